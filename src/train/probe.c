#include "train/probe.h"

#include "base/clock.h"
#include "base/schedule.h"
#include "base/units.h"
#include "math/linalg.h"
#include "photo/store.h"
#include "train/trainer.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Photos of a ball over a floor of squares, from a ring of cameras. Further photos repeat the ring's pictures,
 * because a photo's row of parameters takes time, and its pixels do not. */
enum { WIDTH = 96, HEIGHT = 72, PICTURES = 8, STEPS = 24 };

/* The first steps march through fog, where every sample counts, and are slow. Most of training comes after these.
 * They use a quarter of the samples. */
enum { FOG_STEPS = 160, FOG_PART = 4, SETTLING = 4 };

typedef struct made_tile {
    cn_camera camera;
    cn_scene scene;
    cn_photo *photos;
    cn_photo_index index;
    cn_pixel_store *pixels;
    cn_plan_tile tile;
} made_tile;

static void look_at_middle(cn_view *view, double angle)
{
    const double c[3] = { 4 * cos(angle), 4 * sin(angle), 1.5 }, up[3] = { 0, 0, 1 };
    double z[3] = { -c[0], -c[1], -c[2] }, x[3], y[3], t[3];
    (void)cn_normalize3(z); /* never zero: the ring has a radius */
    cn_cross3(z, up, x);
    (void)cn_normalize3(x);
    cn_cross3(z, x, y);
    memcpy(view->rotation, x, sizeof x);
    memcpy(view->rotation + 3, y, sizeof y);
    memcpy(view->rotation + 6, z, sizeof z);
    cn_mat3_vec(view->rotation, c, t);
    for (int a = 0; a < 3; a++)
        view->translation[a] = -t[a];
}

/* Linear light from place o along d. */
static void shade(const double o[3], const double d[3], float *rgbw)
{
    const double h = cn_dot3(o, d), q = h * h - cn_dot3(o, o) + 1;
    double appearance = 0.4;
    if (q > 0 && -h - sqrt(q) > 0) {
        appearance = 0.15 + 0.1 * sin(8 * (o[2] + (-h - sqrt(q)) * d[2]));
    } else if (d[2] < 0) {
        const double t = (-1 - o[2]) / d[2];
        appearance = ((int)floor(o[0] + t * d[0]) + (int)floor(o[1] + t * d[1])) & 1 ? 0.1 : 0.5;
    }
    for (int c = 0; c < 3; c++)
        rgbw[c] = (float)(appearance * (1 + 0.2 * c));
    rgbw[3] = 1;
}

static cn_status draw(const cn_camera *camera, const cn_view *view, float *rgbw)
{
    double centre[3], dir[3], world[3];
    cn_view_centre(view, centre);
    for (uint32_t i = 0; i < WIDTH * HEIGHT; i++) {
        CN_TRY(cn_camera_unproject(camera, i % WIDTH + 0.5, i / WIDTH + 0.5, dir));
        cn_mat3_tvec(view->rotation, dir, world);
        shade(centre, world, rgbw + 4 * (size_t)i);
    }
    return CN_OK;
}

static cn_status draw_pictures(made_tile *m)
{
    const size_t size = (size_t)WIDTH * HEIGHT * 4;
    float *rgbw = malloc(sizeof *rgbw * size * PICTURES);
    cn_status status = rgbw ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory while measuring this machine");
    for (uint32_t i = 0; i < PICTURES && status == CN_OK; i++)
        status = draw(&m->camera, &m->scene.views[i], rgbw + i * size);
    if (status == CN_OK) status = cn_pixel_store_in_memory(&m->pixels, PICTURES, WIDTH, HEIGHT, rgbw);
    free(rgbw);
    return status;
}

static cn_status make_tile(made_tile *m, const cn_plan_tile *like, uint32_t n)
{
    static char name[] = "made";
    if (n < PICTURES) n = PICTURES;
    m->camera =
        (cn_camera){ .id = 1, .lens = CN_LENS_PINHOLE, .width = WIDTH, .height = HEIGHT, .params = { 90, 90, 48, 36 } };
    m->scene =
        (cn_scene){ .cameras = &m->camera, .n_cameras = 1, .views = calloc(n, sizeof *m->scene.views), .n_views = n };
    m->photos = calloc(PICTURES, sizeof *m->photos);
    m->tile.photos = malloc(sizeof *m->tile.photos * n);
    if (!m->scene.views || !m->photos || !m->tile.photos)
        return cn_fail(CN_ERR_NOMEM, "out of memory while measuring this machine");
    for (uint32_t i = 0; i < n; i++) {
        m->scene.views[i] = (cn_view){ .name = name, .photo = i % PICTURES };
        look_at_middle(&m->scene.views[i], (i % PICTURES) * 2 * CN_PI / PICTURES);
        m->tile.photos[i] = i;
    }
    for (uint32_t i = 0; i < PICTURES; i++)
        m->photos[i] =
            (cn_photo){ .name = name, .width = WIDTH, .height = HEIGHT, .exposure_s = 0.01, .iso = 100, .f_number = 4 };
    m->index = (cn_photo_index){ .photos = m->photos, .n_photos = PICTURES };
    m->tile.n_photos = n;
    m->tile.radius_m = 5;
    m->tile.near_m = 1;
    m->tile.far_m = 30;
    for (int a = 0; a < 3; a++)
        m->tile.bounds_min[a] = -4.5, m->tile.bounds_max[a] = 4.5;
    snprintf(m->tile.id, sizeof m->tile.id, "probe");
    memcpy(m->tile.effects, like->effects, sizeof m->tile.effects);
    m->tile.n_effects = like->n_effects;
    return draw_pictures(m);
}

static void free_tile(made_tile *m)
{
    cn_pixel_store_close(&m->pixels);
    free(m->scene.views);
    free(m->photos);
    free(m->tile.photos);
}

/* The median time of a step if all samples were live. On a busy machine the clock mostly measures other programs.
 * The processor time of the threads, divided among them, is then used instead. */
static cn_status time_steps(const cn_context *ctx, cn_trainer *t, double *full_s)
{
    const uint32_t samples = t->options.samples_per_step;
    double took[STEPS], live = 0;
    for (int i = 0; i < FOG_STEPS + SETTLING; i++) {
        if (cn_stopping(ctx))
            return cn_fail(CN_ERR_INTERRUPTED, "stopped while measuring this machine; run the same command again");
        t->options.samples_per_step = i < FOG_STEPS ? samples / FOG_PART : samples;
        CN_TRY(cn_trainer_step(t));
    }
    const cn_schedule before = cn_schedule_now();
    for (int i = 0; i < STEPS; i++) {
        const double start = cn_now_s();
        CN_TRY(cn_trainer_step(t));
        took[i] = cn_now_s() - start;
        live += (double)t->stats.live / (double)(t->stats.samples ? t->stats.samples : 1) / STEPS;
    }
    const double step_s = cn_schedule_alone(before, cn_schedule_now(), cn_pool_threads(ctx->pool),
                                            STEPS * cn_select(took, STEPS, STEPS / 2)) /
                          STEPS;
    *full_s = step_s / (1 - CN_LIVE_PART + CN_LIVE_PART * live);
    return CN_OK;
}

static cn_status run(cn_trainer *t, const cn_context *ctx, const cn_train_input *input, const cn_train_options *options,
                     double *full_s)
{
    cn_arena counter;
    cn_arena_count(&counter);
    t->ctx = ctx;
    CN_TRY(cn_trainer_plan(t, input, options, cn_pool_threads(ctx->pool)));
    cn_trainer_carve(t, &counter);
    CN_TRY(cn_device_arena_init(t->ctx, &t->arena, counter.used));
    cn_trainer_carve(t, &t->arena);
    CN_TRY(cn_trainer_begin(t));
    return time_steps(ctx, t, full_s);
}

cn_status cn_train_probe(const cn_context *ctx, const cn_train_options *options, const cn_plan_tile *tile,
                         uint32_t n_photos, double *full_s)
{
    const cn_context quiet = { .pool = ctx ? ctx->pool : NULL,
                               .stop = ctx ? ctx->stop : NULL,
                               .device = ctx ? ctx->device : NULL };
    made_tile made = { 0 };
    cn_trainer *trainer = calloc(1, sizeof *trainer);
    cn_status status = trainer ? make_tile(&made, tile, n_photos)
                               : cn_fail(CN_ERR_NOMEM, "out of memory while measuring this machine");
    const cn_train_input input = { &made.scene, &made.index, made.pixels, &made.tile };
    if (status == CN_OK) status = run(trainer, &quiet, &input, options, full_s);
    if (trainer) cn_trainer_deinit(trainer);
    free(trainer);
    free_tile(&made);
    return status;
}

double cn_train_live_part(const cn_plan_tile *tile)
{
    const double depth = log(fmax(tile->far_m, tile->near_m) / fmax(tile->near_m, 1e-12));
    return 1 - CN_LIVE_PART + CN_LIVE_PART * fmin(fmax(1.15 - 0.11 * depth, 0.25), 1);
}
