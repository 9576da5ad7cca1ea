/* Gaussians in the picture of a pinhole camera, and the way back of their gradients (Zwicker et al. 2002, "EWA
 * splatting"; Kerbl et al. 2023). */
#ifndef CONURB_SPLAT_PROJECT_H
#define CONURB_SPLAT_PROJECT_H
#include "conurb/splat.h"
#include "splat/splat_tile.h"

/* A Gaussian as it is fitted, a row of floats: its centre in metres, the logarithms of its scales, a quaternion w x y z
 * of any length, the logit of its opacity, and its colour as in cn_splats. */
enum { CN_ROW_CENTRE = 0, CN_ROW_SCALE = 3, CN_ROW_ROTATION = 6, CN_ROW_OPACITY = 10, CN_ROW_COLOUR = 11 };
enum { CN_ROW_MOST = CN_ROW_COLOUR + 27 };
static inline uint32_t cn_row_length(uint32_t degree)
{
    return CN_ROW_COLOUR + 3 * (degree + 1) * (degree + 1);
}

#define CN_SPLAT_LEAST_ALPHA (1.0f / 255)
#define CN_SPLAT_BLUR 0.3f /* added to the covariance, px^2: no Gaussian is thinner than a pixel */

typedef struct cn_splat_camera {
    uint32_t width, height;
    float f[2], c[2];                          /* px */
    float limit[2];                            /* slopes beyond which the projection is taken as it is there */
    float near_m;                              /* what is nearer is left out */
    float least_alpha;                         /* where a Gaussian covers less it is left out */
    float rotation[9], translation[3], eye[3]; /* cam_from_local, of metres from the splats' origin */
} cn_splat_camera;
/* The camera without its distortion, at its size. */
cn_splat_camera cn_splat_camera_of(const cn_camera *camera, const cn_view *view, const double origin[3], float near_m);

/* False when nothing of the Gaussian is in the picture. `first` is left alone. */
bool cn_splat_project(const cn_splat_camera *camera, const float *row, uint32_t degree, cn_flat_splat *flat);
/* Fills the gradient of a row, from the sums of its pixels. flat: as cn_splat_project made it. */
void cn_splat_project_back(const cn_splat_camera *camera, const float *row, uint32_t degree, const cn_flat_splat *flat,
                           const float sums[CN_SPLAT_SUMS], float *gradient);
#endif
