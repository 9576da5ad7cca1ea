/* Extreme densities, in the compositing of training and in that of a render. */
#include "hard.h"

#include "base/rng.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static synthetic_scene synthetic;
static hard_run run;

static int make(void **state)
{
    (void)state;
    hard_scene_init(&synthetic, 2);
    const cn_train_options o = hard_options();
    hard_run_init(&run, &synthetic, &o, NULL);
    return 0;
}
static int unmake(void **state)
{
    (void)state;
    hard_traps_off();
    hard_run_deinit(&run);
    synthetic_scene_deinit(&synthetic);
    return 0;
}

typedef struct seen {
    float rgba[4], depth;
} seen;
static seen render_one(const cn_tile *tile, const double origin[3], const double dir[3])
{
    const cn_context ctx = { 0 };
    const cn_render_options o = cn_render_options_default();
    seen s;
    hard_must(cn_render_rays(&ctx, tile, &(cn_ray_list){ 1, (const double(*)[3])origin, (const double(*)[3])dir }, &o,
                             s.rgba, &s.depth));
    return s;
}

static const double origin[3] = { 0.3, -0.2, 0.1 }, dir[3] = { 0.36, 0.48, 0.8 };

/* A logit so large that alpha is 1 in float from the first sample on. Its density stays finite, forward and backward.
 * Guard: CN_DENSITY_MAX_LOGIT in field/type.h, which limits the logit. Without it a step of training and a render
 * overflow (and, without traps, the gradient has 0 times infinity). */
static void test_opaque(void **state)
{
    (void)state;
    static const float logits[] = { 15, 30, 88.8f, 1000, 1e10f };
    for (size_t i = 0; i < sizeof logits / sizeof *logits; i++) {
        hard_fill(&run, logits[i]);
        hard_traps_on();
        hard_must(cn_trainer_step(&run.t));
        hard_traps_off();
        assert_true(run.t.monitor.skipped == 0 && run.t.stats.bad == 0 && run.t.stats.live > 0);
        assert_true(isfinite(run.t.stats.gradient) && hard_finite(&run));
        if (i == 3) hard_resume(&run, &synthetic);
        hard_fill(&run, logits[i]);
        cn_tile *tile = hard_tile(&run, &synthetic, 1.0 / 64);
        hard_traps_on();
        const seen s = render_one(tile, origin, dir);
        hard_traps_off();
        assert_true(s.rgba[3] == 1 && s.rgba[0] == 1);
        assert_true(s.depth >= 1 && s.depth < 1.02f); /* the first sample, because near is 1 m */
        cn_tile_close(&tile);
    }
}

/* A ray without any density: black, alpha 0, depth 0. A step of training does not divide by the sum of the weights, and
 * all parameters stay finite. Guards: `s->total > 0` before the mean in
 * train/composite.c (without: 0 / 0), `seen` before the division by alpha in render/render.c (without: a depth that is
 * not a number). */
static void test_empty(void **state)
{
    (void)state;
    static const float logits[] = { -30, -104, -1000, -1e10f };
    for (size_t i = 0; i < sizeof logits / sizeof *logits; i++) {
        hard_fill(&run, logits[i]);
        hard_traps_on();
        hard_must(cn_trainer_step(&run.t));
        hard_traps_off();
        assert_true(run.t.monitor.skipped == 0 && run.t.stats.bad == 0 && run.t.stats.live == 0 &&
                    run.t.stats.rays > 0);
        assert_true(hard_finite(&run));
        if (i == 2) hard_resume(&run, &synthetic);
        hard_fill(&run, logits[i]);
        cn_tile *tile = hard_tile(&run, &synthetic, 1.0 / 64);
        hard_traps_on();
        const seen s = render_one(tile, origin, dir);
        hard_traps_off();
        assert_true(s.rgba[0] == 0 && s.depth == 0);
        assert_true(s.rgba[3] >= 0 && s.rgba[3] < 1e-6f);
        cn_tile_close(&tile);
    }
}

/* Contraction and compositing in double, sample by sample, for a field of constant density and colour 1. depth: the
 * median, and where less than half of the light ends the expected one. slope: of the transmittance there, over the
 * logarithm of the distance; 0 where the depth is the expected one. */
typedef struct sum {
    double alpha, depth, slope;
    unsigned n;
} sum;
static sum composite_double(const cn_box *box, double sigma)
{
    const double ratio = (double)(1 + box->step),
                 inv = 3 / (box->half_extent[0] + box->half_extent[1] + box->half_extent[2]);
    double transmittance = 1, median = 0;
    sum s = { 0 };
    for (double t = (double)box->near_m * sqrt(ratio); t < (double)box->far_m; t *= ratio, s.n++) {
        double m = 0;
        for (int a = 0; a < 3; a++)
            m = fmax(m, fabs(origin[a] - box->centre[a] + t * dir[a]) / box->half_extent[a]);
        const double length = (double)box->step * t * inv * (m > 1 ? (2 - 1 / m) / m : 1);
        const double after = transmittance * exp(-sigma * length);
        s.depth += (transmittance - after) * t;
        if (transmittance > 0.5 && after <= 0.5) {
            median = t;
            s.slope = (transmittance - after) / (double)box->step;
        }
        transmittance = after;
    }
    s.alpha = 1 - transmittance;
    s.depth = median > 0 ? median : s.depth / s.alpha;
    return s;
}

/* A render with ten thousand samples of very small weight. Their sum is not lost, because a weight that is too small
 * for a colour is added to that of the next sample. Guard: the carried weight (render/march.c). Without it the picture
 * is black where its alpha is 0.9. */
static void test_ten_thousand_samples(void **state)
{
    (void)state;
    const double far_m = synthetic.tile.far_m;
    run.t.box.far_m = (float)((double)run.t.box.near_m * pow(1.001, 10000));
    static const float logits[] = { -9, -4, -2, 0, 3 };
    for (size_t i = 0; i < sizeof logits / sizeof *logits; i++) {
        hard_fill(&run, logits[i]);
        cn_tile *tile = hard_tile(&run, &synthetic, 1e-3);
        const sum want = composite_double(&tile->box, exp((double)logits[i]));
        hard_traps_on();
        const seen s = render_one(tile, origin, dir);
        hard_traps_off();
        print_message("logit %g: %u samples, alpha %.6f (in double %.6f), colour %.6f, depth %.4f (%.4f)\n",
                      (double)logits[i], want.n, (double)s.rgba[3], want.alpha, (double)s.rgba[0], (double)s.depth,
                      want.depth);
        assert_true(want.n > 9900);
        /* A ray ends where a thousandth is left of its light; a colour is owed for 5e-4 at most; a sample's
         * transmittance is off by 3e-8 (half a unit in the last place of 1), and for very thin ones always in the same
         * direction. */
        const double ends = want.alpha > 0.999 ? 1e-3 : 0, off = 1e4 * 3e-8;
        assert_true(fabs((double)s.rgba[3] - want.alpha) < off + ends);
        assert_true(fabs((double)s.rgba[0] - (double)s.rgba[3]) < 6e-4);
        const double off_depth = want.slope > 0 ? off / want.slope : off / want.alpha;
        assert_true(fabs((double)s.depth - want.depth) < (1e-3 + off_depth) * want.depth);
        cn_tile_close(&tile);
    }
    run.t.box.far_m = (float)far_m;
}

enum { MANY = 10000 };

/* The same number in one ray of training: transmittance and weights against doubles, from samples thin and thick.
 * Guard: the product of the transmittances is not allowed to end below 0 or to grow: every factor is exp of what is not
 * positive
 * (`fminf` and a length above 0), and what is left out of the weights is less than MIN_WEIGHT, 1e-4, a sample; with ten
 * times that it fails. */
static void test_ten_thousand_in_training(void **state)
{
    (void)state;
    static float logit[MANY], length[MANY], weight[MANY], behind[MANY], tau[MANY], seen_of[MANY],
        pos[MANY / CN_PANEL + 1][3 * CN_PANEL];
    static uint32_t live[MANY], live_ray[MANY];
    const cn_field *field = &run.t.parameters.field;
    const size_t panels = MANY / CN_PANEL + 1;
    float *enc = calloc(2 * panels * field->enc_rows * CN_PANEL, sizeof *enc);
    assert_non_null(enc);
    for (int thick = 0; thick < 4; thick++) {
        cn_worker w = { .logit = logit,
                        .weight = weight,
                        .behind = behind,
                        .tau_gradient = tau,
                        .live = live,
                        .live_ray = live_ray,
                        .acts = { .enc = enc + panels * field->enc_rows * CN_PANEL } };
        double depth = 0, left_out = 0, transmittance = 1;
        const uint32_t n = MANY;
        for (uint32_t i = 0; i < n; i++) {
            logit[i] = -6 * cn_rng_float(3, 1, i) + (float)thick;
            length[i] = 1e-3f * (0.5f + cn_rng_float(3, 2, i));
            depth += exp((double)logit[i]) * (double)length[i];
        }
        cn_span span;
        const cn_composite_samples samples = { 1, &n, length, enc, pos[0], 0, seen_of };
        hard_traps_on();
        const uint32_t n_live = cn_composite_gather(field, &samples, &w, &span);
        hard_traps_off();
        for (uint32_t i = 0, k = 0; i < n; i++) {
            const double after = transmittance * exp(-exp((double)logit[i]) * (double)length[i]);
            if (k < n_live && live[k] == i) {
                assert_true(fabs((double)weight[k] - (transmittance - after)) < 1e-6);
                k++;
            } else if (transmittance > 1e-4) {
                left_out += transmittance - after;
                assert_true(transmittance - after < 1.01e-4);
            }
            transmittance = after;
        }
        print_message("depth %.2f: left %.3g (in double %.3g), %u live, %.4f left out\n", depth, (double)span.after,
                      exp(-depth), n_live, left_out);
        assert_true(fabs((double)span.after - exp(-depth)) < 2e-5 + (exp(-depth) < 1e-4 ? 1e-4 : 0));
        assert_true(fabs((double)span.total + left_out + (double)span.after - 1) < 2e-4);
    }
    free(enc);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_opaque),
        cmocka_unit_test(test_empty),
        cmocka_unit_test(test_ten_thousand_samples),
        cmocka_unit_test(test_ten_thousand_in_training),
    };
    return cmocka_run_group_tests(tests, make, unmake);
}
