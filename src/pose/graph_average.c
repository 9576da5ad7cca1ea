/* Averages the relative rotations of pairs. */
#include "base/disjoint.h"
#include "math/linalg.h"
#include "pose/view_graph.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    BY_ABSOLUTE = 15, /* rounds with weights of 1 / error, then with weights that leave outliers out */
    BY_SQUARES = 25,
    MOST_STEPS = 400 /* of conjugate gradients */
};
#define LEAST_ERROR 1e-4                     /* radians, below which errors weigh the same */
#define SCALE (5.0 * 3.14159265358979 / 180) /* of Geman and McClure's loss: GLOMAP's 5 degrees */
#define FAR (10.0 * 3.14159265358979 / 180)  /* a pair this far from the average is wrong; GLOMAP's, too */

typedef struct averager {
    cn_view_graph *graph;
    double *weight;    /* of each pair */
    double (*turn)[3]; /* of each pair: what its views lack */
    double *buffer;    /* eight vectors of a view each, 3 numbers */
    uint32_t *part;    /* of each view: a view of its part, by union and find */
} averager;

/* The turn that a pair asks of its second view against its first, in the world's axes: the logarithm of
 * transpose(R_b) R_ab R_a. */
static void error_of(const cn_view_graph *g, const cn_graph_pair *pair, double turn[3])
{
    double between[9], full[9], quaternion[4], back[9];
    cn_mat3_mul(pair->rotation, g->views[pair->a].rotation, between);
    cn_mat3_transpose(g->views[pair->b].rotation, back);
    cn_mat3_mul(back, between, full);
    cn_mat3_to_quat(full, quaternion);
    const double s = cn_norm3(quaternion + 1), angle = 2.0 * atan2(s, quaternion[0]);
    for (int c = 0; c < 3; c++)
        turn[c] = s > 1e-12 ? quaternion[1 + c] * angle / s : 2.0 * quaternion[1 + c];
}

typedef struct ranked {
    uint32_t pair, n;
} ranked;

static int by_matches(const void *a, const void *b)
{
    const ranked *x = a, *y = b;
    if (x->n != y->n) return x->n < y->n ? 1 : -1;
    return (x->pair > y->pair) - (x->pair < y->pair);
}

/* Joins views that used pairs connect; the views of the largest part are placed. */
static uint32_t find_largest(averager *w)
{
    cn_view_graph *g = w->graph;
    uint32_t *count = (uint32_t *)w->buffer, best = 0, n = 0;
    for (uint32_t i = 0; i < g->n_views; i++) {
        w->part[i] = i;
        count[i] = 0;
    }
    for (uint32_t i = 0; i < g->n_pairs; i++)
        if (g->pairs[i].used) w->part[cn_root_of(w->part, g->pairs[i].a)] = cn_root_of(w->part, g->pairs[i].b);
    for (uint32_t i = 0; i < g->n_views; i++)
        count[cn_root_of(w->part, i)]++;
    for (uint32_t i = 0; i < g->n_views; i++)
        if (count[i] > count[best]) best = i;
    for (uint32_t i = 0; i < g->n_views; i++) {
        g->views[i].placed = cn_root_of(w->part, i) == best;
        n += g->views[i].placed;
    }
    for (uint32_t i = 0; i < g->n_pairs; i++)
        g->pairs[i].used = g->pairs[i].used && g->views[g->pairs[i].a].placed;
    return n;
}

/* Rotations along the spanning tree of the pairs with the most matches. tree: its pairs, found before. */
static void follow_tree(cn_view_graph *g, const uint32_t *tree, uint32_t n_tree, bool *known)
{
    static const double identity[9] = { 1, 0, 0, 0, 1, 0, 0, 0, 1 };
    memset(known, 0, g->n_views * sizeof *known);
    for (uint32_t i = 0; i < g->n_views; i++) {
        if (!g->views[i].placed) continue;
        memcpy(g->views[i].rotation, identity, sizeof identity);
        known[i] = true;
        break;
    }
    for (bool more = true; more;) {
        more = false;
        for (uint32_t k = 0; k < n_tree; k++) {
            const cn_graph_pair *pair = &g->pairs[tree[k]];
            double back[9];
            if (known[pair->a] == known[pair->b]) continue;
            more = true;
            if (known[pair->a]) {
                cn_mat3_mul(pair->rotation, g->views[pair->a].rotation, g->views[pair->b].rotation);
            } else {
                cn_mat3_transpose(pair->rotation, back);
                cn_mat3_mul(back, g->views[pair->b].rotation, g->views[pair->a].rotation);
            }
            known[pair->a] = known[pair->b] = true;
        }
    }
}

static cn_status begin_from_tree(averager *w)
{
    cn_view_graph *g = w->graph;
    ranked *order = malloc((g->n_pairs + (size_t)1) * sizeof *order);
    uint32_t *tree = malloc((g->n_views + (size_t)1) * sizeof *tree), n = 0, n_tree = 0;
    bool *known = malloc(g->n_views + (size_t)1);
    const bool room = order && tree && known;
    for (uint32_t i = 0; i < g->n_pairs && room; i++)
        if (g->pairs[i].used) order[n++] = (ranked){ i, g->pairs[i].n };
    if (room) qsort(order, n, sizeof *order, by_matches);
    for (uint32_t i = 0; i < g->n_views && room; i++)
        w->part[i] = i;
    for (uint32_t k = 0; k < n && room; k++) {
        const uint32_t a = cn_root_of(w->part, g->pairs[order[k].pair].a),
                       b = cn_root_of(w->part, g->pairs[order[k].pair].b);
        if (a == b) continue;
        w->part[a] = b;
        tree[n_tree++] = order[k].pair;
    }
    if (room) follow_tree(g, tree, n_tree, known);
    free(order);
    free(tree);
    free(known);
    return room ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for %u pairs of photos", g->n_pairs);
}

/* out = (sum over pairs of weight * (x_b - x_a), with the sign of each end), and a hold on the first view. */
static void apply(const averager *w, const double *x, double *out)
{
    const cn_view_graph *g = w->graph;
    memset(out, 0, 3 * (size_t)g->n_views * sizeof *out);
    for (uint32_t i = 0; i < g->n_pairs; i++) {
        const uint32_t a = 3 * g->pairs[i].a, b = 3 * g->pairs[i].b;
        if (!g->pairs[i].used) continue;
        for (uint32_t c = 0; c < 3; c++) {
            const double pull = w->weight[i] * (x[b + c] - x[a + c]);
            out[b + c] += pull;
            out[a + c] -= pull;
        }
    }
}

static double dot(const double *a, const double *b, size_t n)
{
    double sum = 0;
    for (size_t i = 0; i < n; i++)
        sum += a[i] * b[i];
    return sum;
}

/* x: turns of all views that the pairs ask for, by conjugate gradients with the diagonal as preconditioner. All turns
 * alike change nothing, so the matrix is singular; a right side that sums to 0 keeps the steps out of that. */
static void solve(const averager *w, double *x)
{
    const cn_view_graph *g = w->graph;
    const size_t n = 3 * (size_t)g->n_views;
    double *r = x + n, *z = r + n, *p = z + n, *q = p + n, *diagonal = q + n;
    memset(x, 0, 6 * n * sizeof *x);
    for (uint32_t i = 0; i < g->n_pairs; i++) {
        if (!g->pairs[i].used) continue;
        for (uint32_t c = 0; c < 3; c++) {
            const size_t a = 3 * (size_t)g->pairs[i].a + c, b = 3 * (size_t)g->pairs[i].b + c;
            r[b] += w->weight[i] * w->turn[i][c];
            r[a] -= w->weight[i] * w->turn[i][c];
            diagonal[a] += w->weight[i];
            diagonal[b] += w->weight[i];
        }
    }
    for (size_t i = 0; i < n; i++)
        p[i] = z[i] = diagonal[i] > 0 ? r[i] / diagonal[i] : 0;
    double rz = dot(r, z, n);
    const double enough = 1e-20 * rz;
    for (int step = 0; step < MOST_STEPS && rz > enough; step++) {
        apply(w, p, q);
        const double pq = dot(p, q, n);
        if (!(pq > 0)) break;
        for (size_t i = 0; i < n; i++) {
            x[i] += rz / pq * p[i];
            r[i] -= rz / pq * q[i];
            z[i] = diagonal[i] > 0 ? r[i] / diagonal[i] : 0;
        }
        const double before = rz;
        rz = dot(r, z, n);
        for (size_t i = 0; i < n; i++)
            p[i] = z[i] + rz / before * p[i];
    }
}

/* R_i becomes R_i * exp(x_i). */
static void turn_views(cn_view_graph *g, const double *x)
{
    for (uint32_t i = 0; i < g->n_views; i++) {
        double by[9], before[9];
        if (!g->views[i].placed) continue;
        cn_turn_to_mat3(x + 3 * (size_t)i, by);
        memcpy(before, g->views[i].rotation, sizeof before);
        cn_mat3_mul(before, by, g->views[i].rotation);
    }
}

static void average(averager *w)
{
    cn_view_graph *g = w->graph;
    for (int round = 0; round < BY_ABSOLUTE + BY_SQUARES; round++) {
        for (uint32_t i = 0; i < g->n_pairs; i++) {
            if (!g->pairs[i].used) continue;
            error_of(g, &g->pairs[i], w->turn[i]);
            const double error = cn_norm3(w->turn[i]), s = error * error + SCALE * SCALE;
            w->weight[i] = round < BY_ABSOLUTE ? 1.0 / fmax(error, LEAST_ERROR) : SCALE * SCALE / (s * s);
        }
        solve(w, w->buffer);
        turn_views(g, w->buffer);
    }
}

static void drop_far_pairs(cn_view_graph *g)
{
    for (uint32_t i = 0; i < g->n_pairs; i++) {
        double turn[3];
        if (!g->pairs[i].used) continue;
        error_of(g, &g->pairs[i], turn);
        g->pairs[i].used = cn_norm3(turn) <= FAR;
    }
}

cn_status cn_graph_average(cn_view_graph *graph, uint32_t *n_placed)
{
    averager w = { .graph = graph,
                   .weight = calloc(graph->n_pairs + (size_t)1, sizeof *w.weight),
                   .turn = calloc(graph->n_pairs + (size_t)1, sizeof *w.turn),
                   .buffer = malloc((18 * (size_t)graph->n_views + 1) * sizeof *w.buffer),
                   .part = malloc((graph->n_views + (size_t)1) * sizeof *w.part) };
    cn_status status = w.weight && w.turn && w.buffer && w.part
                           ? CN_OK
                           : cn_fail(CN_ERR_NOMEM, "out of memory for %u photos", graph->n_views);
    *n_placed = 0;
    if (status == CN_OK) {
        (void)find_largest(&w);
        status = begin_from_tree(&w);
    }
    if (status == CN_OK) {
        average(&w);
        drop_far_pairs(graph);
        *n_placed = find_largest(&w);
    }
    free(w.weight);
    free(w.turn);
    free(w.buffer);
    free(w.part);
    return status;
}
