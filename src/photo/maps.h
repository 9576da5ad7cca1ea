/* Maps beside the photos: depth. Private to photo/. */
#ifndef CONURB_PHOTO_MAPS_H
#define CONURB_PHOTO_MAPS_H
#include "conurb/photo.h"

/* The photo's depth map in metres at another size, by the nearest value; 0 where nothing was measured. The map may have
 * any size of the photo's shape. CN_ERR_FORMAT or CN_ERR_DATA name the file. */
CN_NODISCARD cn_status cn_photo_read_depth(const cn_photo *photo, uint32_t width, uint32_t height, float *depth_m);
#endif
