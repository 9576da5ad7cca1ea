/* Cars and people: what stands in one photo and not in the next. */
#include "synth/town.h"

#include <math.h>

/* Axes of something that looks along `turn`. */
typedef struct body {
    float x, y, z, c, s;
} body;

static void at(const body *b, float along, float across, float up, float p[3])
{
    p[0] = b->x + along * b->c - across * b->s;
    p[1] = b->y + along * b->s + across * b->c;
    p[2] = b->z + up;
}

static void block(cn_mesh *mesh, const body *b, float along, float across, float up, const float size[3])
{
    float p[3];
    at(b, along, across, up, p);
    cn_mesh_block(mesh, p, size, atan2f(b->s, b->c));
}

/* A quadrilateral as two triangles, corners in the body's axes, counter-clockwise from outside. */
static void quad(cn_mesh *mesh, const body *b, const float corners[4][3])
{
    float p[4][3], e[4][3];
    for (int i = 0; i < 4; i++)
        at(b, corners[i][0], corners[i][1], corners[i][2], p[i]);
    for (int a = 0; a < 3; a++) {
        e[0][a] = p[1][a] - p[0][a];
        e[1][a] = p[3][a] - p[0][a];
        e[2][a] = p[3][a] - p[2][a];
        e[3][a] = p[1][a] - p[2][a];
    }
    cn_mesh_chart(mesh, p[0], e[0], e[1]);
    cn_mesh_triangle(mesh, p[0], e[0], e[1]);
    cn_mesh_triangle(mesh, p[2], e[2], e[3]);
}

/* The part with the windows: a frustum. Its windows lean inwards by the slope. */
typedef struct cabin {
    float front, back, half_width, low, high, slope;
} cabin;

static void build_cabin(cn_mesh *mesh, const body *b, cabin in)
{
    const float front = in.front, back = in.back, w = in.half_width, low = in.low, high = in.high;
    const float f1 = front - in.slope, b1 = back + 0.6f * in.slope, w1 = w - 0.16f;
    const float lower[4][3] = { { back, -w, low }, { front, -w, low }, { front, w, low }, { back, w, low } };
    const float upper[4][3] = { { b1, -w1, high }, { f1, -w1, high }, { f1, w1, high }, { b1, w1, high } };
    mesh->material = CN_MAT_CAR_GLASS;
    for (int i = 0; i < 4; i++) {
        const int j = (i + 1) % 4;
        const float side[4][3] = { { lower[i][0], lower[i][1], lower[i][2] },
                                   { lower[j][0], lower[j][1], lower[j][2] },
                                   { upper[j][0], upper[j][1], upper[j][2] },
                                   { upper[i][0], upper[i][1], upper[i][2] } };
        quad(mesh, b, side);
    }
    mesh->material = CN_MAT_PAINT;
    quad(mesh, b, upper);
}

static void wheel(cn_mesh *mesh, const body *b, float along, float across)
{
    const float r = 0.33f, side = across > 0 ? 1 : -1;
    mesh->material = CN_MAT_TYRE;
    float hub[3];
    at(b, along, across + 0.02f * side, r, hub);
    cn_mesh_chart(mesh, hub, (float[3]){ 0.3f * b->c * -side, 0.3f * b->s * -side, 0 }, (float[3]){ 0, 0, 0.3f });
    for (int i = 0; i < 10; i++) {
        const float a0 = 0.6283185f * (float)i, a1 = a0 + 0.6283185f;
        const float u[3] = { r * cosf(a0) * b->c, r * cosf(a0) * b->s, r * sinf(a0) };
        const float v[3] = { r * cosf(a1) * b->c, r * cosf(a1) * b->s, r * sinf(a1) };
        if (side < 0)
            cn_mesh_triangle(mesh, hub, u, v);
        else
            cn_mesh_triangle(mesh, hub, v, u);
    }
}

void cn_town_build_car(cn_mesh *mesh, float x, float y, float turn, uint32_t seed)
{
    const body b = { x, y, 0, cosf(turn), sinf(turn) };
    const bool van = cn_town_random(seed, 1) < 0.25f;
    const float half = van ? 2.5f : cn_town_between(seed, 2, 1.9f, 2.3f), wide = van ? 0.98f : 0.88f;
    const float waist = van ? 1.15f : 0.88f, roof = van ? 2.3f : cn_town_between(seed, 3, 1.4f, 1.6f);
    mesh->seed = seed;
    mesh->id = seed;
    mesh->texel_m = 10;
    mesh->material = CN_MAT_PAINT;
    block(mesh, &b, 0, 0, 0.24f, (float[3]){ 2 * half, 2 * wide, waist - 0.24f });
    if (van) {
        block(mesh, &b, -0.6f, 0, waist, (float[3]){ 2 * half - 1.4f, 2 * wide - 0.05f, roof - waist });
        build_cabin(mesh, &b, (cabin){ half - 0.35f, half - 1.4f, wide - 0.05f, waist, roof - 0.15f, 0.5f });
    } else {
        build_cabin(
            mesh, &b,
            (cabin){ half - 1.05f, -half + cn_town_between(seed, 4, 0.15f, 0.7f), wide - 0.04f, waist, roof, 0.65f });
    }
    for (int i = 0; i < 4; i++)
        wheel(mesh, &b, (i & 1 ? 0.62f : -0.62f) * half, i & 2 ? wide : -wide);
    mesh->material = CN_MAT_LAMP;
    for (int i = -1; i <= 1; i += 2)
        block(mesh, &b, half, 0.62f * (float)i, 0.6f, (float[3]){ 0.04f, 0.3f, 0.15f });
    mesh->material = CN_MAT_TYRE;
    block(mesh, &b, half, 0, 0.3f, (float[3]){ 0.05f, 1.1f, 0.2f });
}

void cn_town_build_person(cn_mesh *mesh, float x, float y, float z, float turn, uint32_t seed)
{
    const body b = { x, y, z, cosf(turn), sinf(turn) };
    const float tall = cn_town_between(seed, 1, 0.9f, 1.08f), step = cn_town_between(seed, 2, 0.05f, 0.2f);
    float p[3];
    mesh->seed = seed;
    mesh->texel_m = 10;
    mesh->material = CN_MAT_CLOTH;
    for (int leg = -1; leg <= 1; leg += 2) {
        mesh->id = 2;
        at(&b, step * (float)leg, 0.1f * (float)leg, 0, p);
        cn_mesh_prism(mesh, p, 0.88f * tall, 0.075f, 0.1f, 7);
        mesh->id = 1;
        at(&b, -0.6f * step * (float)leg, 0.25f * (float)leg, 0.8f * tall, p);
        cn_mesh_prism(mesh, p, 0.62f * tall, 0.05f, 0.065f, 6);
    }
    at(&b, 0, 0, 0.82f * tall, p);
    cn_mesh_prism(mesh, p, 0.62f * tall, 0.16f, 0.21f, 9);
    mesh->material = CN_MAT_SKIN;
    at(&b, 0, 0, 1.44f * tall, p);
    cn_mesh_prism(mesh, p, 0.14f * tall, 0.07f, 0.11f, 8);
    at(&b, 0, 0, 1.58f * tall, p);
    cn_mesh_prism(mesh, p, 0.14f * tall, 0.11f, 0.07f, 8);
    if (cn_town_random(seed, 3) < 0.4f) {
        mesh->material = CN_MAT_CLOTH;
        mesh->id = 3;
        at(&b, 0, 0.33f, 0.45f * tall, p);
        cn_mesh_block(mesh, p, (float[3]){ 0.32f, 0.12f, 0.34f }, turn);
    }
}
