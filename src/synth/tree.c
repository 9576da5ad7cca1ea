/* Trees: a trunk, and a crown of leaves on a few round clumps. The leaves of a clump share a light-map texel and point
 * their normal away from the crown's middle, which is how a crown as a whole looks. */
#include "synth/town.h"

#include <math.h>

static void random_direction(uint32_t seed, uint32_t what, float d[3])
{
    const float z = cn_town_between(seed, what, -1, 1), a = cn_town_between(seed, what + 1, 0, 6.2831853f);
    const float r = sqrtf(1 - z * z);
    d[0] = r * cosf(a);
    d[1] = r * sinf(a);
    d[2] = z;
}

/* A leafy twig: a diamond about the place, its plane at random. */
static void leaf(cn_mesh *mesh, const float at[3], const float crown[3], float size, uint32_t seed)
{
    float a[3], b[3];
    random_direction(seed, 1, a);
    random_direction(seed, 3, b);
    const float d = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    for (int i = 0; i < 3; i++)
        b[i] -= d * a[i];
    const float length = sqrtf(b[0] * b[0] + b[1] * b[1] + b[2] * b[2]);
    if (length < 0.1f) return;
    float u[3], v[3], corner[3];
    for (int i = 0; i < 3; i++) {
        const float p = a[i] * size, q = b[i] / length * size * 0.55f;
        u[i] = p + q;
        v[i] = p - q;
        corner[i] = at[i] - p;
    }
    mesh->id = seed;
    const uint32_t before = mesh->n_patches;
    cn_mesh_patch(mesh, corner, u, v);
    if (mesh->n_patches == before) return;
    float n[3], far = 0;
    for (int i = 0; i < 3; i++) {
        n[i] = at[i] - crown[i];
        far += n[i] * n[i];
    }
    far = sqrtf(far) + 1e-6f;
    for (int i = 0; i < 3; i++)
        mesh->patches[mesh->n_patches - 1].normal[i] = n[i] / far;
}

/* Leaves around a place. */
typedef struct foliage {
    float radius, leaf_size;
    uint32_t n;
} foliage;

static void clump(cn_mesh *mesh, const float at[3], const float crown[3], foliage f, uint32_t seed)
{
    const float radius = f.radius;
    for (uint32_t c = 0; c < 8; c++) {
        float n_out[3];
        /* One texel for each eighth of the clump, just outside it. */
        const float sx = c & 1 ? 1 : -1, sy = c & 2 ? 1 : -1, sz = c & 4 ? 1 : -1;
        const float place[3] = { at[0] + 0.58f * radius * sx, at[1] + 0.58f * radius * sy,
                                 at[2] + 0.58f * radius * sz };
        for (int i = 0; i < 3; i++)
            n_out[i] = place[i] - crown[i];
        /* Two axes across n_out span the chart, so that its normal is n_out. */
        const float u[3] = { n_out[1], -n_out[0], 0 };
        const float length = hypotf(u[0], u[1]) + 1e-6f;
        const float x[3] = { 0.02f * u[0] / length, 0.02f * u[1] / length, 0 };
        const float y[3] = { n_out[1] * x[2] - n_out[2] * x[1], n_out[2] * x[0] - n_out[0] * x[2],
                             n_out[0] * x[1] - n_out[1] * x[0] };
        cn_mesh_chart(mesh, place, x, y);
        for (uint32_t i = 0; i < f.n / 8; i++) {
            float d[3], p[3];
            const uint32_t s = seed * 4099u + c * 521u + i;
            random_direction(s, 5, d);
            const float r = radius * cbrtf(cn_town_between(s, 7, 0.35f, 1));
            p[0] = at[0] + sx * fabsf(d[0]) * r;
            p[1] = at[1] + sy * fabsf(d[1]) * r;
            p[2] = at[2] + sz * fabsf(d[2]) * r * 0.85f;
            leaf(mesh, p, crown, f.leaf_size * cn_town_between(s, 8, 0.7f, 1.3f), s);
        }
    }
}

void cn_town_build_tree(const cn_tree *tree, cn_mesh *mesh)
{
    const float trunk = tree->height - 1.7f * tree->radius;
    const float foot[3] = { tree->x, tree->y, tree->ground };
    const float crown[3] = { tree->x, tree->y, tree->ground + trunk + 0.75f * tree->radius };
    mesh->seed = tree->seed;
    mesh->id = 0;
    mesh->texel_m = tree->near ? 1 : 8;
    mesh->material = CN_MAT_BARK;
    cn_mesh_prism(mesh, foot, trunk + 0.5f * tree->radius, 0.17f, 0.09f, 7);
    for (uint32_t i = 0; i < 3; i++) {
        const float a = cn_town_between(tree->seed, 10 + i, 0, 6.28f);
        const float p[3] = { tree->x + 0.35f * tree->radius * cosf(a), tree->y + 0.35f * tree->radius * sinf(a),
                             foot[2] + trunk + 0.3f * tree->radius };
        cn_mesh_prism(mesh, p, 0.6f * tree->radius, 0.07f, 0.03f, 4);
    }
    mesh->material = CN_MAT_LEAF;
    mesh->texel_m = 1;
    const uint32_t clumps = tree->near ? 7 : 3, leaves = tree->near ? 240 : 64;
    const float size = tree->near ? 0.2f : 0.45f;
    for (uint32_t i = 0; i < clumps; i++) {
        float d[3], at[3];
        random_direction(tree->seed, 20 + 2 * i, d);
        const float r = 0.55f * tree->radius;
        for (int a = 0; a < 3; a++)
            at[a] = crown[a] + d[a] * r * (a == 2 ? 0.8f : 1);
        const foliage f = { tree->radius * cn_town_between(tree->seed, 40 + i, 0.45f, 0.65f), size, leaves };
        clump(mesh, at, crown, f, tree->seed * 11 + i);
    }
}
