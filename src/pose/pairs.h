/* Pairs of photos to match. */
#ifndef CONURB_POSE_PAIRS_H
#define CONURB_POSE_PAIRS_H
#include "conurb/photo.h"

/* Indices of two photos: the lower one in the upper 32 bits. Freed with cn_photo_pairs_deinit. */
typedef struct cn_photo_pairs {
    uint64_t *items;
    size_t n, room;
} cn_photo_pairs;
void cn_photo_pairs_deinit(cn_photo_pairs *pairs);
/* false when out of memory. */
bool cn_photo_pairs_add(cn_photo_pairs *pairs, uint32_t a, uint32_t b);
/* Sorts the pairs and leaves each one once. */
void cn_photo_pairs_sort(cn_photo_pairs *pairs);

/* These fill empty pairs, each pair once; on failure the pairs are empty. CN_ERR_NOMEM.
 *
 * Each photo with its `neighbours` nearest by GPS, and where altitudes differ by more than 20 m with half as many of
 * about its own altitude; photos without GPS with their neighbours by name (cn_path_compare). No pairs when GPS gives
 * the same place for most photos. */
CN_NODISCARD cn_status cn_photo_pairs_near(const cn_photo_index *index, uint32_t neighbours, cn_photo_pairs *pairs);
/* Every pair of n photos, in an order in which a few hundred photos at a time recur. */
CN_NODISCARD cn_status cn_photo_pairs_all(uint32_t n_photos, cn_photo_pairs *pairs);
/* For a film, as COLMAP's sequential_matcher does by default: each photo with the next 9, and with those 16, 32, ...,
 * 512 later, in the order of cn_path_compare. */
CN_NODISCARD cn_status cn_photo_pairs_in_sequence(const cn_photo_index *index, cn_photo_pairs *pairs);

/* The pairs' names as COLMAP sees them, a pair a line. The caller frees *text. */
CN_NODISCARD cn_status cn_photo_pairs_text(const cn_photo_index *index, bool linked, const cn_photo_pairs *pairs,
                                           char **text, size_t *size);
#endif
