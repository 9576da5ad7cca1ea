#include "train/unseen_light.h"

#include "conurb/tile.h"
#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { LEAST_PHOTOS = 6 }; /* fewer photos do not show how alike neighbours are */
/* A turn by this much counts like the mean distance between neighbours. Not measured apart. */
#define TURN_RAD 0.5
#define CLEAR 2.0 /* standard errors */

/* The two nearest trained photos, and how near they are. */
typedef struct neighbours {
    uint32_t photo[2];
    double weight[2];
} neighbours;

static double apart(const cn_view *a, const cn_view *b, double spacing)
{
    double p[3], q[3], along = 0;
    cn_view_centre(a, p);
    cn_view_centre(b, q);
    for (int k = 0; k < 3; k++)
        along += a->rotation[6 + k] * b->rotation[6 + k];
    const double moved = hypot(hypot(p[0] - q[0], p[1] - q[1]), p[2] - q[2]);
    return moved / spacing + acos(fmin(fmax(along, -1), 1)) / TURN_RAD;
}

/* Finds those of photo i, among the other trained photos. */
static neighbours find_neighbours(const cn_view *const *views, uint32_t n_trained, uint32_t i, double spacing)
{
    neighbours found = { { 0, 0 }, { 0, 0 } };
    double least[2] = { INFINITY, INFINITY };
    for (uint32_t j = 0; j < n_trained; j++) {
        if (j == i) continue;
        const double d = apart(views[i], views[j], spacing);
        const int slot = d < least[0] ? 0 : d < least[1] ? 1 : 2;
        if (slot == 2) continue;
        if (slot == 0) least[1] = least[0], found.photo[1] = found.photo[0];
        least[slot] = d;
        found.photo[slot] = j;
    }
    for (int k = 0; k < 2; k++)
        found.weight[k] = isfinite(least[k]) ? 1 / (0.1 + least[k]) : 0;
    const double sum = found.weight[0] + found.weight[1];
    for (int k = 0; k < 2; k++)
        found.weight[k] = sum > 0 ? found.weight[k] / sum : 0;
    return found;
}

static double predicted(const neighbours *of, const float *rows, uint32_t width, uint32_t c)
{
    return of->weight[0] * (double)rows[(size_t)of->photo[0] * width + c] +
           of->weight[1] * (double)rows[(size_t)of->photo[1] * width + c];
}

/* Mean distance of a trained photo to the nearest other one. */
static double mean_spacing(const cn_view *const *views, uint32_t n_trained)
{
    double sum = 0;
    for (uint32_t i = 0; i < n_trained; i++) {
        double least = INFINITY, p[3], q[3];
        cn_view_centre(views[i], p);
        for (uint32_t j = 0; j < n_trained; j++) {
            if (j == i) continue;
            cn_view_centre(views[j], q);
            least = fmin(least, hypot(hypot(p[0] - q[0], p[1] - q[1]), p[2] - q[2]));
        }
        sum += least / n_trained;
    }
    return sum;
}

/* How well rows are predicted: sums over photos of a = the sum of row * prediction, and b = that of prediction^2. */
typedef struct prediction_sums {
    double a, b, aa, ab, bb;
    uint32_t n;
} prediction_sums;

static void add_photo(prediction_sums *sums, const float *row, const double *prediction, uint32_t width)
{
    double a = 0, b = 0;
    for (uint32_t c = 0; c < width; c++) {
        a += prediction[c] * (double)row[c];
        b += prediction[c] * prediction[c];
    }
    if (!(b > 0)) return;
    sums->a += a;
    sums->b += b;
    sums->aa += a * a;
    sums->ab += a * b;
    sums->bb += b * b;
    sums->n++;
}

/* The part with which predictions fit the trained rows best, between 0 and 1. 0 where it is not clear: among eight
 * photos in lights of their own, neighbours' exposures agreed by chance. The part was 0.28 with a standard error of
 * 0.38 there, and 0.3 to 0.97 with 0.05 to 0.18 on castle, lund and brighton. */
static double best_part(const prediction_sums *sums)
{
    if (sums->n < 2) return 0;
    const double part = sums->a / sums->b;
    const double squares = sums->aa - 2 * part * sums->ab + part * part * sums->bb;
    const double error = sqrt(fmax(squares, 0) * sums->n / (sums->n - 1)) / sums->b;
    return part < CLEAR * error ? 0 : fmin(fmax(part, 0), 1);
}

/* Sets the mean row of the trained photos of i's run without i; zeros where there are none. */
static void mean_of_run(const float *run, uint32_t n_trained, uint32_t i, uint32_t width, const float *rows,
                        double *mean)
{
    uint32_t n = 0;
    for (uint32_t c = 0; c < width; c++)
        mean[c] = 0;
    for (uint32_t j = 0; j < n_trained; j++) {
        if (j == i || run[j] != run[i] || !(run[i] > 0)) continue;
        for (uint32_t c = 0; c < width; c++)
            mean[c] += (double)rows[(size_t)j * width + c];
        n++;
    }
    for (uint32_t c = 0; c < width && n; c++)
        mean[c] /= n;
}

/* Sets the rows that were not trained to a part of the mean of their run, and takes the same part out of the others,
 * to rest[n_trained][width]. */
static void follow_runs(const float *run, uint32_t n, uint32_t n_trained, uint32_t width, float *rows, float *rest)
{
    prediction_sums sums = { 0 };
    double mean[CN_APPEARANCE_MAX];
    for (uint32_t i = 0; i < n_trained; i++) {
        mean_of_run(run, n_trained, i, width, rows, mean);
        add_photo(&sums, rows + (size_t)i * width, mean, width);
    }
    const double trust = best_part(&sums);
    for (uint32_t i = 0; i < n; i++) {
        mean_of_run(run, n_trained, i, width, rows, mean);
        for (uint32_t c = 0; c < width; c++) {
            const size_t at = (size_t)i * width + c;
            if (i < n_trained)
                rest[at] = (float)((double)rows[at] - trust * mean[c]);
            else
                rows[at] = (float)(trust * mean[c]);
        }
    }
}

/* Adds what the neighbours have in rest[n_trained][width] to the rows that were not trained. */
static void follow_neighbours(const cn_view *const *views, uint32_t n, uint32_t n_trained, uint32_t width,
                              const float *rest, float *rows)
{
    const double spacing = n_trained < LEAST_PHOTOS ? 0 : mean_spacing(views, n_trained);
    prediction_sums sums = { 0 };
    double prediction[CN_APPEARANCE_MAX];
    if (!(spacing > 0)) return;
    for (uint32_t i = 0; i < n_trained; i++) {
        const neighbours found = find_neighbours(views, n_trained, i, spacing);
        for (uint32_t c = 0; c < width; c++)
            prediction[c] = predicted(&found, rest, width, c);
        add_photo(&sums, rest + (size_t)i * width, prediction, width);
    }
    const double trust = best_part(&sums);
    for (uint32_t i = n_trained; i < n; i++) {
        const neighbours found = find_neighbours(views, n_trained, i, spacing);
        for (uint32_t c = 0; c < width; c++)
            rows[(size_t)i * width + c] += (float)(trust * predicted(&found, rest, width, c));
    }
}

void cn_unseen_light(const cn_view *const *views, const float *run, uint32_t n, uint32_t n_trained, uint32_t width,
                     float *rows)
{
    float *rest = malloc(sizeof *rest * ((size_t)n_trained * width + 1));
    if (!rest || width > CN_APPEARANCE_MAX) {
        free(rest);
        return;
    }
    memcpy(rest, rows, sizeof *rest * n_trained * width);
    memset(rows + (size_t)n_trained * width, 0, sizeof *rows * (n - n_trained) * width);
    if (run) follow_runs(run, n, n_trained, width, rows, rest);
    follow_neighbours(views, n, n_trained, width, rest, rows);
    free(rest);
}
