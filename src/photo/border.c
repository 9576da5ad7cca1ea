#include "photo/border.h"

#include <math.h>
#include <stdbool.h>

/* Display-encoded, of a channel: noise of JPEG files next to an edge. */
#define SAME (8 / 255.0f)
/* Of the pixels of a row. In a border all but a few are the same; right inside it most are not. A dark street at night,
 * or a sky, ends slowly, or not on both sides. */
#define FLAT 0.98
#define PICTURE 0.5
/* Of a photo's width or height. */
#define WIDEST 0.25
enum { BLURRED = 3 }; /* rows between a border and the picture: a border that was resampled */

/* The rows, or columns, from one side of a photo. */
typedef struct photo_side {
    const float *first; /* pixel at the side's start */
    int64_t inwards;    /* floats to the next row */
    int64_t along;      /* floats to the row's next pixel */
    uint32_t n, length; /* rows; pixels in a row */
} photo_side;

static bool alike(const float *a, const float *b)
{
    return fabsf(a[0] - b[0]) <= SAME && fabsf(a[1] - b[1]) <= SAME && fabsf(a[2] - b[2]) <= SAME;
}

/* The share of a row that has the colour of the side's first pixel. */
static double share_alike(const photo_side *side, uint32_t row)
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < side->length; i++)
        n += alike(side->first + side->inwards * row + side->along * i, side->first);
    return n / (double)side->length;
}

/* Rows of one colour; 0 when they do not end at once. */
static uint32_t flat_rows(const photo_side *side)
{
    const uint32_t most = (uint32_t)(WIDEST * side->n);
    uint32_t rows = 0;
    while (rows < most && share_alike(side, rows) >= FLAT)
        rows++;
    if (!rows || rows == most) return 0;
    for (uint32_t i = 0; i < BLURRED; i++)
        if (share_alike(side, rows + i) < PICTURE) return rows + i;
    return 0;
}

cn_photo_border cn_photo_find_border(const float *rgba, uint32_t width, uint32_t height)
{
    const int64_t px = 4, row = px * width;
    const float *last = rgba + row * height - px; /* opposite corners */
    cn_photo_border b = { 0 };
    if (!alike(rgba, last)) return b;
    b.top = flat_rows(&(photo_side){ rgba, row, px, height, width });
    b.bottom = flat_rows(&(photo_side){ last, -row, -px, height, width });
    b.left = flat_rows(&(photo_side){ rgba, px, row, width, height });
    b.right = flat_rows(&(photo_side){ last, -px, -row, width, height });
    if (!b.top || !b.bottom) b.top = b.bottom = 0;
    if (!b.left || !b.right) b.left = b.right = 0;
    return b;
}
