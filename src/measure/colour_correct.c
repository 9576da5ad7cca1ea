#include "conurb/measure.h"
#include "math/linalg.h"

#include <math.h>
#include <string.h>

void cn_measure_colour_correct(const float *truth, const float *test, const float *weight, size_t n, float *out)
{
    double a[4][4] = { { 0 } }, b[4][3] = { { 0 } }, total = 0;
    for (size_t i = 0; i < n; i++) {
        const double w = weight ? (double)weight[i] : 1;
        if (!(w > 0)) continue;
        const double x[4] = { (double)test[3 * i], (double)test[3 * i + 1], (double)test[3 * i + 2], 1 };
        for (int r = 0; r < 4; r++) {
            for (int c = 0; c < 4; c++)
                a[r][c] += w * x[r] * x[c];
            for (size_t c = 0; c < 3; c++)
                b[r][c] += w * x[r] * (double)truth[3 * i + c];
        }
        total += w;
    }
    /* A small regularisation towards the identity, for pictures of one colour. */
    for (int r = 0; r < 4; r++) {
        a[r][r] += 1e-4 * total + 1e-12;
        if (r < 3) b[r][r] += 1e-4 * total + 1e-12;
    }
    if (!cn_solve4(a, b)) {
        memmove(out, test, 3 * n * sizeof *out);
        return;
    }
    for (size_t i = 0; i < n; i++) {
        const double x[4] = { (double)test[3 * i], (double)test[3 * i + 1], (double)test[3 * i + 2], 1 };
        for (size_t c = 0; c < 3; c++) {
            double sum = 0;
            for (int r = 0; r < 4; r++)
                sum += x[r] * b[r][c];
            out[3 * i + c] = (float)fmin(fmax(sum, 0), 1);
        }
    }
}
