#include "stage/experiment.h"

#include "base/clock.h"
#include "base/file.h"
#include "record/record.h"
#include "base/hash.h"
#include "base/json.h"
#include "base/schedule.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

/* The values that the experiment's figures depend on. */
static cn_status key_of(const cn_city *city, const cn_dataset *m, const cn_experiment *experiment, char key[17])
{
    cn_stage plan, stage;
    CN_TRY(cn_stage_plan(city, &plan));
    cn_stage_tile(city, &plan, &experiment->options, experiment->tile, &m->scene, &stage);
    uint64_t hash = cn_stage_hash(&stage);
    if (experiment->width_px) hash = cn_hash_text(hash, "width_px=%u", experiment->width_px);
    for (uint32_t i = 0; i < experiment->tile->n_effects; i++)
        hash = cn_hash_text(hash, "%s=%d", experiment->tile->effects[i].name, experiment->tile->effects[i].on);
    cn_hash_hex(hash, key);
    return CN_OK;
}

static bool read_score(const json_t *root, const char *key, cn_score *score)
{
    const json_t *o = json_object_get(root, key), *psnr = json_object_get(o, "psnr"),
                 *ssim = json_object_get(o, "ssim");
    score->psnr = json_number_value(psnr);
    score->ssim = json_number_value(ssim);
    return json_is_number(psnr) && json_is_number(ssim);
}

static double number_or_nan(const json_t *root, const char *key)
{
    const json_t *value = json_object_get(root, key);
    return json_is_number(value) ? json_number_value(value) : NAN;
}

static bool read_known(const char *path, const char *key, cn_experiment *experiment)
{
    json_t *root = NULL;
    if (!cn_file_exists(path) || cn_json_load(path, &root) != CN_OK) return false;
    const char *made_with = json_string_value(json_object_get(root, "key"));
    const bool good = made_with && strcmp(made_with, key) == 0 && read_score(root, "plain", &experiment->plain) &&
                      read_score(root, "half", &experiment->half);
    experiment->train_s = json_number_value(json_object_get(root, "train_seconds"));
    experiment->render_s = json_number_value(json_object_get(root, "render_seconds"));
    experiment->bytes = (uint64_t)json_integer_value(json_object_get(root, "bytes"));
    experiment->disk = (uint64_t)json_integer_value(json_object_get(root, "disk_bytes"));
    experiment->depth_error_m = number_or_nan(root, "depth_error_m");
    experiment->depth_within = number_or_nan(root, "depth_within");
    experiment->train_psnr = number_or_nan(root, "train_psnr");
    json_decref(root);
    return good && (!experiment->truth || isfinite(experiment->depth_within));
}

static json_t *score_json(cn_score s)
{
    return json_pack("{s:o,s:o}", "psnr", cn_json_real(s.psnr), "ssim", cn_json_real(s.ssim));
}

static cn_status write_known(const char *path, const char *key, const cn_experiment *experiment)
{
    json_t *root = json_pack("{s:s,s:s,s:o,s:o,s:I,s:I,s:o,s:o,s:o,s:o,s:o}", "name", experiment->name, "key", key,
                             "train_seconds", cn_json_real(experiment->train_s), "render_seconds",
                             cn_json_real(experiment->render_s), "bytes", (json_int_t)experiment->bytes, "disk_bytes",
                             (json_int_t)experiment->disk, "depth_error_m", cn_json_real(experiment->depth_error_m),
                             "depth_within", cn_json_real(experiment->depth_within), "train_psnr",
                             cn_json_real(experiment->train_psnr), "plain", score_json(experiment->plain), "half",
                             score_json(experiment->half));
    const cn_status status = root ? cn_json_save(root, path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    json_decref(root);
    return status;
}

/* An experiment that was stopped starts over, because the time of a resumed one would be wrong. */
static cn_status forget_half(const char *dir)
{
    static const char *const files[] = { "checkpoint.safetensors", CN_TILE_UNFINISHED };
    cn_status status = CN_OK;
    for (size_t i = 0; i < sizeof files / sizeof *files && status == CN_OK; i++) {
        char *path = cn_path_join(dir, files[i]);
        status = path ? cn_file_remove(path) : cn_fail(CN_ERR_NOMEM, "out of memory");
        free(path);
    }
    return status;
}

/* A second pixel store at the experiment's width; removed after training. */
static cn_status train(const cn_context *ctx, const cn_dataset *m, const char *key, const char *dir,
                       const cn_experiment *experiment, cn_train_result *result)
{
    cn_train_input input = { &m->scene, &m->photos, m->pixels, experiment->tile };
    if (!experiment->width_px) return cn_train_tile(ctx, &input, &experiment->options, key, dir, result);
    char *path = cn_path_join(dir, "pixels.bin");
    cn_pixel_store *narrow = NULL;
    cn_status status = path ? cn_folder_make(dir) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_pixel_store_build(ctx, &m->photos, experiment->width_px, path);
    if (status == CN_OK) status = cn_pixel_store_open(&narrow, path);
    input.pixels = narrow;
    if (status == CN_OK) status = cn_train_tile(ctx, &input, &experiment->options, key, dir, result);
    cn_pixel_store_close(&narrow);
    if (status == CN_OK) status = cn_file_remove(path);
    free(path);
    return status;
}

/* Where an experiment's files are. */
typedef struct files {
    char key[17]; /* of its settings and photos */
    char *folder; /* of its tiles, within the city */
    char *dir;    /* of its tile */
} files;

/* Bytes of the tile's file; 0 when it cannot be read. */
static uint64_t tile_bytes(const char *dir)
{
    struct stat st;
    char *path = cn_path_join(dir, "tile.safetensors");
    const uint64_t bytes = path && stat(path, &st) == 0 ? (uint64_t)st.st_size : 0;
    free(path);
    return bytes;
}

static cn_status measure(const cn_context *ctx, const cn_city *city, const cn_dataset *m, const files *at,
                         cn_experiment *experiment)
{
    CN_TRY(cn_dataset_need_pixels(m));
    CN_TRY(forget_half(at->dir));
    cn_train_result result;
    cn_eval eval;
    const cn_schedule before = cn_schedule_now();
    CN_TRY(train(ctx, m, at->key, at->dir, experiment, &result));
    const cn_schedule between = cn_schedule_now();
    const double started = cn_now_s();
    CN_TRY(cn_evaluate_tile(
        ctx, city, m, &(cn_evaluated){ .tile = experiment->tile, .folder = at->folder, .truth = experiment->truth },
        &eval));
    const double took = cn_now_s() - started;
    const unsigned threads = cn_pool_threads(ctx ? ctx->pool : NULL);
    experiment->train_s = cn_schedule_alone(before, between, threads, result.seconds);
    experiment->bytes = result.arena_bytes;
    experiment->train_psnr = result.train_psnr;
    /* On a busy machine wall-clock times are only comparable with each other. */
    experiment->render_s = eval.render_s * cn_schedule_alone(between, cn_schedule_now(), threads, took) / took;
    experiment->plain = eval.plain;
    experiment->half = eval.half;
    experiment->depth_error_m = eval.depth_error_m;
    experiment->depth_within = eval.depth_within;
    experiment->disk = tile_bytes(at->dir);
    cn_eval_deinit(&eval);
    return CN_OK;
}

cn_status cn_experiment_run(const cn_context *ctx, const cn_city *city, const cn_dataset *m, cn_experiment *experiment)
{
    files at;
    CN_TRY(key_of(city, m, experiment, at.key));
    at.folder = cn_format("tradeoff/%s", experiment->name);
    char *base = at.folder ? cn_city_path(city, at.folder) : NULL;
    char *known = base ? cn_path_join(base, "trial.json") : NULL;
    at.dir = base ? cn_path_join(base, experiment->tile->id) : NULL;
    cn_status status = at.dir && known ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK && !read_known(known, at.key, experiment)) {
        status = measure(ctx, city, m, &at, experiment);
        if (status == CN_OK) status = write_known(known, at.key, experiment);
    }
    free(known);
    free(at.dir);
    free(base);
    free(at.folder);
    return status;
}
