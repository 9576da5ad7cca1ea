/* Cloud-optimised GeoTIFFs through GDAL: rows are written to a plain file, which is converted at the end. */
#ifndef CONURB_EXPORT_GEOTIFF_H
#define CONURB_EXPORT_GEOTIFF_H
#include "conurb/base.h"

typedef struct cn_geotiff_place {
    int epsg;
    double left_m, top_m, gsd_m;
} cn_geotiff_place; /* epsg 0: no CRS */

typedef struct cn_geotiff {
    const cn_context *ctx;
    const char *path;
    char *temporary, *plain; /* names */
    void *dataset;           /* of the plain file; GDALDatasetH */
    uint32_t width;
    bool rgba; /* 8-bit RGBA, else float with nodata */
} cn_geotiff;

#define CN_GEOTIFF_NODATA (-9999.0f)

/* What a file is to hold. */
typedef struct cn_geotiff_header {
    bool rgba; /* as cn_geotiff has it */
    uint32_t width, height;
    cn_geotiff_place place;
    const char *const *metadata; /* NAME, value, NAME, value, ..., NULL */
    const char *band;            /* what heights are of; NULL: "surface height" */
} cn_geotiff_header;
/* The path is borrowed. */
CN_NODISCARD cn_status cn_geotiff_open(cn_geotiff *tiff, const cn_context *ctx, const char *path,
                                       const cn_geotiff_header *header);
/* rows * width pixels: 4 bytes each, or a float each. */
CN_NODISCARD cn_status cn_geotiff_write(cn_geotiff *tiff, uint32_t row, uint32_t rows, void *pixels);
CN_NODISCARD cn_status cn_geotiff_finish(cn_geotiff *tiff); /* on failure the old file stays */
/* Removes unfinished files; safe after finish, and when zeroed. */
void cn_geotiff_abort(cn_geotiff *tiff);
#endif
