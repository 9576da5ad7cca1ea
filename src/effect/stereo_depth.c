/* Stereo depth. Before training, depths of the photos are found by PatchMatch stereo (src/stereo). In the first half of
 * the schedule they pull the field's depth towards them (loss/depth_cue.c), less and less. With few photos many fields
 * explain the training photos, and most of them show matter that floats before the walls; the depths lead to one that
 * does not.
 *
 * It has no parameters, and nothing of it is in the tile but its name.
 *
 * Evidence: 10 over the number of photos that the tile trains on and that see sparse points. NaN where fewer than three
 * do: without sparse points the range of depths is not known.
 *
 * Found at standard quality and 400 px, one seed, plain and half-photo PSNR without and with: sceaux (10 photos) 13.5,
 * 18.0 -> 14.1, 18.6 dB; herz-jesus (22) 21.5, 25.3 -> 21.8, 25.8; castle (26) 28.4, 29.4 -> 28.3, 29.3; sacre-coeur
 * (9) 12.3, 14.0 -> 12.3, 14.0; brighton (16) 21.3, 21.2 -> 21.0, 21.1. */
#include "effect/effect.h"

#include <math.h>
#include <stdlib.h>

#define FEW 10.0
enum { LEAST_POINTS = 20, LEAST_PHOTOS = 3 };

static double evidence(const cn_plan_input *input, const cn_plan_tile *tile)
{
    const cn_scene *scene = input->scene;
    uint32_t *points = calloc(scene->n_views + 1u, sizeof *points), n = 0;
    for (uint64_t i = 0; points && i < scene->n_observations; i++)
        points[scene->observations[i].view]++;
    for (uint32_t i = 0; points && i < tile->n_photos; i++)
        n += points[tile->photos[i]] >= LEAST_POINTS;
    free(points);
    return n >= LEAST_PHOTOS ? FEW / n : NAN;
}

extern const cn_effect cn_effect_stereo_depth;
const cn_effect cn_effect_stereo_depth = {
    .name = "stereo_depth",
    .summary = "few photos: depths by stereo lead the field at first",
    .threshold = 0.4,
    .time_share = 0.06f,
    .training_only = true,
    .wants_stereo = true,
    .unprobed = true,
    .evidence = evidence,
};
