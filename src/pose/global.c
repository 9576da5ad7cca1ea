#include "pose/global.h"

#include "base/rng.h"
#include "bridge/ceres.h"
#include "math/linalg.h"
#include "pose/adjust.h"
#include "pose/scene.h"
#include "pose/view_graph.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { SEED = 1, LEAST_SEEN = 15 }; /* points a photo must see in the end: COLMAP's least for a pose */
/* Observations are dropped that are further off than this, after each adjustment. */
static const double MOST_PX[] = { 24.0, 8.0, 4.0 };
enum { N_ROUNDS = sizeof MOST_PX / sizeof *MOST_PX };

typedef struct mapping {
    const cn_context *ctx;
    cn_scene *scene;
    bool fix_focal;
    double (*centres)[3], (*points)[3];
    cn_bearing *bearings;
    uint64_t n_bearings;
} mapping;

/* The directions from cameras to points, by the rotations that are known. */
static void list_bearings(mapping *m)
{
    const cn_scene *s = m->scene;
    for (uint32_t i = 0; i < s->n_points; i++)
        for (uint32_t k = 0; k < s->points[i].n_observations; k++) {
            const cn_observation *o = &s->observations[(uint64_t)s->points[i].first_observation + k];
            const cn_view *view = &s->views[o->view];
            double ray[3];
            if (cn_camera_unproject(&s->cameras[view->camera], o->x_px, o->y_px, ray) != CN_OK) continue;
            cn_bearing *b = &m->bearings[m->n_bearings++];
            *b = (cn_bearing){ .centre = o->view, .point = i };
            cn_mat3_tvec(view->rotation, ray, b->direction);
        }
}

static cn_status find_places(mapping *m)
{
    const cn_scene *s = m->scene;
    m->centres = malloc((s->n_views + (size_t)1) * sizeof *m->centres);
    m->points = malloc((s->n_points + (size_t)1) * sizeof *m->points);
    m->bearings = malloc((s->n_observations + (size_t)1) * sizeof *m->bearings);
    if (!m->centres || !m->points || !m->bearings)
        return cn_fail(CN_ERR_NOMEM, "out of memory placing %u photos", s->n_views);
    for (uint32_t i = 0; i < s->n_views; i++)
        for (uint32_t c = 0; c < 3; c++)
            m->centres[i][c] = 2.0 * (double)cn_rng_float(SEED, 0, 3 * (uint64_t)i + c) - 1.0;
    for (uint32_t i = 0; i < s->n_points; i++)
        for (uint32_t c = 0; c < 3; c++)
            m->points[i][c] = 2.0 * (double)cn_rng_float(SEED, 1, 3 * (uint64_t)i + c) - 1.0;
    list_bearings(m);
    const cn_bearings problem = { m->centres, m->points, m->bearings, s->n_views, s->n_points, m->n_bearings };
    cn_adjust_options options = cn_adjust_options_default();
    cn_adjust_result result;
    options.stage = "poses";
    options.n_threads = cn_pool_threads(m->ctx ? m->ctx->pool : NULL);
    return cn_ceres_place(m->ctx, &problem, &options, &result);
}

/* Writes the places into the scene, in a unit in which half of the cameras lie within 5 of their middle. */
static cn_status take_places(mapping *m)
{
    cn_scene *s = m->scene;
    double middle[3], *values = malloc((s->n_views + (size_t)1) * sizeof *values);
    if (!values) return cn_fail(CN_ERR_NOMEM, "out of memory placing %u photos", s->n_views);
    for (int c = 0; c < 3; c++) {
        for (uint32_t i = 0; i < s->n_views; i++)
            values[i] = m->centres[i][c];
        middle[c] = cn_select(values, s->n_views, s->n_views / 2);
    }
    for (uint32_t i = 0; i < s->n_views; i++)
        values[i] = cn_distance3(m->centres[i], middle);
    const double spread = cn_select(values, s->n_views, s->n_views / 2), scale = spread > 0 ? 5.0 / spread : 1.0;
    free(values);
    for (uint32_t i = 0; i < s->n_views; i++) {
        double centre[3], back[3];
        for (int c = 0; c < 3; c++)
            centre[c] = scale * (m->centres[i][c] - middle[c]);
        cn_mat3_vec(s->views[i].rotation, centre, back);
        for (int c = 0; c < 3; c++)
            s->views[i].translation[c] = -back[c];
    }
    for (uint32_t i = 0; i < s->n_points; i++)
        for (int c = 0; c < 3; c++)
            s->points[i].xyz[c] = scale * (m->points[i][c] - middle[c]);
    return CN_OK;
}

/* Views that see too little lose their place. */
static cn_status drop_views(cn_scene *s)
{
    uint32_t *count = calloc(s->n_views + (size_t)1, sizeof *count);
    bool *keep = malloc(s->n_views + (size_t)1);
    cn_status status = count && keep ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    for (uint64_t i = 0; i < s->n_observations && status == CN_OK; i++)
        count[s->observations[i].view]++;
    for (uint32_t i = 0; i < s->n_views && status == CN_OK; i++)
        keep[i] = count[i] >= LEAST_SEEN;
    if (status == CN_OK) status = cn_scene_keep_views(s, keep);
    free(count);
    free(keep);
    return status;
}

static cn_status adjust_rounds(mapping *m)
{
    for (int round = 0; round < N_ROUNDS; round++) {
        /* As COLMAP does, which goes on from here, and which poses photos that come later. */
        cn_scene_adjustment how = { .keep_lenses = round == 0,
                                    .keep_focal = m->fix_focal,
                                    .keep_centre = true,
                                    .options = cn_adjust_options_default() };
        cn_adjust_result result;
        how.options.stage = "poses";
        how.options.max_iterations = 50;
        how.options.n_threads = cn_pool_threads(m->ctx ? m->ctx->pool : NULL);
        CN_TRY(cn_scene_adjust(m->ctx, m->scene, &how, &result));
        cn_scene_drop_errors(m->scene, MOST_PX[round]);
        CN_TRY(drop_views(m->scene));
        if (m->scene->n_views < 2) return CN_OK;
    }
    return CN_OK;
}

static cn_status place_and_adjust(mapping *m)
{
    cn_status status = find_places(m);
    if (status == CN_OK) status = take_places(m);
    if (status == CN_OK) status = adjust_rounds(m);
    free(m->centres);
    free(m->points);
    free(m->bearings);
    return status;
}

/* Why the photos cannot be mapped at once; NULL: they were. */
static cn_status map(const cn_global_task *task, cn_view_graph *graph, cn_scene *scene, const char **why)
{
    mapping m = { .ctx = task->ctx, .scene = scene, .fix_focal = task->fix_focal };
    uint32_t n_placed;
    *why = "neither EXIF nor the matches tell the focal length";
    if (!task->fix_focal && !cn_graph_calibrate(graph)) return CN_OK;
    *why = "too few pairs agree on how the cameras are turned";
    CN_TRY(cn_graph_relate(task->ctx, graph));
    CN_TRY(cn_graph_average(graph, &n_placed));
    if (2 * n_placed < graph->n_views || n_placed < 3) return CN_OK;
    *why = "too few photos find a place";
    CN_TRY(cn_graph_tracks(graph, scene));
    if (2 * scene->n_views < graph->n_views || scene->n_views < 3) return CN_OK;
    CN_TRY(place_and_adjust(&m));
    if (2 * scene->n_views >= graph->n_views && scene->n_views >= 3) *why = NULL;
    return CN_OK;
}

cn_status cn_global_map(const cn_global_task *task, cn_scene *scene)
{
    cn_view_graph graph;
    const char *why = NULL;
    *scene = (cn_scene){ 0 };
    cn_status status = cn_view_graph_read(task->index, task->linked, task->database, &graph);
    if (status == CN_OK) {
        status = map(task, &graph, scene, &why);
        cn_view_graph_deinit(&graph);
    }
    /* What Ceres cannot solve is what this way cannot do; what is wrong with the database, COLMAP will say. */
    if (status == CN_ERR_DATA || status == CN_ERR_FORMAT) {
        why = cn_error_message();
        status = CN_OK;
    }
    if (status == CN_OK && why)
        cn_log(task->ctx, CN_LOG_INFO, "the photos are mapped one after the other, not at once: %s", why);
    if (status != CN_OK || why) cn_scene_deinit(scene);
    return status;
}
