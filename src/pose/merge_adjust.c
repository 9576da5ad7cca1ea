/* Bundle adjustment of a merged scene: at once where it fits into memory, else group by group. */
#include "base/clock.h"
#include "math/linalg.h"
#include "pose/adjust.h"
#include "pose/align_up.h"
#include "pose/control_fit.h"
#include "pose/from_photos.h"
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
    bool keep_focal;
} adjusting;

static cn_adjust_options options_of(bool first)
{
    cn_adjust_options o = cn_adjust_options_default();
    o.max_iterations = first ? FIRST_STEPS : STEPS;
    if (first) o.loss_sigmas = FIRST_LOSS;
    o.stage = "poses";
    return o;
}

static cn_status adjust(const adjusting *a, cn_scene *scene, bool first)
{
    cn_adjust_result result;
    cn_scene_adjustment how = { .centres = a->priors, .keep_focal = a->keep_focal, .options = options_of(first) };
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

/* ---- Photos whose observations contradict each other ---- */

/* A photo is odd when its mean error is above this many times the median photo's. */
#define ODD 3.0
#define FITS_PX 2.0
/* Observations of odd photos that fit then, of those that did before, for their new poses to count. A wrong pose is a
 * compromise, so the mean error may rise. */
#define MORE 1.05

static uint64_t count_fits(const cn_scene *scene, const bool *marked)
{
    uint64_t n = 0;
    for (uint32_t i = 0; i < scene->n_points; i++)
        for (uint32_t k = 0; k < scene->points[i].n_observations; k++) {
            const cn_observation *seen = &scene->observations[(uint64_t)scene->points[i].first_observation + k];
            double error;
            n += marked[seen->view] && cn_scene_error(scene, &scene->points[i], seen, &error) && error <= FITS_PX;
        }
    return n;
}

/* Marks odd views. Such a photo took a wrong pose from its group, and holds its neighbours off their places. */
static cn_status find_odd(const cn_scene *scene, bool *odd, uint32_t *n_odd)
{
    double *sum = calloc(scene->n_views + (size_t)1, sizeof *sum),
           *means = malloc((scene->n_views + 1) * sizeof *means);
    uint32_t *n = calloc(scene->n_views + (size_t)1, sizeof *n), n_means = 0;
    const bool room = sum && means && n;
    *n_odd = 0;
    for (uint32_t i = 0; i < scene->n_points && room; i++)
        for (uint32_t k = 0; k < scene->points[i].n_observations; k++) {
            const cn_observation *seen = &scene->observations[(uint64_t)scene->points[i].first_observation + k];
            double error;
            if (!cn_scene_error(scene, &scene->points[i], seen, &error)) continue;
            sum[seen->view] += error;
            n[seen->view]++;
        }
    for (uint32_t v = 0; v < scene->n_views && room; v++)
        if (n[v]) means[n_means++] = sum[v] / n[v];
    const double most = room && n_means ? ODD * cn_select(means, n_means, n_means / 2) : 0.0;
    for (uint32_t v = 0; v < scene->n_views && room; v++) {
        odd[v] = n[v] && sum[v] / n[v] > most;
        *n_odd += odd[v];
    }
    free(sum);
    free(means);
    free(n);
    return room ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory adjusting groups");
}

/* The scene without what odd views see. Points keep their index; those that fewer than two others see have no
 * observation. Views and cameras are the scene's own. */
static cn_status leave_out(const cn_scene *scene, const bool *odd, cn_scene *rest)
{
    *rest = *scene;
    rest->points = malloc((scene->n_points + (size_t)1) * sizeof *rest->points);
    rest->observations = malloc((scene->n_observations + 1) * sizeof *rest->observations);
    rest->n_observations = 0;
    if (!rest->points || !rest->observations) return cn_fail(CN_ERR_NOMEM, "out of memory adjusting groups");
    for (uint32_t i = 0; i < scene->n_points; i++) {
        cn_point point = scene->points[i];
        const uint64_t first = rest->n_observations;
        for (uint32_t k = 0; k < point.n_observations; k++) {
            const cn_observation *seen = &scene->observations[(uint64_t)point.first_observation + k];
            if (!odd[seen->view]) rest->observations[rest->n_observations++] = *seen;
        }
        if (rest->n_observations - first < 2) rest->n_observations = first;
        point.first_observation = (uint32_t)first;
        point.n_observations = (uint32_t)(rest->n_observations - first);
        rest->points[i] = point;
    }
    return CN_OK;
}

/* Adjusts odd views alone, from the place that GPS gives them. */
static cn_status adjust_odd(const adjusting *a, const bool *odd)
{
    cn_adjust_result result;
    bool *fixed = malloc(a->scene->n_views + (size_t)1);
    if (!fixed) return cn_fail(CN_ERR_NOMEM, "out of memory adjusting groups");
    for (uint32_t v = 0; v < a->scene->n_views; v++)
        fixed[v] = !odd[v];
    cn_scene_adjustment how = {
        .centres = a->priors, .fixed = fixed, .keep_lenses = true, .keep_focal = true, .options = options_of(true)
    };
    how.options.max_iterations = STEPS;
    const cn_status status = cn_scene_adjust(a->ctx, a->scene, &how, &result);
    free(fixed);
    return status;
}

/* All others are adjusted without the odd photos, then those by what the others say, then all together. */
static cn_status adjust_without(const adjusting *a, const bool *odd)
{
    cn_scene rest;
    cn_status status = leave_out(a->scene, odd, &rest);
    if (status == CN_OK) status = adjust(a, &rest, false);
    for (uint32_t i = 0; i < a->scene->n_points && status == CN_OK; i++)
        memcpy(a->scene->points[i].xyz, rest.points[i].xyz, sizeof rest.points[i].xyz);
    free(rest.points);
    free(rest.observations);
    if (status == CN_OK) status = adjust_odd(a, odd);
    return status == CN_OK ? adjust(a, a->scene, false) : status;
}

/* Leaves the scene as it was where that does not make odd photos fit. */
static cn_status settle_odd(const adjusting *a)
{
    cn_scene *scene = a->scene;
    uint32_t n_odd = 0;
    bool *odd = calloc(scene->n_views + (size_t)1, sizeof *odd);
    cn_view *views = malloc((scene->n_views + (size_t)1) * sizeof *views);
    cn_camera *cameras = malloc((scene->n_cameras + (size_t)1) * sizeof *cameras);
    cn_point *points = malloc((scene->n_points + (size_t)1) * sizeof *points);
    cn_status status = odd && views && cameras && points ? find_odd(scene, odd, &n_odd)
                                                         : cn_fail(CN_ERR_NOMEM, "out of memory adjusting groups");
    if (status == CN_OK && n_odd) {
        const uint64_t before = count_fits(scene, odd);
        memcpy(views, scene->views, scene->n_views * sizeof *views);
        memcpy(cameras, scene->cameras, scene->n_cameras * sizeof *cameras);
        memcpy(points, scene->points, scene->n_points * sizeof *points);
        status = adjust_without(a, odd);
        const bool solved = status == CN_OK;
        /* What cannot be adjusted stays, too: the scene was fine before. */
        if (status == CN_ERR_DATA) status = CN_OK;
        const uint64_t after = solved ? count_fits(scene, odd) : 0;
        const bool better = (double)after >= MORE * (double)before;
        if (status == CN_OK)
            cn_log(a->ctx, CN_LOG_INFO,
                   "%u photos did not fit the others: adjusted without them, then with them; of their observations "
                   "%llu fit, not %llu%s",
                   n_odd, (unsigned long long)after, (unsigned long long)before, better ? "" : "; left as they were");
        if (status == CN_OK && !better) {
            memcpy(scene->views, views, scene->n_views * sizeof *views);
            memcpy(scene->cameras, cameras, scene->n_cameras * sizeof *cameras);
            memcpy(scene->points, points, scene->n_points * sizeof *points);
        }
    }
    free(odd);
    free(views);
    free(cameras);
    free(points);
    return status;
}

/* A photo that keeps fewer observations than COLMAP asks of a pose (abs_pose_min_num_inliers), and less than a third of
 * those that it came with, has a pose that the other photos contradict. */
enum { FEWEST_LEFT = 30, LEAST_PART = 3, MOST_NAMED = 10 };

/* The caller frees it; NULL when out of memory. */
static uint32_t *count_observations(const cn_scene *scene)
{
    uint32_t *n = calloc(scene->n_views + (size_t)1, sizeof *n);
    for (uint64_t i = 0; i < scene->n_observations && n; i++)
        n[scene->observations[i].view]++;
    return n;
}

/* Takes away the photos that the adjustment left with little of what they had. before: observations of each. */
static cn_status leave_out_contradicted(const adjusting *a, const uint32_t *before)
{
    cn_scene *scene = a->scene;
    uint32_t *left = count_observations(scene), n_out = 0;
    bool *keep = malloc(scene->n_views + (size_t)1);
    cn_status status = left && keep ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory adjusting groups");
    for (uint32_t v = 0; v < scene->n_views && status == CN_OK; v++) {
        keep[v] = left[v] >= FEWEST_LEFT || left[v] >= before[v] / LEAST_PART;
        if (keep[v]) continue;
        if (n_out++ < MOST_NAMED)
            cn_log(a->ctx, CN_LOG_WARN, "%s is left out: of its %u sparse points the other photos confirm %u",
                   scene->views[v].name, before[v], left[v]);
    }
    if (n_out > MOST_NAMED)
        cn_log(a->ctx, CN_LOG_WARN, "%u more photos are left out for the same reason", n_out - MOST_NAMED);
    if (status == CN_OK && n_out) status = cn_scene_keep_views(scene, keep);
    free(left);
    free(keep);
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
    report->n_dropped += cn_scene_drop_errors(a->scene, FIRST_DROP_PX);
    CN_TRY(adjust(a, a->scene, false));
    return settle_odd(a);
}

/* First all photos by some of their tracks, which settles the lenses and the shape of the whole; then all tracks. */
static cn_status adjust_by_group(const adjusting *a, cn_merge_report *report)
{
    const cn_block_task task = { a->scene, a->home, a->task->groups->n, a->priors, options_of(false) };
    CN_TRY(adjust_thin(a));
    report->n_dropped += cn_scene_drop_errors(a->scene, FIRST_DROP_PX);
    cn_log(a->ctx, CN_LOG_INFO, "adjusting group by group, the photos around it held");
    CN_TRY(cn_blocks_adjust(a->ctx, &task));
    report->n_dropped += cn_scene_drop_errors(a->scene, DROP_PX);
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
    a.keep_focal =
        cn_pose_keeps_focal(task->index, task->options->refine_focal, frame->georeferenced && cn_align_is_nadir(scene));
    const double began_s = cn_now_s(), most_m = task->options->max_error_m;
    cn_status status = CN_OK;
    if (frame->georeferenced) {
        frame->n_gps = count_gps(scene, task->index);
        CN_TRY(cn_control_measure_gps(scene, task->index, most_m, frame));
        a.priors = calloc(scene->n_views + (size_t)1, sizeof *a.priors);
        status = a.priors ? cn_control_gps(scene, task->index, frame, a.priors)
                          : cn_fail(CN_ERR_NOMEM, "out of memory adjusting groups");
    }
    uint32_t *before = count_observations(scene);
    if (status == CN_OK && !before) status = cn_fail(CN_ERR_NOMEM, "out of memory adjusting groups");
    report->way = fits(&a) ? CN_MERGE_WHOLE : CN_MERGE_BY_GROUP;
    if (status == CN_OK && scene->n_observations)
        status = report->way == CN_MERGE_WHOLE ? adjust_whole(&a, report) : adjust_by_group(&a, report);
    if (status == CN_OK && report->way == CN_MERGE_WHOLE) report->n_dropped += cn_scene_drop_errors(scene, DROP_PX);
    if (status == CN_OK) status = leave_out_contradicted(&a, before);
    free(a.priors);
    free(before);
    CN_TRY(status);
    report->adjust_s = cn_now_s() - began_s;
    if (frame->georeferenced) {
        frame->n_gps = count_gps(scene, task->index);
        CN_TRY(cn_control_measure_gps(scene, task->index, most_m, frame));
    }
    frame->nadir_ambiguous = frame->georeferenced && cn_align_is_nadir(scene);
    return CN_OK;
}
