#include "synth/texture.h"

#include "synth/noise.h"

#include <math.h>
#include <string.h>

static void set(float out[3], float r, float g, float b)
{
    out[0] = r;
    out[1] = g;
    out[2] = b;
}

static void bark(const cn_surface_place *p, float albedo[3])
{
    const float n = cn_noise_sum(p->s * 6, p->position[2] * 1.5f, p->chart->seed, (cn_octaves){ 0.8f, 0.7f, 5 },
                                 p->footprint_m * 3);
    set(albedo, 0.17f, 0.12f, 0.085f);
    cn_scale3(albedo, 1 + 0.55f * n);
}

static void leaf(const cn_surface_place *p, cn_surface *out)
{
    const uint64_t h = cn_noise_hash((int32_t)p->patch->id, 1, p->chart->seed);
    const float tree = cn_noise_at(3, 4, p->chart->seed), v = 0.55f + 0.9f * cn_noise_part(h, 0);
    set(out->albedo, 0.10f + 0.07f * tree + 0.06f * cn_noise_part(h, 1), 0.19f + 0.03f * cn_noise_part(h, 2),
        0.045f + 0.03f * tree);
    cn_scale3(out->albedo, v);
    out->wrap = 0.35f;
}

static void paint(const cn_surface_place *p, cn_surface *out)
{
    const uint64_t h = cn_noise_hash((int32_t)p->chart->seed, 7, p->chart->seed);
    static const float COMMON[5][3] = { { 0.6f, 0.6f, 0.6f },
                                        { 0.04f, 0.04f, 0.045f },
                                        { 0.25f, 0.26f, 0.28f },
                                        { 0.35f, 0.03f, 0.03f },
                                        { 0.05f, 0.1f, 0.3f } };
    if (cn_noise_part(h, 3) < 0.7f)
        memcpy(out->albedo, COMMON[(h >> 20) % 5], sizeof out->albedo);
    else
        cn_texture_colour(h, out->albedo);
    cn_scale3(out->albedo,
              1 + 0.12f * cn_noise_sum(p->s, p->t, p->chart->seed, (cn_octaves){ 0.6f, 0.6f, 3 }, p->footprint_m));
    out->mirror = 0.05f;
}

static void cloth(const cn_surface_place *p, float albedo[3])
{
    const uint64_t h = cn_noise_hash((int32_t)p->patch->id, 9, p->chart->seed);
    static const float dull[3] = { 0.16f, 0.15f, 0.15f };
    cn_texture_colour(h, albedo);
    cn_mix3(albedo, dull, 0.3f + 0.5f * cn_noise_part(h, 2));
    if (cn_noise_part(h, 3) < 0.4f && fmodf(p->position[2], 0.14f) < 0.07f) cn_scale3(albedo, 0.45f);
}

static void wood(const cn_surface_place *p, float albedo[3])
{
    const float grain = cn_noise_sum(p->s * 2, p->t * 14, p->chart->seed + p->patch->id, (cn_octaves){ 1, 0.7f, 4 },
                                     p->footprint_m * 3);
    set(albedo, 0.3f, 0.19f, 0.1f);
    cn_scale3(albedo, (1 + 0.35f * grain) * (fmodf(p->t, 0.15f) < 0.02f ? 0.4f : 1));
}

static void metal(const cn_surface_place *p, float albedo[3])
{
    const uint64_t h = cn_noise_hash((int32_t)p->patch->id, 11, p->chart->seed);
    const float base = 0.12f + 0.3f * cn_noise_part(h, 0);
    const float rust = cn_smooth(0.25f, 0.6f,
                                 cn_noise_sum(p->s + p->position[0], p->t + p->position[2], p->chart->seed,
                                              (cn_octaves){ 0.5f, 0.6f, 4 }, p->footprint_m));
    set(albedo, base, base * 1.02f, base * 1.03f);
    cn_mix3(albedo, (float[3]){ 0.26f, 0.13f, 0.07f }, 0.7f * rust);
}

static void reveal(const cn_surface_place *p, float albedo[3])
{
    const uint64_t h = cn_noise_hash(5, 6, p->chart->seed);
    const float light = 0.42f + 0.25f * cn_noise_part(h, 0), warm = 0.06f * cn_noise_part(h, 1);
    const float x = p->position[0] + p->position[1];
    const float n =
        cn_noise_sum(x, p->position[2] * 0.6f, p->chart->seed, (cn_octaves){ 1.2f, 0.7f, 6 }, p->footprint_m);
    set(albedo, light + warm, light, light - warm);
    cn_scale3(albedo, 1 + 0.22f * n);
}

static void awning(const cn_surface_place *p, float albedo[3])
{
    const uint64_t h = cn_noise_hash(8, 8, p->chart->seed);
    cn_texture_colour(h, albedo);
    const int stripe = (int)floorf(p->s / 0.35f);
    if (stripe & 1) set(albedo, 0.7f, 0.68f, 0.62f);
    cn_scale3(albedo,
              1 + 0.15f * cn_noise_sum(p->s, p->t, p->chart->seed, (cn_octaves){ 0.7f, 0.7f, 4 }, p->footprint_m));
}

void cn_texture(const cn_town *town, const cn_surface_place *p, cn_surface *out)
{
    memset(out, 0, sizeof *out);
    switch ((cn_material)p->patch->material) {
    case CN_MAT_WALL: cn_texture_wall(p, out->albedo); break;
    case CN_MAT_REVEAL: reveal(p, out->albedo); break;
    case CN_MAT_WINDOW: cn_texture_window(p, out); break;
    case CN_MAT_SHOP:
    case CN_MAT_DOOR: cn_texture_shop(p, out); break;
    case CN_MAT_SIGN: cn_texture_sign(p, out->albedo); break;
    case CN_MAT_AWNING: awning(p, out->albedo); break;
    case CN_MAT_FLAT_ROOF:
    case CN_MAT_TILES: cn_texture_roof(p, out->albedo); break;
    case CN_MAT_ROAD:
    case CN_MAT_PAVING:
    case CN_MAT_KERB:
    case CN_MAT_LAWN: cn_texture_ground(town, p, out->albedo); break;
    case CN_MAT_BARK: bark(p, out->albedo); break;
    case CN_MAT_LEAF: leaf(p, out); break;
    case CN_MAT_METAL: metal(p, out->albedo); break;
    case CN_MAT_WOOD: wood(p, out->albedo); break;
    case CN_MAT_LAMP:
        set(out->albedo, 0.7f, 0.7f, 0.65f);
        set(out->glow, 1, 0.72f, 0.4f);
        break;
    case CN_MAT_PAINT: paint(p, out); break;
    case CN_MAT_CAR_GLASS:
        set(out->albedo, 0.02f, 0.022f, 0.025f);
        out->mirror = 0.08f;
        break;
    case CN_MAT_TYRE: set(out->albedo, 0.025f, 0.025f, 0.025f); break;
    case CN_MAT_CLOTH: cloth(p, out->albedo); break;
    case CN_MAT_SKIN: set(out->albedo, 0.42f, 0.27f, 0.2f); break;
    }
    for (int c = 0; c < 3; c++)
        out->albedo[c] = out->albedo[c] < 0.015f ? 0.015f : out->albedo[c] > 0.85f ? 0.85f : out->albedo[c];
}
