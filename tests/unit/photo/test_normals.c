/* Normal maps beside the photos: how they are read and stored, and which faults are named. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "png16.h"
#include "scratch.h"

#include "base/file.h"
#include "photo/store.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { PIXELS = SCRATCH_W * SCRATCH_H };

/* A normal of the map's own axes that differs from pixel to pixel; always towards an OpenGL camera. */
static void true_normal(uint32_t x, uint32_t y, double n[3])
{
    n[0] = 0.02 * x - 0.4;
    n[1] = 0.5 - 0.03 * y;
    n[2] = sqrt(1 - n[0] * n[0] - n[1] * n[1]);
}

typedef enum kind { PNG_8, PNG_16, EXR } kind;

/* Writes the map of true normals. The first pixel has none; the second has alpha 0 in a PNG, and is not finite in an
 * EXR. sign: -1 turns the normals about x, which makes OpenGL's axes OpenCV's. */
static void write_normals(scratch *s, const char *name, kind k, double sign)
{
    static float rgba[4 * PIXELS];
    static uint16_t wide[4 * PIXELS];
    for (uint32_t i = 0; i < PIXELS; i++) {
        double n[3];
        true_normal(i % SCRATCH_W, i / SCRATCH_W, n);
        for (int c = 0; c < 3; c++) {
            const double v = c ? sign * n[c] : n[c];
            rgba[4 * i + (uint32_t)c] = (float)(k == EXR ? v : 0.5 * v + 0.5);
        }
        rgba[4 * i + 3] = 1;
    }
    memset(rgba, 0, 3 * sizeof *rgba);
    rgba[7] = k == EXR ? 1 : 0;
    for (int i = 0; i < 4 * PIXELS; i++)
        wide[i] = (uint16_t)lroundf(65535 * rgba[i]);
    const char *path = scratch_path(s, name);
    if (k == PNG_8) assert_int_equal(cn_oiio_write_png(path, rgba, SCRATCH_W, SCRATCH_H, 4, NULL), CN_OK);
    if (k == PNG_16) assert_true(png16_write(path, wide, SCRATCH_W, SCRATCH_H));
    if (k != EXR) return;
    rgba[5] = NAN;
    assert_int_equal(cn_oiio_write_exr(path, rgba, NULL, SCRATCH_W, SCRATCH_H, NULL), CN_OK);
}

static cn_photo_index scan(scratch *s)
{
    cn_photo_index index;
    char *photos = cn_format("%s/photos", s->folder);
    assert_int_equal(cn_photo_index_scan(&s->context, photos, &index), CN_OK);
    free(photos);
    return index;
}

static cn_status build(scratch *s, cn_photo_index *index, cn_normal_axes axes, bool depth, uint32_t width)
{
    cn_photo_maps maps = { .normal = cn_format("%s/normal", s->folder), .normal_axes = axes };
    if (depth) maps.depth = cn_format("%s/depth", s->folder);
    uint32_t n;
    cn_status status = cn_photo_index_find_maps(index, &maps, &n);
    if (status == CN_OK) status = cn_pixel_store_build(&s->context, index, width, scratch_path(s, "work/pixels"));
    free(maps.normal);
    free(maps.depth);
    return status;
}

static uint16_t version_of(scratch *s)
{
    char *bytes;
    size_t size;
    uint16_t version;
    assert_int_equal(cn_file_read(scratch_path(s, "work/pixels"), 1 << 24, &bytes, &size), CN_OK);
    memcpy(&version, bytes + 14, sizeof version);
    free(bytes);
    return version;
}

/* Compares the store with the true normals, in the camera's axes. */
static void expect_normals(scratch *s, double tolerance)
{
    cn_pixel_store *store;
    assert_int_equal(cn_pixel_store_open(&store, scratch_path(s, "work/pixels")), CN_OK);
    assert_true(cn_pixel_store_has_normal(store, 0) && !cn_pixel_store_has_normal(store, 1));
    for (uint32_t i = 0; i < PIXELS; i++) {
        const uint32_t photo[2] = { 0, 1 };
        const uint16_t x[2] = { (uint16_t)(i % SCRATCH_W), 0 }, y[2] = { (uint16_t)(i / SCRATCH_W), 0 };
        float got[6];
        double n[3];
        assert_int_equal(cn_pixel_store_gather_normal(store, 2, photo, x, y, got), CN_OK);
        true_normal(x[0], y[0], n);
        for (int c = 0; c < 3; c++) {
            const double want = i < 2 ? 0 : c ? -n[c] : n[c];
            if (fabs((double)got[c] - want) > tolerance)
                fail_msg("pixel %u, component %d is %g, not %g", i, c, (double)got[c], want);
            assert_true(got[3 + c] == 0);
        }
    }
    cn_pixel_store_close(&store);
}

static void normals_of_every_format_are_read(void **state)
{
    static const char *const names[] = { "normal/a.png", "normal/a.png", "normal/a.exr" };
    static const double tolerance[] = { 0.009, 0.0045, 0.0045 };
    scratch *s = *state;
    scratch_photo(s, "photos/a.png", 1, NULL);
    scratch_photo(s, "photos/b.png", 2, NULL);
    for (kind k = PNG_8; k <= EXR; k++)
        for (int opencv = 0; opencv < 2; opencv++) {
            cn_photo_index index = scan(s);
            unlink(scratch_path(s, "normal/a.png"));
            write_normals(s, names[k], k, opencv ? -1 : 1);
            assert_int_equal(build(s, &index, opencv ? CN_NORMAL_OPENCV : CN_NORMAL_OPENGL, false, SCRATCH_W), CN_OK);
            expect_normals(s, tolerance[k]);
            assert_int_equal(version_of(s), 4);
            cn_photo_index_deinit(&index);
        }
    assert_null(strstr(s->logged, "normal"));
}

/* Both kinds of maps beside one photo, at half its width. */
static void depths_and_normals_stand_side_by_side(void **state)
{
    scratch *s = *state;
    static float depth[PIXELS], rgba[4 * PIXELS];
    for (int i = 0; i < PIXELS; i++)
        depth[i] = 5;
    scratch_photo(s, "photos/a.png", 1, NULL);
    assert_int_equal(cn_oiio_write_exr(scratch_path(s, "depth/a.exr"), rgba, depth, SCRATCH_W, SCRATCH_H, NULL), CN_OK);
    write_normals(s, "normal/a.exr", EXR, 1);
    cn_photo_index index = scan(s);
    assert_int_equal(build(s, &index, CN_NORMAL_OPENGL, true, SCRATCH_W / 2), CN_OK);
    cn_pixel_store *store;
    assert_int_equal(cn_pixel_store_open(&store, scratch_path(s, "work/pixels")), CN_OK);
    for (uint32_t i = 0; i < PIXELS / 4; i++) {
        const uint32_t photo = 0;
        const uint16_t x = (uint16_t)(i % (SCRATCH_W / 2)), y = (uint16_t)(i / (SCRATCH_W / 2));
        float metres, got[3];
        double n[3];
        assert_int_equal(cn_pixel_store_gather_depth(store, 1, &photo, &x, &y, &metres), CN_OK);
        assert_int_equal(cn_pixel_store_gather_normal(store, 1, &photo, &x, &y, got), CN_OK);
        assert_true(metres == 5);
        true_normal(2 * x + 1u, 2 * y + 1u, n);
        assert_true(fabs((double)got[0] - n[0]) < 0.0045 && fabs((double)got[2] + n[2]) < 0.0045);
    }
    cn_pixel_store_close(&store);
    cn_photo_index_deinit(&index);
}

/* Other axes or another map are read again. A store without normal maps has the bytes that it always had. */
static void a_store_follows_its_normals(void **state)
{
    scratch *s = *state;
    char *before, *after;
    size_t size_before, size_after;
    scratch_photo(s, "photos/a.png", 1, NULL);
    cn_photo_index index = scan(s);
    const char *path = scratch_path(s, "work/pixels");
    assert_int_equal(cn_pixel_store_build(&s->context, &index, SCRATCH_W, path), CN_OK);
    assert_int_equal(cn_file_read(path, 1 << 24, &before, &size_before), CN_OK);
    for (int turn = 0; turn < 3; turn++) {
        const uint32_t photo = 0;
        const uint16_t at = 7;
        cn_pixel_store *store;
        float got[3];
        double n[3];
        true_normal(at, at, n);
        write_normals(s, "normal/a.exr", EXR, turn < 2 ? 1 : -1);
        assert_int_equal(build(s, &index, turn ? CN_NORMAL_OPENCV : CN_NORMAL_OPENGL, false, SCRATCH_W), CN_OK);
        assert_int_equal(cn_pixel_store_open(&store, scratch_path(s, "work/pixels")), CN_OK);
        assert_int_equal(cn_pixel_store_gather_normal(store, 1, &photo, &at, &at, got), CN_OK);
        assert_true(fabs((double)got[2] - (turn == 1 ? n[2] : -n[2])) < 0.0045);
        cn_pixel_store_close(&store);
    }
    assert_non_null(strstr(s->logged, "most normals point away from the camera, and such are not used; "
                                      "photos.normal_axes may have to be opengl"));
    const cn_photo_maps none = { 0 };
    uint32_t n;
    assert_int_equal(cn_photo_index_find_maps(&index, &none, &n), CN_OK);
    path = scratch_path(s, "work/pixels");
    assert_int_equal(cn_pixel_store_build(&s->context, &index, SCRATCH_W, path), CN_OK);
    assert_int_equal(cn_file_read(path, 1 << 24, &after, &size_after), CN_OK);
    assert_int_equal(size_before, size_after);
    assert_memory_equal(before, after, size_before);
    free(before);
    free(after);
    cn_photo_index_deinit(&index);
}

static void expect_refused(scratch *s, cn_status wanted, const char *text)
{
    cn_photo_index index = scan(s);
    assert_int_equal(build(s, &index, CN_NORMAL_OPENGL, false, SCRATCH_W), wanted);
    if (!strstr(cn_error_message(), text)) fail_msg("'%s' lacks '%s'", cn_error_message(), text);
    cn_photo_index_deinit(&index);
}

static void bad_maps_are_named(void **state)
{
    scratch *s = *state;
    static float black[4 * PIXELS];
    for (int i = 0; i < PIXELS; i++)
        black[4 * i + 3] = 1;
    scratch_photo(s, "photos/a.png", 1, NULL);
    expect_refused(s, CN_ERR_DATA, "photos.normal: no photo has a normal map");
    assert_int_equal(cn_oiio_write_exr(scratch_path(s, "normal/a.exr"), black, NULL, SCRATCH_H, SCRATCH_H, NULL),
                     CN_OK);
    expect_refused(s, CN_ERR_DATA, "a.exr is 32 x 32 pixels and its photo 48 x 32");
    write_normals(s, "whole.exr", EXR, 1);
    scratch_copy(s, "whole.exr", "normal/a.exr", 0.6);
    expect_refused(s, CN_ERR_FORMAT, "a.exr");
    unlink(scratch_path(s, "normal/a.exr"));
    assert_int_equal(cn_oiio_write_png(scratch_path(s, "normal/a.png"), black, SCRATCH_W, SCRATCH_H, 1, NULL), CN_OK);
    expect_refused(s, CN_ERR_DATA, "a.png has 1 channels per pixel; give the normal's x, y and z");
    /* Nothing but black is a warning: such a photo has its colours still. */
    assert_int_equal(cn_oiio_write_png(scratch_path(s, "normal/a.png"), black, SCRATCH_W, SCRATCH_H, 4, NULL), CN_OK);
    expect_refused(s, CN_OK, "");
    assert_non_null(strstr(s->logged, "a.png has no normal"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(normals_of_every_format_are_read, scratch_set_up, scratch_tear_down),
        cmocka_unit_test_setup_teardown(depths_and_normals_stand_side_by_side, scratch_set_up, scratch_tear_down),
        cmocka_unit_test_setup_teardown(a_store_follows_its_normals, scratch_set_up, scratch_tear_down),
        cmocka_unit_test_setup_teardown(bad_maps_are_named, scratch_set_up, scratch_tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
