#include "surface/charts.h"

#include "base/keys.h"
#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { NONE = -1, ROUNDS = 8, TURNS = 12 };
#define LEAST_FACING 0.5 /* cosine between a triangle and its chart; more tilted ones get too few texels */

typedef struct grower {
    const cn_context *ctx;
    const cn_mesh *mesh;
    cn_chart_limits limits;
    cn_charts *out;
    uint32_t *beside;   /* 3 of each triangle: those across its sides; UINT32_MAX: none */
    float (*normal)[3]; /* of each triangle */
    float *area;
    uint8_t *taken;
    float *depth; /* of each texel of the chart that is tested; NaN: empty */
    size_t n_depth;
    uint32_t round;
} grower;

void cn_charts_deinit(cn_charts *charts)
{
    free(charts->charts);
    free(charts->triangles);
    *charts = (cn_charts){ 0 };
}

/* ---- neighbours ---- */

static cn_status find_neighbours(grower *g)
{
    const uint32_t *corners = g->mesh->corners;
    const size_t n = 3 * (size_t)g->mesh->n_triangles;
    cn_keys edges = { 0 };
    cn_status status = CN_OK;
    memset(g->beside, 0xff, n * sizeof *g->beside);
    for (size_t i = 0; i < n && status == CN_OK; i++) {
        const uint32_t a = corners[i], b = corners[i / 3 * 3 + (i + 1) % 3];
        const uint64_t key = (uint64_t)(a < b ? a : b) << 32 | (a < b ? b : a);
        bool fresh;
        if (!key) continue;
        status = cn_keys_add(&edges, key, (uint32_t)i, &fresh);
        if (status != CN_OK || fresh) continue;
        const uint32_t other = cn_keys_find(&edges, key);
        if (g->beside[other] != UINT32_MAX) continue; /* a third triangle at an edge */
        g->beside[other] = (uint32_t)(i / 3);
        g->beside[i] = other / 3;
    }
    cn_keys_deinit(&edges);
    return status;
}

static void find_normals(grower *g)
{
    for (uint32_t t = 0; t < g->mesh->n_triangles; t++) {
        double normal[3];
        g->area[t] = (float)fmax(cn_mesh_normal(g->mesh, t, normal), 1e-12);
        for (int k = 0; k < 3; k++)
            g->normal[t][k] = (float)normal[k];
    }
}

/* ---- one chart ---- */

static double facing(const grower *g, uint32_t triangle, const double axis[3])
{
    double sum = 0;
    for (int k = 0; k < 3; k++)
        sum += (double)g->normal[triangle][k] * axis[k];
    return sum;
}

static const float *first_corner(const grower *g, uint32_t triangle)
{
    return g->mesh->vertices[g->mesh->corners[3 * (size_t)triangle]].xyz;
}

static bool near_enough(const grower *g, uint32_t seed, uint32_t triangle)
{
    const float *a = first_corner(g, seed);
    for (int c = 0; c < 3; c++) {
        const float *b = g->mesh->vertices[g->mesh->corners[3 * (size_t)triangle + (size_t)c]].xyz;
        double far = 0;
        for (int k = 0; k < 3; k++)
            far += ((double)a[k] - (double)b[k]) * ((double)a[k] - (double)b[k]);
        if (!(far < g->limits.largest_m * g->limits.largest_m)) return false;
    }
    return true;
}

static void take(grower *g, cn_chart *chart, uint32_t triangle, double sum[3])
{
    g->taken[triangle] = 1;
    g->out->triangles[chart->first + chart->n++] = triangle;
    for (int k = 0; k < 3; k++)
        sum[k] += (double)g->area[triangle] * (double)g->normal[triangle][k];
}

/* The axis that the triangles of a chart agree on most; sum: of their normals by area. */
static void axis_of(const grower *g, const cn_chart *chart, const double sum[3], double axis[3])
{
    memcpy(axis, sum, 3 * sizeof *axis);
    if (cn_normalize3(axis)) return;
    for (int k = 0; k < 3; k++)
        axis[k] = (double)g->normal[g->out->triangles[chart->first]][k];
}

/* Triangles that turn out to face away from the mean, or to lie over others, go back. The first stays. */
static void keep_first(grower *g, cn_chart *chart, const uint8_t *bad)
{
    uint32_t *list = g->out->triangles + chart->first, kept = 1;
    for (uint32_t i = 1; i < chart->n; i++) {
        if (bad[i])
            g->taken[list[i]] = 0;
        else
            list[kept++] = list[i];
    }
    chart->n = kept;
}

static void gather(grower *g, cn_chart *chart, uint32_t seed, double axis[3])
{
    double sum[3] = { 0 };
    take(g, chart, seed, sum);
    axis_of(g, chart, sum, axis);
    for (uint32_t i = 0; i < chart->n && g->round < ROUNDS; i++) {
        const uint32_t *beside = g->beside + 3 * (size_t)g->out->triangles[chart->first + i];
        for (int s = 0; s < 3; s++) {
            const uint32_t t = beside[s];
            if (t == UINT32_MAX || g->taken[t] || facing(g, t, axis) < LEAST_FACING || !near_enough(g, seed, t))
                continue;
            take(g, chart, t, sum);
            axis_of(g, chart, sum, axis);
        }
    }
}

/* ---- the plane ---- */

static void bounds(const grower *g, const cn_chart *chart, const double x[3], const double y[3], double box[4])
{
    box[0] = box[1] = INFINITY;
    box[2] = box[3] = -INFINITY;
    for (uint32_t i = 0; i < 3 * chart->n; i++) {
        const uint32_t triangle = g->out->triangles[chart->first + i / 3];
        const float *p = g->mesh->vertices[g->mesh->corners[3 * (size_t)triangle + i % 3]].xyz;
        const double at[3] = { (double)p[0], (double)p[1], (double)p[2] };
        const double u = cn_dot3(at, x), v = cn_dot3(at, y);
        box[0] = fmin(box[0], u);
        box[1] = fmin(box[1], v);
        box[2] = fmax(box[2], u);
        box[3] = fmax(box[3], v);
    }
}

/* Of some turns the one whose rectangle is smallest, lying on its longer side. */
static void flatten(const grower *g, cn_chart *chart, const double axis[3])
{
    double side[3] = { 0 }, up[3], least = INFINITY;
    side[fabs(axis[0]) < 0.7 ? 0 : 1] = 1;
    cn_cross3(axis, side, up);
    (void)cn_normalize3(up);
    cn_cross3(up, axis, side);
    const int turns = chart->n < 3 ? 2 * TURNS : TURNS;
    for (int i = 0; i < turns; i++) {
        const double c = cos(M_PI / 2 * i / turns), s = sin(M_PI / 2 * i / turns);
        double x[3], y[3], box[4];
        for (int k = 0; k < 3; k++) {
            x[k] = c * side[k] + s * up[k];
            y[k] = c * up[k] - s * side[k];
        }
        bounds(g, chart, x, y, box);
        const double size[2] = { box[2] - box[0], box[3] - box[1] };
        const double area = (size[0] + 2 * g->limits.texel_m) * (size[1] + 2 * g->limits.texel_m);
        if (!(area < least)) continue;
        least = area;
        const bool tall = size[1] > size[0];
        for (int k = 0; k < 3; k++) {
            chart->x[k] = tall ? y[k] : x[k];
            chart->y[k] = tall ? -x[k] : y[k];
        }
        chart->low[0] = tall ? box[1] : box[0];
        chart->low[1] = tall ? -box[2] : box[1];
        chart->size[0] = size[tall];
        chart->size[1] = size[!tall];
    }
    chart->texel_m = fmax(g->limits.texel_m, fmax(chart->size[0], chart->size[1]) / g->limits.most_px);
    for (int k = 0; k < 2; k++)
        chart->size_px[k] = (uint32_t)floor(chart->size[k] / chart->texel_m) + 2;
}

void cn_chart_project(const cn_chart *chart, const float xyz[3], double px[2])
{
    const double at[3] = { (double)xyz[0], (double)xyz[1], (double)xyz[2] };
    px[0] = (cn_dot3(at, chart->x) - chart->low[0]) / chart->texel_m + 0.5;
    px[1] = (cn_dot3(at, chart->y) - chart->low[1]) / chart->texel_m + 0.5;
}

/* ---- texels ---- */

/* Steps of half a texel along the sides: a triangle that is narrower than a texel may cover no centre. */
static void visit_sides(const cn_chart *chart, double px[3][2], uint32_t triangle, cn_chart_visit visit, void *user)
{
    for (int c = 0; c < 3; c++) {
        const double *a = px[c], *b = px[(c + 1) % 3];
        const int steps = (int)ceil(2 * hypot(b[0] - a[0], b[1] - a[1])) + 1;
        for (int i = 0; i < steps; i++) {
            const double part = (double)i / steps;
            cn_chart_texel t = { .side = true };
            t.x = (uint32_t)fmin(fmax(a[0] + part * (b[0] - a[0]), 0), chart->size_px[0] - 1);
            t.y = (uint32_t)fmin(fmax(a[1] + part * (b[1] - a[1]), 0), chart->size_px[1] - 1);
            t.part[c] = 1 - part;
            t.part[(c + 1) % 3] = part;
            visit(user, triangle, &t);
        }
    }
}

void cn_chart_rasterise(const cn_mesh *mesh, const cn_chart *chart, uint32_t triangle, cn_chart_visit visit, void *user)
{
    double px[3][2], low[2] = { INFINITY, INFINITY }, high[2] = { -INFINITY, -INFINITY };
    for (int c = 0; c < 3; c++) {
        const uint32_t vertex = mesh->corners[3 * (size_t)triangle + (size_t)c];
        cn_chart_project(chart, mesh->vertices[vertex].xyz, px[c]);
        for (int k = 0; k < 2; k++) {
            low[k] = fmin(low[k], px[c][k]);
            high[k] = fmax(high[k], px[c][k]);
        }
    }
    const double twice = (px[1][0] - px[0][0]) * (px[2][1] - px[0][1]) - (px[2][0] - px[0][0]) * (px[1][1] - px[0][1]);
    const uint32_t x1 = (uint32_t)fmin(ceil(high[0]), chart->size_px[0]);
    const uint32_t y1 = (uint32_t)fmin(ceil(high[1]), chart->size_px[1]);
    for (uint32_t y = (uint32_t)fmax(floor(low[1]), 0); y < y1 && fabs(twice) > 1e-9; y++)
        for (uint32_t x = (uint32_t)fmax(floor(low[0]), 0); x < x1; x++) {
            cn_chart_texel t = { .x = x, .y = y };
            bool in = true;
            for (int c = 0; c < 3; c++) {
                const double *a = px[(c + 1) % 3], *b = px[(c + 2) % 3];
                t.part[c] = ((b[0] - a[0]) * (y + 0.5 - a[1]) - (b[1] - a[1]) * (x + 0.5 - a[0])) / twice;
                in = in && t.part[c] >= -1e-9;
            }
            if (in) visit(user, triangle, &t);
        }
    visit_sides(chart, px, triangle, visit, user);
}

/* ---- triangles over one another ---- */

typedef struct overlap {
    grower *g;
    const cn_chart *chart;
    double axis[3];
    bool found;
} overlap;

static void test_texel(void *user, uint32_t triangle, const cn_chart_texel *t)
{
    overlap *o = user;
    const cn_mesh *m = o->g->mesh;
    float *there = &o->g->depth[(size_t)t->y * o->chart->size_px[0] + t->x];
    double depth = 0;
    if (t->side) return;
    for (int c = 0; c < 3; c++) {
        const float *p = m->vertices[m->corners[3 * (size_t)triangle + (size_t)c]].xyz;
        for (int k = 0; k < 3; k++)
            depth += t->part[c] * o->axis[k] * (double)p[k];
    }
    if (isnan(*there))
        *there = (float)depth;
    else if (fabs((double)*there - depth) > o->chart->texel_m)
        o->found = true;
}

static cn_status drop_overlaps(grower *g, cn_chart *chart)
{
    const size_t texels = (size_t)chart->size_px[0] * chart->size_px[1];
    overlap o = { .g = g, .chart = chart };
    if (chart->n < 2) return CN_OK;
    uint8_t *bad = calloc(chart->n, 1);
    if (texels > g->n_depth) {
        free(g->depth);
        g->depth = malloc(texels * sizeof *g->depth);
        g->n_depth = g->depth ? texels : 0;
    }
    if (!bad || !g->depth) {
        free(bad);
        return cn_fail(CN_ERR_NOMEM, "out of memory for a chart of %zu texels", texels);
    }
    for (size_t i = 0; i < texels; i++)
        g->depth[i] = NAN;
    cn_cross3(chart->x, chart->y, o.axis);
    for (uint32_t i = 0; i < chart->n; i++) {
        o.found = false;
        cn_chart_rasterise(g->mesh, chart, g->out->triangles[chart->first + i], test_texel, &o);
        bad[i] = o.found;
    }
    keep_first(g, chart, bad);
    free(bad);
    return CN_OK;
}

/* ---- all charts ---- */

static cn_status add_chart(grower *g, uint32_t seed)
{
    cn_charts *out = g->out;
    if (out->n == out->room) {
        const uint32_t room = out->room ? 2 * out->room : 1024;
        cn_chart *charts = realloc(out->charts, room * sizeof *charts);
        if (!charts) return cn_fail(CN_ERR_NOMEM, "out of memory for %u charts; give a larger --gsd", room);
        out->charts = charts;
        out->room = room;
    }
    cn_chart *chart = &out->charts[out->n++];
    *chart = (cn_chart){ .first = out->n_triangles };
    double axis[3];
    gather(g, chart, seed, axis);
    uint8_t *bad = calloc(chart->n, 1);
    if (!bad) return cn_fail(CN_ERR_NOMEM, "out of memory for a chart");
    for (uint32_t i = 0; i < chart->n; i++)
        bad[i] = facing(g, out->triangles[chart->first + i], axis) < 0.9 * LEAST_FACING;
    if (bad[0]) /* the mean has turned away from where the chart began */
        for (int k = 0; k < 3; k++)
            axis[k] = (double)g->normal[seed][k];
    for (uint32_t i = 0; i < chart->n; i++)
        bad[i] = facing(g, out->triangles[chart->first + i], axis) < 0.9 * LEAST_FACING;
    keep_first(g, chart, bad);
    free(bad);
    flatten(g, chart, axis);
    CN_TRY(drop_overlaps(g, chart));
    out->n_triangles += chart->n;
    return CN_OK;
}

static cn_status grow(grower *g)
{
    CN_TRY(find_neighbours(g));
    find_normals(g);
    for (g->round = 0; g->out->n_triangles < g->mesh->n_triangles; g->round++)
        for (uint32_t t = 0; t < g->mesh->n_triangles; t++) {
            if (g->taken[t]) continue;
            if (cn_stopping(g->ctx))
                return cn_fail(CN_ERR_INTERRUPTED, "stopped while making charts; run the same command again");
            CN_TRY(add_chart(g, t));
        }
    return CN_OK;
}

cn_status cn_charts_grow(const cn_context *ctx, const cn_mesh *mesh, const cn_chart_limits *limits, cn_charts *out)
{
    const size_t n = mesh->n_triangles;
    grower g = { .ctx = ctx, .mesh = mesh, .limits = *limits, .out = out };
    *out = (cn_charts){ .triangles = malloc((n + 1) * sizeof *out->triangles) };
    g.beside = malloc((3 * n + 1) * sizeof *g.beside);
    g.normal = malloc((n + 1) * sizeof *g.normal);
    g.area = malloc((n + 1) * sizeof *g.area);
    g.taken = calloc(n + 1, 1);
    cn_status status = out->triangles && g.beside && g.normal && g.area && g.taken
                           ? grow(&g)
                           : cn_fail(CN_ERR_NOMEM, "out of memory for %zu triangles; give a larger --gsd", n);
    free(g.beside);
    free(g.normal);
    free(g.area);
    free(g.taken);
    free(g.depth);
    if (status != CN_OK) cn_charts_deinit(out);
    return status;
}
