/* Runs the trainings of probes, and finds the tiles that share them. */
#include "stage/effect_probe.h"
#include "stage/experiment.h"

#include "base/clock.h"
#include "base/file.h"
#include "base/hash.h"
#include "base/json.h"
#include "record/record.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { FORMAT = 2, SAMPLES = 8192, PHOTOS_EACH = 4, VALIDATED_LEAST = 3, PHOTOS_LEAST = 8 };
/* Pixels. A short training leaves fog, in which a pixel takes long: scored at 240, probes of sacre-coeur take 64 s, of
 * which training is 11. At 80 the probe of castle's codes becomes clear, +0.4 dB, but they gain nothing at standard. */
enum { WIDTH = 240, SCORED_WIDTH = 96 };
#define FOR_TRAINING 0.67 /* fraction of a probe's time; scoring takes the rest */
/* The first steps of a training march through fog, where every sample counts: a step of a probe takes so many times as
 * long as one of the whole training. Found on castle: 585613 samples a second at step 48, 1122175 on the whole. */
#define FOG 2.0

typedef struct trials {
    const cn_context *ctx;
    const cn_city *city;
    const cn_dataset *m, *scored; /* with photos at the small widths, and the plan in the making */
    const cn_stage *plan;
    cn_validation photos;
    cn_train_options options;
    uint32_t done, total;
    double started;
} trials;

static void key_of(const trials *t, const cn_plan_tile *tile, const cn_train_options *options, char key[17])
{
    cn_stage stage;
    cn_stage_tile(t->city, t->plan, options, tile, &t->m->scene, &stage);
    uint64_t hash = cn_hash_text(cn_stage_hash(&stage), "probe %d %d %d", FORMAT, WIDTH, SCORED_WIDTH);
    for (uint32_t i = 0; i < t->photos.validate.n_held_out; i++)
        hash = cn_hash_text(hash, "%s", t->m->scene.views[t->photos.validate.held_out[i]].name);
    cn_hash_hex(hash, key);
}

static bool read_known(const char *path, cn_probe_score *score)
{
    json_t *root = NULL;
    if (!cn_file_exists(path) || cn_json_load(path, &root) != CN_OK) return false;
    const json_t *psnr = json_object_get(root, "psnr");
    const size_t n = json_array_size(psnr);
    bool good = n > 0 && n <= CN_VALIDATION_MOST;
    for (size_t i = 0; good && i < n; i++) {
        const json_t *one = json_array_get(psnr, i); /* null: a mask hides what is scored */
        good = json_is_number(one) || json_is_null(one);
        score->psnr[i] = json_is_number(one) ? json_number_value(one) : NAN;
    }
    score->n = (uint32_t)n;
    score->seconds = json_number_value(json_object_get(root, "seconds"));
    json_decref(root);
    return good;
}

static cn_status write_known(const char *path, const cn_plan_tile *tile, const cn_probe_score *score)
{
    json_t *effects = json_object();
    for (uint32_t i = 0; i < tile->n_effects; i++)
        json_object_set_new(effects, tile->effects[i].name, json_boolean(tile->effects[i].on));
    json_t *root = json_pack("{s:s,s:o,s:o,s:o}", "tile", tile->id, "effects", effects, "psnr",
                             cn_json_reals(score->psnr, (int)score->n), "seconds", cn_json_real(score->seconds));
    const cn_status status = root ? cn_json_save(root, path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    json_decref(root);
    return status;
}

/* Only the figures are kept. Remove the stamp first. */
static cn_status forget_tile(const char *dir)
{
    static const char *const files[] = {
        "DONE",         "tile.safetensors", "good.safetensors", "checkpoint.safetensors", CN_TILE_UNFINISHED,
        "metrics.json", "log.jsonl"
    };
    cn_status status = CN_OK;
    for (size_t i = 0; i < sizeof files / sizeof *files && status == CN_OK; i++) {
        char *path = cn_path_join(dir, files[i]);
        status = path ? cn_file_remove(path) : cn_fail(CN_ERR_NOMEM, "out of memory");
        free(path);
    }
    return status;
}

static cn_status measure(const trials *t, const cn_plan_tile *tile, const cn_train_options *options, const char *key,
                         cn_probe_score *score)
{
    const cn_context quiet = { .pool = t->ctx->pool, .stop = t->ctx->stop, .device = t->ctx->device };
    const cn_train_input input = { &t->m->scene, &t->m->photos, t->m->pixels, tile };
    cn_train_result result;
    cn_eval eval;
    const double started = cn_now_s();
    char *folder = cn_format("probes/%s", key), *base = folder ? cn_city_path(t->city, folder) : NULL,
         *dir = base ? cn_path_join(base, tile->id) : NULL;
    cn_status status = dir ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_train_tile(&quiet, &input, options, key, dir, &result);
    if (status == CN_OK)
        status = cn_evaluate_tile(&quiet, t->city, t->scored,
                                  &(cn_evaluated){ .tile = &t->photos.validate, .folder = folder, .half_only = true },
                                  &eval);
    if (status == CN_OK) {
        score->n = eval.n_photos;
        for (uint32_t i = 0; i < eval.n_photos; i++)
            score->psnr[i] = eval.photos[i].half.psnr;
        score->seconds = cn_now_s() - started;
        cn_eval_deinit(&eval);
        status = forget_tile(dir);
    }
    free(dir);
    free(base);
    free(folder);
    return status;
}

static cn_status run(void *user, const cn_plan_tile *tile, uint32_t round, cn_probe_score *score)
{
    trials *t = user;
    char key[17];
    cn_train_options options = t->options;
    options.seed += round;
    key_of(t, tile, &options, key);
    char *path = cn_format("%s/probes/%s.json", t->city->folder, key);
    cn_status status = path ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK && !read_known(path, score)) {
        status = measure(t, tile, &options, key, score);
        if (status == CN_OK) status = write_known(path, tile, score);
    }
    free(path);
    CN_TRY(status);
    const double elapsed = cn_now_s() - t->started, done = ++t->done;
    const double left = fmax(t->total - done, 0);
    cn_progress(t->ctx,
                &(cn_progress_report){ "probe", tile->id, done, t->total, elapsed, elapsed / done * left, NULL });
    return CN_OK;
}

/* Tiles of one kind have the same decisions, and the same effects in doubt. */
static bool same_kind(const cn_plan_tile *a, const cn_plan_tile *b)
{
    uint32_t doubts[2][CN_MAX_EFFECTS];
    const uint32_t n = cn_probe_doubtful(a, doubts[0]), m = cn_probe_doubtful(b, doubts[1]);
    uint32_t in_a = 0, in_b = 0;
    if (a->n_effects != b->n_effects || n != m) return false;
    for (uint32_t i = 0; i < n; i++) {
        in_a |= 1u << doubts[0][i];
        in_b |= 1u << doubts[1][i];
    }
    for (uint32_t i = 0; i < a->n_effects; i++)
        if (a->effects[i].on != b->effects[i].on) return false;
    return in_a == in_b;
}

static cn_train_options options_of(const cn_city *city, uint32_t steps)
{
    cn_train_options o = cn_train_options_within(&city->config.train, CN_QUALITY_PREVIEW);
    o.samples_per_step = SAMPLES;
    o.steps = steps;
    o.time_budget_s = o.stop_gain_db = 0;
    o.choose = false;
    o.validate = NULL;
    return o;
}

/* Among the tiles of one kind, the one with the most photos; and the predicted seconds of training all of them. */
static cn_plan_tile *pick(cn_plan *plan, const bool *settled, uint32_t first, double *seconds)
{
    cn_plan_tile *chosen = &plan->tiles[first];
    *seconds = 0;
    for (uint32_t i = first; i < plan->n_tiles; i++) {
        cn_plan_tile *tile = &plan->tiles[i];
        if (settled[i] || !same_kind(tile, &plan->tiles[first])) continue;
        *seconds += tile->estimate_s;
        if (tile->n_photos > chosen->n_photos) chosen = tile;
    }
    return chosen;
}

/* Both predictions use the same fixed speed, so the number of steps is the same on every machine. */
static cn_probe_budget budget_of(const cn_city *city, const cn_plan_tile *tile, double seconds, double *a_step_s)
{
    const cn_train_options one = options_of(city, 1);
    uint64_t bytes;
    cn_train_cost(&one, tile, a_step_s, &bytes);
    *a_step_s *= FOG;
    return cn_probe_budget_of(tile, FOR_TRAINING * city->config.probe_share * seconds / *a_step_s);
}

static void say(const cn_context *ctx, const cn_plan_tile *tile, const cn_probe_budget *b, double most_s, double of_s)
{
    char names[CN_MAX_EFFECTS * 26] = "";
    for (uint32_t i = 0; i < b->n_effects; i++) {
        const size_t used = strlen(names);
        snprintf(names + used, sizeof names - used, "%s%s", i ? ", " : "", tile->effects[b->effects[i]].name);
    }
    cn_log(ctx, CN_LOG_INFO, "tile %s: in doubt: %s. Probes: up to %u trainings of %u steps, about %.0f s of %.0f s",
           tile->id, names, b->trainings, b->steps, most_s, of_s);
}

static cn_status train_probes(trials *t, const cn_probe_budget *budget, cn_plan_tile *tile)
{
    const uint32_t wanted = tile->n_photos / PHOTOS_EACH;
    const uint32_t n = wanted < VALIDATED_LEAST      ? VALIDATED_LEAST
                       : wanted > CN_VALIDATION_MOST ? CN_VALIDATION_MOST
                                                     : wanted;
    CN_TRY(cn_validation_take(&t->photos, tile, n));
    t->options = options_of(t->city, budget->steps);
    t->done = 0;
    t->total = budget->trainings;
    t->started = cn_now_s();
    const cn_probe_runner runner = { run, t };
    cn_plan_tile tried = t->photos.train;
    const cn_status status = cn_probe_decide(t->ctx, &runner, budget, &tried);
    if (status == CN_OK) memcpy(tile->effects, tried.effects, sizeof tile->effects);
    cn_validation_deinit(&t->photos);
    return status;
}

/* Copies the decisions of `from` to a tile of its kind. The tile keeps its own evidence. */
static void share(const cn_city *city, const cn_plan_tile *from, cn_plan_tile *to)
{
    for (uint32_t i = 0; i < to->n_effects; i++) {
        to->effects[i].on = from->effects[i].on;
        memcpy(to->effects[i].reason, from->effects[i].reason, sizeof to->effects[i].reason);
    }
    cn_train_cost(&city->config.train, to, &to->estimate_s, &to->estimate_bytes);
}

static cn_status probe_kind(trials *t, cn_plan *plan, uint32_t first, bool *settled, bool dry_run)
{
    double seconds, a_step_s;
    cn_plan_tile *tile = pick(plan, settled, first, &seconds);
    const cn_plan_tile kind = plan->tiles[first]; /* before any decision */
    const cn_probe_budget budget = budget_of(t->city, tile, seconds, &a_step_s);
    const bool wanted = budget.n_effects && tile->n_photos >= PHOTOS_LEAST;
    if (wanted) say(t->ctx, tile, &budget, budget.trainings * budget.steps * a_step_s / FOR_TRAINING, seconds);
    if (wanted && !dry_run) CN_TRY(train_probes(t, &budget, tile));
    const cn_plan_tile decided = *tile;
    for (uint32_t i = first; i < plan->n_tiles; i++) {
        if (settled[i] || (&plan->tiles[i] != tile && !same_kind(&plan->tiles[i], &kind))) continue;
        if (wanted && !dry_run) share(t->city, &decided, &plan->tiles[i]);
        settled[i] = true;
    }
    return CN_OK;
}

static bool has_doubts(const cn_plan *plan)
{
    uint32_t effects[CN_MAX_EFFECTS];
    for (uint32_t i = 0; i < plan->n_tiles; i++)
        if (cn_probe_doubtful(&plan->tiles[i], effects)) return true;
    return false;
}

static cn_status open_photos(const cn_context *ctx, const cn_city *city, const char *name, uint32_t most, cn_dataset *m)
{
    char *folder = cn_city_path(city, "probes"), *path = folder ? cn_path_join(folder, name) : NULL;
    const uint32_t width = city->config.width_px < most ? city->config.width_px : most;
    m->pixels = NULL;
    cn_status status = path ? cn_folder_make(folder) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_pixel_store_build(ctx, &m->photos, width, path);
    if (status == CN_OK) status = cn_pixel_store_open(&m->pixels, path);
    free(path);
    free(folder);
    return status;
}

cn_status cn_probe_plan(const cn_context *ctx, const cn_city *city, const cn_dataset *dataset, cn_plan *plan,
                        bool dry_run)
{
    const cn_context none = { 0 };
    if (!(city->config.probe_share > 0) || !has_doubts(plan)) return CN_OK;
    cn_stage stage;
    cn_dataset m = *dataset, scored; /* borrowed, except the photos' pixels and the plan */
    CN_TRY(cn_stage_plan(city, &stage));
    bool *settled = calloc(plan->n_tiles, sizeof *settled);
    m.plan = *plan;
    m.pixels = NULL;
    scored = m;
    cn_status status = settled ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK && !dry_run) status = open_photos(ctx, city, "pixels.bin", WIDTH, &m);
    if (status == CN_OK && !dry_run) status = open_photos(ctx, city, "scored.bin", SCORED_WIDTH, &scored);
    trials t = { .ctx = ctx ? ctx : &none, .city = city, .m = &m, .scored = &scored, .plan = &stage };
    for (uint32_t i = 0; i < plan->n_tiles && status == CN_OK; i++)
        if (!settled[i]) status = probe_kind(&t, plan, i, settled, dry_run);
    cn_pixel_store_close(&m.pixels);
    cn_pixel_store_close(&scored.pixels);
    free(settled);
    return status;
}
