#include "export/geotiff.h"

#include "base/file.h"

#include <cpl_conv.h>
#include <cpl_error.h>
#include <cpl_string.h>
#include <errno.h>
#include <gdal.h>
#include <ogr_srs_api.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static pthread_once_t once = PTHREAD_ONCE_INIT;
static void register_drivers(void)
{
    GDALAllRegister();
}

static cn_status failure(const cn_geotiff *t)
{
    if (cn_stopping(t->ctx))
        return cn_fail(CN_ERR_INTERRUPTED, "stopped while writing %s; run the same command to make it", t->path);
    const char *why = CPLGetLastErrorMsg();
    return cn_fail(CN_ERR_IO, "cannot write %s: %s", t->path, *why ? why : "GDAL does not say why");
}

/* Errors are returned, not printed. */
static void begin_quiet(void)
{
    CPLPushErrorHandler(CPLQuietErrorHandler);
    CPLErrorReset();
}

static void place_dataset(GDALDatasetH dataset, const cn_geotiff_place *place)
{
    double transform[6] = { place->left_m, place->gsd_m, 0, place->top_m, 0, -place->gsd_m };
    GDALSetGeoTransform(dataset, transform);
    if (!place->epsg) return;
    OGRSpatialReferenceH crs = OSRNewSpatialReference(NULL);
    if (OSRImportFromEPSG(crs, place->epsg) == OGRERR_NONE) GDALSetSpatialRef(dataset, crs);
    OSRDestroySpatialReference(crs);
}

static cn_status create_plain(cn_geotiff *t, const cn_geotiff_header *header)
{
    static const char *const options[] = { "TILED=YES", "BIGTIFF=IF_SAFER", "ALPHA=NON-PREMULTIPLIED",
                                           "INTERLEAVE=PIXEL", NULL };
    GDALDriverH driver = GDALGetDriverByName("GTiff");
    if (!driver || !GDALGetDriverByName("COG"))
        return cn_fail(CN_ERR_TOOL, "this GDAL cannot write cloud-optimised GeoTIFFs; version 3.1 or newer can");
    if (access(t->plain, F_OK) != 0) { /* GDAL does not give the reason when the folder is missing */
        FILE *probe = fopen(t->plain, "wb");
        if (!probe) return cn_fail(CN_ERR_IO, "cannot write %s: %s", t->path, strerror(errno));
        fclose(probe);
    }
    t->dataset = GDALCreate(driver, t->plain, (int)t->width, (int)header->height, t->rgba ? 4 : 1,
                            t->rgba ? GDT_Byte : GDT_Float32, (char **)(uintptr_t)options);
    if (!t->dataset) return failure(t);
    place_dataset(t->dataset, &header->place);
    for (size_t i = 0; header->metadata[i]; i += 2)
        GDALSetMetadataItem(t->dataset, header->metadata[i], header->metadata[i + 1], NULL);
    GDALRasterBandH band = GDALGetRasterBand(t->dataset, 1);
    static const GDALColorInterp colours[] = { GCI_RedBand, GCI_GreenBand, GCI_BlueBand, GCI_AlphaBand };
    for (int b = 0; t->rgba && b < 4; b++)
        GDALSetRasterColorInterpretation(GDALGetRasterBand(t->dataset, b + 1), colours[b]);
    if (!t->rgba) {
        GDALSetRasterNoDataValue(band, CN_GEOTIFF_NODATA);
        GDALSetDescription(band, header->band ? header->band : "surface height");
        if (header->place.epsg) GDALSetRasterUnitType(band, "metre");
    }
    return CN_OK;
}

cn_status cn_geotiff_open(cn_geotiff *t, const cn_context *ctx, const char *path, const cn_geotiff_header *header)
{
    *t = (cn_geotiff){ .ctx = ctx, .path = path, .width = header->width, .rgba = header->rgba };
    t->temporary = cn_file_temporary(path);
    t->plain = t->temporary ? cn_format("%s.plain", t->temporary) : NULL;
    if (!t->plain) return cn_fail(CN_ERR_NOMEM, "out of memory for %s", path);
    pthread_once(&once, register_drivers);
    begin_quiet();
    const cn_status status = create_plain(t, header);
    CPLPopErrorHandler();
    return status;
}

cn_status cn_geotiff_write(cn_geotiff *t, uint32_t row, uint32_t rows, void *pixels)
{
    const int bands = t->rgba ? 4 : 1, pixel = 4;
    begin_quiet();
    const CPLErr error = GDALDatasetRasterIOEx(t->dataset, GF_Write, 0, (int)row, (int)t->width, (int)rows, pixels,
                                               (int)t->width, (int)rows, t->rgba ? GDT_Byte : GDT_Float32, bands, NULL,
                                               pixel, (GSpacing)pixel * t->width, t->rgba ? 1 : 0, NULL);
    CPLPopErrorHandler();
    return error == CE_None ? CN_OK : failure(t);
}

static int CPL_STDCALL go_on(double done, const char *message, void *user)
{
    (void)done;
    (void)message;
    return !cn_stopping(user);
}

static cn_status copy_to_cog(cn_geotiff *t)
{
    const char *const options[] = {
        "COMPRESS=DEFLATE", "PREDICTOR=YES", "BLOCKSIZE=512", "BIGTIFF=IF_SAFER", "OVERVIEW_RESAMPLING=AVERAGE", NULL
    };
    GDALFlushCache(t->dataset);
    if (CPLGetLastErrorType() == CE_Failure) return failure(t);
    GDALDatasetH cog = GDALCreateCopy(GDALGetDriverByName("COG"), t->temporary, t->dataset, 0,
                                      (char **)(uintptr_t)options, go_on, (void *)(uintptr_t)t->ctx);
    if (cog) GDALClose(cog);
    return cog && CPLGetLastErrorType() != CE_Failure ? CN_OK : failure(t);
}

cn_status cn_geotiff_finish(cn_geotiff *t)
{
    begin_quiet();
    cn_status status = copy_to_cog(t);
    CPLPopErrorHandler();
    if (status == CN_OK) status = cn_file_replace(t->temporary, t->path);
    cn_geotiff_abort(t);
    return status;
}

void cn_geotiff_abort(cn_geotiff *t)
{
    begin_quiet();
    if (t->dataset) GDALClose(t->dataset);
    CPLPopErrorHandler();
    if (t->plain) unlink(t->plain);
    if (t->temporary) {
        char *overviews =
            cn_format("%s.ovr.tmp", t->temporary); /* GDAL's temporary file, which stays when it is stopped */
        if (overviews) unlink(overviews);
        free(overviews);
        unlink(t->temporary);
    }
    free(t->temporary);
    free(t->plain);
    *t = (cn_geotiff){ 0 };
}
