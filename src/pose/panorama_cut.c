/* Cuts photos of all directions into views of pinhole cameras. */
#include "base/clock.h"
#include "base/file.h"
#include "base/hash.h"
#include "base/units.h"
#include "bridge/oiio.h"
#include "math/linalg.h"
#include "pose/lens.h"
#include "pose/panorama.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { SMALLEST_PX = 64 };

bool cn_panoramas_exist(const cn_photo_index *index)
{
    for (uint32_t i = 0; i < index->n_photos; i++)
        if (index->photos[i].equirectangular) return true;
    return false;
}

/* 90 degrees wide, with a pixel in the middle as large as one of the photo's horizon. */
cn_camera cn_panorama_view_camera(uint32_t width)
{
    uint32_t side = (uint32_t)round(width / CN_PI);
    if (side < SMALLEST_PX) side = SMALLEST_PX;
    return (cn_camera){
        .lens = CN_LENS_SIMPLE_PINHOLE, .width = side, .height = side, .params = { 0.5 * side, 0.5 * side, 0.5 * side }
    };
}

void cn_panorama_view_rotation(unsigned k, double rotation[9])
{
    const double turn = 2.0 * CN_PI * k / CN_PANORAMA_VIEWS, c = cos(turn), s = sin(turn);
    const double rows[9] = { c, 0, -s, 0, 1, 0, s, 0, c };
    memcpy(rotation, rows, sizeof rows);
}

/* ---- the list ---- */

void cn_panorama_cut_deinit(cn_panorama_cut *cut)
{
    cn_photo_index_deinit(&cut->index);
    free(cut->photo);
    free(cut->view);
    *cut = (cn_panorama_cut){ 0 };
}

/* The name has the photo's hash, so that a view of other bytes is never taken for it. */
static cn_status add(cn_panorama_cut *cut, const cn_photo_index *from, uint32_t photo, uint8_t view)
{
    const cn_photo *p = &from->photos[photo];
    cn_photo *out = &cut->index.photos[cut->index.n_photos];
    const char *dot = strrchr(cn_path_base(p->name), '.');
    cut->photo[cut->index.n_photos] = photo;
    cut->view[cut->index.n_photos++] = view;
    *out = *p;
    out->mask = out->depth = out->normal = NULL;
    if (view == CN_PANORAMA_WHOLE) {
        out->name = cn_format("%08u%s", photo, dot && !strpbrk(dot, " \t\r\n\v\f") ? dot : ".jpg");
        out->camera = strdup(p->camera ? p->camera : "");
    } else {
        const cn_camera camera = cn_panorama_view_camera(p->width);
        out->name = cn_format("%08u-%u-%08x.jpg", photo, view, (unsigned)(p->hash & 0xffffffffu));
        out->camera = strdup("view of a 360 degree photo");
        out->width = camera.width;
        out->height = camera.height;
        out->focal_px = camera.params[0];
        out->focal_mm = out->focal_35mm = NAN;
        out->orientation = 1;
        out->equirectangular = false;
        out->hash = cn_hash64((const uint64_t[2]){ p->hash, view }, 2 * sizeof(uint64_t));
    }
    cut->index.n_gps += out->has_gps;
    return out->name && out->camera ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the views of %s", p->name);
}

static cn_status list_all(const cn_photo_index *from, cn_panorama_cut *cut)
{
    for (uint32_t i = 0; i < from->n_photos; i++) {
        const bool cut_it = from->photos[i].equirectangular;
        cut->n_panoramas += cut_it;
        for (uint8_t k = 0; k < (cut_it ? CN_PANORAMA_VIEWS : 1); k++)
            CN_TRY(add(cut, from, i, cut_it ? k : CN_PANORAMA_WHOLE));
    }
    return CN_OK;
}

/* ---- the pictures ---- */

typedef struct picture {
    float *rgba;
    uint32_t width, height;
    bool is_float; /* linear */
} picture;

/* Across the left and right edge, but not across the poles. */
static void look(const picture *p, double x, double y, float rgb[3])
{
    const double fx = x - 0.5, fy = fmin(fmax(y - 0.5, 0.0), p->height - 1.0);
    const int64_t x0 = (int64_t)floor(fx), w = p->width;
    const uint32_t y0 = (uint32_t)fy, y1 = y0 + 1 < p->height ? y0 + 1 : y0;
    const uint32_t xs[2] = { (uint32_t)(((x0 % w) + w) % w), (uint32_t)((((x0 + 1) % w) + w) % w) }, ys[2] = { y0, y1 };
    const float u = (float)(fx - floor(fx)), v = (float)(fy - y0);
    memset(rgb, 0, 3 * sizeof *rgb);
    for (int k = 0; k < 4; k++) {
        const float *at = p->rgba + 4 * ((size_t)ys[k / 2] * p->width + xs[k % 2]);
        const float weight = (k % 2 ? u : 1 - u) * (k / 2 ? v : 1 - v);
        for (int c = 0; c < 3; c++)
            rgb[c] += weight * at[c];
    }
}

/* COLMAP reads light as screens show it. */
static float shown(const picture *p, float value)
{
    const float x = fminf(fmaxf(value, 0), 1);
    return p->is_float ? powf(x, 1 / 2.2f) : x;
}

static cn_status write_view(const picture *p, unsigned k, const char *path)
{
    const cn_camera camera = cn_panorama_view_camera(p->width), whole = cn_camera_equirectangular(p->width, p->height);
    const size_t n = (size_t)camera.width * camera.height;
    double turn[9];
    float *rgb = malloc(3 * n * sizeof *rgb);
    if (!rgb) return cn_fail(CN_ERR_NOMEM, "out of memory for %s", path);
    cn_panorama_view_rotation(k, turn);
    for (size_t i = 0; i < n; i++) {
        double in_view[3], dir[3], xy[2];
        if (cn_camera_unproject(&camera, (double)(i % camera.width) + 0.5, (double)(i / camera.width) + 0.5, in_view) !=
            CN_OK)
            continue; /* a pinhole has a ray for every pixel */
        cn_mat3_tvec(turn, in_view, dir);
        (void)cn_camera_project(&whole, dir, xy);
        look(p, xy[0], xy[1], rgb + 3 * i);
        for (int c = 0; c < 3; c++)
            rgb[3 * i + (size_t)c] = shown(p, rgb[3 * i + (size_t)c]);
    }
    const cn_status status = cn_oiio_write_jpeg(path, rgb, camera.width, camera.height, NULL);
    free(rgb);
    return status;
}

typedef struct cutting {
    const cn_photo_index *from;
    const cn_panorama_cut *cut;
    uint32_t *first; /* of each photo: its first entry of the cut */
    uint32_t base;   /* of the chunk that is being cut */
    cn_status *status;
    char (*message)[512];
} cutting;

static cn_status make_link(const cutting *c, uint32_t photo, const char *path)
{
    char *target = cn_path_join(c->from->folder, c->from->photos[photo].name);
    cn_status status = target ? cn_file_remove(path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK && symlink(target, path) != 0)
        status = cn_fail(CN_ERR_IO, "%s: cannot make a link: %s", path, strerror(errno));
    free(target);
    return status;
}

static cn_status cut_views(const cutting *c, uint32_t photo, char *const *paths)
{
    picture p = { 0 };
    cn_oiio_info info;
    char *path = cn_path_join(c->from->folder, c->from->photos[photo].name);
    cn_status status = path ? cn_oiio_read_info(path, &info) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_oiio_read_rgba(path, &p.rgba, &p.width, &p.height);
    if (status == CN_OK) p.is_float = info.is_float;
    for (unsigned k = 0; k < CN_PANORAMA_VIEWS && status == CN_OK; k++)
        status = write_view(&p, k, paths[k]);
    free(p.rgba);
    free(path);
    return status;
}

static cn_status cut_photo(const cutting *c, uint32_t photo)
{
    char *paths[CN_PANORAMA_VIEWS] = { NULL };
    const bool whole = c->cut->view[c->first[photo]] == CN_PANORAMA_WHOLE;
    const unsigned n = whole ? 1 : CN_PANORAMA_VIEWS;
    bool room = true, there = true;
    for (unsigned k = 0; k < n; k++) {
        paths[k] = cn_path_join(c->cut->index.folder, c->cut->index.photos[c->first[photo] + k].name);
        room = room && paths[k];
        there = there && paths[k] && cn_file_exists(paths[k]);
    }
    cn_status status = CN_OK;
    if (!room)
        status = cn_fail(CN_ERR_NOMEM, "out of memory");
    else if (whole)
        status = make_link(c, photo, paths[0]);
    else if (!there)
        status = cut_views(c, photo, paths);
    for (unsigned k = 0; k < n; k++)
        free(paths[k]);
    return status;
}

static void cut_one(void *user, size_t i, unsigned worker)
{
    const cutting *c = user;
    const uint32_t photo = c->base + (uint32_t)i;
    (void)worker;
    c->status[photo] = cut_photo(c, photo);
    if (c->status[photo] != CN_OK) snprintf(c->message[photo], sizeof c->message[photo], "%s", cn_error_message());
}

static cn_status cut_all(const cn_context *ctx, cutting *c)
{
    const uint32_t n = c->from->n_photos, chunk = ctx && ctx->pool ? cn_pool_threads(ctx->pool) : 1;
    const double started_s = cn_now_s();
    for (uint32_t i = 0, at = 0; i < n; i++) {
        c->first[i] = at;
        at += c->from->photos[i].equirectangular ? CN_PANORAMA_VIEWS : 1;
    }
    for (c->base = 0; c->base < n; c->base += chunk) {
        if (cn_stopping(ctx))
            return cn_fail(CN_ERR_INTERRUPTED,
                           "stopped while cutting 360 degree photos; run the same command to resume");
        const uint32_t left = n - c->base, now = left < chunk ? left : chunk;
        cn_pool_run(ctx ? ctx->pool : NULL, now, cut_one, c);
        for (uint32_t i = c->base; i < c->base + now; i++)
            if (c->status[i] != CN_OK) return cn_fail(c->status[i], "%s", c->message[i]);
        const double elapsed = cn_now_s() - started_s, done = c->base + now;
        cn_progress(ctx, &(cn_progress_report){ "poses", "views of 360 degree photos", done, n, elapsed,
                                                elapsed * (n - done) / done, NULL });
    }
    return CN_OK;
}

static cn_status write_all(const cn_context *ctx, const cn_photo_index *from, const cn_panorama_cut *cut)
{
    const size_t n = from->n_photos + (size_t)1;
    cutting c = { .from = from, .cut = cut };
    c.first = calloc(n, sizeof *c.first);
    c.status = calloc(n, sizeof *c.status);
    c.message = calloc(n, sizeof *c.message);
    const cn_status status =
        c.first && c.status && c.message ? cut_all(ctx, &c) : cn_fail(CN_ERR_NOMEM, "out of memory for views");
    free(c.first);
    free(c.status);
    free(c.message);
    return status;
}

cn_status cn_panorama_cut_make(const cn_context *ctx, const cn_photo_index *index, const char *dir,
                               cn_panorama_cut *cut)
{
    const size_t room = (size_t)index->n_photos * CN_PANORAMA_VIEWS + 1;
    *cut = (cn_panorama_cut){ 0 };
    cut->index.folder = cn_path_join(dir, "rig-views");
    cut->index.photos = calloc(room, sizeof *cut->index.photos);
    cut->photo = calloc(room, sizeof *cut->photo);
    cut->view = calloc(room, sizeof *cut->view);
    if (!cut->index.folder || !cut->index.photos || !cut->photo || !cut->view)
        return cn_fail(CN_ERR_NOMEM, "out of memory for the views of %u photos", index->n_photos);
    CN_TRY(list_all(index, cut));
    CN_TRY(cn_folder_make(cut->index.folder));
    return write_all(ctx, index, cut);
}
