/* Goes over every effect of the registry. Its gradients agree with finite differences. An effect that is off costs
 * nothing. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "base/rng.h"
#include "effect/effect.h"
#include "effect/sky_hints.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { RAYS = 24, PHOTOS = 5 };

typedef struct rig {
    float dir[RAYS][3], uv[RAYS][2];
    uint32_t photo[RAYS];
    uint8_t sky_hint[RAYS];
    cn_effect_pack pack;
    float *constants, *photos, *d_photos, *shared, *derived, *d_shared, *conditioning, *d_conditioning, *saved;
    float rgb[RAYS][3], d_rgb[RAYS][3], transmittance[RAYS], error[RAYS], scale[RAYS];
    float origin[RAYS][3], d_origin[RAYS][3], d_dir[RAYS][3];
} rig;

static float uniform(unsigned stream, size_t i)
{
    return 2 * cn_rng_float(7, stream, i) - 1;
}

static cn_effect_rays rays_of(const rig *r)
{
    return (cn_effect_rays){ RAYS, &r->dir[0][0], &r->uv[0][0], r->photo, r->sky_hint };
}

static cn_effect_state state_of(const rig *r)
{
    return (cn_effect_state){ &cn_kernel_ref, r->constants, r->photos, r->shared, r->derived };
}

static float *floats(size_t n)
{
    float *x = aligned_alloc(64, (n * sizeof *x + 127) / 64 * 64);
    assert_non_null(x);
    memset(x, 0, n * sizeof *x);
    return x;
}

static void rig_init(rig *r, uint32_t n, const char *const *names)
{
    memset(r, 0, sizeof *r);
    assert_int_equal(cn_effect_pack_make(&r->pack, n, names, PHOTOS), CN_OK);
    r->constants = floats(r->pack.n_constants);
    r->photos = floats(r->pack.n_photo);
    r->d_photos = floats(r->pack.n_photo);
    r->shared = floats(r->pack.n_shared);
    r->derived = floats(r->pack.n_shared);
    r->d_shared = floats(r->pack.n_shared);
    r->conditioning = floats((size_t)RAYS * r->pack.conditioning);
    r->d_conditioning = floats((size_t)RAYS * r->pack.conditioning);
    r->saved = floats(r->pack.saved * CN_EFFECT_RAYS);
    for (size_t i = 0; i < r->pack.n_constants; i++)
        r->constants[i] = uniform(1, i);
    for (size_t i = 0; i < r->pack.n_photo; i++)
        r->photos[i] = 0.3f * uniform(2, i);
    cn_effects_init(&r->pack, 3, r->shared);
    for (size_t i = 0; i < r->pack.n_shared; i++)
        if (r->shared[i] == 0)
            r->shared[i] = 0.2f * uniform(12, i); /* an earlier form of an effect has no first values */
    for (size_t i = 0; i < (size_t)RAYS * r->pack.conditioning; i++)
        r->d_conditioning[i] = uniform(3, i);
    for (size_t i = 0; i < RAYS; i++) {
        float length = 0;
        for (size_t a = 0; a < 3; a++) {
            r->dir[i][a] = uniform(4, 3 * i + a);
            length += r->dir[i][a] * r->dir[i][a];
            r->rgb[i][a] = 0.5f + 0.4f * uniform(5, 3 * i + a);
            r->d_rgb[i][a] = uniform(6, 3 * i + a);
        }
        for (size_t a = 0; a < 3; a++)
            r->dir[i][a] /= sqrtf(length);
        for (size_t a = 0; a < 2; a++)
            r->uv[i][a] = uniform(7, 2 * i + a);
        r->photo[i] = (uint32_t)(i % PHOTOS);
        r->sky_hint[i] = (uint8_t)(i % (CN_SKY_NONE_LAST + 1));
        r->transmittance[i] = 0.5f + 0.5f * uniform(8, i);
        r->error[i] = 0.3f + 0.3f * uniform(9, i);
        r->scale[i] = 1;
        for (size_t a = 0; a < 3; a++)
            r->d_origin[i][a] = uniform(10, 3 * i + a), r->d_dir[i][a] = uniform(11, 3 * i + a);
    }
}

static void rig_deinit(rig *r)
{
    free(r->constants), free(r->photos), free(r->d_photos), free(r->shared), free(r->derived), free(r->d_shared);
    free(r->conditioning), free(r->d_conditioning), free(r->saved);
}

/* A linear function of the effects' results, plus the loss for fixed errors. The photos' colours are not given. They
 * set the price of a transient, and gradients take this price as a constant. */
static double loss(const rig *r)
{
    const cn_effect_rays rays = rays_of(r);
    const cn_effect_state state = state_of(r);
    float rgb[RAYS][3], factor[RAYS];
    memcpy(rgb, r->rgb, sizeof rgb);
    cn_effects_derive(&r->pack, r->shared, r->derived);
    cn_effects_field_in(&r->pack, &rays, &state, r->conditioning, r->pack.conditioning);
    cn_effects_shade(&r->pack, &rays, &state, r->transmittance, &rgb[0][0], r->saved);
    const cn_effect_residuals residuals = { NULL, r->error, r->scale, r->transmittance };
    double sum = cn_effects_loss(&r->pack, &rays, &state, &residuals, factor, r->saved);
    for (size_t i = 0; i < (size_t)RAYS * r->pack.conditioning; i++)
        sum += (double)r->conditioning[i] * r->d_conditioning[i];
    float origin[RAYS][3], dir[RAYS][3];
    memcpy(origin, r->origin, sizeof origin);
    memcpy(dir, r->dir, sizeof dir);
    cn_effects_ray(&r->pack, &rays, &state, origin, dir);
    for (size_t i = 0; i < RAYS * 3; i++)
        sum += (double)(&origin[0][0])[i] * (&r->d_origin[0][0])[i] + (double)(&dir[0][0])[i] * (&r->d_dir[0][0])[i];
    for (size_t i = 0; i < RAYS * 3; i++)
        sum += (double)(&rgb[0][0])[i] * (&r->d_rgb[0][0])[i];
    return sum;
}

/* The loss is piecewise linear in most parameters. Where the differences up, down and over a wider step disagree, a
 * ReLU switches within the step or at x itself. Such a parameter is not checked. */
static void check(const rig *r, float *x, const float *gradient, size_t n)
{
    const size_t stride = n / 400 + 1;
    size_t checked = 0, turned = 0;
    for (size_t i = 0; i < n; i += stride) {
        const float kept = x[i], step[] = { -5e-3f, -2e-3f, 2e-3f, 5e-3f };
        const double here = loss(r);
        double at[4], slope[4];
        for (int k = 0; k < 4; k++) {
            x[i] = kept + step[k];
            at[k] = loss(r) - here;
            slope[k] = at[k] / ((double)x[i] - (double)kept);
        }
        x[i] = kept;
        checked++;
        const double wide = (slope[0] + slope[3]) / 2, narrow = (slope[1] + slope[2]) / 2;
        const double near = 5e-3 + 5e-3 * fabs(wide);
        if (fabs(wide - narrow) > near || fabs(slope[1] - slope[2]) > 2 * near) {
            turned++;
            continue;
        }
        if (!(fabs(narrow - gradient[i]) < 1e-2 + 1e-2 * fabs(narrow)))
            fail_msg("%s: gradient %zu is %g, differences give %g", r->pack.on[0].effect->name, i, (double)gradient[i],
                     narrow);
    }
    assert_true(turned * 5 <= checked);
}

static bool shows_none(const rig *r, uint32_t ray)
{
    return r->sky_hint[ray] == CN_SKY_NONE || r->sky_hint[ray] == CN_SKY_NONE_LATE;
}

/* Where a photo shows no sky the sky learns nothing, which is not a gradient: there the results do not count. */
static void check_gradients(uint32_t n, const char *const *names)
{
    rig r;
    rig_init(&r, n, names);
    for (uint32_t i = 0; i < RAYS; i++)
        if (shows_none(&r, i)) memset(r.d_rgb[i], 0, sizeof r.d_rgb[i]);
    const cn_effect_rays rays = rays_of(&r);
    const cn_effect_state state = state_of(&r);
    const cn_effect_grad grad = { r.d_photos, r.d_shared };
    float d_rgb[RAYS][3], d_transmittance[RAYS];
    memcpy(d_rgb, r.d_rgb, sizeof d_rgb);
    loss(&r); /* fills saved */
    const cn_effect_shading shading = { r.transmittance, r.saved, &d_rgb[0][0], d_transmittance };
    cn_effects_shade_backward(&r.pack, &rays, &state, &shading, &grad);
    cn_effects_field_in_backward(&r.pack, &rays, &state, r.d_conditioning, r.pack.conditioning, &grad);
    cn_effects_ray_backward(&r.pack, &rays, &state, r.d_origin, r.d_dir, &grad);
    check(&r, r.photos, r.d_photos, r.pack.n_photo);
    check(&r, r.shared, r.d_shared, r.pack.n_shared);
    check(&r, &r.rgb[0][0], &d_rgb[0][0], RAYS * 3);
    check(&r, r.transmittance, d_transmittance, RAYS);
    rig_deinit(&r);
}

static void test_gradients(void **state)
{
    (void)state;
    const char *names[CN_MAX_EFFECTS];
    for (uint32_t e = 0; e < cn_effect_count; e++) {
        names[e] = cn_effect_list[e]->name;
        check_gradients(1, names + e);
    }
    check_gradients(cn_effect_count, names);
}

/* Tiles of format 1 have these. */
static void test_earlier_forms_have_gradients(void **state)
{
    (void)state;
    const char *form = cn_effect_form("sky", 1);
    assert_string_not_equal(form, "sky");
    assert_string_equal(cn_effect_find(form)->name, "sky");
    assert_string_equal(cn_effect_form("sky", 3), "sky");
    assert_string_equal(cn_effect_form("exposure", 1), "exposure");
    check_gradients(1, &form);
}

static double sum_of(const float *x, size_t n)
{
    double sum = 0;
    for (size_t i = 0; i < n; i++)
        sum += fabs((double)x[i]);
    return sum;
}

/* A photo that shows no sky tells nothing about the sky's colour, but the ray's transmittance still counts. Its code is
 * drawn to the mean sky all the same. */
static void test_no_sky_tells_no_colour(void **state)
{
    (void)state;
    const char *name = "sky";
    for (int hint = CN_SKY_UNKNOWN; hint <= CN_SKY_NONE_LAST; hint++) {
        rig r;
        rig_init(&r, 1, &name);
        memset(r.sky_hint, hint, sizeof r.sky_hint);
        const cn_effect_rays rays = rays_of(&r);
        const cn_effect_state now = state_of(&r);
        float d_transmittance[RAYS];
        loss(&r); /* fills saved */
        const cn_effect_shading shading = { r.transmittance, r.saved, &r.d_rgb[0][0], d_transmittance };
        cn_effects_shade_backward(&r.pack, &rays, &now, &shading, &(cn_effect_grad){ r.d_photos, r.d_shared });
        assert_true((sum_of(r.d_shared, r.pack.n_shared) > 0) != shows_none(&r, 0));
        for (size_t k = 0; k < r.pack.n_photo && shows_none(&r, 0); k++)
            assert_true(r.photos[k] * r.d_photos[k] >= 0);
        assert_true(sum_of(r.d_photos, r.pack.n_photo) > 0);
        assert_true(sum_of(d_transmittance, RAYS) > 0);
        rig_deinit(&r);
    }
}

/* Where nothing holds a photo's gain, it is drawn to that of the others. */
static void test_gains_have_a_cost(void **state)
{
    (void)state;
    const char *name = "exposure";
    rig r;
    rig_init(&r, 1, &name);
    memset(r.d_rgb, 0, sizeof r.d_rgb);
    const cn_effect_rays rays = rays_of(&r);
    const cn_effect_state now = state_of(&r);
    float d_transmittance[RAYS];
    loss(&r); /* fills saved */
    const cn_effect_shading shading = { r.transmittance, r.saved, &r.d_rgb[0][0], d_transmittance };
    cn_effects_shade_backward(&r.pack, &rays, &now, &shading, &(cn_effect_grad){ r.d_photos, r.d_shared });
    for (size_t k = 0; k < r.pack.n_photo; k++)
        assert_true(r.photos[k] * r.d_photos[k] > 0);
    rig_deinit(&r);
}

/* A photo of unknown light has a code of zeros. Its sky is the mean of the photos' skies, before the activation. */
static void test_no_code_is_the_mean_sky(void **state)
{
    (void)state;
    const char *name = "sky";
    rig r;
    rig_init(&r, 1, &name);
    const uint32_t code = cn_effect_find(name)->photo_params;
    for (uint32_t c = 0; c < code; c++) { /* zero mean over the photos, as in training */
        float mean = 0;
        for (uint32_t p = 0; p < PHOTOS - 1; p++)
            mean += r.photos[p * code + c] / (PHOTOS - 1);
        for (uint32_t p = 0; p < PHOTOS - 1; p++)
            r.photos[p * code + c] = 3 * (r.photos[p * code + c] - mean);
        r.photos[(PHOTOS - 1) * code + c] = 0;
    }
    cn_effects_derive(&r.pack, r.shared, r.derived);
    const cn_effect_state state_now = state_of(&r);
    double logit[PHOTOS][RAYS][3];
    for (uint32_t p = 0; p < PHOTOS; p++) {
        float rgb[RAYS][3] = { { 0 } }, open[RAYS];
        for (uint32_t i = 0; i < RAYS; i++) {
            r.photo[i] = p;
            open[i] = 1;
            r.dir[i][2] = fabsf(r.dir[i][2]); /* above the horizon */
        }
        const cn_effect_rays rays = rays_of(&r);
        cn_effects_shade(&r.pack, &rays, &state_now, open, &rgb[0][0], r.saved);
        for (uint32_t i = 0; i < RAYS; i++)
            for (int c = 0; c < 3; c++)
                logit[p][i][c] = rgb[i][c] < 1 ? log((double)rgb[i][c]) : (double)rgb[i][c] - 1;
    }
    double spread = 0;
    for (uint32_t i = 0; i < RAYS; i++)
        for (int c = 0; c < 3; c++) {
            double mean = 0;
            for (uint32_t p = 0; p < PHOTOS - 1; p++) {
                mean += logit[p][i][c] / (PHOTOS - 1);
                spread = fmax(spread, fabs(logit[p][i][c] - logit[PHOTOS - 1][i][c]));
            }
            assert_true(fabs(mean - logit[PHOTOS - 1][i][c]) < 1e-4);
        }
    assert_true(spread > 1e-3);
    rig_deinit(&r);
}

/* A number of a photo's code changes the sky as far as it is large, in any direction: what a photo shows of its sky is
 * not carried on in wild slopes to where it did not look. */
static void test_a_code_changes_the_sky_evenly(void **state)
{
    (void)state;
    const char *name = "sky";
    rig r;
    rig_init(&r, 1, &name);
    for (size_t i = 0; i < r.pack.n_shared; i++)
        r.shared[i] = 2 * uniform(20, i); /* a head that was trained for long */
    cn_effects_derive(&r.pack, r.shared, r.derived);
    const uint32_t code = cn_effect_find(name)->photo_params;
    const cn_effect_state now = state_of(&r);
    float open[RAYS];
    for (int i = 0; i < RAYS; i++) {
        open[i] = 1;
        r.dir[i][2] = fabsf(r.dir[i][2]);
    }
    for (uint32_t k = 0; k < code; k++) {
        float rgb[2][RAYS][3] = { { { 0 } } }, most = 0;
        memset(r.photos, 0, r.pack.n_photo * sizeof *r.photos);
        r.photos[k] = 1; /* of photo 0; photo 1 has the mean sky */
        for (uint32_t q = 0; q < 2; q++) {
            for (int i = 0; i < RAYS; i++)
                r.photo[i] = q;
            const cn_effect_rays rays = rays_of(&r);
            cn_effects_shade(&r.pack, &rays, &now, open, &rgb[q][0][0], r.saved);
        }
        for (int i = 0; i < RAYS * 3; i++) {
            const float own = (&rgb[0][0][0])[i], mean = (&rgb[1][0][0])[i];
            const float change = (own < 1 ? logf(own) : own - 1) - (mean < 1 ? logf(mean) : mean - 1);
            most = fmaxf(most, fabsf(change));
        }
        assert_true(most > 0.01f && most < 1.001f);
    }
    rig_deinit(&r);
}

static void test_off_costs_nothing(void **state)
{
    (void)state;
    cn_effect_pack none, all, one;
    const char *names[CN_MAX_EFFECTS];
    for (uint32_t e = 0; e < cn_effect_count; e++)
        names[e] = cn_effect_list[e]->name;
    assert_int_equal(cn_effect_pack_make(&none, 0, names, PHOTOS), CN_OK);
    assert_int_equal(none.n_on + none.ray.n + none.field_in.n + none.background.n + none.pixel.n + none.loss.n +
                         none.conditioning,
                     0);
    assert_true(none.n_constants + none.n_photo + none.n_shared + none.saved == 0 && !none.wants_uv &&
                !none.wants_runs && !none.wants_stereo && !none.wants_vignetting && !none.moves_rays &&
                !none.own_rates);
    assert_int_equal(cn_effect_pack_make(&all, cn_effect_count, names, PHOTOS), CN_OK);
    uint32_t conditioning = 0;
    size_t sum = 0, steps = 0;
    for (uint32_t e = 0; e < cn_effect_count; e++) {
        assert_int_equal(cn_effect_pack_make(&one, 1, names + e, PHOTOS), CN_OK);
        assert_int_equal(one.n_on, 1);
        conditioning += one.conditioning;
        sum += one.n_constants + one.n_photo + one.n_shared + one.saved;
        steps += one.ray.n + one.field_in.n + one.background.n + one.pixel.n + one.loss.n;
        assert_true(one.ray.n + one.field_in.n + one.background.n + one.pixel.n + one.loss.n > 0 || one.wants_stereo ||
                    one.wants_vignetting);
    }
    assert_int_equal(all.conditioning, conditioning);
    assert_true(all.n_constants + all.n_photo + all.n_shared + all.saved == sum);
    assert_true(all.ray.n + all.field_in.n + all.background.n + all.pixel.n + all.loss.n == steps);
}

/* An effect that is for training only has no step in a render. One that starts later takes no part before. */
static void test_stages_follow_the_schedule(void **state)
{
    (void)state;
    for (uint32_t e = 0; e < cn_effect_count; e++) {
        const cn_effect *effect = cn_effect_list[e];
        cn_effect_pack pack;
        assert_int_equal(cn_effect_pack_make(&pack, 1, &effect->name, PHOTOS), CN_OK);
        cn_effect_pack_at(&pack, 0);
        if (effect->start > 0) assert_int_equal(pack.background.n + pack.pixel.n + pack.loss.n, 0);
        cn_effect_pack_for_render(&pack);
        if (effect->training_only) assert_int_equal(pack.background.n + pack.pixel.n + pack.loss.n, 0);
        if (effect->pixel) assert_int_equal(pack.pixel.n, !effect->training_only);
    }
}

enum { LOOKS = 600 };

/* The mean sky in each direction, before its activation. */
static void mean_sky(rig *r, const float (*dir)[3], float (*sky)[3])
{
    cn_effects_derive(&r->pack, r->shared, r->derived);
    memset(r->photos, 0, r->pack.n_photo * sizeof *r->photos);
    const cn_effect_state now = state_of(r);
    for (int first = 0; first < LOOKS; first += RAYS) {
        float rgb[RAYS][3] = { { 0 } }, open[RAYS];
        memcpy(r->dir, dir[first], sizeof r->dir);
        for (int i = 0; i < RAYS; i++)
            open[i] = 1;
        const cn_effect_rays rays = rays_of(r);
        cn_effects_shade(&r->pack, &rays, &now, open, &rgb[0][0], r->saved);
        for (int i = 0; i < RAYS; i++)
            for (int c = 0; c < 3; c++)
                sky[first + i][c] = rgb[i][c] < 1 ? logf(rgb[i][c]) : rgb[i][c] - 1;
    }
}

/* Before a tile is written, the sky becomes calm where no photo looked, and stays as it is elsewhere. */
static void test_sky_is_calm_where_no_photo_looked(void **state)
{
    (void)state;
    const char *name = "sky";
    static float dir[LOOKS][3], before[LOOKS][3], after[LOOKS][3];
    static uint8_t look[LOOKS];
    rig r;
    rig_init(&r, 1, &name);
    for (size_t i = 0; i < r.pack.n_shared; i++)
        r.shared[i] = 1.2f * uniform(20, i); /* a head that was trained for long */
    for (int i = 0; i < LOOKS; i++) {
        const float z = ((float)i + 0.5f) / LOOKS, across = sqrtf(1 - z * z);
        dir[i][0] = across * cosf(2.399963f * (float)i);
        dir[i][1] = across * sinf(2.399963f * (float)i);
        dir[i][2] = z;
        look[i] = dir[i][0] < 0.6f ? CN_LOOK_NONE : z < 0.2f ? CN_LOOK_SOMETHING : CN_LOOK_SKY;
    }
    float *kept = floats(r.pack.n_shared);
    memcpy(kept, r.shared, r.pack.n_shared * sizeof *kept);
    mean_sky(&r, (const float(*)[3])dir, before);
    const cn_effect_looks looks = { LOOKS, (const float(*)[3])dir, look };
    assert_true(cn_effect_find(name)->settle(&cn_kernel_ref, &looks, r.shared));
    mean_sky(&r, (const float(*)[3])dir, after);
    float low[3] = { 1e9f, 1e9f, 1e9f }, high[3] = { -1e9f, -1e9f, -1e9f }, moved = 0, wild[2] = { 0 };
    for (int i = 0; i < LOOKS; i++)
        for (int c = 0; c < 3 && look[i] == CN_LOOK_SKY; c++) {
            low[c] = fminf(low[c], before[i][c]);
            high[c] = fmaxf(high[c], before[i][c]);
        }
    for (int i = 0; i < LOOKS; i++)
        for (int c = 0; c < 3; c++) {
            if (look[i] != CN_LOOK_NONE) moved = fmaxf(moved, fabsf(after[i][c] - before[i][c]));
            wild[0] = fmaxf(wild[0], fmaxf(before[i][c] - high[c], low[c] - before[i][c]));
            wild[1] = fmaxf(wild[1], fmaxf(after[i][c] - high[c], low[c] - after[i][c]));
        }
    print_message("beyond the photos' sky by %.2f, before %.2f; where photos look it moved by %.3f\n", (double)wild[1],
                  (double)wild[0], (double)moved);
    assert_true(wild[0] > 1);
    assert_true(wild[1] < 0.5f * wild[0]);
    assert_true(moved < 0.2f);
    /* Where no photo shows sky, or photos look everywhere, nothing changes. */
    for (int all = 0; all < 2; all++) {
        memcpy(r.shared, kept, r.pack.n_shared * sizeof *kept);
        memset(look, all ? CN_LOOK_SKY : CN_LOOK_SOMETHING, sizeof look);
        look[0] = all ? CN_LOOK_SKY : CN_LOOK_NONE;
        assert_true(cn_effect_find(name)->settle(&cn_kernel_ref, &looks, r.shared));
        assert_memory_equal(r.shared, kept, r.pack.n_shared * sizeof *kept);
    }
    free(kept);
    rig_deinit(&r);
}

/* A transient costs more while the scene does not explain the photos yet. */
static void test_transients_wait_for_the_scene(void **state)
{
    (void)state;
    const char *names[1] = { "transient" };
    double charged[2];
    for (int learned = 0; learned < 2; learned++) {
        rig r;
        rig_init(&r, 1, names);
        const cn_effect_rays rays = rays_of(&r);
        const cn_effect_state s = state_of(&r);
        float target[RAYS][4], factor[RAYS], rgb[RAYS][3];
        for (size_t i = 0; i < RAYS; i++)
            for (size_t c = 0; c < 4; c++)
                target[i][c] = c == 3 ? 1 : learned ? r.rgb[i][c] : 1 - r.rgb[i][c];
        memset(r.error, 0, sizeof r.error);
        memcpy(rgb, r.rgb, sizeof rgb);
        cn_effects_derive(&r.pack, r.shared, r.derived);
        cn_effects_shade(&r.pack, &rays, &s, r.transmittance, &rgb[0][0], r.saved);
        const cn_effect_residuals residuals = { &target[0][0], r.error, r.scale, r.transmittance };
        charged[learned] = cn_effects_loss(&r.pack, &rays, &s, &residuals, factor, r.saved);
        rig_deinit(&r);
    }
    /* The errors are 0. The charge is then the price times the same number, which is negative here, because log beta
     * is. */
    assert_true(fabs(charged[0]) > 5 * fabs(charged[1]));
}

static void test_unknown_is_refused(void **state)
{
    (void)state;
    cn_effect_pack pack;
    const char *names[1] = { "fog_machine" };
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
        cmocka_unit_test(test_earlier_forms_have_gradients),
        cmocka_unit_test(test_no_sky_tells_no_colour),
        cmocka_unit_test(test_gains_have_a_cost),
        cmocka_unit_test(test_no_code_is_the_mean_sky),
        cmocka_unit_test(test_a_code_changes_the_sky_evenly),
        cmocka_unit_test(test_sky_is_calm_where_no_photo_looked),
        cmocka_unit_test(test_off_costs_nothing),
        cmocka_unit_test(test_stages_follow_the_schedule),
        cmocka_unit_test(test_transients_wait_for_the_scene),
        cmocka_unit_test(test_unknown_is_refused),
        cmocka_unit_test(test_names_are_unique),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
