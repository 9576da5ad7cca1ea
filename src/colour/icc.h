/* Converts the colours of a photo by its ICC profile. */
#ifndef CONURB_COLOUR_ICC_H
#define CONURB_COLOUR_ICC_H
#include "conurb/colour.h"

typedef struct cn_icc cn_icc;
/* Reads a profile from its bytes. CN_ERR_FORMAT: it is damaged, or not for this number of channels (RGB, or grey when
 * fewer than 3). The caller destroys it. */
CN_NODISCARD cn_status cn_icc_create(cn_icc **icc, const void *profile, size_t size, uint32_t channels);
void cn_icc_destroy(cn_icc **icc);
/* The colour space of Conurb's own config that equals the profile, by its primaries and its curve, or NULL. */
const char *cn_icc_space(const cn_icc *icc);
/* Converts n pixels of `stride` floats from stored values to linear ACEScg, in place. own: Conurb's own config.
 * Channels that are not finite are set to 0 first. Any thread. */
CN_NODISCARD cn_status cn_icc_to_linear(const cn_icc *icc, const cn_colour *own, float *pixels, size_t n, int stride);
#endif
