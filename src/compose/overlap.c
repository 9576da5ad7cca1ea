#include "compose/overlap.h"

#include "base/rng.h"
#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { SEEN_BY = 2, MAX_SEEN = 64, STREAM_VIEW = 50, STREAM_X = 51, STREAM_Y = 52, SHARED_VIEW = 64 };

/* Tiles of each view: tiles[first[v]] .. tiles[first[v + 1]]. */
typedef struct view_tiles {
    uint32_t *first, *tiles;
} view_tiles;

static cn_status index_views(const cn_alignment_input *in, view_tiles *v)
{
    const uint32_t n_views = in->scene->n_views;
    size_t total = 0;
    for (uint32_t t = 0; t < in->n_tiles; t++)
        total += in->tiles[t].n_views;
    v->first = calloc(n_views + 2u, sizeof *v->first);
    v->tiles = calloc(total + 1, sizeof *v->tiles);
    if (!v->first || !v->tiles) return cn_fail(CN_ERR_NOMEM, "out of memory for the tiles of %u photos", n_views);
    for (uint32_t t = 0; t < in->n_tiles; t++)
        for (uint32_t i = 0; i < in->tiles[t].n_views; i++)
            v->first[in->tiles[t].views[i] + 2]++;
    for (uint32_t i = 2; i < n_views + 2; i++)
        v->first[i] += v->first[i - 1];
    for (uint32_t t = 0; t < in->n_tiles; t++)
        for (uint32_t i = 0; i < in->tiles[t].n_views; i++)
            v->tiles[v->first[in->tiles[t].views[i] + 1]++] = t;
    return CN_OK;
}

static int by_pair(const void *x, const void *y)
{
    const cn_alignment_edge *a = x, *b = y;
    if (a->a != b->a) return a->a < b->a ? -1 : 1;
    return (a->b > b->b) - (a->b < b->b);
}

static cn_status list_pairs(const cn_alignment_input *in, cn_alignment_edge **edges, uint32_t *n)
{
    uint32_t room = 0;
    for (uint32_t a = 0; a < in->n_tiles; a++)
        for (uint32_t b = a + 1; b < in->n_tiles; b++) {
            const cn_alignment_tile *p = &in->tiles[a], *q = &in->tiles[b];
            if (!(hypot(p->centre[0] - q->centre[0], p->centre[1] - q->centre[1]) < p->radius_m + q->radius_m))
                continue;
            if (*n == room) {
                room = room ? 2 * room : 64;
                cn_alignment_edge *larger = realloc(*edges, room * sizeof *larger);
                if (!larger) return cn_fail(CN_ERR_NOMEM, "out of memory for pairs of %u tiles", in->n_tiles);
                *edges = larger;
            }
            (*edges)[(*n)++] = (cn_alignment_edge){ a, b, 0, NAN, NAN };
        }
    return CN_OK;
}

/* How often the photos of each tile see a point: tile[i] does times[i] times. */
static uint32_t count_point(const cn_scene *scene, const view_tiles *v, const cn_point *point, uint32_t tile[MAX_SEEN],
                            uint32_t times[MAX_SEEN])
{
    uint32_t n = 0;
    for (uint64_t o = point->first_observation; o < (uint64_t)point->first_observation + point->n_observations; o++) {
        const uint32_t view = scene->observations[o].view;
        for (uint32_t i = v->first[view]; i < v->first[view + 1]; i++) {
            uint32_t k = 0;
            while (k < n && tile[k] != v->tiles[i])
                k++;
            if (k == MAX_SEEN) continue;
            if (k == n) tile[n] = v->tiles[i], times[n++] = 0;
            times[k]++;
        }
    }
    return n;
}

static void count_places(const cn_alignment_input *in, const view_tiles *v, cn_alignment_edge *edges, uint32_t n_edges)
{
    for (uint32_t p = 0; p < in->scene->n_points; p++) {
        uint32_t tile[MAX_SEEN], times[MAX_SEEN];
        const uint32_t n = count_point(in->scene, v, &in->scene->points[p], tile, times);
        for (uint32_t i = 0; i < n; i++)
            for (uint32_t k = 0; k < n; k++) {
                const cn_alignment_edge wanted = { .a = tile[i], .b = tile[k] };
                if (tile[i] >= tile[k] || times[i] < SEEN_BY || times[k] < SEEN_BY) continue;
                cn_alignment_edge *e = bsearch(&wanted, edges, n_edges, sizeof *edges, by_pair);
                if (e) e->n_places++;
            }
    }
}

static void count_shared_views(const cn_alignment_input *in, const view_tiles *v, cn_alignment_edge *edges,
                               uint32_t n_edges)
{
    for (uint32_t view = 0; view < in->scene->n_views; view++)
        for (uint32_t i = v->first[view]; i < v->first[view + 1]; i++)
            for (uint32_t k = i + 1; k < v->first[view + 1]; k++) {
                const cn_alignment_edge wanted = { .a = v->tiles[i],
                                                   .b = v->tiles[k] }; /* tiles were listed in order */
                cn_alignment_edge *e = bsearch(&wanted, edges, n_edges, sizeof *edges, by_pair);
                if (e) e->n_places += SHARED_VIEW;
            }
}

cn_status cn_overlap_find(const cn_alignment_input *in, cn_alignment_edge **edges, uint32_t *n)
{
    view_tiles v = { 0 };
    *edges = NULL;
    *n = 0;
    cn_status status = index_views(in, &v);
    if (status == CN_OK) status = list_pairs(in, edges, n);
    if (status == CN_OK && in->scene->n_points)
        count_places(in, &v, *edges, *n);
    else if (status == CN_OK)
        count_shared_views(in, &v, *edges, *n);
    uint32_t kept = 0;
    for (uint32_t i = 0; i < *n; i++)
        if ((*edges)[i].n_places >= CN_PLACES_MIN) (*edges)[kept++] = (*edges)[i];
    *n = kept;
    free(v.first);
    free(v.tiles);
    if (status != CN_OK) {
        free(*edges);
        *edges = NULL;
        *n = 0;
    }
    return status;
}

cn_status cn_places_init(cn_places *p, size_t room)
{
    *p = (cn_places){ .room = room };
    p->origin = malloc(room * sizeof *p->origin);
    p->direction = malloc(room * sizeof *p->direction);
    p->rgba = malloc(room * sizeof *p->rgba);
    p->depth = malloc(room * sizeof *p->depth);
    p->edge = malloc(room * sizeof *p->edge);
    if (p->origin && p->direction && p->rgba && p->depth && p->edge) return CN_OK;
    cn_places_deinit(p);
    return cn_fail(CN_ERR_NOMEM, "out of memory for %zu places that tiles share", room);
}

void cn_places_deinit(cn_places *p)
{
    free(p->origin);
    free(p->direction);
    free(p->rgba);
    free(p->depth);
    free(p->edge);
    *p = (cn_places){ 0 };
}

/* Bit 1: a photo of tile a; bit 2: of b. */
static uint8_t *mark_views(const cn_alignment_input *in, uint32_t a, uint32_t b)
{
    uint8_t *mark = calloc(in->scene->n_views + 1u, 1);
    for (uint32_t i = 0; mark && i < in->tiles[a].n_views; i++)
        mark[in->tiles[a].views[i]] |= 1;
    for (uint32_t i = 0; mark && i < in->tiles[b].n_views; i++)
        mark[in->tiles[b].views[i]] |= 2;
    return mark;
}

/* The photo to look from at a point that two photos of each tile see: turn by turn one of either. UINT32_MAX: it is not
 * such a point. */
static uint32_t looker(const cn_scene *scene, const cn_point *point, const uint8_t *mark, uint32_t turn)
{
    uint32_t seen[2] = { 0 }, candidates[MAX_SEEN], n = 0;
    for (uint64_t o = point->first_observation; o < (uint64_t)point->first_observation + point->n_observations; o++) {
        const uint32_t view = scene->observations[o].view;
        seen[0] += mark[view] & 1;
        seen[1] += mark[view] >> 1;
        if (mark[view] && n < MAX_SEEN) candidates[n++] = view;
    }
    return seen[0] < SEEN_BY || seen[1] < SEEN_BY ? UINT32_MAX : candidates[turn % n];
}

static void add_to_point(cn_places *p, const cn_scene *scene, uint32_t view, const double xyz[3])
{
    double *origin = p->origin[p->n], *direction = p->direction[p->n];
    cn_view_centre(&scene->views[view], origin);
    for (int k = 0; k < 3; k++)
        direction[k] = xyz[k] - origin[k];
    if (!(cn_norm3(direction) > 0)) return;
    cn_normalize3(direction);
    p->n++;
}

/* Points evenly out of all that both tiles see. */
static void add_points(cn_places *p, const cn_scene *scene, const uint8_t *mark, size_t most)
{
    size_t n = 0, taken = 0;
    for (uint32_t i = 0; i < scene->n_points; i++)
        n += looker(scene, &scene->points[i], mark, i) != UINT32_MAX;
    const size_t wanted = n < most ? n : most;
    for (uint32_t i = 0, at = 0; i < scene->n_points && taken < wanted; i++) {
        const uint32_t view = looker(scene, &scene->points[i], mark, i);
        if (view == UINT32_MAX) continue;
        if (at++ * wanted / n < taken) continue;
        add_to_point(p, scene, view, scene->points[i].xyz);
        taken++;
    }
}

static void add_pixels(cn_places *p, const cn_alignment_input *in, uint32_t a, uint32_t b, const uint8_t *mark,
                       size_t most)
{
    const cn_scene *scene = in->scene;
    const uint32_t n[2] = { in->tiles[a].n_views, in->tiles[b].n_views };
    bool shared = false;
    for (uint32_t i = 0; i < n[0]; i++)
        shared |= mark[in->tiles[a].views[i]] == 3;
    if (!n[0] || !n[1]) return;
    const uint64_t seed = (uint64_t)a * in->n_tiles + b;
    for (uint32_t i = 0; i < 64 * most && most; i++) {
        const cn_alignment_tile *tile = &in->tiles[i & 1 ? b : a];
        const uint32_t view = tile->views[cn_rng_below(seed, STREAM_VIEW, i, tile->n_views)];
        if (shared && mark[view] != 3) continue; /* what a photo of both shows, both see best */
        const cn_view *v = &scene->views[view];
        const cn_camera *camera = &scene->cameras[v->camera];
        double in_camera[3];
        const double x = cn_rng_below(seed, STREAM_X, i, camera->width) + 0.5,
                     y = cn_rng_below(seed, STREAM_Y, i, camera->height) + 0.5;
        if (cn_camera_unproject(camera, x, y, in_camera) != CN_OK) continue;
        cn_view_centre(v, p->origin[p->n]);
        cn_mat3_tvec(v->rotation, in_camera, p->direction[p->n++]);
        most--;
    }
}

cn_status cn_places_add(cn_places *p, const cn_alignment_input *in, uint32_t a, uint32_t b, size_t most)
{
    const size_t before = p->n;
    uint8_t *mark = mark_views(in, a, b);
    if (!mark) return cn_fail(CN_ERR_NOMEM, "out of memory for places that tiles share");
    if (most > p->room - p->n) most = p->room - p->n;
    add_points(p, in->scene, mark, most);
    add_pixels(p, in, a, b, mark, most - (p->n - before));
    free(mark);
    return CN_OK;
}
