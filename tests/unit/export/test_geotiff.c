#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../common.h"
#include "base/file.h"
#include "export/geotiff.h"

#include <gdal.h>
#include <math.h>
#include <ogr_srs_api.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 700, HEIGHT = 600 };

static char folder[] = "/tmp/conurb_geotiff_XXXXXX";
static const cn_geotiff_place somewhere = { 32615, 576647.5, 5188233.25, 0.25 }, nowhere = { 0, -10, 20, 0.5 };
static const char *const metadata[] = { "HEIGHTS", "metres above the ellipsoid", NULL };

static int make_folder(void **state)
{
    (void)state;
    return mkdtemp(folder) ? 0 : -1;
}

static int remove_folder(void **state)
{
    (void)state;
    return folder_remove(folder);
}

/* Whether anything but the named files is left in the folder. */
static int files_left(void)
{
    char *command = cn_format("test $(ls -A %s | wc -l) = 0", folder);
    const int status = system(command);
    free(command);
    return status;
}

static void an_orthophoto(void **state)
{
    (void)state;
    char *path = cn_format("%s/ortho.tif", folder);
    cn_geotiff tiff;
    uint8_t *row = calloc(WIDTH, 4);
    assert_int_equal(
        cn_geotiff_open(&tiff, NULL, path, &(cn_geotiff_header){ true, WIDTH, HEIGHT, somewhere, metadata, NULL }),
        CN_OK);
    for (uint32_t y = 0; y < HEIGHT; y++) {
        for (uint32_t x = 0; x < WIDTH; x++) {
            row[4 * x] = (uint8_t)x;
            row[4 * x + 1] = (uint8_t)y;
            row[4 * x + 3] = x < 650 ? 255 : 0;
        }
        assert_int_equal(cn_geotiff_write(&tiff, y, 1, row), CN_OK);
    }
    assert_int_equal(cn_geotiff_finish(&tiff), CN_OK);
    cn_geotiff_abort(&tiff); /* safe after finish */
    GDALDatasetH d = GDALOpen(path, GA_ReadOnly);
    assert_non_null(d);
    double t[6];
    assert_int_equal(GDALGetGeoTransform(d, t), CE_None);
    assert_true(t[0] == 576647.5 && t[1] == 0.25 && t[3] == 5188233.25 && t[5] == -0.25 && t[2] == 0 && t[4] == 0);
    assert_string_equal(OSRGetAuthorityCode(GDALGetSpatialRef(d), NULL), "32615");
    assert_string_equal(GDALGetMetadataItem(d, "LAYOUT", "IMAGE_STRUCTURE"), "COG");
    assert_string_equal(GDALGetMetadataItem(d, "HEIGHTS", NULL), "metres above the ellipsoid");
    assert_int_equal(GDALGetRasterCount(d), 4);
    assert_int_equal(GDALGetRasterColorInterpretation(GDALGetRasterBand(d, 4)), GCI_AlphaBand);
    assert_true(GDALGetOverviewCount(GDALGetRasterBand(d, 1)) >= 1);
    uint8_t pixel[4];
    assert_int_equal(GDALDatasetRasterIO(d, GF_Read, 201, 302, 1, 1, pixel, 1, 1, GDT_Byte, 4, NULL, 1, 1, 1), CE_None);
    assert_true(pixel[0] == 201 && pixel[1] == 302 % 256 && pixel[2] == 0 && pixel[3] == 255);
    GDALClose(d);
    remove(path);
    assert_int_equal(files_left(), 0);
    free(row);
    free(path);
}

static void a_surface_model_without_crs(void **state)
{
    (void)state;
    char *path = cn_format("%s/dsm.tif", folder);
    cn_geotiff tiff;
    float *rows = malloc((size_t)WIDTH * HEIGHT * sizeof *rows);
    for (size_t i = 0; i < (size_t)WIDTH * HEIGHT; i++)
        rows[i] = i % 7 ? (float)i * 0.01f : CN_GEOTIFF_NODATA;
    assert_int_equal(
        cn_geotiff_open(&tiff, NULL, path, &(cn_geotiff_header){ false, WIDTH, HEIGHT, nowhere, metadata, NULL }),
        CN_OK);
    assert_int_equal(cn_geotiff_write(&tiff, 0, HEIGHT, rows), CN_OK);
    assert_int_equal(cn_geotiff_finish(&tiff), CN_OK);
    GDALDatasetH d = GDALOpen(path, GA_ReadOnly);
    assert_non_null(d);
    assert_null(GDALGetSpatialRef(d));
    GDALRasterBandH band = GDALGetRasterBand(d, 1);
    int has = 0;
    assert_true(GDALGetRasterNoDataValue(band, &has) == -9999 && has);
    assert_string_equal(GDALGetRasterUnitType(band), ""); /* of the poses: not known */
    float value;
    assert_int_equal(GDALRasterIO(band, GF_Read, 10, 20, 1, 1, &value, 1, 1, GDT_Float32, 0, 0), CE_None);
    assert_true(fabsf(value - 0.01f * (20 * WIDTH + 10)) < 1e-3f);
    GDALClose(d);
    remove(path);
    free(rows);
    free(path);
}

static void what_fails_leaves_the_old_file(void **state)
{
    (void)state;
    cn_geotiff tiff;
    assert_int_equal(cn_geotiff_open(&tiff, NULL, "/nonexistent/o.tif",
                                     &(cn_geotiff_header){ true, 8, 8, somewhere, metadata, NULL }),
                     CN_ERR_IO);
    assert_non_null(strstr(cn_error_message(), "/nonexistent/o.tif"));
    cn_geotiff_abort(&tiff);
    char *path = cn_format("%s/old.tif", folder), *text;
    size_t size;
    assert_int_equal(cn_file_write(path, "old", 3), CN_OK);
    int stop = 0;
    cn_context ctx = { .stop = &stop };
    uint8_t pixels[16 * 16 * 4] = { 0 };
    assert_int_equal(
        cn_geotiff_open(&tiff, &ctx, path, &(cn_geotiff_header){ true, 16, 16, somewhere, metadata, NULL }), CN_OK);
    assert_int_equal(cn_geotiff_write(&tiff, 0, 16, pixels), CN_OK);
    stop = 1;
    assert_int_equal(cn_geotiff_finish(&tiff), CN_ERR_INTERRUPTED);
    assert_int_equal(cn_file_read(path, 0, &text, &size), CN_OK);
    assert_string_equal(text, "old");
    free(text);
    remove(path);
    assert_int_equal(files_left(), 0);
    free(path);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_orthophoto),
        cmocka_unit_test(a_surface_model_without_crs),
        cmocka_unit_test(what_fails_leaves_the_old_file),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
