#include "compose/overlap.h"

#include "base/rng.h"
#include "math/linalg.h"
#include "math/plane.h"

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

typedef struct pair_list {
    cn_alignment_edge *edges;
    uint32_t n, room, a;
} pair_list;

static bool add_pair(void *user, uint32_t b)
{
    pair_list *l = user;
    if (l->n == l->room) {
        const uint32_t room = l->room ? 2 * l->room : 64;
        cn_alignment_edge *larger = realloc(l->edges, room * sizeof *larger);
        if (!larger) return false;
        l->edges = larger;
        l->room = room;
    }
    l->edges[l->n++] = (cn_alignment_edge){ l->a, b, 0, NAN, NAN };
    return true;
}

/* Pairs of tiles whose circles overlap, sorted. */
static cn_status list_pairs(const cn_alignment_input *in, cn_alignment_edge **edges, uint32_t *n)
{
    double(*centres)[2] = calloc(in->n_tiles + (size_t)1, sizeof *centres);
    double *radii = calloc(in->n_tiles + (size_t)1, sizeof *radii);
    cn_plane plane = { 0 };
    pair_list list = { 0 };
    for (uint32_t t = 0; centres && radii && t < in->n_tiles; t++) {
        memcpy(centres[t], in->tiles[t].centre, sizeof centres[t]);
        radii[t] = in->tiles[t].radius_m;
    }
    bool fine = centres && radii && cn_plane_init(&plane, (const double(*)[2])centres, radii, in->n_tiles);
    for (; list.a < in->n_tiles && fine; list.a++)
        fine = cn_plane_overlaps(&plane, list.a, add_pair, &list);
    cn_plane_deinit(&plane);
    free(centres);
    free(radii);
    if (list.n) qsort(list.edges, list.n, sizeof *list.edges, by_pair);
    *edges = list.edges;
    *n = list.n;
    return fine ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for pairs of %u tiles", in->n_tiles);
}

/* How often the photos of each tile see a point: those of tile[i] times[i] times. */
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
    free(p->first);
    free(p->points);
    free(p->mark);
    *p = (cn_places){ 0 };
}

/* Which points each view sees. */
static cn_status index_points(cn_places *p, const cn_scene *scene)
{
    p->first = calloc(scene->n_views + (size_t)2, sizeof *p->first);
    p->points = calloc(scene->n_observations + 1, sizeof *p->points);
    p->mark = calloc(scene->n_views + (size_t)1, 1);
    if (!p->first || !p->points || !p->mark)
        return cn_fail(CN_ERR_NOMEM, "out of memory for the points of %u photos", scene->n_views);
    for (uint32_t pass = 0; pass < 2; pass++) {
        for (uint32_t i = 0; i < scene->n_points; i++) {
            const cn_point *point = &scene->points[i];
            for (uint32_t o = 0; o < point->n_observations; o++) {
                const uint32_t view = scene->observations[(uint64_t)point->first_observation + o].view;
                if (pass == 0)
                    p->first[view + 2]++;
                else
                    p->points[p->first[view + 1]++] = i;
            }
        }
        for (uint32_t v = 2; pass == 0 && v < scene->n_views + 2; v++)
            p->first[v] += p->first[v - 1];
    }
    return CN_OK;
}

/* Bit 1: a photo of tile a; bit 2: of b. 0 takes the marks away. */
static void mark_views(cn_places *p, const cn_alignment_input *in, uint32_t a, uint32_t b, bool set)
{
    const uint32_t tiles[2] = { a, b };
    for (uint32_t k = 0; k < 2; k++)
        for (uint32_t i = 0; i < in->tiles[tiles[k]].n_views; i++) {
            uint8_t *mark = &p->mark[in->tiles[tiles[k]].views[i]];
            *mark = set ? (uint8_t)(*mark | (1u << k)) : 0;
        }
}

static int by_number(const void *x, const void *y)
{
    const uint32_t a = *(const uint32_t *)x, b = *(const uint32_t *)y;
    return (a > b) - (a < b);
}

/* The points that a tile's photos see, ascending; caller frees. NULL when out of memory. */
static uint32_t *points_of(const cn_places *p, const cn_alignment_tile *tile, size_t *n)
{
    size_t total = 0;
    for (uint32_t i = 0; i < tile->n_views; i++)
        total += p->first[tile->views[i] + 1] - p->first[tile->views[i]];
    uint32_t *points = malloc((total + 1) * sizeof *points);
    if (!points) return NULL;
    size_t all = 0;
    for (uint32_t i = 0; i < tile->n_views; i++)
        for (uint64_t k = p->first[tile->views[i]]; k < p->first[tile->views[i] + 1]; k++)
            points[all++] = p->points[k];
    if (all) qsort(points, all, sizeof *points, by_number);
    *n = 0;
    for (size_t i = 0; i < all; i++)
        if (i == 0 || points[i] != points[i - 1]) points[(*n)++] = points[i];
    return points;
}

/* The photo to view a point from, alternately of either tile. At least two photos of each tile must see the point;
 * else UINT32_MAX. */
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

/* Points evenly out of all that both tiles see; points: those that one of them sees. */
static void add_points(cn_places *p, const cn_scene *scene, const uint32_t *points, size_t n_points, size_t most)
{
    size_t n = 0, taken = 0, at = 0;
    for (size_t i = 0; i < n_points; i++)
        n += looker(scene, &scene->points[points[i]], p->mark, points[i]) != UINT32_MAX;
    const size_t wanted = n < most ? n : most;
    for (size_t i = 0; i < n_points && taken < wanted; i++) {
        const cn_point *point = &scene->points[points[i]];
        const uint32_t view = looker(scene, point, p->mark, points[i]);
        if (view == UINT32_MAX) continue;
        if (at++ * wanted / n < taken) continue;
        add_to_point(p, scene, view, point->xyz);
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
        if (shared && mark[view] != 3) continue; /* prefer points in a photo that both tiles have */
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
    const cn_alignment_tile *fewer = &in->tiles[in->tiles[a].n_views <= in->tiles[b].n_views ? a : b];
    if (!p->first) CN_TRY(index_points(p, in->scene));
    size_t n_points = 0;
    uint32_t *points = points_of(p, fewer, &n_points);
    if (!points) return cn_fail(CN_ERR_NOMEM, "out of memory for places that tiles share");
    if (most > p->room - p->n) most = p->room - p->n;
    mark_views(p, in, a, b, true);
    add_points(p, in->scene, points, n_points, most);
    add_pixels(p, in, a, b, p->mark, most - (p->n - before));
    mark_views(p, in, a, b, false);
    free(points);
    return CN_OK;
}
