/* Depth maps beside the photos: which are found, how they are resized, what is not measured. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "scratch.h"

#include "base/file.h"
#include "photo/store.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* An EXR of these distances. */
static void write_map(scratch *s, const char *name, const float *depth, uint32_t w, uint32_t h)
{
    float *rgba = calloc((size_t)w * h * 4, sizeof *rgba);
    assert_int_equal(cn_oiio_write_exr(scratch_path(s, name), rgba, depth, w, h, NULL), CN_OK);
    free(rgba);
}

static cn_photo_index scan(scratch *s)
{
    cn_photo_index index;
    char *photos = cn_format("%s/photos", s->folder);
    assert_int_equal(cn_photo_index_scan(&s->context, photos, &index), CN_OK);
    free(photos);
    return index;
}

static cn_photo_maps maps_of(scratch *s)
{
    return (cn_photo_maps){ .depth = cn_format("%s/depth", s->folder) };
}

static void depths_are_the_nearest_and_stay_unknown(void **state)
{
    scratch *s = *state;
    scratch_photo(s, "photos/a.png", 1, NULL);
    scratch_photo(s, "photos/b.png", 2, NULL);
    float depth[SCRATCH_W * SCRATCH_H];
    for (int i = 0; i < SCRATCH_W * SCRATCH_H; i++)
        depth[i] = 1 + (float)i;
    depth[0] = depth[1] = depth[SCRATCH_W] = depth[SCRATCH_W + 1] = NAN;
    depth[2] = depth[3] = depth[SCRATCH_W + 2] = depth[SCRATCH_W + 3] = -1;
    depth[4] = depth[5] = depth[SCRATCH_W + 4] = depth[SCRATCH_W + 5] = INFINITY;
    write_map(s, "depth/a.exr", depth, SCRATCH_W, SCRATCH_H);
    cn_photo_index index = scan(s);
    cn_photo_maps maps = maps_of(s);
    cn_pixel_store *store;
    uint32_t n;
    const char *path = scratch_path(s, "work/pixels");
    assert_int_equal(cn_photo_index_find_maps(&index, &maps, &n), CN_OK);
    assert_int_equal(n, 1);
    assert_int_equal(cn_pixel_store_build(&s->context, &index, SCRATCH_W / 2, path), CN_OK);
    assert_int_equal(cn_pixel_store_open(&store, path), CN_OK);
    assert_true(cn_pixel_store_has_depth(store, 0) && !cn_pixel_store_has_depth(store, 1));
    const uint32_t photo[6] = { 0, 0, 0, 0, 0, 1 };
    const uint16_t x[6] = { 0, 1, 2, 3, SCRATCH_W / 2 - 1, 3 }, y[6] = { 0, 0, 0, 0, SCRATCH_H / 2 - 1, 0 };
    float got[6];
    assert_int_equal(cn_pixel_store_gather_depth(store, 6, photo, x, y, got), CN_OK);
    for (int i = 0; i < 3; i++)
        assert_true(got[i] == 0);
    /* Pixel (3, 0) covers 6 and 7 of rows 0 and 1; its middle falls to the last of these. */
    assert_true(got[3] == depth[SCRATCH_W + 7]);
    assert_true(got[4] == depth[SCRATCH_W * SCRATCH_H - 1]);
    assert_true(got[5] == 0);
    cn_pixel_store_close(&store);
    cn_photo_index_deinit(&index);
    free(maps.depth);
}

/* A map that changes is read again; the store without maps has the bytes that it always had. */
static void a_store_follows_its_maps(void **state)
{
    scratch *s = *state;
    scratch_photo(s, "photos/a.png", 1, NULL);
    float depth[SCRATCH_W * SCRATCH_H];
    for (int i = 0; i < SCRATCH_W * SCRATCH_H; i++)
        depth[i] = 5;
    cn_photo_index index = scan(s);
    cn_photo_maps maps = maps_of(s);
    cn_pixel_store *store;
    uint32_t n;
    char *before, *after;
    size_t size_before, size_after;
    const char *path = scratch_path(s, "work/pixels");
    assert_int_equal(cn_pixel_store_build(&s->context, &index, SCRATCH_W, path), CN_OK);
    assert_int_equal(cn_file_read(path, 1 << 24, &before, &size_before), CN_OK);
    for (int turn = 0; turn < 2; turn++, depth[0] = 7) {
        const uint32_t photo = 0;
        const uint16_t zero = 0;
        float got;
        write_map(s, "depth/a.png.exr", depth, SCRATCH_W, SCRATCH_H);
        assert_int_equal(cn_photo_index_find_maps(&index, &maps, &n), CN_OK);
        assert_int_equal(cn_pixel_store_build(&s->context, &index, SCRATCH_W, path), CN_OK);
        assert_int_equal(cn_pixel_store_open(&store, path), CN_OK);
        assert_int_equal(cn_pixel_store_gather_depth(store, 1, &photo, &zero, &zero, &got), CN_OK);
        assert_true(got == depth[0]);
        cn_pixel_store_close(&store);
    }
    const cn_photo_maps none = { 0 };
    assert_int_equal(cn_photo_index_find_maps(&index, &none, &n), CN_OK);
    assert_int_equal(cn_pixel_store_build(&s->context, &index, SCRATCH_W, path), CN_OK);
    assert_int_equal(cn_file_read(path, 1 << 24, &after, &size_after), CN_OK);
    assert_int_equal(size_before, size_after);
    assert_memory_equal(before, after, size_before);
    free(before);
    free(after);
    free(maps.depth);
    cn_photo_index_deinit(&index);
}

static void expect_refused(scratch *s, cn_status wanted, const char *text)
{
    cn_photo_index index = scan(s);
    cn_photo_maps maps = maps_of(s);
    uint32_t n;
    cn_status status = cn_photo_index_find_maps(&index, &maps, &n);
    if (status == CN_OK) status = cn_pixel_store_build(&s->context, &index, SCRATCH_W, scratch_path(s, "work/pixels"));
    assert_int_equal(status, wanted);
    if (!strstr(cn_error_message(), text)) fail_msg("'%s' lacks '%s'", cn_error_message(), text);
    free(maps.depth);
    cn_photo_index_deinit(&index);
}

static void bad_maps_are_named(void **state)
{
    scratch *s = *state;
    float depth[SCRATCH_W * SCRATCH_H];
    for (int i = 0; i < SCRATCH_W * SCRATCH_H; i++)
        depth[i] = NAN;
    scratch_photo(s, "photos/a.png", 1, NULL);
    expect_refused(s, CN_ERR_DATA, "no photo has a depth map");
    write_map(s, "depth/a.exr", depth, SCRATCH_H, SCRATCH_H);
    expect_refused(s, CN_ERR_DATA, "a.exr is 32 x 32 pixels and its photo 48 x 32");
    write_map(s, "whole.exr", depth, SCRATCH_W, SCRATCH_H);
    scratch_copy(s, "whole.exr", "depth/a.exr", 0.6);
    expect_refused(s, CN_ERR_FORMAT, "a.exr");
    unlink(scratch_path(s, "depth/a.exr"));
    scratch_photo(s, "depth/a.png", 1, NULL);
    expect_refused(s, CN_ERR_DATA, "8 bits per value");
    /* A map of NaN alone gives a warning. The photo is used without it. */
    unlink(scratch_path(s, "depth/a.png"));
    write_map(s, "depth/a.exr", depth, SCRATCH_W, SCRATCH_H);
    expect_refused(s, CN_OK, "");
    assert_non_null(strstr(s->logged, "a.exr has no depth above 0"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(depths_are_the_nearest_and_stay_unknown, scratch_set_up, scratch_tear_down),
        cmocka_unit_test_setup_teardown(a_store_follows_its_maps, scratch_set_up, scratch_tear_down),
        cmocka_unit_test_setup_teardown(bad_maps_are_named, scratch_set_up, scratch_tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
