/* What several effects do with the rows of the photos' parameters. */
#include "effect/effect.h"

void cn_effect_zero_mean(uint32_t n, uint32_t width, float *rows)
{
    for (uint32_t c = 0; c < width; c++) {
        double sum = 0;
        for (uint32_t i = 0; i < n; i++)
            sum += rows[(size_t)i * width + c];
        const float mean = (float)(sum / (n ? n : 1));
        for (uint32_t i = 0; i < n; i++)
            rows[(size_t)i * width + c] -= mean;
    }
}
