/* conurb/export.h: orthophoto, digital surface model and coloured points of a city.
 *
 * Tiles are worked on one after another, so one tile is in memory at a time. Threads: no two calls with the same
 * output files; the pool works within a call. GDAL's drivers are registered in the process. No other setting of GDAL
 * or PROJ is changed. */
#ifndef CONURB_EXPORT_H
#define CONURB_EXPORT_H
#include "conurb/base.h"
#include "conurb/colour.h"
#include "conurb/geo.h"
#include "conurb/pose.h"
#include "conurb/render.h"
#include "conurb/tile.h"
#ifdef __cplusplus
extern "C" {
#endif

/* Fills *row with the appearance to render this tile with. ctx may have no pool. */
typedef cn_status (*cn_survey_appearance)(void *user, const cn_context *ctx, const cn_tile *tile, cn_appearance *row);

/* A trained tile. It is opened only while it is needed. Everything is borrowed. */
typedef struct cn_survey_tile {
    const char *path;           /* path of its tile.safetensors */
    double centre[3], radius_m; /* local metres */
    const uint32_t *views;
    uint32_t n_views; /* indices of the scene's views that the tile was trained on */
    const char *id;   /* for the metadata of files; NULL: they do not name the tile */
} cn_survey_tile;

/* What to export, and how. Everything is borrowed. */
typedef struct cn_survey {
    const cn_scene *scene;
    const cn_frame *frame;
    const cn_survey_tile *tiles;
    uint32_t n_tiles;
    uint32_t width_px;        /* working width of the photos that the tiles were trained on */
    double exponent, reach;   /* as in cn_compose_options: a place blends the tiles whose centre is nearer than reach *
                                 radius (horizontally), with weights distance^-exponent */
    cn_render_options render; /* .appearance is ignored: it differs from tile to tile */
    cn_survey_appearance appearance; /* NULL: the mean of each tile's photos */
    void *appearance_user;
    const char *light;       /* what files say of the appearance; NULL: "mean" */
    const cn_colour *colour; /* for pictures and points; heights do not need it */
    const char *view, *look; /* as in cn_colour_to_display */
    double exposure_ev;
} cn_survey;

/* Which places are exported: those that at least two photos of a tile see (or the only one), and where a ray straight
 * down meets a surface of alpha 0.5 or more. Rays begin above the highest sparse points, and above everything that
 * photos from the air could show. Surfaces far below the lowest sparse points are left out. */

/* The ground sampling distance of the photos at their working width: metres on the ground per pixel, the median over
 * the sparse points, rounded to two digits. Without points: a thousandth of the largest tile's radius. */
CN_API double cn_export_gsd(const cn_survey *survey);

/* Surface heights at n places. ground_m[i]: local z of the surface at xy_m[i], blended between tiles; NaN where there
 * is none. Memory: 64 bytes per place. CN_ERR_INTERRUPTED: asked to stop. Other errors are those of cn_tile_open and
 * cn_render_rays. */
CN_API CN_NODISCARD cn_status cn_export_heights(const cn_context *ctx, const cn_survey *survey, size_t n,
                                                const double (*xy_m)[2], double *ground_m);

typedef struct cn_raster_options {
    const char *ortho, *dsm; /* files to write, or NULL */
    double gsd_m;            /* metres per pixel; 0: cn_export_gsd */
} cn_raster_options;
typedef struct cn_raster_report {
    uint32_t width, height;      /* pixels */
    double gsd_m, left_m, top_m; /* outer corner of the first pixel, in the CRS */
    int epsg;                    /* EPSG code of the CRS; 0 without georeference */
    uint64_t covered;            /* number of pixels with data */
} cn_raster_report;
/* Writes cloud-optimised GeoTIFFs in the UTM zone of the frame's origin (EPSG 326zz and 327zz; UPS near the poles),
 * north up, cropped to the places with data, with corners on multiples of the pixel size.
 *
 * ortho: 8-bit sRGB with alpha, encoded by survey->view; alpha is 0 where there is no data, else 255. dsm: heights as
 * floats in metres, nodata -9999. Heights are above the WGS84 ellipsoid when the frame's geoid was applied, else as
 * GPS gives them (above sea level); the file's metadata say which. Without georeference the files have no CRS, and the
 * unit is that of the local frame.
 *
 * Needs 24 bytes of scratch disk per pixel, and memory for one row of 64-pixel blocks. report may be NULL.
 * CN_ERR_USAGE: a size out of range. CN_ERR_DATA: no place has data. CN_ERR_IO: the message names the file.
 * CN_ERR_INTERRUPTED: asked to stop; files that were there before do not change. */
CN_API CN_NODISCARD cn_status cn_export_rasters(const cn_context *ctx, const cn_survey *survey,
                                                const cn_raster_options *options, cn_raster_report *report);

/* A ground model from a surface model. Borrowed. */
typedef struct cn_ground_task {
    const cn_survey *survey; /* for the file's metadata */
    const char *dsm;         /* a surface model that cn_export_rasters wrote */
    const char *dtm;         /* file to write */
    double widest_m;         /* width of the widest house, m: the largest window; above 0, to 1000 */
} cn_ground_task;
/* Writes a ground model without houses, trees and cars: a cloud-optimised GeoTIFF of floats in the surface model's
 * coordinate system. A cell (0.25 m or the pixel, at most 4096 a side) has the lowest height of its pixels. Hollows
 * narrower than 4 m are errors. The progressive morphological filter (Zhang et al. 2003) opens the heights with windows
 * that double up to widest_m. A cell is no ground when it lies above the opening by more than 0.3 m + 0.3 * the
 * window's growth, at most 2.5 m. Cells that are no ground are interpolated from those around them. Nodata where the
 * surface model has none. Memory: 21 bytes for each cell. CN_ERR_USAGE: a width out of range. CN_ERR_FORMAT,
 * CN_ERR_DATA, CN_ERR_IO, CN_ERR_NOMEM, CN_ERR_INTERRUPTED: an old file stays. */
CN_API CN_NODISCARD cn_status cn_export_ground(const cn_context *ctx, const cn_ground_task *task);

/* Writes coloured points. F.ply is binary little-endian: double x y z (local frame, metres), uchar red green blue
 * (display-encoded). F.las is LAS 1.4 (ASPRS 2019) of point format 7, not compressed: places in the coordinate system
 * and with the heights of cn_export_rasters, in steps of a millimetre or finer; the system as WKT; 16-bit colours.
 * Without georeference a LAS file is in local units and names no system.
 *
 * The points come from depth maps: the nearest tile renders each photo's view. One point is kept in each cube of
 * spacing_m (0: cn_export_gsd). Left out: depth edges, and points that no second photo confirms. The frame is written
 * to F.frame.json. Memory: one view, and 24 bytes for each point at most. n_points may be NULL.
 * CN_ERR_USAGE: another ending.
 * Other errors as above. */
CN_API CN_NODISCARD cn_status cn_export_points(const cn_context *ctx, const cn_survey *survey, const char *path,
                                               double spacing_m, uint64_t *n_points);

#ifdef __cplusplus
}
#endif
#endif
