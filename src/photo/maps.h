/* Depth and normal maps of photos, and the shape of what lies over a photo. Private to photo/. */
#ifndef CONURB_PHOTO_MAPS_H
#define CONURB_PHOTO_MAPS_H
#include "conurb/photo.h"

/* A photo's map: FOLDER/NAME.png or .exr, NAME with or without the photo's own ending; NULL when there is none. The
 * caller frees it. */
CN_NODISCARD cn_status cn_photo_find_map(const char *folder, const char *name, char **found);
/* Whether a map has the photo's aspect ratio, up to the rounding of a pixel. It may be smaller, as from depth cameras.
 */
bool cn_photo_same_shape(uint32_t width, uint32_t height, const cn_photo *photo);
/* CN_ERR_DATA, which names path, where it has not. */
CN_NODISCARD cn_status cn_photo_check_shape(const char *path, uint32_t width, uint32_t height, const cn_photo *photo);
/* Reads the photo's depth map, in metres, resampled to another size by the nearest value; 0: no value. The map must
 * have the photo's aspect ratio. CN_ERR_FORMAT, CN_ERR_DATA: the message names the file. */
CN_NODISCARD cn_status cn_photo_read_depth(const cn_photo *photo, uint32_t width, uint32_t height, float *depth_m);
/* What is odd about a normal map. */
typedef struct cn_normal_report {
    bool none; /* no pixel has a normal */
    bool away; /* most normals point away from the camera, as they do where the axes are wrong */
} cn_normal_report;
/* Reads the photo's normal map as the pixel store keeps it, packed[height][width][4], resampled by the nearest value.
 * Errors as above. */
CN_NODISCARD cn_status cn_photo_read_normal(const cn_photo *photo, uint32_t width, uint32_t height, int8_t *packed,
                                            cn_normal_report *report);
#endif
