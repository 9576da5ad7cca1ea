/* Colours of tracked points in the photos of a tile. Several effects measure their evidence from them. */
#ifndef CONURB_EFFECT_TRACKS_H
#define CONURB_EFFECT_TRACKS_H
#include "conurb/plan.h"

/* One photo's observation of one point. Colours in stops (log2 of linear ACEScg). */
typedef struct cn_track_observation {
    uint32_t point;  /* dense, ascending */
    uint32_t photo;  /* row in tile->photos */
    uint32_t camera; /* of the scene */
    float square;    /* squared distance from the picture's middle, 1 at its corners */
    float dir[3];    /* unit, from the point to the camera */
    float distance_m;
    float log2_rgb[3], log2_luminance;
    float residual; /* of the luminance: less the point's mean and the photo's gain */
} cn_track_observation;
typedef struct cn_track_point {
    uint32_t scene_point;
    float log2_rgb[3], log2_luminance; /* means, less the photos' gains */
} cn_track_point;
typedef struct cn_tracks {
    cn_track_observation *observations;
    size_t n;
    cn_track_point *points;
    uint32_t n_points;
    float *gain;
    uint32_t n_photos; /* stops, a photo */
} cn_tracks;

/* A colour is the mean of a patch of the photo, whose side is one of this many parts of the photo's width, and at least
 * a pixel. So evidence does not change with the width to which photos are scaled down. FINE: edges stay edges. COARSE:
 * what a photo's own light explains, which noise and small errors of the pose must not hide. */
enum { CN_TRACKS_FINE = 480, CN_TRACKS_COARSE = 240 };
/* At most 3,000 points with three or more observations in the tile's training photos, whatever else the scene holds.
 * CN_ERR_DATA when there are fewer than 50. across: of the patches, CN_TRACKS_FINE or CN_TRACKS_COARSE. */
CN_NODISCARD cn_status cn_tracks_gather(cn_tracks *tracks, const cn_plan_input *input, const cn_plan_tile *tile,
                                        uint32_t across);
void cn_tracks_deinit(cn_tracks *tracks);
/* Row of each view in tile->photos, UINT32_MAX for others; the caller frees it. NULL: out of memory. */
uint32_t *cn_tracks_rows(const cn_plan_input *input, const cn_plan_tile *tile);
/* Squared distance of a place from the picture's middle, 1 at its corners. */
double cn_track_square(double x, double y, uint32_t width, uint32_t height);
/* How a colour is taken: patches across the photo, and the least luminance that counts. */
typedef struct cn_track_patch {
    uint32_t across;
    float darkest;
} cn_track_patch;
/* Side of such a patch of a photo of the store, in its pixels. */
double cn_track_side(cn_pixel_extent size, uint32_t across);
/* Colour of a photo at a pixel of its view's camera. False: outside the picture, masked, too dark or near white. */
bool cn_tracks_colour(const cn_plan_input *input, const cn_view *view, double x_px, double y_px, cn_track_patch patch,
                      cn_track_observation *observation);
/* Median absolute difference of residuals between two observations of one point whose directions differ by low..high
 * degrees; NaN for fewer than 50 pairs. */
double cn_tracks_spread(const cn_tracks *tracks, double low_deg, double high_deg);
/* Standard deviation of the photos' gains, stops. */
double cn_tracks_gain(const cn_tracks *tracks);
/* How much of a photo's colours its own light explains beyond its gain, in stops. Root mean square over the
 * photos of two parts: a colour cast (the median residual of red and of blue against luminance), and a contrast (the
 * slope of the residual over the points' luminance, times the spread of that luminance). NaN when no photo has 30
 * observations. */
double cn_tracks_light(const cn_tracks *tracks);
/* How much of a photo's colours light explains that differs from place to place, such as sun and shade, in stops. The
 * square root of the mean product of two residuals of one photo whose points are neighbours: noise and errors of
 * matching do not agree between neighbours, light does. NaN for fewer than 500 pairs. */
double cn_tracks_local_light(const cn_tracks *tracks);
/* Cells of a photo, each an equal part of its width and of its height, row by row. */
enum { CN_TRACK_COLUMNS = 32, CN_TRACK_ROWS = 24, CN_TRACK_CELLS = CN_TRACK_COLUMNS * CN_TRACK_ROWS };
/* That of a pixel of the camera; -1 outside the picture. */
int cn_track_cell(const cn_camera *camera, double x_px, double y_px);
/* Whether a photo tracks another point at less than 0.85 of a point's distance, in its cell or in one beside it.
 * nearest: the distance of the nearest that it tracks, INFINITY where there is none. */
bool cn_track_is_hidden(const float nearest[CN_TRACK_CELLS], int cell, double distance);
/* Evidence of transients, as the effect's file describes it; NaN when it cannot be measured. */
double cn_tracks_transient(const cn_plan_input *input, const cn_plan_tile *tile);
#endif
