#include "train/curve.h"
#include "train/trainer.h"

#include "base/clock.h"
#include "base/file.h"
#include "base/hash.h"
#include "base/json.h"
#include "base/number.h"
#include "effect/occluders.h"

#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* A checkpoint can be continued only with the same key. */
static char *checkpoint_key(const cn_trainer *t, const char *parent_hash)
{
    const cn_train_options *o = &t->options;
    char effects[256] = "";
    for (uint32_t i = 0; i < t->effects.pack.n_on; i++) {
        const size_t used = strlen(effects);
        snprintf(effects + used, sizeof effects - used, " %s", t->effects.pack.on[i].effect->name);
    }
    char field[256], teacher[256] = "";
    cn_field_options_print(&o->field, field, sizeof field);
    if (t->distil.teacher) cn_field_options_print(&o->teacher_field, teacher, sizeof teacher);
    return cn_format("11 %s %s seed=%llu steps=%u samples=%u field=%s rate=%.9g step=%.9g good=%u photos=%u%s%s%s",
                     parent_hash ? parent_hash : "", t->kernel->name, (unsigned long long)o->seed, o->steps,
                     o->samples_per_step, field, o->learning_rate, o->march_step, o->good_every, t->sampler.n_photos,
                     effects, *teacher ? " teacher=" : "", teacher);
}

/* Files and figures of one run. */
typedef struct run {
    cn_trainer trainer;
    const char *dir, *parent_hash;
    char *key, *checkpoint, *good; /* good: the state for a rollback */
    char *unfinished;              /* the tile at the last checkpoint, for conurb view */
    FILE *log;
    double started, saved, reported;
    double warm_s;              /* when the first steps of this process were over (fit_budget) */
    uint32_t first_step, whole; /* whole: steps of the schedule, before validation cuts it */
    double error; /* error of the last steps and number of its rays; both are halved every PSNR_STEPS steps */
    uint64_t rays;
    uint64_t samples, steps;    /* since the start of this process */
    char why[CN_MONITOR_WHY];   /* why training last went back; empty: it never did */
    cn_curve curve;             /* of validation photos */
    double judged_s, judging_s; /* time of the last validation; time that all of them took */
} run;

enum { PSNR_STEPS = 64 };

static double psnr_of(const run *r)
{
    return r->rays ? -10 * log10(fmax(r->error / (3.0 * (double)r->rays), 1e-12)) : NAN;
}

static void log_line(run *r, double elapsed, double rate)
{
    const cn_trainer *t = &r->trainer;
    char psnr[32] = "null";
    const locale_t before = cn_number_begin();
    if (isfinite(psnr_of(r))) snprintf(psnr, sizeof psnr, "%.3f", psnr_of(r));
    fprintf(r->log,
            "{\"step\":%u,\"seconds\":%.2f,\"psnr\":%s,\"samples_per_s\":%.0f,\"rays_per_step\":%u,\"bad_rays\":%llu,"
            "\"skipped_steps\":%.0f,\"returns\":%.0f,\"step_over_distance\":%.5f,\"live_samples\":%llu}\n",
            t->step, elapsed, psnr, rate, t->batch.counts->kept_rays, (unsigned long long)t->bad_rays,
            t->monitor.skipped, t->monitor.rollbacks, t->sampler.pace.march_step, (unsigned long long)t->stats.live);
    cn_number_end(before);
    fflush(r->log);
}

static void report(run *r, bool last)
{
    const cn_trainer *t = &r->trainer;
    const double elapsed = cn_now_s() - r->started, done = (double)r->steps;
    const double rate = elapsed > 0 ? (double)r->samples / elapsed : 0;
    char detail[96];
    cn_print(detail, sizeof detail, "PSNR %.2f dB, %.2f M samples/s", psnr_of(r), rate / 1e6);
    /* The number of steps that fit into a budget of time is known after the probe. */
    const double steps = t->options.steps == UINT32_MAX ? 0 : t->options.steps;
    const cn_progress_report p = { "train", t->input->tile->id,
                                   t->step, steps,
                                   elapsed, done > 0 && steps > 0 ? elapsed / done * (steps - t->step) : -1,
                                   detail };
    cn_progress(t->ctx, &p);
    if (!last && cn_now_s() - r->reported < 2) return;
    r->reported = cn_now_s();
    log_line(r, elapsed, rate);
}

static cn_status save_checkpoint(run *r)
{
    const cn_trainer *t = &r->trainer;
    r->saved = cn_now_s();
    CN_TRY(cn_trainer_save_checkpoint(&r->trainer, r->key, r->checkpoint));
    /* Training goes on without it. */
    if (cn_parameters_finite(&t->parameters) && cn_trainer_save_tile(t, r->parent_hash, r->unfinished) != CN_OK)
        cn_log(t->ctx, CN_LOG_WARN, "%s", cn_error_message());
    return CN_OK;
}

/* Goes back to the last good state, or to the start, with a lower rate. Writes a checkpoint at once, so that a
 * resume never finds a good state from after a rollback beside a checkpoint from before it. */
static cn_status roll_back(run *r)
{
    cn_trainer *t = &r->trainer;
    const uint32_t from = t->step;
    const uint64_t bad_rays = t->bad_rays;
    cn_monitor monitor = t->monitor;
    cn_monitor_reset(&monitor);
    if (monitor.rollbacks++ >= CN_MONITOR_MAX_ROLLBACKS)
        return cn_fail(
            CN_ERR_DATA,
            "tile %s: training diverged %.0f times, the last time at step %u with a learning rate of %.3g: %s; "
            "lower train.learning_rate, or look at its photos and poses",
            t->input->tile->id, monitor.rollbacks, from, t->options.learning_rate * cn_monitor_rate(&t->monitor),
            r->why);
    bool there = false;
    if (cn_file_exists(r->good) && cn_trainer_load_checkpoint(t, r->key, r->good, &there) != CN_OK)
        cn_log(t->ctx, CN_LOG_WARN, "%s", cn_error_message());
    if (!there) {
        CN_TRY(cn_trainer_restart(t));
        if (t->ending) t->options.steps = r->whole;
        t->ending = false;
    }
    r->curve = (cn_curve){ 0 }; /* what diverged says nothing of what is learned from here on */
    t->bad_rays = bad_rays;
    t->monitor = monitor;
    r->error = 0;
    r->rays = 0;
    cn_log(t->ctx, CN_LOG_WARN, "tile %s diverged at step %u: %s; back to step %u with a learning rate of %.3g",
           t->input->tile->id, from, r->why, t->step, t->options.learning_rate * cn_monitor_rate(&t->monitor));
    return save_checkpoint(r);
}

static bool is_healthy(const cn_trainer *t)
{
    return cn_monitor_healthy(&t->monitor) && cn_parameters_finite(&t->parameters);
}

static cn_status one_step(run *r)
{
    cn_trainer *t = &r->trainer;
    CN_TRY(cn_trainer_step(t));
    r->steps++;
    r->error += isfinite(t->stats.squared_error) ? t->stats.squared_error : 0;
    r->rays += t->stats.rays;
    /* The interval is in steps. By the clock, a busy machine would report another PSNR for the same steps. */
    if (t->step % PSNR_STEPS == 0) {
        r->error *= 0.5;
        r->rays /= 2;
    }
    r->samples += t->stats.samples;
    if (cn_monitor_diverged(&t->monitor, r->why)) return roll_back(r);
    if (!t->options.good_every || t->step % t->options.good_every != 0) return CN_OK;
    CN_TRY(cn_device_fetch(t->ctx, &t->device.step));
    return is_healthy(t) ? cn_trainer_save_checkpoint(t, r->key, r->good) : CN_OK;
}

enum { COLD_STEPS = 16, PROBE_STEPS = 50, FIT_EVERY = 16 };
#define MOST_STEPS 1e9

/* Sets the schedule's length from the speed of the steps of this process. Its first ones are not typical: they load
 * the photos, on a device above all. Steps of an earlier process are taken to have been as quick. */
static void fit_budget(run *r, double budget_s)
{
    cn_trainer *t = &r->trainer;
    const double now = cn_now_s(), a_step = (now - r->warm_s) / (double)(r->steps - COLD_STEPS);
    const double spent = now - r->started + (double)r->first_step * a_step;
    t->options.steps = (uint32_t)fmin(fmax(t->step + 1, t->step + (budget_s - spent) / a_step), MOST_STEPS);
}

/* Writes a tile of the present state where `validate` expects it, and removes it afterwards. */
static cn_status validate_state(const run *r, double *psnr)
{
    const cn_trainer *t = &r->trainer;
    CN_TRY(cn_device_fetch(t->ctx, &t->device.step));
    char *validation = cn_path_join(r->dir, "validation"),
         *folder = validation ? cn_path_join(validation, t->input->tile->id) : NULL;
    char *tile = folder ? cn_path_join(folder, "tile.safetensors") : NULL,
         *done = folder ? cn_path_join(folder, "DONE") : NULL;
    cn_status status = tile && done ? cn_folder_make(folder) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_trainer_save_tile(t, r->parent_hash, tile);
    if (status == CN_OK) status = cn_file_write(done, r->key, strlen(r->key));
    if (status == CN_OK) status = t->options.validate(t->options.validate_user, psnr);
    if (tile && done && (unlink(tile), unlink(done), rmdir(folder) == 0)) rmdir(validation);
    free(validation);
    free(folder);
    free(tile);
    free(done);
    return status;
}

/* When the curve has flattened, the end of the schedule begins. */
static cn_status validate(run *r)
{
    cn_trainer *t = &r->trainer;
    const double at = cn_now_s();
    double psnr;
    CN_TRY(validate_state(r, &psnr));
    cn_curve_add(&r->curve, at - r->started - r->judging_s, psnr);
    r->judged_s = cn_now_s();
    r->judging_s += r->judged_s - at;
    const double gain = cn_curve_gain(&r->curve, 60);
    if (!(gain < t->options.stop_gain_db)) return CN_OK;
    t->ending = true;
    t->options.steps = (uint32_t)fmin(t->options.steps, t->step / CN_RATE_HELD + 1);
    cn_log(
        t->ctx, CN_LOG_INFO,
        "tile %s: validation photos are at %.2f dB, and one more minute is expected to gain %.3f dB: training ends at "
        "step %u",
        t->input->tile->id, psnr, gain, t->options.steps);
    return CN_OK;
}

static bool validation_is_due(const run *r)
{
    const cn_train_options *o = &r->trainer.options;
    return o->validate && o->stop_gain_db > 0 && !r->trainer.ending && cn_now_s() - r->judged_s > o->validate_every_s;
}

static cn_status loop(run *r)
{
    cn_trainer *t = &r->trainer;
    const double budget = t->options.time_budget_s;
    /* Until the probe is over, the schedule stands at its start. */
    if (budget > 0 && r->first_step == 0) t->options.steps = UINT32_MAX;
    while (t->step < t->options.steps) {
        if (cn_stopping(t->ctx)) {
            CN_TRY(save_checkpoint(r));
            return cn_fail(CN_ERR_INTERRUPTED, "tile %s stopped at step %u; run the same command to resume",
                           t->input->tile->id, t->step);
        }
        CN_TRY(one_step(r));
        if (r->steps == COLD_STEPS) r->warm_s = cn_now_s();
        if (budget > 0 && !t->ending && r->steps >= PROBE_STEPS && (r->steps - PROBE_STEPS) % FIT_EVERY == 0)
            fit_budget(r, budget);
        if (t->step % 8 == 0 && validation_is_due(r)) {
            const cn_status status = validate(r);
            if (status == CN_ERR_INTERRUPTED && cn_stopping(t->ctx)) continue; /* the checkpoint comes first */
            CN_TRY(status);
        }
        if (t->step % 8 == 0) report(r, false);
        if (cn_now_s() - r->saved > t->options.checkpoint_every_s) CN_TRY(save_checkpoint(r));
    }
    return CN_OK;
}

static cn_status write_metrics(run *r, const cn_train_result *result)
{
    const cn_monitor *monitor = &r->trainer.monitor;
    json_t *root = json_pack("{s:i,s:o,s:o,s:o,s:I,s:I,s:I,s:I}", "steps", (int)result->steps, "seconds",
                             cn_json_real(result->seconds), "samples_per_s", cn_json_real(result->samples_per_s),
                             "train_psnr", cn_json_real(result->train_psnr), "arena_bytes",
                             (json_int_t)result->arena_bytes, "bad_rays", (json_int_t)r->trainer.bad_rays,
                             "skipped_steps", (json_int_t)monitor->skipped, "returns", (json_int_t)monitor->rollbacks);
    char *path = cn_path_join(r->dir, "metrics.json");
    cn_status status =
        root && path ? cn_json_save(root, path) : cn_fail(CN_ERR_NOMEM, "out of memory while writing metrics");
    json_decref(root);
    free(path);
    return status;
}

/* A training that is shorter than the steps after which it counts as diverged ends with such a tile. */
static void warn_of_nothing(run *r)
{
    const cn_trainer *t = &r->trainer;
    if (!cn_monitor_learnt_nothing(&t->monitor, r->why)) return;
    cn_log(t->ctx, CN_LOG_WARN, "tile %s shows nothing of its photos: %s; %s", t->input->tile->id, r->why,
           t->monitor.steps > 0 ? "raise train.steps, or lower train.learning_rate"
                                : "look at its masks, its poses, and whether its photos look at it");
}

static cn_status finish(run *r, cn_train_result *result)
{
    const cn_trainer *t = &r->trainer;
    CN_TRY(cn_device_fetch(t->ctx, &t->device.step));
    if (!cn_parameters_finite(&t->parameters))
        return cn_fail(CN_ERR_DATA,
                       "tile %s: not every parameter is finite at the end of training; lower train.learning_rate",
                       t->input->tile->id);
    report(r, true);
    warn_of_nothing(r);
    const double seconds = cn_now_s() - r->started;
    *result =
        (cn_train_result){ t->step, seconds, (double)r->samples / fmax(seconds, 1e-9), psnr_of(r), t->arena.size };
    char *tile = cn_path_join(r->dir, "tile.safetensors"), *done = cn_path_join(r->dir, "DONE");
    /* DONE is about the tile beside it. So DONE of an earlier training is removed first. */
    cn_status status = tile && done ? cn_file_remove(done) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_trainer_save_tile(t, r->parent_hash, tile);
    if (status == CN_OK) status = write_metrics(r, result);
    if (status == CN_OK) status = cn_file_write(done, r->key, strlen(r->key));
    if (status == CN_OK) status = cn_file_remove(r->good);
    if (status == CN_OK) status = cn_file_remove(r->unfinished);
    if (status == CN_OK) status = cn_file_remove(r->checkpoint);
    free(tile);
    free(done);
    return status;
}

static cn_status start(run *r, const cn_context *ctx, const cn_train_input *input, const cn_train_options *options)
{
    cn_trainer *t = &r->trainer;
    cn_arena counter;
    cn_arena_count(&counter);
    t->ctx = ctx;
    CN_TRY(cn_distil_open(&t->distil, options, input->tile->id, cn_pool_threads(ctx->pool)));
    CN_TRY(cn_trainer_plan(t, input, options, cn_pool_threads(ctx->pool)));
    r->whole = t->options.steps;
    if (t->options.steps < options->steps && !(options->time_budget_s > 0))
        cn_log(
            ctx, CN_LOG_INFO,
            "tile %s: %u steps in place of %u, because it has %u photos; train.steps in city.yaml sets another number",
            input->tile->id, t->options.steps, options->steps, input->tile->n_photos);
    cn_trainer_carve(t, &counter);
    CN_TRY(cn_device_arena_init(t->ctx, &t->arena, counter.used));
    cn_trainer_carve(t, &t->arena);
    CN_TRY(cn_folder_make(r->dir));
    r->key = checkpoint_key(t, r->parent_hash);
    r->checkpoint = cn_path_join(r->dir, "checkpoint.safetensors");
    r->good = cn_path_join(r->dir, "good.safetensors");
    r->unfinished = cn_path_join(r->dir, CN_TILE_UNFINISHED);
    if (!r->key || !r->checkpoint || !r->good || !r->unfinished)
        return cn_fail(CN_ERR_NOMEM, "out of memory at the start of tile %s", input->tile->id);
    CN_TRY(cn_trainer_begin(t));
    bool resumed = false;
    if (cn_file_exists(r->checkpoint) && cn_trainer_load_checkpoint(t, r->key, r->checkpoint, &resumed) != CN_OK)
        cn_log(ctx, CN_LOG_WARN, "%s; training tile %s from the start", cn_error_message(), input->tile->id);
    if (resumed) cn_log(ctx, CN_LOG_INFO, "tile %s resumes at step %u", input->tile->id, t->step);
    char *log = cn_path_join(r->dir, "log.jsonl");
    if (log) r->log = fopen(log, resumed ? "a" : "w");
    free(log);
    if (!r->log) return cn_fail(CN_ERR_IO, "%s/log.jsonl cannot be written; is the workspace read-only?", r->dir);
    r->first_step = t->step;
    r->started = r->saved = r->reported = r->judged_s = cn_now_s();
    return CN_OK;
}

static cn_status train_on(const cn_context *ctx, const cn_train_input *input, const cn_train_options *options,
                          const char *parent_hash, const char *dir, cn_train_result *result)
{
    run *r = calloc(1, sizeof *r);
    if (!r) return cn_fail(CN_ERR_NOMEM, "out of memory at the start of tile %s", input->tile->id);
    r->dir = dir;
    r->parent_hash = parent_hash;
    cn_status status = start(r, ctx, input, options);
    if (status == CN_OK) status = loop(r);
    if (status == CN_OK) status = finish(r, result);
    if (r->log) fclose(r->log);
    cn_trainer_deinit(&r->trainer);
    free(r->key);
    free(r->checkpoint);
    free(r->good);
    free(r->unfinished);
    free(r);
    return status;
}

/* Whether the device can hold the training; else the log says what it lacks. */
static bool fits(const cn_context *ctx, const cn_train_input *input, const cn_train_options *options)
{
    const uint64_t room = cn_device_available(ctx);
    const uint64_t wanted = room == UINT64_MAX ? 0 : cn_train_device_bytes(options, input->tile);
    if (wanted <= room) return true;
    cn_log(ctx, CN_LOG_WARN, "%s has %.3f GB of memory free, and tile %s needs %.3f GB; the processor trains it",
           cn_device_about(ctx->device)->name, (double)room / 1e9, input->tile->id, (double)wanted / 1e9);
    return false;
}

/* Where the device fails, the processor goes on. */
static cn_status train(const cn_context *ctx, const cn_train_input *input, const cn_train_options *options,
                       const char *parent_hash, const char *dir, cn_train_result *result)
{
    cn_context rest = *ctx;
    rest.device = NULL;
    if (cn_device_is_lost(ctx) || !fits(ctx, input, options))
        return train_on(&rest, input, options, parent_hash, dir, result);
    const cn_status status = train_on(ctx, input, options, parent_hash, dir, result);
    if (status == CN_OK || !cn_device_gave_up(ctx, status)) return status;
    cn_log(ctx, CN_LOG_WARN, "%s; the processor trains tile %s from its last checkpoint on", cn_error_message(),
           input->tile->id);
    return train_on(&rest, input, options, parent_hash, dir, result);
}

/* ---- the teacher ---- */

/* DONE says what the tile beside it was made of; a teacher of a budget of time is whole when it is there. */
static char *teacher_key(const cn_train_options *o, const cn_train_input *input, const char *parent_hash)
{
    char field[256];
    cn_field_options_print(&o->teacher_field, field, sizeof field);
    return cn_format("1 %s seed=%llu steps=%u of %u budget=%.9g field=%s photos=%u", parent_hash ? parent_hash : "",
                     (unsigned long long)o->seed, o->teacher_steps, o->steps, o->time_budget_s, field,
                     input->tile->n_photos);
}

static bool teacher_is_there(const char *dir, const char *key)
{
    char *tile = cn_path_join(dir, "tile.safetensors"), *stamp = cn_path_join(dir, "made_with"), *text = NULL;
    size_t size = 0;
    bool there = tile && stamp && cn_file_exists(tile) && cn_file_exists(stamp) &&
                 cn_file_read(stamp, 1 << 12, &text, &size) == CN_OK && size == strlen(key) &&
                 memcmp(text, key, size) == 0;
    free(tile);
    free(stamp);
    free(text);
    return there;
}

/* Trains the teacher in DIR/teacher, unless it is there. */
static cn_status make_teacher(const cn_context *ctx, const cn_train_input *input, const cn_train_options *options,
                              const char *parent_hash, const char *dir, double *seconds)
{
    const cn_train_options of_teacher = cn_distil_teacher(options);
    char *key = teacher_key(options, input, parent_hash), *stamp = cn_path_join(dir, "made_with");
    cn_train_result result = { 0 };
    cn_status status = key && stamp ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory at the start of a teacher");
    if (status == CN_OK && !teacher_is_there(dir, key)) {
        cn_log(ctx, CN_LOG_INFO, "tile %s: its teacher, a field of type %s, is trained first", input->tile->id,
               of_teacher.field.type);
        status = train(ctx, input, &of_teacher, parent_hash, dir, &result);
        if (status == CN_OK) status = cn_file_write(stamp, key, strlen(key));
    }
    *seconds = result.seconds;
    free(key);
    free(stamp);
    return status;
}

static cn_status train_all(const cn_context *ctx, const cn_train_input *input, const cn_train_options *options,
                           const char *parent_hash, const char *dir, cn_train_result *result)
{
    if (!cn_distil_makes_teacher(options)) return train(ctx, input, options, parent_hash, dir, result);
    cn_train_options with = *options;
    char *teacher = cn_path_join(dir, "teacher"), *tile = teacher ? cn_path_join(teacher, "tile.safetensors") : NULL;
    double seconds = 0;
    cn_status status = tile ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory at the start of tile %s", input->tile->id);
    if (status == CN_OK) status = make_teacher(ctx, input, options, parent_hash, teacher, &seconds);
    with.teacher = tile;
    with.time_budget_s -= cn_distil_teacher(options).time_budget_s;
    if (status == CN_OK) status = train(ctx, input, &with, parent_hash, dir, result);
    if (status == CN_OK) result->seconds += seconds;
    free(teacher);
    free(tile);
    return status;
}

static bool has_transients(const cn_plan_tile *tile)
{
    for (uint32_t i = 0; i < tile->n_effects; i++)
        if (tile->effects[i].on && strcmp(tile->effects[i].name, "transient") == 0) return true;
    return false;
}

/* The photos with what one of them alone shows left out. *seen: the caller closes it; NULL: nothing is left out. */
static cn_status leave_out_occluders(const cn_context *ctx, const cn_train_input *input, cn_pixel_store **seen)
{
    const cn_plan_input plan = { input->scene, input->photos, NULL, input->pixels };
    const cn_plan_tile *tile = input->tile;
    cn_occluders found;
    *seen = NULL;
    CN_TRY(cn_occluders_find(&plan, tile, &found));
    cn_status status = found.n_found ? cn_pixel_store_copy(input->pixels, seen) : CN_OK;
    const char *first = NULL;
    double share = 0;
    for (uint32_t i = 0; i < tile->n_photos && *seen && status == CN_OK; i++) {
        const cn_view *view = &input->scene->views[tile->photos[i]];
        status = cn_pixel_store_hide(*seen, view->photo, found.cells[i]);
        const double hidden = cn_occluders_share(&found, i);
        if (hidden > share) first = view->name, share = hidden;
    }
    if (first)
        cn_log(
            ctx, CN_LOG_INFO,
            "tile %s: %u of %u photos show something before what the others see, most in %s (%.0f %%); it is left out "
            "like a mask",
            tile->id, found.n_found, tile->n_photos, first, 100 * share);
    cn_occluders_deinit(&found);
    if (status != CN_OK) cn_pixel_store_close(seen);
    return status;
}

cn_status cn_train_tile(const cn_context *ctx, const cn_train_input *input, const cn_train_options *options,
                        const char *parent_hash, const char *dir, cn_train_result *result)
{
    cn_train_input with = *input;
    cn_pixel_store *seen = NULL;
    /* Transients explain such things where they are on. */
    if (options->leave_out_occluders && !has_transients(input->tile) && input->scene && input->pixels)
        CN_TRY(leave_out_occluders(ctx, input, &seen));
    if (seen) with.pixels = seen;
    const cn_status status = train_all(ctx, &with, options, parent_hash, dir, result);
    cn_pixel_store_close(&seen);
    return status;
}

static cn_effect_rule effect_rules[CN_MAX_EFFECTS];

static void make_effect_rules(void)
{
    for (uint32_t i = 0; i < cn_effect_count; i++)
        effect_rules[i] = (cn_effect_rule){ .name = cn_effect_list[i]->name,
                                            .threshold = cn_effect_list[i]->threshold,
                                            .evidence = cn_effect_list[i]->evidence,
                                            .wanted = CN_AUTO,
                                            .on_unmeasured = cn_effect_list[i]->on_unmeasured };
}

const cn_effect_rule *cn_effect_rules(uint32_t *n_rules)
{
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    pthread_once(&once, make_effect_rules);
    *n_rules = cn_effect_count;
    return effect_rules;
}
