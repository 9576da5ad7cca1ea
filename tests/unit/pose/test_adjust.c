/* Bundle adjustment of a scene: a lens that bends beyond what lenses do costs only its own refinement. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../common.h"
#include "base/rng.h"
#include "math/linalg.h"
#include "pose/adjust.h"
#include "pose/lens.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { N_VIEWS = 4, N_POINTS = 400, BENT = N_VIEWS - 1 };
#define FOCAL 600.0
#define STEP 0.3 /* between cameras */

static char logged[LOGGED];
static const cn_context CONTEXT = { .log = log_append, .user = logged };
static cn_camera cameras[N_VIEWS];
static cn_view views[N_VIEWS];
static cn_point points[N_POINTS];
static cn_observation seen[N_POINTS * N_VIEWS];
static cn_scene scene;

static double chance(uint32_t i, uint32_t k)
{
    return 2.0 * cn_rng_float(3, i, k) - 1.0;
}

/* Cameras side by side, each with a lens of its own. The last one's folds the corners of its picture. */
static int set_up(void **state)
{
    (void)state;
    static char names[N_VIEWS][8];
    uint64_t n = 0;
    logged[0] = '\0';
    for (uint32_t v = 0; v < N_VIEWS; v++) {
        snprintf(names[v], sizeof names[v], "%c.jpg", 'a' + (char)v);
        cameras[v] = (cn_camera){ v + 1, CN_LENS_SIMPLE_RADIAL, 1000, 667, { FOCAL, 500, 333.5, -0.02 } };
        views[v] = (cn_view){ .name = names[v],
                              .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 },
                              .translation = { -STEP * v, 0, 0 },
                              .camera = v,
                              .photo = v };
    }
    cameras[BENT].params[3] = -0.95;
    for (uint32_t p = 0; p < N_POINTS; p++) {
        points[p] = (cn_point){ .xyz = { 0.5 + chance(p, 0), 0.8 * chance(p, 1), 5 + chance(p, 2) },
                                .first_observation = (uint32_t)n };
        for (uint32_t v = 0; v < N_VIEWS; v++) {
            const double *x = points[p].xyz, cam[3] = { x[0] - STEP * v, x[1], x[2] };
            double xy[2];
            if (!cn_camera_project(&cameras[v], cam, xy)) continue;
            seen[n++] = (cn_observation){ v, (float)(xy[0] + 0.25 * chance(p, 10 + v)),
                                          (float)(xy[1] + 0.25 * chance(p, 20 + v)) };
            points[p].n_observations++;
        }
    }
    scene = (cn_scene){ cameras, N_VIEWS, views, N_VIEWS, points, N_POINTS, seen, n };
    return 0;
}

static cn_status adjust(bool keep_lenses)
{
    bool fixed[N_VIEWS] = { true, true };
    cn_scene_adjustment how = { .fixed = fixed, .keep_lenses = keep_lenses, .options = cn_adjust_options_default() };
    cn_adjust_result result;
    how.options.stage = "poses";
    return cn_scene_adjust(&CONTEXT, &scene, &how, &result);
}

static void test_bent_lens(void **state)
{
    (void)state;
    const cn_camera before = cameras[BENT];
    assert_int_equal(cn_camera_check_inverse(&before, "test", "a camera"), CN_ERR_FORMAT);
    assert_int_equal(adjust(false), CN_OK);
    assert_memory_equal(cameras[BENT].params, before.params, sizeof before.params);
    for (uint32_t v = 0; v < BENT; v++)
        assert_true(cameras[v].params[0] != FOCAL && fabs(cameras[v].params[0] / FOCAL - 1) < 0.05);
    assert_non_null(strstr(logged, "camera 4 (of d.jpg)"));
    assert_null(strstr(logged, "camera 1 "));
}

/* Lenses that are not adjusted are not judged. */
static void test_kept_lenses(void **state)
{
    (void)state;
    cn_camera before[N_VIEWS];
    memcpy(before, cameras, sizeof before);
    assert_int_equal(adjust(true), CN_OK);
    assert_memory_equal(cameras, before, sizeof before);
    assert_string_equal(logged, "");
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test_setup(test_bent_lens, set_up),
                                        cmocka_unit_test_setup(test_kept_lenses, set_up) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
