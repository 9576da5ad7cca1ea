/* Channels of pictures of a town whose shape is known. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../export/town.h"
#include "city/workspace.h"
#include "math/linalg.h"
#include "renderer/aov.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { DEPTH, NORMAL, OPACITY, OPEN, COVERAGE, SIDE = 60, ALL = 31 };
static town t;
static cn_context ctx;
static cn_city city;
static cn_dataset dataset;
static cn_plan plan;
static cn_plan_tile tile;
static cn_tile_cache tiles;
static struct stat file;
static uint32_t which;
static double centre[1][3], radius = 3;

static int begin(void **state)
{
    (void)state;
    if (town_init(&t) != CN_OK || cn_pool_create(&ctx.pool, 2) != CN_OK) return -1;
    tile = (cn_plan_tile){ .id = ".", .radius_m = radius, .photos = t.all_views, .n_photos = TOWN_VIEWS };
    plan = (cn_plan){ .tiles = &tile, .n_tiles = 1 };
    city.folder = t.folder;
    dataset.scene = t.scene;
    tiles = (cn_tile_cache){ .city = &city,
                             .folder = ".",
                             .plan = &plan,
                             .dataset = &dataset,
                             .centres = centre,
                             .radii = &radius,
                             .which = &which,
                             .n = 1,
                             .files = &file,
                             .n_cache = 1 };
    return 0;
}

static int end(void **state)
{
    (void)state;
    cn_photo_depths_deinit(tiles.depths);
    free(tiles.depths);
    cn_tile_cache_close(&tiles);
    cn_pool_destroy(&ctx.pool);
    town_deinit(&t);
    return 0;
}

static const cn_camera camera = {
    .lens = CN_LENS_PINHOLE, .width = SIDE, .height = SIDE, .params = { 45, 45, 30, 30 }
};

static cn_aovs look(const double rotation[9], const double from[3], unsigned asked)
{
    cn_view view = { 0 };
    cn_picture picture;
    cn_aovs aovs;
    const cn_render_options options = cn_render_options_default();
    memcpy(view.rotation, rotation, sizeof view.rotation);
    cn_mat3_vec(rotation, from, view.translation);
    for (int k = 0; k < 3; k++)
        view.translation[k] = -view.translation[k];
    assert_int_equal(cn_picture_init(&picture, SIDE, SIDE), CN_OK);
    assert_int_equal(cn_aovs_init(&aovs, SIDE, SIDE, asked), CN_OK);
    const cn_tile_cache_view v = { .camera = &camera, .view = &view, .options = &options };
    assert_int_equal(cn_tile_cache_alone(&tiles, &ctx, 0, &v, &picture), CN_OK);
    assert_int_equal(cn_aovs_fill(&tiles, &ctx, &(cn_aov_source){ &camera, &view, &picture, NULL, 0, 1 }, &aovs),
                     CN_OK);
    cn_picture_deinit(&picture);
    return aovs;
}

/* The pixel of a place under a camera that looks straight down from `above`, beside the block. */
static const double above[3] = { 4, 1, 7 };
static size_t below(double x, double y, double z)
{
    const double scale = 45 / (above[2] - z);
    return (size_t)(30 - scale * (y - above[1])) * SIDE + (size_t)(30 + scale * (x - above[0]));
}

static const double down[9] = { 1, 0, 0, 0, -1, 0, 0, 0, -1 }, north[9] = { 1, 0, 0, 0, 0, -1, 0, 1, 0 };

static void from_above(void **state)
{
    (void)state;
    cn_aovs a = look(down, above, ALL);
    const size_t roof = below(0, 1, TOWN_ROOF), ground = below(5, -3, TOWN_GROUND), foot = below(2.4, 1, TOWN_GROUND);
    assert_true(fabsf(a.values[DEPTH][below(4, 1, TOWN_GROUND)] - 11) < 0.3f);
    assert_true(a.values[NORMAL][3 * roof + 2] > 0.99f && a.values[NORMAL][3 * ground + 2] > 0.99f);
    assert_true(a.values[OPACITY][roof] > 0.99f);
    assert_true(a.values[OPEN][roof] > 0.9f && a.values[OPEN][ground] > 0.9f);
    assert_true(a.values[OPEN][foot] < a.values[OPEN][ground] - 0.1f); /* a wall of 4 m beside it */
    assert_true(a.values[COVERAGE][roof] == 4);
    assert_true(a.values[COVERAGE][foot] == 2); /* the block hides it from the two photos in the west */
    cn_aovs_deinit(&a);
}

static void from_the_south(void **state)
{
    (void)state;
    cn_aovs a = look(north, (const double[3]){ 0, -7, -2 }, CN_AOV_NORMAL);
    const size_t wall = (size_t)30 * SIDE + 30;
    assert_true(a.values[NORMAL][3 * wall + 1] < -0.99f);
    for (int i = 0; i < CN_AOV_COUNT; i++)
        assert_true((a.values[i] != NULL) == (i == NORMAL)); /* what nobody asked for is not there */
    cn_aovs_deinit(&a);
}

static void names(void **state)
{
    (void)state;
    unsigned aovs;
    assert_int_equal(cn_aov_parse("depth,normal,opacity,ambient_occlusion,coverage", &aovs), CN_OK);
    assert_int_equal(aovs, ALL);
    assert_int_equal(cn_aov_parse("normal", &aovs), CN_OK);
    assert_int_equal(aovs, CN_AOV_NORMAL);
    static const char *const wrong[] = { "", "depth,", ",depth", "norm", "depth normal" };
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++)
        assert_int_equal(cn_aov_parse(wrong[i], &aovs), CN_ERR_USAGE);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(from_above), cmocka_unit_test(from_the_south),
                                        cmocka_unit_test(names) };
    return cmocka_run_group_tests(tests, begin, end);
}
