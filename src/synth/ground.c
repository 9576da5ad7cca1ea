/* Roads with their markings, pavements, lawns; and roofs. */
#include "synth/noise.h"
#include "synth/texture.h"

#include <math.h>

/* Distance to the nearest axis, and its index. */
static float nearest(const float *axes, uint32_t n, float at, uint32_t *which)
{
    float best = 1e9f;
    for (uint32_t i = 0; i < n; i++)
        if (fabsf(at - axes[i]) < fabsf(best)) {
            best = at - axes[i];
            *which = i;
        }
    return best;
}

/* White paint on a street that runs along `along`, at `across` from its axis; `end` metres from the crossing's middle.
 */
static float marking(float along, float across, float end)
{
    const float to_crossing = end - CN_ROAD_HALF_M;
    if (to_crossing < 0.8f) return 0;
    /* Zebra, a line to stop at, dashes between the lanes, a line along the kerb. */
    if (to_crossing < 3.6f) return fmodf(across + 40, 1) < 0.5f && fabsf(across) < CN_ROAD_HALF_M - 0.3f ? 1 : 0;
    if (to_crossing > 4.4f && to_crossing < 4.8f) return across > 0.1f && across < CN_ROAD_HALF_M - 0.2f ? 1 : 0;
    if (to_crossing < 5.2f) return 0;
    if (fabsf(across) < 0.07f) return fmodf(along + 4000, 3.2f) < 1.6f ? 1 : 0;
    return fabsf(fabsf(across) - (CN_ROAD_HALF_M - 0.35f)) < 0.05f ? 0.8f : 0;
}

static float road_paint(const cn_town *town, float x, float y)
{
    uint32_t ix = 0, iy = 0;
    const float dx = nearest(town->x, town->n_x, x, &ix), dy = nearest(town->y, town->n_y, y, &iy);
    if (fabsf(dx) < CN_ROAD_HALF_M && fabsf(dy) < CN_ROAD_HALF_M) return 0;
    /* Traffic keeps to the right: the stop line lies on the right lane for who comes to the crossing. */
    if (fabsf(dx) < CN_ROAD_HALF_M) return marking(y, dy > 0 ? -dx : dx, fabsf(dy));
    if (fabsf(dy) < CN_ROAD_HALF_M) return marking(x, dx > 0 ? dy : -dy, fabsf(dx));
    return 0;
}

/* Manhole covers in some squares of the road: rings and a pattern. */
static void lids(float x, float y, uint32_t seed, float rgb[3])
{
    const float cell = 5.5f;
    const int32_t ix = (int32_t)floorf(x / cell), iy = (int32_t)floorf(y / cell);
    const uint64_t h = cn_noise_hash(ix, iy, seed + 5);
    if (cn_noise_part(h, 0) > 0.45f) return;
    const float dx = x - cell * ((float)ix + 0.2f + 0.6f * cn_noise_part(h, 1)),
                dy = y - cell * ((float)iy + 0.2f + 0.6f * cn_noise_part(h, 2));
    const float r = hypotf(dx, dy), size = 0.28f + 0.15f * cn_noise_part(h, 3);
    if (r > size) return;
    const bool ring = r > size - 0.05f || fabsf(r - 0.5f * size) < 0.025f;
    const float tone = ring ? 0.04f : fmodf(atan2f(dy, dx) * (float)(3 + (h & 7)) + 60, 1) < 0.5f ? 0.17f : 0.1f;
    rgb[0] = rgb[1] = rgb[2] = tone;
}

/* Mended places, darker or lighter, with edges. */
static float mended(float x, float y, uint32_t seed)
{
    const float cell = 7;
    const int32_t ix = (int32_t)floorf(x / cell), iy = (int32_t)floorf(y / cell);
    const uint64_t h = cn_noise_hash(ix, iy, seed + 6);
    const float u = x - cell * (float)ix - 3 * cn_noise_part(h, 1), v = y - cell * (float)iy - 3 * cn_noise_part(h, 2);
    if (cn_noise_part(h, 0) > 0.6f || u < 0 || v < 0 || u > 1 + 3 * cn_noise_part(h, 3) ||
        v > 1 + 2 * cn_noise_part(h, 1))
        return 1;
    return 0.7f + 0.45f * cn_noise_part(h, 2);
}

static void road(const cn_town *town, const cn_surface_place *p, float rgb[3])
{
    const float x = p->position[0], y = p->position[1], f = p->footprint_m;
    const uint32_t seed = town->seed;
    const float broad = cn_noise_sum(x, y, seed + 100, (cn_octaves){ 2.6f, 0.75f, 7 }, f),
                grain = cn_noise_sum(x, y, seed + 120, (cn_octaves){ 0.16f, 0.9f, 3 }, f);
    rgb[0] = 0.135f;
    rgb[1] = 0.133f;
    rgb[2] = 0.13f;
    cn_scale3(rgb, (1 + 0.17f * broad + 0.3f * grain) * mended(x, y, seed));
    /* Cracks: where slow noise crosses zero. */
    const float crack = fabsf(cn_noise_sum(x, y, seed + 140, (cn_octaves){ 2.2f, 0.55f, 5 }, f));
    cn_scale3(rgb, 1 - 0.6f * cn_smooth(0.03f, 0.005f, crack));
    const float spot = cn_noise_sum(x, y, seed + 160, (cn_octaves){ 0.7f, 0.5f, 3 }, f);
    cn_scale3(rgb, 1 - 0.35f * cn_smooth(0.55f, 0.75f, spot));
    const float worn = cn_smooth(-0.75f, 0.1f, broad + 0.6f * grain);
    cn_mix3(rgb, (float[3]){ 0.6f, 0.6f, 0.57f }, 0.9f * worn * road_paint(town, x, y));
    lids(x, y, seed, rgb);
}

static void paving(const cn_town *town, const cn_surface_place *p, float rgb[3])
{
    const float x = p->position[0], y = p->position[1], f = p->footprint_m, slab = 0.5f, joint = 0.022f;
    const uint32_t seed = town->seed + 200;
    const int32_t row = (int32_t)floorf(y / slab);
    const float sx = x + (row & 1 ? 0.25f : 0);
    const int32_t column = (int32_t)floorf(sx / slab);
    const uint64_t h = cn_noise_hash(column, row, seed);
    const float shown = cn_noise_shown(slab, f), light = 0.33f + shown * 0.2f * (cn_noise_part(h, 0) - 0.5f);
    rgb[0] = light * (1 + 0.08f * shown * (cn_noise_part(h, 1) - 0.3f));
    rgb[1] = light;
    rgb[2] = light * 0.94f;
    if (cn_noise_part(h, 2) < 0.05f) cn_scale3(rgb, 1 - 0.4f * shown);
    const float u = sx - slab * (float)column, v = y - slab * (float)row;
    if (u < joint || v < joint) cn_scale3(rgb, 1 - 0.5f * cn_noise_shown(2 * joint, f));
    const float broad = cn_noise_sum(x, y, seed + 1, (cn_octaves){ 1.9f, 0.75f, 6 }, f);
    cn_scale3(rgb, 1 + 0.22f * broad);
    /* Gum, and leaves that fell. */
    const int32_t gx = (int32_t)floorf(x * 3), gy = (int32_t)floorf(y * 3);
    const uint64_t g = cn_noise_hash(gx, gy, seed + 9);
    const float dx = x * 3 - (float)gx - cn_noise_part(g, 1), dy = y * 3 - (float)gy - cn_noise_part(g, 2);
    if (cn_noise_part(g, 0) < 0.35f && dx * dx + dy * dy < 0.016f) {
        const float leaf[3] = { 0.28f, 0.18f, 0.05f }, gum[3] = { 0.12f, 0.12f, 0.12f };
        cn_mix3(rgb, cn_noise_part(g, 3) < 0.5f ? leaf : gum, cn_noise_shown(0.08f, f));
    }
}

static void lawn(const cn_town *town, const cn_surface_place *p, float rgb[3])
{
    const float x = p->position[0], y = p->position[1], f = p->footprint_m;
    const uint32_t seed = town->seed + 300;
    const float broad = cn_noise_sum(x, y, seed, (cn_octaves){ 4, 0.7f, 5 }, f),
                grain = cn_noise_sum(x, y, seed + 20, (cn_octaves){ 0.25f, 0.9f, 4 }, f);
    rgb[0] = 0.1f + 0.035f * broad;
    rgb[1] = 0.17f + 0.02f * broad;
    rgb[2] = 0.05f;
    cn_scale3(rgb, 1 + 0.35f * broad + 0.4f * grain);
    const float bare = cn_smooth(0.5f, 0.75f, cn_noise_sum(x, y, seed + 40, (cn_octaves){ 2.1f, 0.6f, 6 }, f));
    cn_mix3(rgb, (float[3]){ 0.25f, 0.19f, 0.12f }, bare);
    const int32_t gx = (int32_t)floorf(x * 2.5f), gy = (int32_t)floorf(y * 2.5f);
    const uint64_t g = cn_noise_hash(gx, gy, seed + 9);
    const float dx = x * 2.5f - (float)gx - cn_noise_part(g, 1), dy = y * 2.5f - (float)gy - cn_noise_part(g, 2);
    if (cn_noise_part(g, 0) < 0.3f && dx * dx + dy * dy < 0.02f) {
        const float white[3] = { 0.65f, 0.65f, 0.6f }, yellow[3] = { 0.65f, 0.5f, 0.05f };
        cn_mix3(rgb, cn_noise_part(g, 3) < 0.6f ? white : yellow, cn_noise_shown(0.1f, f));
    }
}

static void kerb(const cn_town *town, const cn_surface_place *p, float rgb[3])
{
    const int32_t stone = (int32_t)floorf(p->s);
    const float light = 0.3f + 0.16f * cn_noise_at(stone, 1, town->seed + p->patch->chart);
    const float n = cn_noise_sum(p->s, p->t, town->seed + 400, (cn_octaves){ 0.5f, 0.8f, 5 }, p->footprint_m);
    rgb[0] = rgb[1] = light * (1 + 0.25f * n) * (p->s - (float)stone < 0.03f ? 0.5f : 1);
    rgb[2] = 0.97f * rgb[0];
}

void cn_texture_ground(const cn_town *town, const cn_surface_place *p, float rgb[3])
{
    switch (p->patch->material) {
    case CN_MAT_ROAD: road(town, p, rgb); break;
    case CN_MAT_PAVING: paving(town, p, rgb); break;
    case CN_MAT_LAWN: lawn(town, p, rgb); break;
    default: kerb(town, p, rgb); break;
    }
}

static void tiles(const cn_surface_place *p, float rgb[3])
{
    const uint32_t seed = p->chart->seed + 500;
    const float high = 0.36f, wide = 0.27f, f = p->footprint_m;
    const int32_t row = (int32_t)floorf(p->t / high);
    const float s = p->s + (row & 1 ? 0.5f * wide : 0);
    const int32_t column = (int32_t)floorf(s / wide);
    const uint64_t h = cn_noise_hash(column, row, seed), house = cn_noise_hash(1, 1, seed);
    const float grey = cn_noise_part(house, 0) < 0.35f ? 1 : 0, shown = cn_noise_shown(high, f);
    const float base[3] = { 0.36f, 0.15f, 0.085f }, slate[3] = { 0.16f, 0.165f, 0.18f };
    for (int c = 0; c < 3; c++)
        rgb[c] = base[c] + grey * (slate[c] - base[c]);
    cn_scale3(rgb, 1 + shown * 0.7f * (cn_noise_part(h, 0) - 0.5f));
    const float up = p->t / high - (float)row;
    cn_scale3(rgb, 1 - 0.5f * cn_noise_shown(0.1f, f) * cn_smooth(0.2f, 0, up));
    const float moss = cn_smooth(0.2f, 0.6f, cn_noise_sum(p->s, p->t, seed + 2, (cn_octaves){ 1.7f, 0.7f, 6 }, f));
    cn_mix3(rgb, (float[3]){ 0.14f, 0.16f, 0.07f }, 0.7f * moss);
}

/* Felt in strips, gravel, puddles that dried. */
static void felt(const cn_surface_place *p, float rgb[3])
{
    const uint32_t seed = p->chart->seed + 600;
    const float f = p->footprint_m, strip = 1.05f, tone = 0.16f + 0.22f * cn_noise_at(2, 2, seed);
    const int32_t i = (int32_t)floorf(p->s / strip);
    const float broad = cn_noise_sum(p->s, p->t, seed, (cn_octaves){ 2.7f, 0.75f, 7 }, f),
                grain = cn_noise_sum(p->s, p->t, seed + 20, (cn_octaves){ 0.2f, 0.9f, 3 }, f);
    const float light = tone * (0.85f + 0.3f * cn_noise_at(i, 1, seed)) * (1 + 0.3f * broad + 0.3f * grain);
    rgb[0] = light * 1.02f;
    rgb[1] = light;
    rgb[2] = light * 0.96f;
    if (p->s - strip * (float)i < 0.05f) cn_scale3(rgb, 0.55f);
    const float pool = cn_smooth(0.35f, 0.42f, cn_noise_sum(p->s, p->t, seed + 40, (cn_octaves){ 3.3f, 0.5f, 5 }, f));
    cn_scale3(rgb, 1 - 0.4f * pool);
}

void cn_texture_roof(const cn_surface_place *p, float rgb[3])
{
    if (p->patch->material == CN_MAT_TILES)
        tiles(p, rgb);
    else
        felt(p, rgb);
}
