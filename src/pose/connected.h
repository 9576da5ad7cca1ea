/* Which photos the verified matches connect with others. */
#ifndef CONURB_POSE_CONNECTED_H
#define CONURB_POSE_CONNECTED_H
#include "pose/colmap_job.h"

/* (*connected)[i]: verified matches connect photo i of job->index with at least two others, be it by way of others.
 * No attempt makes a model of fewer photos, so none that maps the same matches gives the others a pose. NULL where the
 * database has no verified matches at all, or cannot be read. The caller frees it. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_pose_connected(const cn_colmap_job *job, bool **connected);
#endif
