/* A synthetic city with ground truth: photos as cameras would take them, and true pictures, depths and poses. x east,
 * y north, z up, in metres; light is linear, with sRGB's primaries until it is written. */
#ifndef CONURB_SYNTH_SYNTH_H
#define CONURB_SYNTH_SYNTH_H
#include "conurb/base.h"
#include "conurb/pose.h"

#define CN_SYNTH_RUNS 32 /* at most */

/* Everything that a synthetic city depends on. Written to OUT/truth/synth.json, from where cn_synth_render takes it. */
typedef struct cn_synth_options {
    uint64_t seed;
    uint32_t n_photos, n_runs; /* capture runs, each with its own sun and weather */
    uint32_t width, height;    /* pixels of a photo */
    double size_m;             /* side of the photographed square; the city extends beyond it */
    double aerial;             /* share of photos taken from the air */
    double gps_noise_m;        /* standard deviation of each horizontal coordinate; 1.5 times that of the height */
    double exposure_spread_ev; /* half the range of exposure errors */
    double latitude_deg, longitude_deg, altitude_m; /* of the origin; altitude above sea level */
    bool survey; /* from the air: up from each crossing, then strips over all of them, which connect them */
    bool sphere; /* photos of all directions, twice as wide as high, equirectangular */
    bool plain;  /* the same views without people and cars, in one light, at one exposure */
    bool empty;  /* the same photos without people and cars; exposures and all else are equal */
} cn_synth_options;

cn_synth_options cn_synth_options_default(void);
/* Checks the options. CN_ERR_USAGE: an option is out of range; the message names it. */
CN_NODISCARD cn_status cn_synth_options_check(const cn_synth_options *options);

/* Makes the city's photos in OUT/photos and their truth in OUT/truth (see CONTRIBUTING.md). The same options give the
 * same bytes whatever the number of threads. CN_ERR_USAGE when OUT/photos is there already, CN_ERR_IO when OUT cannot
 * be written, CN_ERR_INTERRUPTED when asked to stop. */
CN_NODISCARD cn_status cn_synth_make(const cn_context *ctx, const char *out, const cn_synth_options *options);
/* Writes the view of a photo (its name, or its number from 0) under the light of a run (its name, its number, or NULL
 * for the photo's own) without people and cars, as EXR with depth, at the reference exposure. OUT was made before. */
CN_NODISCARD cn_status cn_synth_render(const cn_context *ctx, const char *out, const char *view, const char *light,
                                       const char *file);
#endif
