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
/* Sources that are tried for a pixel whose plane two of them match so well; training's default has no more. */
enum { FEW = 4, WIDE = 2 };
#define GOOD_COST 0.3f
#define LEAST_SLANT 0.02f  /* least cosine between a plane's normal and a ray that meets it */
#define DEPTH_CHANGE 0.06f /* of a depth, in the first round twice as much as in the second */

typedef struct plane {
    float normal[3], depth;
} plane;
typedef struct match {
    const cn_kernel *kernel;
    const cn_stereo_view *view;
    cn_stereo_pair pairs[CN_STEREO_SOURCES];
    uint64_t seed, round;
    uint32_t step; /* of windows */
    /* [height][width]: normals in the camera's axes, depths along its axis, and costs of the match. */
    float (*normal)[3], *depth, *cost;
    uint32_t use[CN_STEREO_SOURCES], n_use; /* sources that the pixel at hand is compared with */
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

static void homography_of(const cn_stereo_view *v, const plane *p, float distance, float q[3])
{
    const float *n = p->normal, f = 1 / (v->focal * distance);
    q[0] = n[0] * f;
    q[1] = n[1] * f;
    q[2] = n[2] / distance - n[0] * f * v->cx - n[1] * f * v->cy;
}

static void use_all(match *m)
{
    m->n_use = m->view->n_sources;
    for (uint32_t s = 0; s < m->n_use; s++)
        m->use[s] = s;
}

/* Of many sources, the few that show the pixel's plane best are enough to tell whether another one is better. */
static void use_best(match *m, const cn_stereo_window *w, const float ray[3], const plane *p)
{
    const float distance = p->depth * dot(p->normal, ray);
    float q[3], cost[CN_STEREO_SOURCES];
    use_all(m);
    if (m->n_use <= FEW || !(distance < 0)) return;
    homography_of(m->view, p, distance, q);
    for (uint32_t s = 0; s < m->n_use; s++)
        cost[s] = cn_stereo_cost(m->kernel, w, &m->pairs[s], q);
    for (uint32_t k = 0; k < FEW; k++) {
        uint32_t best = k;
        for (uint32_t s = k + 1; s < m->n_use; s++)
            if (cost[m->use[s]] < cost[m->use[best]]) best = s;
        const uint32_t other = m->use[k];
        m->use[k] = m->use[best];
        m->use[best] = other;
    }
    if (cost[m->use[1]] < GOOD_COST) m->n_use = FEW;
}

/* The mean of the two best sources: the others may not see the place. */
static float cost_of(const match *m, const cn_stereo_window *w, const float ray[3], const plane *p)
{
    const cn_stereo_view *v = m->view;
    const float distance = p->depth * dot(p->normal, ray);
    if (!(p->depth >= v->near_m && p->depth <= v->far_m) || !(distance < -0.05f * p->depth)) return 2;
    float best[2] = { 2, 2 }, q[3];
    homography_of(v, p, distance, q);
    for (uint32_t s = 0; s < m->n_use; s++) {
        const float c = cn_stereo_cost(m->kernel, w, &m->pairs[m->use[s]], q);
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

/* The prior's depths, as the pinhole camera sees them. */
static void begin_at_prior(match *m, const cn_stereo_map *prior)
{
    const cn_stereo_view *v = m->view;
    for (uint32_t y = 0; y < v->height; y++)
        for (uint32_t x = 0; x < v->width; x++) {
            float ray[3];
            double at[2];
            ray_at(v, x, y, ray);
            if (!cn_camera_project(&v->camera, (const double[3]){ (double)ray[0], (double)ray[1], 1 }, at)) continue;
            if (!(at[0] >= 0 && at[1] >= 0 && at[0] < prior->width && at[1] < prior->height)) continue;
            const float depth = prior->depth_m[(size_t)at[1] * prior->width + (size_t)at[0]];
            if (depth > 0) m->depth[(size_t)y * v->width + x] = depth;
        }
}

/* The normal of the plane through a pixel's depth and those of its neighbours. False: too few are known. */
static bool slope_at(const match *m, const float *depth, uint32_t x, uint32_t y, const float ray[3], float n[3])
{
    const cn_stereo_view *v = m->view;
    const size_t i = (size_t)y * v->width + x, steps[2] = { 1, v->width };
    const uint32_t at[2] = { x, y }, size[2] = { v->width, v->height };
    float way[2][3];
    for (int k = 0; k < 2; k++) {
        const size_t before = at[k] > 0 && depth[i - steps[k]] > 0 ? i - steps[k] : i,
                     after = at[k] + 1 < size[k] && depth[i + steps[k]] > 0 ? i + steps[k] : i;
        float from[3], to[3];
        if (before == after) return false;
        ray_at(v, (uint32_t)(before % v->width), (uint32_t)(before / v->width), from);
        ray_at(v, (uint32_t)(after % v->width), (uint32_t)(after / v->width), to);
        for (int a = 0; a < 3; a++)
            way[k][a] = depth[after] * to[a] - depth[before] * from[a];
    }
    for (int a = 0; a < 3; a++)
        n[a] = way[0][(a + 1) % 3] * way[1][(a + 2) % 3] - way[0][(a + 2) % 3] * way[1][(a + 1) % 3];
    normalise(n, ray);
    return true;
}

/* first: depths that are known, [height][width], 0 where they are not. */
static void begin(match *m, const float *first, bool slopes)
{
    const cn_stereo_view *v = m->view;
    for (uint32_t y = 0; y < v->height; y++)
        for (uint32_t x = 0; x < v->width; x++) {
            const size_t i = (size_t)y * v->width + x;
            float ray[3];
            ray_at(v, x, y, ray);
            plane p;
            p.depth = first[i] > 0 ? first[i] : random_depth(m, i, 3);
            if (!(slopes && first[i] > 0 && slope_at(m, first, x, y, ray, p.normal)))
                random_normal(m, i, 0, ray, p.normal);
            cn_stereo_window w;
            cn_stereo_window_init(&w, v, x, y, m->step);
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
    cn_stereo_window_init(&w, m->view, x, y, m->step);
    plane best = { { m->normal[i][0], m->normal[i][1], m->normal[i][2] }, m->depth[i] }, p, tries[5];
    use_best(m, &w, ray, &best);
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

/* False: stopped. all: rounds of the whole match. */
static bool sweep(match *m, uint32_t rounds, uint32_t all, const cn_stereo_watch *watch)
{
    const cn_stereo_view *v = m->view;
    for (const uint64_t end = m->round + rounds; m->round < end; m->round++)
        for (uint32_t half = 0; half < 2; half++)
            for (uint32_t y = 0; y < v->height; y++) {
                for (uint32_t x = (y + half) % 2; x < v->width; x += 2)
                    update(m, x, y);
                const double round = (double)m->round - 1 + 0.5 * (half + (y + 1.0) / v->height);
                if (!watch->row(watch->user, round / all)) return false;
            }
    return true;
}

/* The costs of the planes as they are, with the windows of now. */
static void count_again(match *m)
{
    const cn_stereo_view *v = m->view;
    use_all(m);
    for (uint32_t y = 0; y < v->height; y++)
        for (uint32_t x = 0; x < v->width; x++) {
            const size_t i = (size_t)y * v->width + x;
            const plane p = { { m->normal[i][0], m->normal[i][1], m->normal[i][2] }, m->depth[i] };
            float ray[3];
            ray_at(v, x, y, ray);
            cn_stereo_window w;
            cn_stereo_window_init(&w, v, x, y, m->step);
            m->cost[i] = cost_of(m, &w, ray, &p);
        }
}

/* kept: [height][width], where no match is good enough. */
static void keep_good(const match *m, float worst, const float *kept, float *to)
{
    for (size_t i = 0; i < (size_t)m->view->width * m->view->height; i++)
        to[i] = m->cost[i] > worst ? kept ? kept[i] : 0 : m->depth[i];
}

cn_status cn_stereo_match(cn_stereo_views *views, uint32_t view, const cn_scene *scene, const cn_stereo_map *prior,
                          const cn_stereo_options *options, const cn_stereo_watch *watch)
{
    cn_stereo_view *v = &views->view[view];
    const size_t n = (size_t)v->width * v->height;
    match m = { .kernel = cn_kernel_best(), .view = v, .seed = options->seed, .step = WIDE };
    float *first = malloc(n * sizeof *first);
    m.normal = malloc(sizeof *m.normal * n);
    m.cost = malloc(sizeof *m.cost * n);
    m.depth = calloc(n, sizeof *m.depth);
    const bool room = m.normal && m.cost && m.depth && first;
    if (room) {
        for (uint32_t s = 0; s < v->n_sources; s++)
            cn_stereo_pair_init(&m.pairs[s], v, &views->view[v->sources[s]]);
        use_all(&m);
        begin_at_points(&m, scene);
        if (prior) begin_at_prior(&m, prior);
        memcpy(first, m.depth, n * sizeof *first);
        begin(&m, first, prior != NULL);
        const uint32_t all = options->rounds + options->fine;
        m.round = 1; /* the numbers of round 0 are drawn */
        bool going = sweep(&m, options->rounds, all, watch);
        keep_good(&m, options->worst_cost, NULL, options->fine ? first : m.depth);
        if (going && options->fine) {
            m.step = WIDE / 2;
            count_again(&m);
            going = sweep(&m, options->fine, all, watch);
            keep_good(&m, options->worst_cost, first, m.depth);
        }
        if (going) {
            v->depth = m.depth;
            m.depth = NULL;
        }
    }
    free(first);
    free(m.normal);
    free(m.cost);
    free(m.depth);
    return room ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the depths of photos by stereo");
}
