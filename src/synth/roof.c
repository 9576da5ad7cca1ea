/* Roofs: flat ones behind a parapet with what stands on them, and gables with tiles. */
#include "synth/town.h"

#include <math.h>

static void chimney(cn_mesh *mesh, float x, float y, float z, float height, uint32_t seed)
{
    mesh->material = CN_MAT_WALL;
    cn_mesh_block(mesh, (float[3]){ x, y, z }, (float[3]){ 0.7f, 0.9f, height }, 0);
    mesh->material = CN_MAT_METAL;
    for (int i = 0; i < 2; i++)
        cn_mesh_prism(mesh, (float[3]){ x, y - 0.2f + 0.4f * (float)i, z + height },
                      cn_town_between(seed, 90, 0.25f, 0.5f), 0.12f, 0.12f, 6);
}

static void parapet(cn_mesh *mesh, const cn_rect *r, float z)
{
    const float w = r->x1 - r->x0, h = r->y1 - r->y0, thick = 0.28f, high = 0.55f;
    mesh->material = CN_MAT_REVEAL;
    const float x = 0.5f * (r->x0 + r->x1), y = 0.5f * (r->y0 + r->y1);
    cn_mesh_block(mesh, (float[3]){ x, r->y0 + 0.5f * thick, z }, (float[3]){ w, thick, high }, 0);
    cn_mesh_block(mesh, (float[3]){ x, r->y1 - 0.5f * thick, z }, (float[3]){ w, thick, high }, 0);
    cn_mesh_block(mesh, (float[3]){ r->x0 + 0.5f * thick, y, z }, (float[3]){ thick, h - 2 * thick, high }, 0);
    cn_mesh_block(mesh, (float[3]){ r->x1 - 0.5f * thick, y, z }, (float[3]){ thick, h - 2 * thick, high }, 0);
}

static void flat(const cn_lot *lot, cn_mesh *mesh, float z)
{
    const cn_rect *r = &lot->rect;
    mesh->material = CN_MAT_FLAT_ROOF;
    cn_mesh_panel(mesh, (float[3]){ r->x0, r->y0, z }, (float[3]){ r->x1 - r->x0, 0, 0 },
                  (float[3]){ 0, r->y1 - r->y0, 0 });
    if (!lot->near) return;
    parapet(mesh, r, z);
    const uint32_t n = 3 + (uint32_t)(cn_town_random(lot->seed, 60) * 4);
    for (uint32_t i = 0; i < n; i++) {
        const float x = cn_town_between(lot->seed, 61 + i, r->x0 + 1.5f, r->x1 - 1.5f);
        const float y = cn_town_between(lot->seed, 71 + i, r->y0 + 1.5f, r->y1 - 1.5f);
        const float kind = cn_town_random(lot->seed, 81 + i);
        mesh->id = 5000 + i;
        if (kind < 0.25f) {
            chimney(mesh, x, y, z, 1.4f, lot->seed + i);
        } else {
            mesh->material = kind < 0.5f ? CN_MAT_WINDOW : kind < 0.8f ? CN_MAT_METAL : CN_MAT_REVEAL;
            cn_mesh_block(mesh, (float[3]){ x, y, z }, (float[3]){ 1 + 2 * kind, 1.6f - kind, 0.4f + kind }, 0);
        }
    }
}

/* A ridge along the longer side. axis 0: along x. */
static void gable(const cn_lot *lot, cn_mesh *mesh, float z)
{
    const cn_rect *r = &lot->rect;
    const float w = r->x1 - r->x0, h = r->y1 - r->y0, up = lot->gable_m, over = 0.35f;
    const bool along_x = w >= h;
    const float half = 0.5f * (along_x ? h : w), drop = over * up / half;
    mesh->material = CN_MAT_TILES;
    if (along_x) {
        cn_mesh_panel(mesh, (float[3]){ r->x0, r->y0 - over, z - drop }, (float[3]){ w, 0, 0 },
                      (float[3]){ 0, half + over, up + drop });
        cn_mesh_panel(mesh, (float[3]){ r->x1, r->y1 + over, z - drop }, (float[3]){ -w, 0, 0 },
                      (float[3]){ 0, -half - over, up + drop });
    } else {
        cn_mesh_panel(mesh, (float[3]){ r->x0 - over, r->y1, z - drop }, (float[3]){ 0, -h, 0 },
                      (float[3]){ half + over, 0, up + drop });
        cn_mesh_panel(mesh, (float[3]){ r->x1 + over, r->y0, z - drop }, (float[3]){ 0, h, 0 },
                      (float[3]){ -half - over, 0, up + drop });
    }
    mesh->material = CN_MAT_WALL;
    for (int end = 0; end < 2; end++) {
        const float s = end ? -1.0f : 1.0f;
        /* Two right triangles a gable, back to back, on one light map. */
        const float base[3] = { along_x ? (end ? r->x0 : r->x1) : 0.5f * (r->x0 + r->x1),
                                along_x ? 0.5f * (r->y0 + r->y1) : (end ? r->y1 : r->y0), z };
        const float out[3] = { along_x ? 0 : s * half, along_x ? s * half : 0, 0 }, in[3] = { -out[0], -out[1], 0 };
        const float lift[3] = { 0, 0, up };
        cn_mesh_chart(mesh, (float[3]){ base[0] - out[0], base[1] - out[1], z },
                      (float[3]){ 2 * out[0], 2 * out[1], 0 }, lift);
        cn_mesh_triangle(mesh, base, out, lift);
        cn_mesh_triangle(mesh, base, lift, in);
    }
    if (!lot->near) return;
    const float x = cn_town_between(lot->seed, 61, r->x0 + 1, r->x1 - 1),
                y = cn_town_between(lot->seed, 62, r->y0 + 1, r->y1 - 1);
    chimney(mesh, x, y, z, up + 0.9f, lot->seed);
}

void cn_town_build_roof(const cn_lot *lot, cn_mesh *mesh)
{
    const float z = cn_lot_height(lot) + CN_WALK_HEIGHT_M;
    mesh->texel_m = lot->near ? 0.9f : 6;
    if (lot->gable_m > 0)
        gable(lot, mesh, z);
    else
        flat(lot, mesh, z);
}
