/* The similarity from the poses' frame to GPS. Private to pose/. */
#ifndef CONURB_POSE_ALIGN_FIT_H
#define CONURB_POSE_ALIGN_FIT_H
#include "conurb/pose.h"

/* The views with GPS: camera centres, and GPS positions in the local frame. */
typedef struct cn_gps_pairs {
    uint32_t n;
    double (*source)[3], (*target)[3];
    double *latitude, *longitude, *height, *geoid, *scratch;
    /* has_height: enough of the photos have an altitude. known: of each, whether it has one; where too few have, all
     * count as having the same. */
    bool has_height, *known;
    /* Of the fit. within_m: the largest error of those that it counts; beyond max_error_m where GPS is worse.
     * level: up is that of the cameras. by_median: heights count by their median alone. */
    bool *inlier, *with_height, level, by_median; /* with_height: inliers that are known */
    double within_m;
} cn_gps_pairs;

/* Fits s to the pairs, and sets inlier, level and within_m, and the residuals and n_inliers of the frame. n_inliers
 * counts photos within max_error_m, also where the fit counts more. CN_ERR_DATA: the pairs do not determine it. */
CN_NODISCARD cn_status cn_align_fit(const cn_context *ctx, const cn_scene *scene, cn_gps_pairs *p, double max_error_m,
                                    cn_frame *frame, cn_similarity *s);
/* True when so few of at least 8 photos agree with their GPS that the poses themselves are in doubt. */
bool cn_align_is_doubtful(uint32_t n_gps, uint32_t n_inliers);
/* True when clearly more of n_gps photos agree with their GPS than n_before. */
bool cn_align_is_clearly_better(uint32_t n_gps, uint32_t n_before, uint32_t n_inliers);
#endif
