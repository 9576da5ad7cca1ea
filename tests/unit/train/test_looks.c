/* Where the trained photos look: one photo along the x axis, and one of all directions. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "effect/sky_hints.h"
#include "field/occupancy.h"
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

/* What a tile keeps of two photos that look the same way; the first one's upper quarter shows sky, all else matter. */
static uint32_t places[CN_SEEN_PLACES / 32];
static uint8_t matter[CN_SEEN_DIRECTIONS];
static float distance[CN_SEEN_DIRECTIONS], reach[CN_SEEN_DIRECTIONS];
static double back_m; /* how far back the second photo is */

static void begin(uint8_t *usable, uint32_t n_sparse, cn_sparse_sample *sparse)
{
    cn_train_photo photos[2] = { along_x(), along_x() };
    photos[1].generator.origin[0] -= back_m;
    uint8_t *hint = malloc(2 * CN_SKY_HINTS);
    assert_non_null(hint);
    memset(hint, CN_SKY_NONE, 2 * CN_SKY_HINTS);
    memset(hint, CN_SKY_SHOWN, CN_SKY_HINTS / 4);
    cn_sampler sampler = { .n_photos = 2, .photos = photos, .sky_hint = hint, .n_sparse = n_sparse, .sparse = sparse };
    cn_looks looks = { places, matter, distance, reach };
    assert_int_equal(cn_looks_begin(&looks, &sampler, usable), CN_OK);
    free(hint);
}

static void test_matter_is_a_share_of_the_photos(void **state)
{
    (void)state;
    uint8_t *usable = calloc(CN_OCC_CELLS, 1);
    assert_non_null(usable);
    begin(usable, 0, NULL);
    for (uint32_t i = 0; i < CN_SEEN_DIRECTIONS; i++) {
        float d[3];
        cn_seen_direction(i, d);
        const bool inside = d[0] > 0 && fabsf(d[1]) < d[0] && fabsf(d[2]) < d[0];
        assert_int_equal(matter[i], !inside ? 0 : d[2] > 0.5f * d[0] ? 127 : 255);
        assert_true(distance[i] == 0);
    }
    free(usable);
}

static void test_a_place_is_seen_when_one_of_its_cells_is(void **state)
{
    (void)state;
    uint8_t *usable = calloc(CN_OCC_CELLS, 1);
    assert_non_null(usable);
    const uint32_t wide = CN_OCC_RES / CN_SEEN_RES, x = 10, y = 20, z = 31;
    usable[((z * wide + wide - 1) * CN_OCC_RES + y * wide) * CN_OCC_RES + x * wide + 1] = 1;
    begin(usable, 0, NULL);
    uint32_t seen = 0;
    for (uint32_t i = 0; i < CN_SEEN_PLACES; i++)
        seen += places[i / 32] >> (i % 32) & 1;
    assert_int_equal(seen, 1);
    const uint32_t place = (z * CN_SEEN_RES + y) * CN_SEEN_RES + x;
    assert_true(places[place / 32] >> (place % 32) & 1);
    free(usable);
}

/* Points in the middle of a photo, at 3, 4 ... 13 m, and one alone at its edge, which tells nothing. */
static void test_sparse_points_tell_distances(void **state)
{
    (void)state;
    uint8_t *usable = calloc(CN_OCC_CELLS, 1);
    assert_non_null(usable);
    cn_sparse_sample sparse[12] = { { .photo = 1, .x = 99, .y = 50, .distance_m = 1 } };
    for (int i = 0; i < 11; i++)
        sparse[1 + i] = (cn_sparse_sample){ .photo = (uint32_t)i % 2, .x = 50, .y = 50, .distance_m = (float)(13 - i) };
    begin(usable, 12, sparse);
    for (uint32_t i = 0; i < CN_SEEN_DIRECTIONS; i++) {
        float d[3];
        cn_seen_direction(i, d);
        if (d[0] > 0.97f) assert_true(distance[i] == 8);
        if (d[0] < 0.95f) assert_true(distance[i] == 0);
    }
    /* All points are at the height of the camera. */
    const uint32_t middle = CN_SEEN_RES / 2;
    for (uint32_t z = 0; z < CN_SEEN_RES; z++) {
        const uint32_t place = (z * CN_SEEN_RES + middle) * CN_SEEN_RES + middle;
        assert_int_equal(places[place / 32] >> (place % 32) & 1, z >= middle);
    }
    free(usable);
}

/* A front at 8 m, and a second photo 10 m farther back: the front's place tells more than its distance. Points at 3 to
 * 13 m from each of the photos have no such place. */
static void test_a_front_has_a_place(void **state)
{
    (void)state;
    uint8_t *usable = calloc(CN_OCC_CELLS, 1);
    assert_non_null(usable);
    cn_sparse_sample sparse[12];
    back_m = 10;
    for (int front = 0; front < 2; front++) {
        for (uint32_t i = 0; i < 12; i++)
            sparse[i] = (cn_sparse_sample){ .photo = i % 2,
                                            .x = 50,
                                            .y = 50,
                                            .distance_m = front ? 8 + 10.0f * (float)(i % 2) : 3 + (float)(i / 2) * 2 };
        begin(usable, 12, sparse);
        for (uint32_t i = 0; i < CN_SEEN_DIRECTIONS; i++) {
            float d[3];
            cn_seen_direction(i, d);
            if (d[0] > 0.99f && front) assert_float_equal(reach[i], 8, 0.2);
            if (d[0] < 0.95f || !front) assert_true(reach[i] == -INFINITY);
        }
    }
    back_m = 0;
    free(usable);
}

/* Two photos show sky above the horizon, but for a pole as wide as one hint. Cells beside the pole are cleared, those
 * that it crosses are not, nor is anything below. */
static void test_a_pole_before_the_sky_stays(void **state)
{
    (void)state;
    enum { POLE = CN_SKY_HINT_X / 2 };
    const cn_box box = { .half_extent = { 10, 10, 10 } };
    cn_train_photo photos[2] = { along_x(), along_x() };
    uint8_t *hint = malloc(2 * CN_SKY_HINTS), *usable = malloc(CN_OCC_CELLS);
    assert_non_null(hint);
    assert_non_null(usable);
    for (int i = 0; i < 2 * CN_SKY_HINTS; i++)
        hint[i] = i / CN_SKY_HINT_X % CN_SKY_HINT_Y >= CN_SKY_HINT_Y / 2 ? CN_SKY_NONE
                  : i % CN_SKY_HINT_X == POLE                            ? CN_SKY_UNKNOWN
                                                                         : CN_SKY_SHOWN;
    memset(usable, 1, CN_OCC_CELLS);
    cn_sampler sampler = { .n_photos = 2, .photos = photos, .sky_hint = hint };
    assert_int_equal(cn_looks_clear(&sampler, NULL, &box, usable), CN_OK);
    uint32_t cleared = 0, kept = 0;
    for (uint32_t i = 0; i < CN_OCC_CELLS; i++) {
        float x[3];
        cn_occupancy_centre(i, x);
        /* The pole is to the right of the middle: towards -y. A cell of the box is 1/32 wide. */
        const bool crossed = x[0] > 0.1f && x[0] < 1 && x[1] < 0 && x[1] > -1.0f / 32;
        if (x[2] < 0 || crossed) assert_int_equal(usable[i], 1);
        kept += crossed && x[2] > 0;
        cleared += !usable[i];
    }
    assert_true(kept > 100 && cleared > CN_OCC_CELLS / 100);
    free(hint);
    free(usable);
}

/* What one photo alone shows begins at 0.7 of the nearest points of its part of the picture: the left half has points
 * at 4 m, the right half at 9 m. A few points at the top tell nothing, so there the whole photo's nearest ones count.
 */
static void test_one_photo_is_enough_by_parts(void **state)
{
    (void)state;
    enum { EACH = 400, FEW = 3 };
    const cn_box box = { { 0, 0, 0 }, { 10, 10, 10 }, 0.1f, 100, 0.01f };
    static cn_sparse_sample sparse[2 * EACH + FEW];
    for (int i = 0; i < 2 * EACH; i++) {
        const bool left = i < EACH;
        sparse[i] = (cn_sparse_sample){ 0, (uint16_t)(left ? i % 40 : 60 + i % 40), (uint16_t)(50 + i / 40 % 10 * 5),
                                        left ? 4 : 9 };
    }
    for (int i = 0; i < FEW; i++)
        sparse[2 * EACH + i] = (cn_sparse_sample){ 0, (uint16_t)(80 + i), 5, 9 };
    cn_train_photo photos[2] = { along_x(), along_x() };
    photos[1].generator.origin[0] = 1000; /* sees nothing of the box */
    const cn_sampler sampler = { .n_photos = 2, .photos = photos, .sparse = sparse, .n_sparse = 2 * EACH + FEW };
    uint8_t *usable = malloc(CN_OCC_CELLS);
    assert_non_null(usable);
    assert_int_equal(cn_sampler_usable_cells(&sampler, NULL, &box, usable), CN_OK);
    float nearest[3] = { INFINITY, INFINITY, INFINITY }; /* left and right below, right at the top */
    for (uint32_t i = 0; i < CN_OCC_CELLS; i++) {
        float x[3];
        cn_occupancy_centre(i, x);
        const float across = -x[1] / x[0], down = -x[2] / x[0]; /* of the picture, -1 to 1 */
        const bool below = down > 0.2f && down < 1, top = down < -0.7f && down > -1;
        const bool left = across < -0.3f && across > -1, right = across > 0.5f && across < 1;
        const int where = below && left ? 0 : below && right ? 1 : top && right ? 2 : -1;
        if (!usable[i] || !(x[0] > 0) || where < 0) continue;
        const float away = 10 * sqrtf(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
        if (away < nearest[where]) nearest[where] = away;
    }
    free(usable);
    assert_float_equal(nearest[0], 0.7 * 4, 0.2);
    assert_float_equal(nearest[1], 0.7 * 9, 0.2);
    assert_float_equal(nearest[2], 0.7 * 4, 0.3);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_matter_is_a_share_of_the_photos),
        cmocka_unit_test(test_a_place_is_seen_when_one_of_its_cells_is),
        cmocka_unit_test(test_sparse_points_tell_distances),
        cmocka_unit_test(test_a_front_has_a_place),
        cmocka_unit_test(test_a_photo_looks_where_its_frame_is),
        cmocka_unit_test(test_hints_say_where_sky_is),
        cmocka_unit_test(test_a_photo_of_all_directions_looks_everywhere),
        cmocka_unit_test(test_a_pole_before_the_sky_stays),
        cmocka_unit_test(test_one_photo_is_enough_by_parts),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
