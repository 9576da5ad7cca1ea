/* Coordinate systems. The UTM numbers were computed by GeographicLib, which PROJ has nothing to do with. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "conurb/geo.h"
#include "geo/crs.h"

#include <math.h>
#include <string.h>

static void becomes(const char *crs, const double xyz[3], const double wanted[3])
{
    double place[1][3] = { { xyz[0], xyz[1], xyz[2] } };
    bool by_egm96;
    if (cn_crs_to_wgs84(crs, CN_HEIGHTS_ELLIPSOID, 1, place, &by_egm96) != CN_OK)
        fail_msg("%s: %s", crs, cn_error_message());
    assert_false(by_egm96);
    /* 1e-8 degrees are a millimetre. */
    assert_true(fabs(place[0][0] - wanted[0]) < 1e-8 && fabs(place[0][1] - wanted[1]) < 1e-8);
    assert_true(fabs(place[0][2] - wanted[2]) < 1e-6);
}

static void test_names(void **state)
{
    (void)state;
    static const double munich[3] = { 48.137, 11.575, 560 }, cape[3] = { -33.9, 18.4, 12 };
    static const double munich_utm[3] = { 691567.32638, 5334734.33048, 560 },
                        cape_utm[3] = { 259583.22166, 6245888.04544, 12 };
    static const double degrees[3] = { 11.575, 48.137, 560 };
    becomes("EPSG:32632", munich_utm, munich);
    becomes("EPSG:25832", munich_utm, munich);
    becomes("WGS84 UTM 32N", munich_utm, munich);
    becomes("wgs84 utm 32", munich_utm, munich);
    becomes("+proj=utm +zone=32 +ellps=WGS84 +datum=WGS84 +units=m +no_defs", munich_utm, munich);
    becomes("EPSG:32734", cape_utm, cape);
    becomes("WGS84 UTM 34S", cape_utm, cape);
    /* East comes first, whatever order the system has. */
    becomes("EPSG:4326", degrees, munich);
    becomes("WGS84", degrees, munich);
    becomes("EPSG:4979", degrees, munich);
}

static void test_heights(void **state)
{
    (void)state;
    double place[2][3] = { { 11.575, 48.137, 560 }, { 11.575, 48.137, NAN } }, geoid_m;
    bool by_egm96, found;
    assert_int_equal(cn_geo_geoid_height(48.137, 11.575, &geoid_m, &found), CN_OK);
    if (!found) skip();
    assert_int_equal(cn_crs_to_wgs84("WGS84", CN_HEIGHTS_SEA_LEVEL, 2, place, &by_egm96), CN_OK);
    assert_true(by_egm96 && geoid_m > 40);
    assert_true(fabs(place[0][2] - 560 - geoid_m) < 1e-6);
    assert_true(isnan(place[1][2]));
    /* A vertical part whose grid Debian does not have: the horizontal part, and EGM96. */
    double german[1][3] = { { 691567.32638, 5334734.33048, 560 } };
    assert_int_equal(cn_crs_to_wgs84("EPSG:25832+7837", CN_HEIGHTS_ELLIPSOID, 1, german, &by_egm96), CN_OK);
    assert_true(by_egm96 && fabs(german[0][2] - 560 - geoid_m) < 0.01);
}

static void refused(const char *crs, double x, double y, const char *says)
{
    double place[1][3] = { { x, y, 0 } };
    bool by_egm96;
    assert_int_equal(cn_crs_to_wgs84(crs, CN_HEIGHTS_ELLIPSOID, 1, place, &by_egm96), CN_ERR_DATA);
    if (!strstr(cn_error_message(), says)) fail_msg("\"%s\" does not say \"%s\"", cn_error_message(), says);
}

static void test_faults(void **state)
{
    (void)state;
    refused("EPSG:99999999", 0, 0, "no coordinate system that PROJ knows");
    refused("", 0, 0, "no coordinate system");
    refused("WGS84 UTM 77N", 0, 0, "no coordinate system");
    refused("WGS84", 11, 148, "no place in");
    refused("EPSG:32632", 1e12, 5e6, "no place in");
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_names), cmocka_unit_test(test_heights),
                                        cmocka_unit_test(test_faults) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
