#include "job/gallery.h"

#include "base/file.h"
#include "base/json.h"
#include "bridge/oiio.h"
#include "conurb/colour.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

typedef struct eval_job { const cn_context *ctx; cn_city *city; cn_material m; cn_gallery gallery; cn_colour *colour; char *dir; } eval_job;

static double now_s(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* RGBW to display RGB in place: the first 3 * n floats; weights apart. */
static cn_status to_display(const cn_colour *colour, float *rgbw, size_t n, float *weight)
{
    for (size_t i = 0; weight && i < n; i++) weight[i] = rgbw[4 * i + 3];
    CN_TRY(cn_colour_to_display(colour, "sRGB", NULL, 0, rgbw, n, 4));
    for (size_t i = 0; i < n; i++)
        for (size_t c = 0; c < 3; c++) rgbw[3 * i + c] = rgbw[4 * i + c];
    return CN_OK;
}

static cn_status side_by_side(const eval_job *j, const char *name, const float *truth, const float *test, uint32_t w, uint32_t h)
{
    char base[256];
    snprintf(base, sizeof base, "%s", name);
    for (char *p = base; *p; p++)
        if (*p == '/') *p = '_';
    char *path = cn_format("%s/%s.png", j->dir, base);
    float *out = malloc((size_t)w * h * 9 * sizeof *out);
    cn_status status = path && out ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) {
        cn_measure_side_by_side(truth, test, w, h, out);
        status = cn_oiio_write_png(path, out, 3 * w, h, 3, NULL);
    }
    free(out);
    free(path);
    return status;
}

static cn_status compare(eval_job *j, const cn_view *view, float *truth, float *weight, cn_eval_photo *result)
{
    const cn_pixel_extent size = cn_pixel_store_extent(j->m.pixels, view->photo);
    const size_t n = (size_t)size.width * size.height;
    cn_camera camera;
    cn_camera_resize(&j->m.scene.cameras[view->camera], size.width, size.height, &camera);
    cn_render_options options = cn_render_options_default();
    options.appearance = view->name;
    cn_picture picture;
    CN_TRY(cn_picture_init(&picture, size.width, size.height));
    cn_status status = cn_gallery_view(&j->gallery, j->ctx, &camera, view, &options, &picture, result->tile);
    if (status == CN_OK) status = cn_pixel_store_read(j->m.pixels, view->photo, truth);
    if (status == CN_OK) status = to_display(j->colour, truth, n, weight);
    if (status == CN_OK) status = to_display(j->colour, picture.rgba, n, NULL);
    if (status == CN_OK) {
        result->psnr = cn_measure_psnr(truth, picture.rgba, weight, n);
        result->ssim = cn_measure_ssim(truth, picture.rgba, weight, size.width, size.height);
        status = side_by_side(j, view->name, truth, picture.rgba, size.width, size.height);
    }
    cn_picture_deinit(&picture);
    return status;
}

static cn_status eval_view(eval_job *j, const cn_view *view, cn_eval_photo *result)
{
    const cn_pixel_extent size = cn_pixel_store_extent(j->m.pixels, view->photo);
    const size_t n = (size_t)size.width * size.height;
    float *truth = malloc(n * 4 * sizeof *truth), *weight = malloc(n * sizeof *weight);
    result->name = strdup(view->name);
    cn_status status = truth && weight && result->name ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for %s", view->name);
    if (status == CN_OK) status = compare(j, view, truth, weight, result);
    free(truth);
    free(weight);
    return status;
}

/* Marks the views that any tile of the plan holds out. */
static uint32_t held_out(const cn_material *m, bool *held)
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

static cn_status save(const eval_job *j, const cn_eval *eval)
{
    json_t *photos = json_array();
    for (uint32_t i = 0; i < eval->n_photos; i++)
        json_array_append_new(photos, json_pack("{s:s,s:s,s:o,s:o}", "name", eval->photos[i].name, "tile", eval->photos[i].tile, "psnr",
                                                cn_json_real(eval->photos[i].psnr), "ssim", cn_json_real(eval->photos[i].ssim)));
    json_t *root = json_pack("{s:o,s:o,s:o}", "psnr", cn_json_real(eval->psnr), "ssim", cn_json_real(eval->ssim), "photos", photos);
    char *path = cn_path_join(j->dir, "eval.json");
    const cn_status status = root && path ? cn_json_save(root, path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    json_decref(root);
    free(path);
    return status;
}

static cn_status eval_all(eval_job *j, const bool *held, uint32_t n, cn_eval *eval)
{
    const double started = now_s();
    CN_TRY(cn_folder_make(j->dir));
    CN_TRY(cn_gallery_init(&j->gallery, j->ctx, j->city, &j->m.plan));
    CN_TRY(cn_colour_create(&j->colour, NULL));
    for (uint32_t v = 0; v < j->m.scene.n_views; v++) {
        if (!held[v]) continue;
        if (cn_stopping(j->ctx)) return cn_fail(CN_ERR_INTERRUPTED, "stopped during eval; run the same command again");
        cn_eval_photo *p = &eval->photos[eval->n_photos++];
        CN_TRY(eval_view(j, &j->m.scene.views[v], p));
        eval->psnr += p->psnr / n;
        eval->ssim += p->ssim / n;
        const double done = eval->n_photos, elapsed = now_s() - started;
        const cn_progress_report report = {"eval", p->name, done, n, elapsed, elapsed / done * (n - done), NULL};
        cn_progress(j->ctx, &report);
    }
    return save(j, eval);
}

cn_status cn_city_eval(const cn_context *ctx, cn_city *city, cn_eval *eval)
{
    *eval = (cn_eval){0};
    eval_job j = {.ctx = ctx, .city = city};
    CN_TRY(cn_material_load(ctx, city, true, &j.m));
    bool *held = calloc(j.m.scene.n_views + 1u, sizeof *held);
    j.dir = cn_city_path(city, "eval");
    cn_status status = held && j.dir ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    const uint32_t n = status == CN_OK ? held_out(&j.m, held) : 0;
    if (status == CN_OK && n == 0) cn_log(ctx, CN_LOG_WARN, "no photo is held out (plan.hold_out_every, or too few photos): nothing to evaluate");
    if (status == CN_OK && n) {
        eval->photos = calloc(n, sizeof *eval->photos);
        status = eval->photos ? eval_all(&j, held, n, eval) : cn_fail(CN_ERR_NOMEM, "out of memory");
    }
    cn_gallery_deinit(&j.gallery);
    cn_colour_destroy(&j.colour);
    cn_material_deinit(&j.m);
    free(held);
    free(j.dir);
    if (status != CN_OK) cn_eval_deinit(eval);
    return status;
}
