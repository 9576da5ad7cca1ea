#include "train/unseen_light.h"

#include "math/linalg.h"

#include <math.h>

enum { LEAST_PHOTOS = 6 }; /* fewer photos do not show how alike neighbours are */
/* A turn by this much counts like the mean distance between neighbours. Not measured apart. */
#define TURN_RAD 0.5

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

void cn_unseen_light(const cn_view *const *views, uint32_t n, uint32_t n_trained, uint32_t width, float *rows)
{
    const double spacing = n_trained < LEAST_PHOTOS ? 0 : mean_spacing(views, n_trained);
    double with = 0, of = 0;
    if (!(spacing > 0)) return;
    for (uint32_t i = 0; i < n_trained; i++) {
        const neighbours found = find_neighbours(views, n_trained, i, spacing);
        for (uint32_t c = 0; c < width; c++) {
            const double p = predicted(&found, rows, width, c);
            with += p * (double)rows[(size_t)i * width + c];
            of += p * p;
        }
    }
    const double trust = of > 0 ? fmin(fmax(with / of, 0), 1) : 0;
    for (uint32_t i = n_trained; i < n; i++) {
        const neighbours found = find_neighbours(views, n_trained, i, spacing);
        for (uint32_t c = 0; c < width; c++)
            rows[(size_t)i * width + c] = (float)(trust * predicted(&found, rows, width, c));
    }
}
