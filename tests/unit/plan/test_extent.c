/* How near and far a tile's rays go, and the box of its field, where cameras stand in unusual ways. */
#include "city.h"

#include "base/units.h"

static double widest(const cn_plan_tile *tile)
{
    double most = 0;
    for (int k = 0; k < 3; k++)
        most = fmax(most, tile->bounds_max[k] - tile->bounds_min[k]);
    return most;
}

enum { RING = 41 };

/* Cameras 20 m round a statue, and perhaps one 2 km away that sees the same points. */
static void round_a_statue(city *c, bool far, bool far_first)
{
    enum { POINTS = 50 };
    city_init(c, RING + 1, POINTS, POINTS * (RING + 1));
    if (far && far_first) city_look_along(c, 2000, 0, 2, -1, 0);
    for (int i = 0; i < RING; i++) {
        const double a = i * 2 * CN_PI / RING;
        city_look_along(c, 20 * cos(a), 20 * sin(a), 2, -cos(a), -sin(a));
    }
    if (far && !far_first) city_look_along(c, 2000, 0, 2, -1, 0);
    for (int i = 0; i < POINTS; i++)
        city_point(c, 2 * cos(i), 2 * sin(i), 0.08 * i, 0, c->scene.n_views - 1);
}

/* One far camera must not make the cells of the field large for all, be it trained on or held out. But its rays have to
 * reach what it sees. */
static void test_one_far_camera(void **state)
{
    (void)state;
    const cn_plan_options o = cn_plan_options_default();
    city c;
    cn_plan plan;
    round_a_statue(&c, false, false);
    city_plan(&c, &o, &plan);
    assert_int_equal(plan.n_tiles, 1);
    const cn_plan_tile near = plan.tiles[0];
    assert_true(widest(&near) > 40);
    cn_plan_deinit(&plan);
    city_deinit(&c);
    for (int held = 0; held < 2; held++) {
        round_a_statue(&c, true, held); /* the first by name is held out */
        city_plan(&c, &o, &plan);
        assert_int_equal(plan.n_tiles, 1);
        const cn_plan_tile *tile = &plan.tiles[0];
        assert_true(
            tile_has(held ? tile->held_out : tile->photos, held ? tile->n_held_out : tile->n_photos, held ? 0 : RING));
        assert_true(fabs(widest(tile) - widest(&near)) < 0.01 * widest(&near));
        assert_true(fabs(tile->near_m - near.near_m) < 0.1 * near.near_m);
        assert_true(tile->far_m > 2000);
        cn_plan_deinit(&plan);
        city_deinit(&c);
    }
}

/* Photos of a street, 5 m apart, whose axes are parallel: the length of the street says nothing of how far they see. */
static void test_a_line_without_points(void **state)
{
    (void)state;
    city c;
    cn_plan plan;
    cn_plan_options o = cn_plan_options_default();
    city_init(&c, 60, 0, 0);
    for (int i = 0; i < 60; i++)
        city_look_along(&c, 5 * i, 0, 2, 1, 0);
    city_plan(&c, &o, &plan);
    for (uint32_t t = 0; t < plan.n_tiles; t++) {
        assert_true(plan.tiles[t].near_m < 1.5); /* the road in front of the camera */
        assert_true(plan.tiles[t].far_m > 295);  /* the end of the street */
        assert_true(plan.tiles[t].centre[0] > 0 && plan.tiles[t].centre[0] < 320);
    }
    cn_plan_deinit(&plan);
    o.spacing_m = 40;
    city_plan(&c, &o, &plan);
    assert_true(plan.n_tiles > 4);
    for (uint32_t t = 0; t < plan.n_tiles; t++) {
        assert_true(fabs(plan.tiles[t].near_m - 2) < 1e-9);
        assert_true(plan.tiles[t].centre[0] > 0 && plan.tiles[t].centre[0] < 345);
    }
    cn_plan_deinit(&plan);
    city_deinit(&c);
}

/* A film of a room from within, a photo every 3 cm: the box holds the room, though neighbours are that near. */
static void test_a_room_without_points(void **state)
{
    (void)state;
    city c;
    cn_plan plan;
    const cn_plan_options o = cn_plan_options_default();
    city_init(&c, 300, 0, 0);
    for (int i = 0; i < 300; i++) {
        const double angle = 2 * CN_PI * i / 300, look = angle + 0.4 * sin(3 * angle);
        city_look_along(&c, 1.5 * cos(angle), 1.2 * sin(angle), 1.5, cos(look), sin(look));
    }
    city_plan(&c, &o, &plan);
    for (uint32_t t = 0; t < plan.n_tiles; t++) {
        const cn_plan_tile *tile = &plan.tiles[t];
        assert_true(tile->bounds_min[2] < 0.3 && tile->bounds_max[2] > 2.7);
        assert_true(tile->bounds_max[0] - tile->bounds_min[0] > 3);
        assert_true(tile->near_m < 0.05);
    }
    cn_plan_deinit(&plan);
    city_deinit(&c);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_one_far_camera),
        cmocka_unit_test(test_a_line_without_points),
        cmocka_unit_test(test_a_room_without_points),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
