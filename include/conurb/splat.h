/* conurb/splat.h: a scene as Gaussians ("splats"), which many viewers draw (Kerbl et al. 2023, "3D Gaussian splatting
 * for real-time radiance field rendering"). Threads: any thread, but one at a time for one cn_splats. */
#ifndef CONURB_SPLAT_H
#define CONURB_SPLAT_H
#include "conurb/base.h"
#include "conurb/colour.h"
#include "conurb/geo.h"
#include "conurb/pose.h"
#include "conurb/render.h"
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

/* Writes Gaussians, atomically, and the frame to F.frame.json.
 *
 * F.ply has the usual layout of Kerbl et al., float x y z nx ny nz f_dc_* f_rest_* opacity scale_* rot_*, with the
 * logit of the opacity and the logarithm of the scales, binary little-endian; local metres, x east, y north, z up. The
 * normals are 0. Light, tiles and place are comments.
 *
 * F.spz is SPZ of version 2 (Niantic 2024, gzip): places in steps of 0.25 mm (coarser beyond 2 km from the origin), all
 * else in bytes; x east, y up, z south, as the format asks. Light, tiles and axes are in F.about.json.
 *
 * CN_ERR_USAGE: another ending. CN_ERR_DATA: there is no Gaussian, or a number is not finite. CN_ERR_IO, CN_ERR_NOMEM:
 * an old file stays. */
CN_API CN_NODISCARD cn_status cn_splats_write(const cn_splats *splats, const cn_splat_about *about, const char *path);

/* CN_ERR_USAGE, as cn_splats_write would say it: before the work. */
CN_API CN_NODISCARD cn_status cn_splats_check_path(const char *path);

/* ---- from a field ---- */

/* Renders a view of a scene into the picture, which has the camera's size. depth: where half of the light is left. */
typedef cn_status (*cn_splat_draw)(void *user, const cn_context *ctx, const cn_camera *camera, const cn_view *view,
                                   cn_picture *picture);
/* What to make splats of. Borrowed. */
typedef struct cn_splat_source {
    const cn_scene *scene;
    const uint32_t *views; /* of the scene: those that the splats are fitted to */
    uint32_t n_views;
    uint32_t width_px; /* of the pictures that they are fitted to, at most */
    double near_m;     /* where the photos' rays begin: no Gaussian lies nearer before any of the scene's views; 0: they
                        * may lie anywhere */
    cn_splat_draw draw;
    void *user;
    const cn_colour *colour;
    cn_display_transform display;
} cn_splat_source;
typedef struct cn_splat_options {
    uint32_t budget; /* Gaussians at most */
    uint32_t degree; /* of the spherical harmonics */
    uint32_t rounds; /* each round sees every picture once */
    double limit_s;  /* the fit ends after so many seconds; 0: after its rounds */
} cn_splat_options;
CN_API cn_splat_options cn_splat_options_default(void);
typedef struct cn_splat_report {
    size_t n_seeds, n_pruned;
    uint32_t n_views, n_steps; /* pictures that it was fitted to, between the photos' views too; steps */
    double psnr;               /* over these pictures in the last round, dB */
    double render_s, fit_s;
} cn_splat_report;
/* Makes splats: the source is rendered in its views, without lens distortion (in the six faces of a cube for a view of
 * all directions), and, when they are fewer than 64, in
 * views between them, with about 32 pixels for each Gaussian of the budget at most. Their depths give flat
 * Gaussians, at most one for each pixel's footprint, fewer by the budget. Those of the sky lie on a sphere behind all
 * else. Then the Gaussians are fitted to the pictures: squared differences of display-referred colours and of opacity,
 * by Adam (Kingma and Ba 2015). Gaussians that contribute little are removed, and others are put where the pictures
 * differ most. With the same instruction set, the same bits on any number of threads, unless limit_s ends the fit.
 *
 * Scratch files in the folder of path: 8 bytes for each pixel of each picture. Memory: about 250 bytes for each
 * Gaussian of degree 0, 400 of degree 1. report may be NULL. The caller destroys *splats.
 *
 * CN_ERR_USAGE: an option out of range. CN_ERR_DATA: the views show no surface. CN_ERR_IO, CN_ERR_NOMEM,
 * CN_ERR_INTERRUPTED. */
CN_API CN_NODISCARD cn_status cn_splats_make(const cn_context *ctx, const cn_splat_source *source,
                                             const cn_splat_options *options, const char *path, cn_splats **splats,
                                             cn_splat_report *report);

/* Renders splats as viewers do, without lens distortion: rgb[height * width * 3], display-encoded, over black. */
CN_API CN_NODISCARD cn_status cn_splats_render(const cn_context *ctx, const cn_splats *splats, const cn_camera *camera,
                                               const cn_view *view, float *rgb);
/* The camera with which cn_splats_render shows what this one does: a pinhole of the same size and focal lengths. Of a
 * camera of all directions it shows the middle, 90 degrees high. */
CN_API cn_camera cn_splats_camera(const cn_camera *camera);

/* Reads F.ply in that layout. Harmonics above CN_SPLAT_MAX_DEGREE are left out. The caller destroys *splats.
 * CN_ERR_FORMAT: the message names the file and what is wrong. CN_ERR_IO, CN_ERR_NOMEM. */
CN_API CN_NODISCARD cn_status cn_splats_read(cn_splats **splats, const char *path);

#ifdef __cplusplus
}
#endif
#endif
