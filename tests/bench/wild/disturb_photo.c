/* disturb_photo FROM TO EV SEED OCCLUDERS: a photo with its linear light changed by EV stops and OCCLUDERS striped
 * boxes pasted on it, at places and in colours that the seed gives. */
#include "base/rng.h"
#include "base/srgb.h"
#include "bridge/oiio.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

static float decode(float x)
{
    return (float)cn_srgb_decode(x);
}
static float encode(float x)
{
    return (float)cn_srgb_encode(x);
}

static void paste(float *rgb, uint32_t w, uint32_t h, uint64_t seed, uint32_t k)
{
    const uint32_t bw = (uint32_t)((float)w * (0.12f + 0.1f * cn_rng_float(seed, 1, k)));
    const uint32_t bh = (uint32_t)((float)h * (0.15f + 0.15f * cn_rng_float(seed, 2, k)));
    const uint32_t x0 = cn_rng_below(seed, 3, k, w - bw), y0 = cn_rng_below(seed, 4, k, h - bh);
    for (uint32_t y = y0; y < y0 + bh; y++)
        for (uint32_t x = x0; x < x0 + bw; x++)
            for (uint32_t c = 0; c < 3; c++) {
                const bool stripe = (y - y0) * 5 / bh % 2;
                rgb[3 * ((size_t)y * w + x) + c] = cn_rng_float(seed, stripe ? 5 : 6, 3 * k + c);
            }
}

int main(int argc, char **argv)
{
    if (argc != 6) {
        fprintf(stderr, "usage: disturb_photo FROM TO EV SEED OCCLUDERS\n");
        return 2;
    }
    const float gain = exp2f(strtof(argv[3], NULL));
    const uint64_t seed = strtoull(argv[4], NULL, 10);
    float *rgba = NULL;
    uint32_t w, h;
    if (cn_oiio_read_rgba(argv[1], &rgba, &w, &h) != CN_OK) {
        fprintf(stderr, "disturb_photo: %s\n", cn_error_message());
        return 1;
    }
    /* RGB in place of RGBA. */
    for (size_t i = 0; i < (size_t)w * h; i++)
        for (size_t c = 0; c < 3; c++)
            rgba[3 * i + c] = encode(fminf(gain * decode(rgba[4 * i + c]), 1));
    for (uint32_t k = 0; k < (uint32_t)atoi(argv[5]); k++)
        paste(rgba, w, h, seed, k);
    const cn_oiio_attribute none[] = { { NULL, NULL, NULL, 0 } };
    const cn_status status = cn_oiio_write_jpeg(argv[2], rgba, w, h, none);
    if (status != CN_OK) fprintf(stderr, "disturb_photo: %s\n", cn_error_message());
    free(rgba);
    return status != CN_OK;
}
