/* A photo sees a place when the place lies in its frustum, and not farther away than the surface that the tile shows in
 * the photo's own view. These depths are rendered small, once for each tile. The farthest of 3 x 3 pixels counts, so
 * that the edge of one thing does not hide what stands beside it. */
#include "renderer/photo_depths.h"

#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>

#define WIDTH 128.0
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

static cn_status render_photo(const cn_context *ctx, const cn_tile *tile, const cn_scene *scene, uint32_t view,
                              cn_photo_depth *photo)
{
    const cn_camera *full = &scene->cameras[scene->views[view].camera];
    const cn_render_options options = cn_render_options_default();
    const double height = fmin(fmax(1, round(WIDTH * full->height / full->width)), 8 * WIDTH);
    cn_picture picture;
    photo->view = &scene->views[view];
    cn_view_centre(photo->view, photo->centre);
    cn_camera_resize(full, (uint32_t)WIDTH, (uint32_t)height, &photo->camera);
    CN_TRY(cn_picture_init(&picture, photo->camera.width, photo->camera.height));
    const cn_status status = cn_render_tile(ctx, tile, &photo->camera, photo->view, &options, &picture);
    photo->depth = picture.depth;
    picture.depth = NULL;
    cn_picture_deinit(&picture);
    return status;
}

cn_status cn_photo_depths_init(cn_photo_depths *d, const cn_context *ctx, const cn_tile *tile, const cn_scene *scene,
                               const uint32_t *views, uint32_t n)
{
    cn_status status = CN_OK;
    *d = (cn_photo_depths){ .photos = calloc(n + (size_t)1, sizeof *d->photos) };
    if (!d->photos) return cn_fail(CN_ERR_NOMEM, "out of memory for the depths of %u photos", n);
    for (uint32_t i = 0; i < n && status == CN_OK; i++) {
        d->n = i + 1;
        status = render_photo(ctx, tile, scene, views[i], &d->photos[i]);
    }
    if (status != CN_OK) cn_photo_depths_deinit(d);
    return status;
}

static bool sees(const cn_photo_depth *p, const double xyz[3])
{
    double there[3], px[2];
    cn_mat3_vec(p->view->rotation, xyz, there);
    for (int k = 0; k < 3; k++)
        there[k] += p->view->translation[k];
    if (there[2] <= 0 || !cn_camera_project(&p->camera, there, px)) return false;
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
