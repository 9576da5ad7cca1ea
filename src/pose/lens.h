/* Helpers for all lens models. */
#ifndef CONURB_POSE_LENS_H
#define CONURB_POSE_LENS_H
#include "conurb/pose.h"

#define CN_LENS_COUNT 6
#define CN_LENS_NAMES "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, OPENCV_FISHEYE"

/* A lens in one common form, for every model. */
typedef struct cn_lens_view {
    double fx, fy, cx, cy;
    double k[4]; /* radial, k[2] and k[3] only of the fisheye */
    double p[2]; /* tangential */
    bool fisheye;
} cn_lens_view;

const char *cn_lens_name(cn_lens lens);
int cn_lens_params(cn_lens lens);        /* number of parameters */
int cn_lens_from_name(const char *name); /* COLMAP's model id, or -1 */
cn_lens_view cn_lens_unpack(const cn_camera *camera);
/* Packs into `camera`. Keeps its lens model when it can represent the values; otherwise uses OPENCV, or OPENCV_FISHEYE
 * for a fisheye. */
void cn_lens_pack(const cn_lens_view *view, cn_camera *camera);
/* Checks for positive finite focal lengths, finite parameters and a size above zero. `where` names the file. */
CN_NODISCARD cn_status cn_camera_check(const cn_camera *camera, const char *where);
/* For imported cameras: checks that the radial distortion has an inverse over the picture and is plausible. who:
 * "photo a.jpg". CN_ERR_FORMAT. */
CN_NODISCARD cn_status cn_camera_check_inverse(const cn_camera *camera, const char *where, const char *who);
#endif
