/* Where the trained photos look: one photo along the x axis, and one of all directions. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "effect/sky_hints.h"
#include "train/looks.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static float dir[CN_LOOKS][3];
static uint8_t look[CN_LOOKS];

/* A camera 90 degrees wide and high; its axes in the world: right is -y, down is -z, forward is x. */
static cn_train_photo along_x(void)
{
    const cn_camera camera = { .lens = CN_LENS_SIMPLE_PINHOLE, .width = 100, .height = 100, .params = { 50, 50, 50 } };
    const cn_view view = { .rotation = { 0, -1, 0, 0, 0, -1, 1, 0, 0 } };
    const cn_box box = { .half_extent = { 10, 10, 10 } };
    cn_train_photo photo = { .size = { 100, 100 } };
    cn_ray_generator_init(&photo.generator, &camera, &view, &box);
    return photo;
}

static void test_a_photo_looks_where_its_frame_is(void **state)
{
    (void)state;
    cn_train_photo photo = along_x();
    cn_sampler sampler = { .n_photos = 1, .photos = &photo };
    cn_looks_find(&sampler, dir, look);
    uint32_t looked = 0;
    for (int i = 0; i < CN_LOOKS; i++) {
        const double length = sqrt(pow((double)dir[i][0], 2) + pow((double)dir[i][1], 2) + pow((double)dir[i][2], 2));
        assert_float_equal(length, 1, 1e-5);
        const bool inside = dir[i][0] > 0 && fabsf(dir[i][1]) < dir[i][0] && fabsf(dir[i][2]) < dir[i][0];
        assert_int_equal(look[i], inside ? CN_LOOK_SOMETHING : CN_LOOK_NONE);
        looked += inside;
    }
    assert_true(looked > CN_LOOKS / 10 && looked < CN_LOOKS / 5);
}

/* The upper quarter of the photo shows sky. */
static void test_hints_say_where_sky_is(void **state)
{
    (void)state;
    cn_train_photo photo = along_x();
    uint8_t *hint = calloc(CN_SKY_HINTS, 1);
    assert_non_null(hint);
    memset(hint, CN_SKY_SHOWN, CN_SKY_HINTS / 4);
    cn_sampler sampler = { .n_photos = 1, .photos = &photo, .sky_hint = hint };
    cn_looks_find(&sampler, dir, look);
    for (int i = 0; i < CN_LOOKS; i++) {
        if (look[i] == CN_LOOK_NONE) continue;
        assert_int_equal(look[i], dir[i][2] > 0.5f * dir[i][0] ? CN_LOOK_SKY : CN_LOOK_SOMETHING);
    }
    free(hint);
}

static void test_a_photo_of_all_directions_looks_everywhere(void **state)
{
    (void)state;
    cn_train_photo photo = along_x();
    photo.generator.camera =
        (cn_camera){ .lens = CN_LENS_EQUIRECTANGULAR, .width = 200, .height = 100, .params = { 200, 100 } };
    cn_sampler sampler = { .n_photos = 1, .photos = &photo };
    cn_looks_find(&sampler, dir, look);
    for (int i = 0; i < CN_LOOKS; i++)
        assert_int_equal(look[i], CN_LOOK_SOMETHING);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_photo_looks_where_its_frame_is),
        cmocka_unit_test(test_hints_say_where_sky_is),
        cmocka_unit_test(test_a_photo_of_all_directions_looks_everywhere),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
