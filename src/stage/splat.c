#include "stage/splat.h"

#include "base/clock.h"
#include "base/file.h"
#include "conurb/measure.h"
#include "math/linalg.h"
#include "pose/lens.h"
#include "splat/packed.h"
#include "splat/splat_tiles.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

enum { MOST_SCORED = 4 }; /* held-out photos */

/* used: NULL, or the id of the tile that shows the view. */
static cn_status draw_by(const cn_city_splats *s, const cn_context *ctx, const cn_camera *camera, const cn_view *view,
                         char *used, cn_picture *picture)
{
    cn_render_options options = s->survey->render;
    const cn_tile_cache_view what = {
        .camera = camera, .view = view, .options = &options, .appearance = s->appearance, .used = used
    };
    return cn_renderer_draw(s->renderer, ctx, &what, CN_RENDERER_BLEND, picture);
}

static cn_status draw(void *user, const cn_context *ctx, const cn_camera *camera, const cn_view *view,
                      cn_picture *picture)
{
    return draw_by(user, ctx, camera, view, NULL, picture);
}

static cn_display_transform display_of(const cn_survey *survey)
{
    return (cn_display_transform){ survey->view, survey->look, survey->exposure_ev };
}

/* The views that any tile was trained on, in the scene's order. Returns how many. */
static uint32_t trained_views(const cn_survey *survey, uint32_t *views)
{
    uint32_t n = 0;
    for (uint32_t v = 0; v < survey->scene->n_views; v++) {
        bool seen = false;
        for (uint32_t t = 0; t < survey->n_tiles && !seen; t++)
            for (uint32_t i = 0; i < survey->tiles[t].n_views && !seen; i++)
                seen = survey->tiles[t].views[i] == v;
        if (seen) views[n++] = v;
    }
    return n;
}

/* Where the rays of all tiles' photos have begun. */
static double near_of(const cn_plan *plan)
{
    double near = INFINITY;
    for (uint32_t t = 0; t < plan->n_tiles; t++)
        near = fmin(near, plan->tiles[t].near_m);
    return isfinite(near) ? near : 0;
}

cn_status cn_city_splats_make(const cn_context *ctx, const cn_city_splats *city, const char *path, cn_splats **splats)
{
    const cn_survey *survey = city->survey;
    cn_city_splats mine = *city;
    cn_splat_report report;
    *splats = NULL;
    uint32_t *views = malloc((survey->scene->n_views + (size_t)1) * sizeof *views);
    if (!views) return cn_fail(CN_ERR_NOMEM, "out of memory for %u photos", survey->scene->n_views);
    const cn_splat_source source = { .scene = survey->scene,
                                     .views = views,
                                     .n_views = trained_views(survey, views),
                                     .width_px = survey->width_px,
                                     .near_m = near_of(&city->dataset->plan),
                                     .draw = draw,
                                     .user = &mine,
                                     .colour = survey->colour,
                                     .display = display_of(survey) };
    const cn_status status = cn_splats_make(ctx, &source, &city->options, path, splats, &report);
    free(views);
    CN_TRY(status);
    cn_log(
        ctx, CN_LOG_INFO,
        "splats: %zu seeds, %zu taken away for others, %u views rendered in %.0f s, %u steps in %.0f s, training PSNR "
        "%.2f dB",
        report.n_seeds, report.n_pruned, report.n_views, report.render_s, report.n_steps, report.fit_s, report.psnr);
    return CN_OK;
}

/* ---- how well they show the held-out photos' views ---- */

/* PSNR of splats and field: against each other, and against the photos. */
typedef struct scores {
    double to_field, splats_to_photo, field_to_photo;
    uint32_t n, n_photos;
} scores;

/* A held-out view, without lens distortion. */
typedef struct scored_view {
    cn_camera camera;
    const cn_view *view;
    size_t n;
    float *field, *splats, *photo, *weight;
    char tile[CN_TILE_ID_SIZE]; /* which shows it */
} scored_view;

static cn_status render_field(const cn_context *ctx, const cn_city_splats *city, scored_view *v)
{
    cn_picture picture;
    const cn_display_transform display = display_of(city->survey);
    CN_TRY(cn_picture_init(&picture, v->camera.width, v->camera.height));
    cn_status status = draw_by(city, ctx, &v->camera, v->view, v->tile, &picture);
    for (size_t i = 0; i < v->n; i++)
        for (size_t k = 0; k < 3; k++)
            v->field[3 * i + k] = picture.rgba[4 * i + k] / fmaxf(picture.rgba[4 * i + 3], 1e-6f);
    if (status == CN_OK) status = cn_colour_to_display(city->survey->colour, &display, v->field, v->n, 3);
    for (size_t i = 0; i < 3 * v->n; i++)
        v->field[i] *= fminf(picture.rgba[4 * (i / 3) + 3], 1);
    cn_picture_deinit(&picture);
    return status;
}

/* The photo at the places of a pinhole's pixels. */
static void straighten(scored_view *v, const cn_camera *from, const float *rgbw)
{
    const uint32_t width = v->camera.width;
    for (size_t i = 0; i < v->n; i++) {
        double dir[3];
        float seen[4] = { 0 };
        if (cn_camera_unproject(&v->camera, (double)(i % width) + 0.5, (double)(i / width) + 0.5, dir) == CN_OK)
            cn_camera_look_up(from, rgbw, dir, seen);
        memcpy(v->photo + 3 * i, seen, 3 * sizeof *seen);
        v->weight[i] = seen[3];
    }
}

/* The photo as the tile was trained on it: neither field nor splats have a lens. */
static cn_status remove_vignetting(const cn_city_splats *city, const scored_view *v, float *rgbw)
{
    const cn_pixel_extent size = { v->camera.width, v->camera.height };
    cn_vignetting lens;
    CN_TRY(cn_tile_cache_vignetting(&city->renderer->tiles, v->tile, v->view, &lens));
    for (uint32_t y = 0; y < size.height && !cn_vignetting_is_none(&lens); y++)
        for (uint32_t x = 0; x < size.width; x++)
            cn_vignetting_remove(&lens, size, x, y, rgbw + 4 * ((size_t)y * size.width + x));
    return CN_OK;
}

/* False with CN_OK: the photo's pixels are not there. */
static cn_status read_photo(const cn_city_splats *city, scored_view *v, bool *there)
{
    const cn_camera *full = &city->survey->scene->cameras[v->view->camera];
    cn_camera camera;
    *there = city->dataset->pixels != NULL;
    if (!*there) return CN_OK;
    cn_camera_resize(full, v->camera.width, v->camera.height, &camera);
    float *rgbw = malloc(v->n * 4 * sizeof *rgbw);
    if (!rgbw) return cn_fail(CN_ERR_NOMEM, "out of memory for %s", v->view->name);
    const cn_display_transform display = display_of(city->survey);
    cn_status status = cn_pixel_store_read(city->dataset->pixels, v->view->photo, rgbw);
    if (status == CN_OK) status = remove_vignetting(city, v, rgbw);
    if (status == CN_OK) status = cn_colour_to_display(city->survey->colour, &display, rgbw, v->n, 4);
    if (status == CN_OK) straighten(v, &camera, rgbw);
    free(rgbw);
    return status;
}

static cn_status score_view(const cn_context *ctx, const cn_city_splats *city, const cn_splats *splats, scored_view *v,
                            scores *sum)
{
    bool photo = false;
    CN_TRY(render_field(ctx, city, v));
    CN_TRY(cn_splats_render(ctx, splats, &v->camera, v->view, v->splats));
    sum->to_field += cn_measure_psnr(v->field, v->splats, NULL, v->n);
    sum->n++;
    CN_TRY(read_photo(city, v, &photo));
    if (!photo) return CN_OK;
    sum->splats_to_photo += cn_measure_psnr(v->photo, v->splats, v->weight, v->n);
    sum->field_to_photo += cn_measure_psnr(v->photo, v->field, v->weight, v->n);
    sum->n_photos++;
    return CN_OK;
}

static cn_status score(const cn_context *ctx, const cn_city_splats *city, const cn_splats *splats, uint32_t view,
                       scores *sum)
{
    const cn_view *of = &city->survey->scene->views[view];
    const cn_camera *full = &city->survey->scene->cameras[of->camera];
    const uint32_t width = city->survey->width_px;
    cn_pixel_extent size = { width, (uint32_t)fmax(3, round((double)full->height * width / full->width)) };
    if (city->dataset->pixels) size = cn_pixel_store_extent(city->dataset->pixels, of->photo);
    scored_view v = { .view = of, .n = (size_t)size.width * size.height };
    cn_camera_resize(full, size.width, size.height, &v.camera);
    v.camera = cn_splats_camera(&v.camera);
    float *const room = malloc(v.n * 10 * sizeof *room);
    if (!room) return cn_fail(CN_ERR_NOMEM, "out of memory for %s", of->name);
    v.field = room;
    v.splats = room + 3 * v.n;
    v.photo = room + 6 * v.n;
    v.weight = room + 9 * v.n;
    const cn_status status = score_view(ctx, city, splats, &v, sum);
    free(room);
    return status;
}

/* Each view once: those that a tile holds out, spread evenly when there are many. */
static cn_status score_all(const cn_context *ctx, const cn_city_splats *city, const cn_splats *splats, scores *sum)
{
    const cn_plan *plan = &city->dataset->plan;
    const uint32_t n_views = city->survey->scene->n_views;
    bool *held = calloc(n_views + (size_t)1, sizeof *held);
    uint32_t n = 0, at = 0;
    const double started = cn_now_s();
    if (!held) return cn_fail(CN_ERR_NOMEM, "out of memory for %u photos", n_views);
    for (uint32_t t = 0; t < plan->n_tiles; t++)
        for (uint32_t i = 0; i < plan->tiles[t].n_held_out; i++) {
            n += !held[plan->tiles[t].held_out[i]];
            held[plan->tiles[t].held_out[i]] = true;
        }
    cn_status status = CN_OK;
    const uint32_t wanted = n < MOST_SCORED ? n : MOST_SCORED;
    for (uint32_t v = 0; v < n_views && status == CN_OK; v++) {
        if (!held[v]) continue;
        if ((uint64_t)(at + 1) * wanted / n > (uint64_t)at * wanted / n) {
            status = score(ctx, city, splats, v, sum);
            const double elapsed = cn_now_s() - started, left = elapsed / sum->n * (wanted - sum->n);
            const cn_progress_report report = { "export", "splats: scores", sum->n, wanted, elapsed, left, NULL };
            if (status == CN_OK) cn_progress(ctx, &report);
        }
        at++;
    }
    free(held);
    return status;
}

/* ---- the file ---- */

static void list_tiles(const cn_survey *survey, char *out, size_t size)
{
    size_t used = (size_t)snprintf(out, size, "%u:", survey->n_tiles);
    for (uint32_t i = 0; i < survey->n_tiles && used + 40 < size; i++)
        used += (size_t)snprintf(out + used, size - used, " %.31s", survey->tiles[i].id ? survey->tiles[i].id : "?");
}

static void tell_scores(const cn_context *ctx, const scores *s)
{
    if (!s->n) return;
    char photos[128] = "";
    if (s->n_photos)
        snprintf(photos, sizeof photos, "; to the photos: splats %.2f dB, field %.2f dB",
                 s->splats_to_photo / s->n_photos, s->field_to_photo / s->n_photos);
    cn_log(ctx, CN_LOG_INFO, "splats: PSNR in %u held-out views to the field's renders %.2f dB%s", s->n,
           s->to_field / s->n, photos);
}

cn_status cn_city_splats_export(const cn_context *ctx, const cn_city_splats *city, const char *path)
{
    char light[640], tiles[1024];
    cn_splats *splats;
    scores sum = { 0 };
    struct stat file;
    cn_appearance_spec_describe(city->appearance, light, sizeof light);
    list_tiles(city->survey, tiles, sizeof tiles);
    const cn_splat_about about = { city->survey->frame, light, tiles };
    CN_TRY(cn_splats_check_path(path));
    CN_TRY(cn_city_splats_make(ctx, city, path, &splats));
    cn_status status = cn_splats_write(splats, &about, path);
    if (status == CN_OK && stat(path, &file) == 0)
        cn_log(ctx, CN_LOG_INFO, "%zu splats of degree %u, %.1f MB, light %s: %s", splats->n, splats->degree,
               1e-6 * (double)file.st_size, light, path);
    if (status == CN_OK) status = score_all(ctx, city, splats, &sum);
    if (status == CN_OK) tell_scores(ctx, &sum);
    cn_splats_destroy(&splats);
    return status;
}

/* Scratch files lie in the folder. */
static cn_status make_in(const cn_context *ctx, const cn_city_splats *city, const char *folder, cn_splats **splats)
{
    CN_TRY(cn_folder_make(folder));
    char *path = cn_path_join(folder, "tileset.json");
    const cn_status status =
        path ? cn_city_splats_make(ctx, city, path, splats) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(path);
    return status;
}

/* Without the sky, which is beyond all tiles: on the globe it would be a ball round the city. */
static cn_status drop_sky(const cn_survey *survey, cn_splats **splats)
{
    const cn_splats *s = *splats;
    cn_splats *kept = NULL;
    uint32_t *which = malloc((s->n + 1) * sizeof *which);
    size_t n = 0;
    if (!which) return cn_fail(CN_ERR_NOMEM, "out of memory for %zu splats", s->n);
    for (size_t i = 0; i < s->n; i++) {
        bool inside = false;
        double at[3];
        for (int k = 0; k < 3; k++)
            at[k] = s->origin[k] + (double)s->centre[i][k];
        for (uint32_t t = 0; t < survey->n_tiles && !inside; t++)
            inside = cn_distance3(at, survey->tiles[t].centre) < CN_SPLAT_FAR * survey->tiles[t].radius_m;
        if (inside) which[n++] = (uint32_t)i;
    }
    const cn_status status =
        n ? cn_splats_take(s, which, n, 1, &kept) : cn_fail(CN_ERR_DATA, "no splat lies in the reach of a tile");
    free(which);
    CN_TRY(status);
    cn_splats_destroy(splats);
    *splats = kept;
    return CN_OK;
}

cn_status cn_city_splats_tiles(const cn_context *ctx, const cn_city_splats *city, const char *from, bool compressed,
                               const char *folder)
{
    char light[640], tiles[1024];
    cn_splats *splats;
    cn_appearance_spec_describe(city->appearance, light, sizeof light);
    list_tiles(city->survey, tiles, sizeof tiles);
    const cn_splat_tiles_options options = { folder, { city->survey->frame, light, tiles }, compressed };
    CN_TRY(from ? cn_splats_read(&splats, from) : make_in(ctx, city, folder, &splats));
    cn_status status = drop_sky(city->survey, &splats);
    if (status == CN_OK) status = cn_splat_tiles_write(ctx, splats, &options);
    if (status == CN_OK) cn_log(ctx, CN_LOG_INFO, "3D Tiles: %zu splats, light %s: %s", splats->n, light, folder);
    cn_splats_destroy(&splats);
    return status;
}
