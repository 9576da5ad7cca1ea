#include "pose/groups.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define CORE_SHARE 0.6     /* of a group's photos; the others are its neighbours' */
enum { FEW_TOGETHER = 8 }; /* connected parts with fewer photos than this become groups together */

/* The pairs as lists of neighbours, and what is known of each photo. */
typedef struct graph {
    const cn_group_split *split;
    uint32_t n, core; /* photos; photos of a core at most */
    uint64_t *first;  /* first[i]: of photo i in `next` */
    uint32_t *next;
    uint32_t *group; /* whose core has the photo; UINT32_MAX: none yet */
    uint32_t *order; /* photos, part after part */
    uint32_t *rank;  /* for sorting */
    uint32_t *queue;
} graph;

void cn_photo_groups_deinit(cn_photo_groups *groups)
{
    for (uint32_t i = 0; i < groups->n; i++)
        free(groups->groups[i].photos);
    free(groups->groups);
    *groups = (cn_photo_groups){ 0 };
}

static void graph_deinit(graph *g)
{
    free(g->first);
    free(g->next);
    free(g->group);
    free(g->order);
    free(g->rank);
    free(g->queue);
}

static cn_status graph_init(graph *g, const cn_group_split *split)
{
    const size_t n = split->n_photos, room = n + 1;
    const cn_photo_pairs *pairs = split->pairs;
    *g = (graph){ .split = split, .n = split->n_photos, .core = (uint32_t)(CORE_SHARE * split->most) };
    g->first = calloc(room + 1, sizeof *g->first);
    g->next = calloc(2 * pairs->n + 1, sizeof *g->next);
    g->group = malloc(room * sizeof *g->group);
    g->order = malloc(room * sizeof *g->order);
    g->rank = malloc(room * sizeof *g->rank);
    g->queue = malloc(room * sizeof *g->queue);
    if (!g->first || !g->next || !g->group || !g->order || !g->rank || !g->queue) {
        graph_deinit(g);
        return cn_fail(CN_ERR_NOMEM, "out of memory grouping %u photos", split->n_photos);
    }
    memset(g->group, 0xff, room * sizeof *g->group);
    for (size_t i = 0; i < pairs->n; i++) {
        g->first[(pairs->items[i] >> 32) + 2]++;
        g->first[(uint32_t)pairs->items[i] + 2]++;
    }
    for (size_t i = 2; i <= n; i++)
        g->first[i] += g->first[i - 1];
    for (size_t i = 0; i < pairs->n; i++) {
        const uint32_t a = (uint32_t)(pairs->items[i] >> 32), b = (uint32_t)pairs->items[i];
        g->next[g->first[a + 1]++] = b;
        g->next[g->first[b + 1]++] = a;
    }
    return CN_OK;
}

/* Breadth-first from `start` through photos whose rank is `from`, which becomes `to`. The queue then has them in order.
 * Returns how many. */
static uint32_t search(graph *g, uint32_t start, uint32_t from, uint32_t to)
{
    uint32_t n = 1;
    g->queue[0] = start;
    g->rank[start] = to;
    for (uint32_t i = 0; i < n; i++)
        for (uint64_t k = g->first[g->queue[i]]; k < g->first[g->queue[i] + 1]; k++) {
            const uint32_t photo = g->next[k];
            if (g->rank[photo] != from) continue;
            g->rank[photo] = to;
            g->queue[n++] = photo;
        }
    return n;
}

typedef struct sort_entry {
    double key;
    uint32_t photo;
} sort_entry;
static int by_key(const void *a, const void *b)
{
    const sort_entry *x = a, *y = b;
    if (x->key != y->key) return x->key < y->key ? -1 : 1;
    return (x->photo > y->photo) - (x->photo < y->photo);
}

static int by_number(const void *a, const void *b)
{
    const uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

/* Sorts photos along the longer side of their places. */
static bool sort_by_place(const graph *g, uint32_t *photos, uint32_t n)
{
    const double(*at)[2] = g->split->places;
    double low[2] = { INFINITY, INFINITY }, high[2] = { -INFINITY, -INFINITY };
    sort_entry *entries = malloc((n + (size_t)1) * sizeof *entries);
    if (!entries) return false;
    for (uint32_t i = 0; i < n; i++)
        for (int k = 0; k < 2; k++) {
            low[k] = fmin(low[k], at[photos[i]][k]);
            high[k] = fmax(high[k], at[photos[i]][k]);
        }
    const int axis = high[1] - low[1] > high[0] - low[0];
    for (uint32_t i = 0; i < n; i++)
        entries[i] = (sort_entry){ at[photos[i]][axis], photos[i] };
    qsort(entries, n, sizeof *entries, by_key);
    for (uint32_t i = 0; i < n; i++)
        photos[i] = entries[i].photo;
    free(entries);
    return true;
}

/* Sorts photos in the order of a breadth-first search from one end of them: the photo that a first search reaches last.
 * Parts that the search does not reach follow. */
static void sort_by_search(graph *g, uint32_t *photos, uint32_t n)
{
    enum { OUT = UINT32_MAX, IN = 0, ONCE = 1, TWICE = 2 };
    uint32_t done = 0;
    for (uint32_t i = 0; i < n; i++)
        g->rank[photos[i]] = IN;
    uint32_t *const queue = g->queue;
    for (uint32_t i = 0; done < n && i < n; i++) {
        if (g->rank[photos[i]] != IN) continue;
        uint32_t found = search(g, photos[i], IN, ONCE);
        found = search(g, g->queue[found - 1], ONCE, TWICE);
        /* The queue of the next search begins behind this one. */
        g->queue += found;
        done += found;
    }
    g->queue = queue;
    memcpy(photos, queue, n * sizeof *queue);
    for (uint32_t i = 0; i < n; i++)
        g->rank[photos[i]] = OUT;
}

/* Gives photos[0..n) to `parts` groups from *next on. */
static bool halve(graph *g, uint32_t *photos, uint32_t n, uint32_t parts, uint32_t *next)
{
    if (parts <= 1) {
        for (uint32_t i = 0; i < n; i++)
            g->group[photos[i]] = *next;
        ++*next;
        return true;
    }
    if (!g->split->places)
        sort_by_search(g, photos, n);
    else if (!sort_by_place(g, photos, n))
        return false;
    const uint32_t left = parts / 2, at = (uint32_t)((uint64_t)n * left / parts);
    return halve(g, photos, at, left, next) && halve(g, photos + at, n - at, parts - left, next);
}

/* The cores: each connected part is halved on its own; the smallest ones are put together. */
static bool find_cores(graph *g, uint32_t *n_groups)
{
    uint32_t n = 0, n_small = 0;
    uint32_t *small = malloc((g->n + (size_t)1) * sizeof *small);
    if (!small) return false;
    memset(g->rank, 0xff, (g->n + (size_t)1) * sizeof *g->rank);
    uint32_t *seen = calloc(g->n + (size_t)1, sizeof *seen);
    bool fine = seen != NULL;
    for (uint32_t i = 0; i < g->n && fine; i++) {
        if (seen[i]) continue;
        const uint32_t found = search(g, i, UINT32_MAX, 0);
        memcpy(g->order, g->queue, found * sizeof *g->order);
        for (uint32_t k = 0; k < found; k++) {
            seen[g->order[k]] = 1;
            g->rank[g->order[k]] = UINT32_MAX - 1; /* not for a later search */
            if (found < FEW_TOGETHER) small[n_small++] = g->order[k];
        }
        if (found < FEW_TOGETHER) continue;
        qsort(g->order, found, sizeof *g->order, by_number);
        fine = halve(g, g->order, found, (found + g->core - 1) / g->core, &n);
        for (uint32_t k = 0; k < found; k++)
            g->rank[g->order[k]] = UINT32_MAX - 1;
    }
    for (uint32_t i = 0; i < n_small; i += g->core, n++)
        for (uint32_t k = i; k < n_small && k < i + g->core; k++)
            g->group[small[k]] = n;
    free(seen);
    free(small);
    *n_groups = n;
    return fine;
}

/* A photo of another core, and how many pairs it has with this one. */
typedef struct candidate {
    uint32_t photo, group, n_pairs;
} candidate;
static int by_group(const void *a, const void *b)
{
    const candidate *x = a, *y = b;
    if (x->group != y->group) return x->group < y->group ? -1 : 1;
    if (x->n_pairs != y->n_pairs) return x->n_pairs > y->n_pairs ? -1 : 1;
    return (x->photo > y->photo) - (x->photo < y->photo);
}

/* Photos that have pairs with the core, sorted by their own core and then by falling number of pairs. */
static uint32_t find_candidates(graph *g, const cn_photo_group *group, uint32_t me, candidate *out)
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < group->n_core; i++)
        for (uint64_t k = g->first[group->photos[i]]; k < g->first[group->photos[i] + 1]; k++) {
            const uint32_t photo = g->next[k];
            if (g->group[photo] == me) continue;
            if (g->rank[photo] >= n || out[g->rank[photo]].photo != photo) {
                g->rank[photo] = n;
                out[n++] = (candidate){ photo, g->group[photo], 0 };
            }
            out[g->rank[photo]].n_pairs++;
        }
    qsort(out, n, sizeof *out, by_group);
    return n;
}

/* The candidates of one neighbouring core. */
typedef struct neighbour {
    uint32_t at, end, taken;
    double weight;
} neighbour;

/* Adds photos of the neighbours in turn, so that each gets its share of the places by its number of pairs: a neighbour
 * with few photos must still be tied. */
static bool add_shared(cn_photo_group *group, const candidate *found, uint32_t n, uint32_t most)
{
    neighbour *list = malloc((n + (size_t)1) * sizeof *list);
    uint32_t n_list = 0;
    if (!list) return false;
    for (uint32_t i = 0; i < n; i++) {
        if (!i || found[i].group != found[i - 1].group) list[n_list++] = (neighbour){ i, i, 0, 0 };
        list[n_list - 1].end = i + 1;
        list[n_list - 1].weight += found[i].n_pairs;
    }
    while (group->n < most) {
        neighbour *next = NULL;
        for (uint32_t i = 0; i < n_list; i++) {
            neighbour *l = &list[i];
            if (l->at < l->end && (!next || (l->taken + 1) / sqrt(l->weight) < (next->taken + 1) / sqrt(next->weight)))
                next = l;
        }
        if (!next) break;
        next->taken++;
        group->photos[group->n++] = found[next->at++].photo;
    }
    free(list);
    qsort(group->photos + group->n_core, group->n - group->n_core, sizeof *group->photos, by_number);
    return true;
}

static bool fill_groups(graph *g, cn_photo_groups *out)
{
    candidate *found = malloc((g->n + (size_t)1) * sizeof *found);
    bool fine = found != NULL;
    memset(g->rank, 0, (g->n + (size_t)1) * sizeof *g->rank);
    for (uint32_t i = 0; i < out->n && fine; i++) {
        out->groups[i].photos = malloc((g->split->most + (size_t)1) * sizeof(uint32_t));
        fine = out->groups[i].photos != NULL;
    }
    for (uint32_t i = 0; i < g->n && fine; i++) {
        cn_photo_group *group = &out->groups[g->group[i]];
        group->photos[group->n++] = i;
        group->n_core = group->n;
    }
    for (uint32_t i = 0; i < out->n && fine; i++) {
        const uint32_t n = find_candidates(g, &out->groups[i], i, found);
        fine = add_shared(&out->groups[i], found, n, g->split->most);
    }
    free(found);
    return fine;
}

cn_status cn_photo_groups_split(const cn_group_split *split, cn_photo_groups *out)
{
    graph g;
    *out = (cn_photo_groups){ 0 };
    CN_TRY(graph_init(&g, split));
    uint32_t n = 0;
    bool fine = find_cores(&g, &n);
    if (fine) out->groups = calloc(n + (size_t)1, sizeof *out->groups);
    fine = fine && out->groups;
    out->n = fine ? n : 0;
    fine = fine && fill_groups(&g, out);
    graph_deinit(&g);
    if (fine) return CN_OK;
    cn_photo_groups_deinit(out);
    return cn_fail(CN_ERR_NOMEM, "out of memory grouping %u photos", split->n_photos);
}
