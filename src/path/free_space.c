#include "path/free_space.h"

#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    CELLS_MOST = 64,
    MARGIN = 8, /* cells on either side of the views */
    RAYS_MOST = 2000000,
    MIN_TRACK = 3 /* views that a point needs: points of two are often wrong */
};
/* What a metre costs: in free space, in free space beside sparse points, where nothing is known, and beside sparse
 * points where nothing else is known. All constants here were found on the made city of scripts/run, and looked at on
 * castle and sacre-coeur; the flights of four other sets do not change. */
enum { FREE = 1, BESIDE = 3, UNKNOWN = 5, MATTER = 15 };
enum { IS_FREE = 1, HAS_POINTS = 2 };
#define ABOVE 0.99    /* higher than this share of the sparse points there is only air */
#define AROUND 0.5    /* of the distance to a photo's nearest sparse points: free beside and above the photo */
#define NEAREST 0.05  /* the share of its points that counts as nearest: some are wrong */
#define WORTH 0.7     /* a route costs less than this share of the straight line */
#define SHORTCUT 1.05 /* a corner is left out when the line without it costs at most this much more */

static bool cell_of(const cn_free_space *s, const double p[3], uint32_t at[3])
{
    for (int k = 0; k < 3; k++) {
        const double x = floor((p[k] - s->origin[k]) / s->edge);
        if (!(x >= 0 && x < s->n[k])) return false;
        at[k] = (uint32_t)x;
    }
    return true;
}
static size_t index_of(const cn_free_space *s, const uint32_t at[3])
{
    return ((size_t)at[2] * s->n[1] + at[1]) * s->n[0] + at[0];
}
static void middle_of(const cn_free_space *s, size_t cell, double p[3])
{
    for (int k = 0; k < 3; cell /= s->n[k], k++)
        p[k] = s->origin[k] + s->edge * ((double)(cell % s->n[k]) + 0.5);
}

static void mark(cn_free_space *s, const double p[3], uint8_t bit)
{
    uint32_t at[3];
    if (cell_of(s, p, at)) s->cost[index_of(s, at)] |= bit;
}

static int compare_floats(const void *a, const void *b)
{
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* Lays the cells over the views' centres, with a margin. */
static void lay(cn_free_space *s, const cn_scene *scene)
{
    double least[3] = { INFINITY, INFINITY, INFINITY }, most[3] = { -INFINITY, -INFINITY, -INFINITY }, longest = 0;
    for (uint32_t v = 0; v < scene->n_views; v++) {
        double c[3];
        cn_view_centre(&scene->views[v], c);
        for (int k = 0; k < 3; k++) {
            least[k] = fmin(least[k], c[k]);
            most[k] = fmax(most[k], c[k]);
        }
    }
    for (int k = 0; k < 3; k++)
        longest = fmax(longest, most[k] - least[k]);
    if (!scene->n_points || !scene->n_observations || !(longest > 0) || !isfinite(longest)) return;
    s->edge = longest / (CELLS_MOST - 2 * MARGIN);
    for (int k = 0; k < 3; k++) {
        s->n[k] = (uint32_t)ceil((most[k] - least[k]) / s->edge) + 2 * MARGIN;
        s->origin[k] = (least[k] + most[k] - s->edge * s->n[k]) / 2;
    }
}

/* Lines of sight, up to a cell before their points. */
static void carve_lines(cn_free_space *s, const cn_scene *scene)
{
    const uint64_t stride = scene->n_observations / RAYS_MOST + 1;
    for (uint32_t i = 0; i < scene->n_points; i++) {
        const cn_point *point = &scene->points[i];
        mark(s, point->xyz, HAS_POINTS);
        for (uint32_t j = 0; j < point->n_observations; j++) {
            const uint64_t o = (uint64_t)point->first_observation + j;
            if (o % stride || point->n_observations < MIN_TRACK) continue;
            double from[3], p[3];
            cn_view_centre(&scene->views[scene->observations[o].view], from);
            const double length = cn_distance3(from, point->xyz), step = s->edge / 2;
            for (double t = 0; t < length - s->edge; t += step) {
                uint32_t at[3];
                for (int k = 0; k < 3; k++)
                    p[k] = from[k] + t / length * (point->xyz[k] - from[k]);
                /* The cells are convex, and the ray begins inside. */
                if (!cell_of(s, p, at)) break;
                s->cost[index_of(s, at)] |= IS_FREE;
            }
        }
    }
}

/* A dome over each view, as large as the nearest things that it shows allow. What is below the camera it need not show:
 * the ground is often nearer than anything in the picture. */
static cn_status carve_domes(cn_free_space *s, const cn_scene *scene)
{
    cn_status status = CN_OK;
    uint32_t *first = calloc(scene->n_views + 1, sizeof *first);
    float *distance = malloc(scene->n_observations * sizeof *distance);
    if (!first || !distance) status = cn_fail(CN_ERR_NOMEM, "out of memory for the default camera path");
    for (uint64_t o = 0; status == CN_OK && o < scene->n_observations; o++)
        first[scene->observations[o].view + 1]++;
    for (uint32_t v = 0; status == CN_OK && v < scene->n_views; v++)
        first[v + 1] += first[v];
    for (uint32_t i = 0; status == CN_OK && i < scene->n_points; i++)
        for (uint32_t j = 0; j < scene->points[i].n_observations; j++) {
            const uint32_t v = scene->observations[scene->points[i].first_observation + j].view;
            double c[3];
            cn_view_centre(&scene->views[v], c);
            distance[first[v]++] = (float)cn_distance3(c, scene->points[i].xyz);
        }
    for (uint32_t v = 0; status == CN_OK && v < scene->n_views; v++) {
        const uint32_t from = v ? first[v - 1] : 0, n = first[v] - from;
        double c[3], p[3];
        if (!n) continue;
        qsort(distance + from, n, sizeof *distance, compare_floats);
        cn_view_centre(&scene->views[v], c);
        const double radius = AROUND * distance[from + (uint32_t)(NEAREST * n)];
        const int reach = (int)fmin(ceil(radius / s->edge), CELLS_MOST);
        for (int z = 0; z <= reach; z++)
            for (int y = -reach; y <= reach; y++)
                for (int x = -reach; x <= reach; x++) {
                    const int d[3] = { x, y, z };
                    for (int k = 0; k < 3; k++)
                        p[k] = c[k] + d[k] * s->edge;
                    if (cn_distance3(c, p) <= radius) mark(s, p, IS_FREE);
                }
    }
    free(first);
    free(distance);
    return status;
}

static cn_status carve_above(cn_free_space *s, const cn_scene *scene)
{
    float *z = malloc(scene->n_points * sizeof *z);
    if (!z) return cn_fail(CN_ERR_NOMEM, "out of memory for the default camera path");
    for (uint32_t i = 0; i < scene->n_points; i++)
        z[i] = (float)scene->points[i].xyz[2];
    qsort(z, scene->n_points, sizeof *z, compare_floats);
    const double top = z[(uint32_t)(ABOVE * (scene->n_points - 1))];
    free(z);
    const size_t level = (size_t)s->n[0] * s->n[1];
    for (uint32_t k = 0; k < s->n[2]; k++)
        for (size_t i = 0; i < level && s->origin[2] + s->edge * k > top; i++)
            s->cost[k * level + i] |= IS_FREE;
    return CN_OK;
}

/* Whether a cell or one of its 26 neighbours has points. */
static bool beside_points(const cn_free_space *s, const uint8_t *marks, size_t cell)
{
    const uint32_t at[3] = { (uint32_t)(cell % s->n[0]), (uint32_t)(cell / s->n[0] % s->n[1]),
                             (uint32_t)(cell / s->n[0] / s->n[1]) };
    for (uint32_t z = at[2] - (at[2] > 0); z <= at[2] + 1 && z < s->n[2]; z++)
        for (uint32_t y = at[1] - (at[1] > 0); y <= at[1] + 1 && y < s->n[1]; y++)
            for (uint32_t x = at[0] - (at[0] > 0); x <= at[0] + 1 && x < s->n[0]; x++)
                if (marks[index_of(s, (const uint32_t[]){ x, y, z })] & HAS_POINTS) return true;
    return false;
}

cn_status cn_free_space_carve(cn_free_space *s, const cn_scene *scene)
{
    *s = (cn_free_space){ 0 };
    lay(s, scene);
    const size_t n = (size_t)s->n[0] * s->n[1] * s->n[2];
    if (!n) return CN_OK;
    uint8_t *cost = malloc(n);
    s->cost = calloc(n, 1);
    cn_status status = CN_OK;
    if (!s->cost || !cost) status = cn_fail(CN_ERR_NOMEM, "out of memory for the default camera path");
    if (status == CN_OK) carve_lines(s, scene);
    if (status == CN_OK) status = carve_domes(s, scene);
    if (status == CN_OK) status = carve_above(s, scene);
    for (size_t i = 0; status == CN_OK && i < n; i++) {
        const bool is_free = s->cost[i] & IS_FREE, beside = beside_points(s, s->cost, i);
        cost[i] = is_free ? beside ? BESIDE : FREE : beside ? MATTER : UNKNOWN;
    }
    free(s->cost);
    s->cost = cost;
    if (status != CN_OK) cn_free_space_deinit(s);
    return status;
}

void cn_free_space_deinit(cn_free_space *s)
{
    free(s->cost);
    *s = (cn_free_space){ 0 };
}

double cn_free_space_line(const cn_free_space *s, const double from[3], const double to[3])
{
    const double length = cn_distance3(from, to);
    if (!s->cost) return length;
    const uint32_t n = (uint32_t)fmin(ceil(2 * length / s->edge), 4 * CELLS_MOST) + 1;
    double sum = 0;
    for (uint32_t i = 0; i < n; i++) {
        const double t = (i + 0.5) / n;
        double p[3];
        uint32_t at[3];
        for (int k = 0; k < 3; k++)
            p[k] = from[k] + t * (to[k] - from[k]);
        sum += cell_of(s, p, at) ? s->cost[index_of(s, at)] : UNKNOWN;
    }
    return sum / n * length;
}

/* A binary heap of cells by the least cost of a route through them. */
typedef struct waiting {
    float cost;
    uint32_t cell;
} waiting;
typedef struct search {
    waiting *heap;
    uint32_t n, room;
    float *cost;    /* [cells] from the start; INFINITY: not reached */
    uint32_t *from; /* [cells] the cell before */
} search;

static bool push(search *s, waiting w)
{
    if (s->n == s->room) {
        const uint32_t room = s->room ? 2 * s->room : 4096;
        waiting *more = realloc(s->heap, room * sizeof *more);
        if (!more) return false;
        s->heap = more;
        s->room = room;
    }
    uint32_t i = s->n++;
    for (; i && s->heap[(i - 1) / 2].cost > w.cost; i = (i - 1) / 2)
        s->heap[i] = s->heap[(i - 1) / 2];
    s->heap[i] = w;
    return true;
}
static waiting pop(search *s)
{
    const waiting top = s->heap[0], last = s->heap[--s->n];
    uint32_t i = 0;
    for (uint32_t child = 1; child < s->n; child = 2 * i + 1) {
        if (child + 1 < s->n && s->heap[child + 1].cost < s->heap[child].cost) child++;
        if (s->heap[child].cost >= last.cost) break;
        s->heap[i] = s->heap[child];
        i = child;
    }
    s->heap[i] = last;
    return top;
}

/* Fills cost and from up to the goal. A cell may wait more than once; the first time that it comes is the best. */
static bool find(const cn_free_space *space, search *s, uint32_t start, uint32_t goal)
{
    double end[3];
    middle_of(space, goal, end);
    s->cost[start] = 0;
    if (!push(s, (waiting){ 0, start })) return false;
    while (s->n) {
        const waiting w = pop(s);
        if (w.cell == goal) return true;
        double here[3], there[3];
        middle_of(space, w.cell, here);
        if (w.cost > s->cost[w.cell] + (float)cn_distance3(here, end) * 1.0001f) continue;
        const int at[3] = { (int)(w.cell % space->n[0]), (int)(w.cell / space->n[0] % space->n[1]),
                            (int)(w.cell / space->n[0] / space->n[1]) };
        for (int i = 0; i < 27; i++) {
            const int to[3] = { at[0] + i % 3 - 1, at[1] + i / 3 % 3 - 1, at[2] + i / 9 - 1 };
            bool inside = i != 13;
            for (int k = 0; k < 3; k++)
                inside = inside && to[k] >= 0 && to[k] < (int)space->n[k];
            if (!inside) continue;
            const uint32_t cell =
                (uint32_t)index_of(space, (const uint32_t[]){ (uint32_t)to[0], (uint32_t)to[1], (uint32_t)to[2] });
            middle_of(space, cell, there);
            const float step = (float)(cn_distance3(here, there) * (space->cost[w.cell] + space->cost[cell]) / 2);
            if (!(s->cost[w.cell] + step < s->cost[cell])) continue;
            s->cost[cell] = s->cost[w.cell] + step;
            s->from[cell] = w.cell;
            if (!push(s, (waiting){ s->cost[cell] + (float)cn_distance3(there, end), cell })) return false;
        }
    }
    return true;
}

/* Of the cells from goal back to start, those where the route has to turn, in the order of flight. */
static bool pull_straight(const cn_free_space *space, const search *s, uint32_t start, uint32_t goal,
                          double (**corners)[3], size_t *n)
{
    size_t length = 1;
    for (uint32_t c = goal; c != start; c = s->from[c])
        length++;
    double(*place)[3] = malloc(length * sizeof *place);
    float *cost = malloc(length * sizeof *cost);
    if (place && cost) {
        uint32_t c = goal;
        for (size_t i = length; i-- > 0; c = s->from[c]) {
            middle_of(space, c, place[i]);
            cost[i] = s->cost[c];
        }
        for (size_t at = 0, next; at + 1 < length; at = next) {
            for (next = length - 1; next > at + 1; next--)
                if (cn_free_space_line(space, place[at], place[next]) <= SHORTCUT * (double)(cost[next] - cost[at]))
                    break;
            /* Corners are written over places that were passed. */
            if (next + 1 < length) memcpy(place[(*n)++], place[next], sizeof *place);
        }
    }
    const bool ok = place && cost;
    free(cost);
    *corners = place;
    return ok;
}

cn_status cn_free_space_route(const cn_free_space *space, const double from[3], const double to[3],
                              double (**corners)[3], size_t *n)
{
    uint32_t a[3], b[3];
    *corners = NULL;
    *n = 0;
    if (!space->cost || !cell_of(space, from, a) || !cell_of(space, to, b)) return CN_OK;
    const double straight = cn_free_space_line(space, from, to);
    if (straight * WORTH <= cn_distance3(from, to)) return CN_OK;
    const uint32_t start = (uint32_t)index_of(space, a), goal = (uint32_t)index_of(space, b);
    const size_t cells = (size_t)space->n[0] * space->n[1] * space->n[2];
    search s = { .cost = malloc(cells * sizeof *s.cost), .from = malloc(cells * sizeof *s.from) };
    bool ok = s.cost && s.from;
    for (size_t i = 0; ok && i < cells; i++)
        s.cost[i] = INFINITY;
    ok = ok && find(space, &s, start, goal);
    if (ok && s.cost[goal] < WORTH * straight) ok = pull_straight(space, &s, start, goal, corners, n);
    free(s.heap);
    free(s.cost);
    free(s.from);
    if (!ok) {
        free(*corners);
        *corners = NULL;
        *n = 0;
    }
    return ok ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the default camera path");
}
