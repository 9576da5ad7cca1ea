/* Helpers for all lens models. */
#ifndef CONURB_POSE_LENS_H
#define CONURB_POSE_LENS_H
#include "conurb/pose.h"

#define CN_LENS_NAMES "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, OPENCV_FISHEYE, EQUIRECTANGULAR"
#define CN_LENS_FOREIGN_NAMES "FULL_OPENCV, FOV, SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE, THIN_PRISM_FISHEYE"
/* How far the nearest lens model may be from another tool's lens, of the picture's longer side: a pixel at working
 * widths. */
#define CN_LENS_MOST_ERROR 1e-3

/* A lens in one common form, for every model. */
typedef struct cn_lens_view {
    double fx, fy, cx, cy;
    double k[4]; /* radial, k[2] and k[3] only of the fisheye */
    double p[2]; /* tangential */
    bool fisheye;
    bool equirectangular; /* fx, fy: pixels per radian; the rest is in the middle and 0 */
} cn_lens_view;

const char *cn_lens_name(cn_lens lens);
bool cn_lens_is_known(int id);           /* whether COLMAP's model id is one of cn_lens */
int cn_lens_params(cn_lens lens);        /* number of parameters */
int cn_lens_from_name(const char *name); /* COLMAP's model id, or -1 */

/* Lens models of COLMAP that cn_lens lacks, CN_LENS_FOREIGN_NAMES, with COLMAP's ids and its order of parameters. */
enum { CN_LENS_FOREIGN_PARAMS = 12 };
int cn_lens_foreign_params(int id);              /* number of parameters; 0: none of these */
int cn_lens_foreign_from_name(const char *name); /* COLMAP's id, or -1 */
/* The nearest camera that cn_lens has. camera: id, width and height are set. *error_px: how far it is from that lens at
 * most; 0 where it is the same. CN_ERR_FORMAT: a parameter is not finite, or no camera is near enough. `where` names
 * the file. */
CN_NODISCARD cn_status cn_lens_from_foreign(int id, const double *params, cn_camera *camera, const char *where,
                                            double *error_px);
cn_lens_view cn_lens_unpack(const cn_camera *camera);
/* Where r (1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8) turns back: the smallest such r below `most`, or `most`. */
double cn_lens_fold(const double k[4], double most);
/* cn_camera_project with an unpacked lens, for many places. */
bool cn_lens_project(const cn_lens_view *lens, const double xyz[3], double xy_px[2]);
/* Packs into `camera`. Keeps its lens model when it can represent the values; otherwise uses OPENCV, or OPENCV_FISHEYE
 * for a fisheye. */
void cn_lens_pack(const cn_lens_view *view, cn_camera *camera);
/* The camera of a picture of all directions; its id is 0. */
cn_camera cn_camera_equirectangular(uint32_t width, uint32_t height);
/* From one pixel to another, as pixels at `from`: equal to the difference for most lenses. In an equirectangular
 * picture the way goes across the edge where that is shorter, and near the poles a pixel is narrower. Returns its
 * length. */
double cn_camera_offset_px(const cn_camera *camera, const double from[2], const double to[2], double offset[2]);
/* What a camera's picture shows in a direction of the camera frame, between four of its pixels: rgbw[height][width][4]
 * of at least 2 x 2 pixels, their colours and weights. The weight is the least of the four. All 0 where the picture
 * does not show that direction. */
void cn_camera_look_up(const cn_camera *camera, const float *rgbw, const double dir[3], float out[4]);
/* Checks for positive finite focal lengths, finite parameters and a size above zero. `where` names the file. */
CN_NODISCARD cn_status cn_camera_check(const cn_camera *camera, const char *where);
/* For imported cameras: checks that the radial distortion has an inverse over the picture and is plausible. who:
 * "photo a.jpg". CN_ERR_FORMAT. */
CN_NODISCARD cn_status cn_camera_check_inverse(const cn_camera *camera, const char *where, const char *who);
#endif
