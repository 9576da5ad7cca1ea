/* Reads a surface model that cn_export_rasters wrote. */
#ifndef CONURB_EXPORT_SURFACE_MODEL_H
#define CONURB_EXPORT_SURFACE_MODEL_H
#include "conurb/export.h"

typedef struct cn_surface_model {
    void *dataset; /* GDALDatasetH */
    const char *path;
    uint32_t width, height;
    int epsg; /* 0: none */
    double left_m, top_m, gsd_m;
} cn_surface_model;
/* The path is borrowed. CN_ERR_FORMAT: it is no such file. */
CN_NODISCARD cn_status cn_surface_model_open(cn_surface_model *model, const char *path);
void cn_surface_model_close(cn_surface_model *model); /* fine when zeroed */
/* A row of heights; CN_GEOTIFF_NODATA where there are none. */
CN_NODISCARD cn_status cn_surface_model_row(const cn_surface_model *model, uint32_t y, float *row);
#endif
