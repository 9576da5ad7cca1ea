/* Extreme trainings: with one photo, with two, with photos from one place, with transients nowhere or everywhere, and
 * with a learning rate that is a hundred times too high. */
#include "hard.h"

#include "conurb/plan.h"
#include "effect/head.h"
#include "pose/align.h"

#include <fenv.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* A plan of these views. Its only tile has a range that can be marched. */
static void plan_of(const synthetic_scene *synthetic, unsigned n)
{
    const cn_context ctx = { 0 };
    const cn_scene scene = {
        .cameras = synthetic->scene.cameras, .n_cameras = 1, .views = synthetic->scene.views, .n_views = n
    };
    cn_plan_options o = cn_plan_options_default();
    o.hold_out_every = 0;
    o.min_photos = 1;
    o.rules = cn_effect_rules(&o.n_rules);
    const cn_plan_input input = {
        .scene = &scene, .photos = &synthetic->index, .pixels = synthetic->pixels, .frame = &synthetic->frame
    };
    cn_plan plan;
    hard_must(cn_plan_make(&ctx, &input, &o, &plan));
    assert_true(plan.n_tiles == 1 && plan.tiles[0].n_photos == n);
    const cn_plan_tile *t = &plan.tiles[0];
    assert_true(t->near_m > 0 && t->far_m > t->near_m && isfinite(t->far_m) && t->radius_m > 0 &&
                isfinite(t->radius_m));
    for (int a = 0; a < 3; a++)
        assert_true(isfinite(t->centre[a]) && t->bounds_max[a] >= t->bounds_min[a]);
    cn_plan_deinit(&plan);
}

/* GPS of views that are all at one place does not give a frame. The frame stays local and finite, and the log says so.
 */
static bool said_local;
static void listen_local(void *user, cn_log_level level, const char *text)
{
    (void)user;
    said_local = said_local || (level == CN_LOG_WARN && strstr(text, "place"));
}

static void align_one_place(synthetic_scene *synthetic)
{
    const cn_context ctx = { .log = listen_local };
    cn_frame frame;
    for (uint32_t i = 0; i < synthetic->index.n_photos; i++) {
        cn_photo *p = &synthetic->index.photos[i];
        p->has_gps = p->has_altitude = true;
        p->latitude_deg = 46;
        p->longitude_deg = 8;
        p->altitude_m = 400;
    }
    hard_traps_on();
    hard_must(cn_align(&ctx, &synthetic->scene, &synthetic->index, 5, CN_LEVEL_NEVER, &frame));
    hard_traps_off();
    assert_true(!frame.georeferenced && frame.scale == 1 && said_local);
}

/* One photo, two photos, and three from the same place: each is planned, trained (in one go and resumed), and sees its
 * cells. Guards: a cell is usable when as many views see it as there are, where that is one (rays/rays.c: without it a
 * single photo has no cell at all); ONE_PLACE_M of pose/align.c (without it the frame of three equal places is a
 * similarity of scale 0). */
static void test_few_photos(void **state)
{
    (void)state;
    for (unsigned n = 1; n <= 3; n++) {
        synthetic_scene synthetic;
        hard_run run;
        hard_scene_init(&synthetic, n);
        if (n == 3)
            for (unsigned i = 1; i < 3; i++) {
                memcpy(synthetic.scene.views[i].rotation, synthetic.scene.views[0].rotation,
                       sizeof synthetic.scene.views[0].rotation);
                memcpy(synthetic.scene.views[i].translation, synthetic.scene.views[0].translation,
                       sizeof synthetic.scene.views[0].translation);
            }
        plan_of(&synthetic, n);
        if (n == 3) align_one_place(&synthetic);
        hard_effects(&synthetic, "view_dependence", "exposure", "appearance", NULL);
        const cn_train_options o = hard_options();
        hard_run_init(&run, &synthetic, &o, NULL);
        for (int i = 0; i < 8; i++) {
            hard_traps_on();
            hard_must(cn_trainer_step(&run.t));
            hard_traps_off();
        }
        print_message("%u photos: %llu rays\n", n, (unsigned long long)run.t.stats.rays);
        assert_true(run.t.monitor.skipped == 0 && run.t.stats.rays > 100 && hard_finite(&run));
        hard_run_deinit(&run);
        const hard_trained t = hard_train(&synthetic, &o);
        print_message("%u photos: %.2f dB\n", n, t.psnr);
        assert_true(t.bad_rays == 0 && t.returns == 0);
        synthetic_scene_deinit(&synthetic);
    }
}

/* The transient head as it says this everywhere: rows of its output, before softplus. */
enum { CODE = 16, IN = 36, HEAD = 64, RAYS = 4 }; /* as effect/transient.c has them: what the head says below tells */
typedef struct transient_state {
    float *shared, *derived, *saved, *grad_shared, photo[CODE], grad_photo[CODE];
    cn_effect_pack pack;
} transient_state;

static void head_says(transient_state *s, float sigma, float uncertainty)
{
    const char *name = "transient";
    memset(s, 0, sizeof *s);
    hard_must(cn_effect_pack_make(&s->pack, 1, &name, 1));
    s->shared = calloc(2 * s->pack.n_shared, sizeof *s->shared);
    s->derived = calloc(s->pack.n_shared, sizeof *s->derived);
    s->saved = calloc(s->pack.saved * CN_EFFECT_RAYS, sizeof *s->saved);
    assert_true(s->shared && s->derived && s->saved);
    s->grad_shared = s->shared + s->pack.n_shared;
    /* In the middle of the photo every cosine is 1: one of them makes the first unit of each layer, and that the
     * outputs. */
    s->shared[CODE + 1] = 1;
    s->shared[HEAD * IN] = 1;
    s->shared[HEAD * IN + HEAD * HEAD] = sigma;
    s->shared[HEAD * IN + HEAD * HEAD + 4 * HEAD] = uncertainty;
    cn_effects_derive(&s->pack, s->shared, s->derived);
}
static void head_free(transient_state *s)
{
    free(s->shared);
    free(s->derived);
    free(s->saved);
}

/* beta at its floor with a perfect fit, and at the floor because there is no transient density at all; and a density so
 * large that alpha is 1: weights, losses and gradients are numbers. Guards: BETA_MIN, added after the alpha, in
 * effect/transient.c (without it a perfect fit is 0 / 0), and softplus and logistic that do not form log of exp of what
 * is large (without `x > 15` the opaque one is infinite). */
static void test_beta_at_its_floor(void **state)
{
    (void)state;
    static const float says[][2] = { { -1000, -1000 }, { -1000, 1000 }, { -90, 0 },
                                     { 0, -1000 },     { 1000, 1000 },  { 1000, -1000 } };
    static const float dir[3 * RAYS] = { 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1 }, uv[2 * RAYS],
                               after[RAYS] = { 0, 0.5f, 1, 1e-30f };
    static const uint32_t photo[RAYS];
    static const float error[RAYS] = { 0, 0, 1, 1e-30f }, scale[RAYS] = { 0.25f, 0.25f, 0.25f, 0 }, target[4 * RAYS];
    for (size_t i = 0; i < sizeof says / sizeof *says; i++) {
        transient_state s;
        head_says(&s, says[i][0], says[i][1]);
        const cn_effect_rays rays = { RAYS, dir, uv, photo, NULL };
        const cn_effect_state e = { &cn_kernel_ref, NULL, s.photo, s.shared, s.derived };
        const cn_effect_grad grad = { s.grad_photo, s.grad_shared };
        const cn_effect_residuals residuals = { target, error, scale, after };
        float rgb[3 * RAYS], factor[RAYS], d_after[RAYS];
        for (int k = 0; k < 3 * RAYS; k++)
            rgb[k] = 0.5f;
        hard_traps_on();
        fedisableexcept(FE_OVERFLOW); /* 1 / (1 + exp(1000)) is 0, as it should */
        cn_effects_shade(&s.pack, &rays, &e, after, rgb, s.saved);
        const double loss = cn_effects_loss(&s.pack, &rays, &e, &residuals, factor, s.saved);
        float d_rgb[3 * RAYS] = { 0.1f, -0.1f, 0 };
        cn_effects_shade_backward(&s.pack, &rays, &e, &(cn_effect_shading){ after, s.saved, d_rgb, d_after }, &grad);
        hard_traps_off();
        assert_true(isfinite(loss));
        for (int k = 0; k < RAYS; k++)
            assert_true(factor[k] >= 0 && factor[k] <= 1 && isfinite(d_after[k]));
        if (says[i][0] <= -90)
            assert_true(rgb[0] == 0.5f && factor[0] == 1 && d_rgb[0] == 0.1f); /* as if the effect were off */
        for (int k = 0; k < 3 * RAYS; k++)
            assert_true(isfinite(rgb[k]) && isfinite(d_rgb[k]));
        for (size_t k = 0; k < s.pack.n_shared; k++)
            assert_true(isfinite(s.grad_shared[k]));
        head_free(&s);
    }
}

/* The same in a whole training with every effect on, of photos without anything transient. */
static void test_no_transients(void **state)
{
    (void)state;
    synthetic_scene synthetic;
    hard_run run;
    hard_scene_init(&synthetic, 4);
    hard_effects(&synthetic, "view_dependence", "exposure", "transient", "pose_refinement", "sky", NULL);
    const cn_train_options o = hard_options();
    hard_run_init(&run, &synthetic, &o, NULL);
    for (uint32_t i = 0; i < o.steps; i++) {
        hard_traps_on();
        hard_must(cn_trainer_step(&run.t));
        hard_traps_off();
    }
    assert_true(run.t.bad_rays == 0 && run.t.monitor.skipped == 0 && hard_finite(&run));
    hard_run_deinit(&run);
    assert_true(hard_train(&synthetic, &o).bad_rays == 0);
    synthetic_scene_deinit(&synthetic);
}

/* What the log said. */
typedef struct ears {
    int warnings;
    char last[512];
} ears;
static void listen(void *user, cn_log_level level, const char *text)
{
    ears *e = user;
    if (level != CN_LOG_WARN || !strstr(text, "diverged at step")) return;
    e->warnings++;
    snprintf(e->last, sizeof e->last, "%s", text);
}

/* A learning rate a hundred times that of the presets: found out, taken back with a tenth of it, and said; the tile
 * that comes of it is finite and no worse than grey, and a resume on the way ends with the same bytes. Guard:
 * train/monitor.c as train.c asks it; without it training ends with what the high rate has made. */
static void test_rate_too_high(void **state)
{
    (void)state;
    synthetic_scene synthetic;
    hard_scene_init(&synthetic, 6);
    cn_train_options o = hard_options();
    o.learning_rate = 100 * cn_train_options_preset(CN_QUALITY_STANDARD).learning_rate;
    o.steps = 600;
    o.good_every = 64;
    ears e = { 0 };
    const cn_context ctx = { .log = listen, .user = &e };
    const cn_train_input input = { &synthetic.scene, &synthetic.index, synthetic.pixels, &synthetic.tile };
    cn_train_result result;
    char dir[96];
    snprintf(dir, sizeof dir, "%s/said", synthetic.folder);
    hard_must(cn_train_tile(&ctx, &input, &o, "parent", dir, &result));
    print_message("%d returns, %.2f dB; the last: %s\n", e.warnings, result.train_psnr, e.last);
    assert_true(e.warnings >= 1 && strstr(e.last, "learning rate"));
    const hard_trained t = hard_train(&synthetic, &o);
    assert_true(t.returns == e.warnings && t.psnr > 8);
    synthetic_scene_deinit(&synthetic);
}

static void listen_nothing(void *user, cn_log_level level, const char *text)
{
    if (level == CN_LOG_WARN && strstr(text, "shows nothing of its photos")) snprintf(user, 512, "%s", text);
}

/* Trainings that end before they count as diverged. Guard: warn_of_nothing of train/train.c; without it a tile of
 * nothing is made without a word. */
static void test_short_trainings(void **state)
{
    (void)state;
    synthetic_scene synthetic;
    hard_scene_init(&synthetic, 6);
    cn_train_options o = hard_options();
    for (int good = 0; good < 2; good++) {
        char said[512] = "", dir[96];
        o.learning_rate = good ? cn_train_options_preset(CN_QUALITY_STANDARD).learning_rate : 10;
        o.steps = good ? 200 : 20;
        const cn_context ctx = { .log = listen_nothing, .user = said };
        const cn_train_input input = { &synthetic.scene, &synthetic.index, synthetic.pixels, &synthetic.tile };
        cn_train_result result;
        snprintf(dir, sizeof dir, "%s/short-%d", synthetic.folder, good);
        hard_must(cn_train_tile(&ctx, &input, &o, "parent", dir, &result));
        print_message("%u steps, %.2f dB; %s\n", result.steps, result.train_psnr, said);
        assert_true(good ? !*said : strstr(said, "lower train.learning_rate") != NULL);
    }
    synthetic_scene_deinit(&synthetic);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_few_photos),      cmocka_unit_test(test_beta_at_its_floor),
        cmocka_unit_test(test_no_transients),   cmocka_unit_test(test_rate_too_high),
        cmocka_unit_test(test_short_trainings),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
