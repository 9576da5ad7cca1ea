#include "conurb/measure.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

double cn_measure_psnr(const float *truth, const float *test, const float *weight, size_t n)
{
    double sum = 0, total = 0;
    for (size_t i = 0; i < n; i++) {
        double w = weight ? weight[i] : 1;
        if (!(w > 0)) continue;
        double square = 0;
        for (int c = 0; c < 3; c++) {
            double d = (double)truth[3 * i + c] - test[3 * i + c];
            square += d * d;
        }
        sum += w * square;
        total += w;
    }
    if (!(total > 0)) return NAN;
    return sum == 0 ? INFINITY : -10 * log10(sum / (3 * total));
}

void cn_eval_deinit(cn_eval *eval)
{
    for (uint32_t i = 0; i < eval->n_photos; i++)
        free(eval->photos[i].name);
    free(eval->photos);
    memset(eval, 0, sizeof *eval);
}
