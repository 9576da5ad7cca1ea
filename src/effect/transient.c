/* Transient embedding with uncertainty (after Martin-Brualla et al., "NeRF in the Wild", CVPR 2021, section 4.2).
 * Things that are in one photo only (people, cars) get a density, a colour and an uncertainty beta of their own. A
 * render leaves them out.
 *
 * Each photo has its own transients, and shows them from one place only. Their distance along the ray cannot be
 * known, and does not matter. The transient is therefore one layer of unit thickness in front of the scene, and not
 * a density in every sample: sigma(code, place in the photo), alpha = 1 - exp(-sigma), colour = (1 - alpha) scene +
 * alpha own. No sample belongs to both, so removing the layer cannot darken a render, and the cost is one small head
 * a ray. The place in the photo enters by Fourier features (Tancik et al. 2020) and by a hash grid over photo and
 * place (after Mueller et al. 2022). All photos share one table; entries go to the places that have transients,
 * because only these have gradients.
 *
 * Loss of a ray, scaled so that a ray without transients weighs 1 (E: squared error summed over channels): E
 * beta_min^2 / beta^2 + price (log beta + 1.1 alpha / (alpha + 0.1)), with beta = beta_min + 0.3 alpha logistic(b).
 * beta_min is added after the alpha, so a ray without transient density never divides by zero. The colours' gradients
 * are then taken down for large errors, as in tiles without transients (train/shade.c).
 *
 * Two things differ from the paper, where the second cost is lambda sigma and beta has no bound. First, a thin veil
 * costs nearly as much as an occluder. With lambda sigma a photo's veil explains part of the scene, and the render
 * loses it (0.4 dB on photos with nothing transient in them). Second, beta is bounded. Otherwise a layer that hides
 * nothing could still excuse all errors under it.
 *
 * The price is 2 beta_min^2 as in the paper, or more while the scene is not yet explained: the third quartile of the
 * errors of these rays without their transients. Otherwise everything that the scene has not learned yet, such as
 * four lights at once, counts as transient, and the scene never learns it. The effect starts after a tenth of the
 * schedule, or 150 steps, when exposure and appearance have converged; earlier it would take a change of light for
 * an occluder.
 *
 * Evidence: the share of places where a tracked point should be seen but is not tracked, and whose colour no gain
 * explains; less what that share has by chance, and less that share where the point is tracked (tracks.h). Photos by
 * many strangers have 0.03 more, few photos a twentieth. */
#include "effect/display.h"
#include "effect/effect.h"
#include "effect/head.h"
#include "effect/tracks.h"

#include <math.h>
#include <string.h>

enum { CODE = 16, OCTAVES = 3, LEVELS = 4, COARSEST = 8, ENTRIES = 1 << 13, FEATURES = 2 };
enum { IN = CODE + 4 * OCTAVES + LEVELS * FEATURES, WIDTH = 64, OUT = 8, STREAM = 9 };
enum { TABLE = CN_HEAD_WEIGHTS(IN, WIDTH, OUT) }; /* after the head's weights: [LEVELS][ENTRIES][FEATURES] */
enum { SIGMA = 0, COLOUR = 1, UNCERTAINTY = 4 };  /* rows of the head's output */
static const cn_head head = { IN, WIDTH, OUT };

/* Brightest colour of the layer; a photo ends at 1. A larger value would let a thin bright veil explain everything. Not
 * measured apart. */
#define BRIGHTEST 1.2f
/* Not measured apart. */
#define SIGMA_BIAS (-2.0f) /* at first nothing is transient */
#define LEAST_RAW (-6.0f)  /* alpha 0.0025 */
#define BETA_MIN 0.1f
#define UNSURE 0.3f /* the most that beta is above its floor */
#define VEIL 0.1f   /* an alpha up to which a layer is a veil */

/* One float for each ray, after the head's saved floats. */
enum { BEFORE = 0, D_BETA = 3, D_SIGMA = 4, OWN = 5 };
static float *own(float *saved, uint32_t what)
{
    return saved + (size_t)(CN_HEAD_SAVED(IN, WIDTH, OUT) + what) * CN_EFFECT_RAYS;
}

static float softplus(float x)
{
    return x > 15 ? x : log1pf(expf(x));
}
static float logistic(float x)
{
    return 1 / (1 + expf(-x));
}

typedef struct layer {
    float alpha, colour[3], beta;
} layer;
static layer layer_of(const cn_head_acts *a, uint32_t i)
{
    layer l;
    l.alpha = 1 - expf(-softplus(*cn_head_at(a->out, OUT, SIGMA, i) + SIGMA_BIAS));
    for (uint32_t c = 0; c < 3; c++)
        l.colour[c] = BRIGHTEST * logistic(*cn_head_at(a->out, OUT, COLOUR + c, i));
    l.beta = BETA_MIN + l.alpha * UNSURE * logistic(*cn_head_at(a->out, OUT, UNCERTAINTY, i));
    return l;
}

/* Turns the gradient of softplus(raw) into that of raw. A layer with almost no density is not pushed further down, so
 * that it can come back. Otherwise a layer that was not needed while the scene was fog would never come back. */
static float d_sigma_raw(float raw, float d_sigma)
{
    if (raw < LEAST_RAW && d_sigma > 0) return 0;
    return d_sigma * logistic(fmaxf(raw, LEAST_RAW));
}

/* Photos by many cameras are those of strangers, on days of their own, and people stand on lawns and squares where no
 * tracked point is. reichstag (74 photos, 68 sizes) has evidence of 0.011 and 0.017; transients give it 19.8 -> 20.0 dB
 * of half photos and SSIM 0.719 -> 0.730, and take the people and smears off its lawn. Photos by one camera stand at
 * 0.014, too. Found on reichstag and sacre-coeur (8 photos, 8 sizes), which loses 1 dB by them. */
#define STRANGERS 0.03
enum { ENOUGH_PHOTOS = 20, PHOTOS_A_CAMERA = 4 };

/* Of few photos, each place is in two or three, and the layer takes what only one shows: the scene itself. That large
 * errors count less (train/shade.c) is enough there. So evidence in a tile of few photos counts a twentieth. Found with
 * 7 to 10 photos to train on: statue, sacre-coeur, sceaux, a flat in which a person walks, and synthetic cities with
 * people lose up to 2 dB of plain and 1.7 of half photos by the layer; with 20 they lose up to 0.4, and 21 photos of
 * herz-jesus with boxes gain 1.3 (tests/bench/experiments.md). */
#define OF_FEW_PHOTOS 0.05
enum { FEW_PHOTOS = 15 };

static bool is_of_same_camera(const cn_photo *a, const cn_photo *b)
{
    const bool same = a->width == b->width && a->height == b->height,
               turned = a->width == b->height && a->height == b->width;
    return (same || turned) && strcmp(a->camera ? a->camera : "", b->camera ? b->camera : "") == 0;
}

static bool is_by_strangers(const cn_plan_input *input, const cn_plan_tile *tile)
{
    uint32_t n_cameras = 0;
    for (uint32_t i = 0; i < tile->n_photos; i++) {
        const cn_photo *photo = &input->photos->photos[input->scene->views[tile->photos[i]].photo];
        bool known = false;
        for (uint32_t k = 0; k < i && !known; k++)
            known = is_of_same_camera(photo, &input->photos->photos[input->scene->views[tile->photos[k]].photo]);
        n_cameras += !known;
    }
    return tile->n_photos >= ENOUGH_PHOTOS && PHOTOS_A_CAMERA * n_cameras >= tile->n_photos;
}

static double evidence(const cn_plan_input *input, const cn_plan_tile *tile)
{
    const double found = cn_tracks_transient(input, tile);
    return tile->n_photos < FEW_PHOTOS ? OF_FEW_PHOTOS * found : found + (is_by_strangers(input, tile) ? STRANGERS : 0);
}

static void init(uint64_t seed, float *shared)
{
    cn_head_init(&head, seed, STREAM, shared);
}
static void derive(const float *shared, float *derived)
{
    cn_head_transpose(&head, shared, derived);
}

/* The four nodes around a place on the grid of a level: where their features are, and their bilinear weights. */
typedef struct nodes {
    size_t at[4];
    float weight[4];
} nodes;
static nodes nodes_of(const cn_effect_rays *rays, uint32_t i, uint32_t level)
{
    nodes n;
    const uint32_t cells = (uint32_t)COARSEST << level;
    uint32_t corner[2];
    float part[2];
    for (uint32_t a = 0; a < 2; a++) {
        const float x = fminf(fmaxf(0.5f * (rays->uv[2 * (size_t)i + a] + 1), 0), 1) * (float)cells;
        corner[a] = x < (float)(cells - 1) ? (uint32_t)x : cells - 1;
        part[a] = x - (float)corner[a];
    }
    for (uint32_t k = 0; k < 4; k++) {
        const uint32_t x = corner[0] + (k & 1), y = corner[1] + (k >> 1);
        const uint32_t entry = (x ^ y * 2654435761u ^ rays->photo[i] * 805459861u) & (ENTRIES - 1);
        n.at[k] = TABLE + ((size_t)level * ENTRIES + entry) * FEATURES;
        n.weight[k] = (k & 1 ? part[0] : 1 - part[0]) * (k >> 1 ? part[1] : 1 - part[1]);
    }
    return n;
}

static void fill_in(const cn_effect_rays *rays, const cn_effect_data *data, const cn_head_acts *a)
{
    for (uint32_t i = 0; i < rays->n; i++) {
        uint32_t row = 0;
        for (; row < CODE; row++)
            *cn_head_at(a->in, IN, row, i) = data->photo[(size_t)rays->photo[i] * CODE + row];
        for (uint32_t o = 0; o < 2 * OCTAVES; o++) {
            const float phase = 1.5707963f * (float)(1u << o / 2) * rays->uv[2 * (size_t)i + o % 2];
            *cn_head_at(a->in, IN, row++, i) = sinf(phase);
            *cn_head_at(a->in, IN, row++, i) = cosf(phase);
        }
        for (uint32_t l = 0; l < LEVELS; l++) {
            const nodes n = nodes_of(rays, i, l);
            for (uint32_t f = 0; f < FEATURES; f++) {
                float sum = 0;
                for (uint32_t k = 0; k < 4; k++)
                    sum += n.weight[k] * data->shared[n.at[k] + f];
                *cn_head_at(a->in, IN, row++, i) = sum;
            }
        }
    }
}

static void fill_in_backward(const cn_effect_rays *rays, const cn_head_acts *a, const cn_effect_grad *grad)
{
    for (uint32_t i = 0; i < rays->n; i++) {
        for (uint32_t c = 0; c < CODE; c++)
            grad->photo[(size_t)rays->photo[i] * CODE + c] += *cn_head_at(a->d_in, IN, c, i);
        for (uint32_t l = 0; l < LEVELS; l++) {
            const nodes n = nodes_of(rays, i, l);
            for (uint32_t f = 0; f < FEATURES; f++) {
                const float d = *cn_head_at(a->d_in, IN, CODE + 4 * OCTAVES + l * FEATURES + f, i);
                for (uint32_t k = 0; k < 4; k++)
                    grad->shared[n.at[k] + f] += n.weight[k] * d;
            }
        }
    }
}

static void pixel(const cn_effect_rays *rays, const cn_effect_data *data, float *rgb, float *saved)
{
    const cn_head_acts a = cn_head_split(&head, saved);
    fill_in(rays, data, &a);
    cn_head_forward(&head, data->kernel, data->derived, rays->n, &a);
    for (uint32_t i = 0; i < rays->n; i++) {
        const layer l = layer_of(&a, i);
        for (uint32_t c = 0; c < 3; c++) {
            own(saved, BEFORE + c)[i] = rgb[3 * (size_t)i + c];
            rgb[3 * (size_t)i + c] += l.alpha * (l.colour[c] - rgb[3 * (size_t)i + c]);
        }
        own(saved, D_BETA)[i] = own(saved, D_SIGMA)[i] = 0;
    }
}

/* The cost of a layer: 1 when opaque, half of that at an alpha of about VEIL. cost_gradient is with respect to sigma.
 */
static float cost(float alpha)
{
    return (1 + VEIL) * alpha / (alpha + VEIL);
}
static float cost_gradient(float alpha)
{
    return (1 + VEIL) * VEIL / ((alpha + VEIL) * (alpha + VEIL)) * (1 - alpha);
}

/* The price of a transient among these rays (see above). */
static float price_of(const cn_effect_rays *rays, const float *target, const float *scale, float *saved)
{
    float error[CN_EFFECT_RAYS];
    for (uint32_t i = 0; i < rays->n; i++) {
        const float before[3] = { own(saved, BEFORE)[i], own(saved, BEFORE + 1)[i], own(saved, BEFORE + 2)[i] };
        const float e = target && scale[i] > 0 ? cn_display_error(before, target + 4 * (size_t)i, 0, NULL) : -1;
        error[i] = isfinite(e) ? e : -1;
    }
    return fmaxf(2 * BETA_MIN * BETA_MIN, cn_display_quartile(error, rays->n));
}

static double loss(const cn_effect_rays *rays, const cn_effect_data *data, const cn_effect_residuals *residuals,
                   float *factor, float *saved)
{
    (void)data;
    const cn_head_acts a = cn_head_split(&head, saved);
    const float *error = residuals->error, *scale = residuals->scale;
    const float price = price_of(rays, residuals->target, scale, saved);
    double sum = 0;
    for (uint32_t i = 0; i < rays->n; i++) {
        const layer l = layer_of(&a, i);
        const float share = BETA_MIN * BETA_MIN / (l.beta * l.beta);
        factor[i] *= share;
        own(saved, D_BETA)[i] = scale[i] * (price - 2 * error[i] * share) / l.beta;
        own(saved, D_SIGMA)[i] = scale[i] * price * cost_gradient(l.alpha);
        sum += (double)(scale[i] * (error[i] * (share - 1) + price * (logf(l.beta) + cost(l.alpha))));
    }
    return sum;
}

static void pixel_backward(const cn_effect_rays *rays, const cn_effect_data *data, float *d_rgb, float *saved,
                           const cn_effect_grad *grad)
{
    const cn_head_acts a = cn_head_split(&head, saved);
    for (uint32_t i = 0; i < rays->n; i++) {
        const layer l = layer_of(&a, i);
        const float b = *cn_head_at(a.out, OUT, UNCERTAINTY, i), d_beta = own(saved, D_BETA)[i];
        const float unsure = UNSURE * logistic(b);
        float d_alpha = d_beta * unsure;
        for (uint32_t c = 0; c < 3; c++) {
            float *d = &d_rgb[3 * (size_t)i + c];
            d_alpha += *d * (l.colour[c] - own(saved, BEFORE + c)[i]);
            *cn_head_at(a.d_out, OUT, COLOUR + c, i) = *d * l.alpha * l.colour[c] * (1 - l.colour[c] / BRIGHTEST);
            *d *= 1 - l.alpha;
        }
        const float d_sigma = d_alpha * (1 - l.alpha) + own(saved, D_SIGMA)[i];
        *cn_head_at(a.d_out, OUT, SIGMA, i) = d_sigma_raw(*cn_head_at(a.out, OUT, SIGMA, i) + SIGMA_BIAS, d_sigma);
        *cn_head_at(a.d_out, OUT, UNCERTAINTY, i) = d_beta * l.alpha * unsure * (1 - logistic(b));
        for (uint32_t r = UNCERTAINTY + 1; r < OUT; r++)
            *cn_head_at(a.d_out, OUT, r, i) = 0;
    }
    cn_head_backward(&head, data->kernel, data->shared, rays->n, &a, grad->shared);
    fill_in_backward(rays, &a, grad);
}

extern const cn_effect cn_effect_transient;
const cn_effect cn_effect_transient = {
    .name = "transient",
    .summary = "what stands in one photo only is told apart, and left out of renders",
    /* Found between photos where things move (synthetic cities with people 0.07 in the light of four runs, 0.28 and
     * 0.40 in that of one) and photos where nothing does (the same cities without people 0.011 to 0.014; castle
     * -0.004, herz-jesus 0.008). sacre-coeur has 0.023; transients cost it 1.2 dB. What stands before no tracked point
     * is not seen: ten photos of the British Museum with people on the forecourt have 0.004. There transients change
     * plain PSNR by 0.05 dB. */
    .threshold = 0.03,
    .time_share = 0.08f,
    .training_only = true,
    /* Probes were wrong: they switched it off on a made city with people, where it gains 0.5 dB, and said the opposite
     * of training on sceaux and sacre-coeur (tests/bench/experiments.md). The photos that judge have people of their
     * own. */
    .unprobed = true,
    .wants_uv = true,
    .wants_support = true,
    .start = 0.1f,
    .evidence = evidence,
    .photo_params = CODE,
    .shared_params = TABLE + LEVELS * ENTRIES * FEATURES,
    .saved = CN_HEAD_SAVED(IN, WIDTH, OUT) + OWN,
    .init = init,
    .derive = derive,
    .pixel = pixel,
    .pixel_backward = pixel_backward,
    .loss = loss,
};
