/* What effects make of the rows of all photos: constants from EXIF, capture runs, zero means. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "base/rng.h"
#include "effect/effect.h"
#include "effect/pose.h"
#include "effect/runs.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { PHOTOS = 5 };
#define ALL_TOLD ((cn_effect_settings){ true, true })

static float uniform(unsigned stream, size_t i)
{
    return 2 * cn_rng_float(7, stream, i) - 1;
}

/* EXIF gives the camera's settings, which say nothing between day and night. What is left is learned everywhere. */
static void test_exposure_knows_runs(void **state)
{
    (void)state;
    const cn_effect *e = cn_effect_find("exposure");
    const double noon = 1.7e9, night = noon + 36000;
    const cn_photo photos[PHOTOS] = {
        { .exposure_s = 0.01, .iso = 100, .f_number = 1, .time_s = noon },
        { .exposure_s = 0.04, .iso = 100, .f_number = 1, .time_s = noon + 60 },
        { .exposure_s = 8, .iso = 100, .f_number = 1, .time_s = night },
        { .exposure_s = 2, .iso = 100, .f_number = 1, .time_s = night + 600 },
        { .exposure_s = NAN, .iso = 100, .f_number = 1, .time_s = night + 900 },
    };
    float row[PHOTOS][2];
    for (int i = 0; i < PHOTOS; i++)
        e->constants(&photos[i], ALL_TOLD, row[i]);
    e->centre(row[0], PHOTOS, PHOTOS);
    const float two_runs[PHOTOS] = { -1, 1, 1, -1, 0 };
    for (int i = 0; i < PHOTOS; i++)
        assert_true(fabsf(row[i][0] - two_runs[i]) < 1e-5f && row[i][1] == 1);
    for (int i = 0; i < 2; i++)
        e->constants(&photos[i], ALL_TOLD, row[i]);
    e->centre(row[0], 2, 2);
    for (int i = 0; i < 2; i++)
        assert_true(fabsf(row[i][0] - two_runs[i]) < 1e-5f && row[i][1] == 1);
}

/* Trained photos have the EV that they were trained with, whatever is held out. A held-out photo of a run of its own,
 * such as that of another stranger, has none: how bright its day was is not known. */
static void test_exposure_of_held_out_photos(void **state)
{
    (void)state;
    const cn_effect *e = cn_effect_find("exposure");
    const double noon = 1.7e9;
    const cn_photo photos[] = {
        { .exposure_s = 0.01, .iso = 100, .f_number = 1, .time_s = noon },
        { .exposure_s = 0.04, .iso = 100, .f_number = 1, .time_s = noon + 3000 },
        { .exposure_s = 0.02, .iso = 100, .f_number = 1, .time_s = noon + 1500 }, /* between the two runs */
        { .exposure_s = 0.005, .iso = 100, .f_number = 8, .time_s = noon + 9e5 }, /* days later */
        { .exposure_s = 0.08, .iso = 100, .f_number = 1, .time_s = noon + 4000 }, /* of the second run */
        { .exposure_s = 0.08, .iso = 100, .f_number = 1, .time_s = NAN },
    };
    enum { TRAINED = 2, ALL = 6 };
    float alone[TRAINED][2], row[ALL][2];
    for (int i = 0; i < ALL; i++) {
        e->constants(&photos[i], ALL_TOLD, row[i]);
        if (i < TRAINED) e->constants(&photos[i], ALL_TOLD, alone[i]);
    }
    e->centre(alone[0], TRAINED, TRAINED);
    e->centre(row[0], ALL, TRAINED);
    for (int i = 0; i < TRAINED; i++)
        assert_memory_equal(row[i], alone[i], sizeof row[i]);
    assert_true(fabsf(row[2][0]) <= 1 + 1e-5f); /* relative to one of the two */
    assert_true(row[3][0] == 0 && row[5][0] == 0);
    assert_true(fabsf(row[4][0] - 1) < 1e-5f);
    /* Trained photos of one run; one held out that has no time is of it too, one of another day is not. */
    for (int i = 0; i < ALL; i++)
        e->constants(&photos[i == 1 ? 0 : i], ALL_TOLD, row[i]);
    e->centre(row[0], ALL, TRAINED);
    assert_true(row[0][0] == 0 && row[3][0] == 0 && fabsf(row[5][0] - 3) < 1e-5f);
}

/* A photo without the f-number or the ISO that others have tells nothing: 0 when centred. So does one that alone has
 * an f-number, when it is held out. Where none has one, the exposure times are enough. */
static void test_exposure_of_photos_that_lack_settings(void **state)
{
    (void)state;
    enum { N = 5 };
    const cn_effect *e = cn_effect_find("exposure");
    cn_photo photos[N] = {
        { .exposure_s = 0.01, .iso = 100, .f_number = 8, .time_s = NAN },
        { .exposure_s = 0.04, .iso = 100, .f_number = 8, .time_s = NAN },
        { .exposure_s = 0.02, .iso = 100, .f_number = NAN, .time_s = NAN },
        { .exposure_s = 0.02, .iso = NAN, .f_number = 8, .time_s = NAN },
        { .exposure_s = NAN, .iso = 100, .f_number = 8, .time_s = NAN },
    };
    const float expected[N] = { -1, 1, 0, 0, 0 };
    const cn_photo_index index = { .photos = photos, .n_photos = N };
    cn_view views[N] = { { .photo = 0 }, { .photo = 1 }, { .photo = 2 }, { .photo = 3 }, { .photo = 4 } };
    const cn_scene scene = { .views = views, .n_views = N };
    uint32_t list[N] = { 0, 1, 2, 3, 4 };
    for (int without = 0; without < 2; without++) {
        for (int i = 0; i < 2 && without; i++)
            photos[i].f_number = NAN;
        photos[2].iso = without ? 0 : 100;
        float row[N][2];
        const cn_plan_tile tile = { .photos = list, .n_photos = without ? 2 : N };
        const cn_effect_settings told = cn_effect_settings_told(&index, &scene, &tile);
        assert_true(told.iso && told.f_number == !without);
        for (int i = 0; i < N; i++)
            e->constants(&photos[i], told, row[i]);
        e->centre(row[0], N, without ? 2 : N);
        for (int i = 0; i < N; i++)
            assert_true(fabsf(row[i][0] - expected[i]) < 1e-5f && row[i][1] == 1);
    }
}

/* The number of runs does not matter. A photo without a run stays as it is. */
static void test_runs_are_drawn_together(void **state)
{
    (void)state;
    enum { N = 1500, STRIDE = 3, WIDTH = 2 };
    float *run = malloc(N * sizeof *run), (*row)[STRIDE] = malloc(N * sizeof *row);
    assert_true(run && row);
    for (int i = 0; i < N; i++) {
        run[i] = (float)(i % 500); /* 0: no run; each other run has three photos */
        for (int c = 0; c < STRIDE; c++)
            row[i][c] = (float)(i / 500 * (c + 1));
    }
    cn_runs_draw(run, N, row[0], STRIDE, WIDTH, 0.25f);
    for (int i = 0; i < N; i++)
        for (int c = 0; c < STRIDE; c++) {
            const float was = (float)(i / 500 * (c + 1)), mean = (float)(c + 1);
            assert_true(fabsf(row[i][c] - (run[i] > 0 && c < WIDTH ? was + 0.25f * (mean - was) : was)) < 1e-6f);
        }
    free(run);
    free(row);
}

/* Photos of one capture run share one sky, also where there is no other run. Their light may still differ. */
static void test_one_run_has_one_sky(void **state)
{
    (void)state;
    static const char *const names[] = { "sky", "appearance" };
    static const float run[4] = { 1, 1, 1, 1 };
    for (int k = 0; k < 2; k++) {
        const cn_effect *e = cn_effect_find(names[k]);
        float rows[4 * 16];
        assert_true(e->photo_params <= 16);
        for (uint32_t i = 0; i < 4 * e->photo_params; i++)
            rows[i] = i / e->photo_params % 2 ? 1 : -1;
        const cn_effect_photos photos = { 4, NULL, run, NULL };
        e->project(&photos, rows, 1);
        for (uint32_t i = 0; i < 4 * e->photo_params; i++)
            assert_true(fabsf(fabsf(rows[i]) - (k ? 1 : 1 - CN_RUN_DRAW)) < 1e-6f);
    }
}

/* If the cameras stretch or shear together with the scene, the photos stay the same. Moves therefore keep only the part
 * that is not linear in the cameras' places. */
static void test_moves_have_no_trend(void **state)
{
    (void)state;
    enum { N = 40, WIDTH = 12 };
    const cn_effect *e = cn_effect_find("pose_refinement");
    static float place[N][3], along[N][3], row[N][WIDTH], odd[N], unknown[N];
    assert_int_equal(e->photo_params, WIDTH);
    for (int on_a_line = 0; on_a_line < 2; on_a_line++) {
        for (uint32_t n = 8; n <= N; n += N - 8) {
            for (uint32_t i = 0; i < n; i++) {
                for (size_t a = 0; a < 3; a++)
                    place[i][a] = on_a_line ? (float)i / (float)n * (float)(a + 1) : uniform(61, 3 * i + a);
                odd[i] = 0.01f * (float)(i % 4 == 0 || i % 4 == 3 ? 1 : -1);
                memset(row[i], 0, sizeof row[i]);
                for (int c = 0; c < 3; c++)
                    row[i][3 + c] = 0.1f * place[i][0] + 0.05f * (float)c * place[i][2] + odd[i];
            }
            cn_pose_trends(n, (const float(*)[3])place, along);
            const cn_effect_photos photos = { n, unknown, NULL, (const float(*)[3])along };
            e->project(&photos, row[0], 1);
            double left = 0, trend = 0;
            for (uint32_t i = 0; i < n; i++) {
                assert_true(isfinite(row[i][3]) && row[i][0] == 0 && row[i][6] == 0);
                left += (double)(row[i][3] * odd[i]) / n / 1e-4;
                trend += (double)(row[i][3] * place[i][0]) / n;
            }
            /* With few photos a trend is a large part of what can be learned. It stays. */
            assert_true(n < 12 ? trend > 1e-3 : fabs(trend) < 1e-6 && left > 0.75);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_exposure_knows_runs),
        cmocka_unit_test(test_exposure_of_held_out_photos),
        cmocka_unit_test(test_exposure_of_photos_that_lack_settings),
        cmocka_unit_test(test_runs_are_drawn_together),
        cmocka_unit_test(test_one_run_has_one_sky),
        cmocka_unit_test(test_moves_have_no_trend),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
