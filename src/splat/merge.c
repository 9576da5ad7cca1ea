#include "splat/merge.h"

#include "base/keys.h"
#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { HALVINGS = 12 };
#define FINEST_M 1e-4   /* the smallest cube; from here the halvings find the side of 100 m to 0.4 % */
#define MOST_GROWTH 2.0 /* beyond it neighbours blur each other more than they close gaps */
#define MAX_OPACITY 0.99

typedef struct cluster {
    double weight; /* sum of opacity times area */
    double mean[3], cov[9];
} cluster;

typedef struct merger {
    const cn_splats *s;
    const uint32_t *which;
    size_t n, most;
    double low[3]; /* the lattice begins here */
    cn_keys cells; /* cube to cluster */
    cluster *clusters;
    uint32_t *cluster_of; /* [n] */
} merger;

static uint64_t cell_of(const merger *m, size_t i, double cell_m)
{
    int64_t at[3];
    for (int k = 0; k < 3; k++)
        at[k] = (int64_t)floor(((double)m->s->centre[m->which[i]][k] - m->low[k]) / cell_m);
    return cn_keys_of_cube(1, at);
}

/* Numbers the cubes that hold something. *fits: there are at most `most`. */
static cn_status fill_cells(merger *m, double cell_m, bool *fits)
{
    bool fresh;
    cn_keys_deinit(&m->cells);
    *fits = true;
    for (size_t i = 0; i < m->n && *fits; i++) {
        const uint64_t key = cell_of(m, i, cell_m);
        CN_TRY(cn_keys_add(&m->cells, key, (uint32_t)m->cells.n, &fresh));
        m->cluster_of[i] = cn_keys_find(&m->cells, key);
        *fits = m->cells.n <= m->most;
    }
    return CN_OK;
}

/* The smallest cubes of which there are few enough. */
static cn_status choose_cells(merger *m, double *cell_m)
{
    double whole = FINEST_M; /* a cube that holds all */
    for (int k = 0; k < 3; k++) {
        double high = m->low[k] = (double)m->s->centre[m->which[0]][k];
        for (size_t i = 1; i < m->n; i++) {
            const double at = (double)m->s->centre[m->which[i]][k];
            m->low[k] = fmin(m->low[k], at);
            high = fmax(high, at);
        }
        whole = fmax(whole, 1.001 * (high - m->low[k]));
    }
    double small = log(FINEST_M), large = log(whole);
    bool fits;
    for (int h = 0; h < HALVINGS; h++) {
        const double middle = (small + large) / 2;
        CN_TRY(fill_cells(m, exp(middle), &fits));
        *(fits ? &large : &small) = middle;
    }
    *cell_m = exp(large);
    return fill_cells(m, *cell_m, &fits);
}

/* The product of the two largest deviations. */
static double area_of(const float scale[3])
{
    const double a = (double)scale[0], b = (double)scale[1], c = (double)scale[2];
    return fmax(fmax(a * b, b * c), a * c);
}

static double weight_of(const cn_splats *s, uint32_t i)
{
    return fmax((double)s->opacity[i] * area_of(s->scale[i]), 1e-20);
}

static void add_covariance(const cn_splats *s, uint32_t i, cluster *c)
{
    const float *q = s->rotation[i];
    const double weight = weight_of(s, i), quat[4] = { (double)q[0], (double)q[1], (double)q[2], (double)q[3] };
    double axes[9], away[3];
    cn_quat_to_mat3(quat, axes);
    for (int k = 0; k < 3; k++)
        away[k] = (double)s->centre[i][k] - c->mean[k];
    for (int r = 0; r < 3; r++)
        for (int k = 0; k < 3; k++) {
            double sum = away[r] * away[k];
            for (int a = 0; a < 3; a++)
                sum += axes[3 * r + a] * axes[3 * k + a] * (double)s->scale[i][a] * (double)s->scale[i][a];
            c->cov[3 * r + k] += weight / c->weight * sum;
        }
}

static void add_colour(const merger *m, size_t i, cn_splats *out)
{
    const size_t row = (size_t)(out->degree + 1) * (out->degree + 1) * 3;
    const uint32_t from = m->which[i], to = m->cluster_of[i];
    const float part = (float)(weight_of(m->s, from) / m->clusters[to].weight);
    for (size_t k = 0; k < row; k++)
        out->colour[to * row + k] += part * m->s->colour[from * row + k];
}

/* From the moments to a Gaussian. */
static void shape(const cluster *c, cn_splats *out, size_t u)
{
    double values[3], axes[9], quat[4], z[3];
    cn_eigen_symmetric(3, c->cov, values, axes);
    const double x[3] = { axes[0], axes[3], axes[6] }, y[3] = { axes[1], axes[4], axes[7] };
    cn_cross3(x, y, z);
    for (int r = 0; r < 3; r++) /* right-handed */
        axes[3 * r + 2] = z[r];
    cn_mat3_to_quat(axes, quat);
    for (int k = 0; k < 3; k++)
        out->scale[u][k] = (float)sqrt(fmax(values[k], 1e-12));
    const double cover = c->weight / area_of(out->scale[u]);
    out->opacity[u] = (float)fmin(cover, MAX_OPACITY);
    const double grow = fmin(sqrt(fmax(cover, 1)), MOST_GROWTH);
    for (int k = 1; k < 3; k++) /* ascending: the first is the thickness */
        out->scale[u][k] *= (float)grow;
    for (int k = 0; k < 3; k++)
        out->centre[u][k] = (float)c->mean[k];
    for (int k = 0; k < 4; k++)
        out->rotation[u][k] = (float)quat[k];
}

static cn_status merge(merger *m, cn_splats **out, double *cell_m)
{
    CN_TRY(choose_cells(m, cell_m));
    const size_t n = m->cells.n;
    m->clusters = calloc(n, sizeof *m->clusters);
    if (!m->clusters) return cn_fail(CN_ERR_NOMEM, "out of memory for %zu splats", n);
    CN_TRY(cn_splats_create(out, n, m->s->degree));
    memcpy((*out)->origin, m->s->origin, sizeof m->s->origin);
    for (size_t i = 0; i < m->n; i++) {
        cluster *c = &m->clusters[m->cluster_of[i]];
        const double weight = weight_of(m->s, m->which[i]);
        c->weight += weight;
        for (int k = 0; k < 3; k++)
            c->mean[k] += weight * (double)m->s->centre[m->which[i]][k];
    }
    for (size_t u = 0; u < n; u++)
        for (int k = 0; k < 3; k++)
            m->clusters[u].mean[k] /= m->clusters[u].weight;
    for (size_t i = 0; i < m->n; i++) {
        add_covariance(m->s, m->which[i], &m->clusters[m->cluster_of[i]]);
        add_colour(m, i, *out);
    }
    for (size_t u = 0; u < n; u++)
        shape(&m->clusters[u], *out, u);
    return CN_OK;
}

cn_status cn_splats_merge(const cn_splats *splats, const uint32_t *which, size_t n, size_t most, cn_splats **out,
                          double *cell_m)
{
    merger m = { .s = splats, .which = which, .n = n, .most = most };
    *out = NULL;
    m.cluster_of = malloc(n * sizeof *m.cluster_of);
    cn_status status = m.cluster_of ? merge(&m, out, cell_m) : cn_fail(CN_ERR_NOMEM, "out of memory for %zu splats", n);
    if (status != CN_OK) cn_splats_destroy(out);
    cn_keys_deinit(&m.cells);
    free(m.clusters);
    free(m.cluster_of);
    return status;
}
