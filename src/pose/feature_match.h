/* Matches the SIFT descriptors of two photos by the rules of COLMAP 3.8's brute force: the distance of two descriptors
 * is the angle acos(product / 512^2); a match is the nearest in both directions, at most MAX_DISTANCE away, and nearer
 * than MAX_RATIO times the second nearest (Lowe 2004, "Distinctive image features from scale-invariant keypoints",
 * section 7.1). All pairs of descriptors are compared, where COLMAP's own program searches approximately. */
#ifndef CONURB_POSE_FEATURE_MATCH_H
#define CONURB_POSE_FEATURE_MATCH_H
#include "conurb/base.h"
#include "kernel/kernel.h"

#define CN_MATCH_MAX_RATIO 0.8f    /* SiftMatching.max_ratio */
#define CN_MATCH_MAX_DISTANCE 0.7f /* SiftMatching.max_distance, radians */

/* Index of a descriptor in each of the two photos. */
typedef struct cn_feature_pair {
    uint32_t a, b;
} cn_feature_pair;

/* Buffers that grow as needed. One thread at a time. */
typedef struct cn_match_space {
    int32_t *nearest; /* six arrays of room values */
    cn_feature_pair *pairs;
    uint32_t room, n_pairs; /* pairs: the matches found, ascending by a */
} cn_match_space;
void cn_match_space_deinit(cn_match_space *space);

/* Sets space->pairs and space->n_pairs. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_match_features(const cn_kernel *kernel, cn_descriptors a, cn_descriptors b,
                                         cn_match_space *space);
#endif
