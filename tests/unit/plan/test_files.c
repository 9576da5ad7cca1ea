/* A plan on disk: ids, writing and reading plan.json, tiles.geojson, plan.svg. */
#include "../chart/svg.h"
#include "city.h"

#include "base/file.h"
#include "base/json.h"

#include <ctype.h>

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

/* ---- ids ---- */

/* Plans a survey at a place; ids must be unique, sorted, safe as a folder name, and found again. */
static void check_ids(double latitude, double longitude, const char *zone)
{
    city c;
    cn_plan plan;
    city_survey(&c, 12, 30, 90);
    city_georeference(&c, latitude, longitude);
    cn_plan_options o = cn_plan_options_default();
    o.layout = CN_LAYOUT_GRID;
    o.spacing_m = 90;
    city_plan(&c, &o, &plan);
    assert_true(plan.n_tiles >= 9);
    bool zone_met = false;
    for (uint32_t i = 0; i < plan.n_tiles; i++) {
        const char *id = plan.tiles[i].id;
        for (const char *p = id; *p; p++)
            assert_true(isalnum((unsigned char)*p) || *p == '-');
        assert_true(i == 0 || strcmp(plan.tiles[i - 1].id, id) < 0);
        assert_int_equal(cn_plan_find(&plan, id), i);
        zone_met = zone_met || strncmp(id, zone, strlen(zone)) == 0;
        double place[3];
        char mgrs[32];
        assert_int_equal(
            cn_frame_to_geodetic(&c.frame, (double[]){ plan.tiles[i].centre[0], plan.tiles[i].centre[1], 0 }, place),
            CN_OK);
        assert_int_equal(cn_geo_mgrs(place[0], place[1], 4, mgrs), CN_OK);
        assert_string_equal(id, mgrs);
    }
    assert_true(zone_met);
    assert_int_equal(cn_plan_find(&plan, "nowhere"), -1);
    save(&c, &plan);
    cn_plan again;
    assert_int_equal(cn_plan_load(&again, &c.scene, c.folder), CN_OK);
    assert_int_equal(again.n_tiles, plan.n_tiles);
    cn_plan_deinit(&again);
    cn_plan_deinit(&plan);
    city_deinit(&c);
}

static void test_ids_on_earth(void **state)
{
    (void)state;
    check_ids(48.8582, 2.2945, "31UDQ");
    check_ids(48.0, 6.0 - 0.002, "31U"); /* west of a border of zones, and ... */
    check_ids(48.0, 6.0 - 0.002, "32U"); /* ... east of it, in one plan */
    check_ids(89.9999, 10.0, "Z");       /* UPS at the pole */
    check_ids(-89.9999, 10.0, "B");
    check_ids(10.0, 180.0 - 0.0015, "60P"); /* both sides of the antimeridian */
    check_ids(10.0, 180.0 - 0.0015, "01P");
    check_ids(-0.001, 30.0, "36N"); /* the equator */
}

static void test_ids_of_near_centres(void **state)
{
    (void)state;
    city c;
    cn_plan plan;
    char path[128];
    for (int georeferenced = 0; georeferenced < 2; georeferenced++) {
        city_survey(&c, 6, 0.1, 1);
        if (georeferenced) city_georeference(&c, 48, 8);
        cn_plan_options o = cn_plan_options_default();
        o.layout = CN_LAYOUT_GRID;
        o.spacing_m = 0.2; /* several centres within a metre */
        o.min_photos = 1;
        city_plan(&c, &o, &plan);
        assert_true(plan.n_tiles >= 4);
        for (uint32_t i = 1; i < plan.n_tiles; i++)
            assert_true(strcmp(plan.tiles[i - 1].id, plan.tiles[i].id) < 0);
        if (!georeferenced) assert_int_equal(plan.tiles[0].id[0], 'L');
        save(&c, &plan);
        cn_plan again;
        assert_int_equal(cn_plan_load(&again, &c.scene, c.folder), CN_OK);
        cn_plan_deinit(&again);
        for (uint32_t i = 0; i < plan.n_tiles; i++) {
            snprintf(path, sizeof path, "%s/%s", c.folder, plan.tiles[i].id);
            assert_int_equal(cn_folder_make(path), CN_OK);
        }
        cn_plan_deinit(&plan);
        city_deinit(&c);
    }
}

/* ---- plan.json ---- */

static double evidence_of(const cn_plan_input *input, const cn_plan_tile *tile)
{
    (void)input;
    return 0.25 + 1e-3 * tile->n_photos;
}
static void cost_of(void *user, const cn_plan_tile *tile, double *seconds, uint64_t *bytes)
{
    *seconds = *(double *)user;
    *bytes = 1000000007ull * tile->n_photos;
}

static void make_whole(city *c, cn_plan *plan)
{
    static const cn_effect_rule rules[] = {
        { "exposure", 0.5, evidence_of, CN_AUTO, false },
        { "sky", 0.1, evidence_of, CN_OFF, false },
        { "transient", 0.1, NULL, CN_AUTO, true },
    };
    double seconds = 12.125;
    city_survey(c, 12, 10, 40);
    city_georeference(c, 48.1, 8.2);
    cn_plan_options o = cn_plan_options_default();
    o.layout = CN_LAYOUT_GRID;
    o.spacing_m = 40;
    o.rules = rules;
    o.n_rules = 3;
    o.cost = cost_of;
    o.cost_user = &seconds;
    city_plan(c, &o, plan);
}

static void assert_same_tile(const cn_plan_tile *a, const cn_plan_tile *b)
{
    assert_string_equal(a->id, b->id);
    assert_memory_equal(a->centre, b->centre, sizeof a->centre);
    assert_memory_equal(a->bounds_min, b->bounds_min, sizeof a->bounds_min);
    assert_memory_equal(a->bounds_max, b->bounds_max, sizeof a->bounds_max);
    assert_true(a->radius_m == b->radius_m && a->near_m == b->near_m && a->far_m == b->far_m);
    assert_int_equal(a->n_photos, b->n_photos);
    assert_memory_equal(a->photos, b->photos, sizeof *a->photos * a->n_photos);
    assert_int_equal(a->n_held_out, b->n_held_out);
    if (a->n_held_out) assert_memory_equal(a->held_out, b->held_out, sizeof *a->held_out * a->n_held_out);
    assert_true(a->estimate_s == b->estimate_s && a->estimate_bytes == b->estimate_bytes);
    assert_int_equal(a->n_effects, b->n_effects);
    for (uint32_t e = 0; e < a->n_effects; e++) {
        assert_string_equal(a->effects[e].name, b->effects[e].name);
        assert_string_equal(a->effects[e].reason, b->effects[e].reason);
        assert_int_equal(a->effects[e].on, b->effects[e].on);
        assert_true(a->effects[e].threshold == b->effects[e].threshold);
        assert_true(a->effects[e].evidence == b->effects[e].evidence ||
                    (isnan(a->effects[e].evidence) && isnan(b->effects[e].evidence)));
    }
}

static void test_there_and_back(void **state)
{
    (void)state;
    city c;
    cn_plan plan, read;
    make_whole(&c, &plan);
    assert_int_equal(plan.tiles[0].n_effects, 3);
    assert_false(plan.tiles[0].effects[1].on); /* city.yaml's word */
    assert_true(plan.tiles[0].effects[2].on);  /* not measurable */
    assert_true(plan.tiles[0].estimate_s == 12.125);
    save(&c, &plan);
    assert_int_equal(cn_plan_load(&read, &c.scene, c.folder), CN_OK);
    assert_int_equal(read.n_tiles, plan.n_tiles);
    assert_true(read.overlap == plan.overlap && read.layout == plan.layout);
    assert_int_equal(read.n_warnings, plan.n_warnings);
    for (uint32_t i = 0; i < plan.n_tiles; i++)
        assert_same_tile(&plan.tiles[i], &read.tiles[i]);
    cn_plan_deinit(&read);
    cn_plan_deinit(&plan);
    city_deinit(&c);
}

/* plan.json with one thing wrong. */
static void test_bad_plans(void **state)
{
    (void)state;
    city c;
    cn_plan plan, read;
    char path[128];
    make_whole(&c, &plan);
    save(&c, &plan);
    snprintf(path, sizeof path, "%s/plan.json", c.folder);
    static const struct {
        const char *key, *value;
        cn_status status;
    } bad[] = {
        { "id", "\"../escape\"", CN_ERR_FORMAT },
        { "id", "\"\"", CN_ERR_FORMAT },
        { "radius_m", "-1", CN_ERR_FORMAT },
        { "near_m", "1e9", CN_ERR_FORMAT },
        { "photos", "[]", CN_ERR_FORMAT },
        { "photos", "[\"none.jpg\"]", CN_ERR_DATA },
        { "photos", "[\"00001.jpg\",\"00001.jpg\"]", CN_ERR_FORMAT },
        { "held_out", "[7]", CN_ERR_FORMAT },
        { "effects", "[]", CN_ERR_FORMAT },
        { "estimate", "{\"seconds\":1,\"bytes\":-1}", CN_ERR_FORMAT },
        { "bounds_min", "[1,2]", CN_ERR_FORMAT },
        { "centre", "null", CN_ERR_FORMAT },
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        json_t *root = load(&c, "plan.json"), *value = json_loads(bad[i].value, JSON_DECODE_ANY, NULL);
        json_object_set_new(json_array_get(json_object_get(root, "tiles"), 0), bad[i].key, value);
        assert_int_equal(cn_json_save(root, path), CN_OK);
        json_decref(root);
        assert_int_equal(cn_plan_load(&read, &c.scene, c.folder), bad[i].status);
        assert_non_null(strstr(cn_error_message(), "plan.json"));
        assert_int_equal(read.n_tiles, 0);
        save(&c, &plan);
    }
    static const struct {
        const char *key, *value;
        cn_status status;
    } roots[] = {
        { "version", "999", CN_ERR_VERSION },     { "version", "0", CN_ERR_FORMAT },
        { "layout", "\"round\"", CN_ERR_FORMAT }, { "tiles", "[]", CN_ERR_FORMAT },
        { "tiles", "{}", CN_ERR_FORMAT },
    };
    for (size_t i = 0; i < sizeof roots / sizeof *roots; i++) {
        json_t *root = load(&c, "plan.json");
        json_object_set_new(root, roots[i].key, json_loads(roots[i].value, JSON_DECODE_ANY, NULL));
        assert_int_equal(cn_json_save(root, path), CN_OK);
        json_decref(root);
        assert_int_equal(cn_plan_load(&read, &c.scene, c.folder), roots[i].status);
        save(&c, &plan);
    }
    assert_int_equal(cn_file_write(path, "{", 1), CN_OK);
    assert_int_equal(cn_plan_load(&read, &c.scene, c.folder), CN_ERR_FORMAT);
    assert_int_equal(cn_file_remove(path), CN_OK);
    assert_int_equal(cn_plan_load(&read, &c.scene, c.folder), CN_ERR_IO);
    cn_plan_deinit(&plan);
    city_deinit(&c);
}

/* With more than 100,000 names, plan.json holds ranges of indices, and a hash of the list that they refer to. */
static void test_large_plan(void **state)
{
    (void)state;
    city c;
    cn_plan plan, read;
    char path[128];
    city_init(&c, 50000, 0, 0);
    for (int i = 0; i < 50000; i++)
        city_look_down(&c, i % 200, i / 200, 20);
    cn_plan_options o = cn_plan_options_default();
    o.layout = CN_LAYOUT_GRID;
    o.spacing_m = 20;
    o.overlap = 0.6; /* a photo in five tiles */
    city_plan(&c, &o, &plan);
    save(&c, &plan);
    json_t *root = load(&c, "plan.json");
    assert_int_equal(json_integer_value(json_object_get(root, "version")), 2);
    assert_true(json_is_string(json_object_get(json_array_get(json_object_get(root, "tiles"), 0), "photos")));
    assert_int_equal(cn_plan_load(&read, &c.scene, c.folder), CN_OK);
    assert_int_equal(read.n_tiles, plan.n_tiles);
    for (uint32_t i = 0; i < plan.n_tiles; i++)
        assert_same_tile(&plan.tiles[i], &read.tiles[i]);
    cn_plan_deinit(&read);

    static const char *const bad[] = { "1-",    "-1",          "5 4",       "3-3", "1  2", "1,2",
                                       "50000", "99999999999", "0-49999 5", " 1",  "1 ",   "" };
    snprintf(path, sizeof path, "%s/plan.json", c.folder);
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        json_object_set_new(json_array_get(json_object_get(root, "tiles"), 0), "photos", json_string(bad[i]));
        assert_int_equal(cn_json_save(root, path), CN_OK);
        assert_int_equal(cn_plan_load(&read, &c.scene, c.folder), CN_ERR_FORMAT);
    }
    json_decref(root);
    save(&c, &plan);
    c.scene.views[7].name[0] = 'x'; /* other poses */
    assert_int_equal(cn_plan_load(&read, &c.scene, c.folder), CN_ERR_DATA);
    assert_non_null(strstr(cn_error_message(), "other poses"));
    cn_plan_deinit(&plan);
    city_deinit(&c);
}

/* ---- tiles.geojson ---- */

static void check_ring(const json_t *polygon)
{
    const json_t *rings = json_object_get(polygon, "coordinates"), *ring = json_array_get(rings, 0);
    const size_t n = json_array_size(ring);
    double area = 0;
    assert_int_equal(json_array_size(rings), 1);
    assert_true(n >= 4);
    assert_true(json_equal(json_array_get(ring, 0), json_array_get(ring, n - 1)));
    for (size_t i = 0; i + 1 < n; i++) {
        const json_t *p = json_array_get(ring, i), *q = json_array_get(ring, i + 1);
        assert_int_equal(json_array_size(p), 2);
        area += json_number_value(json_array_get(p, 0)) * json_number_value(json_array_get(q, 1)) -
                json_number_value(json_array_get(q, 0)) * json_number_value(json_array_get(p, 1));
    }
    assert_true(area > 0); /* RFC 7946: counter-clockwise */
}

static void test_geojson(void **state)
{
    (void)state;
    city c;
    cn_plan plan;
    make_whole(&c, &plan);
    for (int georeferenced = 1; georeferenced >= 0; georeferenced--) {
        c.frame.georeferenced = georeferenced;
        save(&c, &plan);
        json_t *root = load(&c, "tiles.geojson");
        const json_t *features = json_object_get(root, "features");
        assert_string_equal(json_string_value(json_object_get(root, "type")), "FeatureCollection");
        assert_int_equal(json_array_size(features), 2 * plan.n_tiles);
        assert_int_equal(json_object_get(root, "conurb:crs") != NULL, !georeferenced);
        for (size_t i = 0; i < json_array_size(features); i++) {
            const json_t *f = json_array_get(features, i), *g = json_object_get(f, "geometry"),
                         *p = json_object_get(f, "properties");
            const cn_plan_tile *tile = &plan.tiles[i / 2];
            assert_string_equal(json_string_value(json_object_get(f, "type")), "Feature");
            assert_string_equal(json_string_value(json_object_get(p, "id")), tile->id);
            assert_int_equal(json_integer_value(json_object_get(p, "photos")), tile->n_photos);
            assert_string_equal(json_string_value(json_object_get(g, "type")), i % 2 ? "Point" : "Polygon");
            if (i % 2 == 0) {
                check_ring(g);
                continue;
            }
            double place[3] = { tile->centre[1], tile->centre[0], 0 };
            if (georeferenced) assert_int_equal(cn_frame_to_geodetic(&c.frame, tile->centre, place), CN_OK);
            const json_t *xy = json_object_get(g, "coordinates");
            assert_true(fabs(json_number_value(json_array_get(xy, 0)) - place[1]) < 1e-9);
            assert_true(fabs(json_number_value(json_array_get(xy, 1)) - place[0]) < 1e-9);
        }
        json_decref(root);
    }
    cn_plan_deinit(&plan);
    city_deinit(&c);
}

/* ---- plan.svg ---- */

static size_t check_svg(const city *c, const cn_plan *plan)
{
    char path[128], *text = NULL;
    size_t size = 0;
    save(c, plan);
    snprintf(path, sizeof path, "%s/plan.svg", c->folder);
    assert_int_equal(cn_file_read(path, 0, &text, &size), CN_OK);
    const size_t n = check_well_formed(text);
    if (plan->n_tiles <= 14)
        for (uint32_t i = 0; i < plan->n_tiles; i++)
            assert_non_null(strstr(text, plan->tiles[i].id));
    free(text);
    return n;
}

static void warn(cn_plan *plan, const char *text)
{
    plan->warnings = realloc(plan->warnings, (plan->n_warnings + 1) * sizeof *plan->warnings);
    plan->warnings[plan->n_warnings++] = strdup(text);
}

/* A warning names photos, in any alphabet. */
static void check_names_of_photos(void)
{
    city c;
    cn_plan plan;
    make_whole(&c, &plan);
    warn(&plan, "Stra\xc3\x9f"
                "e-\xe5\xa4\xa7\xe9\x98\xaa\xe5\xa4\xa7\xe9\x98\xaa\xe5\xa4\xa7\xe9\x98\xaa\xe5\xa4\xa7\xe9\x98\xaa"
                "\xe5\xa4\xa7\xe9\x98\xaa\xe5\xa4\xa7\xe9\x98\xaa\xe5\xa4\xa7\xe9\x98\xaa\xe5\xa4\xa7\xe9\x98\xaa.jpg");
    check_svg(&c, &plan);
    cn_plan_deinit(&plan);
    city_deinit(&c);
}

static void test_svg(void **state)
{
    (void)state;
    city c;
    cn_plan plan;
    make_whole(&c, &plan);
    assert_true(check_svg(&c, &plan) > 144);
    cn_plan_deinit(&plan);
    c.frame.georeferenced = false; /* and names that XML would trip over */
    char **warnings = calloc(1, sizeof *warnings);
    cn_plan_options o = cn_plan_options_default();
    city_plan(&c, &o, &plan);
    assert_int_equal(plan.n_warnings, 0);
    warnings[0] =
        strdup("photo <a> & \"b\" went to the nearest tile, which is quite some way off, and says so in many words");
    plan.warnings = warnings;
    plan.n_warnings = 1;
    check_svg(&c, &plan);
    cn_plan_deinit(&plan);
    city_deinit(&c);
    check_names_of_photos();

    city_init(&c, 3, 0, 0);
    for (int i = 0; i < 3; i++) {
        city_look_along(&c, 7, 7, 7, 1, 0);
        city_plan(&c, &o, &plan);
        check_svg(&c, &plan);
        cn_plan_deinit(&plan);
    }
    city_deinit(&c);
}

/* The start of each text, and its width in an ordinary font. */
static void check_inside(const char *text)
{
    double width, height;
    assert_int_equal(sscanf(strstr(text, "viewBox"), "viewBox=\"0 0 %lf %lf", &width, &height), 2);
    for (const char *p = text; (p = strstr(p, "<text "));) {
        double x, y, size;
        const char *end = strchr(p, '>'), *font = strstr(p, "font-size=\"");
        assert_int_equal(sscanf(p, "<text x=\"%lf\" y=\"%lf\"", &x, &y), 2);
        assert_true(font && font < end && sscanf(font, "font-size=\"%lf", &size) == 1);
        const char *middle = strstr(p, "text-anchor");
        const double reach = 0.56 * size * (double)strcspn(end + 1, "<") / (middle && middle < end ? 2 : 1);
        if (!(x + reach < width && y < height - 4)) fail_msg("%.90s reaches beyond the page", p);
        p = end;
    }
}

static void read_svg(const city *c, const cn_plan *plan, char **text)
{
    char path[128];
    size_t size = 0;
    save(c, plan);
    snprintf(path, sizeof path, "%s/plan.svg", c->folder);
    assert_int_equal(cn_file_read(path, 0, text, &size), CN_OK);
}

/* Every effect on, in as many tiles as the legend lists, and warnings: all of it is on the page. */
static void test_svg_has_room(void **state)
{
    (void)state;
    static const cn_effect_rule rules[] = {
        { "exposure", 0.1, NULL, CN_AUTO, true },        { "view_dependence", 0.1, NULL, CN_AUTO, true },
        { "pose_refinement", 0.1, NULL, CN_AUTO, true }, { "appearance", 0.1, NULL, CN_AUTO, true },
        { "transient", 0.1, NULL, CN_AUTO, true },       { "display_curve", 0.1, NULL, CN_AUTO, true },
        { "rolling_shutter", 0.1, NULL, CN_AUTO, true }, { "sky", 0.1, NULL, CN_AUTO, true },
    };
    city c;
    cn_plan plan;
    city_survey(&c, 12, 10, 40);
    cn_plan_options o = cn_plan_options_default();
    o.layout = CN_LAYOUT_GRID;
    o.spacing_m = 30;
    o.rules = rules;
    o.n_rules = sizeof rules / sizeof *rules;
    city_plan(&c, &o, &plan);
    assert_true(plan.n_tiles > 14);
    while (plan.n_warnings < 7)
        warn(&plan,
             "12 photos went to the nearest tile, which is quite some way off; give plan.spacing_m in city.yaml, "
             "or take photos in between, so that the tiles overlap where they meet, and run `conurb plan` again");
    char *text;
    read_svg(&c, &plan, &text);
    check_well_formed(text);
    check_inside(text);
    for (size_t i = 0; i < o.n_rules; i++) {
        char name[32];
        snprintf(name, sizeof name, "%s", rules[i].name);
        for (char *p = name; (p = strchr(p, '_'));)
            *p = ' ';
        assert_non_null(strstr(text, name));
    }
    assert_non_null(strstr(text, "and 2 more, in plan.json"));
    free(text);
    cn_plan_deinit(&plan);
    city_deinit(&c);
}

static void keep_log(void *user, cn_log_level level, const char *message)
{
    (void)level;
    char *log = user;
    const size_t n = strlen(log);
    snprintf(log + n, 4096 - n, "%s\n", message);
}

/* A number followed by " m". */
static const char *find_metres(const char *text)
{
    for (const char *p = text; (p = strstr(p, " m")); p++)
        if (p > text && isdigit((unsigned char)p[-1]) && !isalnum((unsigned char)p[2])) return p - 1;
    return NULL;
}

static void test_no_metres_without_gps(void **state)
{
    (void)state;
    for (int georeferenced = 0; georeferenced < 2; georeferenced++) {
        char log[4096] = "";
        const cn_context ctx = { .log = keep_log, .user = log };
        city c;
        cn_plan plan;
        city_survey(&c, 12, 10, 40);
        if (georeferenced) city_georeference(&c, 48.1, 8.2);
        cn_plan_options o = cn_plan_options_default();
        const cn_plan_input input = { &c.scene, &c.photos, &c.frame, NULL };
        assert_int_equal(cn_plan_make(&ctx, &input, &o, &plan), CN_OK);
        char *text;
        read_svg(&c, &plan, &text);
        assert_non_null(strstr(log, "viewing distance"));
        assert_int_equal(find_metres(log) != NULL, georeferenced);
        assert_int_equal(find_metres(text) != NULL, georeferenced);
        assert_int_equal(strstr(text, "units") != NULL, !georeferenced);
        free(text);
        cn_plan_deinit(&plan);
        city_deinit(&c);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_ids_on_earth),
        cmocka_unit_test(test_ids_of_near_centres),
        cmocka_unit_test(test_there_and_back),
        cmocka_unit_test(test_bad_plans),
        cmocka_unit_test(test_large_plan),
        cmocka_unit_test(test_geojson),
        cmocka_unit_test(test_svg),
        cmocka_unit_test(test_svg_has_room),
        cmocka_unit_test(test_no_metres_without_gps),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
