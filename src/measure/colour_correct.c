#include "conurb/measure.h"

#include <math.h>
#include <string.h>

/* Solves a x = b for a symmetric 4 x 4 matrix and three right-hand sides, by elimination with pivots; false when
 * singular. */
static bool solve(double a[4][4], double b[4][3])
{
    for (int k = 0; k < 4; k++) {
        int pivot = k;
        for (int i = k + 1; i < 4; i++)
            if (fabs(a[i][k]) > fabs(a[pivot][k])) pivot = i;
        if (!(fabs(a[pivot][k]) > 1e-9)) return false;
        for (int c = 0; c < 4; c++) {
            const double t = a[k][c];
            a[k][c] = a[pivot][c], a[pivot][c] = t;
        }
        for (int c = 0; c < 3; c++) {
            const double t = b[k][c];
            b[k][c] = b[pivot][c], b[pivot][c] = t;
        }
        for (int i = 0; i < 4; i++) {
            if (i == k) continue;
            const double f = a[i][k] / a[k][k];
            for (int c = 0; c < 4; c++)
                a[i][c] -= f * a[k][c];
            for (int c = 0; c < 3; c++)
                b[i][c] -= f * b[k][c];
        }
    }
    for (int k = 0; k < 4; k++)
        for (int c = 0; c < 3; c++)
            b[k][c] /= a[k][k];
    return true;
}

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
    if (!solve(a, b)) {
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
