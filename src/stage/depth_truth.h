/* Errors of depth in views whose true depth is known: distances along the ray in EXR or PNG maps that are named as the
 * photos (photo/maps.h). */
#ifndef CONURB_STAGE_DEPTH_TRUTH_H
#define CONURB_STAGE_DEPTH_TRUTH_H
#include "conurb/photo.h"
#include "conurb/render.h"

typedef struct cn_depth_truth {
    const char *folder;
    float *errors; /* of all pixels of all views */
    size_t n, room;
} cn_depth_truth;

/* Adds the pixels of one view: where both have a depth, their difference; where only the truth has one, infinity. A
 * photo without a map adds nothing. CN_ERR_FORMAT, CN_ERR_DATA: the message names the map. */
CN_NODISCARD cn_status cn_depth_truth_add(cn_depth_truth *truth, const cn_photo *photo, const cn_picture *picture);
/* The median, and the share within 10 cm. NaN without a pixel. Sorts the errors. */
void cn_depth_truth_summary(cn_depth_truth *truth, double *median_m, double *within);
void cn_depth_truth_deinit(cn_depth_truth *truth);
#endif
