/* Houses: walls with windows set back into them, sills, cornices, balconies, and the fronts of shops. */
#include "synth/town.h"

#include <math.h>

#define RECESS_M 0.16f
#define TEXEL_M 0.8f

/* A wall: its lower left corner as seen from outside, its direction, its outward normal. */
typedef struct wall {
    float corner[3], u[3], n[3], length, height;
    uint32_t seed;
    bool recessed;
} wall;

/* The place s along, t up and `out` before the wall. */
static void place(const wall *w, float s, float t, float out, float p[3])
{
    for (int a = 0; a < 3; a++)
        p[a] = w->corner[a] + s * w->u[a] + out * w->n[a];
    p[2] += t;
}

/* A rectangle of the wall. */
typedef struct area {
    float s, t, width, height;
} area;

/* A rectangle parallel to the wall. */
static void facing(cn_mesh *mesh, const wall *w, area a, float out)
{
    if (a.width <= 0 || a.height <= 0) return;
    float p[3];
    place(w, a.s, a.t, out, p);
    cn_mesh_patch(mesh, p, (float[3]){ w->u[0] * a.width, w->u[1] * a.width, 0 }, (float[3]){ 0, 0, a.height });
}

/* A box that stands out of the wall by `out`. */
static void ledge(cn_mesh *mesh, const wall *w, area a, float out)
{
    float p[3], q[3];
    place(w, a.s, a.t, 0, p);
    const float u[3] = { w->u[0] * a.width, w->u[1] * a.width, 0 }, n[3] = { w->n[0] * out, w->n[1] * out, 0 };
    const float up[3] = { 0, 0, a.height }, back[3] = { -n[0], -n[1], 0 };
    place(w, a.s, a.t, out, q);
    cn_mesh_panel(mesh, q, u, up);
    place(w, a.s, a.t + a.height, out, q);
    cn_mesh_patch(mesh, q, u, back);
    cn_mesh_patch(mesh, p, u, n);
    place(w, a.s + a.width, a.t, out, q);
    cn_mesh_patch(mesh, q, back, up);
    cn_mesh_patch(mesh, p, n, up);
}

/* The four sides of an opening, in the wall's own light map. */
static void reveal(cn_mesh *mesh, const wall *w, area a)
{
    const float in[3] = { -RECESS_M * w->n[0], -RECESS_M * w->n[1], 0 };
    const float out[3] = { -in[0], -in[1], 0 }, up[3] = { 0, 0, a.height };
    const float along[3] = { w->u[0] * a.width, w->u[1] * a.width, 0 };
    float p[3];
    mesh->material = CN_MAT_REVEAL;
    place(w, a.s, a.t, 0, p);
    cn_mesh_patch(mesh, p, in, up);
    cn_mesh_patch(mesh, p, along, in);
    place(w, a.s + a.width, a.t, -RECESS_M, p);
    cn_mesh_patch(mesh, p, out, up);
    place(w, a.s, a.t + a.height, -RECESS_M, p);
    cn_mesh_patch(mesh, p, along, out);
}

static void opening(cn_mesh *mesh, const wall *w, area a, cn_material what)
{
    mesh->id++;
    if (w->recessed) reveal(mesh, w, a);
    mesh->material = what;
    facing(mesh, w, a, w->recessed ? -RECESS_M : 0);
}

static void balcony(cn_mesh *mesh, const wall *w, float s, float t, float width)
{
    const uint32_t chart = mesh->chart;
    mesh->material = CN_MAT_REVEAL;
    ledge(mesh, w, (area){ s - 0.35f, t - 0.85f, width + 0.7f, 0.15f }, 0.9f);
    mesh->material = CN_MAT_METAL;
    float p[3];
    mesh->keep_chart = true;
    for (int i = 0; i < 7; i++) {
        place(w, s - 0.3f + (width + 0.6f) * (float)i / 6, t - 0.7f, 0.82f, p);
        cn_mesh_block(mesh, p, (float[3]){ 0.05f, 0.05f, 0.95f }, 0);
    }
    place(w, s - 0.35f, t + 0.2f, 0.82f, p);
    cn_mesh_box(mesh, p, (float[3]){ w->u[0] * (width + 0.7f), w->u[1] * (width + 0.7f), 0 },
                (float[3]){ -0.06f * w->n[0], -0.06f * w->n[1], 0 }, (float[3]){ 0, 0, 0.06f });
    mesh->keep_chart = false;
    mesh->chart = chart;
}

typedef struct bays {
    uint32_t n;
    float step, first, width, height, sill;
} bays;

static bays lay_bays(const wall *w, float floor_m)
{
    bays b = { .width = cn_town_between(w->seed, 20, 0.95f, 1.5f),
               .height = cn_town_between(w->seed, 21, 1.4f, 1.9f),
               .sill = cn_town_between(w->seed, 22, 0.75f, 0.95f) };
    const float wish = b.width + cn_town_between(w->seed, 23, 1, 1.7f);
    if (b.sill + b.height > floor_m - 0.3f) b.height = floor_m - 0.3f - b.sill;
    b.n = (uint32_t)fmaxf(1, floorf((w->length - 0.8f) / wish));
    b.step = w->length / (float)b.n;
    b.first = 0.5f * (b.step - b.width);
    return b;
}

/* One floor: the wall in strips around its windows. */
static void storey(cn_mesh *mesh, const wall *w, float t, float floor_m, const bays *b, bool balconies)
{
    const uint32_t chart = mesh->chart;
    float from = 0;
    mesh->material = CN_MAT_WALL;
    facing(mesh, w, (area){ 0, t, w->length, b->sill }, 0);
    facing(mesh, w, (area){ 0, t + b->sill + b->height, w->length, floor_m - b->sill - b->height }, 0);
    for (uint32_t i = 0; i < b->n; i++) {
        const float s = b->first + b->step * (float)i;
        /* Now and then a window is missing, as in real houses. */
        if (cn_town_random(w->seed, 300 + mesh->id) < 0.07f) {
            mesh->id++;
            continue;
        }
        mesh->material = CN_MAT_WALL;
        facing(mesh, w, (area){ from, t + b->sill, s - from, b->height }, 0);
        opening(mesh, w, (area){ s, t + b->sill, b->width, b->height }, CN_MAT_WINDOW);
        from = s + b->width;
        if (!w->recessed) continue;
        mesh->material = CN_MAT_REVEAL;
        mesh->keep_chart = true;
        ledge(mesh, w, (area){ s - 0.08f, t + b->sill - 0.09f, b->width + 0.16f, 0.09f }, 0.13f);
        mesh->keep_chart = false;
        if (balconies && cn_town_random(w->seed, 700 + mesh->id) < 0.4f) balcony(mesh, w, s, t + b->sill, b->width);
        mesh->chart = chart;
    }
    mesh->material = CN_MAT_WALL;
    facing(mesh, w, (area){ from, t + b->sill, w->length - from, b->height }, 0);
}

static void awning(cn_mesh *mesh, const wall *w, float s, float width, float t)
{
    float p[3];
    place(w, s, t - 0.55f, 1.3f, p);
    mesh->material = CN_MAT_AWNING;
    cn_mesh_panel(mesh, p, (float[3]){ w->u[0] * width, w->u[1] * width, 0 },
                  (float[3]){ -1.3f * w->n[0], -1.3f * w->n[1], 0.55f });
    mesh->material = CN_MAT_AWNING;
    cn_mesh_patch(mesh, (float[3]){ p[0], p[1], p[2] - 0.22f }, (float[3]){ w->u[0] * width, w->u[1] * width, 0 },
                  (float[3]){ 0, 0, 0.22f });
}

/* Shop windows and a door between piers, below a band for the sign. */
static void shop(cn_mesh *mesh, const wall *w, float ground_floor_m)
{
    const uint32_t chart = mesh->chart;
    const uint32_t n = (uint32_t)fmaxf(1, floorf(w->length / 3.4f));
    const float step = w->length / (float)n, pier = 0.4f, top = ground_floor_m - 1.05f, base = 0.45f;
    mesh->material = CN_MAT_WALL;
    facing(mesh, w, (area){ 0, top, w->length, ground_floor_m - top }, 0);
    for (uint32_t i = 0; i < n; i++) {
        const bool door = i == (uint32_t)(cn_town_random(w->seed, 30) * (float)n);
        const float s = step * (float)i + 0.5f * pier, width = step - pier, low = door ? 0.02f : base;
        mesh->material = CN_MAT_WALL;
        facing(mesh, w, (area){ s - 0.5f * pier, 0, 0.5f * pier, top }, 0);
        facing(mesh, w, (area){ s + width, 0, 0.5f * pier, top }, 0);
        facing(mesh, w, (area){ s, 0, width, low }, 0);
        opening(mesh, w, (area){ s, low, width, top - low }, door ? CN_MAT_DOOR : CN_MAT_SHOP);
    }
    if (!w->recessed) return;
    mesh->material = CN_MAT_SIGN;
    ledge(mesh, w, (area){ 0.3f, top + 0.15f, w->length - 0.6f, 0.65f }, 0.1f);
    if (cn_town_random(w->seed, 31) < 0.4f) awning(mesh, w, 0.3f, w->length - 0.6f, top + 0.1f);
    mesh->chart = chart;
}

static wall side_of(const cn_lot *lot, int side)
{
    static const float along[4][2] = { { 1, 0 }, { 0, 1 }, { -1, 0 }, { 0, -1 } };
    const cn_rect *r = &lot->rect;
    wall w = { .u = { along[side][0], along[side][1], 0 }, .n = { along[side][1], -along[side][0], 0 } };
    w.corner[0] = side == 0 || side == 3 ? r->x0 : r->x1;
    w.corner[1] = side < 2 ? r->y0 : r->y1;
    w.corner[2] = CN_WALK_HEIGHT_M;
    w.length = side % 2 == 0 ? r->x1 - r->x0 : r->y1 - r->y0;
    w.height = cn_lot_height(lot);
    w.seed = lot->seed;
    w.recessed = lot->near;
    return w;
}

static void build_front(const cn_lot *lot, int side, cn_mesh *mesh)
{
    const wall w = side_of(lot, side);
    const float along[3] = { w.u[0] * w.length, w.u[1] * w.length, 0 }, up[3] = { 0, 0, w.height };
    mesh->texel_m = lot->near && !lot->party[side] ? TEXEL_M : 5;
    cn_mesh_chart(mesh, w.corner, along, up);
    const uint32_t chart = mesh->chart;
    mesh->id = (uint32_t)side * 1000;
    mesh->material = CN_MAT_WALL;
    if (lot->party[side]) {
        facing(mesh, &w, (area){ 0, 0, w.length, w.height }, 0);
        return;
    }
    const bays b = lay_bays(&w, lot->floor_m);
    const bool balconies = lot->near && cn_town_random(lot->seed, 40 + (uint32_t)side) < 0.35f;
    if (lot->street[side] && cn_town_random(lot->seed, 50) < 0.7f)
        shop(mesh, &w, lot->ground_floor_m);
    else
        storey(mesh, &w, 0, lot->ground_floor_m, &b, false);
    for (uint32_t f = 0; f < lot->floors; f++)
        storey(mesh, &w, lot->ground_floor_m + (float)f * lot->floor_m, lot->floor_m, &b, balconies);
    const float top = lot->ground_floor_m + (float)lot->floors * lot->floor_m;
    facing(mesh, &w, (area){ 0, top, w.length, w.height - top }, 0);
    if (!lot->near || !lot->street[side]) return;
    mesh->material = CN_MAT_REVEAL;
    ledge(mesh, &w, (area){ 0, lot->ground_floor_m - 0.1f, w.length, 0.18f }, 0.12f);
    mesh->chart = chart;
    ledge(mesh, &w, (area){ 0, w.height - 0.35f, w.length, 0.3f }, 0.28f);
}

void cn_town_build_house(const cn_lot *lot, cn_mesh *mesh)
{
    mesh->seed = lot->seed;
    for (int side = 0; side < 4; side++)
        build_front(lot, side, mesh);
    cn_town_build_roof(lot, mesh);
}
