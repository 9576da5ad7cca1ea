/* Which photos may show the same place, where neither GPS nor an order says so: photos whose few largest features match
 * (Wu, "Towards linear-time incremental structure from motion", 3DV 2013, section 2.2: preemptive matching). Large
 * features are few, and they survive a change of distance and of detail. */
#ifndef CONURB_POSE_RETRIEVAL_H
#define CONURB_POSE_RETRIEVAL_H
#include "pose/colmap_job.h"
#include "pose/pairs.h"

/* Fills empty pairs from the features in the job's database: each photo with those that have the most matches among
 * its largest features, and with the photo before it by name. Compares all photos, a pair in about 0.1 ms. Tells
 * progress in pairs of photos. CN_ERR_INTERRUPTED, CN_ERR_NOMEM, and failures of the database. */
CN_NODISCARD cn_status cn_photo_pairs_retrieve(cn_colmap_job *job, cn_photo_pairs *pairs);
#endif
