#include "math/plane.h"

#include <math.h>
#include <stdlib.h>

enum { LEAF = 8 };
#define NONE UINT32_MAX

/* Node i has children 2 i + 1 and 2 i + 2; it holds order[first] .. order[last - 1]. */
struct cn_plane_node {
    double low[2], high[2], radius;    /* the largest */
    uint32_t first, last, least, most; /* least and most: indices of its places */
};

static void measure(cn_plane *p, cn_plane_node *node)
{
    node->radius = 0;
    node->least = UINT32_MAX;
    node->most = 0;
    for (int a = 0; a < 2; a++) {
        node->low[a] = INFINITY;
        node->high[a] = -INFINITY;
    }
    for (uint32_t i = node->first; i < node->last; i++) {
        const uint32_t at = p->order[i];
        for (int a = 0; a < 2; a++) {
            node->low[a] = fmin(node->low[a], p->places[at][a]);
            node->high[a] = fmax(node->high[a], p->places[at][a]);
        }
        if (p->radii) node->radius = fmax(node->radius, p->radii[at]);
        node->least = at < node->least ? at : node->least;
        node->most = at > node->most ? at : node->most;
    }
}

static bool before(const cn_plane *p, int axis, uint32_t a, uint32_t b)
{
    const double x = p->places[a][axis], y = p->places[b][axis];
    return x != y ? x < y : a < b;
}

/* Puts the k-th of order[first .. last - 1] along an axis in its place, lower ones before it (Hoare's selection). */
static void split(cn_plane *p, int axis, int64_t first, int64_t last, int64_t k)
{
    uint32_t *order = p->order;
    while (last - first > 1) {
        const uint32_t pivot = order[first + (last - first) / 2];
        int64_t i = first, j = last - 1;
        while (i <= j) {
            while (before(p, axis, order[i], pivot))
                i++;
            while (before(p, axis, pivot, order[j]))
                j--;
            if (i > j) break;
            const uint32_t swapped = order[i];
            order[i++] = order[j];
            order[j--] = swapped;
        }
        if (k <= j)
            last = j + 1;
        else if (k >= i)
            first = i;
        else
            return;
    }
}

static void build(cn_plane *p, uint32_t i)
{
    cn_plane_node *node = &p->nodes[i];
    measure(p, node);
    if (node->last - node->first <= LEAF) return;
    const int axis = node->high[1] - node->low[1] > node->high[0] - node->low[0];
    const uint32_t middle = node->first + (node->last - node->first) / 2;
    split(p, axis, node->first, node->last, middle);
    p->nodes[2 * i + 1].first = node->first;
    p->nodes[2 * i + 1].last = p->nodes[2 * i + 2].first = middle;
    p->nodes[2 * i + 2].last = node->last;
    build(p, 2 * i + 1);
    build(p, 2 * i + 2);
}

bool cn_plane_init(cn_plane *plane, const double (*places)[2], const double *radii, uint32_t n)
{
    size_t n_nodes = 1;
    for (uint32_t left = n; left > LEAF; left -= left / 2)
        n_nodes = 2 * n_nodes + 1;
    *plane = (cn_plane){ .places = places, .radii = radii, .n = n };
    plane->order = malloc((n + (size_t)1) * sizeof *plane->order);
    plane->nodes = calloc(n_nodes, sizeof *plane->nodes);
    if (!plane->order || !plane->nodes) {
        cn_plane_deinit(plane);
        return false;
    }
    for (uint32_t i = 0; i < n; i++)
        plane->order[i] = i;
    plane->nodes[0].last = n;
    build(plane, 0);
    return true;
}

void cn_plane_deinit(cn_plane *plane)
{
    free(plane->order);
    free(plane->nodes);
    *plane = (cn_plane){ 0 };
}

/* ---- nearest ---- */

typedef struct search {
    double at[2];
    uint32_t self, k, n;
    cn_plane_found *found;
} search;

/* Compares places at the same distance. */
static uint32_t rank(const search *s, uint32_t index)
{
    return s->self == NONE || index > s->self ? index : s->self - 1 - index;
}

static double square_to(const cn_plane_node *node, const double at[2])
{
    double sum = 0;
    for (int a = 0; a < 2; a++) {
        const double off = fmax(fmax(node->low[a] - at[a], at[a] - node->high[a]), 0);
        sum += off * off;
    }
    return sum;
}

/* A lower bound of the ranks in a node. */
static uint32_t rank_to(const search *s, const cn_plane_node *node)
{
    if (s->self == NONE || node->least > s->self) return node->least;
    return node->most < s->self ? s->self - 1 - node->most : 0;
}

static bool worse(const search *s, double square, uint32_t ranked)
{
    if (s->n < s->k) return false;
    const cn_plane_found *last = &s->found[s->k - 1];
    return square != last->square ? square > last->square : ranked >= rank(s, last->index);
}

static void offer(search *s, cn_plane_found c)
{
    const uint32_t ranked = rank(s, c.index);
    if (worse(s, c.square, ranked)) return;
    uint32_t at = s->n < s->k ? s->n++ : s->k - 1;
    for (; at > 0; at--) {
        const cn_plane_found *b = &s->found[at - 1];
        if (b->square < c.square || (b->square == c.square && rank(s, b->index) < ranked)) break;
        s->found[at] = *b;
    }
    s->found[at] = c;
}

static void search_node(cn_plane *p, uint32_t i, search *s)
{
    const cn_plane_node *node = &p->nodes[i];
    if (node->last - node->first <= LEAF) {
        for (uint32_t k = node->first; k < node->last; k++) {
            const uint32_t at = p->order[k];
            if (at == s->self) continue;
            const double dx = p->places[at][0] - s->at[0], dy = p->places[at][1] - s->at[1];
            p->n_compared++;
            offer(s, (cn_plane_found){ dx * dx + dy * dy, at });
        }
        return;
    }
    const cn_plane_node *a = &p->nodes[2 * i + 1], *b = a + 1;
    const double to_a = square_to(a, s->at), to_b = square_to(b, s->at);
    const uint32_t rank_a = rank_to(s, a), rank_b = rank_to(s, b);
    const bool second = to_b != to_a ? to_b < to_a : rank_b < rank_a;
    for (int turn = 0; turn < 2; turn++) {
        const bool take_b = second != (turn == 1);
        if (!worse(s, take_b ? to_b : to_a, take_b ? rank_b : rank_a)) search_node(p, 2 * i + 1 + take_b, s);
    }
}

uint32_t cn_plane_neighbours(cn_plane *plane, uint32_t self, uint32_t k, cn_plane_found *found)
{
    search s = { { plane->places[self][0], plane->places[self][1] }, self, k, 0, found };
    if (k) search_node(plane, 0, &s);
    return s.n;
}

uint32_t cn_plane_nearest(cn_plane *plane, const double place[2])
{
    cn_plane_found found = { INFINITY, 0 };
    search s = { { place[0], place[1] }, NONE, 1, 0, &found };
    search_node(plane, 0, &s);
    return found.index;
}

/* ---- circles ---- */

typedef struct overlaps {
    double at[2], radius;
    uint32_t self;
    bool (*visit)(void *, uint32_t);
    void *user;
} overlaps;

static bool find(cn_plane *p, uint32_t i, const overlaps *o)
{
    const cn_plane_node *node = &p->nodes[i];
    const double reach =
        (o->radius + node->radius) * (1 + 1e-12); /* a margin, so that rounding does not lose circles that touch */
    if (node->most <= o->self || square_to(node, o->at) >= reach * reach) return true;
    if (node->last - node->first > LEAF) return find(p, 2 * i + 1, o) && find(p, 2 * i + 2, o);
    for (uint32_t k = node->first; k < node->last; k++) {
        const uint32_t at = p->order[k];
        if (at <= o->self) continue;
        p->n_compared++;
        const double apart = hypot(p->places[at][0] - o->at[0], p->places[at][1] - o->at[1]);
        if (apart < o->radius + (p->radii ? p->radii[at] : 0) && !o->visit(o->user, at)) return false;
    }
    return true;
}

bool cn_plane_overlaps(cn_plane *plane, uint32_t self, bool (*visit)(void *user, uint32_t index), void *user)
{
    const overlaps o = {
        { plane->places[self][0], plane->places[self][1] }, plane->radii ? plane->radii[self] : 0, self, visit, user
    };
    return find(plane, 0, &o);
}
