/* tiles.geojson where longitudes jump: 180 degrees and the poles. */
#include "city.h"

#include "base/json.h"

static void save(const city *c, const cn_plan *plan)
{
    const cn_plan_input input = { &c->scene, &c->photos, &c->frame, NULL };
    if (cn_plan_save(plan, &input, c->folder) != CN_OK) fail_msg("%s", cn_error_message());
}

static json_t *load(const city *c, const char *name)
{
    char path[128];
    json_t *root = NULL;
    snprintf(path, sizeof path, "%s/%s", c->folder, name);
    assert_int_equal(cn_json_load(path, &root), CN_OK);
    return root;
}

static double check_polygon(const json_t *rings)
{
    const json_t *ring = json_array_get(rings, 0);
    double area = 0;
    assert_int_equal(json_array_size(rings), 1);
    assert_true(json_array_size(ring) >= 4);
    assert_true(json_equal(json_array_get(ring, 0), json_array_get(ring, json_array_size(ring) - 1)));
    for (size_t i = 0; i + 1 < json_array_size(ring); i++) {
        double p[2], q[2];
        for (size_t k = 0; k < 2; k++) {
            p[k] = json_number_value(json_array_get(json_array_get(ring, i), k));
            q[k] = json_number_value(json_array_get(json_array_get(ring, i + 1), k));
        }
        assert_true(fabs(p[0]) <= 180 && fabs(p[1]) <= 90);
        assert_true(fabs(p[0] - q[0]) < 180 || fabs(p[1]) == 90); /* an edge the long way round */
        area += (p[0] * q[1] - q[0] * p[1]) / 2;
    }
    assert_true(area > 0);
    return area;
}

/* A grid of tiles whose middle lies at a longitude: how many are cut, and the square degrees of all of them. */
static size_t cut_tiles(double latitude, double longitude, double *area)
{
    city c;
    cn_plan plan;
    size_t n_cut = 0;
    city_survey(&c, 12, 30, 90);
    city_georeference(&c, latitude, longitude);
    cn_plan_options o = cn_plan_options_default();
    o.layout = CN_LAYOUT_GRID;
    o.spacing_m = 90;
    city_plan(&c, &o, &plan);
    save(&c, &plan);
    json_t *root = load(&c, "tiles.geojson");
    const json_t *features = json_object_get(root, "features");
    *area = 0;
    for (size_t i = 0; i < json_array_size(features); i += 2) {
        const json_t *g = json_object_get(json_array_get(features, i), "geometry");
        const json_t *coordinates = json_object_get(g, "coordinates");
        if (strcmp(json_string_value(json_object_get(g, "type")), "Polygon") == 0) {
            *area += check_polygon(coordinates);
            continue;
        }
        assert_string_equal(json_string_value(json_object_get(g, "type")), "MultiPolygon");
        assert_int_equal(json_array_size(coordinates), 2);
        n_cut++;
        for (size_t k = 0; k < 2; k++)
            *area += check_polygon(json_array_get(coordinates, k));
    }
    json_decref(root);
    cn_plan_deinit(&plan);
    city_deinit(&c);
    return n_cut;
}

static void test_geojson_at_the_antimeridian(void **state)
{
    (void)state;
    double area, whole;
    assert_int_equal(cut_tiles(10, 20, &whole), 0);
    static const double longitudes[] = { 179.999, -180, 180, -179.999 };
    for (int i = 0; i < 4; i++) { /* the grid goes on 330 m to the east */
        const size_t n_cut = cut_tiles(10, longitudes[i], &area);
        assert_true(i < 3 ? n_cut >= 3 : n_cut == 0);
        assert_true(fabs(area - whole) < 1e-6 * whole);
    }
    assert_true(cut_tiles(89.9999, 10, &area) >= 1); /* round the poles too */
    assert_true(cut_tiles(-89.9999, 10, &area) >= 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_geojson_at_the_antimeridian),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
