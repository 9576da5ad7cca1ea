/* A raster on the ground, north up, in the UTM zone of the place (or in local metres), and the vertical line through
 * each pixel. */
#ifndef CONURB_EXPORT_GROUND_GRID_H
#define CONURB_EXPORT_GROUND_GRID_H
#include "export/height_sampler.h"
#include "export/projection.h"

enum { CN_BLOCK = 64 }; /* pixels a side of a block; a grid is whole blocks */

typedef struct cn_ground_grid {
    cn_projection projection;
    double top_m;                  /* local z at the origin that vertical lines begin at */
    double gsd_m, left_m, north_m; /* pixel, and outer corner of the first pixel */
    uint32_t across, down;         /* blocks */
} cn_ground_grid;

/* A grid that holds all places within the reach of the survey's tiles. CN_ERR_USAGE: it would be too large. */
CN_NODISCARD cn_status cn_ground_grid_init(cn_ground_grid *grid, const cn_height_sampler *sampler, double gsd_m);
void cn_ground_grid_deinit(cn_ground_grid *grid);
/* The blocks that a tile reaches: first and one past the last. */
typedef struct cn_block_range {
    uint32_t x0, y0, x1, y1;
} cn_block_range;
CN_NODISCARD cn_status cn_ground_grid_range(const cn_ground_grid *grid, const cn_survey_tile *tile, double reach,
                                            cn_block_range *range);
/* top and down of the CN_BLOCK * CN_BLOCK pixels of a block, rows southwards. */
CN_NODISCARD cn_status cn_ground_grid_block(const cn_ground_grid *grid, uint32_t x, uint32_t y,
                                            cn_height_samples *samples);
/* Height, in the CRS's sense, of what lies below_m below the top. */
double cn_ground_grid_height(const cn_ground_grid *grid, double below_m);
#endif
