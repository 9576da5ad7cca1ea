/* The channels that a picture can show: colours, depth, normals, tiles. */
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

/* The surface point of a pixel, relative to the camera, in world axes. */
static void place_of(const cn_ask *ask, const cn_picture *p, uint32_t x, uint32_t y, double out[3])
{
    const double *r = ask->view.rotation;
    const double focal = ask->camera.params[0] * p->width / ask->camera.width;
    const double c[3] = { (x + 0.5 - p->width / 2.0) / focal, (y + 0.5 - p->height / 2.0) / focal, 1 };
    const double scale = (double)p->depth[(size_t)y * p->width + x] / sqrt(c[0] * c[0] + c[1] * c[1] + 1);
    for (int i = 0; i < 3; i++)
        out[i] = scale * (r[i] * c[0] + r[3 + i] * c[1] + r[6 + i] * c[2]);
}

/* Normals: east is red, north green, up blue, each from -1 (dark) to 1. */
static void show_normal(const cn_ask *ask, const cn_picture *p, float *rgb)
{
    for (uint32_t y = 0; y < p->height; y++)
        for (uint32_t x = 0; x < p->width; x++) {
            float *out = rgb + 3 * ((size_t)y * p->width + x);
            const uint32_t x0 = x ? x - 1 : x, x1 = x + 1 < p->width ? x + 1 : x;
            const uint32_t y0 = y ? y - 1 : y, y1 = y + 1 < p->height ? y + 1 : y;
            double left[3], right[3], above[3], below[3], n[3], u[3], v[3];
            memset(out, 0, 3 * sizeof *out);
            if (!is_there(p, (size_t)y * p->width + x)) continue;
            place_of(ask, p, x0, y, left);
            place_of(ask, p, x1, y, right);
            place_of(ask, p, x, y0, above);
            place_of(ask, p, x, y1, below);
            for (int i = 0; i < 3; i++)
                u[i] = right[i] - left[i], v[i] = above[i] - below[i];
            for (int i = 0; i < 3; i++)
                n[i] = u[(i + 1) % 3] * v[(i + 2) % 3] - u[(i + 2) % 3] * v[(i + 1) % 3];
            const double length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
            for (int i = 0; i < 3 && length > 0; i++)
                out[i] = (float)(0.5 + 0.5 * n[i] / length);
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

void cn_frame_channel(cn_channel channel, const cn_ask *ask, const cn_render_result *result, float *rgb,
                      double near_far[2])
{
    switch (channel) {
    case CN_CHANNEL_DEPTH: show_depth(result->picture, rgb, near_far); break;
    case CN_CHANNEL_NORMAL: show_normal(ask, result->picture, rgb); break;
    case CN_CHANNEL_TILES: show_tiles(result, rgb); break;
    case CN_CHANNEL_COLOUR:
    case CN_CHANNEL_OPACITY: show_opacity(result->picture, rgb); break;
    }
}
