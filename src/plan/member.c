/* Assigns views to tiles. */
#include "plan/plan.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

cn_status cn_plan_list_add(cn_plan_list *list, uint32_t item)
{
    if (list->n == list->capacity) {
        uint32_t capacity = list->capacity ? 2 * list->capacity : 16;
        uint32_t *items = realloc(list->items, sizeof *items * capacity);
        if (!items) return cn_fail(CN_ERR_NOMEM, "out of memory for the photos of a tile");
        list->items = items;
        list->capacity = capacity;
    }
    list->items[list->n++] = item;
    return CN_OK;
}

/* Scratch for one view at a time: how many of its points each circle holds. */
typedef struct tally {
    uint32_t *found, *touched, *count;
    uint32_t n_touched;
} tally;

static void tally_place(tally *t, const cn_plan_circles *circles, const double place[3], uint32_t amount)
{
    uint32_t n = cn_plan_circles_at(circles, place, t->found, circles->n);
    for (uint32_t i = 0; i < n; i++) {
        uint32_t c = t->found[i];
        if (t->count[c] == 0) t->touched[t->n_touched++] = c;
        t->count[c] += amount;
    }
}

/* Adds the view to its circles; *n: their number. */
static cn_status join(tally *t, const cn_plan_draft *d, uint32_t view, uint32_t *n)
{
    const cn_plan_view *v = &d->views.views[view];
    double needed = d->options->min_points_seen * v->n_points;
    t->n_touched = 0;
    for (uint32_t k = 0; k < v->n_points; k++)
        tally_place(t, &d->circles, d->input->scene->points[d->views.seen[v->first_point + k]].xyz, 1);
    /* A photo inside a circle belongs to it, even if it sees most of its points elsewhere. Without points, the anchor
     * counts as the only point seen. */
    tally_place(t, &d->circles, v->centre, v->n_points + 1);
    if (v->n_points == 0) tally_place(t, &d->circles, v->anchor, 1);
    *n = 0;
    for (uint32_t i = 0; i < t->n_touched; i++) {
        uint32_t c = t->touched[i];
        if (t->count[c] >= needed) {
            CN_TRY(cn_plan_list_add(&d->lists[c], view));
            ++*n;
        }
        t->count[c] = 0;
    }
    return CN_OK;
}

/* Removes circles with too few photos. A heap holds each circle with the number of its training photos at the time
 * it was put there. Numbers only grow. An entry that is out of date is therefore too low, comes up too early, and is
 * put back with its present number. */
typedef struct poor {
    uint32_t training, circle;
} poor;
typedef struct leaving {
    poor *heap;
    uint32_t n_heap;
    uint32_t *n_tiles, *training; /* of each view; of each circle */
    bool *gone;                   /* of each circle */
    uint32_t n_circles;
} leaving;

static bool is_poorer(poor a, poor b)
{
    return a.training != b.training ? a.training < b.training : a.circle < b.circle;
}

static void sift_down(leaving *l, uint32_t i)
{
    const poor moved = l->heap[i];
    for (uint32_t child; (child = 2 * i + 1) < l->n_heap; i = child) {
        if (child + 1 < l->n_heap && is_poorer(l->heap[child + 1], l->heap[child])) child++;
        if (!is_poorer(l->heap[child], moved)) break;
        l->heap[i] = l->heap[child];
    }
    l->heap[i] = moved;
}

static void fill_heap(leaving *l, const cn_plan_draft *d)
{
    l->n_heap = l->n_circles = d->circles.n;
    for (uint32_t i = 0; i < l->n_heap; i++) {
        for (uint32_t k = 0; k < d->lists[i].n; k++)
            l->training[i] += !d->held[d->lists[i].items[k]];
        l->heap[i] = (poor){ l->training[i], i };
    }
    for (uint32_t i = l->n_heap / 2; i-- > 0;)
        sift_down(l, i);
}

/* The circle with the fewest training photos, when they are fewer than min; it leaves the heap. */
static bool take_poorest(leaving *l, uint32_t min, uint32_t *poorest)
{
    while (l->n_circles > 1 && l->n_heap > 0) {
        const poor top = l->heap[0];
        if (top.training >= min) return false;
        *poorest = top.circle;
        if (top.training == l->training[top.circle]) {
            l->heap[0] = l->heap[--l->n_heap];
            if (l->n_heap > 0) sift_down(l, 0);
            return true;
        }
        l->heap[0].training = l->training[top.circle];
        sift_down(l, 0);
    }
    return false;
}

static cn_status send_to_nearest(leaving *l, cn_plan_draft *d, uint32_t view)
{
    uint32_t to = cn_plan_circles_nearest(&d->circles, d->views.views[view].anchor, l->gone);
    CN_TRY(cn_plan_list_add(&d->lists[to], view));
    l->training[to] += !d->held[view];
    l->n_tiles[view] = 1;
    d->one_left = view;
    d->n_left++;
    return CN_OK;
}

/* Takes circle i out; views that were in no other go to the nearest one. */
static cn_status drop(leaving *l, cn_plan_draft *d, uint32_t i)
{
    cn_plan_list left = d->lists[i];
    d->lists[i] = (cn_plan_list){ 0 };
    l->gone[i] = true;
    l->n_circles--;
    cn_status status = CN_OK;
    for (uint32_t k = 0; k < left.n && status == CN_OK; k++)
        if (--l->n_tiles[left.items[k]] == 0) status = send_to_nearest(l, d, left.items[k]);
    free(left.items);
    return status;
}

/* Closes the gaps that dropped circles leave in all arrays. */
static void close_gaps(const leaving *l, cn_plan_draft *d)
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < d->circles.n; i++) {
        if (l->gone[i]) continue;
        if (n < i) {
            memcpy(d->circles.centre[n], d->circles.centre[i], sizeof *d->circles.centre);
            d->radius_m[n] = d->radius_m[i];
            d->lists[n] = d->lists[i];
            d->lists[i] = (cn_plan_list){ 0 };
        }
        n++;
    }
    d->circles.n = n;
}

/* ---- Circles with the same photos ---- */

typedef struct listed {
    const cn_plan_list *list;
    uint32_t circle;
} listed;

/* 0: the same photos. */
static int compare_photos(const listed *x, const listed *y)
{
    if (x->list->n != y->list->n) return x->list->n < y->list->n ? -1 : 1;
    return x->list->n ? memcmp(x->list->items, y->list->items, x->list->n * sizeof(uint32_t)) : 0;
}

static int compare_lists(const void *a, const void *b)
{
    const listed *x = a, *y = b;
    const int order = compare_photos(x, y);
    return order ? order : (x->circle > y->circle) - (x->circle < y->circle);
}

static double away(const double *place, const double centre[2])
{
    return hypot(place[0] - centre[0], place[1] - centre[1]);
}

/* Whether a place is in one of n circles. */
static bool is_in_one(const cn_plan_circles *circles, const listed *some, uint32_t n, const double *place)
{
    for (uint32_t i = 0; i < n; i++)
        if (away(place, circles->centre[some[i].circle]) <= circles->radius_m) return true;
    return false;
}

/* One circle for n with the same photos: in the middle of what these look at, with a radius that holds the cameras, as
 * far as either is in the circles. */
static void join_circles(leaving *l, cn_plan_draft *d, const listed *same, uint32_t n)
{
    const uint32_t kept = same[0].circle;
    const cn_plan_list *list = &d->lists[kept];
    double sum[2] = { 0 }, farthest = 0;
    uint32_t n_sum = 0;
    for (uint32_t i = 0; i < list->n; i++) {
        const double *anchor = d->views.views[list->items[i]].anchor;
        if (!is_in_one(&d->circles, same, n, anchor)) continue;
        n_sum++;
        for (int k = 0; k < 2; k++)
            sum[k] += anchor[k];
    }
    const double *first = d->circles.centre[kept],
                 middle[2] = { n_sum ? sum[0] / n_sum : first[0], n_sum ? sum[1] / n_sum : first[1] };
    for (uint32_t i = 0; i < list->n; i++) {
        const double *camera = d->views.views[list->items[i]].centre;
        if (is_in_one(&d->circles, same, n, camera)) farthest = fmax(farthest, away(camera, middle));
    }
    memcpy(d->circles.centre[kept], middle, sizeof middle);
    d->radius_m[kept] = fmax(1.05 * farthest, 0.1 * d->views.distance_m);
    for (uint32_t i = 1; i < n; i++) {
        free(d->lists[same[i].circle].items);
        d->lists[same[i].circle] = (cn_plan_list){ 0 };
        l->gone[same[i].circle] = true;
        l->n_circles--;
        d->n_joined++;
    }
}

/* The lists are sorted. */
static cn_status join_same(leaving *l, cn_plan_draft *d)
{
    uint32_t n = 0;
    if (d->options->layout == CN_LAYOUT_CENTRES || d->options->layout == CN_LAYOUT_GRID || d->options->spacing_m > 0)
        return CN_OK;
    listed *order = malloc((d->circles.n + (size_t)1) * sizeof *order);
    if (!order) return cn_fail(CN_ERR_NOMEM, "out of memory for %u tiles", d->circles.n);
    for (uint32_t i = 0; i < d->circles.n; i++)
        if (!l->gone[i]) order[n++] = (listed){ &d->lists[i], i };
    qsort(order, n, sizeof *order, compare_lists);
    for (uint32_t i = 0, end; i < n; i = end) {
        for (end = i + 1; end < n && compare_photos(&order[i], &order[end]) == 0;)
            end++;
        if (end > i + 1) join_circles(l, d, order + i, end - i);
    }
    free(order);
    return CN_OK;
}

static int compare_indices(const void *a, const void *b)
{
    uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

static cn_status assign(tally *t, leaving *l, cn_plan_draft *d)
{
    uint32_t poorest;
    CN_TRY(cn_plan_circles_index(&d->circles));
    for (uint32_t v = 0; v < d->views.n; v++)
        CN_TRY(join(t, d, v, &l->n_tiles[v]));
    for (uint32_t v = 0; v < d->views.n; v++)
        if (l->n_tiles[v] == 0) CN_TRY(send_to_nearest(l, d, v));
    memset(l->training, 0, sizeof *l->training * d->circles.n); /* count again: views have just been added */
    fill_heap(l, d);
    while (take_poorest(l, d->options->min_photos, &poorest))
        CN_TRY(drop(l, d, poorest));
    for (uint32_t i = 0; i < d->circles.n; i++)
        if (!l->gone[i]) qsort(d->lists[i].items, d->lists[i].n, sizeof(uint32_t), compare_indices);
    CN_TRY(join_same(l, d));
    close_gaps(l, d);
    return CN_OK;
}

cn_status cn_plan_members(cn_plan_draft *draft)
{
    size_t n = draft->circles.n;
    uint32_t *scratch = calloc(4 * n + draft->views.n, sizeof *scratch);
    if (!scratch) return cn_fail(CN_ERR_NOMEM, "out of memory for %zu tiles", n);
    tally t = { .found = scratch, .touched = scratch + n, .count = scratch + 2 * n };
    leaving l = { .training = scratch + 3 * n,
                  .n_tiles = scratch + 4 * n,
                  .heap = malloc(sizeof *l.heap * n),
                  .gone = calloc(n, sizeof *l.gone) };
    draft->n_left = draft->one_left = draft->n_joined = 0;
    cn_status status =
        l.heap && l.gone ? assign(&t, &l, draft) : cn_fail(CN_ERR_NOMEM, "out of memory for %zu tiles", n);
    free(l.heap);
    free(l.gone);
    free(scratch);
    return status;
}
