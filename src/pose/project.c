/* Converts pixels to rays and back, with distortion. */
#include "base/units.h"
#include "math/linalg.h"
#include "pose/lens.h"

#include <math.h>

#define MAX_STEPS 100
#define TOLERANCE 1e-13
/* The fold is the radius where the distortion turns back. Corners beyond it are common: wide lenses with few terms,
 * and circular fisheye pictures, whose circle is 44 % of the picture at 16:9. Training leaves these pixels out. When
 * less than this share of the picture is inside the fold, the parameters must be wrong. */
#define LEAST_OF_PICTURE 0.5
#define LEAST_OF_CIRCLE 0.25
/* Pincushion distortion of real lenses is about 10 % at the corners. */
#define MOST_STRETCH 2.0

/* Odd polynomial x (1 + k1 x^2 + ...): the radius of all these lenses; for the fisheye x is an angle. */
static double distort(const double k[4], double x)
{
    double s = x * x;
    return x * (1.0 + s * (k[0] + s * (k[1] + s * (k[2] + s * k[3]))));
}

static double distort_derivative(const double k[4], double x)
{
    double s = x * x;
    return 1.0 + s * (3.0 * k[0] + s * (5.0 * k[1] + s * (7.0 * k[2] + s * 9.0 * k[3])));
}

/* The radius beyond which the distortion of a radial lens folds back: the smallest positive root of 1 + 3 k1 r^2 + 5
 * k2 r^4. */
static double radial_limit(const double k[4])
{
    double a = 5.0 * k[1], b = 3.0 * k[0];
    if (a == 0.0) return b < 0.0 ? sqrt(-1.0 / b) : INFINITY;
    double discriminant = b * b - 4.0 * a;
    if (discriminant < 0.0) return INFINITY;
    /* The form without cancellation: roots q / a and 1 / q. */
    double q = -0.5 * (b + copysign(sqrt(discriminant), b));
    double r0 = q / a, r1 = 1.0 / q, least = INFINITY;
    if (r0 > 0.0) least = r0;
    if (r1 > 0.0 && r1 < least) least = r1;
    return sqrt(least);
}

double cn_lens_fold(const double k[4], double most)
{
    enum { STEPS = 64 };
    for (int i = 1; i <= STEPS; i++) {
        double high = most * i / STEPS, low = most * (i - 1) / STEPS;
        if (distort_derivative(k, high) > 0.0) continue;
        for (int j = 0; j < 50; j++) {
            double middle = 0.5 * (low + high);
            if (distort_derivative(k, middle) > 0.0)
                low = middle;
            else
                high = middle;
        }
        return low;
    }
    return most;
}

/* The angle to the axis beyond which a fisheye folds back; 180 degrees if it never does. */
static double fisheye_limit(const double k[4])
{
    return cn_lens_fold(k, CN_PI);
}

static void distort_opencv(const cn_lens_view *lens, double u, double v, double out[2])
{
    double s = u * u + v * v, radial = 1.0 + s * (lens->k[0] + s * lens->k[1]);
    out[0] = u * radial + 2.0 * lens->p[0] * u * v + lens->p[1] * (s + 2.0 * u * u);
    out[1] = v * radial + 2.0 * lens->p[1] * u * v + lens->p[0] * (s + 2.0 * v * v);
}

static bool project_fisheye(const cn_lens_view *lens, const double xyz[3], double uv[2])
{
    double r = hypot(xyz[0], xyz[1]);
    if (r == 0.0) {
        uv[0] = uv[1] = 0.0;
        return xyz[2] > 0.0;
    }
    double theta = atan2(r, xyz[2]);
    if (!(theta <= fisheye_limit(lens->k))) return false;
    double scale = distort(lens->k, theta) / r;
    uv[0] = xyz[0] * scale;
    uv[1] = xyz[1] * scale;
    return true;
}

/* Azimuth and elevation; false at the camera's centre. */
static bool project_sphere(const double xyz[3], double uv[2])
{
    const double level = hypot(xyz[0], xyz[2]);
    if (!(level > 0.0) && !(fabs(xyz[1]) > 0.0)) return false;
    uv[0] = atan2(xyz[0], xyz[2]);
    uv[1] = atan2(xyz[1], level);
    return true;
}

bool cn_lens_project(const cn_lens_view *lens, const double xyz[3], double xy_px[2])
{
    double uv[2];
    if (lens->equirectangular) {
        if (!project_sphere(xyz, uv)) return false;
    } else if (lens->fisheye) {
        if (!project_fisheye(lens, xyz, uv)) return false;
    } else {
        if (!(xyz[2] > 0.0)) return false;
        const double u = xyz[0] / xyz[2], v = xyz[1] / xyz[2], limit = radial_limit(lens->k);
        if (isfinite(limit) && !(hypot(u, v) <= limit)) return false;
        distort_opencv(lens, u, v, uv);
    }
    xy_px[0] = lens->fx * uv[0] + lens->cx;
    xy_px[1] = lens->fy * uv[1] + lens->cy;
    return isfinite(xy_px[0]) && isfinite(xy_px[1]);
}

bool cn_camera_project(const cn_camera *camera, const double xyz[3], double xy_px[2])
{
    const cn_lens_view lens = cn_lens_unpack(camera);
    return cn_lens_project(&lens, xyz, xy_px);
}

/* x in [0, limit] with distort(k, x) = target; the derivative is positive there, so a bracketed Newton iteration
 * converges. */
static bool undistort(const double k[4], double target, double limit, double *x)
{
    double low = 0.0, high = limit;
    if (!isfinite(high)) {
        high = target + 1.0;
        for (int i = 0; i < 64 && distort(k, high) < target; i++)
            high *= 2.0;
    }
    if (!(distort(k, high) >= target)) return false;
    *x = target < high ? target : 0.5 * high;
    for (int step = 0; step < MAX_STEPS; step++) {
        double error = distort(k, *x) - target;
        if (fabs(error) <= TOLERANCE * (1.0 + target)) return true;
        if (error > 0.0)
            high = *x;
        else
            low = *x;
        double next = *x - error / distort_derivative(k, *x);
        *x = next > low && next < high ? next : 0.5 * (low + high);
    }
    /* At the fold the derivative is zero, and the last digits are not determined. */
    return fabs(distort(k, *x) - target) <= 1e-9 * (1.0 + target);
}

/* Share of the picture's pixels nearer to the principal point than the fold, by a grid of points. */
static double share_within(const cn_camera *camera, const cn_lens_view *lens, double fold)
{
    enum { GRID = 33 };
    uint32_t n = 0;
    for (int i = 0; i < GRID * GRID; i++) {
        const double x = camera->width * (i % GRID + 0.5) / GRID, y = camera->height * (i / GRID + 0.5) / GRID;
        n += hypot((x - lens->cx) / lens->fx, (y - lens->cy) / lens->fy) <= fold;
    }
    return n / (double)(GRID * GRID);
}

/* Distance of the farthest corner from the principal point, in focal lengths. */
static double farthest_corner(const cn_camera *camera, const cn_lens_view *lens)
{
    return hypot(fmax(lens->cx, camera->width - lens->cx) / lens->fx,
                 fmax(lens->cy, camera->height - lens->cy) / lens->fy);
}

cn_status cn_camera_check_inverse(const cn_camera *camera, const char *where, const char *who)
{
    const cn_lens_view lens = cn_lens_unpack(camera);
    if (lens.equirectangular) return CN_OK;
    const double limit = lens.fisheye ? fisheye_limit(lens.k) : radial_limit(lens.k);
    const double corner = farthest_corner(camera, &lens), fold = isfinite(limit) ? distort(lens.k, limit) : INFINITY;
    double x = corner;
    if (share_within(camera, &lens, fold) < (lens.fisheye ? LEAST_OF_CIRCLE : LEAST_OF_PICTURE))
        return cn_fail(CN_ERR_FORMAT,
                       "%s: %s: the distortion (k1 %g, k2 %g) has no inverse farther than %.0f px from the principal "
                       "point, inside the picture of %u x %u; correct k1 and k2",
                       where, who, lens.k[0], lens.k[1], fold * lens.fx, camera->width, camera->height);
    if (corner > 0.0 && undistort(lens.k, corner, limit, &x) && corner > MOST_STRETCH * x)
        return cn_fail(CN_ERR_FORMAT,
                       "%s: %s: the distortion (k1 %g, k2 %g) moves a corner of the picture to %.1f times its distance "
                       "from the principal point, which no lens does; correct k1 and k2",
                       where, who, lens.k[0], lens.k[1], corner / x);
    return CN_OK;
}

static bool undistort_fisheye(const cn_lens_view *lens, double u, double v, double dir[3])
{
    double distorted = hypot(u, v), theta;
    if (distorted == 0.0) return true; /* the pinhole ray is the axis */
    if (!undistort(lens->k, distorted, fisheye_limit(lens->k), &theta)) return false;
    double s = sin(theta) / distorted;
    dir[0] = u * s;
    dir[1] = v * s;
    dir[2] = cos(theta);
    return true;
}

/* Beyond a pole there is nothing; beyond the left and right edge the picture begins again. */
static bool unproject_sphere(double u, double v, double dir[3])
{
    if (!(fabs(v) <= 0.5 * CN_PI * (1.0 + 1e-9)) || !isfinite(u)) return false;
    dir[0] = cos(v) * sin(u);
    dir[1] = sin(v);
    dir[2] = cos(v) * cos(u);
    return true;
}

/* One Newton step of the tangential model at (u, v) for the residual. False where the lens folds. */
static bool newton_direction(const cn_lens_view *lens, const double w[2], const double residual[2], double step[2])
{
    double u = w[0], v = w[1], s = u * u + v * v;
    double radial = 1.0 + s * (lens->k[0] + s * lens->k[1]), derivative = 2.0 * (lens->k[0] + 2.0 * s * lens->k[1]);
    double cross = derivative * u * v + 2.0 * lens->p[0] * u + 2.0 * lens->p[1] * v;
    double a = radial + derivative * u * u + 2.0 * lens->p[0] * v + 6.0 * lens->p[1] * u;
    double d = radial + derivative * v * v + 2.0 * lens->p[1] * u + 6.0 * lens->p[0] * v;
    double determinant = a * d - cross * cross;
    if (!(determinant > 1e-12) || !(a + d > 0.0)) return false;
    step[0] = (d * residual[0] - cross * residual[1]) / determinant;
    step[1] = (a * residual[1] - cross * residual[0]) / determinant;
    return true;
}

/* Newton's method in two dimensions; a step is halved while the residual does not fall. w holds the start and the
 * result. */
static bool undistort_tangential(const cn_lens_view *lens, const double target[2], double w[2])
{
    double at[2], residual[2], step[2];
    for (int i = 0; i < MAX_STEPS; i++) {
        distort_opencv(lens, w[0], w[1], at);
        residual[0] = target[0] - at[0];
        residual[1] = target[1] - at[1];
        double size = hypot(residual[0], residual[1]), scale = 1.0, reached = INFINITY;
        if (!newton_direction(lens, w, residual, step)) return false;
        if (size <= TOLERANCE * (1.0 + hypot(target[0], target[1]))) return true;
        double next[2] = { w[0], w[1] };
        for (int halving = 0; halving < 30 && !(reached < size); halving++, scale *= 0.5) {
            next[0] = w[0] + scale * step[0];
            next[1] = w[1] + scale * step[1];
            distort_opencv(lens, next[0], next[1], at);
            reached = hypot(target[0] - at[0], target[1] - at[1]);
        }
        if (!(reached < size)) return size <= 1e-9; /* the limit of double precision */
        w[0] = next[0];
        w[1] = next[1];
    }
    return false;
}

static bool undistort_opencv(const cn_lens_view *lens, double u, double v, double dir[3])
{
    const double target[2] = { u, v };
    double distorted = hypot(u, v), r, limit = radial_limit(lens->k), w[2] = { u, v };
    bool tangential = lens->p[0] != 0.0 || lens->p[1] != 0.0;
    if (distorted > 0.0 && undistort(lens->k, distorted, limit, &r)) {
        w[0] = u * r / distorted;
        w[1] = v * r / distorted;
    } else if (distorted > 0.0 && !tangential) {
        return false;
    } else if (distorted > 0.0) {
        /* With tangential terms, points may be reachable that radial terms alone do not reach: start just inside the
         * fold. */
        w[0] = u * 0.95 * limit / distorted;
        w[1] = v * 0.95 * limit / distorted;
    }
    if (tangential && !undistort_tangential(lens, target, w)) return false;
    if (!(hypot(w[0], w[1]) <= limit * (1.0 + 1e-9))) return false;
    dir[0] = w[0];
    dir[1] = w[1];
    dir[2] = 1.0;
    return true;
}

cn_status cn_camera_unproject(const cn_camera *camera, double x_px, double y_px, double dir[3])
{
    cn_lens_view lens = cn_lens_unpack(camera);
    double u = (x_px - lens.cx) / lens.fx, v = (y_px - lens.cy) / lens.fy;
    dir[0] = u;
    dir[1] = v;
    dir[2] = 1.0;
    bool found = lens.equirectangular ? unproject_sphere(u, v, dir)
                 : lens.fisheye       ? undistort_fisheye(&lens, u, v, dir)
                                      : undistort_opencv(&lens, u, v, dir);
    /* For NaN input, return the axis. */
    if (!cn_normalize3(dir)) {
        dir[0] = dir[1] = 0.0;
        dir[2] = 1.0;
        found = false;
    }
    if (found) return CN_OK;
    return cn_fail(CN_ERR_DATA, "camera %u: the %s distortion has no inverse at pixel (%g, %g)", camera->id,
                   cn_lens_name(camera->lens), x_px, y_px);
}

void cn_camera_look_up(const cn_camera *camera, const float *rgbw, const double dir[3], float out[4])
{
    const uint32_t width = camera->width, height = camera->height;
    double px[2];
    for (int k = 0; k < 4; k++)
        out[k] = 0;
    if (!cn_camera_project(camera, dir, px)) return;
    const double x = px[0] - 0.5, y = px[1] - 0.5;
    if (!(x >= 0 && y >= 0 && x <= width - 1 && y <= height - 1)) return;
    const uint32_t x0 = (uint32_t)fmin(x, width - 2), y0 = (uint32_t)fmin(y, height - 2);
    const float u = (float)(x - x0), w = (float)(y - y0);
    const float *top = rgbw + 4 * ((size_t)y0 * width + x0), *below = top + 4 * (size_t)width;
    for (int k = 0; k < 3; k++)
        out[k] = (1 - w) * ((1 - u) * top[k] + u * top[4 + k]) + w * ((1 - u) * below[k] + u * below[4 + k]);
    out[3] = fminf(fminf(top[3], top[7]), fminf(below[3], below[7]));
}
