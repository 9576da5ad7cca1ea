/* Similarity transforms between point sets. */
#ifndef CONURB_POSE_SIMILARITY_H
#define CONURB_POSE_SIMILARITY_H
#include "conurb/pose.h"

/* For points on a line, which do not determine the rotation about the line: `up` (source frame) is rotated as near to
 * the target's z as possible. CN_ERR_DATA: the line is vertical, or fewer than 2 pairs agree. */
CN_NODISCARD cn_status cn_similarity_fit_line(const cn_similarity_task *task, const double up[3], cn_similarity *out,
                                              bool *inlier);
/* Turns `up` (source frame, of length 1) to the target's z; the fit finds the rest: the rotation about it, scale and
 * translation. The scale is that of the first two coordinates. CN_ERR_DATA: fewer than 2 pairs agree. */
CN_NODISCARD cn_status cn_similarity_fit_upright(const cn_similarity_task *task, const double up[3], cn_similarity *out,
                                                 bool *inlier);
/* A rotation, row-major, that turns `up`, of length 1, to z. False where `up` is not finite. */
bool cn_similarity_level(const double up[3], double rotation[9]);
/* How many of n flags are set. */
uint32_t cn_similarity_count(const bool *inlier, uint32_t n);
void cn_similarity_apply(const cn_similarity *s, const double in[3], double out[3]);
/* Standard deviations along the principal axes, ascending, of the points i with use[i] (NULL: all). axes: columns, may
 * be NULL. */
void cn_spread(uint32_t n, const double (*points)[3], const bool *use, double deviation[3], double axes[9]);
#endif
