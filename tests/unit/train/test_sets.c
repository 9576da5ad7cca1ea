/* The same training by every kernel set of this machine, and by the vector source at sixteen lanes: held-out PSNR
 * within 0.1 dB of the reference's. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#ifdef CN_EMULATED
#include "../../kernel/emulated.h"
#endif
#include "conurb/measure.h"
#include "conurb/render.h"
#include "effect/display.h"
#include "synthetic.h"
#include "train/trainer.h"

#include <stdio.h>
#include <stdlib.h>

enum { STEPS = 200, WIDTH = 48, HEIGHT = 36, PIXELS = WIDTH * HEIGHT };

static synthetic_scene synthetic;

static int make(void **state)
{
    (void)state;
    synthetic_scene_init(&synthetic, 17);
    synthetic.tile.n_effects = 1;
    synthetic.tile.effects[0] = (cn_plan_effect){ .name = "exposure", .on = true };
    return 0;
}
static int unmake(void **state)
{
    (void)state;
    synthetic_scene_deinit(&synthetic);
    return 0;
}

static void train_with(const cn_context *ctx, const cn_kernel *kernel, const char *path)
{
    cn_train_options o = synthetic_options();
    const cn_train_input input = { &synthetic.scene, &synthetic.index, synthetic.pixels, &synthetic.tile };
    cn_trainer *t = calloc(1, sizeof *t);
    cn_arena counter;
    o.steps = STEPS;
    o.samples_per_step = 4096;
    t->ctx = ctx;
    assert_int_equal(cn_trainer_plan(t, &input, &o, cn_pool_threads(ctx->pool)), CN_OK);
    t->kernel = kernel;
    cn_arena_count(&counter);
    cn_trainer_carve(t, &counter);
    assert_int_equal(cn_arena_init(&t->arena, counter.used), CN_OK);
    cn_trainer_carve(t, &t->arena);
    assert_int_equal(cn_trainer_begin(t), CN_OK);
    while (t->step < STEPS)
        assert_int_equal(cn_trainer_step(t), CN_OK);
    assert_int_equal(cn_trainer_save_tile(t, "parent", path), CN_OK);
    cn_trainer_deinit(t);
    free(t);
}

/* Display-encoded, over all held-out views at once. */
static double held_out_psnr(const cn_context *ctx, const char *path)
{
    static float seen[17][PIXELS][3], wanted[17][PIXELS][3], truth[PIXELS][4];
    cn_tile *tile = NULL;
    cn_picture picture;
    cn_appearance row;
    cn_render_options options = cn_render_options_default();
    options.appearance = &row;
    assert_int_equal(cn_tile_open(&tile, path), CN_OK);
    assert_int_equal(cn_picture_init(&picture, WIDTH, HEIGHT), CN_OK);
    for (uint32_t h = 0; h < synthetic.tile.n_held_out; h++) {
        const cn_view *view = &synthetic.scene.views[synthetic.tile.held_out[h]];
        assert_int_equal(cn_tile_appearance(tile, view->name, &row), CN_OK);
        assert_int_equal(cn_render_tile(ctx, tile, &synthetic.scene.cameras[0], view, &options, &picture), CN_OK);
        assert_int_equal(cn_pixel_store_read(synthetic.pixels, view->photo, truth[0]), CN_OK);
        for (size_t i = 0; i < PIXELS; i++) {
            cn_display(picture.rgba + 4 * i, seen[h][i]);
            cn_display(truth[i], wanted[h][i]);
        }
    }
    cn_picture_deinit(&picture);
    cn_tile_close(&tile);
    return cn_measure_psnr(wanted[0][0], seen[0][0], NULL, (size_t)synthetic.tile.n_held_out * PIXELS);
}

static void test_sets_reach_the_same(void **state)
{
    (void)state;
    const cn_kernel *sets[5];
    int n = cn_kernel_sets(sets);
#ifdef CN_EMULATED
    static cn_kernel emulated;
    emulated = cn_kernel_ref;
    if (emulated_fill(&emulated)) sets[n++] = &emulated;
#endif
    cn_pool *pool = NULL;
    assert_int_equal(cn_pool_create(&pool, 0), CN_OK);
    const cn_context ctx = { .pool = pool };
    double reference = 0;
    for (int s = 0; s < n; s++) {
        char path[128];
        snprintf(path, sizeof path, "%s/%s.safetensors", synthetic.folder, sets[s]->name);
        train_with(&ctx, sets[s], path);
        const double psnr = held_out_psnr(&ctx, path);
        if (!s) reference = psnr;
        print_message("%s: held out %.3f dB after %d steps, %+.3f\n", sets[s]->name, psnr, STEPS, psnr - reference);
        assert_true(psnr > 10);
        assert_true(psnr > reference - 0.1 && psnr < reference + 0.1);
    }
    cn_pool_destroy(&pool);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_sets_reach_the_same) };
    return cmocka_run_group_tests(tests, make, unmake);
}
