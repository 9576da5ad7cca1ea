/* Hints of sky that hold something narrower than a hint. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "../common.h"
#include "base/file.h"
#include "bridge/oiio.h"
#include "effect/sky_even.h"
#include "effect/sky_grid.h"

#include <stdlib.h>
#include <string.h>

enum { WIDE = 4 * CN_SKY_HINT_X, HIGH = 3 * CN_SKY_HINT_Y, MAST_X = 402, GRAIN = 8 };

/* A grey sky with grain, and a mast one pixel wide beside the middle of its hint. */
static cn_pixel_store *photo_of_mast(const char *folder)
{
    float *rgb = malloc(sizeof *rgb * 3 * WIDE * HIGH);
    assert_non_null(rgb);
    for (uint32_t i = 0; i < WIDE * HIGH; i++)
        for (uint32_t c = 0; c < 3; c++)
            rgb[3 * i + c] = i % WIDE == MAST_X + 1 ? 0.2f : 0.7f + 0.01f * (float)(i * 7 % GRAIN);
    char *path = cn_path_join(folder, "mast.png"), *store = cn_path_join(folder, "pixels.bin");
    assert_int_equal(cn_oiio_write_png(path, rgb, WIDE, HIGH, 3, NULL), CN_OK);
    const cn_context quiet = { 0 };
    cn_photo_index index = { 0 };
    cn_pixel_store *pixels = NULL;
    assert_int_equal(cn_photo_index_scan(&quiet, folder, &index), CN_OK);
    assert_int_equal(cn_pixel_store_build(&quiet, &index, WIDE, store), CN_OK);
    assert_int_equal(cn_pixel_store_open(&pixels, store), CN_OK);
    cn_photo_index_deinit(&index);
    free(path);
    free(store);
    free(rgb);
    return pixels;
}

static void test_narrow_things(void **state)
{
    (void)state;
    char folder[] = "/tmp/conurb-mast-XXXXXX";
    assert_non_null(mkdtemp(folder));
    cn_pixel_store *pixels = photo_of_mast(folder);
    static uint8_t hint[CN_SKY_HINTS];
    memset(hint, CN_SKY_SHOWN, sizeof hint);
    hint[7] = CN_SKY_NONE;
    cn_sky_even_keep(pixels, 0, hint);
    for (uint32_t i = 0; i < CN_SKY_HINTS; i++) {
        const bool mast = i % CN_SKY_HINT_X == MAST_X / 4;
        assert_int_equal(hint[i], i == 7 ? CN_SKY_NONE : mast ? CN_SKY_UNKNOWN : CN_SKY_SHOWN);
    }
    cn_pixel_store_close(&pixels);
    assert_int_equal(folder_remove(folder), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_narrow_things) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
