/* The layout of tiles: grid, given centres, automatic; and the meaning of overlap. */
#include "city.h"

#include "base/file.h"
#include "base/units.h"

static cn_plan_options grid_of(double spacing)
{
    cn_plan_options o = cn_plan_options_default();
    o.layout = CN_LAYOUT_GRID;
    o.spacing_m = spacing;
    return o;
}

/* Overlap is the share of a diameter that two tiles at the spacing have in common. */
static void test_overlap_is_of_the_diameter(void **state)
{
    (void)state;
    city c;
    city_survey(&c, 12, 10, 40);
    static const double overlaps[] = { 0, 0.2, 0.5, 0.75 };
    for (size_t i = 0; i < sizeof overlaps / sizeof *overlaps; i++) {
        cn_plan plan;
        cn_plan_options o = grid_of(40);
        o.overlap = overlaps[i];
        city_plan(&c, &o, &plan);
        assert_true(plan.n_tiles > 1);
        for (uint32_t t = 0; t < plan.n_tiles; t++) {
            const double shared = 2 * plan.tiles[t].radius_m - 40; /* width of the lens along the line of the centres */
            assert_true(fabs(shared / (2 * plan.tiles[t].radius_m) - overlaps[i]) < 1e-12);
        }
        assert_true(plan.overlap == overlaps[i] && plan.layout == CN_LAYOUT_GRID);
        cn_plan_deinit(&plan);
    }
    city_deinit(&c);
}

/* A grid of spacing 40 over 110 m: 3 x 3 cells centred on the photos' extent. */
static void test_grid(void **state)
{
    (void)state;
    city c;
    cn_plan plan;
    city_survey(&c, 12, 10, 40);
    cn_plan_options o = grid_of(40);
    city_plan(&c, &o, &plan);
    assert_int_equal(plan.n_tiles, 9);
    bool met[9] = { false };
    for (uint32_t t = 0; t < 9; t++) {
        const double x = (plan.tiles[t].centre[0] - 15) / 40, y = (plan.tiles[t].centre[1] - 15) / 40;
        assert_true(fabs(x - round(x)) < 1e-9 && fabs(y - round(y)) < 1e-9);
        assert_in_range((int)round(x), 0, 2);
        assert_in_range((int)round(y), 0, 2);
        met[3 * (int)round(y) + (int)round(x)] = true;
        assert_true(fabs(plan.tiles[t].centre[2]) < 1e-9); /* the ground, from the points */
    }
    for (int t = 0; t < 9; t++)
        assert_true(met[t]);
    cn_plan_deinit(&plan);
    o.spacing_m = 1e-9;
    assert_int_equal(city_try(&c, &o, &plan), CN_ERR_CONFIG);
    assert_non_null(strstr(cn_error_message(), "spacing_m"));
    assert_int_equal(plan.n_tiles, 0);
    city_deinit(&c);
}

/* Cells that no photo sees get no tile. */
static void test_grid_leaves_out_what_nobody_sees(void **state)
{
    (void)state;
    city c;
    cn_plan plan;
    city_init(&c, 16, 0, 0);
    for (int i = 0; i < 8; i++)
        city_look_down(&c, i, 0, 10);
    for (int i = 0; i < 8; i++)
        city_look_down(&c, 1000 + i, 0, 10);
    cn_plan_options o = grid_of(50);
    city_plan(&c, &o, &plan);
    assert_int_equal(plan.n_tiles, 2);
    assert_true(fabs(plan.tiles[0].centre[0] - plan.tiles[1].centre[0]) > 900);
    cn_plan_deinit(&plan);
    city_deinit(&c);
}

/* Automatic: neighbours one viewing distance apart, or farther where photos are few. */
static void test_auto(void **state)
{
    (void)state;
    city c;
    cn_plan plan;
    city_survey(&c, 30, 4, 40); /* 116 m across, seen from 40 m, 100 photos a cell */
    cn_plan_options o = cn_plan_options_default();
    city_plan(&c, &o, &plan);
    assert_in_range(plan.n_tiles, 4, 16);
    assert_true(plan.tiles[0].radius_m > 30 && plan.tiles[0].radius_m < 60);
    const uint32_t close = plan.n_tiles;
    cn_plan_deinit(&plan);
    city_deinit(&c);

    city_survey(&c, 8, 20, 10); /* seen from 10 m, but a photo every 20 m */
    city_plan(&c, &o, &plan);
    assert_true(plan.n_tiles <= 64 / 8);
    assert_true(plan.n_tiles < close * 4);
    for (uint32_t t = 0; t < plan.n_tiles; t++)
        assert_true(plan.tiles[t].n_photos >= 4);
    cn_plan_deinit(&plan);
    city_deinit(&c);
}

/* Cameras that look at one thing from all round share one tile, whichever way they stand. */
static void test_auto_object_is_one_tile(void **state)
{
    (void)state;
    city c;
    cn_plan plan;
    city_init(&c, 24, 0, 0);
    for (int i = 0; i < 24; i++) {
        const double a = i * 2 * CN_PI / 24;
        city_look_along(&c, 50 + 6 * cos(a), 20 + 6 * sin(a), 1.5, -cos(a), -sin(a));
    }
    cn_plan_options o = cn_plan_options_default();
    city_plan(&c, &o, &plan);
    assert_int_equal(plan.n_tiles, 1);
    assert_true(hypot(plan.tiles[0].centre[0] - 50, plan.tiles[0].centre[1] - 20) < 1e-6);
    assert_true(plan.tiles[0].radius_m >= 6);
    assert_int_equal(plan.tiles[0].n_photos + plan.tiles[0].n_held_out, 24);
    cn_plan_deinit(&plan);
    city_deinit(&c);
}

/* Two statues, 2 km from each other, with few photos each: there is nothing between them for a tile to show. */
static void test_auto_places_far_apart(void **state)
{
    (void)state;
    enum { EACH = 7 };
    city c;
    cn_plan plan;
    cn_plan_options o = cn_plan_options_default();
    for (int alone = 0; alone < 2; alone++) { /* and a camera that no place has to itself */
        city_init(&c, 2 * EACH + 1, 60, 60 * EACH);
        for (int i = 0; i < 2 * EACH; i++) {
            const double a = i * 2 * CN_PI / EACH;
            city_look_along(&c, (i < EACH ? 0 : 2000) + 20 * cos(a), 20 * sin(a), 2, -cos(a), -sin(a));
        }
        if (alone) city_look_along(&c, 0, 900, 2, 0, -1);
        for (int i = 0; i < 60; i++)
            city_point(&c, (i < 30 ? 0 : 2000) + 2 * cos(i), 2 * sin(i), 1, i < 30 ? 0 : EACH,
                       (i < 30 ? EACH : 2 * EACH) - 1);
        city_plan(&c, &o, &plan);
        assert_int_equal(plan.n_tiles, 2);
        for (uint32_t t = 0; t < 2; t++) {
            const double x = plan.tiles[t].centre[0];
            assert_true(fmin(fabs(x), fabs(x - 2000)) < 5 && fabs(plan.tiles[t].centre[1]) < 5);
            assert_true(plan.tiles[t].radius_m < 200);
        }
        cn_plan_deinit(&plan);
        city_deinit(&c);
    }
}

/* Poses without points, on a street: no more tiles than the photos can fill, and a warning. */
static void test_auto_without_points(void **state)
{
    (void)state;
    city c;
    cn_plan plan;
    city_init(&c, 96, 0, 0);
    for (int i = 0; i < 96; i++)
        city_look_along(&c, i % 48 * 2, i < 48 ? -3 : 3, 1.7, cos(i * 0.4), sin(i * 0.4));
    cn_plan_options o = cn_plan_options_default();
    city_plan(&c, &o, &plan);
    assert_in_range(plan.n_tiles, 1, 2);
    assert_true(plan.n_warnings > 0 && strstr(plan.warnings[0], "without sparse points"));
    cn_plan_deinit(&plan);
    city_deinit(&c);
}

static void write_text(const city *c, const char *text, char *path, size_t size)
{
    snprintf(path, size, "%s/centres.geojson", c->folder);
    assert_int_equal(cn_file_write(path, text, strlen(text)), CN_OK);
}

#define POINT(lon, lat)                                                                                                \
    "{\"type\":\"Feature\",\"properties\":{},\"geometry\":{\"type\":\"Point\",\"coordinates\":[" lon "," lat "]}}"
#define COLLECTION(features) "{\"type\":\"FeatureCollection\",\"features\":[" features "]}"

static void test_centres(void **state)
{
    (void)state;
    city c;
    cn_plan plan;
    char path[96];
    city_survey(&c, 12, 10, 40);
    cn_plan_options o = cn_plan_options_default();
    o.layout = CN_LAYOUT_CENTRES;
    assert_int_equal(city_try(&c, &o, &plan), CN_ERR_CONFIG);
    o.centres = path;

    write_text(&c, COLLECTION(POINT("20", "30") "," POINT("80", "30")), path, sizeof path); /* local metres */
    city_plan(&c, &o, &plan);
    assert_int_equal(plan.n_tiles, 2);
    assert_true(fabs(plan.tiles[0].radius_m - 60) < 1e-9); /* 60 m apart, overlap 0.5 */
    assert_true(fabs(plan.tiles[0].centre[1] - 30) < 1e-9);
    cn_plan_deinit(&plan);

    city_georeference(&c, 48, 8); /* longitude first; 1e-3 degrees of latitude are 111.2 m here */
    write_text(&c, COLLECTION(POINT("8", "48") "," POINT("8", "48.001")), path, sizeof path);
    city_plan(&c, &o, &plan);
    assert_int_equal(plan.n_tiles, 2);
    assert_true(fabs(fabs(plan.tiles[0].centre[1] - plan.tiles[1].centre[1]) - 111.2) < 0.1);
    cn_plan_deinit(&plan);
    city_deinit(&c);
}

static void test_bad_centres(void **state)
{
    (void)state;
    city c;
    cn_plan plan;
    char path[96];
    city_survey(&c, 4, 10, 40);
    city_georeference(&c, 48, 8);
    cn_plan_options o = cn_plan_options_default();
    o.layout = CN_LAYOUT_CENTRES;
    o.centres = path;
    static const struct {
        const char *text, *says;
    } bad[] = {
        { "[]", "type" },
        { "{\"type\":\"Feature\"}", "FeatureCollection" },
        { COLLECTION(""), "0 centres" },
        { COLLECTION("{\"geometry\":{\"type\":\"LineString\",\"coordinates\":[[0,0]]}}"), "feature 0" },
        { COLLECTION(POINT("8", "48") "," POINT("48", "98")), "feature 1" },
        { COLLECTION("{\"geometry\":{\"type\":\"Point\",\"coordinates\":[8]}}"), "2 or 3" },
        { COLLECTION(POINT("8", "48") "," POINT("8", "48")), "duplicates" },
        { COLLECTION(POINT("8", "\"48\"")), "coordinates" },
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        write_text(&c, bad[i].text, path, sizeof path);
        assert_int_equal(city_try(&c, &o, &plan), CN_ERR_FORMAT);
        assert_non_null(strstr(cn_error_message(), bad[i].says));
        assert_non_null(strstr(cn_error_message(), "centres.geojson"));
    }
    snprintf(path, sizeof path, "%s/none.geojson", c.folder);
    assert_int_equal(city_try(&c, &o, &plan), CN_ERR_IO);
    city_deinit(&c);
}

static void test_bad_options(void **state)
{
    (void)state;
    city c;
    cn_plan plan;
    city_survey(&c, 4, 10, 40);
    cn_plan_options bad[6];
    for (int i = 0; i < 6; i++)
        bad[i] = cn_plan_options_default();
    bad[0].overlap = 1;
    bad[1].overlap = NAN;
    bad[2].spacing_m = -1;
    bad[3].spacing_m = INFINITY;
    bad[4].min_points_seen = 1.5;
    bad[5].hold_out_every = 1;
    for (int i = 0; i < 6; i++)
        assert_int_equal(city_try(&c, &bad[i], &plan), CN_ERR_CONFIG);
    city_deinit(&c);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_overlap_is_of_the_diameter),
        cmocka_unit_test(test_grid),
        cmocka_unit_test(test_grid_leaves_out_what_nobody_sees),
        cmocka_unit_test(test_auto),
        cmocka_unit_test(test_auto_object_is_one_tile),
        cmocka_unit_test(test_auto_places_far_apart),
        cmocka_unit_test(test_auto_without_points),
        cmocka_unit_test(test_centres),
        cmocka_unit_test(test_bad_centres),
        cmocka_unit_test(test_bad_options),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
