/* Which views belong to which tile. */
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
typedef struct tally { uint32_t *found, *touched, *count; uint32_t n_touched; } tally;

static void tally_place(tally *t, const cn_plan_circles *circles, const double place[3], uint32_t amount)
{
    uint32_t n = cn_plan_circles_at(circles, place, t->found, circles->n);
    for (uint32_t i = 0; i < n; i++) {
        uint32_t c = t->found[i];
        if (t->count[c] == 0) t->touched[t->n_touched++] = c;
        t->count[c] += amount;
    }
}

/* Adds the view to its circles; *n how many. */
static cn_status join(tally *t, const cn_plan_circles *circles, cn_plan_list *lists, const cn_plan_views *views,
                      const cn_scene *scene, double min_seen, uint32_t view, uint32_t *n)
{
    const cn_plan_view *v = &views->views[view];
    double needed = min_seen * v->n_points;
    t->n_touched = 0;
    for (uint32_t k = 0; k < v->n_points; k++) tally_place(t, circles, scene->points[views->seen[v->first_point + k]].xyz, 1);
    /* Standing inside outweighs every point; without points the anchor stands for what is seen. */
    tally_place(t, circles, v->centre, v->n_points + 1);
    if (v->n_points == 0) tally_place(t, circles, v->anchor, 1);
    *n = 0;
    for (uint32_t i = 0; i < t->n_touched; i++) {
        uint32_t c = t->touched[i];
        if (t->count[c] >= needed) {
            CN_TRY(cn_plan_list_add(&lists[c], view));
            ++*n;
        }
        t->count[c] = 0;
    }
    return CN_OK;
}

static uint32_t nearest_circle(const cn_plan_circles *circles, const double place[3])
{
    uint32_t best = 0;
    double smallest = INFINITY;
    for (uint32_t i = 0; i < circles->n; i++) {
        double d = hypot(place[0] - circles->centre[i][0], place[1] - circles->centre[i][1]);
        if (d < smallest) {
            smallest = d;
            best = i;
        }
    }
    return best;
}

/* The circle with the fewest training photos, when they are fewer than min. */
static bool find_poorest(const cn_plan_circles *circles, const cn_plan_list *lists, const bool *held, uint32_t min,
                         uint32_t *training, bool count_all, uint32_t *poorest)
{
    uint32_t fewest = UINT32_MAX;
    for (uint32_t i = 0; i < circles->n; i++) {
        if (count_all) {
            training[i] = 0;
            for (uint32_t k = 0; k < lists[i].n; k++) training[i] += !held[lists[i].items[k]];
        }
        if (training[i] < fewest) {
            fewest = training[i];
            *poorest = i;
        }
    }
    return circles->n > 1 && fewest < min;
}

typedef struct leaving { uint32_t *n_tiles, *training; uint32_t n_left, one_left; } leaving;

static cn_status send_to_nearest(leaving *l, cn_plan_circles *circles, cn_plan_list *lists, const cn_plan_views *views,
                                 const bool *held, uint32_t view)
{
    uint32_t to = nearest_circle(circles, views->views[view].anchor);
    CN_TRY(cn_plan_list_add(&lists[to], view));
    l->training[to] += !held[view];
    l->n_tiles[view] = 1;
    l->one_left = view;
    l->n_left++;
    return CN_OK;
}

/* Takes circle i out; views that were in no other go to the nearest one. */
static cn_status drop(leaving *l, cn_plan_circles *circles, cn_plan_list *lists, const cn_plan_views *views, const bool *held,
                      uint32_t i)
{
    cn_plan_list gone = lists[i];
    uint32_t last = --circles->n;
    lists[i] = lists[last];
    lists[last] = (cn_plan_list){0};
    memcpy(circles->centre[i], circles->centre[last], sizeof *circles->centre);
    l->training[i] = l->training[last];
    cn_status status = CN_OK;
    for (uint32_t k = 0; k < gone.n && status == CN_OK; k++)
        if (--l->n_tiles[gone.items[k]] == 0) status = send_to_nearest(l, circles, lists, views, held, gone.items[k]);
    free(gone.items);
    return status;
}

static int compare_indices(const void *a, const void *b)
{
    uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

static cn_status assign(tally *t, leaving *l, cn_plan_circles *circles, cn_plan_list *lists, const cn_plan_views *views,
                        const cn_scene *scene, const cn_plan_options *options, const bool *held)
{
    uint32_t poorest = 0;
    CN_TRY(cn_plan_circles_index(circles));
    for (uint32_t v = 0; v < views->n; v++)
        CN_TRY(join(t, circles, lists, views, scene, options->min_points_seen, v, &l->n_tiles[v]));
    for (uint32_t v = 0; v < views->n; v++)
        if (l->n_tiles[v] == 0) CN_TRY(send_to_nearest(l, circles, lists, views, held, v));
    bool count_all = true;
    while (find_poorest(circles, lists, held, options->min_photos, l->training, count_all, &poorest)) {
        count_all = false;
        CN_TRY(drop(l, circles, lists, views, held, poorest));
    }
    for (uint32_t i = 0; i < circles->n; i++) qsort(lists[i].items, lists[i].n, sizeof(uint32_t), compare_indices);
    return CN_OK;
}

cn_status cn_plan_members(cn_plan_circles *circles, cn_plan_list *lists, const cn_plan_views *views, const cn_scene *scene,
                          const cn_plan_options *options, const bool *held, uint32_t *n_left, uint32_t *one_left)
{
    size_t n = circles->n;
    uint32_t *scratch = calloc(4 * n + views->n, sizeof *scratch);
    if (!scratch) return cn_fail(CN_ERR_NOMEM, "out of memory for %zu tiles", n);
    tally t = {.found = scratch, .touched = scratch + n, .count = scratch + 2 * n};
    leaving l = {.training = scratch + 3 * n, .n_tiles = scratch + 4 * n};
    cn_status status = assign(&t, &l, circles, lists, views, scene, options, held);
    *n_left = l.n_left;
    *one_left = l.one_left;
    free(scratch);
    return status;
}
