/* The rays that a device draws are those of the processor: photo, pixel, colour and weight bit by bit, the rest within
 * rounding. All lenses, photos of several sizes, masked pixels, pixels without a ray, sparse points, depth maps, depths
 * by stereo, normal maps. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "../unit/train/synthetic.h"
#include "base/rng.h"
#include "device/step_session.h"
#include "effect/effect.h"
#include "effect/sky_hints.h"
#include "image/image.h"
#include "list.h"
#include "math/linalg.h"
#include "photo/store.h"
#include "train/trainer.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

enum { CAMERAS = 9, PHOTOS = 13, POINTS = 60, GROUPS = 64, STEREO_WIDTH = 17, STEREO_HEIGHT = 16, MESSAGE = 200 };

/* The fisheye's picture is larger than what its lens shows; so is that of the last but one. The last two have the same
 * numbers. */
static const cn_camera cameras[CAMERAS] = {
    { .lens = CN_LENS_SIMPLE_PINHOLE, .width = 80, .height = 60, .params = { 70, 40, 30 } },
    { .lens = CN_LENS_PINHOLE, .width = 96, .height = 72, .params = { 90, 91, 47, 37 } },
    { .lens = CN_LENS_SIMPLE_RADIAL, .width = 96, .height = 72, .params = { 80, 48, 36, 0.05 } },
    { .lens = CN_LENS_RADIAL, .width = 96, .height = 72, .params = { 80, 48, 36, -0.1, 0.02 } },
    { .lens = CN_LENS_OPENCV, .width = 96, .height = 72, .params = { 80, 82, 48, 36, -0.1, 0.02, 1e-3, -2e-3 } },
    { .lens = CN_LENS_OPENCV_FISHEYE, .width = 96, .height = 72, .params = { 24, 24, 48, 36, -0.05, 0.01, 0, 0 } },
    { .lens = CN_LENS_EQUIRECTANGULAR, .width = 128, .height = 64, .params = { 128, 64 } },
    { .lens = CN_LENS_SIMPLE_RADIAL, .width = 96, .height = 72, .params = { 40, 48, 36, -0.4 } },
    { .lens = CN_LENS_PINHOLE, .width = 96, .height = 72, .params = { 40, 48, 36, -0.4 } },
};
/* What the photos have of cameras; the last two share one, and its size. */
static const uint32_t camera_of[PHOTOS] = { 0, 1, 2, 3, 4, 5, 6, 7, 8, 6, 5, 1, 1 };
static const cn_pixel_extent size_of[PHOTOS] = { { 40, 30 }, { 48, 36 }, { 96, 72 }, { 33, 25 }, { 48, 35 },
                                                 { 48, 36 }, { 64, 32 }, { 96, 72 }, { 96, 72 }, { 41, 21 },
                                                 { 96, 72 }, { 24, 18 }, { 24, 18 } };

typedef struct world {
    cn_scene scene;
    cn_camera camera[CAMERAS];
    cn_view view[PHOTOS];
    cn_point point[POINTS];
    cn_observation observation[POINTS * PHOTOS];
    cn_photo photo[PHOTOS];
    cn_photo_index index;
    cn_pixel_store pixels;
    cn_plan_tile tile;
    uint32_t photos[PHOTOS];
    uint64_t drawn;
} world;

static char said[MESSAGE];

static void note(void *user, cn_log_level level, const char *message)
{
    (void)user;
    if (level <= CN_LOG_WARN) snprintf(said, sizeof said, "%s", message);
}

static double draw(world *w, double low, double high)
{
    return low + (high - low) * (double)cn_rng_float(3, 7, w->drawn++);
}

/* ---- photos ---- */

static void put(world *w, const void *data, size_t size)
{
    assert_int_equal(write(w->pixels.fd, data, size), (ssize_t)size);
}

/* Colours from the smallest halves to large ones; a fifth of the pixels is masked. */
static void put_colours(world *w, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        uint16_t half[4];
        for (int c = 0; c < 3; c++)
            half[c] = i % 7 ? cn_half_from_float((float)draw(w, -0.1, 4)) : (uint16_t)(1 + i % 1000);
        half[3] = cn_half_from_float(draw(w, 0, 1) < 0.2 ? 0 : i % 3 ? 1.0f : 0.3f);
        put(w, half, sizeof half);
    }
}

static void put_depths(world *w, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        const float depth = draw(w, 0, 1) < 0.2 ? 0 : (float)draw(w, 1, 20);
        put(w, &depth, sizeof depth);
    }
}

/* Mostly of one plane that faces the camera; some of another, some missing. */
static void put_normals(world *w, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        const double kind = draw(w, 0, 1), x = draw(w, 0.2, 0.3), y = draw(w, -0.2, -0.1);
        int8_t normal[4] = { (int8_t)(127 * x), (int8_t)(127 * y), (int8_t)(-127 * sqrt(1 - x * x - y * y)), 0 };
        if (kind < 0.1) memset(normal, 0, sizeof normal);
        if (kind > 0.9) memcpy(normal, (int8_t[]){ 127, 0, 0, 0 }, sizeof normal);
        put(w, normal, sizeof normal);
    }
}

static void make_store(world *w)
{
    cn_pixel_store *s = &w->pixels;
    uint64_t at = 0;
    s->fd = memfd_create("conurb-test", MFD_CLOEXEC);
    s->path = strdup("pixels");
    s->head.n_photos = PHOTOS;
    s->records = calloc(PHOTOS, sizeof *s->records);
    for (uint32_t i = 0; i < PHOTOS; i++) {
        cn_store_record *r = &s->records[i];
        const size_t n = (size_t)size_of[i].width * size_of[i].height;
        *r = (cn_store_record){ .offset = at,
                                .width = size_of[i].width,
                                .height = size_of[i].height,
                                .depth_hash = i % 4 != 1,
                                .normal_hash = i % 3 != 1 };
        put_colours(w, n);
        if (r->depth_hash) put_depths(w, n);
        if (r->normal_hash) put_normals(w, n);
        at += cn_store_photo_bytes(r);
    }
}

static void turn(world *w, cn_view *view)
{
    double x[3], y[3], z[3];
    for (int a = 0; a < 3; a++) {
        x[a] = draw(w, -1, 1);
        z[a] = draw(w, -1, 1);
        view->translation[a] = draw(w, -2, 2);
    }
    cn_normalize3(z);
    cn_cross3(z, x, y);
    cn_normalize3(y);
    cn_cross3(y, z, x);
    for (int a = 0; a < 3; a++) {
        view->rotation[a] = x[a];
        view->rotation[3 + a] = y[a];
        view->rotation[6 + a] = z[a];
    }
}

/* Every photo sees every point somewhere; what is in its place does not matter here. */
static void make_points(world *w)
{
    uint32_t n = 0;
    for (uint32_t p = 0; p < POINTS; p++) {
        cn_point *point = &w->point[p];
        *point = (cn_point){ .first_observation = n, .n_observations = PHOTOS };
        for (int a = 0; a < 3; a++)
            point->xyz[a] = draw(w, -8, 8);
        for (uint32_t i = 0; i < PHOTOS; i++) {
            const cn_camera *camera = &w->camera[camera_of[i]];
            w->observation[n++] =
                (cn_observation){ i, (float)draw(w, 0, camera->width), (float)draw(w, 0, camera->height) };
        }
    }
}

static void make_world(world *w)
{
    memset(w, 0, sizeof *w);
    memcpy(w->camera, cameras, sizeof cameras);
    make_store(w);
    make_points(w);
    for (uint32_t i = 0; i < PHOTOS; i++) {
        w->view[i] = (cn_view){ .name = "a photo", .camera = camera_of[i], .photo = i };
        turn(w, &w->view[i]);
        w->photo[i] = (cn_photo){ .name = "a photo", .exposure_s = 0.01, .iso = 100, .f_number = 4 };
        w->photos[i] = i;
    }
    w->index = (cn_photo_index){ .photos = w->photo, .n_photos = PHOTOS };
    w->scene = (cn_scene){ w->camera, CAMERAS, w->view, PHOTOS, w->point, POINTS, w->observation, POINTS * PHOTOS };
    w->tile = (cn_plan_tile){ .id = "rays",
                              .near_m = 0.5,
                              .far_m = 40,
                              .bounds_min = { -4, -4, -2 },
                              .bounds_max = { 5, 5, 3 },
                              .photos = w->photos,
                              .n_photos = PHOTOS };
}

static void free_world(world *w)
{
    close(w->pixels.fd);
    free(w->pixels.records);
    free(w->pixels.path);
}

static void turn_on(world *w, const char *name)
{
    cn_plan_effect *e = &w->tile.effects[w->tile.n_effects++];
    snprintf(e->name, sizeof e->name, "%s", name);
    e->on = true;
}

/* ---- what is compared ---- */

typedef struct errors {
    double ray, uv, first_t, measured, plane_log, plane_width;
    uint32_t of_camera[CAMERAS], without_ray, masked, sparse, with_depth, on_plane, hints[3];
} errors;

static void differ(double *worst, double got, double wanted, double scale)
{
    const double error = fabs(got - wanted) / scale;
    if (!(error <= *worst)) *worst = error;
}

/* A depth along the axis gives a distance that grows without bounds where a fisheye's ray nears the plane of the lens,
 * and so does its error. */
static void differ_by_distance(double *worst, float got, float wanted_m)
{
    const double size = fabs((double)wanted_m);
    differ(worst, (double)got, (double)wanted_m, fmax(size * fmax(1, size / 100), 1e-3));
}

/* Pixels are masked where the store says so; else a ray without weight has no ray in the lens. */
static void count(const cn_trainer *t, uint32_t r, errors *e)
{
    const cn_batch *b = &t->batch;
    const uint32_t photo = b->ray_photo[r];
    const uint16_t x = (uint16_t)((b->uv[2 * r] + 1) / 2 * (float)size_of[photo].width),
                   y = (uint16_t)((b->uv[2 * r + 1] + 1) / 2 * (float)size_of[photo].height);
    float rgbw[4];
    assert_int_equal(cn_pixel_store_gather(t->sampler.pixels, 1, &photo, &x, &y, rgbw), CN_OK);
    e->masked += rgbw[3] == 0;
    e->without_ray += rgbw[3] > 0 && b->target[4 * r + 3] == 0;
    e->of_camera[camera_of[photo]]++;
    e->sparse += b->depth_m[r] > 0;
    e->with_depth += b->measured_m && b->measured_m[r] > 0;
    e->on_plane += b->plane_width && b->plane_width[r] > 0;
    if (b->sky_hint) e->hints[b->sky_hint[r]]++;
}

/* got: the trainer's arena as the device left it. */
static void compare(const cn_trainer *t, const unsigned char *got, errors *e)
{
    const cn_batch *b = &t->batch;
#define GOT(array) ((const void *)(got + ((const unsigned char *)(array)-t->arena.base)))
    const float *ray = GOT(b->rays), *wanted = (const float *)(const void *)b->rays, *uv = GOT(b->uv),
                *first_t = GOT(b->first_t);
    assert_memory_equal(GOT(b->ray_photo), b->ray_photo, b->n_rays * sizeof *b->ray_photo);
    assert_memory_equal(GOT(b->target), b->target, 4 * b->n_rays * sizeof *b->target);
    assert_memory_equal(GOT(b->depth_m), b->depth_m, b->n_rays * sizeof *b->depth_m);
    if (b->sky_hint) assert_memory_equal(GOT(b->sky_hint), b->sky_hint, b->n_rays);
    for (uint32_t i = 0; i < 9 * b->n_rays; i++)
        differ(&e->ray, (double)ray[i], (double)wanted[i], 1);
    for (uint32_t i = 0; i < 2 * b->n_rays; i++)
        differ(&e->uv, (double)uv[i], (double)b->uv[i], 1);
    for (uint32_t r = 0; r < b->n_rays; r++) {
        count(t, r, e);
        differ(&e->first_t, (double)first_t[r], (double)b->first_t[r], (double)b->first_t[r]);
        if (b->measured_m) differ_by_distance(&e->measured, ((const float *)GOT(b->measured_m))[r], b->measured_m[r]);
        if (!b->plane_log) continue;
        const double width = (double)b->plane_width[r];
        differ(&e->plane_width, (double)((const float *)GOT(b->plane_width))[r], width, fmax(width, 1e-3));
        differ(&e->plane_log, (double)((const float *)GOT(b->plane_log))[r], (double)b->plane_log[r], 1);
    }
#undef GOT
}

/* ---- what runs ---- */

static void never(void *user, size_t item, unsigned worker)
{
    (void)user, (void)item, (void)worker;
    fail_msg("the processor draws rays");
}

static cn_status draw_on_device(const cn_context *ctx, cn_trainer *t)
{
    const cn_op op = { .kind = CN_OP_RAYS, .item = never, .batch = &t->device.step };
    const cn_chain chain = { &op, 1, t->batch.n_groups, t };
    return cn_device_run(ctx, &chain, 1);
}

/* A step in which a ray draws the first of the numbers that stand for a row of a photo of all directions. */
static uint32_t step_at_a_bound(const cn_sampler *s)
{
    enum { STREAM_PHOTO = 16, STREAM_Y = 18 }; /* as in sampler.c */
    for (uint32_t step = 1000;; step++)
        for (uint32_t r = 1; r < GROUPS * CN_GROUP; r++) {
            const uint64_t counter = (uint64_t)step * CN_MAX_RAYS + r;
            const uint32_t photo = cn_rng_below(s->seed, STREAM_PHOTO, counter, PHOTOS), height = size_of[photo].height;
            const float drawn = cn_rng_float(s->seed, STREAM_Y, counter);
            if (cameras[camera_of[photo]].lens != CN_LENS_EQUIRECTANGULAR || r % CN_SPARSE_EVERY == 0 ||
                cn_sampler_is_neighbour(r) || !(drawn > 0))
                continue;
            if (cn_sampler_sphere_row(drawn, height) != cn_sampler_sphere_row(drawn - 0x1p-24f, height)) return step;
        }
}

static void check_steps(const cn_context *ctx, cn_trainer *t, errors *e)
{
    static const uint8_t no_sky[] = { CN_SKY_NONE, CN_SKY_NONE_LATE, CN_SKY_NONE_LAST };
    const uint32_t steps[] = { 0, 1, 300, 4000000000u, step_at_a_bound(&t->sampler) };
    unsigned char *got = malloc(t->arena.size);
    for (size_t k = 0; k < sizeof steps / sizeof *steps; k++) {
        t->step = steps[k];
        t->batch.n_groups = GROUPS;
        t->batch.n_rays = GROUPS * CN_GROUP;
        const cn_lead lead = { .sparse = k != 2, .no_sky = no_sky[k % 3] };
        cn_train_device_step(t, lead);
        assert_false(t->device.step.by_processor[CN_OP_RAYS]);
        assert_int_equal(draw_on_device(ctx, t), CN_OK);
        assert_int_equal(cn_device_fetch(ctx, &t->device.step), CN_OK);
        memcpy(got, t->arena.base, t->arena.size);
        for (uint32_t g = 0; g < GROUPS; g++) {
            cn_sampler_draw(&t->sampler, t->step, lead, g, &t->batch);
            assert_int_equal(t->sampler.read_status[g], CN_OK);
        }
        compare(t, got, e);
        assert_int_equal(cn_device_forget(ctx, &t->device.step), CN_OK);
    }
    free(got);
}

static void check_errors(const cn_context *ctx, const errors *e)
{
    printf("%s: worst error of rays %.1e, uv %.1e, begin %.1e, measured depths %.1e, planes %.1e and %.1e; "
           "%u masked, %u without a ray in the lens, %u sparse, %u with a depth, %u on planes\n",
           cn_device_about(ctx->device)->name, e->ray, e->uv, e->first_t, e->measured, e->plane_log, e->plane_width,
           e->masked, e->without_ray, e->sparse, e->with_depth, e->on_plane);
    assert_true(e->ray < 1e-6 && e->uv < 1e-6 && e->first_t < 1e-6 && e->measured < 1e-5);
    assert_true(e->plane_log < 1e-5 && e->plane_width < 1e-4);
    for (int i = 0; i < CAMERAS; i++)
        assert_true(e->of_camera[i] > 100);
    assert_true(e->masked > 100 && e->without_ray > 100 && e->sparse > 100 && e->with_depth > 100);
}

static void begin(cn_trainer *t, const cn_context *ctx, const cn_train_input *input, const cn_train_options *o)
{
    cn_arena counter;
    t->ctx = ctx;
    assert_int_equal(cn_trainer_plan(t, input, o, 1), CN_OK);
    cn_arena_count(&counter);
    cn_trainer_carve(t, &counter);
    assert_int_equal(cn_device_arena_init(ctx, &t->arena, counter.used), CN_OK);
    cn_trainer_carve(t, &t->arena);
    assert_int_equal(cn_trainer_begin(t), CN_OK);
    for (size_t i = 0; t->sampler.sky_hint && i < (size_t)PHOTOS * CN_SKY_HINTS; i++)
        t->sampler.sky_hint[i] = (uint8_t)(i / 7 % 3);
    assert_int_equal(t->device.photos.n > 0, true);
}

static cn_train_options options(void)
{
    cn_train_options o = synthetic_options();
    o.samples_per_step = 4096;
    o.precision = CN_PRECISION_FLOAT;
    o.seed = 0x123456789abcdef0u;
    return o;
}

/* The maps lie in all of the device's buffers for them. A store that cannot be read is an error with the processor's
 * message; afterwards drawing works. */
static void test_depth_and_normal_maps(void **unused)
{
    (void)unused;
    static world w;
    make_world(&w);
    for (uint32_t i = 0; i < cn_effect_count; i++)
        turn_on(&w, cn_effect_list[i]->name);
    const cn_train_input input = { &w.scene, &w.index, &w.pixels, &w.tile };
    for (uint32_t d = 0; d < n_choices; d++) {
        cn_context ctx = { .log = note };
        cn_trainer *t = calloc(1, sizeof *t);
        cn_train_options o = options();
        errors e = { 0 };
        o.depth_maps = o.normal_maps = true;
        o.depth_along = CN_DEPTH_ALONG_AXIS;
        assert_int_equal(cn_device_create(choice[d], &ctx.device), CN_OK);
        begin(t, &ctx, &input, &o);
        cn_vulkan *vulkan = (cn_vulkan *)ctx.device;
        vulkan->block_bytes = (cn_device_map_bytes(&t->device.step) * 10 / 33 + 3) / 4 * 4;
        const int fd = w.pixels.fd;
        w.pixels.fd = -1;
        t->batch.n_groups = 1;
        assert_int_equal(draw_on_device(&ctx, t), CN_ERR_IO);
        assert_string_equal(cn_error_message(),
                            "the pixel store cannot be read; delete pixels.bin and run `conurb plan` again");
        w.pixels.fd = fd;
        check_steps(&ctx, t, &e);
        for (int i = CN_OWN_MAPS; i <= CN_OWN_MAPS_END; i++)
            assert_true(vulkan->sessions->buffer[i].size > 1000);
        check_errors(&ctx, &e);
        assert_true(e.on_plane > 100 && e.hints[0] > 0 && e.hints[1] > 0 && e.hints[2] > 0);
        cn_trainer_deinit(t);
        cn_device_destroy(&ctx.device);
        free(t);
    }
    free_world(&w);
}

static cn_stereo_map *stereo_maps(world *w)
{
    cn_stereo_map *maps = calloc(PHOTOS + 1, sizeof *maps);
    for (uint32_t i = 0; i < PHOTOS; i++) {
        if (i % 5 == 2) continue; /* stereo has found nothing there */
        maps[i] = (cn_stereo_map){ STEREO_WIDTH, STEREO_HEIGHT, calloc(STEREO_WIDTH * STEREO_HEIGHT, sizeof(float)) };
        for (int k = 0; k < STEREO_WIDTH * STEREO_HEIGHT; k++)
            maps[i].depth_m[k] = draw(w, 0, 1) < 0.4 ? 0 : (float)draw(w, 1, 20);
    }
    return maps;
}

/* All maps in one buffer. */
static void test_depths_by_stereo(void **unused)
{
    (void)unused;
    static world w;
    make_world(&w);
    turn_on(&w, "stereo_depth");
    turn_on(&w, "transient");
    turn_on(&w, "sky");
    const cn_train_input input = { &w.scene, &w.index, &w.pixels, &w.tile };
    for (uint32_t d = 0; d < n_choices; d++) {
        cn_context ctx = { .log = note };
        cn_trainer *t = calloc(1, sizeof *t);
        cn_train_options o = options();
        errors e = { 0 };
        o.depth_along = CN_DEPTH_ALONG_RAY;
        t->sampler.stereo = stereo_maps(&w);
        assert_int_equal(cn_device_create(choice[d], &ctx.device), CN_OK);
        begin(t, &ctx, &input, &o);
        for (uint32_t i = 0; i < PHOTOS; i += 2) /* taken out of the pixels that the device reads */
            t->sampler.photos[i].vignetting = (cn_vignetting){ -0.7f, -0.4f };
        check_steps(&ctx, t, &e);
        check_errors(&ctx, &e);
        cn_trainer_deinit(t);
        cn_device_destroy(&ctx.device);
        free(t);
    }
    free_world(&w);
}

int main(int argc, char **argv)
{
    if (!list_devices(argc, argv)) return 77;
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_depth_and_normal_maps),
                                        cmocka_unit_test(test_depths_by_stereo) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
