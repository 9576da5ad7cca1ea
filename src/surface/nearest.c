#include "surface/nearest.h"

#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { LEAF = 4 };

/* Node i has children 2 i + 1 and 2 i + 2; it holds order[first] .. order[last - 1]. */
struct cn_nearest_node {
    float low[3], high[3];
    uint32_t first, last;
};

static const float *corner_of(const cn_triangle_list *list, uint32_t i, int k)
{
    return list->places[list->n_triangles ? list->corners[i][k] : i];
}

static float middle(const cn_triangle_list *list, uint32_t i, int axis)
{
    return corner_of(list, i, 0)[axis] + corner_of(list, i, 1)[axis] + corner_of(list, i, 2)[axis];
}

static void measure(const cn_nearest *t, cn_nearest_node *node)
{
    for (int a = 0; a < 3; a++) {
        node->low[a] = INFINITY;
        node->high[a] = -INFINITY;
    }
    for (uint32_t i = node->first; i < node->last; i++)
        for (int k = 0; k < 3; k++) {
            const float *p = corner_of(t->list, t->order[i], k);
            for (int a = 0; a < 3; a++) {
                node->low[a] = fminf(node->low[a], p[a]);
                node->high[a] = fmaxf(node->high[a], p[a]);
            }
        }
}

/* Puts the `half` smallest along the axis first (quickselect). */
static void split(const cn_nearest *t, uint32_t first, uint32_t last, uint32_t half, int axis)
{
    while (last - first > 1) {
        const float pivot = middle(t->list, t->order[first + (last - first) / 2], axis);
        uint32_t i = first, j = last - 1;
        for (;;) {
            while (middle(t->list, t->order[i], axis) < pivot)
                i++;
            while (middle(t->list, t->order[j], axis) > pivot)
                j--;
            if (i >= j) break;
            const uint32_t swapped = t->order[i];
            t->order[i++] = t->order[j];
            t->order[j--] = swapped;
        }
        if (half <= j && i > j)
            last = j + 1;
        else if (half >= i && i > j)
            first = i;
        else if (half < j)
            last = j;
        else if (half > j && i == j)
            first = j + 1;
        else
            return; /* it is the pivot, or as large */
    }
}

static void build(cn_nearest *t, size_t at, uint32_t first, uint32_t last)
{
    cn_nearest_node *node = &t->nodes[at];
    *node = (cn_nearest_node){ .first = first, .last = last };
    measure(t, node);
    if (last - first <= LEAF) return;
    int axis = 0;
    for (int a = 1; a < 3; a++)
        if (node->high[a] - node->low[a] > node->high[axis] - node->low[axis]) axis = a;
    const uint32_t half = first + (last - first) / 2;
    split(t, first, last, half, axis);
    build(t, 2 * at + 1, first, half);
    build(t, 2 * at + 2, half, last);
}

cn_status cn_nearest_init(cn_nearest *t, const cn_triangle_list *list)
{
    *t = (cn_nearest){ .list = list, .n = list->n_triangles ? list->n_triangles : list->n_places };
    size_t room = 1;
    for (uint64_t n = t->n; n > LEAF; n = n - n / 2)
        room = 2 * room + 1;
    t->order = malloc(t->n * sizeof *t->order);
    t->nodes = calloc(room, sizeof *t->nodes);
    if (!t->order || !t->nodes) {
        cn_nearest_deinit(t);
        return cn_fail(CN_ERR_NOMEM, "out of memory for a tree of %u triangles", list->n_triangles);
    }
    for (uint32_t i = 0; i < t->n; i++)
        t->order[i] = i;
    build(t, 0, 0, t->n);
    return CN_OK;
}

void cn_nearest_deinit(cn_nearest *t)
{
    free(t->order);
    free(t->nodes);
    *t = (cn_nearest){ 0 };
}

/* ---- distances, squared ---- */

static double to_box(const cn_nearest_node *node, const double p[3])
{
    double sum = 0;
    for (int a = 0; a < 3; a++) {
        const double off = fmax(fmax((double)node->low[a] - p[a], p[a] - (double)node->high[a]), 0);
        sum += off * off;
    }
    return sum;
}

/* To the segment from the origin to `way`. */
static double to_segment(const double p[3], const double way[3])
{
    const double length = cn_dot3(way, way);
    const double part = length > 0 ? fmin(fmax(cn_dot3(p, way) / length, 0), 1) : 0;
    double sum = 0;
    for (int k = 0; k < 3; k++)
        sum += (p[k] - part * way[k]) * (p[k] - part * way[k]);
    return sum;
}

/* The foot of the perpendicular when it lies in the triangle, else the nearest of the three sides. */
static double to_triangle(const cn_triangle_list *list, uint32_t i, const double p[3])
{
    double u[3], v[3], w[3], from[3], from_b[3], n[3], c[3];
    for (int k = 0; k < 3; k++) {
        const double a = (double)corner_of(list, i, 0)[k], b = (double)corner_of(list, i, 1)[k];
        u[k] = b - a;
        v[k] = (double)corner_of(list, i, 2)[k] - a;
        w[k] = v[k] - u[k];
        from[k] = p[k] - a;
        from_b[k] = p[k] - b;
    }
    cn_cross3(u, v, n);
    const double area = cn_dot3(n, n);
    if (area > 0) {
        cn_cross3(from, v, c);
        const double s = cn_dot3(c, n) / area;
        cn_cross3(u, from, c);
        const double t = cn_dot3(c, n) / area;
        if (s >= 0 && t >= 0 && s + t <= 1) return cn_dot3(from, n) * cn_dot3(from, n) / area;
    }
    return fmin(to_segment(from, u), fmin(to_segment(from, v), to_segment(from_b, w)));
}

static void search(const cn_nearest *t, size_t at, const double p[3], double *best)
{
    const cn_nearest_node *node = &t->nodes[at];
    if (node->last - node->first <= LEAF) {
        for (uint32_t i = node->first; i < node->last; i++)
            *best = fmin(*best, to_triangle(t->list, t->order[i], p));
        return;
    }
    const double left = to_box(&t->nodes[2 * at + 1], p), right = to_box(&t->nodes[2 * at + 2], p);
    const size_t nearer = 2 * at + (left <= right ? 1 : 2), other = 2 * at + (left <= right ? 2 : 1);
    if (fmin(left, right) < *best) search(t, nearer, p, best);
    if (fmax(left, right) < *best) search(t, other, p, best);
}

double cn_nearest_distance(const cn_nearest *t, const float place[3])
{
    const double p[3] = { (double)place[0], (double)place[1], (double)place[2] };
    double best = INFINITY;
    search(t, 0, p, &best);
    return sqrt(best);
}
