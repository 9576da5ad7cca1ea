/* Matter that one photo alone shows has a cost. Matter that two photos show has none. */
#include "loss/loss.h"
#include "train/composite.h"
#include "train/support.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* One group, whose first ray has three samples in as many cells. */
enum { SAMPLES = 3, LONG_AGO = 1000 };
static const uint32_t cells[SAMPLES] = { 10, 20, 30 };

typedef struct desk {
    cn_support s;
    cn_batch b;
    cn_worker w;
    size_t panel;
    uint32_t photo[CN_GROUP], samples[CN_GROUP], cell[CN_PANEL], live[SAMPLES];
    float seen[CN_PANEL], weight[SAMPLES], behind[SAMPLES], tau[SAMPLES], d_logit[SAMPLES], d_weight[SAMPLES];
    uint8_t single_view[SAMPLES];
} desk;

static int make(void **state)
{
    desk *d = calloc(1, sizeof *d);
    if (!d) return -1;
    d->s.n_photos = 2;
    d->s.photo = calloc(CN_SUPPORT_CELLS, sizeof(float));
    d->s.since = calloc(CN_SUPPORT_CELLS, sizeof(float));
    d->s.times = calloc(CN_SUPPORT_CELLS, sizeof(float));
    d->b.group_panel = &d->panel;
    d->b.ray_photo = d->photo;
    d->b.ray_samples = d->samples;
    d->s.visit = d->cell;
    d->b.visit_seen = d->seen;
    d->samples[0] = SAMPLES;
    for (uint32_t i = 0; i < SAMPLES; i++)
        d->cell[i] = cells[i], d->live[i] = i, d->seen[i] = 0.9f;
    d->w = (cn_worker){ .live = d->live,
                        .weight = d->weight,
                        .behind = d->behind,
                        .tau_gradient = d->tau,
                        .d_logit = d->d_logit,
                        .d_weight = d->d_weight,
                        .single_view = d->single_view };
    *state = d;
    return d->s.photo && d->s.since && d->s.times ? 0 : -1;
}

static int unmake(void **state)
{
    desk *d = *state;
    free(d->s.photo);
    free(d->s.since);
    free(d->s.times);
    free(d);
    return 0;
}

/* The ray of a photo is seen in steps first to last. */
static void look(desk *d, uint32_t photo, uint32_t first, uint32_t last)
{
    d->photo[0] = photo;
    for (uint32_t step = first; step < last; step++)
        cn_support_update(&d->s, &d->b, step, 0);
}

/* Weights of optical thicknesses; returns the weight in the cells that `counts` has. */
static double weigh(desk *d, const float tau[SAMPLES], const bool counts[SAMPLES])
{
    float after = 1;
    double sum = 0;
    for (uint32_t i = 0; i < SAMPLES; i++) {
        const float next = after * expf(-tau[i]);
        d->tau[i] = tau[i];
        d->weight[i] = after - next;
        d->behind[i] = after = next;
        if (counts[i]) sum += (double)d->weight[i];
    }
    return sum;
}

static const float thickness[SAMPLES] = { 0.3f, 0.8f, 1.5f };

static void gradients(desk *d, uint32_t step, const bool single[SAMPLES])
{
    const cn_span span = { .n = SAMPLES };
    weigh(d, thickness, single);
    memset(d->d_logit, 0, sizeof d->d_logit);
    cn_loss_ray ray = { .n = SAMPLES, .weight = d->weight, .single_view = d->single_view, .scale = 1 };
    float d_colour[3 * SAMPLES];
    cn_loss_grad grad = { d->d_weight, d_colour, 0 };
    cn_loss_pack pack = { .n = 1 };
    for (uint32_t i = 0; i < cn_loss_count; i++)
        if (strcmp(cn_loss_list[i]->name, "single view") == 0) pack.term[0] = cn_loss_list[i];
    cn_support_mark(&d->s, d->cell, step, &span, &d->w);
    cn_losses_add(&pack, &ray, &grad);
    cn_composite_backward(&span, 0, &d->w);
}

static void what_two_show_is_free(void **state)
{
    desk *d = *state;
    for (uint32_t step = 0; step < LONG_AGO; step++)
        look(d, step % 2, step, step + 1);
    gradients(d, LONG_AGO, (bool[SAMPLES]){ true, true, true });
    for (uint32_t i = 0; i < SAMPLES; i++)
        assert_true(d->d_logit[i] == 0);
}

/* A step of a hundredth of the half extent leads to another cell, one of a thousandth rarely; far away and where
 * nothing is defined there are cells too. */
static void cells_are_small(void **state)
{
    (void)state;
    uint32_t same = 0;
    for (int i = 0; i < 1000; i++) {
        const float x = 0.25f + 0.0005f * (float)i, contracted = 0.25f; /* of [0, 1]: four half extents */
        assert_true(cn_support_cell(x, 0.5f, 0.5f) != cn_support_cell(x + 0.01f * contracted, 0.5f, 0.5f));
        same += cn_support_cell(x, 0.5f, 0.5f) == cn_support_cell(x + 0.001f * contracted, 0.5f, 0.5f);
    }
    assert_true(same > 800);
    const float odd[] = { -1, 0, 1, 2, NAN, INFINITY };
    for (size_t i = 0; i < sizeof odd / sizeof *odd; i++)
        assert_true(cn_support_cell(odd[i], odd[i], 0.5f) < CN_SUPPORT_CELLS);
}

/* The middle cell is shown by one photo only: the gradient is that of its weight, up to the loss's factor. */
static void what_one_shows_costs(void **state)
{
    desk *d = *state;
    static const bool single[SAMPLES] = { false, true, false };
    memset(d->s.photo, 0, CN_SUPPORT_CELLS * sizeof(float));
    memset(d->s.since, 0, CN_SUPPORT_CELLS * sizeof(float));
    memset(d->s.times, 0, CN_SUPPORT_CELLS * sizeof(float));
    for (uint32_t step = 0; step < LONG_AGO; step++) {
        d->seen[1] = step % 2 ? 0.05f : 0.9f; /* the other looks through it */
        look(d, step % 2, step, step + 1);
    }
    gradients(d, LONG_AGO, single);
    assert_true(d->d_logit[1] > 0); /* less of it */
    assert_true(d->d_logit[0] < 0); /* what hides it is welcome */
    double factor = 0;
    for (uint32_t i = 0; i < SAMPLES; i++) {
        const double h = 1e-2;
        float up[SAMPLES], down[SAMPLES];
        for (uint32_t k = 0; k < SAMPLES; k++)
            up[k] = down[k] = thickness[k];
        up[i] *= (float)exp(h);
        down[i] *= (float)exp(-h);
        const double slope = (weigh(d, up, single) - weigh(d, down, single)) / (2 * h), is = (double)d->d_logit[i];
        if (i == 0) factor = is / slope;
        assert_true(fabs(is - factor * slope) < 1e-3 * fabs(factor));
    }
    assert_true(factor > 0);
}

/* A few observations by one photo in a long time do not prove that no other photo sees the cell. */
static void what_is_seldom_looked_at_is_free(void **state)
{
    desk *d = *state;
    memset(d->s.photo, 0, CN_SUPPORT_CELLS * sizeof(float));
    memset(d->s.since, 0, CN_SUPPORT_CELLS * sizeof(float));
    memset(d->s.times, 0, CN_SUPPORT_CELLS * sizeof(float));
    d->seen[1] = 0.9f;
    look(d, 1, 0, 4);
    gradients(d, LONG_AGO, (bool[SAMPLES]){ false, true, false });
    for (uint32_t i = 0; i < SAMPLES; i++)
        assert_true(d->d_logit[i] == 0);
    look(d, 1, LONG_AGO, LONG_AGO + 40);
    gradients(d, LONG_AGO + 40, (bool[SAMPLES]){ false, true, false });
    assert_true(d->d_logit[1] != 0);
}

/* Photo 0 is treated like the others: matter that it alone has shown for a short time is not single-view yet. */
static void the_first_photo_is_one_too(void **state)
{
    desk *d = *state;
    for (uint32_t photo = 0; photo < 2; photo++) {
        memset(d->s.photo, 0, CN_SUPPORT_CELLS * sizeof(float));
        memset(d->s.since, 0, CN_SUPPORT_CELLS * sizeof(float));
        memset(d->s.times, 0, CN_SUPPORT_CELLS * sizeof(float));
        d->seen[1] = 0.9f;
        look(d, photo, LONG_AGO, LONG_AGO + 20);
        gradients(d, LONG_AGO + 20, (bool[SAMPLES]){ false, true, false });
        for (uint32_t i = 0; i < SAMPLES; i++)
            assert_true(d->d_logit[i] == 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(cells_are_small), cmocka_unit_test(what_two_show_is_free),
                                        cmocka_unit_test(what_one_shows_costs),
                                        cmocka_unit_test(what_is_seldom_looked_at_is_free),
                                        cmocka_unit_test(the_first_photo_is_one_too) };
    return cmocka_run_group_tests(tests, make, unmake);
}
