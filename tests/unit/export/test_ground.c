/* The ground model of a surface whose ground is known: a slope with a house, trees, a hole and a wrong low spot. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/file.h"
#include "export/geotiff.h"

#include "conurb/export.h"

#include <gdal.h>
#include <math.h>
#include <ogr_srs_api.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { SIDE = 400 };
#define PIXEL_M 0.5

static char folder[] = "/tmp/conurb_ground_XXXXXX";
static char *dsm, *dtm;
static cn_frame frame;
static cn_survey survey = { .frame = &frame };

static float slope_at(int x, int y)
{
    return 100 + 0.05f * (float)PIXEL_M * (float)x + 0.02f * (float)PIXEL_M * (float)y;
}

/* How far the surface lies above the ground; NaN: nothing was seen. */
static float above(int x, int y)
{
    if (x >= 100 && x < 180 && y >= 120 && y < 200) return 12;               /* a house of 40 m */
    if (hypot(x - 250, y - 90) < 8 || hypot(x - 300, y - 250) < 6) return 7; /* trees */
    if (x >= 40 && x < 44 && y >= 300 && y < 309) return 1.6f;               /* a car */
    if (x >= 220 && x < 240 && y >= 320 && y < 330) return NAN;              /* a hole */
    if (x >= 350 && x < 353 && y >= 60 && y < 63) return -9;                 /* an error */
    return 0;
}

static int begin(void **state)
{
    (void)state;
    if (!mkdtemp(folder)) return -1;
    dsm = cn_path_join(folder, "dsm.tif");
    dtm = cn_path_join(folder, "dtm.tif");
    cn_frame_init(&frame);
    const char *const metadata[] = { NULL };
    const cn_geotiff_header header = { false, SIDE, SIDE, { 32632, 691500, 5334800, PIXEL_M }, metadata, NULL };
    cn_geotiff tiff;
    float row[SIDE];
    if (cn_geotiff_open(&tiff, NULL, dsm, &header) != CN_OK) return -1;
    for (int y = 0; y < SIDE; y++) {
        for (int x = 0; x < SIDE; x++)
            row[x] = isnan(above(x, y)) ? CN_GEOTIFF_NODATA : slope_at(x, y) + above(x, y);
        if (cn_geotiff_write(&tiff, (uint32_t)y, 1, row) != CN_OK) return -1;
    }
    return cn_geotiff_finish(&tiff) == CN_OK ? 0 : -1;
}

static int end(void **state)
{
    (void)state;
    unlink(dsm);
    unlink(dtm);
    free(dsm);
    free(dtm);
    return rmdir(folder);
}

static void houses_and_trees_are_gone(void **state)
{
    (void)state;
    const cn_ground_task task = { &survey, dsm, dtm, 60 };
    assert_int_equal(cn_export_ground(NULL, &task), CN_OK);
    GDALDatasetH d = GDALOpen(dtm, GA_ReadOnly);
    assert_non_null(d);
    double t[6];
    assert_int_equal(GDALGetGeoTransform(d, t), CE_None);
    assert_true(t[0] == 691500 && t[3] == 5334800 && t[1] == PIXEL_M);
    assert_string_equal(OSRGetAuthorityCode(GDALGetSpatialRef(d), NULL), "32632");
    assert_string_equal(GDALGetMetadataItem(d, "LAYOUT", "IMAGE_STRUCTURE"), "COG");
    assert_non_null(strstr(GDALGetMetadataItem(d, "GROUND", NULL), "Zhang"));
    GDALRasterBandH band = GDALGetRasterBand(d, 1);
    assert_string_equal(GDALGetDescription(band), "ground height");
    float *z = malloc(sizeof(float[SIDE][SIDE]));
    assert_int_equal(GDALRasterIO(band, GF_Read, 0, 0, SIDE, SIDE, z, SIDE, SIDE, GDT_Float32, 0, 0), CE_None);
    double worst = 0, open = 0;
    for (int y = 0; y < SIDE; y++)
        for (int x = 0; x < SIDE; x++) {
            const float at = z[y * SIDE + x];
            if (isnan(above(x, y))) {
                assert_true(at == CN_GEOTIFF_NODATA);
                continue;
            }
            const double off = fabs((double)(at - slope_at(x, y)));
            worst = fmax(worst, off);
            if (!(above(x, y) > 0) && !(above(x, y) < 0)) open = fmax(open, off);
        }
    print_message("off by %.3f m at most, %.3f m in the open\n", worst, open);
    assert_true(worst < 0.4 && open < 0.05);
    free(z);
    GDALClose(d);
}

static void what_is_no_surface_model(void **state)
{
    (void)state;
    cn_ground_task task = { &survey, "/nonexistent/dsm.tif", dtm, 60 };
    assert_int_equal(cn_export_ground(NULL, &task), CN_ERR_FORMAT);
    assert_non_null(strstr(cn_error_message(), "/nonexistent/dsm.tif"));
    task.dsm = dsm;
    task.widest_m = 0;
    assert_int_equal(cn_export_ground(NULL, &task), CN_ERR_USAGE);
    task.widest_m = 60;
    task.dtm = "/nonexistent/dtm.tif";
    assert_int_equal(cn_export_ground(NULL, &task), CN_ERR_IO);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(houses_and_trees_are_gone),
        cmocka_unit_test(what_is_no_surface_model),
    };
    return cmocka_run_group_tests(tests, begin, end);
}
