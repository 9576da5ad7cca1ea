/* conurb/splat.h: a scene as Gaussians ("splats"), which many viewers draw (Kerbl et al. 2023, "3D Gaussian splatting
 * for real-time radiance field rendering"). Threads: any thread, but one at a time for one cn_splats. */
#ifndef CONURB_SPLAT_H
#define CONURB_SPLAT_H
#include "conurb/base.h"
#include "conurb/geo.h"
#ifdef __cplusplus
extern "C" {
#endif

enum { CN_SPLAT_MAX_DEGREE = 2 };

/* Gaussians. Their colours lie at the place (u * (degree + 1)^2 + c) * 3 + channel for Gaussian u and coefficient c.
 * The basis of the spherical harmonics and its signs are those of Kerbl et al.; their directions are those from the
 * camera to the Gaussian, in local axes. */
typedef struct cn_splats {
    size_t n;
    uint32_t degree;      /* of the spherical harmonics, 0 to CN_SPLAT_MAX_DEGREE */
    double origin[3];     /* local metres east, north, up; added to every centre */
    float (*centre)[3];   /* metres from the origin */
    float (*scale)[3];    /* metres: standard deviations along the splat's axes, above 0 */
    float (*rotation)[4]; /* unit quaternions w x y z, world_from_splat */
    float *opacity;       /* 0 to 1 */
    float *colour;        /* n x (degree + 1)^2 x 3: display-referred sRGB is 0.5 + the sum over the coefficients */
} cn_splats;

/* Allocates n Gaussians, all zero. CN_ERR_USAGE: the degree. CN_ERR_NOMEM. */
CN_API CN_NODISCARD cn_status cn_splats_create(cn_splats **splats, size_t n, uint32_t degree);
CN_API void cn_splats_destroy(cn_splats **splats); /* *splats may be NULL */

/* What the files say of themselves. Borrowed. */
typedef struct cn_splat_about {
    const cn_frame *frame; /* is written beside the file */
    const char *light;     /* one line; NULL: it is not named */
    const char *tiles;     /* one line: how many, and which; NULL: not named */
} cn_splat_about;

/* Writes Gaussians to F.ply, atomically, and the frame to F.frame.json: the usual layout of Kerbl et al., float x y z
 * nx ny nz f_dc_* f_rest_* opacity scale_* rot_*, with the logit of the opacity and the logarithm of the scales, binary
 * little-endian; local metres, x east, y north, z up. The normals are 0. Light, tiles and place are comments.
 *
 * CN_ERR_USAGE: another ending. CN_ERR_DATA: there is no Gaussian, or a number is not finite. CN_ERR_IO, CN_ERR_NOMEM:
 * an old file stays. */
CN_API CN_NODISCARD cn_status cn_splats_write(const cn_splats *splats, const cn_splat_about *about, const char *path);

#ifdef __cplusplus
}
#endif
#endif
