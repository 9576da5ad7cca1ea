/* SSIM as in Wang, Bovik, Sheikh, Simoncelli, "Image quality assessment: from error visibility to structural
 * similarity", IEEE Trans. Image Processing 13(4), 2004. The Gaussian window is separable: each row is filtered along x
 * once into a ring of 11 rows, from which each output row is filtered along y, so memory grows with the width only. */
#include "conurb/measure.h"

#include <math.h>
#include <stdlib.h>

#define WINDOW 11u
#define MOMENTS 5u /* x, y, xx, yy, xy */

static void make_window(double window[WINDOW])
{
    double sum = 0;
    for (unsigned i = 0; i < WINDOW; i++) {
        double d = (double)i - WINDOW / 2;
        window[i] = exp(-d * d / (2 * 1.5 * 1.5));
        sum += window[i];
    }
    for (unsigned i = 0; i < WINDOW; i++)
        window[i] /= sum;
}

/* Filters one row of one channel along x into moments[x][MOMENTS]. */
static void filter_row(const float *truth, const float *test, uint32_t n_out, const double window[WINDOW],
                       double *moments)
{
    for (uint32_t x = 0; x < n_out; x++) {
        double m[MOMENTS] = { 0 };
        for (unsigned i = 0; i < WINDOW; i++) {
            double a = truth[3 * (x + i)], b = test[3 * (x + i)], w = window[i];
            m[0] += w * a;
            m[1] += w * b;
            m[2] += w * a * a;
            m[3] += w * b * b;
            m[4] += w * a * b;
        }
        for (unsigned k = 0; k < MOMENTS; k++)
            moments[MOMENTS * x + k] = m[k];
    }
}

static double ssim_of_moments(const double m[MOMENTS])
{
    const double c1 = 0.01 * 0.01, c2 = 0.03 * 0.03;
    double aa = m[0] * m[0], bb = m[1] * m[1], ab = m[0] * m[1];
    return (2 * ab + c1) * (2 * (m[4] - ab) + c2) / ((aa + bb + c1) * ((m[2] - aa) + (m[3] - bb) + c2));
}

double cn_measure_ssim(const float *truth, const float *test, const float *weight, uint32_t width, uint32_t height)
{
    if (width < WINDOW || height < WINDOW) return NAN;
    uint32_t n_out = width - WINDOW + 1;
    double *ring = malloc(sizeof *ring * MOMENTS * WINDOW * n_out);
    if (!ring) return NAN;
    double window[WINDOW], sum = 0, total = 0;
    make_window(window);
    for (int channel = 0; channel < 3; channel++) {
        for (uint32_t y = 0; y < height; y++) {
            size_t row = (size_t)3 * width * y + (size_t)channel;
            filter_row(truth + row, test + row, n_out, window, ring + (size_t)MOMENTS * n_out * (y % WINDOW));
            if (y + 1 < WINDOW) continue;
            uint32_t first = y + 1 - WINDOW; /* top row of the window that ends here */
            const float *centre = weight ? weight + (size_t)width * (first + WINDOW / 2) + WINDOW / 2 : NULL;
            for (uint32_t x = 0; x < n_out; x++) {
                double w = centre ? centre[x] : 1;
                if (!(w > 0)) continue;
                double m[MOMENTS] = { 0 };
                for (unsigned i = 0; i < WINDOW; i++) {
                    const double *from = ring + MOMENTS * ((size_t)n_out * ((first + i) % WINDOW) + x);
                    for (unsigned k = 0; k < MOMENTS; k++)
                        m[k] += window[i] * from[k];
                }
                sum += w * ssim_of_moments(m);
                total += w;
            }
        }
    }
    free(ring);
    return total > 0 ? sum / total : NAN;
}
