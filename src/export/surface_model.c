#include "export/surface_model.h"

#include <cpl_error.h>
#include <gdal.h>
#include <ogr_srs_api.h>
#include <stdlib.h>

static cn_status refuse(const cn_surface_model *m)
{
    return cn_fail(CN_ERR_FORMAT, "%s: not a surface model (GeoTIFF with one band of heights)", m->path);
}

cn_status cn_surface_model_open(cn_surface_model *m, const char *path)
{
    double t[6];
    *m = (cn_surface_model){ .path = path };
    GDALAllRegister();
    CPLPushErrorHandler(CPLQuietErrorHandler);
    m->dataset = GDALOpen(path, GA_ReadOnly);
    CPLPopErrorHandler();
    if (!m->dataset) return refuse(m);
    if (GDALGetRasterCount(m->dataset) != 1 || GDALGetGeoTransform(m->dataset, t) != CE_None || !(t[1] > 0)) {
        cn_surface_model_close(m);
        return refuse(&(cn_surface_model){ .path = path });
    }
    m->width = (uint32_t)GDALGetRasterXSize(m->dataset);
    m->height = (uint32_t)GDALGetRasterYSize(m->dataset);
    m->left_m = t[0];
    m->top_m = t[3];
    m->gsd_m = t[1];
    OGRSpatialReferenceH crs = GDALGetSpatialRef(m->dataset);
    const char *code = crs ? OSRGetAuthorityCode(crs, NULL) : NULL;
    m->epsg = code ? atoi(code) : 0;
    return CN_OK;
}

void cn_surface_model_close(cn_surface_model *m)
{
    if (m->dataset) GDALClose(m->dataset);
    m->dataset = NULL;
}

cn_status cn_surface_model_row(const cn_surface_model *m, uint32_t y, float *row)
{
    CPLPushErrorHandler(CPLQuietErrorHandler);
    const CPLErr error = GDALRasterIO(GDALGetRasterBand(m->dataset, 1), GF_Read, 0, (int)y, (int)m->width, 1, row,
                                      (int)m->width, 1, GDT_Float32, 0, 0);
    CPLPopErrorHandler();
    return error == CE_None ? CN_OK : cn_fail(CN_ERR_IO, "cannot read %s: %s", m->path, CPLGetLastErrorMsg());
}
