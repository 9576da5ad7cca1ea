/* Sums of a raster, in blocks, in a scratch file, so that they need not fit into memory. */
#ifndef CONURB_EXPORT_BLOCKS_H
#define CONURB_EXPORT_BLOCKS_H
#include "export/ground_grid.h"

/* Of one pixel: weighted sums of premultiplied colour, alpha and depth below the top, and of the weights. */
typedef struct cn_pixel_sum {
    float rgb[3], alpha, below, weight;
} cn_pixel_sum;
typedef cn_pixel_sum cn_block_sums[CN_BLOCK * CN_BLOCK];

typedef struct cn_blocks {
    int fd;
    char *path;
    uint32_t across, down;
} cn_blocks;
/* Begins with zeros. The file is made in the folder of `path` and has no name: it vanishes when it is closed, or with
 * the process. */
CN_NODISCARD cn_status cn_blocks_open(cn_blocks *blocks, const char *path, uint32_t across, uint32_t down);
void cn_blocks_close(cn_blocks *blocks);
CN_NODISCARD cn_status cn_blocks_read(const cn_blocks *blocks, uint32_t x, uint32_t y, cn_pixel_sum *sums);
CN_NODISCARD cn_status cn_blocks_write(const cn_blocks *blocks, uint32_t x, uint32_t y, const cn_pixel_sum *sums);
#endif
