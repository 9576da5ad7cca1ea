/* View dependence. The colour head reads the ray's direction as 16 spherical harmonics.
 *
 * Evidence, in stops: how much the colour of tracked points changes with the direction they are seen from. For
 * points that are seen often, take the colour residual (log2 luminance less the photo's own gain). Compare it
 * between two observations whose directions differ by more than 15 degrees, and between two within 5 degrees. The
 * evidence is the difference of the two median absolute differences. */
#include "effect/effect.h"
#include "effect/tracks.h"
#include "rays/rays.h"

#include <math.h>

static void field_in(const cn_effect_rays *rays, const cn_effect_data *data, float *conditioning, size_t stride)
{
    (void)data;
    for (uint32_t i = 0; i < rays->n; i++)
        cn_rays_harmonics(rays->dir + 3 * (size_t)i, conditioning + i * stride);
}

static double evidence(const cn_plan_input *input, const cn_plan_tile *tile)
{
    cn_tracks tracks;
    if (cn_tracks_gather(&tracks, input, tile, CN_TRACKS_FINE) != CN_OK) return NAN;
    const double wide = cn_tracks_spread(&tracks, 15, 180), narrow = cn_tracks_spread(&tracks, 0, 5);
    cn_tracks_deinit(&tracks);
    return wide - narrow;
}

extern const cn_effect cn_effect_view_dependence;
const cn_effect cn_effect_view_dependence = {
    .name = "view_dependence",
    .summary = "colour changes with the direction of view",
    .threshold = 0.02,
    .time_share = 0.08f,
    .on_unmeasured = true,
    .evidence = evidence,
    .conditioning = 16,
    .harmonics = true,
    .field_in = field_in,
};
