/* Colours of tracked points in the photos of a tile: what the evidence of several effects is measured from. */
#ifndef CONURB_EFFECT_TRACKS_H
#define CONURB_EFFECT_TRACKS_H
#include "conurb/plan.h"

typedef struct cn_track_look {
    uint32_t point;   /* dense, ascending */
    uint32_t photo;   /* row in tile->photos */
    float dir[3];     /* unit, from the point to the camera */
    float log2_luminance, residual; /* residual: less the point's mean and the photo's gain */
} cn_track_look;
typedef struct cn_tracks { cn_track_look *looks; size_t n; float *gain; /* stops, a photo */ uint32_t n_photos; } cn_tracks;

/* At most 3,000 points with three or more observations in the tile's training photos. CN_ERR_DATA when there are fewer than 50. */
CN_NODISCARD cn_status cn_tracks_gather(cn_tracks *tracks, const cn_plan_input *input, const cn_plan_tile *tile);
void cn_tracks_deinit(cn_tracks *tracks);
/* Median absolute difference of residuals between two observations of one point whose directions differ by low..high degrees; NaN for fewer than 50 pairs. */
double cn_tracks_spread(const cn_tracks *tracks, double low_deg, double high_deg);
#endif
