/* Bundle adjustment of a merged scene: at once where it fits into memory, else group by group. */
#include "base/clock.h"
#include "math/linalg.h"
#include "pose/adjust.h"
#include "pose/align.h"
#include "pose/control_fit.h"
#include "pose/merge.h"
#include "pose/merge_block.h"
#include "pose/scene.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Where groups meet, points are first off by many pixels, more than outliers later. */
#define FIRST_LOSS 8.0
#define FIRST_DROP_PX 16.0
#define DROP_PX 4.0 /* COLMAP's filter_max_reproj_error */
/* Tracks that each photo gets where not all fit into memory: as many as fit, between these. */
enum { FIRST_STEPS = 8, STEPS = 20, FEWEST_TRACKS = 20, MOST_TRACKS = 60 };

typedef struct adjusting {
    const cn_context *ctx;
    const cn_merge_task *task;
    const uint32_t *home;
    cn_scene *scene;
    cn_place_prior *priors;
} adjusting;

static cn_adjust_options options_of(bool first)
{
    cn_adjust_options o = cn_adjust_options_default();
    o.max_iterations = first ? FIRST_STEPS : STEPS;
    if (first) o.loss_sigmas = FIRST_LOSS;
    o.stage = "poses";
    return o;
}

/* Removes observations that are off by more than this, and points that fewer than two views still see. Returns how
 * many observations. */
static uint64_t drop_far(cn_scene *scene, double most_px)
{
    uint64_t kept = 0, before = scene->n_observations;
    uint32_t n_points = 0;
    for (uint32_t i = 0; i < scene->n_points; i++) {
        cn_point point = scene->points[i];
        const uint64_t first = kept;
        for (uint32_t k = 0; k < point.n_observations; k++) {
            const cn_observation seen = scene->observations[(uint64_t)point.first_observation + k];
            double error;
            if (cn_scene_error(scene, &point, &seen, &error) && error <= most_px) scene->observations[kept++] = seen;
        }
        if (kept - first < 2) {
            kept = first;
            continue;
        }
        point.first_observation = (uint32_t)first;
        point.n_observations = (uint32_t)(kept - first);
        scene->points[n_points++] = point;
    }
    scene->n_points = n_points;
    scene->n_observations = kept;
    return before - kept;
}

static cn_status adjust(const adjusting *a, cn_scene *scene, bool first)
{
    cn_adjust_result result;
    cn_scene_adjustment how = { .centres = a->priors,
                                .keep_focal = a->task->options->refine_focal == CN_OFF,
                                .options = options_of(first) };
    return cn_scene_adjust(a->ctx, scene, &how, &result);
}

/* ---- The longest tracks of all photos ---- */

static int by_length(const void *p, const void *q)
{
    const uint64_t x = *(const uint64_t *)p, y = *(const uint64_t *)q;
    return (x > y) - (x < y);
}

/* A photo gets more than its share where others need theirs: about half as much again. */
static uint32_t count_tracks(const adjusting *a)
{
    const cn_adjust_problem one = { .n_observations = 1 };
    const double room = (double)a->task->most_bytes / (double)cn_ceres_bytes(&one);
    return (uint32_t)fmin(fmax(room / (1.5 * a->scene->n_views), FEWEST_TRACKS), MOST_TRACKS);
}

/* Points that give each view this many tracks, the longest first. Returns how many. */
static uint32_t pick_tracks(const cn_scene *scene, uint32_t tracks, uint64_t *order, uint32_t *counts)
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < scene->n_points; i++)
        order[i] = (uint64_t)(UINT32_MAX - scene->points[i].n_observations) << 32 | i;
    qsort(order, scene->n_points, sizeof *order, by_length);
    for (uint32_t i = 0; i < scene->n_points; i++) {
        const cn_point *point = &scene->points[(uint32_t)order[i]];
        const cn_observation *seen = scene->observations + point->first_observation;
        bool wanted = false;
        for (uint32_t k = 0; k < point->n_observations; k++)
            wanted = wanted || counts[seen[k].view] < tracks;
        for (uint32_t k = 0; k < point->n_observations && wanted; k++)
            counts[seen[k].view]++;
        if (wanted) order[n++] = (uint32_t)order[i];
    }
    return n;
}

/* Points keep their place in the cameras that see them: the mean of what each says. */
static void carry_points(cn_scene *scene, const cn_view *before)
{
    for (uint32_t i = 0; i < scene->n_points; i++) {
        cn_point *point = &scene->points[i];
        double sum[3] = { 0 };
        for (uint32_t k = 0; k < point->n_observations; k++) {
            const uint32_t v = scene->observations[(uint64_t)point->first_observation + k].view;
            double cam[3], world[3];
            cn_mat3_vec(before[v].rotation, point->xyz, cam);
            for (int c = 0; c < 3; c++)
                cam[c] += before[v].translation[c] - scene->views[v].translation[c];
            cn_mat3_tvec(scene->views[v].rotation, cam, world);
            for (int c = 0; c < 3; c++)
                sum[c] += world[c] / point->n_observations;
        }
        memcpy(point->xyz, sum, sizeof sum);
    }
}

static void copy_tracks(const cn_scene *scene, const uint64_t *picked, uint32_t n, cn_scene *thin)
{
    for (uint32_t i = 0; i < n; i++) {
        cn_point point = scene->points[picked[i]];
        memcpy(thin->observations + thin->n_observations, scene->observations + point.first_observation,
               point.n_observations * sizeof *thin->observations);
        point.first_observation = (uint32_t)thin->n_observations;
        thin->n_observations += point.n_observations;
        thin->points[thin->n_points++] = point;
    }
}

static cn_status adjust_thin(const adjusting *a)
{
    cn_scene *scene = a->scene, thin = *scene;
    uint64_t *order = malloc((scene->n_points + (size_t)1) * sizeof *order);
    uint32_t *counts = calloc(scene->n_views + (size_t)1, sizeof *counts);
    cn_view *before = malloc((scene->n_views + (size_t)1) * sizeof *before);
    thin.points = malloc((scene->n_points + (size_t)1) * sizeof *thin.points);
    thin.observations = malloc((scene->n_observations + 1) * sizeof *thin.observations);
    thin.n_points = 0;
    thin.n_observations = 0;
    cn_status status = order && counts && before && thin.points && thin.observations
                           ? CN_OK
                           : cn_fail(CN_ERR_NOMEM, "out of memory adjusting groups");
    if (status == CN_OK) {
        memcpy(before, scene->views, scene->n_views * sizeof *before);
        copy_tracks(scene, order, pick_tracks(scene, count_tracks(a), order, counts), &thin);
        cn_log(a->ctx, CN_LOG_INFO, "adjusting %u photos by %u of %u sparse points", scene->n_views, thin.n_points,
               scene->n_points);
        status = adjust(a, &thin, true);
        /* Views and cameras are the scene's own arrays. */
        if (status == CN_OK) status = adjust(a, &thin, false);
        carry_points(scene, before);
    }
    free(order);
    free(counts);
    free(before);
    free(thin.points);
    free(thin.observations);
    return status;
}

/* ---- Both ways ---- */

static bool fits(const adjusting *a)
{
    const cn_scene *s = a->scene;
    const cn_adjust_problem p = {
        .n_cameras = s->n_cameras, .n_poses = s->n_views, .n_points = s->n_points, .n_observations = s->n_observations
    };
    return cn_ceres_bytes(&p) <= a->task->most_bytes;
}

static cn_status adjust_whole(const adjusting *a, cn_merge_report *report)
{
    cn_log(a->ctx, CN_LOG_INFO, "adjusting %u photos and %u sparse points", a->scene->n_views, a->scene->n_points);
    CN_TRY(adjust(a, a->scene, true));
    report->n_dropped += drop_far(a->scene, FIRST_DROP_PX);
    return adjust(a, a->scene, false);
}

/* First all photos by some of their tracks, which settles the lenses and the shape of the whole; then all tracks. */
static cn_status adjust_by_group(const adjusting *a, cn_merge_report *report)
{
    const cn_block_task task = { a->scene, a->home, a->task->groups->n, a->priors, options_of(false) };
    CN_TRY(adjust_thin(a));
    report->n_dropped += drop_far(a->scene, FIRST_DROP_PX);
    cn_log(a->ctx, CN_LOG_INFO, "adjusting group by group, the photos around it held");
    CN_TRY(cn_blocks_adjust(a->ctx, &task));
    report->n_dropped += drop_far(a->scene, DROP_PX);
    return CN_OK;
}

static uint32_t count_gps(const cn_scene *scene, const cn_photo_index *index)
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < scene->n_views; i++)
        n += index->photos[scene->views[i].photo].has_gps;
    return n;
}

size_t cn_merge_memory(void)
{
    const size_t most = (size_t)4 << 30, least = (size_t)256 << 20;
    char key[32];
    double kilobytes = 0, available = 0;
    FILE *stream = fopen("/proc/meminfo", "re");
    while (stream && fscanf(stream, "%31s %lf%*[^\n]", key, &kilobytes) == 2)
        if (strcmp(key, "MemAvailable:") == 0) available = kilobytes * 1024;
    if (stream) fclose(stream);
    return (size_t)fmin(fmax(0.5 * available, (double)least), (double)most);
}

cn_status cn_groups_adjust(const cn_context *ctx, const cn_merge_task *task, const uint32_t *home, cn_scene *scene,
                           cn_frame *frame, cn_merge_report *report)
{
    adjusting a = { .ctx = ctx, .task = task, .home = home, .scene = scene };
    const double began_s = cn_now_s(), most_m = task->options->max_error_m;
    cn_status status = CN_OK;
    if (frame->georeferenced) {
        frame->n_gps = count_gps(scene, task->index);
        CN_TRY(cn_control_measure_gps(scene, task->index, most_m, frame));
        a.priors = calloc(scene->n_views + (size_t)1, sizeof *a.priors);
        status = a.priors ? cn_control_gps(scene, task->index, frame, a.priors)
                          : cn_fail(CN_ERR_NOMEM, "out of memory adjusting groups");
    }
    report->way = fits(&a) ? CN_MERGE_WHOLE : CN_MERGE_BY_GROUP;
    if (status == CN_OK && scene->n_observations)
        status = report->way == CN_MERGE_WHOLE ? adjust_whole(&a, report) : adjust_by_group(&a, report);
    free(a.priors);
    CN_TRY(status);
    if (report->way == CN_MERGE_WHOLE) report->n_dropped += drop_far(scene, DROP_PX);
    report->adjust_s = cn_now_s() - began_s;
    if (frame->georeferenced) CN_TRY(cn_control_measure_gps(scene, task->index, most_m, frame));
    frame->nadir_ambiguous = frame->georeferenced && cn_align_is_nadir(scene);
    return CN_OK;
}
