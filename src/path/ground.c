/* Heights above the ground: samples, and smooth lines that stay above it. */
#include "path/path.h"

#include "base/units.h"
#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Fills gaps linearly; constant before the first and after the last value. False when there is no value. */
static bool fill_gaps(size_t n, double *z)
{
    size_t before = n;
    for (size_t i = 0; i < n; i++) {
        if (!isfinite(z[i])) continue;
        for (size_t k = before == n ? 0 : before + 1; k < i; k++)
            z[k] = before == n ? z[i] : z[before] + (z[i] - z[before]) * (double)(k - before) / (double)(i - before);
        before = i;
    }
    for (size_t k = before + 1; before < n && k < n; k++)
        z[k] = z[before];
    return before < n;
}

cn_status cn_path_ground(const cn_path_options *options, const char *where, size_t n, const double (*xy_m)[2],
                         double *ground_m)
{
    if (!options->sound)
        return cn_fail(CN_ERR_USAGE,
                       "%s: a height above the ground needs trained tiles, and there are none; train first", where);
    CN_TRY(options->sound(options->sound_user, n, xy_m, ground_m));
    if (fill_gaps(n, ground_m)) return CN_OK;
    return cn_fail(CN_ERR_DATA, "%s: there is no ground below this place: it lies outside what the photos show", where);
}

static double hann(size_t k, size_t reach)
{
    return 0.5 + 0.5 * cos(CN_PI * (double)k / ((double)reach + 1));
}

/* Coordinate c of point i, mirrored through the ends. */
static double extended(size_t n, int width, const double *points, ptrdiff_t i, int c)
{
    ptrdiff_t last = (ptrdiff_t)n - 1, inside = i < 0 ? -i : i > last ? 2 * last - i : i;
    if (inside < 0) inside = 0;
    if (inside > last) inside = last;
    double p = points[inside * width + c];
    if (i < 0) return 2 * points[c] - p;
    return i > last ? 2 * points[last * width + c] - p : p;
}

void cn_path_smooth(size_t n, int width, const double *points, size_t reach, double *out)
{
    for (size_t i = 0; i < n; i++)
        for (int c = 0; c < width; c++) {
            double sum = points[i * (size_t)width + (size_t)c], weights = 1;
            for (size_t k = 1; k <= reach; k++) {
                ptrdiff_t at = (ptrdiff_t)i, step = (ptrdiff_t)k;
                sum += hann(k, reach) *
                       (extended(n, width, points, at - step, c) + extended(n, width, points, at + step, c));
                weights += 2 * hann(k, reach);
            }
            out[i * (size_t)width + (size_t)c] = sum / weights;
        }
}

static size_t window(size_t n, size_t i, size_t reach, size_t *first)
{
    size_t last = i + reach < n - 1 ? i + reach : n - 1;
    *first = i > reach ? i - reach : 0;
    return last - *first + 1;
}

cn_status cn_path_smooth_above(size_t n, double *z, size_t reach)
{
    if (!n) return CN_OK;
    double *median = malloc((2 * n + 2 * reach + 1) * sizeof *median);
    if (!median) return cn_fail(CN_ERR_NOMEM, "out of memory for a camera path's heights");
    double *highest = median + n, *sorted = highest + n;
    for (size_t i = 0; i < n; i++) {
        /* The window is symmetric, because a slope would otherwise sink at the ends. */
        size_t sides = i < n - 1 - i ? i : n - 1 - i, first,
               count = window(n, i, sides < reach ? sides : reach, &first);
        memcpy(sorted, z + first, count * sizeof *z);
        median[i] = cn_select(sorted, count, count / 2);
    }
    for (size_t i = 0; i < n; i++) {
        size_t first, count = window(n, i, reach, &first);
        highest[i] = -INFINITY;
        for (size_t k = 0; k < count; k++)
            highest[i] = fmax(highest[i], median[first + k]);
    }
    /* Every value in the mean is a maximum over a window with i in it, so the mean is never below median[i]. Beyond
     * the ends the last value is used, because a straight continuation could fall below. */
    for (size_t i = 0; i < n; i++) {
        double sum = highest[i], weights = 1;
        for (size_t k = 1; k <= reach; k++) {
            sum += hann(k, reach) * (highest[i > k ? i - k : 0] + highest[i + k < n ? i + k : n - 1]);
            weights += 2 * hann(k, reach);
        }
        z[i] = sum / weights;
    }
    free(median);
    return CN_OK;
}
