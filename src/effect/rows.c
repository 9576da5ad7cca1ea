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

cn_effect_settings cn_effect_settings_told(const cn_photo_index *photos, const cn_scene *scene,
                                           const cn_plan_tile *tile)
{
    cn_effect_settings told = { 0 };
    for (uint32_t i = 0; i < tile->n_photos; i++) {
        const uint32_t at = scene->views[tile->photos[i]].photo;
        if (at >= photos->n_photos || !isfinite(cn_photo_exposure_ev(&photos->photos[at]))) continue;
        told.iso |= photos->photos[at].iso > 0;
        told.f_number |= photos->photos[at].f_number > 0;
    }
    return told;
}
