/* The ground: roads, pavements, lawns; lamps, benches, bins, signs and what stands in the park. */
#include "synth/town.h"

#include "base/units.h"

#include <math.h>

#define HIGH CN_WALK_HEIGHT_M

static void flat(cn_mesh *mesh, float x0, float y0, float x1, float y1, float z)
{
    cn_mesh_panel(mesh, (float[3]){ x0, y0, z }, (float[3]){ x1 - x0, 0, 0 }, (float[3]){ 0, y1 - y0, 0 });
}

static void road(const cn_town *town, cn_mesh *mesh, float x0, float y0, float x1, float y1)
{
    mesh->texel_m = cn_town_near(town, 0.5f * (x0 + x1), 0.5f * (y0 + y1), 28) ? 0.7f : 5;
    flat(mesh, x0, y0, x1, y1, 0);
}

/* Crossings, and the streets between them. */
static void ground(const cn_town *town, cn_mesh *mesh)
{
    const float x0 = town->x[0], x1 = town->x[town->n_x - 1], y0 = town->y[0], y1 = town->y[town->n_y - 1],
                h = CN_ROAD_HALF_M;
    mesh->material = CN_MAT_ROAD;
    for (uint32_t j = 0; j < town->n_y; j++)
        for (uint32_t i = 0; i < town->n_x; i++) {
            const float x = town->x[i], y = town->y[j];
            road(town, mesh, x - h, y - h, x + h, y + h);
            if (i + 1 < town->n_x) road(town, mesh, x + h, y - h, town->x[i + 1] - h, y + h);
            if (j + 1 < town->n_y) road(town, mesh, x - h, y + h, x + h, town->y[j + 1] - h);
        }
    /* Fields beyond the town, low enough not to meet the road's plane. */
    mesh->material = CN_MAT_LAWN;
    mesh->texel_m = 100;
    flat(mesh, x0 - 600, y0 - 600, x1 + 600, y1 + 600, -0.3f);
}

static void pavement(const cn_town *town, cn_mesh *mesh, uint32_t block)
{
    const cn_rect *b = &town->blocks[block];
    const float w = b->x1 - b->x0, h = b->y1 - b->y0, in = CN_WALK_M;
    const bool near = cn_town_near(town, 0.5f * (b->x0 + b->x1), 0.5f * (b->y0 + b->y1), 40);
    mesh->texel_m = near ? 0.7f : 5;
    mesh->material = CN_MAT_KERB;
    cn_mesh_panel(mesh, (float[3]){ b->x0, b->y0, 0 }, (float[3]){ w, 0, 0 }, (float[3]){ 0, 0, HIGH });
    cn_mesh_panel(mesh, (float[3]){ b->x1, b->y0, 0 }, (float[3]){ 0, h, 0 }, (float[3]){ 0, 0, HIGH });
    cn_mesh_panel(mesh, (float[3]){ b->x1, b->y1, 0 }, (float[3]){ -w, 0, 0 }, (float[3]){ 0, 0, HIGH });
    cn_mesh_panel(mesh, (float[3]){ b->x0, b->y1, 0 }, (float[3]){ 0, -h, 0 }, (float[3]){ 0, 0, HIGH });
    mesh->material = CN_MAT_PAVING;
    flat(mesh, b->x0, b->y0, b->x1, b->y0 + in, HIGH);
    flat(mesh, b->x0, b->y1 - in, b->x1, b->y1, HIGH);
    flat(mesh, b->x0, b->y0 + in, b->x0 + in, b->y1 - in, HIGH);
    flat(mesh, b->x1 - in, b->y0 + in, b->x1, b->y1 - in, HIGH);
    mesh->material = CN_MAT_LAWN;
    if (!town->parks[block]) {
        flat(mesh, b->x0 + in, b->y0 + in, b->x1 - in, b->y1 - in, HIGH);
        return;
    }
    const float x = 0.5f * (b->x0 + b->x1), y = 0.5f * (b->y0 + b->y1), path = 1.4f;
    flat(mesh, b->x0 + in, b->y0 + in, x - path, y - path, HIGH);
    flat(mesh, x + path, b->y0 + in, b->x1 - in, y - path, HIGH);
    flat(mesh, b->x0 + in, y + path, x - path, b->y1 - in, HIGH);
    flat(mesh, x + path, y + path, b->x1 - in, b->y1 - in, HIGH);
    mesh->material = CN_MAT_PAVING;
    flat(mesh, b->x0 + in, y - path, b->x1 - in, y + path, HIGH);
    flat(mesh, x - path, b->y0 + in, x + path, y - path, HIGH);
    flat(mesh, x - path, y + path, x + path, b->y1 - in, HIGH);
}

static void lamp(cn_mesh *mesh, const cn_lamp *l)
{
    const float foot[3] = { l->x, l->y, HIGH }, turn = atan2f(l->dy, l->dx);
    mesh->texel_m = 2;
    mesh->material = CN_MAT_METAL;
    cn_mesh_prism(mesh, foot, 0.7f, 0.12f, 0.1f, 6);
    cn_mesh_prism(mesh, (float[3]){ l->x, l->y, HIGH + 0.7f }, 4.7f, 0.065f, 0.05f, 6);
    cn_mesh_block(mesh, (float[3]){ l->x + 0.45f * l->dx, l->y + 0.45f * l->dy, HIGH + 5.35f },
                  (float[3]){ 1, 0.07f, 0.07f }, turn);
    const float x = l->x + 0.95f * l->dx, y = l->y + 0.95f * l->dy;
    cn_mesh_block(mesh, (float[3]){ x, y, HIGH + 5.3f }, (float[3]){ 0.6f, 0.24f, 0.13f }, turn);
    mesh->material = CN_MAT_LAMP;
    cn_mesh_panel(mesh, (float[3]){ x - 0.1f, y + 0.1f, HIGH + 5.29f }, (float[3]){ 0.2f, 0, 0 },
                  (float[3]){ 0, -0.2f, 0 });
}

static void bench(cn_mesh *mesh, float x, float y, float turn)
{
    const float c = cosf(turn), s = sinf(turn);
    mesh->material = CN_MAT_WOOD;
    cn_mesh_block(mesh, (float[3]){ x, y, HIGH + 0.42f }, (float[3]){ 1.7f, 0.45f, 0.06f }, turn);
    cn_mesh_block(mesh, (float[3]){ x - 0.24f * s, y + 0.24f * c, HIGH + 0.5f }, (float[3]){ 1.7f, 0.06f, 0.42f },
                  turn);
    mesh->material = CN_MAT_METAL;
    for (int end = -1; end <= 1; end += 2)
        cn_mesh_block(mesh, (float[3]){ x + 0.7f * c * (float)end, y + 0.7f * s * (float)end, HIGH },
                      (float[3]){ 0.08f, 0.4f, 0.42f }, turn);
}

static void sign_post(cn_mesh *mesh, float x, float y, float turn)
{
    mesh->material = CN_MAT_METAL;
    cn_mesh_prism(mesh, (float[3]){ x, y, HIGH }, 2.4f, 0.035f, 0.035f, 5);
    mesh->material = CN_MAT_SIGN;
    cn_mesh_block(mesh, (float[3]){ x, y, HIGH + 2.1f }, (float[3]){ 0.75f, 0.05f, 0.65f }, turn);
}

/* An advertising column, a kind of bin, a box: each corner of a block has something of its own. */
static void corner_piece(cn_mesh *mesh, float x, float y, uint32_t seed)
{
    const float kind = cn_town_random(seed, 1), turn = cn_town_between(seed, 2, 0, 3);
    mesh->seed = seed;
    mesh->id = seed;
    mesh->texel_m = 1;
    if (kind < 0.35f) {
        mesh->material = CN_MAT_SIGN;
        cn_mesh_prism(mesh, (float[3]){ x, y, HIGH }, 2.6f, 0.6f, 0.6f, 12);
        mesh->material = CN_MAT_METAL;
        cn_mesh_prism(mesh, (float[3]){ x, y, HIGH + 2.6f }, 0.5f, 0.75f, 0.1f, 12);
    } else if (kind < 0.7f) {
        sign_post(mesh, x, y, turn);
        mesh->material = CN_MAT_METAL;
        cn_mesh_prism(mesh, (float[3]){ x + 0.7f, y + 0.5f, HIGH }, 0.9f, 0.24f, 0.3f, 8);
    } else {
        mesh->material = CN_MAT_PAINT;
        cn_mesh_block(mesh, (float[3]){ x, y, HIGH }, (float[3]){ 0.6f, 0.5f, 1.25f }, turn);
        sign_post(mesh, x - 0.8f, y, turn + 1.5f);
    }
}

static void park(const cn_town *town, cn_mesh *mesh, uint32_t block)
{
    const cn_rect *b = &town->blocks[block];
    const float x = 0.5f * (b->x0 + b->x1), y = 0.5f * (b->y0 + b->y1);
    mesh->seed = town->seed + block;
    mesh->texel_m = 1;
    mesh->material = CN_MAT_PAVING;
    for (int i = 0; i < 3; i++) {
        const float side = 3.2f - 0.8f * (float)i;
        cn_mesh_block(mesh, (float[3]){ x, y, HIGH + 0.25f * (float)i }, (float[3]){ side, side, 0.25f }, 0);
    }
    mesh->material = CN_MAT_REVEAL;
    cn_mesh_prism(mesh, (float[3]){ x, y, HIGH + 0.75f }, 3.6f, 0.42f, 0.32f, 14);
    cn_mesh_block(mesh, (float[3]){ x, y, HIGH + 4.35f }, (float[3]){ 1, 1, 0.25f }, 0.78f);
    mesh->material = CN_MAT_METAL;
    cn_mesh_prism(mesh, (float[3]){ x, y, HIGH + 4.6f }, 1.2f, 0.4f, 0.05f, 9);
    for (int i = 0; i < 4; i++) {
        const float s = i & 1 ? 1 : -1, t = i & 2 ? 1 : -1;
        bench(mesh, x + s * 7, y + t * 2.1f, t > 0 ? 0 : (float)CN_PI);
    }
}

void cn_town_build_street(const cn_town *town, cn_mesh *mesh)
{
    mesh->seed = town->seed;
    ground(town, mesh);
    for (uint32_t i = 0; i < town->n_blocks; i++) {
        const cn_rect *b = &town->blocks[i];
        mesh->seed = town->seed;
        pavement(town, mesh, i);
        if (town->parks[i]) park(town, mesh, i);
        for (uint32_t c = 0; c < 4; c++) {
            const float x = c & 1 ? b->x1 - 1.1f : b->x0 + 1.1f, y = c & 2 ? b->y1 - 1.1f : b->y0 + 1.1f;
            if (cn_town_near(town, x, y, 8)) corner_piece(mesh, x, y, town->seed * 5 + i * 4 + c);
        }
    }
    mesh->seed = town->seed;
    for (uint32_t i = 0; i < town->n_lamps; i++)
        if (cn_town_near(town, town->lamps[i].x, town->lamps[i].y, 30)) lamp(mesh, &town->lamps[i]);
}
