/* Masks of photos. Private to photo/. */
#ifndef CONURB_PHOTO_MASK_H
#define CONURB_PHOTO_MASK_H
#include "conurb/photo.h"

/* Sets the weight, the fourth of rgba[height][width][4], to 0 where the photo's mask is black (nearest pixel). rgba has
 * the photo's size as it is shown. The mask has its aspect ratio, or that of the stored pixels, and is then turned as
 * the photo is. Does nothing for a photo without a mask. CN_ERR_IO, CN_ERR_FORMAT, CN_ERR_DATA: the message names the
 * mask. */
CN_NODISCARD cn_status cn_photo_apply_mask(const char *folder, const cn_photo *photo, float *rgba);
#endif
