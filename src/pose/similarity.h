/* Similarities between point sets. */
#ifndef CONURB_POSE_SIMILARITY_H
#define CONURB_POSE_SIMILARITY_H
#include "conurb/pose.h"

/* For points on a line, about which the rotation cannot be seen: `up` (source frame) is turned towards the target's z
 * as far as the line lets it. CN_ERR_DATA when the line itself is vertical or fewer than 2 pairs agree. */
CN_NODISCARD cn_status cn_similarity_fit_line(const cn_similarity_task *task, const double up[3], cn_similarity *out,
                                              bool *inlier);
void cn_similarity_apply(const cn_similarity *s, const double in[3], double out[3]);
/* Standard deviations along the principal axes, ascending, of the points i with use[i] (NULL: all). axes: columns, may
 * be NULL. */
void cn_spread(uint32_t n, const double (*points)[3], const bool *use, double deviation[3], double axes[9]);
#endif
