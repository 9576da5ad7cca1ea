#include "stereo/match.h"

#include "base/rng.h"
#include "stereo/window.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { NEAR_POINT = 4 }; /* pixels around a sparse point that begin with its depth */
/* Planes that differ by less are the same one: depths, relative, and the cosine of the normals. */
#define SAME_DEPTH 0.0005f
#define SAME_NORMAL 0.995f
#define LEAST_SLANT 0.02f  /* least cosine between a plane's normal and a ray that meets it */
#define DEPTH_CHANGE 0.06f /* of a depth, in the first round twice as much as in the second */
#define WORST_COST 0.5f    /* a match that costs more is not kept */

typedef struct plane {
    float normal[3], depth;
} plane;
typedef struct match {
    const cn_kernel *kernel;
    const cn_stereo_view *view;
    cn_stereo_pair pairs[CN_STEREO_SOURCES];
    uint64_t seed, round;
    /* [height][width]: normals in the camera's axes, depths along its axis, and costs of the match. */
    float (*normal)[3], *depth, *cost;
} match;

static float random_at(const match *m, size_t pixel, uint32_t k)
{
    return cn_rng_float(m->seed, m->round * 32 + k, pixel);
}

/* The ray through a pixel's centre, with z = 1. */
static void ray_at(const cn_stereo_view *v, uint32_t x, uint32_t y, float ray[3])
{
    ray[0] = ((float)x + 0.5f - v->cx) / v->focal;
    ray[1] = ((float)y + 0.5f - v->cy) / v->focal;
    ray[2] = 1;
}

static float dot(const float a[3], const float b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void normalise(float n[3], const float ray[3])
{
    float length = sqrtf(dot(n, n));
    if (!(length > 1e-6f)) {
        memcpy(n, (float[3]){ 0, 0, -1 }, sizeof(float[3]));
        length = 1;
    }
    const float sign = dot(n, ray) > 0 ? -1 : 1;
    for (int a = 0; a < 3; a++)
        n[a] *= sign / length;
}

/* The mean of the better half of the sources: the others may not see the place. */
static float cost_of(const match *m, const cn_stereo_window *w, const float ray[3], const plane *p)
{
    const cn_stereo_view *v = m->view;
    const float distance = p->depth * dot(p->normal, ray);
    if (!(p->depth >= v->near_m && p->depth <= v->far_m) || !(distance < -0.05f * p->depth)) return 2;
    const float *n = p->normal, f = 1 / (v->focal * distance);
    const float q[3] = { n[0] * f, n[1] * f, n[2] / distance - n[0] * f * v->cx - n[1] * f * v->cy };
    float best[2] = { 2, 2 };
    for (uint32_t s = 0; s < v->n_sources; s++) {
        const float c = cn_stereo_cost(m->kernel, w, &m->pairs[s], q);
        if (c < best[0]) {
            best[1] = best[0];
            best[0] = c;
        } else if (c < best[1]) {
            best[1] = c;
        }
    }
    return v->n_sources > 1 ? 0.5f * (best[0] + best[1]) : best[0];
}

static void keep_better(const match *m, const cn_stereo_window *w, const float ray[3], const plane *p, plane *best,
                        float *cost)
{
    const float c = cost_of(m, w, ray, p);
    if (!(c < *cost)) return;
    *cost = c;
    *best = *p;
}

static void random_normal(const match *m, size_t pixel, uint32_t k, const float ray[3], float n[3])
{
    for (uint32_t a = 0; a < 3; a++)
        n[a] = 2 * random_at(m, pixel, k + a) - 1;
    n[2] -= 0.7f;
    normalise(n, ray);
}

static float random_depth(const match *m, size_t pixel, uint32_t k)
{
    const float near = 1 / m->view->near_m, far = 1 / m->view->far_m;
    return 1 / (far + random_at(m, pixel, k) * (near - far));
}

/* Sparse points give the first depths around them. */
static void begin_at_points(match *m, const cn_scene *scene)
{
    const cn_stereo_view *v = m->view;
    for (uint32_t i = 0; i < v->n_points; i++) {
        double x[3];
        cn_stereo_to_camera(v->pose, scene->points[v->points[i]].xyz, x);
        if (!(x[2] > 0)) continue;
        const double u = (double)v->focal * x[0] / x[2] + (double)v->cx,
                     w = (double)v->focal * x[1] / x[2] + (double)v->cy;
        if (!(u >= 0 && w >= 0 && u < v->width && w < v->height)) continue;
        const int px = (int)u, py = (int)w;
        for (int y = py - NEAR_POINT; y <= py + NEAR_POINT; y++)
            for (int k = px - NEAR_POINT; k <= px + NEAR_POINT; k++) {
                if (k < 0 || y < 0 || k >= (int)v->width || y >= (int)v->height) continue;
                float *depth = &m->depth[(size_t)y * v->width + (size_t)k];
                if (!(*depth > 0) || (k == px && y == py)) *depth = (float)x[2];
            }
    }
}

static void begin(match *m, const cn_scene *scene)
{
    const cn_stereo_view *v = m->view;
    begin_at_points(m, scene);
    for (uint32_t y = 0; y < v->height; y++)
        for (uint32_t x = 0; x < v->width; x++) {
            const size_t i = (size_t)y * v->width + x;
            float ray[3];
            ray_at(v, x, y, ray);
            plane p;
            random_normal(m, i, 0, ray, p.normal);
            p.depth = m->depth[i] > 0 ? m->depth[i] : random_depth(m, i, 3);
            cn_stereo_window w;
            cn_stereo_window_init(&w, v, x, y);
            m->cost[i] = cost_of(m, &w, ray, &p);
            m->depth[i] = p.depth;
            memcpy(m->normal[i], p.normal, sizeof p.normal);
        }
}

/* A neighbour's plane, as it meets this pixel's ray. False: it does not, or it is what this pixel has. */
static bool from_neighbour(const match *m, int x, int y, const float ray[3], const plane *own, plane *p)
{
    const cn_stereo_view *v = m->view;
    if (x < 0 || y < 0 || x >= (int)v->width || y >= (int)v->height) return false;
    const size_t q = (size_t)y * v->width + (size_t)x;
    float at_q[3];
    ray_at(v, (uint32_t)x, (uint32_t)y, at_q);
    memcpy(p->normal, m->normal[q], sizeof p->normal);
    const float along = dot(p->normal, ray);
    if (!(along < -LEAST_SLANT)) return false;
    p->depth = m->depth[q] * dot(p->normal, at_q) / along;
    return fabsf(p->depth - own->depth) > SAME_DEPTH * own->depth || dot(p->normal, own->normal) < SAME_NORMAL;
}

/* Planes near the best one, and any other. They come nearer from round to round. */
static void random_planes(const match *m, size_t i, const float ray[3], const plane *best, plane tries[5])
{
    const float narrow = exp2f(-(float)m->round);
    plane near = *best, any;
    near.depth *= 1 + DEPTH_CHANGE * narrow * (2 * random_at(m, i, 0) - 1);
    for (uint32_t a = 0; a < 3; a++)
        near.normal[a] += narrow * (random_at(m, i, 1 + a) - 0.5f);
    normalise(near.normal, ray);
    random_normal(m, i, 4, ray, any.normal);
    any.depth = random_depth(m, i, 7);
    for (int k = 0; k < 5; k++)
        tries[k] = *best;
    tries[0].depth = near.depth;
    memcpy(tries[1].normal, near.normal, sizeof near.normal);
    memcpy(tries[2].normal, any.normal, sizeof any.normal);
    tries[3] = near;
    tries[4].depth = any.depth;
}

static void update(match *m, uint32_t x, uint32_t y)
{
    static const int around[8][2] = {
        { -1, 0 }, { 1, 0 }, { 0, -1 }, { 0, 1 }, { -5, 0 }, { 5, 0 }, { 0, -5 }, { 0, 5 }
    };
    const size_t i = (size_t)y * m->view->width + x;
    float ray[3], cost = m->cost[i];
    ray_at(m->view, x, y, ray);
    cn_stereo_window w;
    cn_stereo_window_init(&w, m->view, x, y);
    plane best = { { m->normal[i][0], m->normal[i][1], m->normal[i][2] }, m->depth[i] }, p, tries[5];
    for (int k = 0; k < 8; k++)
        if (from_neighbour(m, (int)x + around[k][0], (int)y + around[k][1], ray, &best, &p))
            keep_better(m, &w, ray, &p, &best, &cost);
    random_planes(m, i, ray, &best, tries);
    for (int k = 0; k < 5; k++)
        keep_better(m, &w, ray, &tries[k], &best, &cost);
    m->cost[i] = cost;
    m->depth[i] = best.depth;
    memcpy(m->normal[i], best.normal, sizeof best.normal);
}

cn_status cn_stereo_match(cn_stereo_views *views, uint32_t view, const cn_scene *scene, uint32_t rounds, uint64_t seed)
{
    cn_stereo_view *v = &views->view[view];
    const size_t n = (size_t)v->width * v->height;
    match m = { .kernel = cn_kernel_best(), .view = v, .seed = seed };
    m.normal = malloc(sizeof *m.normal * n);
    m.cost = malloc(sizeof *m.cost * n);
    m.depth = calloc(n, sizeof *m.depth);
    const bool room = m.normal && m.cost && m.depth;
    if (room) {
        for (uint32_t s = 0; s < v->n_sources; s++)
            cn_stereo_pair_init(&m.pairs[s], v, &views->view[v->sources[s]]);
        begin(&m, scene);
        for (m.round = 1; m.round <= rounds; m.round++)
            for (uint32_t half = 0; half < 2; half++)
                for (uint32_t y = 0; y < v->height; y++)
                    for (uint32_t x = (y + half) % 2; x < v->width; x += 2)
                        update(&m, x, y);
        for (size_t i = 0; i < n; i++)
            if (m.cost[i] > WORST_COST) m.depth[i] = 0;
        v->depth = m.depth;
        m.depth = NULL;
    }
    free(m.normal);
    free(m.cost);
    free(m.depth);
    return room ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the depths of photos by stereo");
}
