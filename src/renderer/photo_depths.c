/* A photo sees a place when the place lies in its frustum, and not farther away than the surface that the tile shows in
 * the photo's own view. These depths are rendered small, once for each tile, and coarser at first where a first picture
 * must not wait for them. The farthest of 3 x 3 pixels counts, so
 * that the edge of one thing does not hide what stands beside it. */
#include "renderer/photo_depths.h"

#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>

/* How much too short a depth may be, as a fraction of the distance. On a surface at 75 degrees to the ray, half a pixel
 * of 128 makes 3 %. */
#define SLACK 0.03

void cn_photo_depths_deinit(cn_photo_depths *d)
{
    for (uint32_t i = 0; i < d->n; i++)
        free(d->photos[i].depth);
    free(d->photos);
    *d = (cn_photo_depths){ 0 };
}

static cn_status render_photo(const cn_context *ctx, const cn_tile *tile, const cn_view *view, const cn_camera *camera,
                              cn_photo_depth *photo)
{
    const cn_render_options options = cn_render_options_default();
    cn_picture picture;
    CN_TRY(cn_picture_init(&picture, camera->width, camera->height));
    const cn_status status = cn_render_tile(ctx, tile, camera, view, &options, &picture);
    if (status == CN_OK) {
        free(photo->depth);
        *photo = (cn_photo_depth){ .camera = *camera, .view = view, .depth = picture.depth };
        cn_view_centre(view, photo->centre);
        picture.depth = NULL;
    }
    cn_picture_deinit(&picture);
    return status;
}

cn_status cn_photo_depths_render(cn_photo_depths *d, const cn_context *ctx, const cn_tile *tile,
                                 const cn_photo_views *of, uint32_t width)
{
    if (!d->photos) d->photos = calloc(of->n + (size_t)1, sizeof *d->photos);
    if (!d->photos) return cn_fail(CN_ERR_NOMEM, "out of memory for the depths of %u photos", of->n);
    d->n = of->n;
    for (uint32_t i = 0; i < of->n; i++) {
        const cn_view *view = &of->scene->views[of->views[i]];
        const cn_camera *full = &of->scene->cameras[view->camera];
        const double height = fmin(fmax(1, round((double)width * full->height / full->width)), 8.0 * width);
        cn_camera camera;
        if (d->photos[i].depth && d->photos[i].camera.width >= width) continue;
        cn_camera_resize(full, width, (uint32_t)height, &camera);
        CN_TRY(render_photo(ctx, tile, view, &camera, &d->photos[i]));
    }
    return CN_OK;
}

static bool sees(const cn_photo_depth *p, const double xyz[3])
{
    double there[3], px[2];
    if (!p->depth) return false;
    cn_mat3_vec(p->view->rotation, xyz, there);
    for (int k = 0; k < 3; k++)
        there[k] += p->view->translation[k];
    if (!cn_camera_project(&p->camera, there, px)) return false;
    if (!(px[0] >= 0 && px[0] < p->camera.width && px[1] >= 0 && px[1] < p->camera.height)) return false;
    const int x0 = (int)px[0], y0 = (int)px[1];
    float farthest = 0;
    for (int y = y0 - 1; y <= y0 + 1; y++)
        for (int x = x0 - 1; x <= x0 + 1; x++) {
            if (x < 0 || y < 0 || x >= (int)p->camera.width || y >= (int)p->camera.height) continue;
            const float depth = p->depth[(size_t)y * p->camera.width + (size_t)x];
            farthest = fmaxf(farthest, depth > 0 ? depth : INFINITY); /* nothing there hides nothing */
        }
    return cn_distance3(xyz, p->centre) <= farthest * (1 + SLACK);
}

uint32_t cn_photo_depths_count(const cn_photo_depths *d, const double xyz[3])
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < d->n; i++)
        n += sees(&d->photos[i], xyz);
    return n;
}
