/* Relative poses of pairs of photos. */
#include "math/linalg.h"
#include "pose/lens.h"
#include "pose/view_graph.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    LEAST_MATCHES = 30, /* of a pair, GLOMAP's; with fewer, some pairs show other places that look alike */
    MOST_USED = 400,    /* matches, evenly out of all of a pair */
    ROUNDS = 10,
    UNKNOWNS = 6 /* a turn and a shift */
};
#define SCALE 2e-3 /* Cauchy's, radians: some pixels */
/* Focal lengths of cameras without EXIF, in sides of the picture: 0.4 to 4.2. */
#define LEAST_FOCAL 0.4
enum { FOCAL_STEPS = 25, LEAST_PAIRS = 5 };
#define IMBALANCE 0.05 /* of singular values, that counts half */
/* A minimum counts where the cost on either side, at 1.5 times and at 1 / 1.5 of the focal length, is higher by this.
 */
#define ASIDE 1.5
#define LEAST_RISE 0.03
/* Of the matches that lie before both cameras, of all: wrong ones out of verification do not. */
#define LEAST_BEFORE 0.6

/* Two rays of the k-th match that is used. False: one of them is not known. */
static bool rays_of(const cn_view_graph *g, const cn_graph_pair *pair, uint32_t k, double a[3], double b[3])
{
    const float *ra = g->views[pair->a].rays[pair->pairs[k][0]], *rb = g->views[pair->b].rays[pair->pairs[k][1]];
    for (int c = 0; c < 3; c++) {
        a[c] = ra[c];
        b[c] = rb[c];
    }
    return cn_dot3(a, a) > 0.5 && cn_dot3(b, b) > 0.5;
}

/* Matches before both cameras, of how many, for x_b = rotation * x_a + translation. */
static uint32_t count_before(const cn_view_graph *g, const cn_graph_pair *pair, const double rotation[9],
                             const double translation[3], uint32_t *of)
{
    const uint32_t step = 1 + pair->n / MOST_USED;
    uint32_t n = 0;
    *of = 0;
    for (uint32_t k = 0; k < pair->n; k += step) {
        double a[3], b[3], turned[3];
        if (!rays_of(g, pair, k, a, b)) continue;
        cn_mat3_vec(rotation, a, turned);
        const double d = cn_dot3(turned, b), ta = cn_dot3(turned, translation), tb = cn_dot3(b, translation);
        /* Depths along the rays times 1 - d * d, which is not negative. */
        const double depth_a = d * tb - ta, depth_b = tb - d * ta;
        n += depth_a > 0 && depth_b > 0;
        ++*of;
    }
    return n;
}

/* The rotation for one sign of the translation b of E = [b]x R (Horn 1990, "Recovering baseline and orientation from
 * essential matrix"): (cofactors(E) - [b]x E) / (b . b). */
static void rotation_of(const double e[9], const double b[3], double rotation[9])
{
    const double cross[9] = { 0, -b[2], b[1], b[2], 0, -b[0], -b[1], b[0], 0 };
    double product[9], quaternion[4];
    cn_mat3_mul(cross, e, product);
    for (int i = 0; i < 3; i++) {
        double cofactors[3];
        cn_cross3(e + 3 * ((i + 1) % 3), e + 3 * ((i + 2) % 3), cofactors);
        for (int j = 0; j < 3; j++)
            rotation[3 * i + j] = (cofactors[j] - product[3 * i + j]) / cn_dot3(b, b);
    }
    cn_mat3_to_quat(rotation, quaternion);
    cn_quat_to_mat3(quaternion, rotation);
}

/* transpose(K_b) F K_a */
static void essential_of(const cn_view_graph *g, const cn_graph_pair *pair, double e[9])
{
    memcpy(e, pair->matrix, sizeof pair->matrix);
    if (pair->is_essential) return;
    const cn_lens_view a = cn_lens_unpack(&g->cameras[g->views[pair->a].camera]);
    const cn_lens_view b = cn_lens_unpack(&g->cameras[g->views[pair->b].camera]);
    const double ka[9] = { a.fx, 0, a.cx, 0, a.fy, a.cy, 0, 0, 1 };
    const double kb[9] = { b.fx, 0, 0, 0, b.fy, 0, b.cx, b.cy, 1 }; /* transposed */
    double half[9];
    cn_mat3_mul(pair->matrix, ka, half);
    cn_mat3_mul(kb, half, e);
}

/* The best of the four poses that an essential matrix stands for. False: none has most matches before both cameras. */
static bool decompose(const cn_view_graph *g, cn_graph_pair *pair)
{
    double e[9], b[3] = { 0 }, columns[3][3];
    uint32_t best = 0, of = 0;
    essential_of(g, pair, e);
    for (int j = 0; j < 3; j++)
        for (int i = 0; i < 3; i++)
            columns[j][i] = e[3 * i + j];
    /* b is at right angles to all columns. */
    for (int j = 0; j < 3; j++) {
        double cross[3];
        cn_cross3(columns[j], columns[(j + 1) % 3], cross);
        if (cn_norm3(cross) > cn_norm3(b)) memcpy(b, cross, sizeof b);
    }
    double trace = 0;
    for (int i = 0; i < 9; i++)
        trace += 0.5 * e[i] * e[i];
    if (!cn_normalize3(b) || !(trace > 0)) return false;
    for (int i = 0; i < 3; i++)
        b[i] *= sqrt(trace);
    for (int sign = 0; sign < 4; sign++) {
        const double way = sign & 1 ? -1.0 : 1.0, twist = sign & 2 ? -1.0 : 1.0;
        double along[3], rotation[9], translation[3];
        for (int i = 0; i < 3; i++) {
            along[i] = twist * b[i];
            translation[i] = way * b[i];
        }
        rotation_of(e, along, rotation);
        const uint32_t n = count_before(g, pair, rotation, translation, &of);
        if (n <= best) continue;
        best = n;
        memcpy(pair->rotation, rotation, sizeof rotation);
        memcpy(pair->translation, translation, sizeof translation);
        cn_normalize3(pair->translation);
    }
    return best >= LEAST_BEFORE * of && best > 0;
}

/* Solves m x = v by Cholesky, in place: v becomes x. False: m is not positive. */
static bool solve(double m[UNKNOWNS][UNKNOWNS], double v[UNKNOWNS])
{
    for (int i = 0; i < UNKNOWNS; i++) {
        for (int j = 0; j <= i; j++) {
            double sum = m[i][j];
            for (int k = 0; k < j; k++)
                sum -= m[i][k] * m[j][k];
            if (i == j && !(sum > 0)) return false;
            m[i][j] = i == j ? sqrt(sum) : sum / m[j][j];
        }
        for (int k = 0; k < i; k++)
            v[i] -= m[i][k] * v[k];
        v[i] /= m[i][i];
    }
    for (int i = UNKNOWNS - 1; i >= 0; i--) {
        for (int k = i + 1; k < UNKNOWNS; k++)
            v[i] -= m[k][i] * v[k];
        v[i] /= m[i][i];
    }
    return true;
}

/* One step of Gauss and Newton on the angles between rays and epipolar planes, by Cauchy's loss. */
static bool refine_once(const cn_view_graph *g, cn_graph_pair *pair)
{
    const double *t = pair->translation;
    const uint32_t step = 1 + pair->n / MOST_USED;
    double m[UNKNOWNS][UNKNOWNS] = { { 0 } }, v[UNKNOWNS] = { 0 }, row[UNKNOWNS];
    for (uint32_t k = 0; k < pair->n; k += step) {
        double a[3], b[3], turned[3], plane[3], bt[3];
        if (!rays_of(g, pair, k, a, b)) continue;
        cn_mat3_vec(pair->rotation, a, turned);
        cn_cross3(t, turned, plane);
        const double length = cn_norm3(plane);
        if (length < 1e-6) continue;
        const double error = cn_dot3(b, plane) / length;
        cn_cross3(b, t, bt);
        cn_cross3(turned, bt, row);
        cn_cross3(turned, b, row + 3);
        const double weight = 1.0 / (1.0 + error * error / (SCALE * SCALE));
        for (int i = 0; i < UNKNOWNS; i++) {
            for (int j = 0; j <= i; j++)
                m[i][j] += weight * row[i] * row[j] / (length * length);
            v[i] -= weight * row[i] * error / length;
        }
    }
    /* The length of t stays; a little damping, for a turn and a shift look alike where the view is narrow. */
    double trace = 0;
    for (int i = 0; i < UNKNOWNS; i++)
        trace += m[i][i];
    for (int i = 0; i < UNKNOWNS; i++) {
        for (int j = 3; j <= i; j++)
            m[i][j] += trace * t[i - 3] * t[j - 3];
        m[i][i] += 1e-9 * trace;
    }
    if (!solve(m, v)) return false;
    double turn[9], before[9];
    cn_turn_to_mat3(v, turn);
    memcpy(before, pair->rotation, sizeof before);
    cn_mat3_mul(turn, before, pair->rotation);
    for (int i = 0; i < 3; i++)
        pair->translation[i] += v[3 + i];
    return cn_normalize3(pair->translation);
}

static void relate(void *user, size_t i, unsigned worker)
{
    const cn_view_graph *g = user;
    cn_graph_pair *pair = &g->pairs[i];
    (void)worker;
    if (!pair->used) return;
    pair->used = pair->n >= LEAST_MATCHES && decompose(g, pair);
    for (int k = 0; k < ROUNDS && pair->used; k++)
        pair->used = refine_once(g, pair);
    uint32_t of;
    if (pair->used)
        pair->used = count_before(g, pair, pair->rotation, pair->translation, &of) >= LEAST_BEFORE * of && of > 0;
}

/* How far E's two singular values differ, 0 to 1. */
static double imbalance(const double e[9])
{
    double transposed[9], square[9], values[3], vectors[9];
    cn_mat3_transpose(e, transposed);
    cn_mat3_mul(transposed, e, square);
    cn_eigen_symmetric(3, square, values, vectors);
    const double small = sqrt(fmax(values[1], 0)), large = sqrt(fmax(values[2], 0));
    return large > 0 ? (large - small) / (large + small) : 1;
}

/* The mean imbalance of a camera's pairs with this focal length, by a loss that wrong pairs hardly move. */
static double cost_of(cn_view_graph *g, uint32_t camera, double focal, uint32_t *n)
{
    const cn_camera was = g->cameras[camera];
    cn_lens_view lens = cn_lens_unpack(&was);
    double sum = 0;
    lens.fx = lens.fy = focal;
    cn_lens_pack(&lens, &g->cameras[camera]);
    *n = 0;
    for (uint32_t i = 0; i < g->n_pairs; i++) {
        const cn_graph_pair *pair = &g->pairs[i];
        double e[9];
        if (!pair->used || pair->is_essential || g->views[pair->a].camera != camera ||
            g->views[pair->b].camera != camera)
            continue;
        essential_of(g, pair, e);
        const double off = imbalance(e) / IMBALANCE;
        sum += off * off / (1.0 + off * off);
        ++*n;
    }
    g->cameras[camera] = was;
    return *n ? sum / *n : 1;
}

/* False: no focal length makes the pairs agree. */
static bool calibrate(cn_view_graph *g, uint32_t camera)
{
    const double side = fmax(g->cameras[camera].width, g->cameras[camera].height);
    double best = 0, least = 1, ratio = 1.1;
    uint32_t n = 0;
    for (int k = 0; k < FOCAL_STEPS; k++) {
        const double focal = LEAST_FOCAL * side * pow(ratio, k), cost = cost_of(g, camera, focal, &n);
        if (cost >= least) continue;
        least = cost;
        best = focal;
    }
    if (n < LEAST_PAIRS) return false;
    if (fmin(cost_of(g, camera, best * ASIDE, &n), cost_of(g, camera, best / ASIDE, &n)) < least + LEAST_RISE)
        return false;
    while (ratio > 1.0001) {
        const double up = cost_of(g, camera, best * ratio, &n), down = cost_of(g, camera, best / ratio, &n);
        if (up < least || down < least) {
            best *= up < down ? ratio : 1 / ratio;
            least = fmin(up, down);
        } else {
            ratio = sqrt(ratio);
        }
    }
    cn_lens_view lens = cn_lens_unpack(&g->cameras[camera]);
    lens.fx = lens.fy = best;
    cn_lens_pack(&lens, &g->cameras[camera]);
    return true;
}

bool cn_graph_calibrate(cn_view_graph *graph)
{
    for (uint32_t i = 0; i < graph->n_cameras; i++)
        if (!graph->knows_focal[i] && !calibrate(graph, i)) return false;
    return true;
}

static cn_status find_rays(const cn_view_graph *g, cn_graph_view *view)
{
    free(view->rays);
    view->rays = calloc(view->n + (size_t)1, sizeof *view->rays);
    if (!view->rays) return cn_fail(CN_ERR_NOMEM, "out of memory for the features of %s", view->name);
    for (uint32_t k = 0; k < view->n; k++) {
        double ray[3];
        if (cn_camera_unproject(&g->cameras[view->camera], view->xy[k][0], view->xy[k][1], ray) != CN_OK) continue;
        for (int c = 0; c < 3; c++)
            view->rays[k][c] = (float)ray[c];
    }
    return CN_OK;
}

cn_status cn_graph_relate(const cn_context *ctx, cn_view_graph *graph)
{
    for (uint32_t i = 0; i < graph->n_views; i++)
        CN_TRY(find_rays(graph, &graph->views[i]));
    cn_pool_run(ctx ? ctx->pool : NULL, graph->n_pairs, relate, graph);
    return CN_OK;
}
