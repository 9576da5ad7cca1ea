/* Finds the circles that contain a place: sorted cells as wide as the radius, found by bisection. */
#include "plan/plan.h"

#include <math.h>
#include <stdlib.h>

/* Signed cell numbers, shifted so that neighbours across 0 stay neighbours. Layouts keep them within 32 bits. */
static uint64_t cell_key(int64_t x, int64_t y)
{
    return ((uint64_t)(x + INT32_MAX) << 32) | (uint64_t)(uint32_t)(y + INT32_MAX);
}

static int64_t cell_of(double v, double size)
{
    return (int64_t)fmax(fmin(floor(v / size), 1e9), -1e9);
}

typedef struct keyed {
    uint64_t cell;
    uint32_t circle;
} keyed;

static int compare_keyed(const void *a, const void *b)
{
    const keyed *x = a, *y = b;
    if (x->cell != y->cell) return x->cell < y->cell ? -1 : 1;
    return (x->circle > y->circle) - (x->circle < y->circle);
}

cn_status cn_plan_circles_index(cn_plan_circles *c)
{
    free(c->cells);
    free(c->order);
    c->cells = malloc(sizeof *c->cells * c->n);
    c->order = malloc(sizeof *c->order * c->n);
    keyed *sorted = malloc(sizeof *sorted * c->n);
    if (!c->cells || !c->order || !sorted) {
        free(sorted);
        return cn_fail(CN_ERR_NOMEM, "out of memory for %u tiles", c->n);
    }
    for (uint32_t i = 0; i < c->n; i++)
        sorted[i] =
            (keyed){ cell_key(cell_of(c->centre[i][0], c->radius_m), cell_of(c->centre[i][1], c->radius_m)), i };
    qsort(sorted, c->n, sizeof *sorted, compare_keyed);
    for (uint32_t i = 0; i < c->n; i++) {
        c->cells[i] = sorted[i].cell;
        c->order[i] = sorted[i].circle;
    }
    free(sorted);
    return CN_OK;
}

void cn_plan_circles_deinit(cn_plan_circles *c)
{
    free(c->centre);
    free(c->cells);
    free(c->order);
    *c = (cn_plan_circles){ 0 };
}

static uint32_t lower_bound(const cn_plan_circles *c, uint64_t cell)
{
    uint32_t low = 0, high = c->n;
    while (low < high) {
        uint32_t middle = low + (high - low) / 2;
        if (c->cells[middle] < cell)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

uint32_t cn_plan_circles_at(const cn_plan_circles *c, const double place[2], uint32_t *found, uint32_t max)
{
    int64_t x = cell_of(place[0], c->radius_m), y = cell_of(place[1], c->radius_m);
    uint32_t n = 0;
    for (int64_t dx = -1; dx <= 1; dx++) {
        uint64_t last = cell_key(x + dx, y + 1);
        for (uint32_t i = lower_bound(c, cell_key(x + dx, y - 1)); i < c->n && c->cells[i] <= last && n < max; i++) {
            const double *centre = c->centre[c->order[i]];
            const double x_m = place[0] - centre[0], y_m = place[1] - centre[1];
            if (x_m * x_m + y_m * y_m <= c->radius_m * c->radius_m) found[n++] = c->order[i];
        }
    }
    return n;
}

/* A search for the circle that is nearest to a place, of those that are not gone. */
typedef struct search {
    const double *place;
    const bool *gone;
    uint32_t circle; /* the best so far */
    double square;   /* of its distance */
} search;

static void try_circle(search *s, const cn_plan_circles *c, uint32_t circle)
{
    const double dx = s->place[0] - c->centre[circle][0], dy = s->place[1] - c->centre[circle][1];
    const double square = dx * dx + dy * dy;
    if (s->gone[circle] || square >= s->square) return;
    s->circle = circle;
    s->square = square;
}

/* Tries the circles in cells (x, low) to (x, high). */
static void try_cells(search *s, const cn_plan_circles *c, int64_t x, int64_t low, int64_t high)
{
    const uint64_t last = cell_key(x, high);
    for (uint32_t i = lower_bound(c, cell_key(x, low)); i < c->n && c->cells[i] <= last; i++)
        try_circle(s, c, c->order[i]);
}

/* Goes through rings of cells from the inside out. Whatever is beyond ring r is farther away than r radii. */
uint32_t cn_plan_circles_nearest(const cn_plan_circles *c, const double place[2], const bool *gone)
{
    enum { RINGS = 32 };
    const int64_t x = cell_of(place[0], c->radius_m), y = cell_of(place[1], c->radius_m);
    search s = { place, gone, 0, INFINITY };
    for (int64_t r = 0; r < RINGS; r++) {
        for (int64_t dx = -r; dx <= r; dx++) {
            const bool edge = dx == -r || dx == r;
            try_cells(&s, c, x + dx, y - r, edge ? y + r : y - r);
            if (!edge) try_cells(&s, c, x + dx, y + r, y + r);
        }
        if (s.square <= (double)(r * r) * c->radius_m * c->radius_m) return s.circle;
    }
    /* The place is far from all circles: try them all. This is rare. */
    for (uint32_t i = 0; i < c->n; i++)
        try_circle(&s, c, i);
    return s.circle;
}
