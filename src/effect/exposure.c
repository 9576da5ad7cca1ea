/* Exposure: a photo's linear light is the scene's times 2^EV, EV = log2(shutter * ISO / 100 / f^2) from EXIF, relative to the
 * tile's mean. Photos without a shutter time take part at the mean.
 *
 * Evidence: the standard deviation of EV over the tile's photos, in stops; not measurable when fewer than half of them have it. */
#include "effect/effect.h"

#include <math.h>

static void constants_of(const cn_photo *photo, float *row) { row[0] = (float)cn_photo_exposure_ev(photo); }

static void pixel(const cn_effect_rays *rays, const float *constants, const float *params, float *rgb)
{
    (void)params;
    for (uint32_t i = 0; i < rays->n; i++) {
        const float gain = exp2f(constants[rays->photo[i]]);
        for (int c = 0; c < 3; c++) rgb[3 * (size_t)i + c] *= gain;
    }
}

static void pixel_backward(const cn_effect_rays *rays, const float *constants, const float *params, const float *before,
                           float *d_rgb, float *d_params)
{
    (void)before;
    (void)d_params;
    pixel(rays, constants, params, d_rgb);
}

static double evidence(const cn_plan_input *input, const cn_plan_tile *tile)
{
    double sum = 0, squares = 0;
    uint32_t n = 0;
    for (uint32_t i = 0; i < tile->n_photos; i++) {
        const uint32_t photo = input->scene->views[tile->photos[i]].photo;
        if (photo >= input->photos->n_photos) continue;
        const double ev = cn_photo_exposure_ev(&input->photos->photos[photo]);
        if (!isfinite(ev)) continue;
        sum += ev;
        squares += ev * ev;
        n++;
    }
    if (n < 2 || 2 * n < tile->n_photos) return NAN;
    const double mean = sum / n;
    return sqrt(fmax(squares / n - mean * mean, 0));
}

extern const cn_effect cn_effect_exposure;
const cn_effect cn_effect_exposure = {
    .name = "exposure",
    .summary = "brightness follows the camera's shutter, ISO and f-number",
    .threshold = 0.1,
    .evidence = evidence,
    .photo_constants = 1,
    .constants = constants_of,
    .pixel = pixel,
    .pixel_backward = pixel_backward,
};
