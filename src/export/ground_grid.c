#include "export/ground_grid.h"

#include "base/units.h"
#include "math/linalg.h"

#include <cpl_error.h>
#include <math.h>
#include <ogr_srs_api.h>
#include <string.h>

#define LEVER_M 100.0  /* metres between two points of a vertical line, which give its direction */
#define MAX_BLOCKS 4e6 /* 16 thousand million pixels */

static cn_status open_transforms(cn_ground_grid *g)
{
    CN_TRY(cn_geo_utm_epsg(g->frame->latitude_deg, g->frame->longitude_deg, &g->epsg));
    CPLPushErrorHandler(CPLQuietErrorHandler); /* errors are returned, not printed */
    OGRSpatialReferenceH utm = OSRNewSpatialReference(NULL), wgs84 = OSRNewSpatialReference(NULL);
    const bool known = OSRImportFromEPSG(utm, g->epsg) == OGRERR_NONE && OSRImportFromEPSG(wgs84, 4326) == OGRERR_NONE;
    OSRSetAxisMappingStrategy(utm, OAMS_TRADITIONAL_GIS_ORDER);
    OSRSetAxisMappingStrategy(wgs84, OAMS_TRADITIONAL_GIS_ORDER);
    if (known) {
        g->to_geodetic = OCTNewCoordinateTransformation(utm, wgs84);
        g->from_geodetic = OCTNewCoordinateTransformation(wgs84, utm);
    }
    OSRDestroySpatialReference(utm);
    OSRDestroySpatialReference(wgs84);
    CPLPopErrorHandler();
    if (g->to_geodetic && g->from_geodetic) return CN_OK;
    return cn_fail(CN_ERR_TOOL, "PROJ's database has no EPSG:%d; install proj-data", g->epsg);
}

/* Easting and northing of a local point. */
static cn_status project(const cn_ground_grid *g, const double local[3], double xy[2])
{
    if (!g->epsg) {
        memcpy(xy, local, sizeof(double[2]));
        return CN_OK;
    }
    double place[3];
    CN_TRY(cn_frame_to_geodetic(g->frame, local, place));
    xy[0] = place[1];
    xy[1] = place[0];
    if (OCTTransform(g->from_geodetic, 1, &xy[0], &xy[1], NULL)) return CN_OK;
    return cn_fail(CN_ERR_DATA, "latitude %.6f, longitude %.6f cannot be converted to EPSG:%d", place[0], place[1],
                   g->epsg);
}

/* The box round a tile's reach: west, south, east, north. */
static cn_status tile_box(const cn_ground_grid *g, const cn_survey_tile *tile, double reach, double box[4])
{
    box[0] = box[1] = INFINITY;
    box[2] = box[3] = -INFINITY;
    for (int i = 0; i < 64; i++) {
        /* Radius of a polygon that holds the circle. */
        const double turn = 2 * CN_PI * i / 64, r = tile->radius_m * reach / cos(CN_PI / 64);
        const double at[3] = { tile->centre[0] + r * sin(turn), tile->centre[1] + r * cos(turn), tile->centre[2] };
        double xy[2];
        CN_TRY(project(g, at, xy));
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
    *g = (cn_ground_grid){ .frame = survey->frame, .top_m = s->top_m, .gsd_m = gsd_m };
    if (!(gsd_m > 1e-4 && gsd_m < 1e4))
        return cn_fail(CN_ERR_USAGE, "--gsd %g: give metres per pixel, 0.0001 to 10000", gsd_m);
    if (g->frame->georeferenced) CN_TRY(open_transforms(g));
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
    OCTDestroyCoordinateTransformation(g->to_geodetic);
    OCTDestroyCoordinateTransformation(g->from_geodetic);
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
    if (!g->epsg) {
        const double at[3] = { x, y, g->top_m }, straight[3] = { 0, 0, -1 };
        memcpy(top, at, sizeof at);
        memcpy(down, straight, sizeof straight);
        return CN_OK;
    }
    if (!OCTTransform(g->to_geodetic, 1, &x, &y, NULL))
        return cn_fail(CN_ERR_DATA, "a corner of the raster lies outside EPSG:%d", g->epsg);
    double place[3] = { y, x, g->frame->height_m + g->top_m };
    CN_TRY(cn_frame_from_geodetic(g->frame, place, top));
    place[2] -= LEVER_M;
    CN_TRY(cn_frame_from_geodetic(g->frame, place, down));
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
    return (g->epsg ? g->frame->height_m : 0) + g->top_m - below_m;
}
