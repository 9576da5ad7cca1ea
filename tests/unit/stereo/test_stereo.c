/* Depth maps of a synthetic scene: a box before a wall, seen by five cameras in a row. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "photo/store.h"
#include "stereo/stereo.h"
#include "stereo/views.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 120, HEIGHT = 90, VIEWS = 5, POINTS = 150 };
#define FOCAL 110.0
#define WALL 8.0 /* the wall stands at z = WALL + SLANT x */
#define SLANT 0.3
#define BOX 5.0 /* the front of the box, for |x| < 0.8 and |y| < 0.8 */
#define SKY 2.0 /* above this height (y < -SKY on the wall) nothing has texture */

static double depth_at(const double origin[3], double x, double y)
{
    const double dx = (x - WIDTH / 2.0) / FOCAL, dy = (y - HEIGHT / 2.0) / FOCAL, to_box = BOX - origin[2];
    if (fabs(origin[0] + dx * to_box) < 0.8 && fabs(origin[1] + dy * to_box) < 0.8) return to_box;
    return (WALL + SLANT * origin[0] - origin[2]) / (1 - SLANT * dx);
}

static float grey_at(const double p[3])
{
    if (p[1] < -SKY) return 0.5f;
    double sum = 0;
    for (int i = 0; i < 6; i++)
        sum += sin(p[0] * (3 + 2.3 * i) + 7 * i) * sin(p[1] * (2 + 2.9 * i) + 3 * i) * sin(p[2] * (1 + i) + i);
    return (float)(0.4 + 0.08 * sum);
}

typedef struct made {
    cn_camera camera;
    cn_view views[VIEWS];
    cn_point points[POINTS];
    cn_observation observations[POINTS * VIEWS];
    double centres[VIEWS][3];
    cn_scene scene;
    cn_pixel_store *pixels;
} made;

static void place(const double o[3], double x, double y, double p[3])
{
    const double z = depth_at(o, x, y);
    p[0] = o[0] + (x - WIDTH / 2.0) / FOCAL * z;
    p[1] = o[1] + (y - HEIGHT / 2.0) / FOCAL * z;
    p[2] = o[2] + z;
}

/* Points that the first view shows, as all views see them. */
static void make_points(made *m)
{
    uint64_t n = 0;
    for (uint32_t i = 0; i < POINTS; i++) {
        cn_point *p = &m->points[i];
        place(m->centres[0], 4 + (i * 37) % (WIDTH - 8), 4 + (i * 53) % (HEIGHT - 8), p->xyz);
        p->first_observation = (uint32_t)n;
        for (uint32_t v = 0; v < VIEWS; v++) {
            const double *o = m->centres[v], z = p->xyz[2] - o[2], x = FOCAL * (p->xyz[0] - o[0]) / z + WIDTH / 2.0,
                         y = FOCAL * (p->xyz[1] - o[1]) / z + HEIGHT / 2.0;
            if (x < 0 || y < 0 || x >= WIDTH || y >= HEIGHT || fabs(depth_at(o, x, y) - z) > 0.01) continue;
            m->observations[n++] = (cn_observation){ v, (float)x, (float)y };
            p->n_observations++;
        }
    }
    m->scene.n_observations = n;
}

static int begin(void **state)
{
    made *m = calloc(1, sizeof *m);
    float *rgbw = malloc(sizeof *rgbw * 4 * VIEWS * WIDTH * HEIGHT);
    if (!m || !rgbw) return 1;
    m->camera = (cn_camera){
        .lens = CN_LENS_PINHOLE, .width = WIDTH, .height = HEIGHT, .params = { FOCAL, FOCAL, WIDTH / 2.0, HEIGHT / 2.0 }
    };
    for (uint32_t v = 0; v < VIEWS; v++) {
        const double centre[3] = { 0.7 * ((double)v - 2), 0.1 * (v % 2), 0.1 * (v % 3) };
        memcpy(m->centres[v], centre, sizeof centre);
        m->views[v] = (cn_view){ .photo = v, .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 } };
        for (int a = 0; a < 3; a++)
            m->views[v].translation[a] = -centre[a];
        /* Each photo has its own exposure. */
        const float gain = 1 + 0.2f * (float)v;
        for (uint32_t i = 0; i < WIDTH * HEIGHT; i++) {
            double p[3];
            place(centre, i % WIDTH + 0.5, i / WIDTH + 0.5, p);
            const float grey = gain * grey_at(p) * grey_at(p), pixel[4] = { grey, grey, grey, 1 };
            memcpy(rgbw + 4 * ((size_t)v * WIDTH * HEIGHT + i), pixel, sizeof pixel);
        }
    }
    m->scene = (cn_scene){ .cameras = &m->camera,
                           .n_cameras = 1,
                           .views = m->views,
                           .n_views = VIEWS,
                           .points = m->points,
                           .n_points = POINTS,
                           .observations = m->observations };
    make_points(m);
    const cn_status status = cn_pixel_store_in_memory(&m->pixels, VIEWS, WIDTH, HEIGHT, rgbw);
    free(rgbw);
    *state = m;
    return status != CN_OK;
}

static int end(void **state)
{
    made *m = *state;
    cn_pixel_store_close(&m->pixels);
    free(m);
    return 0;
}

static void run(const made *m, const cn_context *ctx, uint32_t n, const uint32_t *views, cn_stereo_map *maps)
{
    cn_stereo_options options = cn_stereo_options_default();
    options.width_px = WIDTH;
    const cn_stereo_input input = { .scene = &m->scene, .pixels = m->pixels, .views = views, .n = n, .name = "made" };
    assert_int_equal(cn_stereo_run(ctx, &input, &options, maps), CN_OK);
}
static const uint32_t all[VIEWS] = { 0, 1, 2, 3, 4 };

static void test_depths_are_right_where_they_are_known(void **state)
{
    const made *m = *state;
    cn_stereo_map maps[VIEWS] = { 0 };
    run(m, NULL, VIEWS, all, maps);
    uint32_t textured = 0, known = 0, right = 0, plain = 0, invented = 0;
    for (uint32_t v = 0; v < VIEWS; v++) {
        assert_int_equal(maps[v].width, WIDTH);
        assert_int_equal(maps[v].height, HEIGHT);
        for (uint32_t i = 0; i < WIDTH * HEIGHT; i++) {
            const double x = i % WIDTH + 0.5, y = i / WIDTH + 0.5, true_m = depth_at(m->centres[v], x, y);
            const double found_m = (double)maps[v].depth_m[i];
            double p[3];
            place(m->centres[v], x, y, p);
            /* The windows reach 4 pixels beyond their centre. */
            const bool sky = p[1] < -SKY - 5 * true_m / FOCAL;
            plain += sky;
            invented += sky && found_m > 0;
            textured += p[1] > -SKY;
            known += p[1] > -SKY && found_m > 0;
            right += p[1] > -SKY && fabs(found_m - true_m) < 0.02 * true_m;
        }
        cn_stereo_map_deinit(&maps[v]);
    }
    print_message("known %.3f of the textured, right %.3f of the known; invented %.3f of the plain\n",
                  (double)known / textured, (double)right / known, (double)invented / plain);
    assert_true(known > 0.7 * textured);
    assert_true(right > 0.95 * known);
    assert_true(invented < 0.01 * plain);
}

static void test_the_number_of_threads_changes_nothing(void **state)
{
    const made *m = *state;
    cn_stereo_map one[VIEWS] = { 0 }, three[VIEWS] = { 0 };
    cn_context ctx = { 0 };
    assert_int_equal(cn_pool_create(&ctx.pool, 3), CN_OK);
    run(m, NULL, VIEWS, all, one);
    run(m, &ctx, VIEWS, all, three);
    for (uint32_t v = 0; v < VIEWS; v++) {
        assert_memory_equal(one[v].depth_m, three[v].depth_m, sizeof(float) * WIDTH * HEIGHT);
        cn_stereo_map_deinit(&one[v]);
        cn_stereo_map_deinit(&three[v]);
    }
    cn_pool_destroy(&ctx.pool);
}

/* The small picture shows all of the photo, as its camera takes it to do, also where no whole number of pixels becomes
 * one. */
static void test_a_small_picture_shows_all_of_the_photo(void **state)
{
    (void)state;
    enum { W = 121, H = 90, SMALL_W = 30, SMALL_H = 22 };
    cn_camera camera = { .lens = CN_LENS_PINHOLE, .width = W, .height = H, .params = { W, W, W / 2.0, H / 2.0 } };
    cn_view view = { .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 } };
    const cn_scene scene = { .cameras = &camera, .n_cameras = 1, .views = &view, .n_views = 1 };
    const uint32_t only[1] = { 0 };
    float *rgbw = malloc(sizeof *rgbw * 4 * W * H);
    cn_stereo_input input = { .scene = &scene, .views = only, .n = 1, .name = "made" };
    cn_stereo_options options = cn_stereo_options_default();
    cn_pixel_store *pixels;
    cn_stereo_views views;
    assert_non_null(rgbw);
    for (int along = 0; along < 2; along++) {
        for (uint32_t i = 0; i < W * H; i++) { /* as bright as it is far from the left, or from above */
            const float grey = along ? ((float)(i / W) + 0.5f) / H : ((float)(i % W) + 0.5f) / W;
            const float pixel[4] = { grey, grey, grey, 1 };
            memcpy(rgbw + 4 * (size_t)i, pixel, sizeof pixel);
        }
        assert_int_equal(cn_pixel_store_in_memory(&pixels, 1, W, H, rgbw), CN_OK);
        input.pixels = pixels;
        options.width_px = SMALL_W + 1;
        assert_int_equal(cn_stereo_views_init(&views, &input, &options), CN_OK);
        const cn_stereo_view *v = &views.view[0];
        uint32_t width, height;
        cn_stereo_size(&options, W, H, &width, &height);
        assert_true(width == SMALL_W && height == SMALL_H && v->grey);
        for (uint32_t i = 0; i < SMALL_W * SMALL_H; i++) {
            const float x = (float)(i % SMALL_W) + 0.5f, y = (float)(i / SMALL_W) + 0.5f;
            /* The pinhole camera has one focal length, so its rays leave the picture a little at its upper edge. */
            if (i / SMALL_W < 1 || i / SMALL_W > SMALL_H - 2) continue;
            double at[2];
            const double ray[3] = { (double)((x - v->cx) / v->focal), (double)((y - v->cy) / v->focal), 1 };
            assert_true(cn_camera_project(&camera, ray, at));
            const double shown = along ? at[1] / H : at[0] / W, found = (double)(v->grey[i] * v->grey[i]);
            assert_true(fabs(found - shown) < 0.5 / H);
        }
        cn_stereo_views_deinit(&views);
        cn_pixel_store_close(&pixels);
    }
    free(rgbw);
}

/* Maps stand in the order of the views, and a view that nothing can be matched with has none. */
static void test_a_view_without_a_neighbour_has_no_map(void **state)
{
    const made *m = *state;
    const uint32_t some[2] = { 3, 1 }, alone[1] = { 2 };
    cn_stereo_map maps[2] = { 0 }, lonely = { 0 };
    run(m, NULL, 2, some, maps);
    uint32_t known = 0, right = 0;
    for (uint32_t i = 0; i < WIDTH * HEIGHT; i++) {
        const double true_m = depth_at(m->centres[3], i % WIDTH + 0.5, i / WIDTH + 0.5);
        known += maps[0].depth_m[i] > 0;
        right += fabs((double)maps[0].depth_m[i] - true_m) < 0.03 * true_m;
    }
    assert_true(known > 0.3 * WIDTH * HEIGHT);
    assert_true(right > 0.9 * known);
    run(m, NULL, 1, alone, &lonely);
    assert_null(lonely.depth_m);
    for (uint32_t v = 0; v < 2; v++)
        cn_stereo_map_deinit(&maps[v]);
}

/* Depths that are 6 % wrong, as of a field, and known in three of four rows, lead to those of the photos. A view that
 * is not wanted has no map. */
static void test_a_prior_is_mended(void **state)
{
    const made *m = *state;
    cn_stereo_map prior[2], maps[VIEWS] = { 0 };
    cn_stereo_options options = cn_stereo_options_default();
    options.width_px = WIDTH;
    options.worst_cost = 0.3f;
    for (uint32_t v = 0; v < 2; v++) {
        prior[v] = (cn_stereo_map){ WIDTH, HEIGHT, calloc(WIDTH * HEIGHT, sizeof(float)) };
        assert_non_null(prior[v].depth_m);
        for (uint32_t i = 0; i < WIDTH * HEIGHT; i++)
            if (i / WIDTH % 4)
                prior[v].depth_m[i] = (float)(1.06 * depth_at(m->centres[v], i % WIDTH + 0.5, i / WIDTH + 0.5));
    }
    const cn_stereo_input input = {
        .scene = &m->scene, .pixels = m->pixels, .views = all, .n = VIEWS, .prior = prior, .n_wanted = 2
    };
    assert_int_equal(cn_stereo_run(NULL, &input, &options, maps), CN_OK);
    uint32_t textured = 0, known = 0, right = 0;
    for (uint32_t v = 0; v < 2; v++)
        for (uint32_t i = 0; i < WIDTH * HEIGHT; i++) {
            const double x = i % WIDTH + 0.5, y = i / WIDTH + 0.5, true_m = depth_at(m->centres[v], x, y);
            double p[3];
            place(m->centres[v], x, y, p);
            if (p[1] < -SKY + 5 * true_m / FOCAL) continue;
            textured++;
            known += maps[v].depth_m[i] > 0;
            right += fabs((double)maps[v].depth_m[i] - true_m) < 0.01 * true_m;
        }
    print_message("known %.3f of the textured, right to 1 %% %.3f of the known\n", (double)known / textured,
                  (double)right / known);
    assert_true(known > 0.7 * textured);
    assert_true(right > 0.85 * known);
    assert_null(maps[2].depth_m);
    for (uint32_t v = 0; v < 2; v++) {
        cn_stereo_map_deinit(&prior[v]);
        cn_stereo_map_deinit(&maps[v]);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_depths_are_right_where_they_are_known),
        cmocka_unit_test(test_a_small_picture_shows_all_of_the_photo),
        cmocka_unit_test(test_the_number_of_threads_changes_nothing),
        cmocka_unit_test(test_a_prior_is_mended),
        cmocka_unit_test(test_a_view_without_a_neighbour_has_no_map),
    };
    return cmocka_run_group_tests(tests, begin, end);
}
