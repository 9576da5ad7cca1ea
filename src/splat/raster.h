/* Pictures of Gaussians: projected, sorted front to back, binned to tiles of 16 x 16 pixels, and composited. The same
 * instruction set gives the same bits, whatever the number of threads. */
#ifndef CONURB_SPLAT_RASTER_H
#define CONURB_SPLAT_RASTER_H
#include "splat/project.h"

enum { CN_RASTER_CHUNKS = 64 };
typedef struct cn_raster {
    cn_pool *pool;
    const cn_splat_kernel *kernel;
    size_t most; /* Gaussians */
    cn_flat_splat *flats;
    /* The Gaussians that the picture shows: in the order of their numbers, and front to back. */
    uint32_t *visible, n_visible, *sorted, *spare, *keys, *spare_keys;
    uint32_t tiles_x, tiles_y, *begin; /* of each tile's part of the list */
    uint32_t *list, n_entries;
    float (*slots)[CN_SPLAT_SUMS];
    size_t most_tiles, most_entries;
    uint32_t *counts; /* of chunks */
    size_t most_counts;
    double *errors; /* of each tile; after a step */
    float *buffers; /* of each worker */
} cn_raster;
/* Room for `most` Gaussians. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_raster_init(cn_raster *raster, cn_pool *pool, const cn_splat_kernel *kernel, size_t most);
void cn_raster_deinit(cn_raster *raster); /* fine when zeroed */

/* Gaussians as rows (project.h). Borrowed. */
typedef struct cn_splat_rows {
    const float *rows;
    size_t n;
    uint32_t degree;
} cn_splat_rows;
/* Prepares a picture: fills flats, visible, sorted, begin and list. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_raster_bin(cn_raster *raster, const cn_splat_camera *camera, const cn_splat_rows *rows);
/* Composites it over black: rgb[height * width * 3], and, where light is not NULL, what passes through each pixel. */
void cn_raster_draw(cn_raster *raster, const cn_splat_camera *camera, float *rgb, float *light);

/* What a picture is to be: for each tile [4][16][16] bytes, red, green, blue (over black) and opacity. Beyond the
 * picture's edges they are ignored. */
static inline size_t cn_raster_target_size(uint32_t width, uint32_t height)
{
    const size_t x = (width + CN_SPLAT_TILE - 1) / CN_SPLAT_TILE, y = (height + CN_SPLAT_TILE - 1) / CN_SPLAT_TILE;
    return x * y * 4 * CN_SPLAT_TILE_PIXELS;
}
/* Composites it, and fills the slots with sums for the gradient of half the squared differences to the target, over
 * colours and light. Returns the sum of the squared differences of colours; errors: of each tile. */
double cn_raster_step(cn_raster *raster, const cn_splat_camera *camera, const uint8_t *target);
/* The sums of a visible Gaussian over its tiles. */
void cn_raster_sums(const cn_raster *raster, uint32_t splat, float sums[CN_SPLAT_SUMS]);
#endif
