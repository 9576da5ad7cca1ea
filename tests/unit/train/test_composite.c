/* Gradients with respect to densities, including the spread loss, against finite differences. */
#include "effect/display.h"
#include "loss/loss.h"
#include "train/composite.h"
#include "train/monitor.h"
#include "train/shade.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <cmocka.h>

#include <math.h>
#include <string.h>

enum { SAMPLES = 4 };
static const float at[SAMPLES] = { 2, 3, 3.1f, 9 }, thickness[SAMPLES] = { 0.2f, 0.7f, 1.1f, 0.4f };
static const float colour[3 * SAMPLES] = { 0.9f, 0.1f, 0.3f, 0.2f, 0.8f, 0.5f, 0.4f, 0.4f, 0.9f, 0.6f, 0.7f, 0.1f };
static const float d_pixel[3] = { 0.3f, -0.2f, 0.1f }, d_after = -0.15f, scale = 0.25f, prior = 0.4f;

/* Weights from optical thicknesses, and the transmittance at the end. */
static float weigh(const float tau[SAMPLES], float weight[SAMPLES], float behind[SAMPLES])
{
    float after = 1;
    for (uint32_t i = 0; i < SAMPLES; i++) {
        behind[i] = after * expf(-tau[i]);
        weight[i] = after - behind[i];
        after = behind[i];
    }
    return after;
}

/* The spread loss about a distance: the sparse point's, or the ray's own mean, which counts as a constant. */
static double loss(const float tau[SAMPLES], double about, double squared, double linear, double open)
{
    float weight[SAMPLES], behind[SAMPLES];
    double sum = (double)weigh(tau, weight, behind) * ((double)d_after + open);
    for (uint32_t i = 0; i < SAMPLES; i++) {
        const double off = log((double)at[i]) - about;
        const double cut = fmin(fabs(off), 0.7);
        double d = (double)scale * (squared * cut * cut + linear * fabs(off));
        for (uint32_t c = 0; c < 3; c++)
            d += (double)d_pixel[c] * (double)colour[3 * i + c];
        sum += (double)weight[i] * d;
    }
    return sum;
}

static void check(float sparse, double squared, double linear)
{
    float weight[SAMPLES], behind[SAMPLES], tau[SAMPLES], lit[3 * SAMPLES], d_logit[SAMPLES], d_weight[SAMPLES],
        log_at[SAMPLES];
    uint32_t live[SAMPLES];
    cn_span span = { .n = SAMPLES };
    double about = 0;
    for (uint32_t i = 0; i < SAMPLES; i++)
        live[i] = i, tau[i] = thickness[i];
    memcpy(lit, colour, sizeof lit);
    span.after = weigh(thickness, weight, behind);
    span.total = 1 - span.after;
    for (uint32_t i = 0; i < SAMPLES; i++)
        about += (double)weight[i] * log((double)at[i]) / (double)span.total;
    if (sparse > 0) about = log((double)sparse);
    cn_worker w = {
        .live = live, .weight = weight, .behind = behind, .tau_gradient = tau, .d_logit = d_logit, .d_weight = d_weight
    };
    for (uint32_t i = 0; i < SAMPLES; i++)
        log_at[i] = logf(at[i]);
    const cn_loss_ray ray = { .n = SAMPLES,
                              .weight = weight,
                              .colour = lit,
                              .log_distance = log_at,
                              .after = span.after,
                              .covered = 1,
                              .mean = (float)about,
                              .log_depth = (float)about,
                              .has_depth = sparse > 0,
                              .counts = true,
                              .d_pixel = d_pixel,
                              .scale = scale,
                              .prior_weight = prior };
    const cn_loss_scene scene = { .background = true, .sparse = true };
    float d_colour[3 * SAMPLES];
    cn_loss_grad grad = { d_weight, d_colour, d_after };
    cn_loss_pack pack;
    cn_loss_pack_make(&pack, &scene);
    cn_losses_add(&pack, &ray, &grad);
    cn_composite_backward(&span, grad.after, &w);
    for (uint32_t i = 0; i < SAMPLES; i++) {
        const double h = 1e-2, open = sparse > 0 ? (double)(scale * 0.1f) : 0;
        float up[SAMPLES], down[SAMPLES];
        for (uint32_t k = 0; k < SAMPLES; k++)
            up[k] = down[k] = thickness[k];
        up[i] *= (float)exp(h);
        down[i] *= (float)exp(-h);
        const double gradient =
            (loss(up, about, squared, linear, open) - loss(down, about, squared, linear, open)) / (2 * h);
        assert_true(fabs((double)d_logit[i] - gradient) < 1e-4 * fmax(fabs(gradient), 0.1));
    }
}

static void a_free_ray(void **state)
{
    (void)state;
    check(0, (double)0.01f, (double)(prior * 0.003f));
}

static void a_ray_through_a_point(void **state)
{
    (void)state;
    check(3.05f, (double)0.1f, (double)0.2f);
}

/* The priors have full weight until the loss is known and small. Then their weight is proportional to the loss. */
static void prior_weight_falls_with_the_error(void **state)
{
    (void)state;
    cn_monitor m = { 0 };
    assert_float_equal(cn_monitor_prior_weight(&m), 1, 0); /* nothing is known yet */
    m.steps = 1000;
    m.unexplained = 0.2;
    assert_float_equal(cn_monitor_prior_weight(&m), 1, 0);
    m.unexplained = 1e-3;
    const float small = cn_monitor_prior_weight(&m);
    assert_true(small > 0 && small < 1);
    m.unexplained = 5e-4;
    assert_float_equal(cn_monitor_prior_weight(&m), small / 2, 1e-6);
    cn_monitor_reset(&m); /* an effect sets in */
    assert_float_equal(cn_monitor_prior_weight(&m), 1, 0);
}

/* The first ray's residual counts by a tenth. */
static double distrust(const cn_effect_rays *rays, const cn_effect_data *data, const cn_effect_residuals *residuals,
                       float *factor, float *saved)
{
    (void)rays;
    (void)data;
    (void)residuals;
    (void)saved;
    factor[0] = 0.1f;
    return 0;
}

/* Residuals that an effect scales down do not count as unexplained. Neither do rays of weight 0. */
static void errors_count_as_the_loss_weighs_them(void **state)
{
    (void)state;
    static const cn_effect effect = { .name = "distrust", .loss = distrust };
    cn_effect_pack pack = { .n_on = 1, .on = { { .effect = &effect } } };
    static const uint32_t photo[CN_GROUP];
    float target[4 * CN_GROUP] = { 1, 1, 1, 1, 0.5f, 0.5f, 0.5f, 1, 1, 1, 1, 0 };
    cn_shade_grad shade_grad;
    cn_span spans[CN_GROUP] = { { 0 } };
    cn_worker w = { 0 };
    cn_step_stats plain = { 0 }, told = { 0 };
    const cn_shade shade = { .pack = &pack, .rays = { CN_GROUP, NULL, NULL, photo }, .target = target, .scale = 1 };
    const cn_effect_grad grad = { NULL, NULL };
    cn_shade_loss(&shade, spans, &w, &shade_grad, &grad, &plain);
    assert_true(plain.rays == 2 && plain.squared_error > 3);
    assert_float_equal(plain.weighed_error, plain.squared_error, 1e-6);
    assert_float_equal(plain.weight, 2, 1e-6);
    pack.loss.n = 1;
    cn_shade_loss(&shade, spans, &w, &shade_grad, &grad, &told);
    const double second = plain.squared_error - 3; /* white for black is 3 */
    assert_float_equal(told.squared_error, plain.squared_error, 1e-6);
    assert_float_equal(told.weighed_error, 0.3 + second, 1e-4);
    assert_float_equal(told.weight, 1.1, 1e-6);
}

/* The errors of 17 rays, whose photos are grey and, for the last, white, before a black pixel: their third quartile is
 * that of the 13th, b. A ray's loss is 2 b (sqrt(1 + e / b) - 1), whose slope the gradient has to be. Without this loss
 * the gradient is that of e. */
static void large_errors_count_less(void **state)
{
    (void)state;
    enum { RAYS = 17, QUARTILE = 12 };
    static const uint32_t photo[CN_GROUP];
    const cn_effect_pack pack = { 0 };
    float target[4 * CN_GROUP] = { 0 };
    double error[RAYS];
    for (uint32_t r = 0; r < RAYS; r++) {
        const float black[3] = { 0, 0, 0 }, grey = r + 1 < RAYS ? 0.01f * (float)(r + 1) : 1;
        for (int c = 0; c < 3; c++)
            target[4 * r + (uint32_t)c] = grey;
        target[4 * r + 3] = 1;
        error[r] = (double)cn_display_error(black, target + 4 * (size_t)r, 1, NULL);
        assert_true(!r || error[r] > error[r - 1]);
    }
    cn_shade_grad got;
    cn_span spans[CN_GROUP] = { { 0 } };
    cn_worker w = { 0 };
    cn_step_stats stats = { 0 };
    cn_shade shade = {
        .pack = &pack, .rays = { CN_GROUP, NULL, NULL, photo }, .target = target, .scale = 1, .charbonnier = true
    };
    cn_shade_loss(&shade, spans, &w, &got, &(cn_effect_grad){ NULL, NULL }, &stats);
    const double b = error[QUARTILE];
    for (uint32_t r = 0; r < RAYS; r++) {
        const float h = 1e-4f, pixel[3] = { h, 0, 0 };
        const double e = (double)cn_display_error(pixel, target + 4 * (size_t)r, 1, NULL),
                     slope = 2 * b * (sqrt(1 + e / b) - sqrt(1 + error[r] / b)) / (double)h;
        assert_float_equal(got.pixel[r][0], slope, 0.02 * fabs(slope));
    }
    for (uint32_t r = RAYS; r < CN_GROUP; r++)
        assert_float_equal(got.pixel[r][0], 0, 0); /* of weight 0 */
    const double tempered = (double)got.pixel[RAYS - 1][0];
    shade.charbonnier = false;
    cn_shade_loss(&shade, spans, &w, &got, &(cn_effect_grad){ NULL, NULL }, &stats);
    assert_float_equal(tempered, (double)got.pixel[RAYS - 1][0] / sqrt(1 + error[RAYS - 1] / b), 1e-5);
}

/* Without any error, and without any ray. */
static void no_errors_are_no_trouble(void **state)
{
    (void)state;
    static const uint32_t photo[CN_GROUP];
    const cn_effect_pack pack = { 0 };
    float target[4 * CN_GROUP] = { 0 };
    cn_shade_grad got;
    cn_span spans[CN_GROUP] = { { 0 } };
    cn_worker w = { 0 };
    cn_step_stats stats = { 0 };
    const cn_shade shade = {
        .pack = &pack, .rays = { CN_GROUP, NULL, NULL, photo }, .target = target, .scale = 1, .charbonnier = true
    };
    for (int round = 0; round < 2; round++) {
        cn_shade_loss(&shade, spans, &w, &got, &(cn_effect_grad){ NULL, NULL }, &stats);
        for (uint32_t r = 0; r < CN_GROUP; r++)
            for (int c = 0; c < 3; c++)
                assert_float_equal(got.pixel[r][c], 0, 0);
        for (uint32_t r = 0; r < CN_GROUP; r++)
            target[4 * r + 3] = 1;
    }
    assert_int_equal(stats.bad, 0);
}

static void the_quartile_is_of_errors_that_count(void **state)
{
    (void)state;
    const float error[] = { 4, -1, 1, 3, -1, 2 };
    assert_float_equal(cn_display_quartile(error, 6), 4, 0);
    assert_float_equal(cn_display_quartile(error, 5), 4, 0);
    assert_float_equal(cn_display_quartile(error + 1, 5), 3, 0);
    assert_float_equal(cn_display_quartile(error + 1, 1), 0, 0);
    assert_float_equal(cn_display_quartile(error, 0), 0, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(a_free_ray),
                                        cmocka_unit_test(a_ray_through_a_point),
                                        cmocka_unit_test(prior_weight_falls_with_the_error),
                                        cmocka_unit_test(errors_count_as_the_loss_weighs_them),
                                        cmocka_unit_test(large_errors_count_less),
                                        cmocka_unit_test(no_errors_are_no_trouble),
                                        cmocka_unit_test(the_quartile_is_of_errors_that_count) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
