/* Depth maps become distances: along a ray whatever they were measured along, at the scale of the poses. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../common.h"
#include "base/file.h"
#include "base/rng.h"
#include "bridge/oiio.h"
#include "synthetic.h"
#include "train/sampler.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { PHOTOS = 3, WIDTH = 48, HEIGHT = 36, EACH = 40, FEW = 5 };

static char logged[LOGGED];
static const cn_context ctx = { .log = log_append, .user = logged };

/* Metres along the camera's axis. */
static double truth(uint32_t x, uint32_t y)
{
    return 2 + 0.05 * x + 0.03 * y;
}

typedef struct planted {
    synthetic_scene scene;
    cn_pixel_store *pixels;
    cn_train_photo photos[PHOTOS];
    cn_sparse_sample sparse[PHOTOS * EACH];
    cn_sampler sampler;
    cn_train_input input;
} planted;

static double cosine(const planted *p, uint32_t photo, uint32_t x, uint32_t y)
{
    double in_camera[3];
    const cn_camera *camera = &p->photos[photo].generator.camera;
    assert_int_equal(cn_camera_unproject(camera, x + 0.5, y + 0.5, in_camera), CN_OK);
    return in_camera[2];
}

/* The maps hold truth * factor + shift, up to the given part off. The last photo has few sparse samples. */
static void plant_noisy(planted *p, double factor, double shift, double noise)
{
    memset(p, 0, sizeof *p);
    *logged = 0;
    synthetic_scene_init(&p->scene, PHOTOS);
    float depth[WIDTH * HEIGHT], rgba[WIDTH * HEIGHT * 4] = { 0 };
    for (uint32_t i = 0; i < WIDTH * HEIGHT; i++)
        depth[i] = (float)((truth(i % WIDTH, i / WIDTH) * factor + shift) *
                           (1 + noise * (2 * (double)cn_rng_float(1, 1, i) - 1)));
    char *map = cn_format("%s/map.exr", p->scene.folder), *path = cn_format("%s/deep.bin", p->scene.folder);
    assert_int_equal(cn_oiio_write_exr(map, rgba, depth, WIDTH, HEIGHT, NULL), CN_OK);
    for (uint32_t i = 0; i < PHOTOS; i++)
        p->scene.index.photos[i].depth = cn_format("%s", map);
    assert_int_equal(cn_pixel_store_build(NULL, &p->scene.index, WIDTH, path), CN_OK);
    assert_int_equal(cn_pixel_store_open(&p->pixels, path), CN_OK);
    free(map);
    free(path);
    const cn_box box = { .half_extent = { 5, 5, 5 }, .near_m = 0.1f, .far_m = 100, .step = 0.01f };
    p->sampler = (cn_sampler){ .pixels = p->pixels, .n_photos = PHOTOS, .photos = p->photos, .sparse = p->sparse };
    p->input = (cn_train_input){ .tile = &p->scene.tile };
    for (uint32_t i = 0; i < PHOTOS; i++) {
        const cn_view *view = &p->scene.scene.views[i];
        cn_ray_generator_init(&p->photos[i].generator, &p->scene.scene.cameras[view->camera], view, &box);
        p->photos[i].store = i;
        p->photos[i].size = (cn_pixel_extent){ WIDTH, HEIGHT };
        for (uint32_t k = 0; k < (i == PHOTOS - 1 ? FEW : EACH); k++) {
            const uint32_t x = 7 * k % WIDTH, y = 5 * k % HEIGHT;
            p->sparse[p->sampler.n_sparse++] =
                (cn_sparse_sample){ i, (uint16_t)x, (uint16_t)y, (float)(truth(x, y) / cosine(p, i, x, y)) };
        }
    }
}

static void plant(planted *p, double factor, double shift)
{
    plant_noisy(p, factor, shift, 0);
}

static void uproot(planted *p)
{
    cn_pixel_store_close(&p->pixels);
    synthetic_scene_deinit(&p->scene);
}

/* The measured distances of a group of rays through the photo. */
static void expect_truth(const planted *p, uint32_t photo, bool known)
{
    float target[4 * CN_GROUP], measured[CN_GROUP];
    uint32_t ray_photo[CN_GROUP];
    uint16_t x[CN_GROUP], y[CN_GROUP];
    cn_ray rays[CN_GROUP];
    cn_batch b = { .rays = rays, .ray_photo = ray_photo, .target = target, .measured_m = measured };
    for (uint32_t i = 0; i < CN_GROUP; i++) {
        x[i] = (uint16_t)(11 * i % WIDTH);
        y[i] = (uint16_t)(i % HEIGHT);
        ray_photo[i] = photo;
        target[4 * i + 3] = 1;
        assert_true(cn_ray_generator_ray(&p->photos[photo].generator, x[i] + 0.5, y[i] + 0.5, &rays[i]));
    }
    assert_int_equal(cn_sampler_read_depth(&p->sampler, 0, x, y, &b), CN_OK);
    for (uint32_t i = 0; i < CN_GROUP; i++) {
        const double want = known ? truth(x[i], y[i]) / cosine(p, photo, x[i], y[i]) : 0;
        assert_true(fabs((double)measured[i] - want) <= 1e-3 * want);
    }
}

static void measured_depths_follow_the_scale_of_the_poses(void **state)
{
    (void)state;
    static planted p;
    plant(&p, 0.5, 0);
    assert_int_equal(cn_sampler_fit_depth(&p.sampler, &ctx, &p.input, CN_DEPTH_MEASURED), CN_OK);
    assert_int_equal(p.sampler.n_depth, PHOTOS);
    assert_non_null(strstr(logged, "scaled by 2, to agree with 85 sparse points"));
    for (uint32_t i = 0; i < PHOTOS; i++)
        expect_truth(&p, i, true);
    uproot(&p);
    plant(&p, 1, 0);
    assert_int_equal(cn_sampler_fit_depth(&p.sampler, &ctx, &p.input, CN_DEPTH_MEASURED), CN_OK);
    assert_string_equal(logged, "");
    uproot(&p);
}

static void a_cue_gets_a_scale_and_a_shift(void **state)
{
    (void)state;
    static planted p;
    plant(&p, 0.25, -0.3);
    assert_int_equal(cn_sampler_fit_depth(&p.sampler, &ctx, &p.input, CN_DEPTH_CUE), CN_OK);
    assert_int_equal(p.sampler.n_depth, PHOTOS - 1);
    assert_non_null(strstr(logged, "the depth maps of 1 photos are left out"));
    for (uint32_t i = 0; i < PHOTOS; i++)
        expect_truth(&p, i, i < PHOTOS - 1);
    uproot(&p);
}

/* Noise makes the values spread more than the distances, but not less steeply. A line of distances over values has a
 * scale of 3.4 here, the true one is 4. */
static void noise_does_not_flatten_a_cue(void **state)
{
    (void)state;
    static planted p;
    plant_noisy(&p, 0.25, -0.3, 0.2);
    assert_int_equal(cn_sampler_fit_depth(&p.sampler, &ctx, &p.input, CN_DEPTH_CUE), CN_OK);
    assert_true(fabs((double)p.photos[0].depth_scale - 4) < 0.4);
    uproot(&p);
}

/* A map that has nothing to do with the distances of its photo's points. */
static void a_wrong_cue_is_left_out(void **state)
{
    (void)state;
    static planted p;
    plant(&p, 0.25, -0.3);
    for (uint32_t i = 0; i < p.sampler.n_sparse; i++)
        if (p.sparse[i].photo == 0) p.sparse[i].distance_m = 3 + (float)(i * 2654435761u % 1000) / 200;
    assert_int_equal(cn_sampler_fit_depth(&p.sampler, &ctx, &p.input, CN_DEPTH_CUE), CN_OK);
    assert_int_equal(p.sampler.n_depth, PHOTOS - 2);
    assert_non_null(strstr(logged, "do not follow the points' distances"));
    expect_truth(&p, 0, false);
    expect_truth(&p, 1, true);
    uproot(&p);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(measured_depths_follow_the_scale_of_the_poses),
                                        cmocka_unit_test(a_cue_gets_a_scale_and_a_shift),
                                        cmocka_unit_test(noise_does_not_flatten_a_cue),
                                        cmocka_unit_test(a_wrong_cue_is_left_out) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
