/* What several effects do with the rows of the photos. */
#include "effect/effect.h"

#include <math.h>

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

void cn_effect_settings_add(cn_effect_settings *told, const cn_photo *photo)
{
    if (!isfinite(cn_photo_exposure_ev(photo))) return;
    told->iso |= photo->iso > 0;
    told->f_number |= photo->f_number > 0;
}
