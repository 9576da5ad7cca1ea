/* The ground under houses and trees, from the surface model: the progressive morphological filter (Zhang et al. 2003,
 * "A progressive morphological filter for removing nonground measurements from airborne LIDAR data"). */
#include "base/file.h"
#include "export/about.h"
#include "export/geotiff.h"
#include "export/surface_model.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_CELLS = 4096 }; /* a side */
#define FINEST_M 0.25
#define FIRST_STEP_M 0.3 /* a cell this much above the first opening is no ground */
#define MOST_STEP_M 2.5
#define SLOPE 0.3 /* of the ground, rise over run */
#define PIT_M 4.0 /* a hollow narrower than this, and deeper than the first step, is an error of the surface model */

/* Heights of cells; NaN: none. */
typedef struct grid {
    float *z, *opened, *scratch;
    uint8_t *ground;
    uint32_t width, height;
    double cell_m;
    uint32_t factor; /* pixels of the surface model a side of a cell */
} grid;

/* ---- reading: the lowest pixel of each cell ---- */

static void take_row(grid *g, const float *row, uint32_t y, uint32_t pixels)
{
    float *cells = g->z + (size_t)(y / g->factor) * g->width;
    for (uint32_t x = 0; x < pixels; x++) {
        float *cell = &cells[x / g->factor];
        if (row[x] != CN_GEOTIFF_NODATA && !(*cell <= row[x])) *cell = row[x];
    }
}

static cn_status read_grid(grid *g, const cn_surface_model *model)
{
    const size_t n = (size_t)g->width * g->height;
    float *row = malloc(model->width * sizeof *row);
    g->z = malloc(n * sizeof *g->z);
    g->opened = malloc(n * sizeof *g->opened);
    g->scratch = malloc(n * sizeof *g->scratch);
    g->ground = malloc(n);
    cn_status status =
        row && g->z && g->opened && g->scratch && g->ground
            ? CN_OK
            : cn_fail(CN_ERR_NOMEM, "out of memory for a ground model of %u x %u cells", g->width, g->height);
    for (size_t i = 0; status == CN_OK && i < n; i++)
        g->z[i] = NAN;
    for (uint32_t y = 0; status == CN_OK && y < model->height; y++) {
        status = cn_surface_model_row(model, y, row);
        if (status == CN_OK) take_row(g, row, y, model->width);
    }
    free(row);
    return status;
}

/* ---- morphology: minima and maxima over a square, line by line ---- */

/* sign 1: minima over +-reach cells, -1: maxima. queue: room for a line's indices. */
typedef struct window {
    uint32_t reach;
    float sign;
    uint32_t *queue;
} window;

/* A line of n cells, `step` apart. Cells without data do not count. */
static void slide(const float *in, float *out, uint32_t n, size_t step, const window *w)
{
    uint32_t first = 0, last = 0, next = 0, *queue = w->queue;
    for (uint32_t i = 0; i < n; i++) {
        for (; next < n && next <= i + w->reach; next++) {
            const float value = w->sign * in[next * step];
            if (isnan(value)) continue;
            while (last > first && w->sign * in[queue[last - 1] * step] >= value)
                last--;
            queue[last++] = next;
        }
        while (first < last && queue[first] + w->reach < i)
            first++;
        out[i * step] = first < last ? in[queue[first] * step] : NAN;
    }
}

/* Minima, then maxima with sign 1: an opening. -1: a closing. Into g->opened; `in` may be that. */
static void open_or_close(const grid *g, const float *in, uint32_t reach, float sign, uint32_t *queue)
{
    for (int pass = 0; pass < 2; pass++) {
        const window w = { reach, pass ? -sign : sign, queue };
        const float *from = pass ? g->opened : in;
        for (uint32_t y = 0; y < g->height; y++)
            slide(from + (size_t)y * g->width, g->scratch + (size_t)y * g->width, g->width, 1, &w);
        for (uint32_t x = 0; x < g->width; x++)
            slide(g->scratch + x, g->opened + x, g->height, g->width, &w);
    }
}

/* Closes hollows: what lies below the closing is no ground, and the closing is what the filter sees. A single low cell
 * would else pull every window down that it is in. */
static void close_pits(grid *g, float *current, uint32_t *queue)
{
    const size_t n = (size_t)g->width * g->height;
    const uint32_t reach = (uint32_t)ceil(PIT_M / 2 / g->cell_m);
    open_or_close(g, g->z, reach, -1, queue);
    for (size_t i = 0; i < n; i++) {
        const bool pit = g->opened[i] - g->z[i] > (float)FIRST_STEP_M;
        g->ground[i] = !isnan(g->z[i]) && !pit;
        current[i] = pit ? g->opened[i] : g->z[i];
    }
}

/* Opens with windows that grow to the widest house, and flags what stands out. */
static cn_status filter(const cn_context *ctx, grid *g, double widest_m)
{
    const size_t n = (size_t)g->width * g->height;
    uint32_t *queue = malloc((g->width + (size_t)g->height) * sizeof *queue), before = 0;
    float *opened = g->opened, *current = malloc(n * sizeof *current);
    if (!queue || !current) {
        free(queue);
        free(current);
        return cn_fail(CN_ERR_NOMEM, "out of memory for a ground model of %u x %u cells", g->width, g->height);
    }
    close_pits(g, current, queue);
    const uint32_t most = (uint32_t)ceil(widest_m / 2 / g->cell_m);
    cn_status status = CN_OK;
    for (uint32_t reach = 1; before < most && status == CN_OK; reach *= 2) {
        reach = reach < most ? reach : most;
        const double rise = before ? SLOPE * 2 * (reach - before) * g->cell_m : 0;
        const float step = (float)fmin(FIRST_STEP_M + rise, MOST_STEP_M);
        open_or_close(g, current, reach, 1, queue);
        for (size_t i = 0; i < n; i++)
            if (current[i] - opened[i] > step) g->ground[i] = 0;
        memcpy(current, opened, n * sizeof *current);
        before = reach;
        if (cn_stopping(ctx)) status = cn_fail(CN_ERR_INTERRUPTED, "stopped while exporting; run the command again");
    }
    free(queue);
    free(current);
    return status;
}

/* ---- what lies between the ground's cells ---- */

/* One level coarser: the mean of four cells where there is ground. */
static void halve(const float *z, uint32_t w, uint32_t h, float *out)
{
    const uint32_t half = (w + 1) / 2;
    for (uint32_t y = 0; y < (h + 1) / 2; y++)
        for (uint32_t x = 0; x < half; x++) {
            double sum = 0, n = 0;
            for (uint32_t c = 0; c < 4; c++) {
                const uint32_t u = 2 * x + (c & 1), v = 2 * y + (c >> 1);
                if (u >= w || v >= h || isnan(z[(size_t)v * w + u])) continue;
                sum += (double)z[(size_t)v * w + u];
                n++;
            }
            out[(size_t)y * half + x] = n > 0 ? (float)(sum / n) : NAN;
        }
}

/* Bilinear between the coarser level's cells. */
static float interpolate(const float *z, uint32_t w, uint32_t h, double x, double y)
{
    const double u = fmin(fmax(x, 0), w - 1), v = fmin(fmax(y, 0), h - 1);
    const uint32_t i = (uint32_t)fmin(floor(u), w > 1 ? w - 2 : 0), k = (uint32_t)fmin(floor(v), h > 1 ? h - 2 : 0);
    const uint32_t right = w > 1, down = h > 1;
    const double a = u - i, b = v - k;
    const float *at = z + (size_t)k * w + i;
    return (float)((1 - b) * ((1 - a) * (double)at[0] + a * (double)at[right]) +
                   b * ((1 - a) * (double)at[(size_t)down * w] + a * (double)at[(size_t)down * w + right]));
}

/* Fills cells of NaN from coarser levels (pull and push; Gortler et al. 1996, "The lumigraph"). */
static cn_status fill(float *z, uint32_t w, uint32_t h)
{
    if (w == 1 && h == 1) return CN_OK;
    const uint32_t half_w = (w + 1) / 2, half_h = (h + 1) / 2;
    float *coarse = malloc((size_t)half_w * half_h * sizeof *coarse);
    if (!coarse) return cn_fail(CN_ERR_NOMEM, "out of memory for a ground model of %u x %u cells", w, h);
    halve(z, w, h, coarse);
    const cn_status status = fill(coarse, half_w, half_h);
    for (size_t i = 0; status == CN_OK && i < (size_t)w * h; i++)
        if (isnan(z[i]))
            z[i] = interpolate(coarse, half_w, half_h, (double)(i % w) / 2 - 0.25, (double)(i / w) / 2 - 0.25);
    free(coarse);
    return status;
}

/* ---- writing ---- */

static cn_status write_rows(const grid *g, cn_geotiff *tiff)
{
    for (uint32_t y = 0; y < g->height; y++)
        CN_TRY(cn_geotiff_write(tiff, y, 1, g->opened + (size_t)y * g->width));
    return cn_geotiff_finish(tiff);
}

static cn_status write_ground(const cn_context *ctx, const grid *g, const cn_ground_task *task,
                              const cn_surface_model *model)
{
    cn_export_about about;
    cn_geotiff tiff;
    char how[192];
    cn_export_about_make(&about, task->survey);
    snprintf(
        how, sizeof how,
        "progressive morphological filter (Zhang et al. 2003): windows to %.0f m, slope %.1f, steps %.1f to %.1f m",
        task->widest_m, SLOPE, FIRST_STEP_M, MOST_STEP_M);
    const char *metadata[] = { "TIFFTAG_SOFTWARE", about.software, "HEIGHTS", about.heights, "TILES",
                               about.tiles,        "GROUND",       how,       NULL };
    const cn_geotiff_header header = { .width = g->width,
                                       .height = g->height,
                                       .place = { model->epsg, model->left_m, model->top_m, g->cell_m },
                                       .metadata = metadata,
                                       .band = "ground height" };
    cn_status status = cn_geotiff_open(&tiff, ctx, task->dtm, &header);
    if (status == CN_OK) status = write_rows(g, &tiff);
    cn_geotiff_abort(&tiff);
    return status;
}

static cn_status make_ground(const cn_context *ctx, grid *g, const cn_ground_task *task, const cn_surface_model *model)
{
    const size_t n = (size_t)g->width * g->height;
    CN_TRY(read_grid(g, model));
    CN_TRY(filter(ctx, g, task->widest_m));
    size_t ground = 0;
    for (size_t i = 0; i < n; i++) {
        g->opened[i] = g->ground[i] ? g->z[i] : NAN;
        ground += g->ground[i];
    }
    if (!ground) return cn_fail(CN_ERR_DATA, "%s: the surface model shows no ground", task->dtm);
    CN_TRY(fill(g->opened, g->width, g->height));
    for (size_t i = 0; i < n; i++)
        if (isnan(g->z[i])) g->opened[i] = CN_GEOTIFF_NODATA;
    return write_ground(ctx, g, task, model);
}

cn_status cn_export_ground(const cn_context *ctx, const cn_ground_task *task)
{
    cn_surface_model model;
    if (!(task->widest_m > 0 && task->widest_m < 1000))
        return cn_fail(CN_ERR_USAGE, "%g: give the width of the widest house in metres, to 1000", task->widest_m);
    CN_TRY(cn_surface_model_open(&model, task->dsm));
    const double side = fmax(model.width, model.height);
    grid g = { .factor = (uint32_t)fmax(ceil(side / MOST_CELLS), fmax(1, round(FINEST_M / model.gsd_m))) };
    g.cell_m = g.factor * model.gsd_m;
    g.width = (model.width + g.factor - 1) / g.factor;
    g.height = (model.height + g.factor - 1) / g.factor;
    const cn_status status = make_ground(ctx, &g, task, &model);
    cn_surface_model_close(&model);
    free(g.z);
    free(g.opened);
    free(g.scratch);
    free(g.ground);
    return status;
}
