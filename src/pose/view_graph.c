#include "pose/view_graph.h"

#include "bridge/sqlite.h"
#include "pose/colmap.h"
#include "pose/lens.h"

#include <stdlib.h>
#include <string.h>

void cn_view_graph_deinit(cn_view_graph *graph)
{
    for (uint32_t i = 0; i < graph->n_views; i++) {
        free(graph->views[i].name);
        free(graph->views[i].xy);
        free(graph->views[i].rays);
    }
    for (uint32_t i = 0; i < graph->n_pairs; i++)
        free(graph->pairs[i].pairs);
    free(graph->knows_focal);
    free(graph->views);
    free(graph->pairs);
    free(graph->cameras);
    *graph = (cn_view_graph){ 0 };
}

typedef struct reader {
    cn_colmap_database *database;
    cn_view_graph *graph;
    uint32_t *photos; /* COLMAP's number of each view; 0: the database lacks it */
} reader;

/* Camera number `id` of COLMAP goes to index id - 1, for a model's files number cameras by their index. */
static cn_status find_camera(reader *r, uint32_t id, uint32_t *at)
{
    cn_view_graph *g = r->graph;
    if (id > g->n_views) return cn_fail(CN_ERR_DATA, "COLMAP's numbers of cameras have gaps");
    *at = id - 1;
    cn_camera *camera = &g->cameras[*at];
    if (camera->id) return CN_OK;
    cn_colmap_camera given;
    CN_TRY(cn_colmap_database_lens(r->database, id, &given));
    if (!cn_lens_is_known(given.lens)) return cn_fail(CN_ERR_DATA, "camera %u has lens model %d", id, given.lens);
    *camera = (cn_camera){ .id = id, .lens = (cn_lens)given.lens, .width = given.width, .height = given.height };
    memcpy(camera->params, given.params, sizeof camera->params);
    g->knows_focal[*at] = given.has_focal;
    if (id > g->n_cameras) g->n_cameras = id;
    return CN_OK;
}

static cn_status check_cameras(const cn_view_graph *g)
{
    for (uint32_t i = 0; i < g->n_cameras; i++)
        if (!g->cameras[i].id) return cn_fail(CN_ERR_DATA, "COLMAP's numbers of cameras have gaps");
    return g->n_cameras ? CN_OK : cn_fail(CN_ERR_DATA, "COLMAP's database has none of the photos");
}

static cn_status read_view(reader *r, const cn_photo_index *index, bool linked, uint32_t i)
{
    cn_graph_view *view = &r->graph->views[i];
    uint32_t camera = 0;
    view->name = cn_colmap_name(index, linked, i);
    if (!view->name) return cn_fail(CN_ERR_NOMEM, "out of memory");
    CN_TRY(cn_colmap_database_photo(r->database, view->name, &r->photos[i]));
    if (!r->photos[i]) return CN_OK;
    CN_TRY(cn_colmap_database_camera(r->database, view->name, &camera));
    if (!camera) return cn_fail(CN_ERR_FORMAT, "%s has no camera in COLMAP's database", view->name);
    CN_TRY(find_camera(r, camera, &view->camera));
    return cn_colmap_database_places(r->database, r->photos[i], &view->xy, &view->n);
}

typedef struct numbered {
    uint32_t photo, view;
} numbered;

static int by_photo(const void *a, const void *b)
{
    const uint32_t x = ((const numbered *)a)->photo, y = ((const numbered *)b)->photo;
    return (x > y) - (x < y);
}

/* Takes ownership of the matches. False: they name a feature that a photo lacks. */
static bool add_pair(cn_view_graph *g, uint32_t a, uint32_t b, cn_colmap_geometry *found)
{
    cn_graph_pair *pair = &g->pairs[g->n_pairs++];
    const bool swapped = a > b;
    *pair = (cn_graph_pair){ .a = swapped ? b : a, .b = swapped ? a : b, .n = found->n, .pairs = found->pairs };
    for (uint32_t k = 0; k < pair->n; k++) {
        const uint32_t first = pair->pairs[k][swapped], second = pair->pairs[k][!swapped];
        if (first >= g->views[pair->a].n || second >= g->views[pair->b].n) return false;
        pair->pairs[k][0] = first;
        pair->pairs[k][1] = second;
    }
    /* On a plane, a fundamental matrix is not determined. */
    const bool plane = found->config == CN_COLMAP_PLANAR || found->config == CN_COLMAP_PLANAR_OR_PANORAMIC;
    pair->is_essential = found->has_e && (plane || found->config == CN_COLMAP_CALIBRATED);
    pair->used = pair->is_essential || (found->has_f && !plane && found->config != CN_COLMAP_PANORAMIC);
    const double *m = pair->is_essential ? found->e : found->f;
    for (int k = 0; k < 9; k++)
        pair->matrix[k] = swapped ? m[3 * (k % 3) + k / 3] : m[k];
    return true;
}

static cn_status read_pairs(reader *r, const char *path)
{
    cn_view_graph *g = r->graph;
    cn_colmap_verified *listed = NULL;
    numbered *order = malloc((g->n_views + (size_t)1) * sizeof *order);
    size_t n = 0;
    uint32_t n_known = 0;
    cn_status status = order ? CN_OK : cn_fail(CN_ERR_NOMEM, "%s: out of memory", path);
    if (status == CN_OK) status = cn_colmap_database_verified(r->database, &listed, &n);
    if (status == CN_OK && !(g->pairs = calloc(n + 1, sizeof *g->pairs)))
        status = cn_fail(CN_ERR_NOMEM, "%s: out of memory for %zu pairs", path, n);
    for (uint32_t i = 0; i < g->n_views && status == CN_OK; i++)
        if (r->photos[i]) order[n_known++] = (numbered){ r->photos[i], i };
    if (status == CN_OK) qsort(order, n_known, sizeof *order, by_photo);
    for (size_t i = 0; i < n && status == CN_OK; i++) {
        const uint32_t a = listed[i].a < listed[i].b ? listed[i].a : listed[i].b;
        const uint32_t b = listed[i].a < listed[i].b ? listed[i].b : listed[i].a;
        const numbered *first = bsearch(&(numbered){ a, 0 }, order, n_known, sizeof *order, by_photo);
        const numbered *second = bsearch(&(numbered){ b, 0 }, order, n_known, sizeof *order, by_photo);
        cn_colmap_geometry found;
        if (!first || !second) continue;
        status = cn_colmap_database_geometry(r->database, a, b, &found);
        if (status == CN_OK && found.n && !add_pair(g, first->view, second->view, &found))
            status =
                cn_fail(CN_ERR_FORMAT, "%s: a match of photos %u and %u names a feature that is not there", path, a, b);
    }
    free(order);
    free(listed);
    return status;
}

cn_status cn_view_graph_read(const cn_photo_index *index, bool linked, const char *path, cn_view_graph *graph)
{
    reader r = { .graph = graph };
    *graph = (cn_view_graph){ .n_views = index->n_photos };
    graph->views = calloc(index->n_photos + (size_t)1, sizeof *graph->views);
    graph->cameras = calloc(index->n_photos + (size_t)1, sizeof *graph->cameras);
    graph->knows_focal = calloc(index->n_photos + (size_t)1, sizeof *graph->knows_focal);
    r.photos = calloc(index->n_photos + (size_t)1, sizeof *r.photos);
    cn_status status = graph->views && graph->cameras && graph->knows_focal && r.photos
                           ? cn_colmap_database_open(&r.database, path)
                           : cn_fail(CN_ERR_NOMEM, "%s: out of memory", path);
    if (!graph->views) graph->n_views = 0;
    for (uint32_t i = 0; i < index->n_photos && status == CN_OK; i++)
        status = read_view(&r, index, linked, i);
    if (status == CN_OK) status = check_cameras(graph);
    if (status == CN_OK) status = read_pairs(&r, path);
    cn_colmap_database_close(&r.database);
    free(r.photos);
    if (status != CN_OK) cn_view_graph_deinit(graph);
    return status;
}
