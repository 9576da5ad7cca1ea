/* Places the tiles. A tile's field has a fixed number of cells across, so the circle that it can show at the photos'
 * detail is proportional to the viewing distance. Neighbouring centres are one median viewing distance apart, or
 * farther when tiles would get fewer than MIN_SHARE (BLIND_SHARE) photos. Places that are far from each other get no
 * tile together, though each has few photos. */
#include "plan/plan.h"

#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Not measured apart. */
#define MIN_SHARE 8.0 /* photos per tile, without overlap */
/* The same without sparse points. Nobody knows how far photos see then, and a tile with too few photos is worse than a
 * tile with less detail. */
#define BLIND_SHARE 40.0
/* Median viewing distances between tiles from which on places may be too far from each other for one tile. Most photo
 * sets have 1, lund 2. Not measured apart. */
#define FAR_APART 4
enum { ONE_IN = 10 }; /* photos at most that such places leave without a tile of their own */
#define SLACK 0.25    /* fraction of a spacing by which cells are stretched instead of adding a tile */
#define MAX_CELLS 1e6 /* along an axis */
#define MAX_BITS ((int64_t)1 << 26)

typedef struct cell_grid {
    double axis[2][2], low[2], size[2]; /* axes as rows; low corner and cell size along each */
    int64_t n[2];
} cell_grid;

typedef struct placed {
    int64_t cell;
    uint32_t view;
} placed;

static int compare_placed(const void *a, const void *b)
{
    const placed *x = a, *y = b;
    if (x->cell != y->cell) return x->cell < y->cell ? -1 : 1;
    return (x->view > y->view) - (x->view < y->view);
}

/* Principal axes of the anchors, so that a long strip is cut across, whichever way it runs. */
static void principal_axes(const cn_plan_views *views, double axis[2][2])
{
    double mean[2] = { 0 }, a[4] = { 0 }, values[2], v[4];
    for (uint32_t i = 0; i < views->n; i++)
        for (int k = 0; k < 2; k++)
            mean[k] += views->views[i].anchor[k] / views->n;
    for (uint32_t i = 0; i < views->n; i++) {
        double d[2] = { views->views[i].anchor[0] - mean[0], views->views[i].anchor[1] - mean[1] };
        for (int k = 0; k < 4; k++)
            a[k] += d[k / 2] * d[k % 2];
    }
    cn_eigen_symmetric(2, a, values, v);
    for (int k = 0; k < 2; k++)
        for (int r = 0; r < 2; r++)
            axis[k][r] = v[2 * r + k];
}

static double along(const double axis[2], const double place[3])
{
    return axis[0] * place[0] + axis[1] * place[1];
}

/* Cells over the anchors' extent; regular: of exactly the spacing, centred on the extent. */
static cn_status fit_grid(const cn_plan_views *views, double spacing, bool regular, cell_grid *grid)
{
    for (int k = 0; k < 2; k++) {
        double low = INFINITY, high = -INFINITY;
        for (uint32_t i = 0; i < views->n; i++) {
            double u = along(grid->axis[k], views->views[i].anchor);
            low = fmin(low, u);
            high = fmax(high, u);
        }
        double cells = fmax(ceil((high - low) / spacing - SLACK), 1);
        if (!(cells <= MAX_CELLS))
            return cn_fail(CN_ERR_CONFIG, "plan.spacing_m %g is too small for a scene %g across; raise it", spacing,
                           high - low);
        grid->n[k] = (int64_t)cells;
        grid->size[k] = regular || !(high > low) ? spacing : (high - low) / cells;
        grid->low[k] = (low + high - grid->size[k] * cells) / 2;
    }
    return CN_OK;
}

static int64_t cell_of(const cell_grid *grid, const double anchor[3])
{
    int64_t at[2];
    for (int k = 0; k < 2; k++) {
        double u = floor((along(grid->axis[k], anchor) - grid->low[k]) / grid->size[k]);
        at[k] = (int64_t)fmin(fmax(u, 0), (double)(grid->n[k] - 1));
    }
    return at[1] * grid->n[0] + at[0];
}

/* Sorts the views by cell; returns the number of cells with views. */
static uint32_t fill_cells(const cell_grid *grid, const cn_plan_views *views, placed *items)
{
    uint32_t n = views->n > 0;
    for (uint32_t i = 0; i < views->n; i++)
        items[i] = (placed){ cell_of(grid, views->views[i].anchor), i };
    qsort(items, views->n, sizeof *items, compare_placed);
    for (uint32_t i = 1; i < views->n; i++)
        n += items[i].cell != items[i - 1].cell;
    return n;
}

/* The number of cells with views: uses one bit per cell instead of sorting, when that is small. */
static uint32_t count_cells(const cell_grid *grid, const cn_plan_views *views, placed *items)
{
    const int64_t cells = grid->n[0] * grid->n[1];
    uint32_t n = 0;
    uint8_t *met = cells <= MAX_BITS ? calloc((size_t)cells / 8 + 1, 1) : NULL;
    if (!met) return fill_cells(grid, views, items);
    for (uint32_t i = 0; i < views->n; i++) {
        const int64_t cell = cell_of(grid, views->views[i].anchor);
        n += !(met[cell / 8] >> cell % 8 & 1);
        met[cell / 8] |= (uint8_t)(1 << cell % 8);
    }
    free(met);
    return n;
}

static int compare_cell(const void *key, const void *item)
{
    const int64_t cell = *(const int64_t *)key, other = ((const placed *)item)->cell;
    return (cell > other) - (cell < other);
}

/* Whether one of the eight cells around has views. */
static bool has_neighbour(const cell_grid *grid, const placed *items, uint32_t n, int64_t cell)
{
    const int64_t x = cell % grid->n[0], y = cell / grid->n[0];
    for (int64_t v = y - 1; v <= y + 1; v++)
        for (int64_t u = x - 1; u <= x + 1; u++) {
            const int64_t beside = v * grid->n[0] + u;
            if (beside != cell && u >= 0 && v >= 0 && u < grid->n[0] && v < grid->n[1] &&
                bsearch(&beside, items, n, sizeof *items, compare_cell))
                return true;
        }
    return false;
}

/* Whether the cells with views lie apart, and nearly all of these are in cells that have enough. Sorts the views. */
static bool are_places(const cell_grid *grid, const cn_plan_views *views, placed *items, uint32_t enough)
{
    uint32_t n_few = 0;
    (void)fill_cells(grid, views, items);
    for (uint32_t i = 0, end; i < views->n; i = end) {
        for (end = i + 1; end < views->n && items[end].cell == items[i].cell;)
            end++;
        if (has_neighbour(grid, items, views->n, items[i].cell)) return false;
        if (end - i < enough) n_few += end - i;
    }
    return ONE_IN * n_few <= views->n;
}

/* One circle for each cell with anchors: at the cell's middle when regular, else at the anchors' mean. */
static void place_circles(const cell_grid *grid, const cn_plan_views *views, const placed *items, bool regular,
                          cn_plan_circles *circles)
{
    circles->n = 0;
    for (uint32_t i = 0, end; i < views->n; i = end) {
        double *c = circles->centre[circles->n++];
        double middle[2] = { grid->low[0] + (double)(items[i].cell % grid->n[0] + 0.5) * grid->size[0],
                             grid->low[1] + (double)(items[i].cell / grid->n[0] + 0.5) * grid->size[1] };
        c[0] = c[1] = 0;
        for (end = i; end < views->n && items[end].cell == items[i].cell; end++)
            for (int k = 0; k < 2; k++)
                c[k] += views->views[items[end].view].anchor[k];
        for (int k = 0; k < 2; k++)
            c[k] = regular ? grid->axis[0][k] * middle[0] + grid->axis[1][k] * middle[1] : c[k] / (end - i);
    }
}

static cn_status reserve(cn_plan_circles *circles, uint32_t n)
{
    circles->centre = malloc(sizeof *circles->centre * n);
    circles->capacity = circles->centre ? n : 0;
    return circles->centre ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for %u tiles", n);
}

/* Photos that a tile needs, so that min_photos of them are trained on. */
static uint32_t enough_photos(const cn_plan_options *options)
{
    const uint32_t least = options->min_photos, every = options->hold_out_every;
    return every > 1 ? least + (least + every - 2) / (every - 1) : least;
}

static cn_status layout_cells(cn_plan_circles *circles, const cn_plan_views *views, const cn_plan_options *options,
                              double *spacing)
{
    const bool fixed = options->spacing_m > 0, regular = options->layout == CN_LAYOUT_GRID;
    cell_grid grid = { .axis = { { 1, 0 }, { 0, 1 } } };
    placed *items = malloc(sizeof *items * views->n);
    if (!items) return cn_fail(CN_ERR_NOMEM, "out of memory for %u views", views->n);
    if (!regular) principal_axes(views, grid.axis);
    const double share = views->has_points ? MIN_SHARE : BLIND_SHARE;
    cn_status status;
    uint32_t n = 0;
    do {
        status = fit_grid(views, *spacing, regular, &grid);
        if (status != CN_OK) break;
        n = count_cells(&grid, views, items);
        if (fixed || n == 1 || views->n >= share * n) break;
        if (views->has_points && *spacing > FAR_APART * views->distance_m &&
            are_places(&grid, views, items, enough_photos(options)))
            break;
        *spacing *= 1.15;
    } while (true);
    /* The overlap uses the actual distance of neighbours, not the requested spacing. */
    if (!fixed && !regular && n > 1)
        *spacing = fmax(grid.n[0] > 1 ? grid.size[0] : 0, grid.n[1] > 1 ? grid.size[1] : 0);
    if (status == CN_OK) status = reserve(circles, n);
    if (status == CN_OK) (void)fill_cells(&grid, views, items);
    if (status == CN_OK) place_circles(&grid, views, items, regular, circles);
    free(items);
    return status;
}

static int compare_doubles(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Median distance from a given centre to the next one. Centres are given by hand: few enough to try all pairs. */
static cn_status spacing_of_centres(const cn_plan_circles *circles, double *spacing)
{
    double *nearest = malloc(sizeof *nearest * circles->n);
    if (!nearest) return cn_fail(CN_ERR_NOMEM, "out of memory for %u tiles", circles->n);
    for (uint32_t i = 0; i < circles->n; i++) {
        nearest[i] = INFINITY;
        for (uint32_t j = 0; j < circles->n; j++) {
            double d =
                hypot(circles->centre[i][0] - circles->centre[j][0], circles->centre[i][1] - circles->centre[j][1]);
            if (j != i) nearest[i] = fmin(nearest[i], d);
        }
    }
    qsort(nearest, circles->n, sizeof *nearest, compare_doubles);
    *spacing = nearest[circles->n / 2];
    free(nearest);
    return CN_OK;
}

/* A single tile holds every camera, whatever the spacing. */
static void widen_single(cn_plan_circles *circles, const cn_plan_views *views, bool given)
{
    double *c = circles->centre[0], farthest = 0.1 * views->distance_m;
    if (!given && !views->has_points) memcpy(c, views->focus, sizeof *circles->centre);
    for (uint32_t i = 0; i < views->n; i++)
        farthest = fmax(farthest, hypot(views->views[i].centre[0] - c[0], views->views[i].centre[1] - c[1]));
    circles->radius_m = fmax(given ? circles->radius_m : 0, 1.05 * farthest);
}

cn_status cn_plan_layout(cn_plan_circles *circles, const cn_plan_views *views, const cn_frame *frame,
                         const cn_plan_options *options, double *spacing_m)
{
    bool given = options->layout == CN_LAYOUT_CENTRES, fixed = options->spacing_m > 0;
    *circles = (cn_plan_circles){ 0 };
    *spacing_m = fixed ? options->spacing_m : views->distance_m;
    if (given) {
        if (!options->centres)
            return cn_fail(CN_ERR_CONFIG, "plan.layout is \"centres\" but plan.centres names no GeoJSON file");
        CN_TRY(cn_plan_read_centres(options->centres, frame, &circles->centre, &circles->n));
        circles->capacity = circles->n;
        if (!fixed && circles->n > 1) CN_TRY(spacing_of_centres(circles, spacing_m));
        if (!(*spacing_m > 0))
            return cn_fail(CN_ERR_FORMAT, "%s: most centres lie at the same place; remove the duplicates",
                           options->centres);
    } else {
        CN_TRY(layout_cells(circles, views, options, spacing_m));
    }
    circles->radius_m = *spacing_m / (2 * (1 - options->overlap));
    if (circles->n == 1) widen_single(circles, views, given);
    return CN_OK;
}
