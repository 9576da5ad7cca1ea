/* Exports of a town whose shape is known. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/file.h"
#include "conurb/export.h"
#include "town.h"

#include <gdal.h>
#include <math.h>
#include <ogr_srs_api.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static town t;
static cn_survey *survey = &t.survey;
static char *ortho, *dsm, *ply, *las;

static int begin(void **state)
{
    (void)state;
    cn_colour *colour;
    if (town_init(&t) != CN_OK || cn_colour_create(&colour, "") != CN_OK) return -1;
    survey->colour = colour;
    ortho = cn_path_join(t.folder, "ortho.tif");
    dsm = cn_path_join(t.folder, "dsm.tif");
    ply = cn_path_join(t.folder, "points.ply");
    las = cn_path_join(t.folder, "points.las");
    return 0;
}

static int end(void **state)
{
    (void)state;
    cn_colour *colour = (cn_colour *)(uintptr_t)survey->colour;
    cn_colour_destroy(&colour);
    town_deinit(&t);
    char *const names[] = { ortho, dsm, ply, las };
    for (int i = 0; i < 4; i++)
        free(names[i]);
    return 0;
}

static double truth(double x, double y)
{
    return town_has(x, y, (TOWN_GROUND + TOWN_ROOF) / 2) ? TOWN_ROOF : TOWN_GROUND;
}

/* Away from the block's walls. */
static bool clear_of_walls(double x, double y)
{
    return town_has(x - TOWN_CELL, y - TOWN_CELL, -2) == town_has(x + TOWN_CELL, y + TOWN_CELL, -2) &&
           town_has(x - TOWN_CELL, y + TOWN_CELL, -2) == town_has(x + TOWN_CELL, y - TOWN_CELL, -2);
}

static void samples_find_ground_and_roof(void **state)
{
    (void)state;
    double xy[400][2], z[400], both[400];
    for (int i = 0; i < 400; i++) {
        xy[i][0] = -3.9 + 0.4 * (i % 20);
        xy[i][1] = -3.9 + 0.4 * (double)(i / 20);
    }
    assert_int_equal(cn_export_heights(NULL, survey, 400, (const double(*)[2])xy, z), CN_OK);
    for (int i = 0; i < 400; i++)
        if (clear_of_walls(xy[i][0], xy[i][1])) assert_true(fabs(z[i] - truth(xy[i][0], xy[i][1])) < TOWN_CELL);
    /* The same tile twice, blended, is that tile. */
    survey->n_tiles = 2;
    assert_int_equal(cn_export_heights(NULL, survey, 400, (const double(*)[2])xy, both), CN_OK);
    survey->n_tiles = 1;
    for (int i = 0; i < 400; i++)
        assert_true(fabs(both[i] - z[i]) < 1e-5);
    const double far_off[2][2] = { { 50, 0 }, { 0, 5.9 } }; /* out of reach; in reach, but in no photo */
    assert_int_equal(cn_export_heights(NULL, survey, 1, far_off, z), CN_OK);
    assert_true(isnan(z[0]));
}

/* Where GDAL puts a pixel's centre, in the frame. */
static void local_of(const cn_raster_report *report, uint32_t pixel, double local[3])
{
    double x = report->left_m + report->gsd_m * (pixel % report->width + 0.5);
    double y = report->top_m - report->gsd_m * (pixel / report->width + 0.5);
    local[0] = x;
    local[1] = y;
    if (!report->epsg) return;
    OGRSpatialReferenceH utm = OSRNewSpatialReference(NULL), wgs84 = OSRNewSpatialReference(NULL);
    assert_true(OSRImportFromEPSG(utm, report->epsg) == OGRERR_NONE && OSRImportFromEPSG(wgs84, 4326) == OGRERR_NONE);
    OSRSetAxisMappingStrategy(utm, OAMS_TRADITIONAL_GIS_ORDER);
    OSRSetAxisMappingStrategy(wgs84, OAMS_TRADITIONAL_GIS_ORDER);
    OGRCoordinateTransformationH to = OCTNewCoordinateTransformation(utm, wgs84);
    assert_true(to && OCTTransform(to, 1, &x, &y, NULL));
    const double place[3] = { y, x, t.frame.height_m };
    assert_int_equal(cn_frame_from_geodetic(&t.frame, place, local), CN_OK);
    OCTDestroyCoordinateTransformation(to);
    OSRDestroySpatialReference(utm);
    OSRDestroySpatialReference(wgs84);
}

/* Every pixel of the surface model equals the height sample at its place. */
static void check_heights(const cn_raster_report *report)
{
    GDALDatasetH d = GDALOpen(dsm, GA_ReadOnly);
    assert_non_null(d);
    const uint32_t n = report->width * report->height;
    assert_true(GDALGetRasterXSize(d) == (int)report->width && GDALGetRasterYSize(d) == (int)report->height);
    float *heights = malloc(n * sizeof *heights);
    assert_int_equal(GDALRasterIO(GDALGetRasterBand(d, 1), GF_Read, 0, 0, (int)report->width, (int)report->height,
                                  heights, (int)report->width, (int)report->height, GDT_Float32, 0, 0),
                     CE_None);
    assert_string_equal(GDALGetRasterUnitType(GDALGetRasterBand(d, 1)), report->epsg ? "metre" : "");
    GDALClose(d);
    uint64_t covered = 0;
    const double base = report->epsg ? t.frame.height_m : 0;
    for (uint32_t i = 0; i < n; i++) {
        covered += heights[i] != -9999;
        if (heights[i] == -9999 || i % 13) continue;
        double local[3], z;
        local_of(report, i, local);
        assert_int_equal(cn_export_heights(NULL, survey, 1, (const double(*)[2])local, &z), CN_OK);
        assert_true(fabs(base + z - heights[i]) < 0.01);
        if (clear_of_walls(local[0], local[1])) assert_true(fabs(z - truth(local[0], local[1])) < TOWN_CELL);
    }
    assert_int_equal(covered, report->covered);
    free(heights);
}

static void rasters_in_local_metres(void **state)
{
    (void)state;
    cn_raster_report report;
    const cn_raster_options options = { ortho, dsm, 0.1 };
    assert_int_equal(cn_export_rasters(NULL, survey, &options, &report), CN_OK);
    assert_int_equal(report.epsg, 0);
    assert_true(report.covered > 500);
    check_heights(&report);
    GDALDatasetH d = GDALOpen(ortho, GA_ReadOnly);
    assert_non_null(d);
    assert_null(GDALGetSpatialRef(d));
    uint8_t p[4];
    const int x = (int)((0 - report.left_m) / 0.1), y = (int)((report.top_m - 0) / 0.1);
    assert_int_equal(GDALDatasetRasterIO(d, GF_Read, x, y, 1, 1, p, 1, 1, GDT_Byte, 4, NULL, 1, 1, 1), CE_None);
    assert_true(p[3] == 255 && p[0] > p[1] + 40 && p[0] > p[2] + 40); /* red */
    GDALClose(d);
}

static void rasters_on_earth(void **state)
{
    (void)state;
    cn_raster_report report;
    const cn_raster_options options = { NULL, dsm, 0.1 };
    town_place(&t);
    const cn_status status = cn_export_rasters(NULL, survey, &options, &report);
    assert_int_equal(status, CN_OK);
    assert_int_equal(report.epsg, 32632);
    check_heights(&report);
    t.frame.georeferenced = false;
    /* The frame's origin, where PROJ's own programs put it. */
    assert_true(fabs(report.left_m - 465270.423) < 6.1 && fabs(report.top_m - 5246384.776) < 6.1);
}

static void points_with_their_frame(void **state)
{
    (void)state;
    uint64_t n;
    assert_int_equal(cn_export_points(NULL, survey, ply, 0.1, &n), CN_OK);
    char *data, *body;
    size_t size;
    unsigned long long told;
    assert_int_equal(cn_file_read(ply, 0, &data, &size), CN_OK);
    assert_int_equal(strncmp(data, "ply\nformat binary_little_endian 1.0\n", 36), 0);
    body = strstr(data, "end_header\n") + strlen("end_header\n");
    assert_int_equal(sscanf(strstr(data, "element vertex"), "element vertex %llu", &told), 1);
    assert_true(told == n && n > 200);
    assert_int_equal(size, (size_t)(body - data) + 27 * n);
    uint64_t roof = 0;
    for (uint64_t i = 0; i < n; i++) {
        double p[3];
        memcpy(p, body + 27 * i, sizeof p);
        const uint8_t *rgb = (const uint8_t *)body + 27 * i + 24;
        assert_true(rgb[0] > rgb[1] + 40 && rgb[0] > rgb[2] + 40);
        assert_true(!town_has(p[0], p[1], p[2] + 1.5 * TOWN_CELL) ||
                    !clear_of_walls(p[0], p[1])); /* on the surface, not in it */
        assert_true(p[2] < TOWN_ROOF + TOWN_CELL);
        roof += p[2] > TOWN_ROOF - TOWN_CELL;
    }
    assert_true(roof > 100 && roof < n / 2);
    free(data);
    char *frame = cn_path_join(t.folder, "points.frame.json");
    assert_true(cn_file_exists(frame));
    free(frame);
}

static double real_at(const char *bytes)
{
    double value;
    memcpy(&value, bytes, sizeof value);
    return value;
}

static int32_t whole_at(const char *bytes)
{
    int32_t value;
    memcpy(&value, bytes, sizeof value);
    return value;
}

/* Every point of the LAS file lies where the same point of the PLY file is on Earth. */
static void las_on_earth(void **state)
{
    (void)state;
    uint64_t n, again;
    town_place(&t);
    survey->light = "noon\nof May";
    assert_int_equal(cn_export_points(NULL, survey, ply, 0.1, &n), CN_OK);
    assert_int_equal(cn_export_points(NULL, survey, las, 0.1, &again), CN_OK);
    char *p, *l;
    size_t size;
    assert_int_equal(cn_file_read(ply, 0, &p, &size), CN_OK);
    assert_int_equal(cn_file_read(las, 0, &l, &size), CN_OK);
    assert_memory_equal(l, "LASF", 4);
    assert_true(n == again && l[24] == 1 && l[25] == 4 && l[104] == 7 && whole_at(l + 247) == (int32_t)n);
    const char *from = strstr(p, "end_header\n") + strlen("end_header\n"), *to = l + whole_at(l + 96);
    assert_int_equal(size, (size_t)(to - l) + 36 * n);
    assert_memory_equal(l + 375 + 54, "PROJCS[\"WGS 84 / UTM zone 32N\"", 30);
    for (const char *c = l; c < to; c++)
        if (strncmp(c, "light: noon of May\n", 19) == 0) l[0] = 0;
    assert_int_equal(l[0], 0); /* found */
    double worst = 0;
    for (uint64_t i = 0; i < n; i++, from += 27, to += 36) {
        const double local[3] = { real_at(from), real_at(from + 8), real_at(from + 16) };
        double place[3];
        town_utm(&t, local, place);
        for (int k = 0; k < 3; k++) {
            const double at = real_at(l + 155 + 8 * k) + real_at(l + 131 + 8 * k) * whole_at(to + 4 * k);
            worst = fmax(worst, fabs(at - place[k]));
            assert_true(at <= real_at(l + 179 + 16 * k) && at >= real_at(l + 187 + 16 * k));
        }
        assert_int_equal((uint8_t)from[24], (uint8_t)to[30]); /* red */
        assert_int_equal((uint8_t)to[31], (uint8_t)to[30]);
    }
    assert_true(worst < 0.00051);
    free(p);
    free(l);
    t.frame.georeferenced = false;
    assert_int_equal(cn_export_points(NULL, survey, las, 0.1, &n), CN_OK);
    assert_int_equal(cn_file_read(las, 0, &l, &size), CN_OK);
    assert_true(whole_at(l + 100) == 1 && real_at(l + 155) == 0); /* no coordinate system, local units */
    assert_memory_equal(l + 375 + 2, "LASF_Spec", 9);
    free(l);
    assert_int_equal(cn_export_points(NULL, survey, "points.laz", 0.1, &n), CN_ERR_USAGE);
    assert_int_equal(cn_export_points(NULL, survey, "/nonexistent/p.las", 0.5, NULL), CN_ERR_IO);
}

static void count_report(void *user, const cn_progress_report *r)
{
    (void)r;
    ++*(int *)user;
}

/* The second file's folder is missing: nothing is rendered for the first one. */
static void files_are_checked_first(void **state)
{
    (void)state;
    int reports = 0;
    const cn_context ctx = { .progress = count_report, .user = &reports };
    const cn_raster_options lost = { ortho, "/nonexistent/d.tif", 0.5 }, folder = { t.folder, NULL, 0.5 };
    assert_int_equal(cn_export_rasters(&ctx, survey, &lost, NULL), CN_ERR_IO);
    assert_non_null(strstr(cn_error_message(), "/nonexistent/d.tif"));
    assert_int_equal(cn_export_rasters(&ctx, survey, &folder, NULL), CN_ERR_IO);
    assert_int_equal(reports, 0);
}

static void what_cannot_be_exported(void **state)
{
    (void)state;
    const cn_raster_options nothing = { 0 }, fine = { NULL, dsm, 1e-5 }, lost = { NULL, "/nonexistent/d.tif", 0.5 };
    assert_int_equal(cn_export_rasters(NULL, survey, &nothing, NULL), CN_ERR_USAGE);
    assert_int_equal(cn_export_rasters(NULL, survey, &fine, NULL), CN_ERR_USAGE);
    assert_int_equal(cn_export_rasters(NULL, survey, &lost, NULL), CN_ERR_IO);
    assert_non_null(strstr(cn_error_message(), "/nonexistent"));
    assert_int_equal(cn_export_points(NULL, survey, "/nonexistent/p.ply", 0.5, NULL), CN_ERR_IO);
    int stop = 1;
    const cn_context ctx = { .stop = &stop };
    const cn_raster_options again = { NULL, dsm, 0.2 };
    char *before, *after;
    size_t size;
    assert_int_equal(cn_file_read(dsm, 0, &before, &size), CN_OK);
    assert_int_equal(cn_export_rasters(&ctx, survey, &again, NULL), CN_ERR_INTERRUPTED);
    assert_int_equal(cn_export_points(&ctx, survey, ply, 0.5, NULL), CN_ERR_INTERRUPTED);
    assert_int_equal(cn_file_read(dsm, 0, &after, &size), CN_OK);
    assert_memory_equal(before, after, size);
    free(before);
    free(after);
    assert_true(cn_export_gsd(survey) > 0.1 && cn_export_gsd(survey) < 0.2); /* 7 to 11 m away at 60 px a radian */
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(samples_find_ground_and_roof),
        cmocka_unit_test(rasters_in_local_metres),
        cmocka_unit_test(rasters_on_earth),
        cmocka_unit_test(points_with_their_frame),
        cmocka_unit_test(las_on_earth),
        cmocka_unit_test(files_are_checked_first),
        cmocka_unit_test(what_cannot_be_exported),
    };
    return cmocka_run_group_tests(tests, begin, end);
}
