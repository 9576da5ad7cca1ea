/* Adapts cameras to the photos of the index: with EXIF orientation applied, and at their real size. */
#include "pose/lens.h"
#include "pose/scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MERGE_WITHIN 1000

/* out = m * in + offset, pixels. */
typedef struct affine {
    double m[4], offset[2];
} affine;

/* EXIF orientation as a rotation of the picture about its centre; a mirrored one has determinant -1. */
static void orientation_turn(int orientation, double m[4])
{
    static const double TURNS[9][4] = {
        { 1, 0, 0, 1 }, { 1, 0, 0, 1 },  { -1, 0, 0, 1 },  { -1, 0, 0, -1 }, { 1, 0, 0, -1 },
        { 0, 1, 1, 0 }, { 0, -1, 1, 0 }, { 0, -1, -1, 0 }, { 0, 1, -1, 0 },
    };
    memcpy(m, TURNS[orientation >= 1 && orientation <= 8 ? orientation : 1], sizeof TURNS[0]);
}

void cn_photo_upright(const cn_photo *photo, double xy_px[2])
{
    double m[4];
    const bool swapped = photo->orientation >= 5;
    const double x = xy_px[0] - 0.5 * (swapped ? photo->height : photo->width);
    const double y = xy_px[1] - 0.5 * (swapped ? photo->width : photo->height);
    orientation_turn(photo->orientation, m);
    xy_px[0] = m[0] * x + m[1] * y + 0.5 * photo->width;
    xy_px[1] = m[2] * x + m[3] * y + 0.5 * photo->height;
}

/* Same aspect ratio, up to the rounding of either size to whole pixels. */
static bool same_aspect(uint32_t w, uint32_t h, uint32_t photo_w, uint32_t photo_h)
{
    double off = fabs((double)w * photo_h - (double)h * photo_w);
    return off <= 0.5 * ((double)w + h + photo_w + photo_h);
}

/* Camera and view of the same photo, rotated by m. */
static affine turn(cn_camera *camera, double rotation[9], double translation[3], const double m[4])
{
    cn_lens_view lens = cn_lens_unpack(camera), out = lens;
    bool swapped = m[0] == 0.0;
    double w = camera->width, h = camera->height;
    camera->width = (uint32_t)(swapped ? h : w);
    camera->height = (uint32_t)(swapped ? w : h);
    affine a = { .m = { m[0], m[1], m[2], m[3] } };
    a.offset[0] = 0.5 * camera->width - 0.5 * (m[0] * w + m[1] * h);
    a.offset[1] = 0.5 * camera->height - 0.5 * (m[2] * w + m[3] * h);
    out.cx = m[0] * lens.cx + m[1] * lens.cy + a.offset[0];
    out.cy = m[2] * lens.cx + m[3] * lens.cy + a.offset[1];
    if (swapped) {
        out.fx = lens.fy;
        out.fy = lens.fx;
    }
    /* The tangential term is r^2 q + 2 w (w.q) with q = (p2, p1): q rotates like a vector. */
    out.p[1] = m[0] * lens.p[1] + m[1] * lens.p[0];
    out.p[0] = m[2] * lens.p[1] + m[3] * lens.p[0];
    cn_lens_pack(&out, camera);
    for (int k = 0; k < 3; k++) {
        double x = rotation[k], y = rotation[3 + k];
        rotation[k] = m[0] * x + m[1] * y;
        rotation[3 + k] = m[2] * x + m[3] * y;
    }
    double x = translation[0], y = translation[1];
    translation[0] = m[0] * x + m[1] * y;
    translation[1] = m[2] * x + m[3] * y;
    return a;
}

static void resize(cn_camera *camera, uint32_t width, uint32_t height, affine *a)
{
    double sx = (double)width / camera->width, sy = (double)height / camera->height;
    cn_camera resized;
    cn_camera_resize(camera, width, height, &resized);
    *camera = resized;
    a->m[0] *= sx;
    a->m[1] *= sx;
    a->offset[0] *= sx;
    a->m[2] *= sy;
    a->m[3] *= sy;
    a->offset[1] *= sy;
}

/* True when the camera is for the stored pixels, which still must be rotated. */
static bool is_raw(const cn_camera *camera, const cn_photo *photo, bool raw_pixels)
{
    if (photo->orientation < 2 || photo->orientation > 8) return false;
    if (photo->orientation < 5) return raw_pixels;
    bool as_shown = same_aspect(camera->width, camera->height, photo->width, photo->height);
    bool as_stored = same_aspect(camera->width, camera->height, photo->height, photo->width);
    return as_stored && (raw_pixels || !as_shown);
}

static bool is_same(const cn_camera *a, const cn_camera *b)
{
    return a->lens == b->lens && a->width == b->width && a->height == b->height &&
           memcmp(a->params, b->params, sizeof a->params) == 0;
}

/* The camera's index in the list; it is appended when it is new. Photos of one camera are usually adjacent, so search
 * from the end, and give up after a few when every photo has its own camera. There is room for one camera per view. */
static uint32_t intern(cn_camera *cameras, uint32_t *n, cn_camera camera)
{
    for (uint32_t i = *n; i > 0 && *n - i < MERGE_WITHIN; i--)
        if (is_same(&cameras[i - 1], &camera)) return i - 1;
    camera.id = *n + 1;
    cameras[*n] = camera;
    return (*n)++;
}

/* *keep false: the photo is mirrored, or shows all directions and lies on its side; no rotation undoes that. */
static cn_status fit_view(cn_view *view, const cn_photo *photo, bool raw_pixels, cn_camera *camera, affine *a,
                          bool *keep)
{
    *a = (affine){ .m = { 1, 0, 0, 1 } };
    if (is_raw(camera, photo, raw_pixels)) {
        double m[4];
        orientation_turn(photo->orientation, m);
        if (m[0] * m[3] - m[1] * m[2] < 0.0 || (m[0] == 0.0 && camera->lens == CN_LENS_EQUIRECTANGULAR)) {
            *keep = false;
            return CN_OK;
        }
        *a = turn(camera, view->rotation, view->translation, m);
    }
    if (camera->width == photo->width && camera->height == photo->height) return CN_OK;
    if (!same_aspect(camera->width, camera->height, photo->width, photo->height))
        return cn_fail(CN_ERR_DATA,
                       "photo %s is %u x %u pixels, but its poses are for %u x %u, another aspect ratio; "
                       "give the photos that the poses were made from",
                       view->name, photo->width, photo->height, camera->width, camera->height);
    resize(camera, photo->width, photo->height, a);
    return CN_OK;
}

/* What fitting gives: which views stay, how each view's pixels move, and the cameras that fit the photos. */
typedef struct fitted {
    bool *keep;
    affine *moves;
    cn_camera *cameras;
    uint32_t n_cameras;
} fitted;

static cn_status fit_all(const cn_context *ctx, cn_scene *scene, const cn_photo_index *index, bool raw_pixels,
                         fitted *f)
{
    for (uint32_t i = 0; i < scene->n_views; i++) {
        cn_view *view = &scene->views[i];
        cn_camera camera = scene->cameras[view->camera];
        f->moves[i] = (affine){ .m = { 1, 0, 0, 1 } };
        if (view->photo != UINT32_MAX && f->keep[i]) {
            CN_TRY(fit_view(view, &index->photos[view->photo], raw_pixels, &camera, &f->moves[i], &f->keep[i]));
            if (!f->keep[i])
                cn_log(ctx, CN_LOG_WARN, "photo %s is %s (EXIF orientation); it is left out", view->name,
                       camera.lens == CN_LENS_EQUIRECTANGULAR ? "turned or mirrored" : "mirrored");
        }
        view->camera = intern(f->cameras, &f->n_cameras, camera);
    }
    return CN_OK;
}

cn_status cn_scene_fit_photos(const cn_context *ctx, cn_scene *scene, const cn_photo_index *index, bool raw_pixels,
                              bool *keep)
{
    fitted f = { .keep = keep };
    f.moves = calloc(scene->n_views + (size_t)1, sizeof *f.moves);
    f.cameras = calloc(scene->n_views + (size_t)1, sizeof *f.cameras);
    cn_status status = f.moves && f.cameras ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory fitting cameras to photos");
    if (status == CN_OK) status = fit_all(ctx, scene, index, raw_pixels, &f);
    if (status == CN_OK) {
        for (uint64_t i = 0; i < scene->n_observations; i++) {
            cn_observation *o = &scene->observations[i];
            const affine *a = &f.moves[o->view];
            double x = o->x_px, y = o->y_px;
            o->x_px = (float)(a->m[0] * x + a->m[1] * y + a->offset[0]);
            o->y_px = (float)(a->m[2] * x + a->m[3] * y + a->offset[1]);
        }
        free(scene->cameras);
        scene->cameras = f.cameras;
        scene->n_cameras = f.n_cameras;
        f.cameras = NULL;
    }
    free(f.moves);
    free(f.cameras);
    return status;
}
