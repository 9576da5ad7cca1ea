#include "conurb/stage.h"
#include "stage/choice.h"
#include "city/lock.h"
#include "stage/device.h"
#include "stage/experiment.h"
#include "stage/validation.h"
#include "city/workspace.h"

#include "base/file.h"
#include "base/hash.h"
#include "base/json.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* Scores a tile in training on its validation photos. */
typedef struct validation_job {
    cn_context ctx;
    const cn_city *city;
    const cn_dataset *m;
    const cn_plan_tile *tile;
} validation_job;

static cn_status validate_tile(void *user, double *psnr)
{
    const validation_job *j = user;
    char folder[64];
    cn_eval eval;
    snprintf(folder, sizeof folder, "tiles/%s/validation", j->tile->id);
    CN_TRY(cn_evaluate_tile(&j->ctx, j->city, j->m, &(cn_evaluated){ .tile = j->tile, .folder = folder }, &eval));
    *psnr = eval.half.psnr;
    cn_eval_deinit(&eval);
    return CN_OK;
}

/* The training of one tile. */
typedef struct training {
    const cn_city *city;
    const cn_dataset *dataset;
    const cn_plan_tile *tile;
    char parent[17]; /* the stage's hash; a checkpoint of another one is not continued */
    char *dir;       /* of the tile */
} training;

/* Trains a tile, with early stopping by validation photos if the options ask for it. */
static cn_status train_and_validate(const cn_context *ctx, const training *t, cn_train_options *options,
                                    cn_train_result *result)
{
    const cn_dataset *m = t->dataset;
    cn_train_input input = { &m->scene, &m->photos, m->pixels, t->tile };
    if (!(options->stop_gain_db > 0)) return cn_train_tile(ctx, &input, options, t->parent, t->dir, result);
    cn_validation validation;
    CN_TRY(cn_validation_init(&validation, t->tile));
    validation_job validate = {
        .ctx = { .pool = ctx->pool, .stop = ctx->stop }, .city = t->city, .m = m, .tile = &validation.validate
    };
    input.tile = &validation.train;
    if (validation.validate.n_held_out)
        options->validate = validate_tile;
    else
        cn_log(ctx, CN_LOG_WARN,
               "tile %s has %u photos, too few to keep some for train.stop_gain_db: it trains to the end", t->tile->id,
               t->tile->n_photos);
    options->validate_user = &validate;
    const cn_status status = cn_train_tile(ctx, &input, options, t->parent, t->dir, result);
    cn_validation_deinit(&validation);
    return status;
}

static cn_status train_alone(const cn_context *ctx, const cn_city *city, const cn_dataset *m, const cn_plan_tile *tile,
                             const cn_train_options *request, const cn_stage *stage)
{
    training t = { .city = city, .dataset = m, .tile = tile };
    cn_train_options options;
    CN_TRY(cn_dataset_need_pixels(m));
    CN_TRY(cn_choice_make(ctx, city, request, tile, stage, &options));
    cn_hash_hex(cn_stage_hash(stage), t.parent);
    char *tiles = cn_city_path(city, "tiles");
    t.dir = tiles ? cn_path_join(tiles, tile->id) : NULL;
    cn_train_result result;
    cn_status status = t.dir ? train_and_validate(ctx, &t, &options, &result) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_stage_finish(city, stage);
    if (status == CN_OK)
        cn_log(ctx, CN_LOG_INFO, "tile %s: %u steps in %.0f s, %.2f M samples/s, training PSNR %.2f dB, %.0f MB",
               tile->id, result.steps, result.seconds, result.samples_per_s / 1e6, result.train_psnr,
               (double)result.arena_bytes / 1e6);
    free(tiles);
    free(t.dir);
    return status;
}

/* Keeps the reason of a failure for `conurb status`, until the tile is tried again. */
static void record_failure(const cn_city *city, const char *id, cn_status status, const char *why)
{
    char *path = cn_format("%s/tiles/%s/error.json", city->folder, id);
    json_t *root = json_pack("{s:s,s:i,s:s}", "message", why, "status", (int)status, "conurb", cn_version());
    /* On a full disk this may fail too; the caller has the message. */
    if (path && root) (void)!cn_json_save(root, path);
    json_decref(root);
    free(path);
}

/* A run may have been killed after it wrote the tile, before the record or the clean-up. */
static cn_status tidy(const cn_city *city, const cn_stage *stage, const char *folder)
{
    static const char *const left[] = { "checkpoint.safetensors", CN_TILE_UNFINISHED };
    cn_city_lock_tidy(city, folder);
    for (size_t i = 0; i < sizeof left / sizeof *left; i++) {
        char *path = cn_format("%s/%s/%s", city->folder, folder, left[i]);
        if (path && cn_file_exists(path)) (void)!unlink(path);
        free(path);
    }
    return cn_stage_recorded(city, stage) ? CN_OK : cn_stage_finish(city, stage);
}

static cn_status train_one(const cn_context *ctx, const cn_city *city, const cn_dataset *m, const cn_plan_tile *tile,
                           const cn_train_options *options, const cn_stage *stage)
{
    char folder[64], what[64];
    cn_city_lock lock;
    snprintf(folder, sizeof folder, "tiles/%s", tile->id);
    if (cn_stage_done(city, stage, NULL)) {
        cn_log(ctx, CN_LOG_INFO, "tile %s is done", tile->id);
        return tidy(city, stage, folder);
    }
    snprintf(what, sizeof what, "tile %s", tile->id);
    CN_TRY(cn_city_lock_take(&lock, ctx, city, folder, what));
    char *error = cn_format("%s/tiles/%s/error.json", city->folder, tile->id);
    cn_status status = error ? cn_file_remove(error) : cn_fail(CN_ERR_NOMEM, "out of memory");
    /* Another process may have trained it in between. */
    if (status == CN_OK && !cn_stage_done(city, stage, NULL))
        status = train_alone(&lock.ctx, city, m, tile, options, stage);
    if (status != CN_OK && status != CN_ERR_INTERRUPTED) record_failure(city, tile->id, status, cn_error_message());
    cn_city_lock_drop(&lock);
    free(error);
    return status;
}

/* The failures of some tiles, while the others were trained. Each was logged when it came; the last line has the reason
 * of one, and the names of a few others. */
typedef struct failures {
    cn_status first;
    const char *id; /* of the tile whose reason it is */
    uint32_t n;
    char why[500], others[150];
} failures;

static void note_other(failures *f, const char *id)
{
    enum { FEW = 3 };
    const size_t used = strlen(f->others);
    const uint32_t n = f->n - 1;
    if (n <= FEW) snprintf(f->others + used, sizeof f->others - used, "%s %s", n == 1 ? "; also" : ",", id);
    if (n == FEW + 1) snprintf(f->others + used, sizeof f->others - used, ", ...");
}

static void note_failure(failures *f, const cn_city *city, const char *id, cn_status status)
{
    const char *why = cn_error_message();
    /* A tile that another process trains is no failure, and gives way to a real one. */
    const bool first = !f->n || (f->first == CN_ERR_LOCKED && status != CN_ERR_LOCKED);
    f->n++;
    if (f->n > 1) note_other(f, first ? f->id : id);
    if (!first) return;
    f->first = status;
    f->id = id;
    if (status == CN_ERR_LOCKED)
        snprintf(f->why, sizeof f->why, "%s: %s", id, why);
    else
        snprintf(f->why, sizeof f->why, "%s: %s (its log: %s/tiles/%s/log.jsonl)", id, why, city->folder, id);
}

/* The tiles of a city in training; with several devices, several at the same time. */
typedef struct tiles {
    const cn_city *city;
    const cn_dataset *m;
    const cn_train_options *options;
    cn_stage plan;
    failures failed;
    pthread_mutex_t lock; /* of the failures */
} tiles;

static cn_status train_next(void *user, const cn_context *ctx, uint32_t i)
{
    tiles *t = user;
    const cn_plan_tile *tile = &t->m->plan.tiles[i];
    cn_stage stage;
    cn_stage_tile(t->city, &t->plan, t->options, tile, &t->m->scene, &stage);
    const cn_status status = train_one(ctx, t->city, t->m, tile, t->options, &stage);
    if (status == CN_OK || status == CN_ERR_INTERRUPTED) return status;
    cn_log(ctx, CN_LOG_ERROR, "tile %s: %s", tile->id, cn_error_message());
    pthread_mutex_lock(&t->lock);
    note_failure(&t->failed, t->city, tile->id, status);
    pthread_mutex_unlock(&t->lock);
    return CN_OK; /* the others go on */
}

static cn_status train_all(const cn_context *ctx, const cn_city *city, const cn_dataset *m,
                           const cn_train_options *options)
{
    tiles t = { .city = city, .m = m, .options = options, .lock = PTHREAD_MUTEX_INITIALIZER };
    CN_TRY(cn_stage_plan(city, &t.plan));
    CN_TRY(cn_devices_run(ctx, m->plan.n_tiles, train_next, &t));
    if (!t.failed.n) return CN_OK;
    return cn_fail(t.failed.first, "%u of %u tiles not trained; %s%s", t.failed.n, m->plan.n_tiles, t.failed.why,
                   t.failed.others);
}

static cn_status train_only(const cn_context *ctx, const cn_city *city, const cn_dataset *m, const char *id,
                            const cn_train_options *options)
{
    const int64_t i = cn_plan_find(&m->plan, id);
    cn_stage plan, stage;
    if (i < 0) return cn_fail(CN_ERR_USAGE, "the plan has no tile '%s'; see %s/plan/plan.json", id, city->folder);
    CN_TRY(cn_stage_plan(city, &plan));
    cn_stage_tile(city, &plan, options, &m->plan.tiles[i], &m->scene, &stage);
    return train_one(ctx, city, m, &m->plan.tiles[i], options, &stage);
}

/* The plan decides which effects a tile has, so a change of city.yaml may need a new plan. */
static cn_status warn_of_old_plan(const cn_context *ctx, const cn_city *city)
{
    cn_stage plan;
    char reason[CN_REASON_SIZE];
    CN_TRY(cn_stage_plan(city, &plan));
    if (!cn_stage_done(city, &plan, reason))
        cn_log(ctx, CN_LOG_WARN,
               "the plan is older than city.yaml (%s); tiles are trained as it says; to plan anew, run "
               "conurb plan %s",
               reason, city->folder);
    return CN_OK;
}

/* Else tiles would be trained on the old pixels, and count as trained on the new ones. */
static cn_status check_pixels(const cn_dataset *m)
{
    bool current;
    if (!m->pixels) return CN_OK; /* said where they are needed */
    CN_TRY(cn_dataset_pixels_current(m, &current));
    if (current) return CN_OK;
    return cn_fail(CN_ERR_DATA,
                   "%s/pixels.bin is not of the photos, masks and maps as they are now, at the width in city.yaml; run "
                   "`conurb plan %s`, then train again",
                   m->city->folder, m->city->folder);
}

static cn_status train_city(const cn_context *ctx, cn_city *city, const char *tile, int quality, double time_budget_s)
{
    cn_dataset m;
    CN_TRY(cn_dataset_load(ctx, city, true, &m));
    const cn_train_options options = cn_config_train(&city->config, quality, time_budget_s);
    cn_status status = check_pixels(&m);
    if (status == CN_OK) status = warn_of_old_plan(ctx, city);
    if (status == CN_OK) status = tile ? train_only(ctx, city, &m, tile, &options) : train_all(ctx, city, &m, &options);
    cn_dataset_deinit(&m);
    return status;
}

cn_status cn_city_train(const cn_context *ctx, cn_city *city, const char *tile, int quality, double time_budget_s)
{
    cn_context own = *ctx;
    cn_device *device;
    CN_TRY(cn_stage_device(ctx, city, &device));
    if (device) own.device = device;
    const cn_status status = train_city(&own, city, tile, quality, time_budget_s);
    cn_device_destroy(&device);
    return status;
}
