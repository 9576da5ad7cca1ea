/* Matches pairs of photos in COLMAP's database, on all threads of the pool. */
#ifndef CONURB_POSE_PAIR_MATCHER_H
#define CONURB_POSE_PAIR_MATCHER_H
#include "pose/colmap_job.h"
#include "pose/pairs.h"

/* Matches each pair that has no matches in j->database, and writes them there about once a second, so a killed run
 * loses no more. Pairs with fewer matches than COLMAP verifies get none. Photos that are not in the database are left
 * out. Tells progress in pairs of the list. Uses up to 512 MB for descriptors.
 *
 * CN_ERR_FORMAT: the database is damaged, or not COLMAP's. CN_ERR_INTERRUPTED: asked to stop; what is done is kept. */
CN_NODISCARD cn_status cn_pairs_match(cn_colmap_job *j, const cn_photo_pairs *pairs);
/* The pairs that have matches which COLMAP has not verified, in the order of the list. The caller frees `left`. */
CN_NODISCARD cn_status cn_pairs_unverified(const cn_colmap_job *j, const cn_photo_pairs *pairs, cn_photo_pairs *left);
#endif
