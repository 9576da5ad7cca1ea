/* COLMAP's lens models that cn_lens lacks, as the nearest of those it has. */
#include "base/units.h"
#include "bridge/ceres.h"
#include "pose/lens.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { FULL_OPENCV = 6, FOV = 7, SIMPLE_RADIAL_FISHEYE = 8, RADIAL_FISHEYE = 9, THIN_PRISM_FISHEYE = 10 };
static const struct {
    int id, n_params;
    const char *name;
} FOREIGN[] = {
    { FULL_OPENCV, 12, "FULL_OPENCV" },
    { FOV, 5, "FOV" },
    { SIMPLE_RADIAL_FISHEYE, 4, "SIMPLE_RADIAL_FISHEYE" },
    { RADIAL_FISHEYE, 5, "RADIAL_FISHEYE" },
    { THIN_PRISM_FISHEYE, 12, "THIN_PRISM_FISHEYE" },
};
enum { N_FOREIGN = sizeof FOREIGN / sizeof *FOREIGN };

/* Rays that the fit is made with: so many directions about the axis, and a step along each. */
enum { SPOKES = 32, STEPS_A_SPOKE = 180 };
#define STEP_DEG 1.0

static int place_of(int id)
{
    int i = 0;
    while (i < N_FOREIGN && FOREIGN[i].id != id)
        i++;
    return i;
}

int cn_lens_foreign_params(int id)
{
    const int i = place_of(id);
    return i < N_FOREIGN ? FOREIGN[i].n_params : 0;
}

int cn_lens_foreign_from_name(const char *name)
{
    for (int i = 0; i < N_FOREIGN; i++)
        if (strcmp(FOREIGN[i].name, name) == 0) return FOREIGN[i].id;
    return -1;
}

/* Brown's tangential terms at (x, y), r2 from the axis. */
static void tangential(const double p[2], const double xy[2], double r2, double out[2])
{
    out[0] = 2 * p[0] * xy[0] * xy[1] + p[1] * (r2 + 2 * xy[0] * xy[0]);
    out[1] = 2 * p[1] * xy[0] * xy[1] + p[0] * (r2 + 2 * xy[1] * xy[1]);
}

/* The pixel of a ray at an angle to the axis, on the spoke (cos, sin). */
static void project(int id, const double *p, double angle, const double spoke[2], double xy_px[2])
{
    const double *k = p + 4;
    double r = tan(angle), bent[2], more[2] = { 0, 0 };
    if (id == THIN_PRISM_FISHEYE) {
        const double r2 = angle * angle, xy[2] = { angle * spoke[0], angle * spoke[1] };
        const double radial = 1 + r2 * (k[0] + r2 * (k[1] + r2 * (k[4] + r2 * k[5])));
        tangential(k + 2, xy, r2, more);
        for (int a = 0; a < 2; a++)
            bent[a] = xy[a] * radial + more[a] + k[6 + a] * r2;
    } else if (id == FULL_OPENCV) {
        const double r2 = r * r, xy[2] = { r * spoke[0], r * spoke[1] };
        const double radial = (1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))) / (1 + r2 * (k[5] + r2 * (k[6] + r2 * k[7])));
        tangential(k + 2, xy, r2, more);
        for (int a = 0; a < 2; a++)
            bent[a] = xy[a] * radial + more[a];
    } else {
        if (fabs(k[0]) > 1e-6) r = atan(2 * r * tan(k[0] / 2)) / k[0];
        for (int a = 0; a < 2; a++)
            bent[a] = r * spoke[a];
    }
    for (int a = 0; a < 2; a++)
        xy_px[a] = p[a] * bent[a] + p[2 + a];
}

typedef struct bundle {
    cn_adjust_point point[SPOKES * STEPS_A_SPOKE];
    cn_adjust_observation seen[SPOKES * STEPS_A_SPOKE];
    uint32_t n;
} bundle;

/* The rays of a spoke, from the axis to the edge of the picture or to where the lens folds back. */
static void cast_spoke(bundle *to, int id, const double *params, const cn_camera *camera, int s)
{
    const double turn = 2 * CN_PI * s / SPOKES, spoke[2] = { cos(turn), sin(turn) };
    const double end = id == THIN_PRISM_FISHEYE ? CN_PI : CN_PI / 2;
    double before = 0;
    for (int i = 1; i < STEPS_A_SPOKE; i++) {
        const double angle = cn_radians(STEP_DEG * i);
        double at[2];
        if (angle >= end) return;
        project(id, params, angle, spoke, at);
        const double r = hypot(at[0] - params[2], at[1] - params[3]);
        if (!(r > before) || !(at[0] >= 0 && at[0] <= camera->width && at[1] >= 0 && at[1] <= camera->height)) return;
        before = r;
        to->point[to->n] =
            (cn_adjust_point){ .xyz = { sin(angle) * spoke[0], sin(angle) * spoke[1], cos(angle) }, .fixed = true };
        to->seen[to->n] =
            (cn_adjust_observation){ .point = to->n, .x_px = (float)at[0], .y_px = (float)at[1], .sigma_px = 1 };
        to->n++;
    }
}

/* Fits a lens that cn_lens has to the rays. Returns the largest error in pixels; INFINITY where there is no fit. */
static double fit(bundle *rays, cn_lens lens, const double *params, cn_camera *camera)
{
    cn_adjust_camera start = { .lens = (int)lens };
    cn_adjust_pose pose = { .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 }, .fixed = true };
    memcpy(start.params, params, 4 * sizeof *params);
    const cn_adjust_problem problem = { &start, &pose, rays->point, rays->seen, 1, 1, rays->n, rays->n };
    cn_adjust_options options = cn_adjust_options_default();
    options.loss_sigmas = 0;
    options.stage = "lens";
    cn_adjust_result result;
    const cn_context quiet = { 0 };
    if (cn_ceres_adjust(&quiet, &problem, &options, &result) != CN_OK) return INFINITY;
    camera->lens = lens;
    memcpy(camera->params, start.params, sizeof camera->params);
    const cn_lens_view view = cn_lens_unpack(camera);
    double worst = 0;
    for (uint32_t i = 0; i < rays->n; i++) {
        double at[2];
        if (!cn_lens_project(&view, rays->point[i].xyz, at)) return INFINITY;
        worst = fmax(worst, hypot(at[0] - (double)rays->seen[i].x_px, at[1] - (double)rays->seen[i].y_px));
    }
    return worst;
}

static cn_status approximate(int id, const double *params, cn_camera *camera, double *error_px)
{
    bundle *rays = calloc(1, sizeof *rays);
    if (!rays) return cn_fail(CN_ERR_NOMEM, "out of memory");
    for (int s = 0; s < SPOKES; s++)
        cast_spoke(rays, id, params, camera, s);
    cn_camera flat = *camera, wide = *camera;
    const double flat_px = rays->n ? fit(rays, CN_LENS_OPENCV, params, &flat) : INFINITY,
                 wide_px = rays->n ? fit(rays, CN_LENS_OPENCV_FISHEYE, params, &wide) : INFINITY;
    free(rays);
    *error_px = fmin(flat_px, wide_px);
    *camera = flat_px <= wide_px ? flat : wide;
    return CN_OK;
}

cn_status cn_lens_from_foreign(int id, const double *params, cn_camera *camera, const char *where, double *error_px)
{
    *error_px = 0;
    for (int i = 0; i < cn_lens_foreign_params(id); i++)
        if (!isfinite(params[i]))
            return cn_fail(CN_ERR_FORMAT, "%s: camera %u: parameter %d is not finite", where, camera->id, i);
    if (id == SIMPLE_RADIAL_FISHEYE || id == RADIAL_FISHEYE) {
        /* These are fisheye lenses with one focal length and fewer terms. */
        const double same[8] = { params[0], params[0], params[1],
                                 params[2], params[3], id == RADIAL_FISHEYE ? params[4] : 0 };
        camera->lens = CN_LENS_OPENCV_FISHEYE;
        memcpy(camera->params, same, sizeof same);
        return CN_OK;
    }
    CN_TRY(approximate(id, params, camera, error_px));
    if (*error_px <= CN_LENS_MOST_ERROR * fmax(camera->width, camera->height)) return CN_OK;
    char far[48] = "";
    if (isfinite(*error_px)) snprintf(far, sizeof far, ", the nearest %.1f pixels off", *error_px);
    return cn_fail(CN_ERR_FORMAT,
                   "%s: camera %u has lens model %s at %u x %u pixels, and no lens model of Conurb (" CN_LENS_NAMES
                   ") is near it%s; undistort the photos with colmap image_undistorter",
                   where, camera->id, FOREIGN[place_of(id)].name, camera->width, camera->height, far);
}
