/* A photo sees its tile however small the reach is: photos from the air stand outside the tile that they look at. */
#include "conurb/renderer.h"
#include "city/workspace.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

enum { WIDTH = 48, HEIGHT = 32 };
static const char PHOTO[] = "run0-clear_air_0003.jpg";

/* The mean alpha of a view, and whether a tile shows it. */
static double shown(cn_renderer *r, const cn_view *view, const cn_camera *camera, bool *by_tile)
{
    const cn_render_request request = { .view = *view, .camera = *camera, .passes = CN_PASS_FULL };
    cn_render_result result;
    cn_render_job *job;
    double alpha = 0;
    assert_int_equal(cn_renderer_submit(r, &request, &job), CN_OK);
    assert_int_equal(cn_renderer_wait(job, NULL, &result), CN_OK);
    *by_tile = result.tile[0] != 0;
    for (int i = 0; i < WIDTH * HEIGHT; i++)
        alpha += (double)result.picture->rgba[4 * i + 3] / (WIDTH * HEIGHT);
    cn_renderer_release(&job);
    return alpha;
}

static void a_photo_sees_its_tile(void **state)
{
    (void)state;
    cn_context ctx = { 0 };
    cn_city *city;
    cn_dataset data;
    cn_renderer *r;
    cn_view view = { 0 };
    cn_camera camera = { 0 };
    bool by_tile;
    assert_int_equal(cn_pool_create(&ctx.pool, 2), CN_OK);
    assert_int_equal(cn_city_open(&city, DEMO), CN_OK);
    assert_int_equal(cn_dataset_load(&ctx, city, true, &data), CN_OK);
    for (uint32_t v = 0; v < data.scene.n_views; v++)
        if (strcmp(data.scene.views[v].name, PHOTO) == 0) {
            view = data.scene.views[v];
            cn_camera_resize(&data.scene.cameras[view.camera], WIDTH, HEIGHT, &camera);
            view.name = NULL;
        }
    cn_dataset_deinit(&data);
    city->config.compose.reach = 1e-3;
    assert_int_equal(cn_renderer_create(&r, &ctx, city, true), CN_OK);
    assert_true(shown(r, &view, &camera, &by_tile) > 0.9 && by_tile);
    view.translation[2] += 1e4; /* far behind: no photo stands there */
    assert_true(shown(r, &view, &camera, &by_tile) <= 0 && !by_tile);
    cn_renderer_destroy(&r);
    cn_city_close(&city);
    cn_pool_destroy(&ctx.pool);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(a_photo_sees_its_tile) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
