/* Every effect of the registry, by being in the list: its gradients agree with finite differences, and off it costs nothing. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "base/rng.h"
#include "effect/effect.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { RAYS = 24, PHOTOS = 5 };

typedef struct rig {
    float dir[RAYS][3];
    uint32_t photo[RAYS];
    cn_effect_pack pack;
    float *constants, *params, *d_params, *columns, *d_columns;
    float rgb[RAYS][3], d_rgb[RAYS][3];
} rig;

static float uniform(unsigned stream, size_t i) { return 2 * cn_rng_float(7, stream, i) - 1; }

static cn_effect_rays rays_of(const rig *r) { return (cn_effect_rays){RAYS, &r->dir[0][0], r->photo}; }

static void rig_init(rig *r, const cn_effect *effect)
{
    memset(r, 0, sizeof *r);
    const char *names[1] = {effect->name};
    assert_int_equal(cn_effect_pack_make(&r->pack, 1, names, PHOTOS), CN_OK);
    r->constants = calloc(r->pack.n_constants + 1, sizeof(float));
    r->params = calloc(r->pack.n_params + 1, sizeof(float));
    r->d_params = calloc(r->pack.n_params + 1, sizeof(float));
    r->columns = calloc((size_t)RAYS * r->pack.columns + 1, sizeof(float));
    r->d_columns = calloc((size_t)RAYS * r->pack.columns + 1, sizeof(float));
    for (size_t i = 0; i < r->pack.n_constants; i++) r->constants[i] = uniform(1, i);
    for (size_t i = 0; i < r->pack.n_params; i++) r->params[i] = 0.3f * uniform(2, i);
    for (size_t i = 0; i < (size_t)RAYS * r->pack.columns; i++) r->d_columns[i] = uniform(3, i);
    for (size_t i = 0; i < RAYS; i++) {
        float length = 0;
        for (size_t a = 0; a < 3; a++) {
            r->dir[i][a] = uniform(4, 3 * i + a);
            length += r->dir[i][a] * r->dir[i][a];
            r->rgb[i][a] = 0.5f + 0.4f * uniform(5, 3 * i + a);
            r->d_rgb[i][a] = uniform(6, 3 * i + a);
        }
        for (size_t a = 0; a < 3; a++) r->dir[i][a] /= sqrtf(length);
        r->photo[i] = (uint32_t)(i % PHOTOS);
    }
}

static void rig_deinit(rig *r)
{
    free(r->constants), free(r->params), free(r->d_params), free(r->columns), free(r->d_columns);
}

static double loss(const rig *r)
{
    const cn_effect_rays rays = rays_of(r);
    float rgb[RAYS][3];
    memcpy(rgb, r->rgb, sizeof rgb);
    cn_effects_field_in(&r->pack, &rays, r->constants, r->params, r->columns, r->pack.columns);
    cn_effects_pixel(&r->pack, &rays, r->constants, r->params, &rgb[0][0], NULL);
    double sum = 0;
    for (size_t i = 0; i < (size_t)RAYS * r->pack.columns; i++) sum += (double)r->columns[i] * r->d_columns[i];
    for (size_t i = 0; i < RAYS * 3; i++) sum += (double)(&rgb[0][0])[i] * (&r->d_rgb[0][0])[i];
    return sum;
}

static void check(const rig *r, float *x, const float *gradient, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        const float kept = x[i], h = 1e-2f;
        x[i] = kept + h;
        const double above = loss(r);
        x[i] = kept - h;
        const double below = loss(r), numeric = (above - below) / (2 * (double)h);
        x[i] = kept;
        if (!(fabs(numeric - gradient[i]) < 1e-2 + 1e-2 * fabs(numeric)))
            fail_msg("%s: gradient %zu is %g, differences give %g", r->pack.on[0].effect->name, i, (double)gradient[i], numeric);
    }
}

static void test_gradients(void **state)
{
    (void)state;
    for (uint32_t e = 0; e < cn_effect_count; e++) {
        rig r;
        rig_init(&r, cn_effect_list[e]);
        const cn_effect_rays rays = rays_of(&r);
        float rgb[RAYS][3], d_rgb[RAYS][3], trail[RAYS * 3];
        memcpy(rgb, r.rgb, sizeof rgb);
        memcpy(d_rgb, r.d_rgb, sizeof d_rgb);
        cn_effects_pixel(&r.pack, &rays, r.constants, r.params, &rgb[0][0], trail);
        cn_effects_pixel_backward(&r.pack, &rays, r.constants, r.params, trail, &d_rgb[0][0], r.d_params);
        cn_effects_field_in_backward(&r.pack, &rays, r.constants, r.params, r.d_columns, r.pack.columns, r.d_params);
        check(&r, r.params, r.d_params, r.pack.n_params);
        check(&r, &r.rgb[0][0], &d_rgb[0][0], RAYS * 3);
        rig_deinit(&r);
    }
}

static void test_off_costs_nothing(void **state)
{
    (void)state;
    cn_effect_pack none, all, one;
    const char *names[CN_MAX_EFFECTS];
    for (uint32_t e = 0; e < cn_effect_count; e++) names[e] = cn_effect_list[e]->name;
    assert_int_equal(cn_effect_pack_make(&none, 0, names, PHOTOS), CN_OK);
    assert_int_equal(none.n_on + none.n_field_in + none.n_pixel + none.columns, 0);
    assert_true(none.n_constants == 0 && none.n_params == 0);
    assert_int_equal(cn_effect_pack_make(&all, cn_effect_count, names, PHOTOS), CN_OK);
    uint32_t columns = 0;
    size_t floats = 0;
    for (uint32_t e = 0; e < cn_effect_count; e++) {
        assert_int_equal(cn_effect_pack_make(&one, 1, names + e, PHOTOS), CN_OK);
        assert_int_equal(one.n_on, 1);
        columns += one.columns;
        floats += one.n_constants + one.n_params;
    }
    assert_int_equal(all.columns, columns);
    assert_true(all.n_constants + all.n_params == floats);
}

static void test_unknown_is_refused(void **state)
{
    (void)state;
    cn_effect_pack pack;
    const char *names[1] = {"fog_machine"};
    assert_int_equal(cn_effect_pack_make(&pack, 1, names, 1), CN_ERR_CONFIG);
    assert_non_null(strstr(cn_error_message(), "fog_machine"));
}

static void test_names_are_unique(void **state)
{
    (void)state;
    for (uint32_t a = 0; a < cn_effect_count; a++)
        for (uint32_t b = a + 1; b < cn_effect_count; b++)
            assert_string_not_equal(cn_effect_list[a]->name, cn_effect_list[b]->name);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_gradients),
        cmocka_unit_test(test_off_costs_nothing),
        cmocka_unit_test(test_unknown_is_refused),
        cmocka_unit_test(test_names_are_unique),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
