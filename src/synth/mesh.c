#include "synth/mesh.h"

#include "base/rng.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

void cn_mesh_deinit(cn_mesh *mesh)
{
    free(mesh->patches);
    free(mesh->charts);
    memset(mesh, 0, sizeof *mesh);
}

/* One more item behind the n of *items; NULL when there is no memory, which stays so. */
static void *grow(cn_mesh *mesh, void *items, uint32_t *n, uint32_t *room, size_t size)
{
    void **list = items;
    if (mesh->full) return NULL;
    if (*n == *room) {
        const uint32_t more = *room ? *room * 2 : 1024;
        void *grown = realloc(*list, more * size);
        if (!grown) {
            mesh->full = true;
            return NULL;
        }
        *list = grown;
        *room = more;
    }
    void *item = (char *)*list + (*n)++ * size;
    memset(item, 0, size);
    return item;
}

static float unit(const float v[3], float out[3])
{
    const float length = sqrtf(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    for (int a = 0; a < 3; a++)
        out[a] = length > 0 ? v[a] / length : 0;
    return length;
}
static void cross(const float a[3], const float b[3], float out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static uint32_t texels(float length, float texel_m)
{
    const float n = ceilf(length / texel_m);
    return n < 1 ? 1 : n > 4096 ? 4096 : (uint32_t)n;
}

void cn_mesh_chart(cn_mesh *mesh, const float corner[3], const float u[3], const float v[3])
{
    if (mesh->keep_chart) return;
    cn_chart *chart = grow(mesh, &mesh->charts, &mesh->n_charts, &mesh->room_charts, sizeof *chart);
    if (!chart) return;
    memcpy(chart->corner, corner, sizeof chart->corner);
    chart->width_m = unit(u, chart->u);
    chart->height_m = unit(v, chart->v);
    float n[3];
    cross(chart->u, chart->v, n);
    unit(n, chart->normal);
    const float texel_m = mesh->texel_m > 0 ? mesh->texel_m : 1;
    chart->nu = texels(chart->width_m, texel_m);
    chart->nv = texels(chart->height_m, texel_m);
    chart->first = mesh->n_texels;
    chart->seed = mesh->seed;
    mesh->n_texels += chart->nu * chart->nv;
    mesh->chart = mesh->n_charts - 1;
}

static cn_patch *add(cn_mesh *mesh, const float corner[3], const float u[3], const float v[3])
{
    cn_patch *patch = grow(mesh, &mesh->patches, &mesh->n_patches, &mesh->room_patches, sizeof *patch);
    if (!patch) return NULL;
    memcpy(patch->corner, corner, sizeof patch->corner);
    memcpy(patch->u, u, sizeof patch->u);
    memcpy(patch->v, v, sizeof patch->v);
    float n[3];
    cross(u, v, n);
    unit(n, patch->normal);
    patch->chart = mesh->chart;
    patch->id = mesh->id;
    patch->material = (uint8_t)mesh->material;
    return patch;
}

void cn_mesh_patch(cn_mesh *mesh, const float corner[3], const float u[3], const float v[3])
{
    add(mesh, corner, u, v);
}

void cn_mesh_triangle(cn_mesh *mesh, const float corner[3], const float u[3], const float v[3])
{
    cn_patch *patch = add(mesh, corner, u, v);
    if (patch) patch->triangle = true;
}

void cn_mesh_panel(cn_mesh *mesh, const float corner[3], const float u[3], const float v[3])
{
    cn_mesh_chart(mesh, corner, u, v);
    cn_mesh_patch(mesh, corner, u, v);
}

static void sum(const float a[3], const float b[3], float out[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = a[i] + b[i];
}

void cn_mesh_box(cn_mesh *mesh, const float corner[3], const float u[3], const float v[3], const float w[3])
{
    const float back_u[3] = { -u[0], -u[1], -u[2] }, back_v[3] = { -v[0], -v[1], -v[2] };
    float at_u[3], at_v[3], at_w[3], at_uv[3];
    sum(corner, u, at_u);
    sum(corner, v, at_v);
    sum(corner, w, at_w);
    sum(at_u, v, at_uv);
    cn_mesh_panel(mesh, corner, u, w);
    cn_mesh_panel(mesh, at_u, v, w);
    cn_mesh_panel(mesh, at_uv, back_u, w);
    cn_mesh_panel(mesh, at_v, back_v, w);
    cn_mesh_panel(mesh, at_w, u, v);
}

void cn_mesh_block(cn_mesh *mesh, const float centre[3], const float size[3], float turn)
{
    const float c = cosf(turn), s = sinf(turn);
    const float u[3] = { c * size[0], s * size[0], 0 }, v[3] = { -s * size[1], c * size[1], 0 },
                w[3] = { 0, 0, size[2] };
    const float corner[3] = { centre[0] - 0.5f * (u[0] + v[0]), centre[1] - 0.5f * (u[1] + v[1]), centre[2] };
    cn_mesh_box(mesh, corner, u, v, w);
}

void cn_mesh_prism(cn_mesh *mesh, const float bottom[3], float height, float r0, float r1, int n)
{
    const float step = 6.2831853f / (float)n;
    const float top[3] = { bottom[0], bottom[1], bottom[2] + height };
    for (int i = 0; i < n; i++) {
        const float a = step * (float)i, b = step * (float)(i + 1);
        const float p[3] = { bottom[0] + r0 * cosf(a), bottom[1] + r0 * sinf(a), bottom[2] };
        const float q[3] = { bottom[0] + r0 * cosf(b), bottom[1] + r0 * sinf(b), bottom[2] };
        const float p1[3] = { top[0] + r1 * cosf(a), top[1] + r1 * sinf(a), top[2] };
        const float q1[3] = { top[0] + r1 * cosf(b), top[1] + r1 * sinf(b), top[2] };
        const float along[3] = { q[0] - p[0], q[1] - p[1], 0 }, up[3] = { p1[0] - p[0], p1[1] - p[1], height };
        const float back[3] = { p1[0] - q1[0], p1[1] - q1[1], 0 }, down[3] = { q[0] - q1[0], q[1] - q1[1], -height };
        cn_mesh_chart(mesh, p, along, up);
        cn_mesh_triangle(mesh, p, along, up);
        if (r1 > 0) cn_mesh_triangle(mesh, q1, back, down);
        if (r1 <= 0) continue;
        const float out[3] = { p1[0] - top[0], p1[1] - top[1], 0 }, next[3] = { q1[0] - top[0], q1[1] - top[1], 0 };
        cn_mesh_chart(mesh, top, out, next);
        cn_mesh_triangle(mesh, top, out, next);
    }
}
