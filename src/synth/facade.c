/* Walls, windows, shops and signs. Each building has its own colours and its own stains. */
#include "synth/noise.h"
#include "synth/texture.h"

#include <math.h>
#include <string.h>

static void bricks(const cn_surface_place *p, float rgb[3])
{
    const uint32_t seed = p->chart->seed;
    const float high = 0.105f, wide = 0.32f, joint = 0.014f;
    const int32_t row = (int32_t)floorf(p->t / high);
    const float s = p->s + (row & 1 ? 0.5f * wide : 0);
    const int32_t column = (int32_t)floorf(s / wide);
    const uint64_t h = cn_noise_hash(column, row, seed);
    const float shown = cn_noise_shown(wide, p->footprint_m), fine = cn_noise_shown(2 * joint, p->footprint_m);
    const float tone = cn_noise_at(1, 2, seed);
    rgb[0] = 0.3f + 0.14f * tone;
    rgb[1] = 0.15f + 0.1f * tone * tone;
    rgb[2] = 0.1f + 0.07f * tone * tone;
    cn_scale3(rgb, 1 + shown * 0.75f * (cn_noise_part(h, 0) - 0.5f));
    if (cn_noise_part(h, 1) < 0.06f) cn_mix3(rgb, (float[3]){ 0.1f, 0.08f, 0.08f }, 0.7f * shown);
    const float x = s - wide * (float)column, y = p->t - high * (float)row;
    const float mortar = x < joint || y < joint ? 1 : 0;
    cn_mix3(rgb, (float[3]){ 0.42f, 0.39f, 0.35f }, fine * mortar + (1 - fine) * 0.17f);
}

static void plaster(const cn_surface_place *p, float rgb[3])
{
    static const float TONES[6][3] = { { 0.62f, 0.55f, 0.4f }, { 0.6f, 0.45f, 0.3f }, { 0.66f, 0.62f, 0.56f },
                                       { 0.5f, 0.55f, 0.5f },  { 0.6f, 0.38f, 0.3f }, { 0.46f, 0.52f, 0.6f } };
    const uint32_t seed = p->chart->seed;
    memcpy(rgb, TONES[cn_noise_hash(3, 3, seed) % 6], 3 * sizeof *rgb);
    /* Plaster has come off in places, most near the ground. */
    const float off = cn_noise_sum(p->s, p->t, seed + 40, (cn_octaves){ 1.6f, 0.6f, 6 }, p->footprint_m) - 0.06f * p->t;
    const float edge = cn_smooth(0.42f, 0.46f, off);
    if (edge > 0) {
        float under[3];
        bricks(p, under);
        cn_mix3(rgb, under, edge);
    }
    cn_scale3(rgb, 1 + 0.17f * cn_noise_sum(p->s, p->t, seed + 50, (cn_octaves){ 0.5f, 0.85f, 5 }, p->footprint_m));
}

static void stone(const cn_surface_place *p, float rgb[3])
{
    const uint32_t seed = p->chart->seed;
    const float high = 0.42f, joint = 0.02f;
    const int32_t row = (int32_t)floorf(p->t / high);
    const float wide = 0.55f + 0.4f * cn_noise_at(row, 77, seed), s = p->s + 3 * cn_noise_at(row, 78, seed);
    const int32_t column = (int32_t)floorf(s / wide);
    const uint64_t h = cn_noise_hash(column, row, seed);
    const float warm = 0.05f * cn_noise_part(h, 1), light = 0.36f + 0.2f * cn_noise_part(h, 0);
    rgb[0] = light + warm;
    rgb[1] = light;
    rgb[2] = light - warm - 0.04f;
    const float x = s - wide * (float)column, y = p->t - high * (float)row;
    if (x < joint || y < joint) cn_scale3(rgb, 1 - 0.55f * cn_noise_shown(2 * joint, p->footprint_m));
    cn_scale3(rgb, 1 + 0.2f * cn_noise_sum(p->s, p->t, seed + 60 + (uint32_t)(h & 15), (cn_octaves){ 0.3f, 0.85f, 4 },
                                           p->footprint_m));
}

static void concrete(const cn_surface_place *p, float rgb[3])
{
    const uint32_t seed = p->chart->seed;
    const float wide = 1.7f, high = 1.25f, joint = 0.03f;
    const int32_t column = (int32_t)floorf(p->s / wide), row = (int32_t)floorf(p->t / high);
    const uint64_t h = cn_noise_hash(column, row, seed);
    const float light = 0.34f + 0.16f * cn_noise_part(h, 0);
    rgb[0] = light;
    rgb[1] = light * 0.99f;
    rgb[2] = light * (0.9f + 0.08f * cn_noise_part(h, 1));
    const float x = p->s - wide * (float)column, y = p->t - high * (float)row;
    if (x < joint || y < joint) cn_scale3(rgb, 1 - 0.6f * cn_noise_shown(2 * joint, p->footprint_m));
    const float hole = hypotf(fabsf(x - 0.5f * wide) - 0.6f, fabsf(y - 0.5f * high) - 0.4f);
    if (hole < 0.035f) cn_scale3(rgb, 0.35f);
    cn_scale3(rgb,
              1 + 0.2f * cn_noise_sum(p->s, 0.4f * p->t, seed + 70, (cn_octaves){ 0.8f, 0.8f, 6 }, p->footprint_m));
}

/* Bills pasted on the wall, within reach of a hand. */
static void bills(const cn_surface_place *p, float rgb[3])
{
    const float wide = 0.95f;
    const int32_t column = (int32_t)floorf(p->s / wide);
    const uint64_t h = cn_noise_hash(column, 500, p->chart->seed);
    if (cn_noise_part(h, 0) > 0.4f) return;
    const float x = p->s - wide * (float)column - 0.1f * cn_noise_part(h, 1) - 0.08f,
                y = p->t - 0.7f - 0.6f * cn_noise_part(h, 2);
    const float w = 0.65f, tall = 0.95f;
    if (x < 0 || x > w || y < 0 || y > tall) return;
    const int32_t ix = (int32_t)(x / w * 5), iy = (int32_t)(y / tall * 8);
    float paper[3], ink[3];
    cn_texture_colour(h, paper);
    cn_texture_colour(cn_noise_hash(ix, iy, (uint32_t)(h >> 32)), ink);
    if (cn_noise_part(cn_noise_hash(ix, iy, (uint32_t)h), 0) < 0.55f) memcpy(paper, ink, sizeof ink);
    cn_mix3(rgb, paper, 0.9f);
}

/* Graffiti: wandering painted lines. */
static void scrawl(const cn_surface_place *p, float rgb[3])
{
    if (p->t > 2.1f || p->t < 0.5f) return;
    const uint32_t seed = p->chart->seed + 90;
    const float where = cn_noise(p->s * 0.23f, 0.5f, seed);
    if (where < 0.25f) return;
    const float line = fabsf(cn_noise_sum(p->s, p->t, seed + 1, (cn_octaves){ 0.7f, 0.5f, 2 }, p->footprint_m));
    float ink[3];
    cn_texture_colour(cn_noise_hash((int32_t)floorf(p->s * 0.3f), 1, seed), ink);
    cn_mix3(rgb, ink, 0.9f * cn_smooth(0.1f, 0.06f, line) * cn_smooth(0.25f, 0.35f, where));
}

void cn_texture_wall(const cn_surface_place *p, float rgb[3])
{
    const uint32_t seed = p->chart->seed;
    switch (cn_lot_wall(seed)) {
    case CN_WALL_BRICK: bricks(p, rgb); break;
    case CN_WALL_PLASTER: plaster(p, rgb); break;
    case CN_WALL_STONE: stone(p, rgb); break;
    default: concrete(p, rgb); break;
    }
    /* Large stains, streaks that rain has drawn, and dirt near the ground. */
    const float stain = cn_noise_sum(p->s, p->t, seed + 10, (cn_octaves){ 3.2f, 0.7f, 6 }, p->footprint_m);
    const float streak =
        cn_noise_sum(p->s * 5, p->t * 0.45f, seed + 20, (cn_octaves){ 1.6f, 0.7f, 4 }, 3 * p->footprint_m);
    cn_scale3(rgb, 1 + 0.12f * stain + 0.1f * streak);
    cn_scale3(rgb, 0.75f + 0.25f * cn_smooth(0, 1.2f + 0.5f * stain, p->t));
    scrawl(p, rgb);
    bills(p, rgb);
}

/* Behind the glass: a room's back wall, dark, lit at night in some windows. */
static void room(const cn_surface_place *p, uint64_t h, cn_surface *out)
{
    const float dim = 0.02f + 0.07f * cn_noise_part(h, 0);
    const uint32_t seed = (uint32_t)h;
    const float pattern = cn_noise_sum(p->a * 2 + 7, p->b * 2, seed, (cn_octaves){ 1, 0.8f, 4 }, 0.6f * p->footprint_m);
    for (int c = 0; c < 3; c++)
        out->albedo[c] = dim * (1 + 0.7f * pattern);
    if (cn_noise_part(h, 1) < 0.38f) {
        static const float warm[3] = { 1, 0.68f, 0.36f };
        for (int c = 0; c < 3; c++)
            out->glow[c] = warm[c] * (0.35f + 0.3f * cn_noise_part(h, 2)) * (1 + 0.4f * pattern);
    }
}

/* Curtains to the sides, a blind from the top, flowers on the sill: each window has its own. */
static bool hangings(const cn_surface_place *p, uint64_t h, cn_surface *out)
{
    const uint64_t k = cn_rng_mix(h);
    const float blind = cn_noise_part(k, 0) < 0.45f ? 0.15f + 0.7f * cn_noise_part(k, 1) : 0;
    const float curtain = cn_noise_part(k, 2) < 0.5f ? 0.08f + 0.3f * cn_noise_part(k, 3) : 0;
    const float aside = p->a < 0.5f ? p->a : 1 - p->a, low = (float)(h >> 5 & 255) / 255 * 0.35f;
    const bool flowers = (h >> 40 & 3) == 0 && p->b < 0.12f + 0.16f * cn_noise(p->a * 9, 1, (uint32_t)k);
    float rgb[3] = { 0.5f, 0.48f, 0.42f };
    if (flowers) {
        cn_texture_colour(cn_noise_hash((int32_t)(p->a * 11), (int32_t)(p->b * 12), (uint32_t)k), rgb);
        rgb[1] += 0.1f;
    } else if (p->b > 1 - blind) {
        cn_scale3(rgb, fmodf(p->b * 14, 1) < 0.25f ? 0.75f : 1);
    } else if (aside < curtain && p->b > low) {
        cn_texture_colour(k >> 3, rgb);
        cn_mix3(rgb, (float[3]){ 0.6f, 0.58f, 0.55f }, 0.5f);
        cn_scale3(rgb, 0.8f + 0.2f * sinf(p->a * 60 + 3 * p->b));
    } else {
        return false;
    }
    for (int c = 0; c < 3; c++) {
        out->albedo[c] = 0.8f * rgb[c];
        out->glow[c] *= 0.55f * rgb[c] + 0.1f;
    }
    return true;
}

void cn_texture_window(const cn_surface_place *p, cn_surface *out)
{
    const uint32_t seed = p->chart->seed;
    const uint64_t h = cn_noise_hash((int32_t)p->patch->id, 200, seed);
    const uint64_t house = cn_noise_hash(1, 201, seed);
    const float rim_a = 0.07f, rim_b = 0.05f, rail = cn_noise_part(house, 0) < 0.5f ? 0.68f : 0.5f;
    const bool frame = p->a < rim_a || p->a > 1 - rim_a || p->b < rim_b || p->b > 1 - rim_b ||
                       fabsf(p->a - 0.5f) < 0.03f || fabsf(p->b - rail) < 0.022f;
    if (frame) {
        const float light = cn_noise_part(house, 1) < 0.65f ? 0.62f : 0.12f;
        const float dirt = 1 - 0.35f * cn_noise_part(h, 3);
        for (int c = 0; c < 3; c++)
            out->albedo[c] = light * dirt * (c == 2 ? 0.92f : 1);
        return;
    }
    room(p, h, out);
    hangings(p, h, out);
    out->mirror = 0.07f;
}

/* Goods on shelves behind the glass of a shop; a door has panels and a bar. */
void cn_texture_shop(const cn_surface_place *p, cn_surface *out)
{
    const uint64_t h = cn_noise_hash((int32_t)p->patch->id, 210, p->chart->seed);
    const uint32_t seed = (uint32_t)h;
    const bool door = p->patch->material == CN_MAT_DOOR && fabsf(p->a - 0.5f) < 0.22f;
    const float edge = door ? 0.035f : 0.025f, a = door ? (p->a - 0.28f) / 0.44f : p->a;
    if (a < edge || a > 1 - edge || p->b < 0.04f || p->b > 0.96f || (door && (p->b < 0.35f || a > 0.85f))) {
        cn_texture_colour(h >> 7, out->albedo);
        cn_scale3(out->albedo,
                  0.5f + 0.15f * cn_noise_sum(p->s * 3, p->t, seed, (cn_octaves){ 0.6f, 0.7f, 4 }, p->footprint_m));
        return;
    }
    const int32_t shelf = (int32_t)floorf(p->t / 0.42f);
    const float wide = 0.16f + 0.3f * cn_noise_at(shelf, 1, seed);
    const int32_t item = (int32_t)floorf(p->s / wide);
    const uint64_t k = cn_noise_hash(item, shelf, seed);
    const float up = p->t / 0.42f - (float)shelf, across = p->s / wide - (float)item;
    const bool goods =
        up < 0.25f + 0.6f * cn_noise_part(k, 3) && fabsf(across - 0.5f) < 0.2f + 0.3f * cn_noise_part(k, 2);
    float rgb[3] = { 0.05f, 0.05f, 0.05f };
    if (up > 0.93f)
        rgb[0] = rgb[1] = rgb[2] = 0.22f;
    else if (goods)
        cn_texture_colour(k, rgb);
    for (int c = 0; c < 3; c++) {
        out->albedo[c] = 0.65f * rgb[c];
        out->glow[c] = (c == 0 ? 1 : c == 1 ? 0.82f : 0.55f) * (0.05f + 1.1f * rgb[c]);
    }
    out->mirror = 0.06f;
}

/* Fake letters: strokes on a grid, different in each sign. */
void cn_texture_sign(const cn_surface_place *p, float rgb[3])
{
    const uint64_t h = cn_noise_hash((int32_t)p->chart->seed, (int32_t)p->patch->id, 220);
    float ink[3];
    cn_texture_colour(h, rgb);
    cn_texture_colour(cn_rng_mix(h), ink);
    const float gap = fabsf(rgb[0] + rgb[1] + rgb[2] - ink[0] - ink[1] - ink[2]);
    if (gap < 0.4f) ink[0] = ink[1] = ink[2] = rgb[0] + rgb[1] + rgb[2] > 0.9f ? 0.03f : 0.75f;
    const float tall = fminf(0.45f, 0.6f * p->chart->height_m), wide = 0.75f * tall;
    const float line = p->t - 0.18f * p->chart->height_m;
    const int32_t row = (int32_t)floorf(line / (1.5f * tall)), letter = (int32_t)floorf(p->s / wide);
    const uint64_t glyph = cn_noise_hash(letter, row, (uint32_t)h);
    const int32_t x = (int32_t)floorf((p->s / wide - (float)letter) * 5),
                  y = (int32_t)floorf((line / tall - 1.5f * (float)row) * 6);
    if (y < 0 || y > 5 || x == 0 || cn_noise_part(glyph, 3) < 0.12f) return;
    const bool stroke =
        x == 1 + (int32_t)(glyph & 1) * 3 || (glyph >> (8 + y) & 1) || ((glyph >> 20 & 1) && x == y - 1);
    if (stroke) cn_mix3(rgb, ink, cn_noise_shown(0.3f * tall, p->footprint_m));
}
