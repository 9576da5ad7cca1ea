/* RANSAC (Fischler and Bolles 1981, scored as MSAC) around the closed form of Horn 1987 with Umeyama's scale (1991). */
#include "pose/similarity.h"

#include "base/rng.h"
#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MAX_TRIALS 1000
#define MAX_REFITS 20

void cn_similarity_apply(const cn_similarity *s, const double in[3], double out[3])
{
    double turned[3];
    cn_mat3_vec(s->rotation, in, turned);
    for (int k = 0; k < 3; k++)
        out[k] = s->scale * turned[k] + s->translation[k];
}

static uint32_t mean(uint32_t n, const double (*points)[3], const bool *use, double out[3])
{
    uint32_t count = 0;
    out[0] = out[1] = out[2] = 0.0;
    for (uint32_t i = 0; i < n; i++) {
        if (use && !use[i]) continue;
        for (int k = 0; k < 3; k++)
            out[k] += points[i][k];
        count++;
    }
    for (int k = 0; k < 3 && count; k++)
        out[k] /= count;
    return count;
}

void cn_spread(uint32_t n, const double (*points)[3], const bool *use, double deviation[3], double axes[9])
{
    double centre[3], covariance[9] = { 0 }, vectors[9];
    uint32_t count = mean(n, points, use, centre);
    for (uint32_t i = 0; i < n; i++)
        for (int a = 0; a < 9 && (!use || use[i]); a++)
            covariance[a] += (points[i][a / 3] - centre[a / 3]) * (points[i][a % 3] - centre[a % 3]);
    cn_eigen_symmetric(3, covariance, deviation, axes ? axes : vectors);
    for (int k = 0; k < 3; k++)
        deviation[k] = count ? sqrt(fmax(deviation[k], 0.0) / count) : 0.0;
}

/* Checks that both sets span at least a plane: the second axis is not rounding noise of the first. */
static bool spans_plane(uint32_t n, const double (*points)[3], const bool *use)
{
    double deviation[3];
    cn_spread(n, points, use, deviation, NULL);
    return deviation[2] > 0.0 && deviation[1] > 1e-5 * deviation[2];
}

/* Horn's 4 x 4 matrix; its greatest eigenvector is the rotation. */
static void horn(const double m[9], double rotation[9])
{
    const double a[16] = {
        m[0] + m[4] + m[8], m[5] - m[7], m[6] - m[2], m[1] - m[3],         m[5] - m[7],         m[0] - m[4] - m[8],
        m[1] + m[3],        m[6] + m[2], m[6] - m[2], m[1] + m[3],         -m[0] + m[4] - m[8], m[5] + m[7],
        m[1] - m[3],        m[6] + m[2], m[5] + m[7], -m[0] - m[4] + m[8],
    };
    double values[4], vectors[16];
    cn_eigen_symmetric(4, a, values, vectors);
    const double quaternion[4] = { vectors[3], vectors[7], vectors[11], vectors[15] };
    cn_quat_to_mat3(quaternion, rotation);
}

static void place(cn_similarity *out, const double source[3], const double target[3])
{
    double turned[3];
    cn_mat3_vec(out->rotation, source, turned);
    for (int k = 0; k < 3; k++)
        out->translation[k] = target[k] - out->scale * turned[k];
}

/* Least-squares fit to the pairs in use. */
static bool fit_plain(const cn_similarity_task *task, const bool *use, const void *unused, cn_similarity *out)
{
    double from[3], to[3], cross[9] = { 0 }, square = 0.0, along = 0.0;
    (void)unused;
    if (mean(task->n, task->source, use, from) < 3) return false;
    mean(task->n, task->target, use, to);
    if (!spans_plane(task->n, task->source, use) || !spans_plane(task->n, task->target, use)) return false;
    for (uint32_t i = 0; i < task->n; i++) {
        if (use && !use[i]) continue;
        for (int a = 0; a < 9; a++)
            cross[a] += (task->source[i][a / 3] - from[a / 3]) * (task->target[i][a % 3] - to[a % 3]);
        for (int k = 0; k < 3; k++)
            square += (task->source[i][k] - from[k]) * (task->source[i][k] - from[k]);
    }
    horn(cross, out->rotation);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            along += out->rotation[3 * i + j] * cross[3 * j + i];
    out->scale = along / square;
    place(out, from, to);
    return out->scale > 0.0 && isfinite(out->scale);
}

/* Right-handed axes with x along `line` and z as near `up` as that allows; columns. */
static bool axes_of(const double line[3], const double up[3], double m[9])
{
    double x[3] = { line[0], line[1], line[2] }, z[3], y[3];
    if (!cn_normalize3(x)) return false;
    double along = cn_dot3(up, x);
    for (int k = 0; k < 3; k++)
        z[k] = up[k] - along * x[k];
    if (cn_norm3(z) < 0.1 || !cn_normalize3(z)) return false;
    cn_cross3(z, x, y);
    for (int k = 0; k < 3; k++) {
        m[3 * k] = x[k];
        m[3 * k + 1] = y[k];
        m[3 * k + 2] = z[k];
    }
    return true;
}

/* Aligns the principal axes of both sets; `up` gives the rotation about them. */
static bool fit_line(const cn_similarity_task *task, const bool *use, const void *up, cn_similarity *out)
{
    static const double Z[3] = { 0.0, 0.0, 1.0 };
    double from[3], to[3], deviation[3], axes[9], line_s[3], line_t[3], m_s[9], m_t[9], inverse[9];
    if (mean(task->n, task->source, use, from) < 2) return false;
    mean(task->n, task->target, use, to);
    cn_spread(task->n, task->source, use, deviation, axes);
    for (int k = 0; k < 3; k++)
        line_s[k] = axes[3 * k + 2];
    cn_spread(task->n, task->target, use, deviation, axes);
    for (int k = 0; k < 3; k++)
        line_t[k] = axes[3 * k + 2];
    double along = 0.0, square = 0.0;
    for (uint32_t i = 0; i < task->n; i++) {
        if (use && !use[i]) continue;
        double a = 0.0, b = 0.0;
        for (int k = 0; k < 3; k++) {
            a += (task->source[i][k] - from[k]) * line_s[k];
            b += (task->target[i][k] - to[k]) * line_t[k];
        }
        along += a * b;
        square += a * a;
    }
    for (int k = 0; k < 3 && along < 0.0; k++)
        line_t[k] = -line_t[k];
    if (!axes_of(line_s, up, m_s) || !axes_of(line_t, Z, m_t)) return false;
    cn_mat3_transpose(m_s, inverse);
    cn_mat3_mul(m_t, inverse, out->rotation);
    out->scale = fabs(along) / square;
    place(out, from, to);
    return out->scale > 0.0 && isfinite(out->scale);
}

bool cn_similarity_level(const double up[3], double rotation[9])
{
    double x[3] = { 0 }, y[3];
    x[fabs(up[0]) > 0.9] = 1.0;
    cn_cross3(up, x, y);
    if (!cn_normalize3(y)) return false;
    cn_cross3(y, up, x);
    memcpy(rotation, x, sizeof x);
    memcpy(rotation + 3, y, sizeof y);
    memcpy(rotation + 6, up, 3 * sizeof *up);
    return true;
}

/* `up` becomes z; the rest is a similarity of the plane, in closed form. */
static bool fit_upright(const cn_similarity_task *task, const bool *use, const void *up, cn_similarity *out)
{
    double from[3], to[3], level[9], a = 0.0, b = 0.0, square = 0.0;
    if (mean(task->n, task->source, use, from) < 2) return false;
    mean(task->n, task->target, use, to);
    if (!cn_similarity_level(up, level)) return false;
    for (uint32_t i = 0; i < task->n; i++) {
        if (use && !use[i]) continue;
        double offset[3], p[3], q[2];
        for (int k = 0; k < 3; k++)
            offset[k] = task->source[i][k] - from[k];
        cn_mat3_vec(level, offset, p);
        for (int k = 0; k < 2; k++)
            q[k] = task->target[i][k] - to[k];
        a += p[0] * q[0] + p[1] * q[1];
        b += p[0] * q[1] - p[1] * q[0];
        square += p[0] * p[0] + p[1] * p[1];
    }
    const double length = hypot(a, b);
    if (!(square > 0) || !(length > 0)) return false;
    const double about[9] = { a / length, -b / length, 0, b / length, a / length, 0, 0, 0, 1 };
    cn_mat3_mul(about, level, out->rotation);
    out->scale = length / square;
    place(out, from, to);
    return isfinite(out->scale);
}

/* A way to fit a similarity to the pairs that are marked. */
typedef struct model {
    bool (*fit)(const cn_similarity_task *task, const bool *use, const void *extra, cn_similarity *out);
    const void *extra;
    uint32_t size; /* pairs that it needs */
} model;

static bool has_height(const cn_similarity_task *task, uint32_t i)
{
    return !task->has_height || task->has_height[i];
}

/* Marks inliers; returns the sum of squared errors, each clamped at the threshold. */
static double score(const cn_similarity_task *task, const cn_similarity *s, bool *inlier)
{
    double sum = 0.0, limit = task->max_error_m * task->max_error_m;
    for (uint32_t i = 0; i < task->n; i++) {
        double at[3];
        cn_similarity_apply(s, task->source[i], at);
        double dx = at[0] - task->target[i][0], dy = at[1] - task->target[i][1];
        double dz = has_height(task, i) ? task->vertical_weight * (at[2] - task->target[i][2]) : 0.0;
        double square = dx * dx + dy * dy + dz * dz;
        inlier[i] = square <= limit;
        sum += inlier[i] ? square : limit;
    }
    return sum;
}

uint32_t cn_similarity_count(const bool *inlier, uint32_t n)
{
    uint32_t sum = 0;
    for (uint32_t i = 0; i < n; i++)
        sum += inlier[i];
    return sum;
}

/* Hypotheses are made by pairs with a height alone. */
static void choose_all(const cn_similarity_task *task, bool *chosen)
{
    for (uint32_t i = 0; i < task->n; i++)
        chosen[i] = has_height(task, i);
}

static void draw(const cn_similarity_task *task, uint64_t trial, uint32_t size, bool *chosen)
{
    memset(chosen, false, task->n);
    for (uint64_t i = 0, taken = 0; taken < size; i++) {
        uint32_t pick = cn_rng_below(task->seed, trial, i, task->n);
        if (!has_height(task, pick)) continue;
        taken += !chosen[pick];
        chosen[pick] = true;
    }
}

/* Room for n pairs. target: a copy, in which heights that are not known are those of the fit. */
typedef struct workspace {
    bool *inlier, *trial_inlier;
    double (*target)[3];
} workspace;

/* Fits to the inliers as long as the error becomes less. A pair without height counts by its place: its height is that
 * which the last fit gives it. */
static void refit(const cn_similarity_task *task, const model *m, double least, const workspace *room,
                  cn_similarity *best)
{
    cn_similarity_task filled = *task;
    cn_similarity s;
    if (task->has_height) filled.target = (const double(*)[3])room->target;
    for (int k = 0; k < MAX_REFITS; k++) {
        for (uint32_t i = 0; i < task->n && task->has_height; i++) {
            double at[3];
            if (task->has_height[i]) continue;
            cn_similarity_apply(best, task->source[i], at);
            room->target[i][2] = at[2];
        }
        if (!m->fit(&filled, room->inlier, m->extra, &s)) break;
        const double sum = score(task, &s, room->trial_inlier);
        if (!(sum < least)) break;
        least = sum;
        *best = s;
        memcpy(room->inlier, room->trial_inlier, task->n);
    }
}

/* Of the pairs that hypotheses are made by. */
static double share_of_inliers(const cn_similarity_task *task, const bool *inlier)
{
    uint32_t n = 0, n_inliers = 0;
    for (uint32_t i = 0; i < task->n; i++) {
        n += has_height(task, i);
        n_inliers += has_height(task, i) && inlier[i];
    }
    return n ? (double)n_inliers / n : 0;
}

/* The first hypothesis is all pairs, so clean data always works. */
static cn_status ransac(const cn_similarity_task *task, const model *m, const workspace *room, cn_similarity *best)
{
    double least = INFINITY, needed = MAX_TRIALS;
    bool *inlier = room->inlier, *trial_inlier = room->trial_inlier;
    cn_similarity s;
    for (uint32_t trial = 0; trial <= MAX_TRIALS && trial <= needed; trial++) {
        if (trial)
            draw(task, trial, m->size, trial_inlier);
        else
            choose_all(task, trial_inlier);
        if (!m->fit(task, trial_inlier, m->extra, &s)) continue;
        double sum = score(task, &s, trial_inlier);
        if (!(sum < least)) continue;
        least = sum;
        *best = s;
        memcpy(inlier, trial_inlier, task->n);
        double share = pow(share_of_inliers(task, inlier), m->size);
        needed = share >= 1.0 ? 0.0 : log(1e-6) / log1p(-share);
    }
    if (!isfinite(least)) return cn_fail(CN_ERR_DATA, "the points lie on a line or at one place");
    refit(task, m, least, room, best);
    return CN_OK;
}

static cn_status fit_robust(const cn_similarity_task *task, const model *m, cn_similarity *out, bool *inlier)
{
    for (uint32_t i = 0; i < task->n; i++)
        for (int k = 0; k < 3; k++)
            if (!isfinite(task->source[i][k]) || !isfinite(task->target[i][k]))
                return cn_fail(CN_ERR_DATA, "point pair %u is not finite", i);
    if (task->has_height && cn_similarity_count(task->has_height, task->n) < m->size)
        return cn_fail(CN_ERR_DATA, "fewer than %u of %u points have a height", m->size, task->n);
    const size_t n = task->n + (size_t)1;
    const workspace room = { calloc(n, sizeof(bool)), calloc(n, sizeof(bool)), malloc(n * sizeof *room.target) };
    const bool good = room.inlier && room.trial_inlier && room.target;
    if (good) memcpy(room.target, task->target, task->n * sizeof *room.target);
    cn_status status =
        good ? ransac(task, m, &room, out) : cn_fail(CN_ERR_NOMEM, "out of memory aligning %u points", task->n);
    if (status == CN_OK && cn_similarity_count(room.inlier, task->n) < m->size)
        status = cn_fail(CN_ERR_DATA, "no %u of %u points agree within %g m", m->size, task->n, task->max_error_m);
    if (status == CN_OK && inlier) memcpy(inlier, room.inlier, task->n);
    free(room.inlier);
    free(room.trial_inlier);
    free(room.target);
    return status;
}

cn_status cn_pose_fit_similarity(const cn_similarity_task *task, cn_similarity *out, bool *inlier)
{
    if (task->n < 3) return cn_fail(CN_ERR_DATA, "%u point pairs, but a similarity needs 3", task->n);
    return fit_robust(task, &(model){ fit_plain, NULL, 3 }, out, inlier);
}

cn_status cn_similarity_fit_line(const cn_similarity_task *task, const double up[3], cn_similarity *out, bool *inlier)
{
    if (task->n < 2) return cn_fail(CN_ERR_DATA, "%u point pairs, but a line needs 2", task->n);
    return fit_robust(task, &(model){ fit_line, up, 2 }, out, inlier);
}

cn_status cn_similarity_fit_upright(const cn_similarity_task *task, const double up[3], cn_similarity *out,
                                    bool *inlier)
{
    if (task->n < 2) return cn_fail(CN_ERR_DATA, "%u point pairs, but 2 are needed", task->n);
    return fit_robust(task, &(model){ fit_upright, up, 2 }, out, inlier);
}
