#include "conurb/stage.h"
#include "city/lock.h"
#include "renderer/renderer.h"
#include "stage/depth_truth.h"
#include "stage/experiment.h"

#include "base/clock.h"
#include "base/file.h"
#include "base/json.h"
#include "base/units.h"
#include "bridge/oiio.h"
#include "conurb/colour.h"

#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* dir NULL: scores only, no pictures. */
typedef struct eval_job {
    const cn_context *ctx;
    const cn_city *city;
    const cn_dataset *m;
    cn_blend blend;
    cn_renderer *renderer;
    cn_colour *colour;
    char *dir;
    bool *held; /* of each view: whether it is scored */
    uint32_t n_held;
    bool half_only; /* see cn_evaluated */
    cn_depth_truth truth;
} eval_job;

/* Converts RGBW to display RGB in place, in the first 3 * n floats; copies the weights. By Conurb's own config,
 * whatever $OCIO says: scores of one city can be compared, and the user's config may lack sRGB. */
static cn_status to_display(const cn_colour *colour, float *rgbw, size_t n, float *weight)
{
    for (size_t i = 0; weight && i < n; i++)
        weight[i] = rgbw[4 * i + 3];
    CN_TRY(cn_colour_to_display(colour, &(cn_display_transform){ .view = "sRGB" }, rgbw, n, 4));
    for (size_t i = 0; i < n; i++)
        for (size_t c = 0; c < 3; c++)
            rgbw[3 * i + c] = rgbw[4 * i + c];
    return CN_OK;
}

static cn_status side_by_side(const eval_job *j, const char *name, const float *truth, const float *test, uint32_t w,
                              uint32_t h)
{
    /* In the same folders as the photos, so that no two photos share a file. */
    char *path = cn_format("%s/%s.png", j->dir, name);
    float *out = malloc((size_t)w * h * 9 * sizeof *out);
    cn_status status = path && out ? cn_folder_of_make(path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) {
        cn_measure_side_by_side(truth, test, w, h, out);
        status = cn_oiio_write_png(path, out, 3 * w, h, 3, NULL);
    }
    free(out);
    free(path);
    return status;
}

/* Shows the picture as the photo's lens would, by the tile that it was rendered with. */
static cn_status add_vignetting(eval_job *j, const cn_view *view, const char *tile, cn_picture *picture)
{
    cn_vignetting lens;
    CN_TRY(cn_tile_cache_vignetting(&j->renderer->tiles, tile, view, &lens));
    if (cn_vignetting_is_none(&lens)) return CN_OK;
    const cn_pixel_extent size = { picture->width, picture->height };
    for (uint32_t y = 0; y < size.height; y++)
        for (uint32_t x = 0; x < size.width; x++) {
            const float factor = cn_vignetting_factor(&lens, size, x + 0.5, y + 0.5);
            for (size_t c = 0; c < 3; c++)
                picture->rgba[4 * ((size_t)y * size.width + x) + c] *= factor;
        }
    return CN_OK;
}

/* Renders the photo's view with an appearance; display-encoded, in the first 3 * n floats of picture->rgba. */
static cn_status render_appearance(eval_job *j, const cn_view *view, cn_appearance_kind kind, cn_picture *picture,
                                   char tile[CN_TILE_ID_SIZE])
{
    cn_camera camera;
    cn_camera_resize(&j->m->scene.cameras[view->camera], picture->width, picture->height, &camera);
    const cn_render_options options = cn_render_options_default();
    cn_appearance_spec spec = { .kind = kind };
    snprintf(spec.a, sizeof spec.a, "%s", view->name);
    const size_t n = (size_t)picture->width * picture->height;
    memset(picture->rgba, 0, n * 4 * sizeof *picture->rgba);
    memset(picture->depth, 0, n * sizeof *picture->depth);
    const cn_tile_cache_view shown = {
        .camera = &camera, .view = view, .options = &options, .appearance = &spec, .used = tile
    };
    CN_TRY(cn_renderer_draw(j->renderer, j->ctx, &shown, CN_RENDERER_BLEND, picture));
    CN_TRY(cn_compose_unseen(picture, j->city->config.unseen));
    CN_TRY(add_vignetting(j, view, tile, picture));
    return to_display(j->colour, picture->rgba, n, NULL);
}

/* PSNR at most, and of equal pictures, as of photos that are black all over: infinity has no mean and no number in
 * JSON. 144.5 dB is a difference in the last bit of a float of 1. */
#define EQUAL_DB 150.0

static cn_score score(const float *truth, const float *test, const float *weight, uint32_t width, uint32_t height)
{
    const double psnr = cn_measure_psnr(truth, test, weight, (size_t)width * height);
    return (cn_score){ psnr > EQUAL_DB ? EQUAL_DB : psnr, cn_measure_ssim(truth, test, weight, width, height) };
}

/* A held-out photo and its render. */
typedef struct photo_pair {
    float *truth, *weight;
    cn_picture picture;
} photo_pair;

/* Rows of a picture of all directions count by their part of the sphere (WS-PSNR; Sun, Lu and Yu 2017). */
static void weigh_directions(const eval_job *j, const cn_view *view, float *weight, uint32_t width, uint32_t height)
{
    if (j->m->scene.cameras[view->camera].lens != CN_LENS_EQUIRECTANGULAR) return;
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++)
            weight[(size_t)y * width + x] *= sinf(((float)y + 0.5f) / (float)height * (float)CN_PI);
}

/* Renders the photo in its own light, as far as that is known, and scores all of it. */
static cn_status compare_known(eval_job *j, const cn_view *view, photo_pair *pair, cn_eval_photo *result,
                               double *seconds)
{
    cn_picture *picture = &pair->picture;
    const float *truth = pair->truth, *weight = pair->weight;
    const uint32_t w = picture->width, h = picture->height;
    const size_t n = (size_t)w * h;
    cn_appearance_spec known = { .kind = CN_APPEARANCE_KNOWN };
    snprintf(known.a, sizeof known.a, "%s", view->name);
    CN_TRY(cn_tile_cache_align_known(&j->renderer->tiles, j->ctx, &known, view));
    const double started = cn_now_s();
    CN_TRY(render_appearance(j, view, CN_APPEARANCE_KNOWN, picture, result->tile));
    *seconds = cn_now_s() - started;
    result->plain = score(truth, picture->rgba, weight, w, h);
    if (j->truth.folder) CN_TRY(cn_depth_truth_add(&j->truth, &j->m->photos.photos[view->photo], picture));
    if (j->dir) CN_TRY(side_by_side(j, view->name, truth, picture->rgba, w, h));
    float *corrected = malloc(n * 3 * sizeof *corrected);
    if (!corrected) return cn_fail(CN_ERR_NOMEM, "out of memory for %s", view->name);
    cn_measure_colour_correct(truth, picture->rgba, weight, n, corrected);
    result->corrected = score(truth, corrected, weight, w, h);
    free(corrected);
    return CN_OK;
}

static cn_status compare(eval_job *j, const cn_view *view, photo_pair *pair, cn_eval_photo *result, double *seconds)
{
    cn_picture *picture = &pair->picture;
    float *truth = pair->truth, *weight = pair->weight;
    const uint32_t w = picture->width, h = picture->height;
    const size_t n = (size_t)w * h;
    CN_TRY(cn_pixel_store_read(j->m->pixels, view->photo, truth));
    CN_TRY(to_display(j->colour, truth, n, weight));
    weigh_directions(j, view, weight, w, h);
    const bool no_need = j->half_only && j->renderer->tiles.varies;
    result->plain = result->corrected = (cn_score){ NAN, NAN };
    if (!no_need) CN_TRY(compare_known(j, view, pair, result, seconds));
    for (size_t i = 0; i < n; i++)
        if (i % w < w / 2) weight[i] = 0;
    result->unfitted = no_need ? (cn_score){ NAN, NAN } : score(truth, picture->rgba, weight, w, h);
    /* When no tile has appearance, a fit changes nothing. */
    char used[CN_TILE_ID_SIZE];
    if (j->renderer->tiles.varies) CN_TRY(render_appearance(j, view, CN_APPEARANCE_FIT_LEFT, picture, used));
    result->half = score(truth, picture->rgba, weight, w, h);
    return CN_OK;
}

static cn_status eval_view(eval_job *j, const cn_view *view, cn_eval_photo *result, double *seconds)
{
    CN_TRY(cn_dataset_need_pixels(j->m));
    const cn_pixel_extent size = cn_pixel_store_extent(j->m->pixels, view->photo);
    const size_t n = (size_t)size.width * size.height;
    photo_pair pair;
    CN_TRY(cn_picture_init(&pair.picture, size.width, size.height));
    pair.truth = malloc(n * 4 * sizeof *pair.truth);
    pair.weight = malloc(n * sizeof *pair.weight);
    result->name = strdup(view->name);
    cn_status status =
        pair.truth && pair.weight && result->name ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for %s", view->name);
    if (status == CN_OK) status = compare(j, view, &pair, result, seconds);
    cn_picture_deinit(&pair.picture);
    free(pair.truth);
    free(pair.weight);
    return status;
}

/* Marks the views that any tile of the plan holds out. */
static uint32_t held_out(const cn_dataset *m, bool *held)
{
    uint32_t n = 0;
    for (uint32_t t = 0; t < m->plan.n_tiles; t++)
        for (uint32_t i = 0; i < m->plan.tiles[t].n_held_out; i++) {
            bool *h = &held[m->plan.tiles[t].held_out[i]];
            n += !*h;
            *h = true;
        }
    return n;
}

static json_t *score_json(cn_score score)
{
    return json_pack("{s:o,s:o}", "psnr", cn_json_real(score.psnr), "ssim", cn_json_real(score.ssim));
}

static cn_status save(const eval_job *j, const cn_eval *eval)
{
    json_t *photos = json_array();
    for (uint32_t i = 0; i < eval->n_photos; i++) {
        const cn_eval_photo *p = &eval->photos[i];
        json_array_append_new(photos, json_pack("{s:s,s:s,s:o,s:o,s:o,s:o,s:o}", "name", p->name, "tile", p->tile,
                                                "psnr", cn_json_real(p->plain.psnr), "ssim",
                                                cn_json_real(p->plain.ssim), "half", score_json(p->half), "unfitted",
                                                score_json(p->unfitted), "corrected", score_json(p->corrected)));
    }
    json_t *root = json_pack("{s:s,s:o,s:o,s:o,s:o,s:o,s:o}", "blend", cn_blend_name(j->blend), "psnr",
                             cn_json_real(eval->plain.psnr), "ssim", cn_json_real(eval->plain.ssim), "half",
                             score_json(eval->half), "unfitted", score_json(eval->unfitted), "corrected",
                             score_json(eval->corrected), "photos", photos);
    char *path = cn_path_join(j->dir, "eval.json");
    const cn_status status = root && path ? cn_json_save(root, path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    json_decref(root);
    free(path);
    return status;
}

/* The mean over the photos that have the figure. A photo has none where a mask hides all that is scored, and no SSIM
 * when it is smaller than SSIM's window. `figure`: the offset of a double in cn_eval_photo. */
static double mean_of(const cn_eval *eval, size_t figure)
{
    double sum = 0;
    uint32_t n = 0;
    for (uint32_t i = 0; i < eval->n_photos; i++) {
        const double x = *(const double *)((const char *)&eval->photos[i] + figure);
        if (!isfinite(x)) continue;
        sum += x;
        n++;
    }
    return n ? sum / n : NAN;
}

static cn_score mean_score(const cn_eval *eval, size_t score)
{
    return (cn_score){ mean_of(eval, score + offsetof(cn_score, psnr)),
                       mean_of(eval, score + offsetof(cn_score, ssim)) };
}

static void add_means(const cn_context *ctx, cn_eval *eval)
{
    uint32_t n_lacking = 0;
    const char *first = NULL;
    for (uint32_t i = 0; i < eval->n_photos; i++) {
        if (isfinite(eval->photos[i].plain.psnr) && isfinite(eval->photos[i].half.psnr)) continue;
        if (!n_lacking++) first = eval->photos[i].name;
    }
    if (n_lacking)
        cn_log(ctx, CN_LOG_WARN,
               "%u of %u held-out photos lack a score, %s first: their masks hide all that is scored; the means are "
               "over the others",
               n_lacking, eval->n_photos, first);
    eval->plain = mean_score(eval, offsetof(cn_eval_photo, plain));
    eval->half = mean_score(eval, offsetof(cn_eval_photo, half));
    eval->unfitted = mean_score(eval, offsetof(cn_eval_photo, unfitted));
    eval->corrected = mean_score(eval, offsetof(cn_eval_photo, corrected));
}

static int compare_doubles(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Scores the marked views, n of them. */
static cn_status score_views(eval_job *j, const char *folder, cn_eval *eval, double *seconds)
{
    const uint32_t n = j->n_held;
    const double started = cn_now_s();
    CN_TRY(cn_renderer_open(&j->renderer, j->ctx, j->city, j->m, folder));
    j->renderer->tiles.compose.scheme = j->blend;
    CN_TRY(cn_colour_create(&j->colour, ""));
    for (uint32_t v = 0; v < j->m->scene.n_views; v++) {
        if (!j->held[v]) continue;
        if (cn_stopping(j->ctx)) return cn_fail(CN_ERR_INTERRUPTED, "stopped during eval; run the same command again");
        cn_eval_photo *p = &eval->photos[eval->n_photos++];
        CN_TRY(eval_view(j, &j->m->scene.views[v], p, &seconds[eval->n_photos - 1]));
        const double done = eval->n_photos, elapsed = cn_now_s() - started;
        const cn_progress_report report = { "eval", p->name, done, n, elapsed, elapsed / done * (n - done), NULL };
        cn_progress(j->ctx, &report);
    }
    add_means(j->ctx, eval);
    qsort(seconds, eval->n_photos, sizeof *seconds, compare_doubles);
    eval->render_s = eval->n_photos ? seconds[eval->n_photos / 2] : NAN;
    return CN_OK;
}

static cn_status score_marked(eval_job *j, const char *folder, cn_eval *eval)
{
    double *seconds = calloc(j->n_held + 1u, sizeof *seconds);
    const cn_status status = seconds ? score_views(j, folder, eval, seconds) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(seconds);
    return status;
}

static cn_status make_room(cn_eval *eval, uint32_t n)
{
    eval->photos = calloc(n + 1u, sizeof *eval->photos);
    return eval->photos ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
}

cn_status cn_evaluate_tile(const cn_context *ctx, const cn_city *city, const cn_dataset *m, const cn_evaluated *of,
                           cn_eval *eval)
{
    const cn_plan_tile *tile = of->tile;
    *eval = (cn_eval){ 0 };
    eval_job j = { .ctx = ctx,
                   .city = city,
                   .m = m,
                   .blend = city->config.compose.scheme,
                   .half_only = of->half_only,
                   .truth.folder = of->truth };
    j.held = calloc(m->scene.n_views + 1u, sizeof *j.held);
    j.n_held = tile->n_held_out;
    cn_status status = j.held ? make_room(eval, tile->n_held_out) : cn_fail(CN_ERR_NOMEM, "out of memory");
    for (uint32_t i = 0; status == CN_OK && i < tile->n_held_out; i++)
        j.held[tile->held_out[i]] = true;
    if (status == CN_OK) status = score_marked(&j, of->folder, eval);
    cn_depth_truth_summary(&j.truth, &eval->depth_error_m, &eval->depth_within);
    cn_depth_truth_deinit(&j.truth);
    cn_renderer_destroy(&j.renderer);
    cn_colour_destroy(&j.colour);
    free(j.held);
    if (status != CN_OK) cn_eval_deinit(eval);
    return status;
}

/* Whether the photo is scored now. */
static bool is_scored(const eval_job *j, const char *name)
{
    for (uint32_t v = 0; v < j->m->scene.n_views; v++)
        if (j->held[v] && strcmp(j->m->scene.views[v].name, name) == 0) return true;
    return false;
}

/* Removes the pictures of photos that the last eval scored and this one does not: other tiles rendered them. */
static cn_status remove_old_pictures(const eval_job *j, const json_t *photos)
{
    size_t i;
    const json_t *photo;
    json_array_foreach(photos, i, photo)
    {
        const char *name = json_string_value(json_object_get(photo, "name"));
        if (!name || is_scored(j, name) || strstr(name, "../")) continue; /* names are below the folder of the photos */
        char *path = cn_format("%s/%s.png", j->dir, name);
        const cn_status status = path ? cn_file_remove(path) : cn_fail(CN_ERR_NOMEM, "out of memory");
        free(path);
        CN_TRY(status);
    }
    return CN_OK;
}

/* Removes what the last eval left. The record goes last, as it names the pictures, and it goes until the stage is
 * complete again: pictures may come from other tiles. */
static cn_status remove_old(const eval_job *j)
{
    json_t *root = NULL;
    char *old = cn_path_join(j->dir, "eval.json");
    if (!old) return cn_fail(CN_ERR_NOMEM, "out of memory");
    const bool there = cn_file_exists(old);
    if (there && cn_json_load(old, &root) != CN_OK) root = NULL; /* it names no pictures then */
    cn_status status = remove_old_pictures(j, json_object_get(root, "photos"));
    if (status == CN_OK && there) status = cn_file_remove(old);
    json_decref(root);
    free(old);
    return status;
}

static cn_status eval_all(eval_job *j, cn_eval *eval)
{
    CN_TRY(cn_folder_make(j->dir));
    CN_TRY(remove_old(j));
    CN_TRY(make_room(eval, j->n_held));
    CN_TRY(score_marked(j, "tiles", eval));
    return save(j, eval);
}

/* Scores the held-out photos. Only the blend of city.yaml is recorded as a stage. */
static cn_status eval_locked(eval_job *j, cn_city *city, const char *folder, bool stage_too, cn_eval *eval)
{
    cn_city_lock lock = { 0 };
    cn_stage stage;
    CN_TRY(cn_stage_eval(city, &j->m->plan, &stage));
    cn_status status = cn_city_lock_take(&lock, j->ctx, city, folder, "the held-out photos");
    const cn_context *outer = j->ctx;
    j->ctx = &lock.ctx;
    if (status == CN_OK) status = eval_all(j, eval);
    if (status == CN_OK && stage_too) status = cn_stage_finish(city, &stage);
    j->ctx = outer;
    cn_city_lock_drop(&lock);
    return status;
}

cn_status cn_city_eval(const cn_context *ctx, cn_city *city, const char *blend, cn_eval *eval)
{
    *eval = (cn_eval){ .render_s = NAN };
    cn_dataset m;
    eval_job j = { .ctx = ctx, .city = city, .m = &m, .blend = city->config.compose.scheme };
    if (blend) CN_TRY(cn_blend_parse(blend, &j.blend));
    CN_TRY(cn_dataset_load(ctx, city, true, &m));
    j.held = calloc(m.scene.n_views + 1u, sizeof *j.held);
    char *folder = blend ? cn_format("eval-%s", blend) : cn_format("eval");
    j.dir = folder ? cn_city_path(city, folder) : NULL;
    cn_status status = j.held && j.dir ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    const uint32_t n = j.n_held = status == CN_OK ? held_out(&m, j.held) : 0;
    /* Without a photo there is no score. */
    if (!n) eval->plain = eval->half = eval->unfitted = eval->corrected = (cn_score){ NAN, NAN };
    if (status == CN_OK && n == 0)
        cn_log(ctx, CN_LOG_WARN, "no photo is held out (plan.hold_out_every, or too few photos): nothing to evaluate");
    if (status == CN_OK && n == 0) status = remove_old(&j);
    if (status == CN_OK && n) status = eval_locked(&j, city, folder, !blend, eval);
    cn_renderer_destroy(&j.renderer);
    cn_colour_destroy(&j.colour);
    cn_dataset_deinit(&m);
    free(j.held);
    free(folder);
    free(j.dir);
    if (status != CN_OK) cn_eval_deinit(eval);
    return status;
}
