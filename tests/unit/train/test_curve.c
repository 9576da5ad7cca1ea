/* When a validation curve is flat: never before there are enough values, and by the expected gain of the next minute,
 * not by the noise of the last value. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "base/file.h"
#include "synthetic.h"
#include "train/curve.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void test_line(void **state)
{
    (void)state;
    cn_curve curve = { 0 };
    for (uint32_t i = 0; i < CN_CURVE_POINTS; i++) {
        assert_true(cn_curve_gain(&curve, 60) == INFINITY);
        cn_curve_add(&curve, 20.0 * i, 20 + 0.5 * i);
    }
    assert_true(fabs(cn_curve_gain(&curve, 60) - 1.5) < 1e-9);
    cn_curve_add(&curve, 500, NAN); /* of no use */
    assert_true(fabs(cn_curve_gain(&curve, 60) - 1.5) < 1e-9);
    for (uint32_t i = 0; i < CN_CURVE_POINTS; i++)
        cn_curve_add(&curve, 1000 + 20.0 * i, 25); /* the old ones go */
    assert_true(fabs(cn_curve_gain(&curve, 60)) < 1e-9);
}

/* PSNR is 30 dB less a term that falls with a power of time. The predicted gain comes from the past gradient, so it is
 * at least the coming gain, and less than twice of it. */
static void test_flattens(void **state)
{
    (void)state;
    cn_curve curve = { 0 };
    double last = INFINITY;
    for (double at = 60; at < 2000; at += 20) {
        cn_curve_add(&curve, at, 30 - 4 * pow(at / 60, -1.2));
        const double comes = 4 * (pow(at / 60, -1.2) - pow((at + 60) / 60, -1.2)), said = cn_curve_gain(&curve, 60);
        if (curve.n < CN_CURVE_POINTS) continue;
        assert_true(said > comes && said <= last);
        if (at > 300) assert_true(said < 2 * comes);
        last = said;
    }
    assert_true(last < 0.01);
}

/* A curve that is flat from the start, and one that rises by a dB a value. */
typedef struct mark_job {
    const char *dir, *id;
    double psnr, rise;
    uint32_t n;
} mark_job;

static cn_status mark(void *user, double *psnr)
{
    mark_job *m = user;
    char path[160];
    snprintf(path, sizeof path, "%s/validation/%s/tile.safetensors", m->dir, m->id);
    cn_tile *tile;
    assert_int_equal(cn_tile_open(&tile, path), CN_OK); /* a whole tile, there to be rendered */
    cn_tile_close(&tile);
    *psnr = m->psnr += m->rise;
    m->n++;
    return CN_OK;
}

static uint32_t train(synthetic_scene *synthetic, double stop_gain_db, double rise, uint32_t *n_marks)
{
    char dir[96], validation[128];
    snprintf(dir, sizeof dir, "%s/t", synthetic->folder);
    snprintf(validation, sizeof validation, "%s/validation", dir);
    mark_job marks = { .dir = dir, .id = synthetic->tile.id, .psnr = 20, .rise = rise };
    cn_train_options o = synthetic_options();
    o.steps = 400;
    o.stop_gain_db = stop_gain_db;
    o.validate_every_s = 1e-9; /* at every chance: 8 steps */
    o.validate = mark;
    o.validate_user = &marks;
    const cn_context ctx = { 0 };
    const cn_train_input input = { &synthetic->scene, &synthetic->index, synthetic->pixels, &synthetic->tile };
    cn_train_result result;
    if (cn_train_tile(&ctx, &input, &o, "p", dir, &result) != CN_OK) fail_msg("%s", cn_error_message());
    assert_false(cn_file_exists(validation));
    *n_marks = marks.n;
    return result.steps;
}

static void test_stops(void **state)
{
    (void)state;
    synthetic_scene synthetic;
    uint32_t n;
    synthetic_scene_init(&synthetic, 17);
    /* The fourth value ends it, after 32 steps. The learning rate falls in the last 15 % of the steps. */
    assert_int_equal(train(&synthetic, 0.1, 0, &n), 38);
    assert_int_equal(n, CN_CURVE_POINTS);
    assert_int_equal(train(&synthetic, 0.1, 1, &n), 400);
    assert_true(n == 50);
    assert_int_equal(train(&synthetic, 0, 0, &n), 400);
    assert_int_equal(n, 0);
    synthetic_scene_deinit(&synthetic);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_line),
        cmocka_unit_test(test_flattens),
        cmocka_unit_test(test_stops),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
