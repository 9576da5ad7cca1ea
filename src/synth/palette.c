/* Colours that a hash chooses. */
#include "synth/noise.h"
#include "synth/texture.h"

#include <math.h>

void cn_texture_colour(uint64_t hash, float rgb[3])
{
    const float hue = 6 * cn_noise_part(hash, 0), value = 0.15f + 0.6f * cn_noise_part(hash, 1);
    const float grey = 0.1f + 0.6f * cn_noise_part(hash, 2);
    for (int c = 0; c < 3; c++) {
        const float x = fmodf(hue + 4 - 2 * (float)c, 6), ramp = cn_clamp01(fabsf(x - 3) - 1);
        rgb[c] = value * (grey + (1 - grey) * ramp);
    }
}
