#include "splat/project.h"

#include "math/linalg.h"
#include "splat/harmonics.h"

#include <math.h>
#include <string.h>

/* ---- cameras ---- */

cn_splat_camera cn_splat_camera_of(const cn_camera *camera, const cn_view *view, const double origin[3], float near_m)
{
    const cn_camera pinhole = cn_splats_camera(camera);
    const double size[2] = { camera->width, camera->height };
    cn_splat_camera out = {
        .width = camera->width, .height = camera->height, .near_m = near_m, .least_alpha = CN_SPLAT_LEAST_ALPHA
    };
    double eye[3], shifted[3];
    cn_view_centre(view, eye);
    cn_mat3_vec(view->rotation, origin, shifted);
    for (int k = 0; k < 2; k++) {
        out.f[k] = (float)pinhole.params[k];
        out.c[k] = (float)pinhole.params[2 + k];
        const double off = fmax(pinhole.params[2 + k], size[k] - pinhole.params[2 + k]);
        out.limit[k] = (float)(1.3 * off / pinhole.params[k]);
    }
    for (int k = 0; k < 9; k++)
        out.rotation[k] = (float)view->rotation[k];
    for (int k = 0; k < 3; k++) {
        out.translation[k] = (float)(view->translation[k] + shifted[k]);
        out.eye[k] = (float)(eye[k] - origin[k]);
    }
    return out;
}

/* ---- forwards ---- */

/* What both directions compute: places, matrices, covariance. */
typedef struct projection {
    float t[3];     /* in the camera */
    float slope[2]; /* x/z and y/z, limited */
    bool limited[2];
    float jacobian[2][3]; /* of the picture by the camera's axes */
    float by_local[2][3]; /* jacobian * rotation */
    float turn[3][3];     /* world_from_splat */
    float q[4], length;   /* the unit quaternion, and the length that it had */
    float scale[3];
    float axes[2][3]; /* by_local * turn: the splat's axes in the picture, for a scale of 1 */
    float cov[3];     /* xx xy yy */
} projection;

static void turn_of(projection *p, const float *raw)
{
    float sum = 0;
    for (int k = 0; k < 4; k++)
        sum += raw[k] * raw[k];
    p->length = fmaxf(sqrtf(sum), 1e-12f);
    for (int k = 0; k < 4; k++)
        p->q[k] = raw[k] / p->length;
    const float w = p->q[0], x = p->q[1], y = p->q[2], z = p->q[3];
    const float m[3][3] = { { 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y) },
                            { 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x) },
                            { 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y) } };
    memcpy(p->turn, m, sizeof m);
}

/* False: it is behind the camera, or too near. */
static bool place(const cn_splat_camera *cam, const float *row, projection *p)
{
    for (int i = 0; i < 3; i++) {
        p->t[i] = cam->translation[i];
        for (int k = 0; k < 3; k++)
            p->t[i] += cam->rotation[3 * i + k] * row[CN_ROW_CENTRE + k];
    }
    return p->t[2] > cam->near_m;
}

static void shape(const cn_splat_camera *cam, const float *row, projection *p)
{
    const float z = p->t[2];
    for (int i = 0; i < 2; i++) {
        const float slope = p->t[i] / z;
        p->limited[i] = fabsf(slope) > cam->limit[i];
        p->slope[i] = fminf(fmaxf(slope, -cam->limit[i]), cam->limit[i]);
        for (int k = 0; k < 3; k++)
            p->jacobian[i][k] = k == i ? cam->f[i] / z : k == 2 ? -cam->f[i] * p->slope[i] / z : 0;
    }
    turn_of(p, row + CN_ROW_ROTATION);
    for (int k = 0; k < 3; k++)
        p->scale[k] = expf(row[CN_ROW_SCALE + k]);
    p->cov[0] = p->cov[2] = CN_SPLAT_BLUR;
    p->cov[1] = 0;
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 3; k++)
            p->by_local[i][k] = p->jacobian[i][i] * cam->rotation[3 * i + k] + p->jacobian[i][2] * cam->rotation[6 + k];
    for (int j = 0; j < 3; j++) {
        for (int i = 0; i < 2; i++) {
            p->axes[i][j] = 0;
            for (int k = 0; k < 3; k++)
                p->axes[i][j] += p->by_local[i][k] * p->turn[k][j];
        }
        const float s2 = p->scale[j] * p->scale[j];
        p->cov[0] += s2 * p->axes[0][j] * p->axes[0][j];
        p->cov[1] += s2 * p->axes[0][j] * p->axes[1][j];
        p->cov[2] += s2 * p->axes[1][j] * p->axes[1][j];
    }
}

/* The direction from the eye, and the distance. */
static float direction_of(const cn_splat_camera *cam, const float *row, float d[3])
{
    float sum = 0;
    for (int k = 0; k < 3; k++) {
        d[k] = row[CN_ROW_CENTRE + k] - cam->eye[k];
        sum += d[k] * d[k];
    }
    const float length = fmaxf(sqrtf(sum), 1e-12f);
    for (int k = 0; k < 3; k++)
        d[k] /= length;
    return length;
}

static void shade(const cn_splat_camera *cam, const float *row, uint32_t degree, float rgb[3])
{
    float d[3], basis[CN_HARMONICS_MOST];
    direction_of(cam, row, d);
    cn_harmonics(d, degree, basis);
    for (int k = 0; k < 3; k++)
        rgb[k] = 0.5f;
    for (uint32_t c = 0; c < (degree + 1) * (degree + 1); c++)
        for (uint32_t k = 0; k < 3; k++)
            rgb[k] += basis[c] * row[CN_ROW_COLOUR + 3 * c + k];
    for (int k = 0; k < 3; k++)
        rgb[k] = fmaxf(rgb[k], 0);
}

/* The box of the ellipse where alpha is the least that counts. False: it holds no pixel's centre. */
static bool box_of(const cn_splat_camera *cam, const projection *p, cn_flat_splat *flat)
{
    const uint32_t tile = CN_SPLAT_TILE; /* whole tiles: kernels work on all pixels of a row */
    const float size[2] = { (float)((cam->width + tile - 1) / tile * tile),
                            (float)((cam->height + tile - 1) / tile * tile) };
    const float middle[2] = { flat->x, flat->y }, reach = 2 * logf(flat->opacity / cam->least_alpha);
    if (!(reach > 0)) return false;
    for (int k = 0; k < 2; k++) {
        const float half = sqrtf(reach * p->cov[2 * k]) + 0.01f;
        const float low = fmaxf(ceilf(middle[k] - half - 0.5f), 0),
                    high = fminf(floorf(middle[k] + half + 0.5f), size[k]);
        if (!(low < high)) return false;
        flat->box[k] = (int16_t)low;
        flat->box[2 + k] = (int16_t)high;
    }
    return true;
}

/* Whether a Gaussian may reach the picture, by a ball about it. Most that do not end here. */
static bool near_picture(const cn_splat_camera *cam, const float *row, const projection *p, const cn_flat_splat *flat)
{
    const float widest = expf(fmaxf(fmaxf(row[CN_ROW_SCALE], row[CN_ROW_SCALE + 1]), row[CN_ROW_SCALE + 2])) / p->t[2];
    const float size[2] = { (float)cam->width, (float)cam->height }, at[2] = { flat->x, flat->y };
    for (int k = 0; k < 2; k++) {
        /* A Gaussian ends before 6 standard deviations; a pixel or two are blur and whole tiles. */
        const float reach = 6 * widest * cam->f[k] * (1 + cam->limit[k]) + CN_SPLAT_TILE + 4;
        if (at[k] < -reach || at[k] > size[k] + reach) return false;
    }
    return true;
}

bool cn_splat_project(const cn_splat_camera *cam, const float *row, uint32_t degree, cn_flat_splat *flat)
{
    projection p;
    if (!place(cam, row, &p)) return false;
    flat->x = cam->f[0] * p.t[0] / p.t[2] + cam->c[0];
    flat->y = cam->f[1] * p.t[1] / p.t[2] + cam->c[1];
    if (!near_picture(cam, row, &p, flat)) return false;
    flat->depth = p.t[2];
    flat->opacity = 1 / (1 + expf(-row[CN_ROW_OPACITY]));
    shape(cam, row, &p);
    const float det = p.cov[0] * p.cov[2] - p.cov[1] * p.cov[1];
    if (!(det > 0) || !isfinite(det) || !box_of(cam, &p, flat)) return false;
    flat->a = p.cov[2] / det;
    flat->b = -p.cov[1] / det;
    flat->c = p.cov[0] / det;
    shade(cam, row, degree, flat->rgb);
    return true;
}

/* ---- backwards ---- */

/* The gradient by the covariance's xx, yx = xy and yy: -K G K with the inverse covariance K. */
static void cov_back(const cn_flat_splat *f, const float sums[CN_SPLAT_SUMS], float h[2][2])
{
    const float k[2][2] = { { f->a, f->b }, { f->b, f->c } };
    const float g[2][2] = { { -0.5f * sums[CN_SUM_P_XX], -0.5f * sums[CN_SUM_P_XY] },
                            { -0.5f * sums[CN_SUM_P_XY], -0.5f * sums[CN_SUM_P_YY] } };
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 2; j++) {
            h[i][j] = 0;
            for (int m = 0; m < 2; m++)
                for (int n = 0; n < 2; n++)
                    h[i][j] -= k[i][m] * g[m][n] * k[n][j];
        }
}

static void turn_back(const projection *p, const float g[3][3], float *out)
{
    const float w = p->q[0], x = p->q[1], y = p->q[2], z = p->q[3];
    const float d[4] = {
        2 * (-z * g[0][1] + y * g[0][2] + z * g[1][0] - x * g[1][2] - y * g[2][0] + x * g[2][1]),
        2 * (y * g[0][1] + z * g[0][2] + y * g[1][0] - 2 * x * g[1][1] - w * g[1][2] + z * g[2][0] + w * g[2][1] -
             2 * x * g[2][2]),
        2 * (-2 * y * g[0][0] + x * g[0][1] + w * g[0][2] + x * g[1][0] + z * g[1][2] - w * g[2][0] + z * g[2][1] -
             2 * y * g[2][2]),
        2 * (-2 * z * g[0][0] - w * g[0][1] + x * g[0][2] + w * g[1][0] - 2 * z * g[1][1] + y * g[1][2] + x * g[2][0] +
             y * g[2][1]),
    };
    float along = 0;
    for (int k = 0; k < 4; k++)
        along += p->q[k] * d[k];
    for (int k = 0; k < 4; k++)
        out[k] = (d[k] - p->q[k] * along) / p->length;
}

/* From the covariance to scales, rotation and the place in the camera. */
static void shape_back(const cn_splat_camera *cam, const projection *p, const float h[2][2], float *gradient,
                       float t[3])
{
    float by_axes[2][3], by_turn[3][3] = { 0 }, by_local[2][3] = { 0 };
    for (int j = 0; j < 3; j++) {
        float sum = 0;
        for (int i = 0; i < 2; i++) {
            by_axes[i][j] = 2 * (h[i][0] * p->axes[0][j] + h[i][1] * p->axes[1][j]) * p->scale[j] * p->scale[j];
            sum += by_axes[i][j] * p->axes[i][j];
        }
        gradient[CN_ROW_SCALE + j] = sum;
    }
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 3; k++)
            for (int j = 0; j < 3; j++) {
                by_turn[k][j] += p->by_local[i][k] * by_axes[i][j];
                by_local[i][k] += by_axes[i][j] * p->turn[k][j];
            }
    turn_back(p, by_turn, gradient + CN_ROW_ROTATION);
    const float z = p->t[2];
    for (int i = 0; i < 2; i++) {
        float straight = 0, across = 0; /* by jacobian[i][i] and [i][2] */
        for (int k = 0; k < 3; k++) {
            straight += by_local[i][k] * cam->rotation[3 * i + k];
            across += by_local[i][k] * cam->rotation[6 + k];
        }
        t[2] += (across * p->slope[i] - straight) * cam->f[i] / (z * z);
        const float slope = p->limited[i] ? 0 : -across * cam->f[i] / z;
        t[i] += slope / z;
        t[2] -= slope * p->t[i] / (z * z);
    }
}

static void shade_back(const cn_splat_camera *cam, const float *row, uint32_t degree, const float by_rgb[3],
                       float *gradient)
{
    float d[3], basis[CN_HARMONICS_MOST], slope[CN_HARMONICS_MOST][3], by_d[3] = { 0 };
    const float length = direction_of(cam, row, d);
    cn_harmonics(d, degree, basis);
    cn_harmonics_slope(d, degree, slope);
    for (uint32_t c = 0; c < (degree + 1) * (degree + 1); c++)
        for (uint32_t k = 0; k < 3; k++) {
            gradient[CN_ROW_COLOUR + 3 * c + k] = basis[c] * by_rgb[k];
            for (int m = 0; m < 3; m++)
                by_d[m] += slope[c][m] * by_rgb[k] * row[CN_ROW_COLOUR + 3 * c + k];
        }
    const float along = d[0] * by_d[0] + d[1] * by_d[1] + d[2] * by_d[2];
    for (int k = 0; k < 3; k++)
        gradient[CN_ROW_CENTRE + k] += (by_d[k] - along * d[k]) / length;
}

void cn_splat_project_back(const cn_splat_camera *cam, const float *row, uint32_t degree, const cn_flat_splat *flat,
                           const float sums[CN_SPLAT_SUMS], float *gradient)
{
    projection p;
    float h[2][2], t[3] = { 0 }, by_rgb[3];
    (void)place(cam, row, &p);
    shape(cam, row, &p);
    cov_back(flat, sums, h);
    const float x = flat->a * sums[CN_SUM_P_X] + flat->b * sums[CN_SUM_P_Y];
    const float y = flat->b * sums[CN_SUM_P_X] + flat->c * sums[CN_SUM_P_Y];
    t[0] = x * cam->f[0] / p.t[2];
    t[1] = y * cam->f[1] / p.t[2];
    t[2] = -(t[0] * p.t[0] + t[1] * p.t[1]) / p.t[2];
    shape_back(cam, &p, h, gradient, t);
    for (int k = 0; k < 3; k++) {
        gradient[CN_ROW_CENTRE + k] = 0;
        for (int i = 0; i < 3; i++)
            gradient[CN_ROW_CENTRE + k] += cam->rotation[3 * i + k] * t[i];
        by_rgb[k] = flat->rgb[k] > 0 ? sums[CN_SUM_RED + k] : 0;
    }
    gradient[CN_ROW_OPACITY] = sums[CN_SUM_P] * (1 - flat->opacity);
    shade_back(cam, row, degree, by_rgb, gradient);
}
