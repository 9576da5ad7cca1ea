/* Goes over every loss term of the list. Its gradients agree with finite differences. A term that is off is not called.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "loss/loss.h"

#include <math.h>
#include <string.h>

enum { SAMPLES = 4 };
static float weight[SAMPLES] = { 0.1f, 0.4f, 0.3f, 0.1f };
static float colour[3 * SAMPLES] = { 0.9f, 0.1f, 3.3f, 0.2f, 0.8f, 0.5f, 0.4f, 0.4f, 0.9f, 0.6f, 7.7f, 0.1f };
static const float log_distance[SAMPLES] = { 0.3f, 1.1f, 1.13f, 1.6f }, d_pixel[3] = { 0.3f, -0.2f, 0.1f };
static const uint8_t single_view[SAMPLES] = { 0, 1, 0, 1 };

static double difference(const cn_loss_term *term, const cn_loss_ray *ray, float *at, float step)
{
    const float kept = *at, up = kept + step, down = kept - step;
    *at = up;
    const double above = term->value(ray);
    *at = down;
    const double below = term->value(ray);
    *at = kept;
    return (above - below) / ((double)up - (double)down);
}

static void check(const cn_loss_term *term, bool has_depth)
{
    cn_loss_ray ray = { .n = SAMPLES,
                        .weight = weight,
                        .colour = colour,
                        .log_distance = log_distance,
                        .single_view = single_view,
                        .after = 0.1f,
                        .covered = 0.3f,
                        .mean = 1.12f,
                        .brightest = 0.6f,
                        .log_depth = 1.2f,
                        .has_depth = has_depth,
                        .log_measured = 1.2f,
                        .has_measured = has_depth,
                        .log_plane = 1.05f,
                        .plane_width = 0.3f,
                        .has_plane = has_depth,
                        .cue_weight = 0.5f,
                        .cue_deviation = 0.1f,
                        .counts = true,
                        .d_pixel = d_pixel,
                        .scale = 0.25f,
                        .prior_weight = 0.4f };
    float d_weight[SAMPLES] = { 0 }, d_colour[3 * SAMPLES] = { 0 };
    cn_loss_grad grad = { d_weight, d_colour, 0 };
    term->add(&ray, &grad);
    const bool by_pixel = strcmp(term->name, "colour") == 0; /* shading gives the gradients of its colours */
    for (uint32_t i = 0; i <= SAMPLES + (by_pixel ? 0 : 3 * SAMPLES); i++) {
        float *at = i < SAMPLES ? &weight[i] : i == SAMPLES ? &ray.after : &colour[i - SAMPLES - 1];
        const double wide = difference(term, &ray, at, 0x1p-7f), narrow = difference(term, &ray, at, 0x1p-8f);
        const double gradient = narrow + (narrow - wide) / 3; /* Richardson: a term need not be linear in the weights */
        const double is = (double)(i < SAMPLES ? d_weight[i] : i == SAMPLES ? grad.after : d_colour[i - SAMPLES - 1]);
        if (fabs(is - gradient) > 1e-5 * fmax(fabs(gradient), 0.01))
            fail_msg("%s: gradient %u is %g, differences give %g", term->name, i, is, gradient);
    }
}

static void test_gradients(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < cn_loss_count; i++) {
        check(cn_loss_list[i], false);
        check(cn_loss_list[i], true);
    }
}

static void test_off_is_not_called(void **state)
{
    (void)state;
    for (int bits = 0; bits < 64; bits++) {
        const cn_loss_scene scene = { bits & 1,      bits >> 1 & 1, bits >> 2 & 1,
                                      bits >> 3 & 1, bits >> 4 & 1, bits >> 5 & 1 };
        cn_loss_pack pack;
        cn_loss_pack_make(&pack, &scene);
        uint32_t n = 0;
        for (uint32_t i = 0; i < cn_loss_count; i++)
            if (!cn_loss_list[i]->on || cn_loss_list[i]->on(&scene)) assert_ptr_equal(pack.term[n++], cn_loss_list[i]);
        assert_int_equal(pack.n, n);
        assert_int_equal(n, 4 + scene.sparse + scene.measured + scene.cue + scene.normals + scene.single_view);
    }
}

/* Two rays on a plane pull each other to it, and a turn of the plane costs the same at any slant. */
static void test_normal_cue_measures_a_turn(void **state)
{
    (void)state;
    const cn_loss_term *term = NULL;
    for (uint32_t i = 0; i < cn_loss_count; i++)
        if (strcmp(cn_loss_list[i]->name, "normal cue") == 0) term = cn_loss_list[i];
    assert_non_null(term);
    double costs[2];
    for (int k = 0; k < 2; k++) {
        const float width = k ? 2 : 0.02f, one = 0.9f, place = 1 + 0.1f * width;
        cn_loss_ray ray = { .n = 1,
                            .weight = &one,
                            .log_distance = &place,
                            .log_plane = 1,
                            .plane_width = width,
                            .has_plane = true,
                            .cue_weight = 1,
                            .scale = 1 };
        costs[k] = term->value(&ray);
        ray.cue_weight = 0;
        assert_true(term->value(&ray) == 0);
        ray.has_plane = false;
        ray.cue_weight = 1;
        assert_true(term->value(&ray) == 0);
    }
    assert_true(costs[0] > 0 && fabs(costs[0] / costs[1] - 1) < 1e-4);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_gradients), cmocka_unit_test(test_off_is_not_called),
                                        cmocka_unit_test(test_normal_cue_measures_a_turn) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
