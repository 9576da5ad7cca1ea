/* Measures seams where the tiles that own a picture meet. The scene itself may have a step there, such as a wall
 * beside a street: that step is measured in each tile's own render. */
#include "conurb/measure.h"

#include <math.h>

#define NOBODY UINT32_MAX

/* The tile that owns a whole block. */
static uint32_t block_owner(const cn_seam_frame *f, uint32_t bx, uint32_t by)
{
    const uint32_t owner = f->owner[(size_t)by * CN_TEMPORAL_BLOCK * f->width + (size_t)bx * CN_TEMPORAL_BLOCK];
    for (uint32_t y = by * CN_TEMPORAL_BLOCK; y < (by + 1) * CN_TEMPORAL_BLOCK; y++)
        for (uint32_t x = bx * CN_TEMPORAL_BLOCK; x < (bx + 1) * CN_TEMPORAL_BLOCK; x++) {
            const size_t i = (size_t)y * f->width + x;
            if (f->owner[i] != owner || f->border[i] >= CN_TEMPORAL_SHARE) return NOBODY;
        }
    return owner < f->n_tiles ? owner : NOBODY;
}

typedef struct at {
    uint32_t x, y;
} at;

static void block_sum(const float *rgb, uint32_t width, at block, double sum[3])
{
    sum[0] = sum[1] = sum[2] = 0;
    for (uint32_t y = block.y * CN_TEMPORAL_BLOCK; y < (block.y + 1) * CN_TEMPORAL_BLOCK; y++)
        for (uint32_t x = block.x * CN_TEMPORAL_BLOCK; x < (block.x + 1) * CN_TEMPORAL_BLOCK; x++)
            for (size_t c = 0; c < 3; c++)
                sum[c] += (double)rgb[3 * ((size_t)y * width + x) + c];
}

static double step(const float *rgb, uint32_t width, at a, at b)
{
    double one[3], other[3];
    block_sum(rgb, width, a, one);
    block_sum(rgb, width, b, other);
    return (fabs(one[0] - other[0]) + fabs(one[1] - other[1]) + fabs(one[2] - other[2])) /
           (3.0 * CN_TEMPORAL_BLOCK * CN_TEMPORAL_BLOCK);
}

/* Goes along a row or column of blocks; `from` is the last block that belongs to one tile. */
static void walk(cn_seam *s, const cn_seam_frame *f, at first, at by, uint32_t n)
{
    at from = first;
    uint32_t owner = NOBODY, blocks_ago = 0;
    for (uint32_t i = 0; i < n; i++) {
        const at here = { first.x + i * by.x, first.y + i * by.y };
        const uint32_t mine = block_owner(f, here.x, here.y);
        blocks_ago++;
        if (mine == NOBODY) continue;
        if (owner != NOBODY && owner != mine && blocks_ago <= CN_SEAM_GAP + 1) {
            s->n++;
            s->step += step(f->rgb, f->width, from, here);
            s->own_step +=
                (step(f->alone[owner], f->width, from, here) + step(f->alone[mine], f->width, from, here)) / 2;
        }
        owner = mine;
        from = here;
        blocks_ago = 0;
    }
}

void cn_measure_seam(cn_seam *s, const cn_seam_frame *f)
{
    const uint32_t columns = f->width / CN_TEMPORAL_BLOCK, rows = f->height / CN_TEMPORAL_BLOCK;
    for (uint32_t y = 0; y < rows; y++)
        walk(s, f, (at){ 0, y }, (at){ 1, 0 }, columns);
    for (uint32_t x = 0; x < columns; x++)
        walk(s, f, (at){ x, 0 }, (at){ 0, 1 }, rows);
}

cn_seam_figures cn_measure_seam_figures(const cn_seam *s)
{
    const double n = s->n ? (double)s->n : NAN;
    return (cn_seam_figures){ s->n, s->step / n, s->own_step / n, s->own_step > 0 ? s->step / s->own_step : NAN };
}
