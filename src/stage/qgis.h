/* A folder that QGIS opens: a project with the city's rasters, its tiles and the photos' places. */
#ifndef CONURB_STAGE_QGIS_H
#define CONURB_STAGE_QGIS_H
#include "city/workspace.h"
#include "conurb/export.h"

typedef struct cn_qgis {
    const cn_dataset *dataset;
    const cn_raster_report *rasters; /* of ortho.tif and dsm.tif in the folder */
    const char *about;               /* light and tiles, for the project's metadata */
} cn_qgis;
/* Writes tiles.geojson and photos.geojson (WGS84) and, last, city.qgs into the folder; each atomically. The project is
 * of QGIS 3.22's format, with relative paths. CN_ERR_IO, CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_qgis_write(const cn_qgis *qgis, const char *folder);
#endif
