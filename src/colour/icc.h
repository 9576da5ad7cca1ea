/* The colours of a photo by its ICC profile. */
#ifndef CONURB_COLOUR_ICC_H
#define CONURB_COLOUR_ICC_H
#include "conurb/colour.h"

typedef struct cn_icc cn_icc;
/* From the bytes of a profile. CN_ERR_FORMAT when it is damaged, or not for pictures of so many channels: RGB, or grey
 * (fewer than 3). Caller destroys. */
CN_NODISCARD cn_status cn_icc_create(cn_icc **icc, const void *profile, size_t size, uint32_t channels);
void cn_icc_destroy(cn_icc **icc);
/* The colour space of Conurb's own config that the profile amounts to, by its primaries and its curve, or NULL. */
const char *cn_icc_space(const cn_icc *icc);
/* In place, n pixels of stride floats: values as stored to linear ACEScg. own: Conurb's own config. Non-finite channels
 * become 0 first. Any thread. */
CN_NODISCARD cn_status cn_icc_to_linear(const cn_icc *icc, const cn_colour *own, float *pixels, size_t n, int stride);
#endif
