/* The photos of a tile, the held-out photos, and very small cities. */
#include "city.h"

static cn_plan_options grid_of(double spacing)
{
    cn_plan_options o = cn_plan_options_default();
    o.layout = CN_LAYOUT_GRID;
    o.spacing_m = spacing;
    o.min_photos = 1;
    o.hold_out_every = 0;
    return o;
}

/* The membership rule, computed directly: in the circle, or with at least the given fraction of its points there. */
static bool belongs(const cn_scene *scene, const cn_plan_tile *tile, uint32_t view, double share)
{
    double c[3];
    cn_view_centre(&scene->views[view], c);
    if (hypot(c[0] - tile->centre[0], c[1] - tile->centre[1]) <= tile->radius_m) return true;
    uint32_t seen = 0, inside = 0;
    for (uint32_t p = 0; p < scene->n_points; p++)
        for (uint32_t k = 0; k < scene->points[p].n_observations; k++) {
            if (scene->observations[scene->points[p].first_observation + k].view != view) continue;
            seen++;
            inside += hypot(scene->points[p].xyz[0] - tile->centre[0], scene->points[p].xyz[1] - tile->centre[1]) <=
                      tile->radius_m;
        }
    return seen && inside >= share * seen;
}

/* A photo is in every tile that it belongs to and in no other; one that belongs to none is in one tile. */
static void check_member(const cn_scene *scene, const cn_plan *plan, uint32_t view, double share)
{
    uint32_t n_in = 0, n_belongs = 0;
    for (uint32_t t = 0; t < plan->n_tiles; t++)
        n_belongs += belongs(scene, &plan->tiles[t], view, share);
    for (uint32_t t = 0; t < plan->n_tiles; t++) {
        const bool in = tile_has(plan->tiles[t].photos, plan->tiles[t].n_photos, view);
        n_in += in;
        if (n_belongs) assert_int_equal(in, belongs(scene, &plan->tiles[t], view, share));
    }
    if (!n_belongs) assert_int_equal(n_in, 1);
}

/* Two rows of houses, photographed from the middle of the street and from afar: every pair of photo and tile is as the
 * rule says. */
static void test_rule(void **state)
{
    (void)state;
    city c;
    cn_plan plan;
    city_init(&c, 60, 400, 4000);
    for (int i = 0; i < 40; i++)
        city_look_along(&c, 5 * i, 0, 2, 0, i % 2 ? 1 : -1);
    for (int i = 0; i < 20; i++)
        city_look_along(&c, 10 * i, -90, 30, 0.2, 1);
    for (uint32_t i = 0; i < 380; i++) {
        const uint32_t first = i * 7 % 57;
        city_point(&c, fmod(i * 37.7, 200), i % 3 ? 12 : -12, 5, first, first + i % 3);
    }
    city_point(&c, 150, -12, 5, 58, 59); /* every photo sees one: without points the rule is another */
    cn_plan_options o = grid_of(45);
    static const double shares[] = { 0.1, 0.3, 0.7 };
    uint32_t most = UINT32_MAX;
    for (int s = 0; s < 3; s++) {
        o.min_points_seen = shares[s];
        city_plan(&c, &o, &plan);
        uint32_t n = 0;
        for (uint32_t t = 0; t < plan.n_tiles; t++)
            n += plan.tiles[t].n_photos;
        for (uint32_t v = 0; v < c.scene.n_views; v++)
            check_member(&c.scene, &plan, v, shares[s]);
        assert_true(n < most); /* a stricter share leaves fewer: the rule is at work */
        most = n;
        cn_plan_deinit(&plan);
    }
    city_deinit(&c);
}

static void test_held_out(void **state)
{
    (void)state;
    city c;
    cn_plan plan;
    city_survey(&c, 12, 10, 40);
    cn_plan_options o = grid_of(40);
    static const uint32_t every[] = { 8, 5, 2 };
    for (int e = 0; e < 3; e++) {
        o.hold_out_every = every[e];
        city_plan(&c, &o, &plan);
        uint32_t met = 0;
        for (uint32_t t = 0; t < plan.n_tiles; t++) {
            const cn_plan_tile *tile = &plan.tiles[t];
            for (uint32_t i = 0; i < tile->n_photos; i++)
                assert_true(tile->photos[i] % every[e] != 0);
            for (uint32_t i = 0; i < tile->n_held_out; i++)
                assert_true(tile->held_out[i] % every[e] == 0);
            for (uint32_t i = 1; i < tile->n_photos; i++)
                assert_true(tile->photos[i - 1] < tile->photos[i]);
            for (uint32_t i = 1; i < tile->n_held_out; i++)
                assert_true(tile->held_out[i - 1] < tile->held_out[i]);
            met += tile->n_held_out;
        }
        assert_true(met >= 144 / every[e]); /* each of them somewhere */
        cn_plan_deinit(&plan);
    }
    o.hold_out_every = 0;
    city_plan(&c, &o, &plan);
    for (uint32_t t = 0; t < plan.n_tiles; t++)
        assert_int_equal(plan.tiles[t].n_held_out, 0);
    cn_plan_deinit(&plan);
    city_deinit(&c);
}

/* Every photo is in some tile, also those that a dropped tile had. */
static void test_nobody_is_lost(void **state)
{
    (void)state;
    city c;
    cn_plan plan;
    city_init(&c, 43, 0, 0);
    for (int i = 0; i < 40; i++)
        city_look_down(&c, i % 8 * 5, i / 8 * 5, 20);
    for (int i = 0; i < 3; i++)
        city_look_down(&c, 400 + i, 0, 20); /* too few for a tile */
    cn_plan_options o = grid_of(60);
    o.min_photos = 4;
    city_plan(&c, &o, &plan);
    assert_int_equal(plan.n_tiles, 1);
    for (uint32_t v = 0; v < 43; v++)
        assert_true(tile_has(plan.tiles[0].photos, plan.tiles[0].n_photos, v));
    cn_plan_deinit(&plan);
    o.min_photos = 3;
    city_plan(&c, &o, &plan);
    assert_int_equal(plan.n_tiles, 2);
    cn_plan_deinit(&plan);
    city_deinit(&c);
}

static void test_near_and_far_hold_the_points(void **state)
{
    (void)state;
    city c;
    cn_plan plan;
    city_survey(&c, 12, 10, 40);
    cn_plan_options o = grid_of(40);
    city_plan(&c, &o, &plan);
    for (uint32_t t = 0; t < plan.n_tiles; t++) {
        const cn_plan_tile *tile = &plan.tiles[t];
        /* Points are 40 to 117 m away. Smooth ground has none and may be far nearer; the lens itself shows nothing. */
        assert_true(tile->near_m < 10 && tile->near_m > 1);
        assert_true(tile->far_m > 41.3 && tile->far_m < 200);
        for (int k = 0; k < 3; k++)
            assert_true(tile->bounds_min[k] < tile->bounds_max[k]);
        assert_true(tile->bounds_min[2] < 0 && tile->bounds_max[2] > 40); /* ground and cameras */
        for (uint32_t i = 0; i < tile->n_photos; i++) {
            double centre[3];
            cn_view_centre(&c.scene.views[tile->photos[i]], centre);
            for (int k = 0; k < 3; k++)
                assert_true(tile->bounds_min[k] <= centre[k] && centre[k] <= tile->bounds_max[k]);
        }
    }
    cn_plan_deinit(&plan);
    city_deinit(&c);
}

/* A point at the horizon, wrongly triangulated, must not make the tile huge. */
static void test_outliers_do_not_stretch_a_tile(void **state)
{
    (void)state;
    city c;
    cn_plan plan;
    city_init(&c, 100, 1000, 2000);
    for (int i = 0; i < 100; i++)
        city_look_down(&c, i % 10 * 5, i / 10 * 5, 30);
    for (uint32_t i = 0; i < 990; i++)
        city_point(&c, i % 45, i * 7 % 45, 0, i % 100, i % 100);
    city_point(&c, 1e6, 1e6, -1e5, 3, 4);
    city_point(&c, 0, 0, 29.999, 7, 7);
    cn_plan_options o = cn_plan_options_default();
    city_plan(&c, &o, &plan);
    for (uint32_t t = 0; t < plan.n_tiles; t++) {
        assert_true(plan.tiles[t].far_m < 1000 && plan.tiles[t].near_m > 1);
        for (int k = 0; k < 3; k++)
            assert_true(plan.tiles[t].bounds_max[k] - plan.tiles[t].bounds_min[k] < 200);
    }
    cn_plan_deinit(&plan);
    city_deinit(&c);
}

static void check_single(const city *c, uint32_t n, const char *warning)
{
    cn_plan plan;
    cn_plan_options o = cn_plan_options_default();
    city_plan(c, &o, &plan);
    assert_int_equal(plan.n_tiles, 1);
    assert_int_equal(plan.tiles[0].n_photos + plan.tiles[0].n_held_out, n);
    assert_true(plan.tiles[0].n_photos > 0 && plan.tiles[0].radius_m > 0 && isfinite(plan.tiles[0].radius_m));
    assert_true(plan.tiles[0].near_m > 0 && plan.tiles[0].far_m > plan.tiles[0].near_m &&
                isfinite(plan.tiles[0].far_m));
    for (int k = 0; k < 3; k++)
        assert_true(plan.tiles[0].bounds_max[k] > plan.tiles[0].bounds_min[k]);
    assert_true(warned(&plan, warning));
    cn_plan_deinit(&plan);
}

static void test_one_photo(void **state)
{
    (void)state;
    city c;
    city_init(&c, 1, 1, 1);
    city_look_along(&c, 3, 4, 2, 1, 0);
    check_single(&c, 1, "only one photo");
    city_point(&c, 13, 4, 2, 0, 0);
    check_single(&c, 1, "only one photo");
    city_deinit(&c);
}

static void test_two_photos(void **state)
{
    (void)state;
    city c;
    city_init(&c, 2, 1, 2);
    city_look_along(&c, 3, 4, 2, 1, 0);
    city_look_along(&c, 3, 5, 2, 1, 0);
    check_single(&c, 2, "only two photos");
    city_point(&c, 13, 4, 2, 0, 1);
    check_single(&c, 2, "only two photos");
    city_deinit(&c);
}

static void test_all_at_one_place(void **state)
{
    (void)state;
    city c;
    city_init(&c, 12, 0, 0);
    for (int i = 0; i < 12; i++)
        city_look_along(&c, 7, 7, 7, cos(i), sin(i));
    check_single(&c, 12, "at one place");
    city_deinit(&c);
    city_init(&c, 12, 0, 0);
    for (int i = 0; i < 12; i++)
        city_look_down(&c, 7, 7, 7); /* and all the same way */
    check_single(&c, 12, "at one place");
    city_deinit(&c);
}

static void test_no_photo_and_no_pose(void **state)
{
    (void)state;
    city c;
    cn_plan plan;
    cn_plan_options o = cn_plan_options_default();
    city_init(&c, 3, 1, 4);
    assert_int_equal(city_try(&c, &o, &plan), CN_ERR_DATA);
    for (int i = 0; i < 3; i++)
        city_look_down(&c, i, 0, 10);
    c.scene.views[1].translation[0] = NAN;
    assert_int_equal(city_try(&c, &o, &plan), CN_ERR_DATA);
    assert_non_null(strstr(cn_error_message(), "00001.jpg"));
    c.scene.views[1].translation[0] = 0;
    city_point(&c, 0, 0, 0, 0, 3); /* there is no view 3 */
    assert_int_equal(city_try(&c, &o, &plan), CN_ERR_FORMAT);
    city_deinit(&c);
}

static void cost_of(void *user, const cn_plan_tile *tile, double *seconds, uint64_t *bytes)
{
    (void)user;
    *seconds = 1;
    *bytes = 1000000 + 1000ull * tile->n_photos;
}

/* Photos above a limit are left out evenly: every quarter of a tile keeps its share. */
static void test_budgets(void **state)
{
    (void)state;
    city c;
    cn_plan plan;
    city_init(&c, 4000, 0, 0);
    for (int i = 0; i < 4000; i++)
        city_look_along(&c, i % 64, i / 64, 10, cos(i), sin(i));
    cn_plan_options o = grid_of(1000);
    o.hold_out_every = 8;
    o.max_tile_photos = 1000;
    o.cost = cost_of;
    city_plan(&c, &o, &plan);
    assert_int_equal(plan.n_tiles, 1);
    assert_int_equal(plan.tiles[0].n_photos, 1000);
    assert_in_range(plan.tiles[0].n_held_out, 142, 144); /* an eighth of all, as before */
    assert_true(warned(&plan, "1 of 1 tiles have more photos"));
    uint32_t quarter[4] = { 0 };
    for (uint32_t i = 0; i < 1000; i++) {
        const uint32_t v = plan.tiles[0].photos[i];
        assert_true(v % 8 != 0 && (i == 0 || plan.tiles[0].photos[i - 1] < v));
        quarter[(v % 64 >= 32) + 2 * (v / 64 >= 31)]++;
    }
    for (int q = 0; q < 4; q++)
        assert_in_range(quarter[q], 220, 280);
    cn_plan_deinit(&plan);

    o.max_tile_bytes = 1500000;
    city_plan(&c, &o, &plan);
    assert_int_equal(plan.tiles[0].n_photos, 500);
    assert_true(plan.tiles[0].estimate_bytes == 1500000);
    cn_plan_deinit(&plan);

    o.max_tile_bytes = 500000; /* not even one photo fits: nothing is thinned for it, and the plan says so */
    city_plan(&c, &o, &plan);
    assert_int_equal(plan.tiles[0].n_photos, 1000);
    assert_true(warned(&plan, "2 MB even with"));
    cn_plan_deinit(&plan);
    city_deinit(&c);
}

/* The same on any number of threads. */
static void test_threads_change_nothing(void **state)
{
    (void)state;
    city c;
    cn_plan one, many;
    cn_plan_options o = grid_of(20);
    cn_context ctx = { 0 };
    city_survey(&c, 20, 7, 30);
    const cn_plan_input input = { &c.scene, &c.photos, &c.frame, NULL };
    assert_int_equal(cn_pool_create(&ctx.pool, 5), CN_OK);
    assert_int_equal(cn_plan_make(NULL, &input, &o, &one), CN_OK);
    assert_int_equal(cn_plan_make(&ctx, &input, &o, &many), CN_OK);
    assert_int_equal(one.n_tiles, many.n_tiles);
    for (uint32_t t = 0; t < one.n_tiles; t++) {
        assert_string_equal(one.tiles[t].id, many.tiles[t].id);
        assert_int_equal(one.tiles[t].n_photos, many.tiles[t].n_photos);
        assert_memory_equal(one.tiles[t].photos, many.tiles[t].photos, 4 * one.tiles[t].n_photos);
        assert_memory_equal(one.tiles[t].bounds_max, many.tiles[t].bounds_max, sizeof one.tiles[t].bounds_max);
    }
    cn_plan_deinit(&one);
    cn_plan_deinit(&many);
    cn_pool_destroy(&ctx.pool);
    city_deinit(&c);
}

/* The same city gives the same plan, and where the frame's origin is changes no photo. */
static void test_stable(void **state)
{
    (void)state;
    city near, away;
    cn_plan a, b;
    const cn_plan_options o = cn_plan_options_default();
    city_survey(&near, 20, 7, 30);
    city_init(&away, 400, 400, 800);
    for (uint32_t i = 0; i < 400; i++)
        city_look_down(&away, 65536 + 7 * (i % 20), -131072 + 7 * (i / 20), 30);
    for (uint32_t i = 0; i < 400; i++)
        city_point(&away, 65536 + 7 * (i % 20), -131072 + 7 * (i / 20), 0, i, i < 399 ? i + 1 : i);
    city_plan(&near, &o, &a);
    city_plan(&away, &o, &b);
    assert_int_equal(a.n_tiles, b.n_tiles);
    uint32_t photos[2] = { 0, 0 };
    for (uint32_t t = 0; t < a.n_tiles; t++) {
        photos[0] += a.tiles[t].n_photos;
        photos[1] += b.tiles[t].n_photos;
    }
    assert_int_equal(photos[0], photos[1]);
    cn_plan_deinit(&a);
    cn_plan_deinit(&b);
    city_deinit(&near);
    city_deinit(&away);
}

static bool same_photos(const cn_plan_tile *a, const cn_plan_tile *b)
{
    return a->n_photos == b->n_photos && memcmp(a->photos, b->photos, a->n_photos * sizeof *a->photos) == 0;
}

/* Photos from the middle of courtyards, whose walls lie in several cells. Where all photos of a courtyard are in each
 * of its tiles, it has one, with a radius that holds its cameras. A given distance is kept to. */
static void test_a_courtyard_is_one_tile(void **state)
{
    (void)state;
    enum { YARDS = 5, EACH = 32 };
    static const double at[YARDS][2] = { { 0, 0 }, { 150, 31 }, { 333, -47 }, { 480, 90 }, { 707, 12 } };
    city c;
    cn_plan plan;
    city_init(&c, YARDS * EACH, YARDS * EACH, YARDS * EACH * 3);
    for (uint32_t i = 0; i < YARDS * EACH; i++) {
        const double angle = 6.283185307179586 * i / EACH, *m = at[i / EACH];
        city_look_along(&c, m[0] + 2 * cos(angle), m[1] + 2 * sin(angle), 2, cos(angle), sin(angle));
    }
    for (uint32_t i = 0; i < YARDS * EACH; i++) {
        const double angle = 6.283185307179586 * i / EACH, *m = at[i / EACH];
        const uint32_t first = i % EACH < EACH - 2 ? i : i - 2;
        city_point(&c, m[0] + 25 * cos(angle), m[1] + 25 * sin(angle), 1, first, first + 2);
    }
    cn_plan_options o = cn_plan_options_default();
    city_plan(&c, &o, &plan);
    assert_int_equal(plan.n_tiles, YARDS);
    for (uint32_t t = 0; t < plan.n_tiles; t++) {
        const cn_plan_tile *tile = &plan.tiles[t];
        const double *m = at[tile->photos[0] / EACH];
        assert_true(hypot(tile->centre[0] - m[0], tile->centre[1] - m[1]) < 5);
        assert_true(tile->radius_m > 2 && tile->radius_m < 30);
        for (uint32_t k = 0; k < t; k++)
            assert_false(same_photos(tile, &plan.tiles[k]));
    }
    cn_plan_deinit(&plan);
    o.spacing_m = 25;
    city_plan(&c, &o, &plan);
    assert_true(plan.n_tiles > YARDS);
    cn_plan_deinit(&plan);
    city_deinit(&c);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_rule),
        cmocka_unit_test(test_held_out),
        cmocka_unit_test(test_nobody_is_lost),
        cmocka_unit_test(test_near_and_far_hold_the_points),
        cmocka_unit_test(test_outliers_do_not_stretch_a_tile),
        cmocka_unit_test(test_one_photo),
        cmocka_unit_test(test_two_photos),
        cmocka_unit_test(test_all_at_one_place),
        cmocka_unit_test(test_no_photo_and_no_pose),
        cmocka_unit_test(test_stable),
        cmocka_unit_test(test_budgets),
        cmocka_unit_test(test_threads_change_nothing),
        cmocka_unit_test(test_a_courtyard_is_one_tile),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
