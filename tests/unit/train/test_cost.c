/* Predicted time and memory: measured once, kept in a file, and close to the real ones. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "../common.h"
#include "../field/options.h"
#include "base/file.h"
#include "base/json.h"
#include "synthetic.h"
#include "train/probe.h"
#include "train/trainer.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static cn_plan_tile tile_of(const char *effect)
{
    cn_plan_tile tile = { .id = "t", .radius_m = 5, .near_m = 1, .far_m = 30, .n_photos = 20 };
    for (int a = 0; a < 3; a++)
        tile.bounds_min[a] = -1, tile.bounds_max[a] = 1;
    if (effect) {
        strcpy(tile.effects[0].name, effect);
        tile.effects[0].on = true;
        tile.n_effects = 1;
    }
    return tile;
}

static double predict(cn_train_speed *speed, const cn_context *ctx, const cn_train_options *o, const cn_plan_tile *tile,
                      uint64_t *bytes)
{
    double seconds = 0;
    if (cn_train_speed_predict(ctx, speed, o, tile, &seconds, bytes) != CN_OK) fail_msg("%s", cn_error_message());
    return seconds;
}

static void test_measured_once(void **state)
{
    (void)state;
    char folder[] = "/tmp/conurb-cost-XXXXXX", cache[64];
    assert_non_null(mkdtemp(folder));
    snprintf(cache, sizeof cache, "%s/speed.json", folder);
    cn_train_options o = synthetic_options();
    cn_plan_tile tile = tile_of(NULL);
    const cn_context ctx = { 0 };
    cn_train_speed *speed;
    uint64_t bytes, more;
    assert_int_equal(cn_train_speed_create(&speed, cache), CN_OK);
    const double first = predict(speed, &ctx, &o, &tile, &bytes);
    assert_true(first > 0 && isfinite(first) && bytes > 0);
    /* The same to the last bit, because it is read from the file, not measured again. */
    assert_true(predict(speed, &ctx, &o, &tile, &bytes) == first);
    o.steps *= 3; /* time goes with the steps */
    assert_true(fabs(predict(speed, &ctx, &o, &tile, &bytes) - 3 * first) < 1e-9);
    o.steps /= 3;
    cn_train_speed_destroy(&speed);
    assert_int_equal(cn_train_speed_create(&speed, cache), CN_OK); /* another process */
    assert_true(predict(speed, &ctx, &o, &tile, &bytes) == first);

    field_set(&o.field, "log2_table", 13); /* other settings are measured */
    (void)predict(speed, &ctx, &o, &tile, &more);
    assert_true(more > bytes);
    field_set(&o.field, "log2_table", 12);
    tile = tile_of("exposure");
    (void)predict(speed, &ctx, &o, &tile, &more);
    assert_true(more > bytes);
    o.time_budget_s = 7;
    assert_true(predict(speed, &ctx, &o, &tile, &more) == 7);
    cn_train_speed_destroy(&speed);

    /* A file of another machine, or a damaged one: measured again. */
    json_t *root = NULL;
    assert_int_equal(cn_json_load(cache, &root), CN_OK);
    assert_int_equal(json_object_size(json_object_get(root, "full_step_s")), 3);
    json_object_set_new(root, "machine", json_string("a mainframe"));
    assert_int_equal(cn_json_save(root, cache), CN_OK);
    json_decref(root);
    o.time_budget_s = 0;
    tile = tile_of(NULL);
    assert_int_equal(cn_train_speed_create(&speed, cache), CN_OK);
    (void)predict(speed, &ctx, &o, &tile, &bytes);
    cn_train_speed_destroy(&speed);
    assert_int_equal(cn_json_load(cache, &root), CN_OK);
    assert_int_equal(json_object_size(json_object_get(root, "full_step_s")), 1);
    json_decref(root);
    assert_int_equal(cn_file_write(cache, "{", 1), CN_OK);
    assert_int_equal(cn_train_speed_create(&speed, cache), CN_OK);
    cn_train_speed_destroy(&speed);
    assert_int_equal(folder_remove(folder), 0);
}

static void test_stop_and_bad_settings(void **state)
{
    (void)state;
    cn_train_speed *speed;
    const int stop = 1;
    const cn_context ctx = { .stop = &stop };
    cn_train_options o = synthetic_options();
    const cn_plan_tile tile = tile_of(NULL);
    double seconds;
    uint64_t bytes;
    assert_int_equal(cn_train_speed_create(&speed, NULL), CN_OK);
    assert_int_equal(cn_train_speed_predict(&ctx, speed, &o, &tile, &seconds, &bytes), CN_ERR_INTERRUPTED);
    o.samples_per_step = 1;
    assert_int_equal(cn_train_speed_predict(NULL, speed, &o, &tile, &seconds, &bytes), CN_ERR_CONFIG);
    cn_train_speed_destroy(&speed);
}

/* Many steps learn few photos by heart, so a tile of few photos has fewer; never fewer than standard, and as said where
 * somebody said it. */
static void test_few_photos(void **state)
{
    (void)state;
    cn_train_options high = cn_train_options_preset(CN_QUALITY_HIGH);
    const cn_train_options standard = cn_train_options_preset(CN_QUALITY_STANDARD);
    cn_plan_tile tile = tile_of(NULL);
    uint32_t before = 0;
    for (tile.n_photos = 1; tile.n_photos < 100; tile.n_photos++) {
        const uint32_t steps = cn_train_steps(&high, &tile);
        assert_true(steps >= before && steps >= standard.steps && steps <= high.steps);
        assert_int_equal(cn_train_steps(&standard, &tile), standard.steps);
        before = steps;
    }
    assert_int_equal(before, high.steps);
    tile.n_photos = 8;
    assert_int_equal(cn_train_steps(&high, &tile), standard.steps);
    double few, as_standard, many;
    uint64_t bytes;
    cn_train_cost(&high, &tile, &few, &bytes);
    cn_train_cost(&standard, &tile, &as_standard, &bytes);
    assert_true(few == as_standard);
    high.steps_per_photo = 0;
    assert_int_equal(cn_train_steps(&high, &tile), high.steps);
    cn_train_cost(&high, &tile, &many, &bytes);
    assert_true(fabs(many - few * high.steps / standard.steps) < 1e-9 * many);
    high.steps = 10;
    high.steps_per_photo = 1;
    assert_int_equal(cn_train_steps(&high, &tile), 10);
}

/* A prediction is steps times the time of a full step times the part of its work that a step of this tile does. The
 * time of a full step is measured. The rest is compared here with counted samples: a clock would depend on what else
 * the machine does. */
static void test_right(void **state)
{
    (void)state;
    synthetic_scene synthetic;
    synthetic_scene_init(&synthetic, 17);
    cn_train_options o = synthetic_options();
    o.steps = 300;
    o.samples_per_step = 16384;
    cn_train_speed *speed;
    uint64_t bytes;
    const cn_context ctx = { 0 };
    const cn_train_input input = { &synthetic.scene, &synthetic.index, synthetic.pixels, &synthetic.tile };
    char cache[96];
    snprintf(cache, sizeof cache, "%s/speed.json", synthetic.folder);
    assert_int_equal(cn_train_speed_create(&speed, cache), CN_OK);
    const double seconds = predict(speed, &ctx, &o, &synthetic.tile, &bytes);
    cn_train_speed_destroy(&speed);
    json_t *root = NULL;
    assert_int_equal(cn_json_load(cache, &root), CN_OK);
    json_t *known = json_object_get(root, "full_step_s");
    assert_int_equal(json_object_size(known), 1);
    const double full_s = json_number_value(json_object_iter_value(json_object_iter(known)));
    json_decref(root);

    cn_trainer *t = calloc(1, sizeof *t);
    assert_non_null(t);
    synthetic_begin(t, &ctx, &input, &o);
    double samples = 0, live = 0;
    for (uint32_t i = 0; i < o.steps; i++) {
        assert_int_equal(cn_trainer_step(t), CN_OK);
        samples += (double)t->stats.samples / o.samples_per_step;
        live += (double)t->stats.live / o.samples_per_step;
    }
    const double counted = (1 - CN_LIVE_PART) * samples + CN_LIVE_PART * live, predicted = seconds / full_s;
    print_message("predicted %.0f full steps, counted %.0f in %u steps; %llu bytes\n", predicted, counted, o.steps,
                  (unsigned long long)bytes);
    assert_true(bytes == t->arena.size);
    assert_true(predicted > 0.67 * counted && predicted < 1.5 * counted);
    cn_trainer_deinit(t);
    free(t);
    synthetic_scene_deinit(&synthetic);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_few_photos),
        cmocka_unit_test(test_measured_once),
        cmocka_unit_test(test_stop_and_bad_settings),
        cmocka_unit_test(test_right),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
