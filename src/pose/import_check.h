/* Do imported poses agree with the GPS of their photos? */
#ifndef CONURB_POSE_IMPORT_CHECK_H
#define CONURB_POSE_IMPORT_CHECK_H
#include "pose/ladder.h"

typedef enum cn_import_outcome {
    CN_IMPORT_UNCHECKED, /* too little GPS, or poses.check_import: off */
    CN_IMPORT_AGREES,    /* with the photos' GPS */
    CN_IMPORT_DOUBTFUL,  /* GPS contradicts it, but no other poses were found */
    CN_IMPORT_KEPT,      /* the poses found anew are no better */
    CN_IMPORT_REPLACED,  /* by poses found anew */
} cn_import_outcome;
typedef struct cn_import_verdict {
    cn_import_outcome outcome;
    uint32_t n_gps, n_agree; /* photos of the import with GPS, and those of them that agree with it */
    uint32_t n_agree_anew;   /* the same of the poses found anew; 0 when there are none */
} cn_import_verdict;

/* Poses with their frame. */
typedef struct cn_posed {
    cn_scene scene;
    cn_frame frame;
    uint32_t n_models;
    cn_import_verdict import;
} cn_posed;

/* Where imported poses are doubtful: says so, finds the poses of the photos anew in task->dir, and keeps whichever
 * agree with more of the GPS. task->options->check_import: off does nothing; auto says only how to find them anew where
 * there are more than 200 photos or no COLMAP. A search without result leaves the import. CN_ERR_INTERRUPTED: asked to
 * stop.
 */
CN_NODISCARD cn_status cn_import_check(const cn_colmap_task *task, cn_posed *posed);
#endif
