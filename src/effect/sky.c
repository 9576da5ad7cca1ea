/* Sky. Rays that leave the scene end in a far background. A small head draws the mean sky from the direction (16
 * spherical harmonics). Each photo has its own sky: its code of 12 numbers adds a colour and the colour's slopes along
 * the three axes, before the activation that makes it light. Codes keep zero mean. A code of zeros is therefore the
 * mean of the photos' skies, and a photo of unknown light gets that sky. Codes of one capture run are pulled towards
 * each other (runs.h), also where there is only one run: it has one sky.
 *
 * Before, the head also drew what each of 8 numbers of a code adds. Of few photos that said little about a sky that
 * they do not show: the head went on in wild slopes, the more so the longer it was trained. Figures of both are in
 * tests/bench/experiments.md.
 *
 * Without a background the field draws clouds as fog near the cameras. With one it could still do so, because the head
 * cannot draw the edges of clouds. Matter above the horizon therefore costs as much as a small error, and more where
 * the photo shows sky (sky_hints.h). Where it shows none, the sky has a cost; in the later part of a long schedule it
 * has none there, for it shows between twigs too (train/sampler.c). Nor does such a photo tell the sky's colour: the
 * head would draw house walls, which then lack in the field, and go on in dark clouds above the roofs. Only at the end
 * it may, so that pinholes that are left look like the wall.
 *
 * Evidence: the share of the photos' area that looks like sky, and a twentieth of it where that may be a ceiling
 * (sky_hints.c). The threshold lies between herz-jesus (0.012) and entry-P10 and fountain-P11 (Strecha et al. 2008;
 * both 0.023). A little sky is enough: without it, matter before the roofs stands for it. Figures are in
 * tests/bench/experiments.md. */
#include "effect/effect.h"
#include "effect/head.h"
#include "effect/runs.h"
#include "effect/sky.h"
#include "effect/sky_hints.h"
#include "field/field.h"

#include <string.h>

enum { CODE = 12, IN = CN_SKY_IN, WIDTH = CN_SKY_WIDTH, OUT = CN_SKY_OUT, STREAM = 8 };
/* Of a slope in the code, over a colour: what one photo shows should not lead far beyond it. Not measured apart. */
#define SLOPE 0.3f
#define MATTER 0.012f /* loss of an opaque ray above the horizon, as a squared error. Not measured apart */
/* Loss of a ray that ends in the sky where the photo shows none. Found on castle and sceaux, standard, 400 px:
 * half-photo PSNR 26.1 and 17.4 dB without it, 29.3 and 17.4 with it, 29.0 and 16.5 with 0.1. Looked at on lund. */
#define GAP 0.03f
/* Loss of an opaque ray where the photo shows sky. Without it, light matter hangs round roofs. Standard, 400 px, one
 * seed each, plain and half-photo PSNR without hints and with 0.05 and 0.15: sacre-coeur 12.7, 14.0; 12.7, 13.1; 12.5,
 * 14.3. sceaux 13.4, 17.2; 13.8, 17.1; 14.1, 18.2 dB. */
#define SHOWN 0.15f
#define HORIZON 0.05f /* sine of the elevation */

/* Codes cost half of this times their square, as if they were normally distributed. A photo whose sky is at white says
 * only that it is no darker: its code has nothing to hold it, and went to 20, in one of 17 photos of a street, with
 * slopes as large. By the zero mean of the codes it took the others' skies along. Found on that street; five times as
 * much loses 0.1 dB of relighting on a made city. Figures are in tests/bench/experiments.md. */
#define PRIOR 2e-5f

/* The gradient of the loss of matter for each ray. It follows the head's saved floats. */
static float *d_matter(float *saved)
{
    return saved + (size_t)CN_HEAD_SAVED(IN, WIDTH, OUT) * CN_EFFECT_RAYS;
}
/* The weight of the codes' cost for each ray. */
static float *prior_of(float *saved)
{
    return d_matter(saved) + CN_EFFECT_RAYS;
}

static void init(uint64_t seed, float *shared)
{
    cn_head_init(&cn_sky_head, seed, STREAM, shared);
}
static void derive(const float *shared, float *derived)
{
    cn_head_transpose(&cn_sky_head, shared, derived);
}

static void project(const cn_effect_photos *photos, float *rows, double progress)
{
    (void)progress;
    cn_runs_draw(photos->run, photos->n, rows, CODE, CODE, CN_RUN_DRAW);
    cn_effect_zero_mean(photos->n, CODE, rows);
}

/* Colour c before its activation. */
static float logit(const cn_head_acts *a, const float *code, const float dir[3], uint32_t c, uint32_t i)
{
    float slope = 0;
    for (uint32_t k = 0; k < 3; k++)
        slope += code[3 + 3 * k + c] * dir[k];
    return *cn_head_at(a->out, OUT, c, i) + code[c] + SLOPE * slope;
}

static void background(const cn_effect_rays *rays, const cn_effect_data *data, const float *transmittance, float *rgb,
                       float *saved)
{
    const cn_head_acts a = cn_head_split(&cn_sky_head, saved);
    for (uint32_t i = 0; i < rays->n; i++)
        cn_sky_see(rays->dir + 3 * (size_t)i, &a, i);
    cn_head_forward(&cn_sky_head, data->kernel, data->derived, rays->n, &a);
    memset(d_matter(saved), 0, rays->n * sizeof *saved);
    for (uint32_t i = 0; i < rays->n; i++) {
        const float *dir = rays->dir + 3 * (size_t)i, *code = data->photo + (size_t)rays->photo[i] * CODE;
        const float open = transmittance[i] * cn_sky_cover(dir);
        for (uint32_t c = 0; c < 3; c++)
            rgb[3 * (size_t)i + c] += open * cn_field_light(logit(&a, code, dir, c, i));
    }
}

static void describe(const cn_effect_data *data, cn_device_sky *sky)
{
    _Static_assert(IN == (int)CN_DEVICE_SKY_IN && WIDTH == (int)CN_DEVICE_SKY_WIDTH && OUT == (int)CN_DEVICE_SKY_OUT &&
                       CODE == (int)CN_DEVICE_SKY_CODE,
                   "one sky");
    *sky = (cn_device_sky){ data->derived, data->photo };
}

static double loss(const cn_effect_rays *rays, const cn_effect_data *data, const cn_effect_residuals *residuals,
                   float *factor, float *saved)
{
    (void)factor;
    const float *scale = residuals->scale, *transmittance = residuals->transmittance;
    double sum = 0;
    for (uint32_t i = 0; i < rays->n; i++) {
        const uint8_t hint = rays->sky_hint ? rays->sky_hint[i] : CN_SKY_UNKNOWN;
        const bool may_be_sky = hint == CN_SKY_UNKNOWN && rays->dir[3 * (size_t)i + 2] > HORIZON;
        const float matter = hint == CN_SKY_SHOWN ? SHOWN
                             : may_be_sky         ? MATTER
                                                  : 0,
                    gap = hint == CN_SKY_NONE ? GAP : 0, slope = scale[i] * (gap - matter);
        d_matter(saved)[i] = slope;
        sum += (double)(scale[i] * (matter * (1 - transmittance[i]) + gap * transmittance[i]));
        const float *code = data->photo + (size_t)rays->photo[i] * CODE;
        prior_of(saved)[i] = scale[i] * PRIOR;
        for (uint32_t k = 0; k < CODE; k++)
            sum += (double)(0.5f * prior_of(saved)[i] * code[k] * code[k]);
    }
    return sum;
}

/* Whether a photo may tell the sky's colour there (see above; the figures are in tests/bench/experiments.md). */
static bool tells_colour(const cn_effect_rays *rays, uint32_t i)
{
    return !rays->sky_hint || (rays->sky_hint[i] != CN_SKY_NONE && rays->sky_hint[i] != CN_SKY_NONE_LATE);
}

static void background_backward(const cn_effect_rays *rays, const cn_effect_data *data,
                                const cn_effect_shading *shading, const cn_effect_grad *grad)
{
    const cn_head_acts a = cn_head_split(&cn_sky_head, shading->saved);
    for (uint32_t i = 0; i < rays->n; i++) {
        const float *dir = rays->dir + 3 * (size_t)i, open = cn_sky_cover(dir);
        const float *code = data->photo + (size_t)rays->photo[i] * CODE;
        float *d_code = grad->photo + (size_t)rays->photo[i] * CODE;
        const bool tells = tells_colour(rays, i);
        for (uint32_t c = 0; c < 3; c++) {
            const float light = cn_field_light(logit(&a, code, dir, c, i)), d = shading->d_rgb[3 * (size_t)i + c];
            const float d_logit = tells ? d * shading->transmittance[i] * open * cn_field_light_gradient(light) : 0;
            shading->d_transmittance[i] += d * open * light;
            *cn_head_at(a.d_out, OUT, c, i) = d_logit;
            d_code[c] += d_logit;
            for (uint32_t k = 0; k < 3; k++)
                d_code[3 + 3 * k + c] += SLOPE * d_logit * dir[k];
        }
        for (uint32_t k = 0; k < CODE; k++)
            d_code[k] += prior_of(shading->saved)[i] * code[k];
        shading->d_transmittance[i] += d_matter(shading->saved)[i];
        *cn_head_at(a.d_out, OUT, OUT - 1, i) = 0;
    }
    cn_head_backward(&cn_sky_head, data->kernel, data->shared, rays->n, &a, grad->shared);
}

extern const cn_effect cn_effect_sky;
const cn_effect cn_effect_sky = {
    .name = "sky",
    .summary = "rays that leave the scene end in a sky",
    .threshold = 0.017,
    .time_share = 0.05f,
    .evidence = cn_sky_hints_share,
    .wants_sky_hints = true,
    .wants_runs = true,
    .photo_params = CODE,
    .shared_params = CN_HEAD_WEIGHTS(IN, WIDTH, OUT),
    .saved = CN_HEAD_SAVED(IN, WIDTH, OUT) + 2,
    .init = init,
    .derive = derive,
    .settle = cn_sky_settle,
    .project = project,
    .cover = cn_sky_cover,
    .background = background,
    .describe = describe,
    .background_backward = background_backward,
    .loss = loss,
};
