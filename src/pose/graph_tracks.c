/* Points from chains of matches. */
#include "pose/view_graph.h"

#include "base/disjoint.h"

#include <stdlib.h>
#include <string.h>

enum {
    WANTED = 200,    /* points a photo should see; more only cost time here, for COLMAP finds the rest afterwards */
    LEAST_LENGTH = 3 /* photos that see a point */
};

/* One feature of a placed view. */
typedef struct seen {
    uint32_t track, view, feature;
} seen;

typedef struct chains {
    const cn_view_graph *graph;
    uint64_t *first;  /* number of each view's first feature */
    uint32_t *parent; /* of each feature, by union and find */
    seen *seen;       /* by track, then by view */
    uint64_t n;
    uint64_t *tracks; /* where each track begins in `seen` */
    uint32_t n_tracks;
} chains;

static int by_track(const void *a, const void *b)
{
    const seen *x = a, *y = b;
    if (x->track != y->track) return x->track < y->track ? -1 : 1;
    if (x->view != y->view) return x->view < y->view ? -1 : 1;
    return (x->feature > y->feature) - (x->feature < y->feature);
}

static void join_matches(chains *c)
{
    const cn_view_graph *g = c->graph;
    for (uint32_t i = 0; i < g->n_pairs; i++)
        for (uint32_t k = 0; k < g->pairs[i].n && g->pairs[i].used; k++) {
            const uint64_t a = c->first[g->pairs[i].a] + g->pairs[i].pairs[k][0];
            const uint64_t b = c->first[g->pairs[i].b] + g->pairs[i].pairs[k][1];
            c->parent[cn_root_of(c->parent, (uint32_t)a)] = cn_root_of(c->parent, (uint32_t)b);
        }
}

static void list_seen(chains *c)
{
    const cn_view_graph *g = c->graph;
    for (uint32_t v = 0; v < g->n_views; v++)
        for (uint32_t k = 0; k < g->views[v].n && g->views[v].placed; k++) {
            const float *ray = g->views[v].rays[k];
            if (ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2] < 0.5F) continue;
            c->seen[c->n++] = (seen){ cn_root_of(c->parent, (uint32_t)(c->first[v] + k)), v, k };
        }
    qsort(c->seen, c->n, sizeof *c->seen, by_track);
}

/* Tracks that are long enough, and show no photo twice: such a track holds a wrong match. */
static void list_tracks(chains *c)
{
    for (uint64_t at = 0, end; at < c->n; at = end) {
        bool twice = false;
        for (end = at + 1; end < c->n && c->seen[end].track == c->seen[at].track; end++)
            twice = twice || c->seen[end].view == c->seen[end - 1].view;
        if (end - at >= LEAST_LENGTH && !twice) c->tracks[c->n_tracks++] = at;
    }
}

static uint64_t length_of(const chains *c, uint64_t at)
{
    uint64_t end = at;
    while (end < c->n && c->seen[end].track == c->seen[at].track)
        end++;
    return end - at;
}

/* Tracks by length, longest first, then in their order; a counting sort. CN_ERR_NOMEM. */
static cn_status sort_by_length(chains *c)
{
    const uint32_t most = c->graph->n_views;
    uint64_t *place = calloc(most + (size_t)2, sizeof *place),
             *sorted = malloc((c->n_tracks + (size_t)1) * sizeof *sorted);
    if (!place || !sorted) {
        free(place);
        free(sorted);
        return cn_fail(CN_ERR_NOMEM, "out of memory for %u chains of matches", c->n_tracks);
    }
    for (uint32_t i = 0; i < c->n_tracks; i++)
        place[most - length_of(c, c->tracks[i]) + 1]++;
    for (uint32_t i = 0; i < most; i++)
        place[i + 1] += place[i];
    for (uint32_t i = 0; i < c->n_tracks; i++)
        sorted[place[most - length_of(c, c->tracks[i])]++] = c->tracks[i];
    free(place);
    free(c->tracks);
    c->tracks = sorted;
    return CN_OK;
}

/* Keeps a track when one of its photos has too few points. Returns observations of those kept. */
static uint64_t choose(chains *c, uint32_t *points_of)
{
    uint32_t kept = 0;
    uint64_t n = 0;
    for (uint32_t i = 0; i < c->n_tracks; i++) {
        const uint64_t at = c->tracks[i], length = length_of(c, at);
        bool wanted = false;
        for (uint64_t k = at; k < at + length; k++)
            wanted = wanted || points_of[c->seen[k].view] < WANTED;
        if (!wanted) continue;
        for (uint64_t k = at; k < at + length; k++)
            points_of[c->seen[k].view]++;
        c->tracks[kept++] = at;
        n += length;
    }
    c->n_tracks = kept;
    return n;
}

/* Views that see a point, with their names and rotations. */
static cn_status fill_views(const cn_view_graph *g, const uint32_t *points_of, cn_scene *scene, uint32_t *slot)
{
    for (uint32_t v = 0; v < g->n_views; v++) {
        slot[v] = UINT32_MAX;
        if (!points_of[v]) continue;
        slot[v] = scene->n_views;
        cn_view *view = &scene->views[scene->n_views++];
        *view = (cn_view){ .name = strdup(g->views[v].name), .camera = g->views[v].camera, .photo = UINT32_MAX };
        if (!view->name) return cn_fail(CN_ERR_NOMEM, "out of memory");
        memcpy(view->rotation, g->views[v].rotation, sizeof view->rotation);
    }
    return CN_OK;
}

static void fill_points(const chains *c, cn_scene *scene, const uint32_t *slot)
{
    for (uint32_t i = 0; i < c->n_tracks; i++) {
        cn_point *point = &scene->points[scene->n_points++];
        const uint64_t length = length_of(c, c->tracks[i]);
        *point = (cn_point){ .first_observation = (uint32_t)scene->n_observations, .n_observations = (uint32_t)length };
        for (uint64_t k = c->tracks[i]; k < c->tracks[i] + length; k++) {
            const float *xy = c->graph->views[c->seen[k].view].xy[c->seen[k].feature];
            scene->observations[scene->n_observations++] = (cn_observation){ slot[c->seen[k].view], xy[0], xy[1] };
        }
    }
}

static cn_status fill(const chains *c, const uint32_t *points_of, uint64_t n_seen, cn_scene *scene)
{
    const cn_view_graph *g = c->graph;
    uint32_t *slot = malloc((g->n_views + (size_t)1) * sizeof *slot);
    scene->cameras = malloc((g->n_cameras + (size_t)1) * sizeof *scene->cameras);
    scene->views = calloc(g->n_views + (size_t)1, sizeof *scene->views);
    scene->points = malloc((c->n_tracks + (size_t)1) * sizeof *scene->points);
    scene->observations = malloc((n_seen + 1) * sizeof *scene->observations);
    cn_status status = slot && scene->cameras && scene->views && scene->points && scene->observations
                           ? CN_OK
                           : cn_fail(CN_ERR_NOMEM, "out of memory for %u points", c->n_tracks);
    if (status == CN_OK) {
        memcpy(scene->cameras, g->cameras, g->n_cameras * sizeof *scene->cameras);
        scene->n_cameras = g->n_cameras;
        status = fill_views(g, points_of, scene, slot);
    }
    if (status == CN_OK) {
        fill_points(c, scene, slot);
    }
    free(slot);
    return status;
}

cn_status cn_graph_tracks(const cn_view_graph *graph, cn_scene *scene)
{
    chains c = { .graph = graph, .first = malloc((graph->n_views + (size_t)1) * sizeof *c.first) };
    uint32_t *points_of = calloc(graph->n_views + (size_t)1, sizeof *points_of);
    uint64_t n = 0;
    *scene = (cn_scene){ 0 };
    for (uint32_t v = 0; v < graph->n_views && c.first; v++) {
        c.first[v] = n;
        n += graph->views[v].n;
    }
    if (n < UINT32_MAX) {
        c.parent = malloc((n + 1) * sizeof *c.parent);
        c.seen = malloc((n + 1) * sizeof *c.seen);
        c.tracks = malloc((n + 1) * sizeof *c.tracks);
    }
    cn_status status = points_of && c.first && c.parent && c.seen && c.tracks
                           ? CN_OK
                           : cn_fail(CN_ERR_NOMEM, "out of memory for %llu features", (unsigned long long)n);
    if (status == CN_OK) {
        for (uint64_t i = 0; i < n; i++)
            c.parent[i] = (uint32_t)i;
        join_matches(&c);
        list_seen(&c);
        list_tracks(&c);
        status = sort_by_length(&c);
    }
    if (status == CN_OK) {
        const uint64_t n_seen = choose(&c, points_of);
        status = fill(&c, points_of, n_seen, scene);
    }
    free(c.first);
    free(c.parent);
    free(c.seen);
    free(c.tracks);
    free(points_of);
    if (status != CN_OK) cn_scene_deinit(scene);
    return status;
}
