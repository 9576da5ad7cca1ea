/* Depth maps of photos. Private to photo/. */
#ifndef CONURB_PHOTO_MAPS_H
#define CONURB_PHOTO_MAPS_H
#include "conurb/photo.h"

/* Reads the photo's depth map, in metres, resampled to another size by the nearest value; 0: no value. The map must
 * have the photo's aspect ratio. CN_ERR_FORMAT, CN_ERR_DATA: the message names the file. */
CN_NODISCARD cn_status cn_photo_read_depth(const cn_photo *photo, uint32_t width, uint32_t height, float *depth_m);
#endif
