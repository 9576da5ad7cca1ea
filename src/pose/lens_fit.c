/* Lenses of other tools as one of cn_lens. */
#include "pose/importer.h"
#include "pose/lens.h"

#include <math.h>
#include <string.h>

enum { SAMPLES = 128, BISECTIONS = 60, TERMS = 3 };

static double polynomial(const double k[4], double r)
{
    const double s = r * r;
    return r * (1.0 + s * (k[0] + s * (k[1] + s * (k[2] + s * k[3]))));
}

/* The r in [0, most] with polynomial(r) = wanted; most when there is none. The polynomial rises up to there. */
static double invert(const double k[4], double wanted, double most)
{
    double low = 0.0, high = most;
    for (int i = 0; i < BISECTIONS; i++) {
        const double middle = 0.5 * (low + high);
        if (polynomial(k, middle) < wanted)
            low = middle;
        else
            high = middle;
    }
    return 0.5 * (low + high);
}

/* Solves the 3 x 3 system a x = b by Cramer's rule. False when it is singular. */
static bool solve3(double a[TERMS][TERMS], const double b[TERMS], double x[TERMS])
{
    double m[TERMS][TERMS], determinant[TERMS + 1];
    for (int c = 0; c <= TERMS; c++) {
        memcpy(m, a, sizeof m);
        for (int i = 0; i < TERMS && c < TERMS; i++)
            m[i][c] = b[i];
        determinant[c] = m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
                         m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
                         m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
    }
    for (int c = 0; c < TERMS; c++)
        x[c] = determinant[c] / determinant[TERMS];
    return isfinite(x[0]) && isfinite(x[1]) && isfinite(x[2]);
}

/* straight[i] to bent[i], n radii over the focal length, by bent = scale * r * (1 + k1 r^2 + k2 r^4). Returns the
 * largest error, or INFINITY. */
static double fit(const double *straight, const double *bent, int n, double *scale, double k[4])
{
    double a[TERMS][TERMS] = { { 0 } }, b[TERMS] = { 0 }, x[TERMS], worst = 0.0;
    /* Radii are divided by the largest one to keep the system well conditioned. */
    const double unit = straight[n - 1];
    for (int i = 0; i < n; i++) {
        const double r = straight[i] / unit, s = r * r, row[TERMS] = { r, r * s, r * s * s };
        for (int p = 0; p < TERMS; p++) {
            b[p] += row[p] * bent[i];
            for (int q = 0; q < TERMS; q++)
                a[p][q] += row[p] * row[q];
        }
    }
    if (!solve3(a, b, x) || !(x[0] > 0.0)) return INFINITY;
    *scale = x[0] / unit;
    k[0] = x[1] / x[0] / (unit * unit);
    k[1] = x[2] / x[0] / (unit * unit * unit * unit);
    k[2] = k[3] = 0.0;
    for (int i = 0; i < n; i++)
        worst = fmax(worst, fabs(*scale * polynomial(k, straight[i]) - bent[i]));
    return worst;
}

/* Radius of the farthest corner over the focal length. */
static double farthest(const cn_import_lens *lens, const cn_camera *camera)
{
    const double x = fmax(lens->cx, camera->width - lens->cx), y = fmax(lens->cy, camera->height - lens->cy);
    return hypot(x / lens->fx, y / lens->fy);
}

/* Replaces the radial terms by k1 and k2. Returns the largest error in pixels. Where the lens folds back there are no
 * rays, and nothing is asked of the fit; a lens that folds back in the middle of the picture is none. */
static double approximate(const cn_import_lens *lens, const cn_camera *camera, cn_lens_view *view)
{
    enum { WIDEST = 4 }; /* straight radii at most so many times the bent ones */
    double straight[SAMPLES], bent[SAMPLES], scale = 1.0;
    const double most = farthest(lens, camera), fold = cn_lens_fold(lens->k, WIDEST * most);
    int n = 0;
    for (; n < SAMPLES; n++) {
        bent[n] = most * (n + 1) / SAMPLES;
        if (!lens->undistorts && bent[n] > polynomial(lens->k, fold)) break;
        straight[n] = lens->undistorts ? polynomial(lens->k, bent[n]) : invert(lens->k, bent[n], fold);
    }
    if (n < SAMPLES / 2) return INFINITY;
    const double error_px = fit(straight, bent, n, &scale, view->k) * fmax(lens->fx, lens->fy);
    view->fx *= scale;
    view->fy *= scale;
    for (int i = 0; i < 2; i++)
        view->p[i] /= scale;
    return error_px;
}

static bool is_straight(const cn_lens_view *view)
{
    return !view->fisheye && view->k[0] == 0.0 && view->k[1] == 0.0 && view->p[0] == 0.0 && view->p[1] == 0.0;
}

cn_status cn_importer_lens(cn_importer *to, const cn_import_lens *lens, const char *who, cn_camera *camera)
{
    cn_lens_view view = { .fx = lens->fx, .fy = lens->fy, .cx = lens->cx, .cy = lens->cy, .fisheye = lens->fisheye };
    memcpy(view.k, lens->k, sizeof view.k);
    memcpy(view.p, lens->p, sizeof view.p);
    if (!(lens->fx > 0.0) || !(lens->fy > 0.0) || camera->width == 0 || camera->height == 0)
        return cn_fail(CN_ERR_FORMAT, "%s: %s: focal length %g x %g at %u x %u pixels is no camera", to->path, who,
                       lens->fx, lens->fy, camera->width, camera->height);
    double error_px = 0;
    const double far = farthest(lens, camera);
    if (lens->fisheye) error_px += 3.0 * hypot(lens->p[0], lens->p[1]) * far * far * fmax(lens->fx, lens->fy);
    const bool more_terms = lens->k[2] != 0.0 || lens->k[3] != 0.0, inverse = lens->undistorts && lens->k[0] != 0.0;
    if (!lens->fisheye && (more_terms || inverse)) error_px += approximate(lens, camera, &view);
    if (!(error_px <= CN_LENS_MOST_ERROR * fmax(camera->width, camera->height)))
        return cn_fail(CN_ERR_FORMAT,
                       "%s: %s: no lens model of Conurb (" CN_LENS_NAMES ") comes nearer to this lens than %.1f "
                       "pixels; export undistorted photos and their poses",
                       to->path, who, error_px);
    if (error_px > to->worst_fit_px) to->worst_fit_px = error_px;
    camera->lens = lens->fisheye ? CN_LENS_OPENCV_FISHEYE : CN_LENS_OPENCV;
    if (is_straight(&view)) camera->lens = CN_LENS_PINHOLE;
    cn_lens_pack(&view, camera);
    CN_TRY(cn_camera_check(camera, to->path));
    return cn_camera_check_inverse(camera, to->path, who);
}
