#include "export/ground_grid.h"

#include "base/units.h"
#include "math/linalg.h"

#include <math.h>

#define LEVER_M 100.0  /* metres between two points of a vertical line, which give its direction */
#define MAX_BLOCKS 4e6 /* 16 thousand million pixels */

/* The box round a tile's reach: west, south, east, north. */
static cn_status tile_box(const cn_ground_grid *g, const cn_survey_tile *tile, double reach, double box[4])
{
    box[0] = box[1] = INFINITY;
    box[2] = box[3] = -INFINITY;
    for (int i = 0; i < 64; i++) {
        /* Radius of a polygon that holds the circle. */
        const double turn = 2 * CN_PI * i / 64, r = tile->radius_m * reach / cos(CN_PI / 64);
        const double at[3] = { tile->centre[0] + r * sin(turn), tile->centre[1] + r * cos(turn), tile->centre[2] };
        double xy[3];
        CN_TRY(cn_projection_forward(&g->projection, at, xy));
        for (int k = 0; k < 2; k++) {
            box[k] = fmin(box[k], xy[k]);
            box[2 + k] = fmax(box[2 + k], xy[k]);
        }
    }
    return CN_OK;
}

cn_status cn_ground_grid_init(cn_ground_grid *g, const cn_height_sampler *s, double gsd_m)
{
    const cn_survey *survey = s->survey;
    double all[4] = { INFINITY, INFINITY, -INFINITY, -INFINITY };
    *g = (cn_ground_grid){ .projection.frame = survey->frame, .top_m = s->top_m, .gsd_m = gsd_m };
    if (!(gsd_m > 1e-4 && gsd_m < 1e4))
        return cn_fail(CN_ERR_USAGE, "--gsd %g: give metres per pixel, 0.0001 to 10000", gsd_m);
    CN_TRY(cn_projection_init(&g->projection, survey->frame));
    for (uint32_t t = 0; t < survey->n_tiles; t++) {
        double box[4];
        CN_TRY(tile_box(g, &survey->tiles[t], survey->reach, box));
        for (int k = 0; k < 2; k++) {
            all[k] = fmin(all[k], box[k]);
            all[2 + k] = fmax(all[2 + k], box[2 + k]);
        }
    }
    g->left_m = floor(all[0] / gsd_m) * gsd_m;
    g->north_m = ceil(all[3] / gsd_m) * gsd_m;
    const double across = ceil((all[2] - g->left_m) / gsd_m / CN_BLOCK),
                 down = ceil((g->north_m - all[1]) / gsd_m / CN_BLOCK);
    if (!(across >= 1 && down >= 1 && across * down <= MAX_BLOCKS))
        return cn_fail(CN_ERR_USAGE, "%.0f x %.0f pixels are too many for one file; give a larger --gsd than %g",
                       across * CN_BLOCK, down * CN_BLOCK, gsd_m);
    g->across = (uint32_t)across;
    g->down = (uint32_t)down;
    return CN_OK;
}

void cn_ground_grid_deinit(cn_ground_grid *g)
{
    cn_projection_deinit(&g->projection);
    *g = (cn_ground_grid){ 0 };
}

cn_status cn_ground_grid_range(const cn_ground_grid *g, const cn_survey_tile *tile, double reach, cn_block_range *range)
{
    double box[4];
    const double block = g->gsd_m * CN_BLOCK;
    CN_TRY(tile_box(g, tile, reach, box));
    range->x0 = (uint32_t)fmin(fmax(floor((box[0] - g->left_m) / block), 0), g->across);
    range->x1 = (uint32_t)fmin(fmax(ceil((box[2] - g->left_m) / block), 0), g->across);
    range->y0 = (uint32_t)fmin(fmax(floor((g->north_m - box[3]) / block), 0), g->down);
    range->y1 = (uint32_t)fmin(fmax(ceil((g->north_m - box[1]) / block), 0), g->down);
    return CN_OK;
}

/* The vertical line through easting and northing: its point at the top, and the direction down. */
static cn_status vertical(const cn_ground_grid *g, double x, double y, double top[3], double down[3])
{
    const double height = cn_ground_grid_height(g, 0);
    CN_TRY(cn_projection_inverse(&g->projection, (const double[3]){ x, y, height }, top));
    CN_TRY(cn_projection_inverse(&g->projection, (const double[3]){ x, y, height - LEVER_M }, down));
    for (int k = 0; k < 3; k++)
        down[k] = (down[k] - top[k]) / LEVER_M;
    return CN_OK;
}

cn_status cn_ground_grid_block(const cn_ground_grid *g, uint32_t bx, uint32_t by, cn_height_samples *q)
{
    /* Exact at the block's corners and bilinear between: over 64 pixels the curvature of projection and Earth is
     * negligible. */
    double top[4][3], down[4][3];
    for (int c = 0; c < 4; c++) {
        const double x = g->left_m + g->gsd_m * CN_BLOCK * (bx + (uint32_t)(c & 1));
        const double y = g->north_m - g->gsd_m * CN_BLOCK * (by + (uint32_t)(c >> 1));
        CN_TRY(vertical(g, x, y, top[c], down[c]));
    }
    q->n = CN_BLOCK * CN_BLOCK;
    for (size_t i = 0; i < q->n; i++) {
        const double u = ((double)(i % CN_BLOCK) + 0.5) / CN_BLOCK, v = ((double)(i / CN_BLOCK) + 0.5) / CN_BLOCK;
        const double w[4] = { (1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v };
        for (int k = 0; k < 3; k++) {
            q->top[i][k] = w[0] * top[0][k] + w[1] * top[1][k] + w[2] * top[2][k] + w[3] * top[3][k];
            q->down[i][k] = w[0] * down[0][k] + w[1] * down[1][k] + w[2] * down[2][k] + w[3] * down[3][k];
        }
        cn_normalize3(q->down[i]);
    }
    return CN_OK;
}

double cn_ground_grid_height(const cn_ground_grid *g, double below_m)
{
    return (g->projection.epsg ? g->projection.frame->height_m : 0) + g->top_m - below_m;
}
