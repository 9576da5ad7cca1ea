#include "pose/ladder.h"

#include "base/clock.h"
#include "base/file.h"
#include "base/process.h"
#include "bridge/sqlite.h"
#include "pose/align.h"
#include "pose/align_fit.h"
#include "pose/colmap.h"
#include "pose/connected.h"
#include "pose/mapping.h"
#include "pose/outlier.h"
#include "pose/parts.h"
#include "pose/retrieval.h"
#include "pose/scene.h"
#include "pose/similarity.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Shares of the photos with which an attempt of the next kind is not worth its time: one that only maps again, and one
 * that also needs new features and matches. */
#define ENOUGH 0.95
#define ENOUGH_FOR_NEW_FEATURES 0.8
#define ENOUGH_OF_RIGS 0.6 /* views of rigs: some of them see only what is near, or the sky */
#define ENOUGH_SHARED 0.6  /* photos of a group that are in the core of another */
#define MOST_PHOTOS_FOR_NEW_FEATURES 500
#define MOST_PHOTOS_TO_MAP_AGAIN 100
/* Mean reprojection error above which a model counts as doubtful, whatever its photos: good ones have 0.3 to 1 px, and
 * COLMAP leaves out observations above 4 px. The same holds where most photos disagree with their GPS. */
#define DOUBTFUL_PX 1.5
#define SAME_PLACE 0.02 /* of the spread of the cameras */

typedef struct cn_rung {
    const char *name, *suffix;
    bool at_once;      /* by the global mapper */
    bool new_features; /* in a folder of its own; else the first attempt's matches are mapped again */
    cn_colmap_way way;
} cn_rung;

/* Along a street few photos see a point from the sides, so the lens is hardly determined: OPENCV's eight parameters
 * then bend the whole model. */
static cn_status simplify_cameras(const cn_colmap_job *j)
{
    cn_colmap_database *database;
    CN_TRY(cn_colmap_database_open(&database, j->database));
    const cn_status status = cn_colmap_database_simplify_cameras(database);
    cn_colmap_database_close(&database);
    return status;
}

/* Along a street the camera moves forwards, and angles between photos are small: COLMAP's defaults find no pair to
 * begin with. They also drop models of fewer than 10 photos, or, of less than 13 photos, fewer than 0.8 of them: all
 * poses of a few photos, if some photos show something else. */
#define FORWARD                                                                                                        \
    "--Mapper.min_model_size", "3", "--Mapper.init_max_forward_motion", "0.99", "--Mapper.init_min_tri_angle"
#define LOOSE                                                                                                          \
    "--Mapper.init_min_num_inliers", "50", "--Mapper.abs_pose_min_num_inliers", "15",                                  \
        "--Mapper.abs_pose_min_inlier_ratio", "0.15"

static const char *const FORWARD_WORDS[] = { FORWARD, "6", NULL };
static const char *const LOOSE_WORDS[] = { FORWARD, "3", LOOSE, NULL };
static const char *const SHAPE_WORDS[] = { "--SiftExtraction.estimate_affine_shape", "1",
                                           "--SiftExtraction.domain_size_pooling", "1", NULL };
static const char *const GUIDED_WORDS[] = { "--SiftMatching.guided_matching", "1", NULL };

static const cn_rung RUNGS[CN_MOST_ATTEMPTS] = {
    { "all photos at once", "-global", true, false, { 0 } },
    { "COLMAP's defaults", "", false, false, { 0 } },
    { "a start from forward motion and small angles",
      "-2",
      false,
      false,
      { .mapper = FORWARD_WORDS, .simple_camera = true } },
    { "fewer matches for a photo", "-3", false, false, { .mapper = LOOSE_WORDS, .simple_camera = true } },
    { "more features, of affine shape, with guided matches",
      "-4",
      false,
      true,
      { .features = SHAPE_WORDS,
        .matches = GUIDED_WORDS,
        .mapper = LOOSE_WORDS,
        .simple_camera = true,
        .every_pair = true } },
};

static void job_deinit(cn_colmap_job *j)
{
    free(j->log);
    free(j->database);
    free(j->images);
    free(j->note);
}

static cn_status job_init(cn_colmap_job *j, const cn_colmap_task *task, const char *dir, const cn_colmap_way *way)
{
    *j = (cn_colmap_job){ .ctx = task->ctx,
                          .index = task->index,
                          .options = task->options,
                          .way = way,
                          .dir = dir,
                          .linked = cn_colmap_needs_links(task->index) };
    snprintf(j->threads, sizeof j->threads, "%u", cn_pool_threads(task->ctx ? task->ctx->pool : NULL));
    j->log = cn_path_join(task->dir, "colmap.log");
    j->database = cn_path_join(dir, "database.db");
    j->images = j->linked ? cn_path_join(task->dir, "links") : strdup(task->index->folder);
    j->note = cn_path_join(task->dir, "colmap.pid");
    if (j->log && j->database && j->images && j->note) return CN_OK;
    job_deinit(j);
    return cn_fail(CN_ERR_NOMEM, "out of memory");
}

static cn_status map(const cn_colmap_task *task, cn_colmap_job *j, const cn_rung *rung, cn_mapped *out)
{
    cn_mapping how = { rung->suffix, task->fix_focal, CN_GLOBAL_NONE };
    /* COLMAP's global mapper refines focal lengths. */
    if (rung->at_once)
        how.global = task->colmaps_global && !task->fix_focal && cn_colmap_has_global_mapper(j->options->colmap)
                         ? CN_GLOBAL_COLMAP
                         : CN_GLOBAL_OWN;
    return cn_colmap_map(j, &how, out);
}

/* An attempt with features of its own. *database: the caller frees it. */
static cn_status map_anew(const cn_colmap_task *task, const cn_rung *rung, cn_mapped *out, char **database)
{
    cn_colmap_job j;
    cn_pose_options options = *task->options;
    cn_colmap_task more = *task;
    char *dir = cn_format("%s/attempt%s", task->dir, rung->suffix);
    options.max_features *= 2;
    more.options = &options;
    cn_status status = dir ? cn_folder_make(dir) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = job_init(&j, &more, dir, &rung->way);
    if (status == CN_OK) {
        status = cn_colmap_features(&j);
        if (status == CN_OK) status = cn_colmap_matches(&j);
        if (status == CN_OK) status = map(&more, &j, rung, out);
        *database = status == CN_OK ? strdup(j.database) : NULL;
        job_deinit(&j);
    }
    free(dir);
    return status;
}

/* The best result so far. */
typedef struct kept {
    cn_mapped mapped;
    const cn_rung *rung;
    char *database; /* that it was made from */
    uint32_t n_attempts;
    bool confirmed;  /* two attempts agree with each other, so it is GPS that is off */
    bool *connected; /* of each photo: see connected.h; NULL: not known */
} kept;

/* Photos that the global mapper left out contradict what it found, or have too few matches. Then COLMAP maps alone too,
 * as far as that takes minutes. 25 photos around a table with two mats, kitchen of facebookresearch/vggsfm: 18 were
 * placed, and the others added, with 3023 points; but the table was there twice. COLMAP alone has 3279 points. On eight
 * other sets all photos were placed. */
static bool is_partly_placed(const cn_mapped *mapped)
{
    return mapped->n_at_once && mapped->n_at_once < ENOUGH * mapped->n_photos;
}

static bool is_enough(const cn_colmap_task *task, const kept *found, const cn_rung *next)
{
    const cn_mapped *best = &found->mapped;
    const uint32_t n = task->index->n_photos;
    const double enough = task->rig_views ? ENOUGH_OF_RIGS : next->new_features ? ENOUGH_FOR_NEW_FEATURES : ENOUGH;
    uint32_t n_core = 0, n_shared = 0;
    for (uint32_t i = 0; i < n; i++) {
        const bool core = !task->core || task->core[i];
        if (found->connected && !found->connected[i] && !next->new_features) continue;
        n_core += core;
        n_shared += !core;
    }
    const bool posed = best->n_core >= enough * n_core &&
                       best->n_photos + best->n_elsewhere - best->n_core >= fmin(enough, ENOUGH_SHARED) * n_shared;
    if (found->n_attempts == 1 && is_partly_placed(best) && n <= MOST_PHOTOS_TO_MAP_AGAIN) return false;
    if (!next->new_features)
        return posed && best->error_px <= DOUBTFUL_PX &&
               (found->confirmed || !cn_align_is_doubtful(best->n_gps, best->n_agree));
    return posed || n > MOST_PHOTOS_FOR_NEW_FEATURES;
}

/* Of as many photos, many points with small errors hold the poses best. Errors alone favour few points: 16 photos of a
 * rig had 244 points at 0.54 px, and 593 at 0.57 px. */
static bool is_better(const cn_mapped *a, const cn_mapped *b)
{
    if (!a->model || !b->model) return a->model != NULL;
    const uint32_t n_a = a->n_photos + a->n_elsewhere, n_b = b->n_photos + b->n_elsewhere;
    const bool as_many = is_partly_placed(a) != is_partly_placed(b) && fmin(n_a, n_b) >= ENOUGH * fmax(n_a, n_b);
    if (n_a != n_b && !as_many) return n_a > n_b;
    if (cn_align_is_clearly_better(a->n_gps, b->n_agree, a->n_agree)) return true;
    if (cn_align_is_clearly_better(a->n_gps, a->n_agree, b->n_agree)) return false;
    return a->n_points * b->error_px > b->n_points * a->error_px;
}

static cn_status count_in(const cn_colmap_task *task, cn_scene *scene, cn_mapped *got)
{
    uint32_t n_lost;
    cn_frame frame;
    cn_parts parts;
    if (cn_colmap_needs_links(task->index)) CN_TRY(cn_colmap_restore_names(scene, task->index));
    CN_TRY(cn_scene_tie(scene, task->index, &n_lost));
    CN_TRY(cn_pose_drop_unsupported(NULL, scene));
    CN_TRY(cn_align(NULL, scene, task->index, task->options->max_error_m, CN_LEVEL_NEVER, &frame));
    if (frame.georeferenced) {
        got->n_gps = frame.n_gps;
        got->n_agree = frame.n_inliers;
    }
    CN_TRY(cn_parts_find(task, got->folder, scene, &frame, &parts));
    got->n_elsewhere = parts.n_views;
    cn_parts_deinit(&parts);
    got->n_core = got->n_elsewhere;
    for (uint32_t v = 0; v < scene->n_views; v++)
        got->n_core += !task->core || (scene->views[v].photo != UINT32_MAX && task->core[scene->views[v].photo]);
    return CN_OK;
}

/* Counts the photos of the core, those whose GPS agrees with the model, and those of other models. */
static cn_status count_photos(const cn_colmap_task *task, cn_mapped *got)
{
    cn_scene scene;
    if (!got->model) return CN_OK;
    CN_TRY(cn_scene_read_colmap(&scene, got->model));
    const cn_status status = count_in(task, &scene, got);
    cn_scene_deinit(&scene);
    return status;
}

static void tell(const cn_colmap_task *task, const cn_rung *rung, const cn_mapped *got, double seconds)
{
    const uint32_t n = task->index->n_photos;
    char gps[64] = "", more[64] = "";
    if (got->n_gps) snprintf(gps, sizeof gps, ", %u of %u agree with their GPS", got->n_agree, got->n_gps);
    if (got->n_elsewhere) snprintf(more, sizeof more, ", %u more elsewhere by GPS", got->n_elsewhere);
    if (got->model)
        cn_log(task->ctx, CN_LOG_INFO, "attempt %u (%s): %u of %u photos, %u sparse points, %.2f px%s%s, %.0f s",
               got->attempt, rung->name, got->n_photos, n, got->n_points, got->error_px, gps, more, seconds);
    else
        cn_log(task->ctx, CN_LOG_INFO, "attempt %u (%s): none of %u photos, %.0f s", got->attempt, rung->name, n,
               seconds);
}

/* Takes ownership of what was found and of the database's path. */
static void take(kept *best, const cn_rung *rung, cn_mapped *got, char *database)
{
    if (is_better(got, &best->mapped)) {
        cn_mapped_deinit(&best->mapped);
        free(best->database);
        best->mapped = *got;
        best->database = database;
        best->rung = rung;
    } else {
        cn_mapped_deinit(got);
        free(database);
    }
}

/* Whether two models have their shared cameras at the same places, up to a similarity. */
static cn_status compare_places(const cn_scene *a, const cn_scene *b, bool *same)
{
    double(*from)[3] = calloc(a->n_views + (size_t)1, sizeof *from),
    (*to)[3] = calloc(a->n_views + (size_t)1, sizeof *to);
    bool *near = calloc(a->n_views + (size_t)1, sizeof *near);
    uint32_t n = 0;
    for (uint32_t i = 0; from && to && near && i < a->n_views; i++)
        for (uint32_t k = 0; k < b->n_views; k++) {
            if (strcmp(a->views[i].name, b->views[k].name) != 0) continue;
            cn_view_centre(&a->views[i], from[n]);
            cn_view_centre(&b->views[k], to[n++]);
            break;
        }
    *same = false;
    if (n >= 3) {
        double spread[3];
        cn_similarity s;
        cn_spread(n, (const double(*)[3])to, NULL, spread, NULL);
        const cn_similarity_task task = {
            n, (const double(*)[3])from, (const double(*)[3])to, SAME_PLACE * spread[2], 1, 1, NULL
        };
        *same = cn_pose_fit_similarity(&task, &s, near) == CN_OK &&
                cn_similarity_count(near, n) >= ENOUGH * fmax(a->n_views, b->n_views);
    }
    const bool room = from && to && near;
    free(from);
    free(to);
    free(near);
    return room ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory comparing two models");
}

static cn_status confirm(const cn_colmap_task *task, const char *model, kept *best)
{
    cn_scene a = { 0 }, b = { 0 };
    cn_status status = cn_scene_read_colmap(&a, best->mapped.model);
    if (status == CN_OK) status = cn_scene_read_colmap(&b, model);
    if (status == CN_OK) status = compare_places(&a, &b, &best->confirmed);
    cn_scene_deinit(&a);
    cn_scene_deinit(&b);
    if (status == CN_OK && best->confirmed)
        cn_log(task->ctx, CN_LOG_INFO, "two attempts agree on the poses, so it is the GPS of the photos that is off");
    return status;
}

/* The next attempt, of which the better result is kept. A way that does not hold for these photos is none. */
static cn_status attempt(const cn_colmap_task *task, cn_colmap_job *first, const cn_rung *rung, kept *best)
{
    const uint64_t chain = first->chain;
    const double started_s = cn_now_s();
    cn_mapped got = { 0 };
    char *from = NULL;
    first->way = &rung->way;
    cn_status status = rung->way.simple_camera && !rung->new_features ? simplify_cameras(first) : CN_OK;
    if (status == CN_OK) status = rung->new_features ? map_anew(task, rung, &got, &from) : map(task, first, rung, &got);
    first->chain = chain;
    got.attempt = best->n_attempts + 1;
    if (status == CN_OK) status = count_photos(task, &got);
    if (status != CN_OK) {
        cn_mapped_deinit(&got);
        free(from);
        return status;
    }
    if (rung->at_once && !got.model) {
        free(from);
        return CN_OK;
    }
    best->n_attempts++;
    tell(task, rung, &got, cn_now_s() - started_s);
    if (best->mapped.model && got.model && cn_align_is_doubtful(best->mapped.n_gps, best->mapped.n_agree))
        status = confirm(task, got.model, best);
    if (status != CN_OK) {
        cn_mapped_deinit(&got);
        free(from);
        return status;
    }
    if (!from) from = strdup(first->database);
    if (!from) {
        cn_mapped_deinit(&got);
        return cn_fail(CN_ERR_NOMEM, "out of memory");
    }
    take(best, rung, &got, from);
    return CN_OK;
}

static cn_status note_choice(const cn_colmap_task *task, const kept *best)
{
    if (!task->choice) return CN_OK;
    free(task->choice->database);
    *task->choice = (cn_colmap_choice){ best->mapped.attempt, best->rung->name, strdup(best->database) };
    return task->choice->database ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
}

static cn_status climb(const cn_colmap_task *task, cn_colmap_job *first, kept *best)
{
    CN_TRY(cn_process_end_stray(first->ctx, first->note));
    CN_TRY(cn_colmap_features(first));
    CN_TRY(cn_colmap_matches(first));
    CN_TRY(cn_pose_connected(first, &best->connected));
    for (const cn_rung *rung = RUNGS; rung < RUNGS + CN_MOST_ATTEMPTS; rung++) {
        if (best->n_attempts == task->options->attempts) break;
        /* Views of one rig share a place, about which pairs of them say nothing. */
        if (rung->at_once && (task->options->mapper == CN_MAP_INCREMENTAL || task->rig_views)) continue;
        if (best->n_attempts && is_enough(task, best, rung)) continue;
        const cn_status status = attempt(task, first, rung, best);
        if (status == CN_ERR_TOOL && best->mapped.model) {
            /* What was found is worth more than what failed after it. */
            cn_log(task->ctx, CN_LOG_WARN, "attempt %u (%s) failed: %s", best->n_attempts + 1, rung->name,
                   cn_error_message());
            break;
        }
        CN_TRY(status);
    }
    if (best->mapped.model) return note_choice(task, best);
    return cn_fail(CN_ERR_DATA,
                   "COLMAP finds no poses for these %u photos: they overlap too little, show too little texture or "
                   "were taken at one place; add photos in between (see %s)",
                   task->index->n_photos, first->log);
}

cn_status cn_colmap_alike(const cn_colmap_task *task, cn_photo_pairs *pairs)
{
    cn_colmap_job j;
    CN_TRY(job_init(&j, task, task->dir, &RUNGS[0].way));
    cn_status status = cn_process_end_stray(j.ctx, j.note);
    if (status == CN_OK) status = cn_colmap_features(&j);
    if (status == CN_OK) status = cn_photo_pairs_retrieve(&j, pairs);
    job_deinit(&j);
    return status;
}

cn_status cn_colmap_settle(const cn_colmap_task *task, cn_colmap_result *result)
{
    cn_colmap_job j;
    char *model = NULL, *own;
    CN_TRY(job_init(&j, task, task->dir, &RUNGS[0].way));
    own = j.database;
    j.database = result->database;
    const cn_status status = cn_colmap_settle_focal(&j, result->model, &model);
    j.database = own;
    job_deinit(&j);
    CN_TRY(status);
    free(result->model);
    result->model = model;
    return CN_OK;
}

void cn_colmap_result_deinit(cn_colmap_result *result)
{
    free(result->model);
    free(result->folder);
    free(result->database);
    memset(result, 0, sizeof *result);
}

cn_status cn_colmap_poses(const cn_colmap_task *task, cn_colmap_result *result)
{
    cn_colmap_job first;
    kept best = { 0 };
    memset(result, 0, sizeof *result);
    CN_TRY(job_init(&first, task, task->dir, &RUNGS[0].way));
    const cn_status status = climb(task, &first, &best);
    job_deinit(&first);
    free(best.connected);
    result->model = best.mapped.model;
    result->folder = best.mapped.folder;
    result->database = best.database;
    result->n_models = best.mapped.n_models;
    if (status != CN_OK) cn_colmap_result_deinit(result);
    return status;
}
