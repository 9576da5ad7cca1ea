/* conurb/export.h: what a geographer expects of a city: orthophoto, surface model, coloured points.
 * All are made tile by tile, with one tile in memory at a time. One thread a call (the pool works within). GDAL's
 * drivers are registered in the process; no other setting of GDAL or PROJ is touched. */
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

/* The light to show a tile in: fills *row, a row of that tile. ctx may hold no pool. */
typedef cn_status (*cn_survey_appearance)(void *user, const cn_context *ctx, const cn_tile *tile, cn_appearance *row);

/* A trained tile, opened only while it is worked with. Everything is borrowed. */
typedef struct cn_survey_tile {
    const char *path;           /* its tile.safetensors */
    double centre[3], radius_m; /* local metres */
    const uint32_t *views;
    uint32_t n_views; /* of the scene: the photos that it was trained on */
} cn_survey_tile;

/* What is surveyed, and how. Everything is borrowed. */
typedef struct cn_survey {
    const cn_scene *scene;
    const cn_frame *frame;
    const cn_survey_tile *tiles;
    uint32_t n_tiles;
    uint32_t width_px;        /* working width of the photos that the tiles were trained on */
    double exponent, reach;   /* a place takes from the tiles whose centre lies within reach * radius (horizontal), by
                               * distance^-exponent; as in cn_compose_options */
    cn_render_options render; /* .appearance is not looked at: it differs from tile to tile */
    cn_survey_appearance appearance; /* NULL: the mean of each tile's photos */
    void *appearance_user;
    const cn_colour *colour; /* for pictures and points; not for soundings */
    const char *view, *look; /* as in cn_colour_to_display */
    double exposure_ev;
} cn_survey;

/* A place counts where at least two photos of a tile look at it (or the only one) and a ray straight down meets
 * something of alpha 0.5 or more. Rays begin above the highest sparse points, and above whatever photos from the air
 * could show; what lies far below the lowest sparse points does not count. */

/* Metres on the ground a pixel of the photos at their working width: the median over the sparse points, two digits.
 * Without points a thousandth of the largest tile's radius. */
CN_API double cn_export_gsd(const cn_survey *survey);

/* ground_m[i]: local z of the surface below (xy_m[i]), blended between tiles; NaN where nothing counts. Memory: 64
 * bytes a place. CN_ERR_INTERRUPTED when asked to stop; what opening a tile and rendering give. */
CN_API CN_NODISCARD cn_status cn_export_heights(const cn_context *ctx, const cn_survey *survey, size_t n,
                                                const double (*xy_m)[2], double *ground_m);

typedef struct cn_raster_options {
    const char *ortho, *dsm; /* files to write, or NULL */
    double gsd_m;            /* metres a pixel; 0: cn_export_gsd */
} cn_raster_options;
typedef struct cn_raster_report {
    uint32_t width, height;      /* pixels */
    double gsd_m, left_m, top_m; /* outer corner of the first pixel, in the CRS */
    int epsg;                    /* 0 without georeference */
    uint64_t covered;            /* pixels that hold something */
} cn_raster_report;
/* Cloud-optimised GeoTIFFs in the UTM zone of the frame's origin (EPSG 326zz and 327zz; UPS near the poles), north up,
 * corners on multiples of the pixel, cropped to what is covered. ortho: 8-bit RGBA as survey->view encodes (sRGB),
 * alpha 0 where nothing is, else 255. dsm: float heights in metres, nodata -9999: above the WGS84 ellipsoid where the
 * frame's geoid was applied, else as the photos' GPS has them (above the sea); the metadata say which. Without
 * georeference the files have no CRS and are in local metres. Scratch space of 24 bytes a pixel is used beside the
 * output, and one row of 64-pixel blocks of memory. CN_ERR_USAGE for a size out of range; CN_ERR_DATA when nothing is
 * covered; CN_ERR_IO naming the file; CN_ERR_INTERRUPTED when asked to stop: files that were there stay. report may be
 * NULL. */
CN_API CN_NODISCARD cn_status cn_export_rasters(const cn_context *ctx, const cn_survey *survey,
                                                const cn_raster_options *options, cn_raster_report *report);

/* Coloured points as binary little-endian PLY: double x y z (local metres, east north up), uchar red green blue
 * (display encoded), from the depth of every photo's view as the tile nearest to it renders it; one point a cube of
 * spacing_m (0: the gsd). Edges of depth and what no second photo sees are left out. The frame is written beside it:
 * for F.ply, F.frame.json. *n_points may be NULL. Errors as above. */
CN_API CN_NODISCARD cn_status cn_export_points(const cn_context *ctx, const cn_survey *survey, const char *path,
                                               double spacing_m, uint64_t *n_points);

#ifdef __cplusplus
}
#endif
#endif
