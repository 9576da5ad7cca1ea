#include "video/choose.h"

#include <math.h>
#include <stdlib.h>

/* Motion that takes longer to show is that of a camera that stood still before. */
#define STILL_S 0.5
#define EDGE_WORTH 0.5 /* what a picture at the edge of its part is worth beside one in its middle, equally sharp */

size_t cn_film_choose(const cn_film_picture *pictures, size_t n, double every_s, size_t *chosen)
{
    double moving_s = 0, way = 0, before_s = n ? pictures[0].time_s : 0;
    for (size_t i = 1; i < n; i++)
        if (pictures[i].motion > 0) {
            moving_s += fmin(pictures[i].time_s - before_s, STILL_S);
            before_s = pictures[i].time_s;
            way += pictures[i].motion;
        }
    if (!n) return 0;
    size_t parts = (size_t)fmax(1, round(moving_s / every_s)), found = 0;
    if (parts > n) parts = n;
    const double part = way > 0 ? way / (double)parts : 1;
    double at = 0, best_worth = -1;
    size_t best = 0, current = 0;
    for (size_t i = 0; i < n; i++) {
        at += pictures[i].motion;
        size_t mine = (size_t)fmin(at / part, (double)parts - 1);
        if (mine != current) {
            chosen[found++] = best;
            best_worth = -1;
            current = mine;
        }
        const double off = fmin(2 * fabs(at / part - (double)mine - 0.5), 1);
        const double worth = pictures[i].sharpness * (1 - (1 - EDGE_WORTH) * off);
        if (worth > best_worth) {
            best_worth = worth;
            best = i;
        }
    }
    chosen[found++] = best;
    return found;
}

/* Normal flow: brightness changes by gradient times motion. The ratio of the sums is a mean over the picture, and
 * needs no matching. It saturates at about two pixels of the small picture. */
double cn_film_motion(const uint8_t *before, const uint8_t *after, int w, int h)
{
    double change = 0, gradient = 0;
    for (int y = 1; y + 1 < h; y++)
        for (int x = 1; x + 1 < w; x++) {
            const uint8_t *p = after + (ptrdiff_t)y * w + x;
            change += abs(*p - before[(ptrdiff_t)y * w + x]);
            gradient += 0.5 * hypot(p[1] - p[-1], p[w] - p[-w]);
        }
    return gradient > 0 ? change / gradient : 0;
}

/* The energy of the Laplacian over the variance, so that brightness and contrast do not count. */
double cn_film_sharpness(const uint8_t *grey, size_t stride, int w, int h)
{
    double energy = 0, sum = 0, squares = 0;
    size_t n = 0;
    for (int y = 1; y + 1 < h; y++)
        for (int x = 1; x + 1 < w; x++, n++) {
            const uint8_t *p = grey + (size_t)y * stride + (size_t)x;
            const double l = 4.0 * *p - p[-1] - p[1] - p[stride] - *(p - stride);
            energy += l * l;
            sum += *p;
            squares += (double)*p * *p;
        }
    if (!n) return 0;
    const double variance = squares / (double)n - sum / (double)n * (sum / (double)n);
    return energy / (double)n / (variance + 1);
}
