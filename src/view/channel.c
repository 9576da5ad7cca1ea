/* The channels that a picture can show beside its colours. */
#include "view/frame.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Colour map of depth: near is warm and bright, far is cold. A cubic through five colours. */
static void ramp(double t, float rgb[3])
{
    static const double stops[5][3] = {
        { 0.99, 0.91, 0.55 }, { 0.95, 0.56, 0.35 }, { 0.72, 0.24, 0.46 }, { 0.35, 0.13, 0.50 }, { 0.07, 0.06, 0.20 }
    };
    const double at = (t < 0 ? 0 : t > 1 ? 1 : t) * 4;
    const int i = at >= 4 ? 3 : (int)at;
    const double f = at - i;
    for (int c = 0; c < 3; c++)
        rgb[c] = (float)((1 - f) * stops[i][c] + f * stops[i + 1][c]);
}

static bool is_there(const cn_picture *p, size_t i)
{
    return p->rgba[4 * i + 3] >= 0.5f && p->depth[i] > 0;
}

/* The range of depths, widened to powers of two, so that colours do not change when the camera moves a little. */
static void find_range(const cn_picture *p, double near_far[2])
{
    double low = INFINITY, high = 0;
    for (size_t i = 0; i < (size_t)p->width * p->height; i++) {
        if (!is_there(p, i)) continue;
        low = fmin(low, (double)p->depth[i]);
        high = fmax(high, (double)p->depth[i]);
    }
    near_far[0] = high > 0 ? exp2(floor(log2(low))) : 1;
    near_far[1] = high > 0 ? exp2(ceil(log2(high) + 1e-9)) : 2;
}

static void show_depth(const cn_picture *p, float *rgb, double near_far[2])
{
    find_range(p, near_far);
    const double scale = 1 / log(near_far[1] / near_far[0]);
    for (size_t i = 0; i < (size_t)p->width * p->height; i++) {
        if (is_there(p, i))
            ramp(log((double)p->depth[i] / near_far[0]) * scale, rgb + 3 * i);
        else
            memset(rgb + 3 * i, 0, 3 * sizeof *rgb);
    }
}

/* Values of a channel, one of CN_AOV_*; NULL: the renderer did not make it. */
static const float *values_of(const cn_render_result *result, unsigned aov)
{
    for (unsigned i = 0; i < CN_AOV_COUNT && result->aovs; i++)
        if (aov == 1u << i) return result->aovs->values[i];
    return NULL;
}

/* Normals: east is red, north green, up blue, each from -1 (dark) to 1. Black where there is no surface. */
static void show_normal(const cn_render_result *result, float *rgb)
{
    const cn_picture *p = result->picture;
    const float *n = values_of(result, CN_AOV_NORMAL);
    for (size_t i = 0; i < (size_t)p->width * p->height; i++) {
        const bool there = n && (n[3 * i] != 0 || n[3 * i + 1] != 0 || n[3 * i + 2] != 0);
        for (size_t c = 0; c < 3; c++)
            rgb[3 * i + c] = there ? 0.5f + 0.5f * n[3 * i + c] : 0;
    }
}

static void show_occlusion(const cn_render_result *result, float *rgb)
{
    const cn_picture *p = result->picture;
    const float *open = values_of(result, CN_AOV_AMBIENT_OCCLUSION);
    for (size_t i = 0; i < (size_t)p->width * p->height; i++)
        for (size_t c = 0; c < 3; c++)
            rgb[3 * i + c] = open && is_there(p, i) ? open[i] : 0;
}

/* Bright where many photos support the surface. The range ends at a power of two. */
static void show_coverage(const cn_render_result *result, float *rgb, double range[2])
{
    const cn_picture *p = result->picture;
    const float *photos = values_of(result, CN_AOV_COVERAGE);
    double most = 1;
    for (size_t i = 0; i < (size_t)p->width * p->height && photos; i++)
        if ((double)photos[i] > most) most = (double)photos[i]; /* no fmax: GCC 12 for ARM breaks on it here */
    range[0] = 0;
    range[1] = exp2(ceil(log2(most) - 1e-9));
    for (size_t i = 0; i < (size_t)p->width * p->height; i++) {
        if (photos && is_there(p, i))
            ramp(1 - (double)photos[i] / range[1], rgb + 3 * i);
        else
            memset(rgb + 3 * i, 0, 3 * sizeof *rgb);
    }
}

static void show_opacity(const cn_picture *p, float *rgb)
{
    for (size_t i = 0; i < (size_t)p->width * p->height; i++)
        for (int c = 0; c < 3; c++)
            rgb[3 * i + (size_t)c] = p->rgba[4 * i + 3];
}

void cn_frame_tile_colour(uint32_t tile, float rgb[3])
{
    /* Hues a golden angle apart differ between successive tiles, for any number of tiles. */
    const double hue = fmod(0.08 + tile * 0.61803398875, 1) * 6;
    for (int c = 0; c < 3; c++) {
        const double k = fmod(hue + (c == 0 ? 0 : c == 1 ? 4 : 2), 6);
        rgb[c] = (float)(0.25 + 0.65 * fmin(fmax(fabs(k - 3) - 1, 0), 1));
    }
}

/* One hue per tile, with the brightness of the picture. */
static void show_tiles(const cn_render_result *result, float *rgb)
{
    const cn_picture *p = result->picture;
    for (size_t i = 0; i < (size_t)p->width * p->height; i++) {
        const float *in = p->rgba + 4 * i;
        const double bright = sqrt(fmin(fmax(0.27 * in[0] + 0.67 * in[1] + 0.06 * in[2], 0), 1));
        float colour[3] = { 0, 0, 0 };
        if (result->owners && result->owners[i] != UINT32_MAX) cn_frame_tile_colour(result->owners[i], colour);
        for (int c = 0; c < 3; c++)
            rgb[3 * i + (size_t)c] = (float)((0.35 + 0.65 * bright) * (double)colour[c] * (double)in[3]);
    }
}

void cn_frame_channel(cn_channel channel, const cn_render_result *result, float *rgb, double range[2])
{
    switch (channel) {
    case CN_CHANNEL_DEPTH: show_depth(result->picture, rgb, range); break;
    case CN_CHANNEL_NORMAL: show_normal(result, rgb); break;
    case CN_CHANNEL_TILES: show_tiles(result, rgb); break;
    case CN_CHANNEL_OCCLUSION: show_occlusion(result, rgb); break;
    case CN_CHANNEL_COVERAGE: show_coverage(result, rgb, range); break;
    case CN_CHANNEL_COLOUR:
    case CN_CHANNEL_OPACITY: show_opacity(result->picture, rgb); break;
    }
}
