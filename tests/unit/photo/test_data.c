/* The index and the store over a real set: 18 drone photos with GPS. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "scratch.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static char photos[512];

static void brighton_is_indexed_whole(void **state)
{
    scratch *s = *state;
    cn_photo_index index;
    assert_int_equal(cn_photo_index_scan(&s->context, photos, &index), CN_OK);
    assert_int_equal(index.n_photos, 18);
    assert_int_equal(index.n_gps, 18);
    assert_int_equal(index.n_rejects, 0);
    for (uint32_t i = 0; i < index.n_photos; i++) {
        const cn_photo *p = &index.photos[i];
        assert_true(p->width == 2000 && p->height == 1125);
        assert_true(fabs(p->latitude_deg - 46.84) < 0.01 && fabs(p->longitude_deg + 91.99) < 0.01);
        assert_true(p->has_altitude && p->altitude_m > 150 && p->altitude_m < 250);
        assert_true(p->exposure_s > 1 / 600.0 && p->exposure_s < 1 / 250.0);
        assert_true(p->iso == 100 && p->focal_35mm == 20 && fabs(p->f_number - 2.8) < 1e-5);
        assert_true(p->time_s > 1.4e9 && isfinite(cn_photo_exposure_ev(p)));
        assert_string_equal(p->camera, "DJI FC300S");
    }
    const char *path = scratch_path(s, "pixels");
    assert_int_equal(cn_pixel_store_build(&s->context, &index, 500, path), CN_OK);
    cn_pixel_store *store;
    assert_int_equal(cn_pixel_store_open(&store, path), CN_OK);
    assert_int_equal(cn_pixel_store_count(store), 18);
    const cn_pixel_extent e = cn_pixel_store_extent(store, 17);
    assert_true(e.width == 500 && e.height == 281);
    float *rgbw = malloc((size_t)e.width * e.height * 4 * sizeof *rgbw);
    assert_int_equal(cn_pixel_store_read(store, 17, rgbw), CN_OK);
    double mean = 0;
    for (size_t i = 0; i < (size_t)e.width * e.height; i++) {
        assert_float_equal(rgbw[4 * i + 3], 1, 0);
        mean += (double)rgbw[4 * i + 1] / (e.width * e.height);
    }
    assert_true(mean > 0.02 && mean < 0.9);
    free(rgbw);
    cn_pixel_store_close(&store);
    cn_photo_index_deinit(&index);
}

int main(void)
{
    const char *data = getenv("CONURB_DATA");
    snprintf(photos, sizeof photos, "%s/brighton/photos", data && *data ? data : CONURB_SOURCE "/../shared/data");
    if (access(photos, R_OK) != 0) {
        printf("skipped: no photos at %s; set CONURB_DATA\n", photos);
        return 77;
    }
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(brighton_is_indexed_whole, scratch_set_up, scratch_tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
