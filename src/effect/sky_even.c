#include "effect/sky_even.h"

#include "effect/display.h"
#include "effect/sky_grid.h"

#include <math.h>

enum { X = CN_SKY_HINT_X, Y = CN_SKY_HINT_Y, MOST = 16 /* pixels along a side that are looked at */ };
/* Display-encoded: a pixel that differs by more from the one in the middle is not of the same sky. Noise differs less.
 * It is the step that tells what is darker than a sky (sky_hints.c). Not measured apart. */
#define OTHER 0.15f

/* The pixels from `from` to `to` of a hint along one axis, of which at most MOST are looked at. */
typedef struct side {
    uint32_t from, to, step;
} side;

static side side_of(uint32_t hint, uint32_t n_hints, uint32_t size)
{
    side s = { .from = hint * size / n_hints, .to = (hint + 1) * size / n_hints };
    s.step = (s.to - s.from) / MOST + 1;
    return s;
}

/* Whether a row's pixels have the colour rgb.. */
static bool row_is(const cn_pixel_store *pixels, uint32_t photo, uint32_t y, side columns, const float rgb[3])
{
    uint32_t photos[MOST] = { 0 }, n = 0;
    uint16_t px[MOST] = { 0 }, py[MOST] = { 0 };
    float rgbw[4 * MOST];
    for (uint32_t x = columns.from; x < columns.to; x += columns.step, n++) {
        photos[n] = photo;
        px[n] = (uint16_t)x;
        py[n] = (uint16_t)y;
    }
    if (cn_pixel_store_gather(pixels, n, photos, px, py, rgbw) != CN_OK) return true;
    for (uint32_t i = 0; i < n; i++) {
        float shown[3];
        cn_display(rgbw + 4 * (size_t)i, shown);
        for (int c = 0; rgbw[4 * (size_t)i + 3] > 0 && c < 3; c++)
            if (fabsf(shown[c] - rgb[c]) > OTHER) return false;
    }
    return true;
}

static bool is_even(const cn_pixel_store *pixels, uint32_t photo, side columns, side rows)
{
    const uint16_t x = (uint16_t)((columns.from + columns.to) / 2), y = (uint16_t)((rows.from + rows.to) / 2);
    float rgbw[4], rgb[3];
    if (cn_pixel_store_gather(pixels, 1, &photo, &x, &y, rgbw) != CN_OK || !(rgbw[3] > 0)) return true;
    cn_display(rgbw, rgb);
    for (uint32_t row = rows.from; row < rows.to; row += rows.step)
        if (!row_is(pixels, photo, row, columns, rgb)) return false;
    return true;
}

void cn_sky_even_keep(const cn_pixel_store *pixels, uint32_t photo, uint8_t *hint)
{
    const cn_pixel_extent size = cn_pixel_store_extent(pixels, photo);
    for (uint32_t i = 0; i < CN_SKY_HINTS; i++) {
        if (hint[i] != CN_SKY_SHOWN) continue;
        const side columns = side_of(i % X, X, size.width), rows = side_of(i / X, Y, size.height);
        if (columns.from == columns.to || rows.from == rows.to) continue; /* the photo has fewer pixels than hints */
        if (!is_even(pixels, photo, columns, rows)) hint[i] = CN_SKY_UNKNOWN;
    }
}
