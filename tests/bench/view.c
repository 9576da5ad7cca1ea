/* Speed of rendering a trained city: the views of its held-out photos, 320 pixels wide, one after the other on all
 * processors. Pictures are 180 pixels high. Every view is rendered three times, and the median of all is taken. usage:
 * bench_view CITY Prints: views a second, million samples a second by the clock and by processor time (the same on a
 * machine that does nothing else), samples a pixel, and the name of the tile. */
#include "base/clock.h"
#include "conurb/photo.h"
#include "conurb/plan.h"
#include "conurb/render.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 320, HEIGHT = 180, REPEATS = 3, MAX_VIEWS = 64 };

typedef struct city {
    cn_photo_index photos;
    cn_scene scene;
    cn_plan plan;
    cn_tile *tile;
} city;

static cn_status open_city(const cn_context *ctx, const char *folder, city *c)
{
    char path[4096];
    snprintf(path, sizeof path, "%s/photos.json", folder);
    CN_TRY(cn_photo_index_load(&c->photos, path));
    snprintf(path, sizeof path, "%s/poses", folder);
    CN_TRY(cn_pose_load(ctx, path, &c->photos, &c->scene));
    snprintf(path, sizeof path, "%s/plan", folder);
    CN_TRY(cn_plan_load(&c->plan, &c->scene, path));
    snprintf(path, sizeof path, "%s/tiles/%s/tile.safetensors", folder, c->plan.tiles[0].id);
    return cn_tile_open(&c->tile, path);
}

/* The photo's lens, cropped to the middle of its picture, in the format of a film. */
static cn_camera film_camera(const cn_camera *photo)
{
    cn_camera camera;
    cn_camera_resize(photo, WIDTH, (uint32_t)((uint64_t)photo->height * WIDTH / photo->width), &camera);
    const double focal = camera.params[0];
    return (cn_camera){
        .lens = CN_LENS_PINHOLE, .width = WIDTH, .height = HEIGHT, .params = { focal, focal, WIDTH / 2.0, HEIGHT / 2.0 }
    };
}

static int by_value(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static cn_status time_views(const cn_context *ctx, const city *c)
{
    const cn_plan_tile *tile = &c->plan.tiles[0];
    double seconds[MAX_VIEWS * REPEATS], sum = 0, ran = 0;
    uint64_t samples = 0;
    uint32_t n = 0;
    cn_picture picture;
    CN_TRY(cn_picture_init(&picture, WIDTH, HEIGHT));
    for (uint32_t i = 0; i < tile->n_held_out && i < MAX_VIEWS; i++)
        for (int k = 0; k < REPEATS; k++) {
            const cn_view *view = &c->scene.views[tile->held_out[i]];
            const cn_camera camera = film_camera(&c->scene.cameras[view->camera]);
            uint64_t asked = 0;
            cn_render_options options = cn_render_options_default();
            options.samples = &asked;
            const double start = cn_clock_s(CLOCK_MONOTONIC), busy = cn_clock_s(CLOCK_PROCESS_CPUTIME_ID);
            CN_TRY(cn_render_tile(ctx, c->tile, &camera, view, &options, &picture));
            sum += seconds[n++] = cn_clock_s(CLOCK_MONOTONIC) - start;
            ran += (cn_clock_s(CLOCK_PROCESS_CPUTIME_ID) - busy) / cn_pool_threads(ctx->pool);
            samples += asked;
        }
    cn_picture_deinit(&picture);
    if (!n) return cn_fail(CN_ERR_DATA, "tile %s has no held-out photos", tile->id);
    qsort(seconds, n, sizeof *seconds, by_value);
    printf("%.2f %.3f %.3f %.1f %s\n", 1 / seconds[n / 2], (double)samples / sum * 1e-6, (double)samples / ran * 1e-6,
           (double)samples / ((double)n * WIDTH * HEIGHT), tile->id);
    return CN_OK;
}

int main(int argc, char **argv)
{
    city c = { 0 };
    cn_pool *pool = NULL;
    if (argc != 2) {
        fprintf(stderr, "usage: bench_view CITY\n");
        return 2;
    }
    cn_status status = cn_pool_create(&pool, 0);
    const cn_context ctx = { .pool = pool };
    if (status == CN_OK) status = open_city(&ctx, argv[1], &c);
    if (status == CN_OK) status = time_views(&ctx, &c);
    if (status != CN_OK) fprintf(stderr, "bench_view: %s\n", cn_error_message());
    cn_tile_close(&c.tile);
    cn_plan_deinit(&c.plan);
    cn_scene_deinit(&c.scene);
    cn_photo_index_deinit(&c.photos);
    cn_pool_destroy(&pool);
    return (int)status;
}
