#include "conurb/measure.h"

#include <math.h>
#include <string.h>

/* Black, red, yellow, white: each channel rises in its own third of the scale, so brightness grows with the error. */
static void heat(double error, float rgb[3])
{
    double t = isfinite(error) ? 3 * fmin(error / 0.25, 1) : 3;
    for (int c = 0; c < 3; c++)
        rgb[c] = (float)fmin(fmax(t - c, 0), 1);
}

void cn_measure_side_by_side(const float *truth, const float *test, uint32_t width, uint32_t height, float *out)
{
    size_t row = (size_t)3 * width;
    for (uint32_t y = 0; y < height; y++) {
        const float *a = truth + row * y, *b = test + row * y;
        float *to = out + 3 * row * y;
        memcpy(to, a, sizeof *to * row);
        memcpy(to + row, b, sizeof *to * row);
        for (uint32_t x = 0; x < width; x++) {
            double error = 0;
            for (int c = 0; c < 3; c++)
                error += fabs((double)a[3 * x + c] - b[3 * x + c]) / 3;
            heat(error, to + 2 * row + (size_t)3 * x);
        }
    }
}
