/* Appearance embedding (GLO codes, Bojanowski et al. 2018, as in Martin-Brualla et al., "NeRF in the Wild", CVPR
 * 2021, section 4.1). Each photo has a code of 16 numbers. Only the colour head reads it, so a code can change the
 * light but not the geometry. Codes begin at zero and keep zero mean over the tile's photos. The zero code is
 * therefore the mean light. Where there are several capture runs, codes of one run are pulled towards each other
 * (runs.h).
 *
 * Evidence, in stops, the larger of two (tracks.h): how much of the tracked points' colours a photo's own colour cast
 * and contrast explain beyond a gain, and how much of what is left neighbouring points of a photo share. The second
 * finds sun and shade: 0.33 to 0.36 on synthetic cities in many lights and 0.03 to 0.07 in one. The first is taken from
 * coarse patches: by single pixels of photos 320, 480 and 800 px wide, lund had 0.12, 0.10, 0.08 and sceaux 0.07, 0.08,
 * 0.09. */
#include "effect/effect.h"
#include "effect/runs.h"
#include "effect/tracks.h"

#include <math.h>

enum { CODE = 16 };
/* Of photos 480 and 800 px wide. Between sceaux (0.076), where codes cost 0.5 to 1.1 dB of half-photo PSNR, by two
 * choices of held-out photos, and lund (0.110 to 0.134), where they gain 0.6; brighton (0.064 to 0.079) loses 1.3,
 * castle (0.070) gains or loses 0.2, fountain-P11 (0.031) gains nothing. herz-jesus, where shadows of trees come and
 * go, has 0.092 and 0.094 by the second part (0.044 by the first) and gains 2.3 dB; sacre-coeur 0.19 by the first part,
 * and gains 1.1. Near the threshold a short training that is clear decides. Nine photos by flash (0.148) lose 2.0 dB.
 */
#define THRESHOLD 0.085

static void field_in(const cn_effect_rays *rays, const cn_effect_data *data, float *conditioning, size_t stride)
{
    for (uint32_t i = 0; i < rays->n; i++)
        for (size_t c = 0; c < CODE; c++)
            conditioning[i * stride + c] = data->photo[(size_t)rays->photo[i] * CODE + c];
}

static void field_in_backward(const cn_effect_rays *rays, const cn_effect_data *data, const float *d_conditioning,
                              size_t stride, const cn_effect_grad *grad)
{
    (void)data;
    for (uint32_t i = 0; i < rays->n; i++)
        for (size_t c = 0; c < CODE; c++)
            grad->photo[(size_t)rays->photo[i] * CODE + c] += d_conditioning[i * stride + c];
}

static void project(const cn_effect_photos *photos, float *rows, double progress)
{
    (void)progress;
    if (cn_runs_differ(photos->run, photos->n)) cn_runs_draw(photos->run, photos->n, rows, CODE, CODE, CN_RUN_DRAW);
    cn_effect_zero_mean(photos->n, CODE, rows);
}

static double evidence(const cn_plan_input *input, const cn_plan_tile *tile)
{
    cn_tracks tracks;
    if (cn_tracks_gather(&tracks, input, tile, CN_TRACKS_COARSE) != CN_OK) return NAN;
    const double whole = cn_tracks_light(&tracks);
    cn_tracks_deinit(&tracks);
    if (cn_tracks_gather(&tracks, input, tile, CN_TRACKS_FINE) != CN_OK) return NAN;
    const double local = cn_tracks_local_light(&tracks);
    cn_tracks_deinit(&tracks);
    return fmax(whole, local);
}

extern const cn_effect cn_effect_appearance;
const cn_effect cn_effect_appearance = {
    .name = "appearance",
    .summary = "each photo has its own light",
    .threshold = THRESHOLD,
    .time_share = 0.08f,
    .evidence = evidence,
    .conditioning = CODE,
    .wants_runs = true,
    .photo_params = CODE,
    .project = project,
    .field_in = field_in,
    .field_in_backward = field_in_backward,
};
