#include "conurb/stage.h"
#include "base/file.h"
#include "export/point_file.h"
#include "stage/qgis.h"
#include "stage/splat.h"
#include "stage/surface.h"
#include "surface/mesh_file.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

typedef struct export_job {
    const cn_context *ctx;
    cn_city *city;
    const cn_city_export_options *options;
    cn_dataset m;
    cn_city_survey survey;
    cn_colour *colour;
    cn_appearance_spec spec;
    cn_renderer *renderer;
    char light[640];
} export_job;

static cn_status tile_appearance(void *user, const cn_context *ctx, const cn_tile *tile, cn_appearance *row)
{
    export_job *j = user;
    return cn_renderer_row(j->renderer, ctx, &j->spec, tile, row);
}

/* report: NULL, or what was written. */
static cn_status export_rasters(export_job *j, const char *ortho, const char *dsm, cn_raster_report *report)
{
    if (!ortho && !dsm) return CN_OK;
    const cn_raster_options options = { ortho, dsm, j->options->gsd_m };
    cn_raster_report r;
    CN_TRY(cn_export_rasters(j->ctx, &j->survey.survey, &options, &r));
    if (report) *report = r;
    char crs[64] = "axes and units of the poses: no GPS, so no CRS";
    if (r.epsg) snprintf(crs, sizeof crs, "EPSG:%d", r.epsg);
    cn_log(j->ctx, CN_LOG_INFO, "%u x %u pixels of %g %s, %.0f %% covered, from %.2f, %.2f (%s)", r.width, r.height,
           r.gsd_m, cn_frame_unit(&j->m.frame), 100.0 * (double)r.covered / ((double)r.width * r.height), r.left_m,
           r.top_m, crs);
    if (ortho) cn_log(j->ctx, CN_LOG_INFO, "orthophoto: %s", ortho);
    if (dsm)
        cn_log(j->ctx, CN_LOG_INFO, "surface model: %s (%s)", dsm,
               !r.epsg                    ? "local heights"
               : j->m.frame.geoid_applied ? "heights above the WGS84 ellipsoid"
                                          : "heights as the photos' GPS has them");
    return CN_OK;
}

#define WIDEST_HOUSE_M 60

/* The ground is made from the surface model, which is a temporary file when nobody wants it. */
static cn_status export_ground(export_job *j, const char *dtm, const char *dsm)
{
    if (!dtm) return CN_OK;
    char *temporary = dsm ? NULL : cn_file_temporary(dtm);
    if (!dsm && !temporary) return cn_fail(CN_ERR_NOMEM, "out of memory");
    const cn_raster_options options = { NULL, temporary, j->options->gsd_m };
    const cn_ground_task task = { &j->survey.survey, dsm ? dsm : temporary, dtm, WIDEST_HOUSE_M };
    cn_status status = dsm ? CN_OK : cn_export_rasters(j->ctx, &j->survey.survey, &options, NULL);
    if (status == CN_OK) status = cn_export_ground(j->ctx, &task);
    if (temporary) remove(temporary);
    free(temporary);
    if (status == CN_OK) cn_log(j->ctx, CN_LOG_INFO, "ground model: %s", dtm);
    return status;
}

static cn_status export_points(export_job *j, const char *points)
{
    if (!points) return CN_OK;
    uint64_t n;
    CN_TRY(cn_export_points(j->ctx, &j->survey.survey, points, j->options->gsd_m, &n));
    cn_log(j->ctx, CN_LOG_INFO, "%llu points: %s", (unsigned long long)n, points);
    return CN_OK;
}

static cn_status export_mesh(export_job *j, const char *mesh, bool tiles)
{
    const cn_pixel_store *pixels;
    if (!mesh) return CN_OK;
    CN_TRY(cn_city_surface_photos(j->ctx, &j->m, j->options->depths, &pixels));
    const cn_city_surface surface = { .renderer = j->renderer,
                                      .survey = &j->survey.survey,
                                      .appearance = &j->spec,
                                      .cube_m = j->options->gsd_m,
                                      .tiles = tiles,
                                      .n_triangles = (uint64_t)j->options->triangles,
                                      .page_px = (uint32_t)j->options->texture_px,
                                      .texel_m = j->options->texels_per_m > 0 ? 1 / j->options->texels_per_m : 0,
                                      .pixels = pixels };
    return cn_city_surface_make(j->ctx, &surface, mesh);
}

static cn_city_splats splats_of(const export_job *j)
{
    cn_city_splats splats = { j->renderer, &j->m, &j->survey.survey, &j->spec, cn_splat_options_default() };
    if (j->options->splat_budget) splats.options.budget = j->options->splat_budget;
    splats.options.limit_s = j->options->splat_limit_s;
    return splats;
}

static cn_status export_splats(export_job *j, const char *path)
{
    if (!path) return CN_OK;
    const cn_city_splats splats = splats_of(j);
    return cn_city_splats_export(j->ctx, &splats, path);
}

/* Of the mesh or of splats. */
static cn_status export_tiles(export_job *j, const char *folder)
{
    const char *content = j->options->tileset_content;
    if (!folder || !content || strcmp(content, "mesh") == 0) return export_mesh(j, folder, true);
    cn_city_splats splats = splats_of(j);
    splats.options.degree = splats.options.degree > 1 ? 1 : splats.options.degree;
    return cn_city_splats_tiles(j->ctx, &splats, j->options->splats_from, strcmp(content, "spz") == 0, folder);
}

/* A folder with a project, and all that it opens. */
static cn_status export_qgis(export_job *j, const char *folder)
{
    if (!folder) return CN_OK;
    char about[1024];
    cn_raster_report report;
    char *ortho = cn_path_join(folder, "ortho.tif"), *dsm = cn_path_join(folder, "dsm.tif");
    cn_status status = ortho && dsm ? export_rasters(j, ortho, dsm, &report) : cn_fail(CN_ERR_NOMEM, "out of memory");
    snprintf(about, sizeof about, "Conurb %s\nlight: %s\ntiles: %u", cn_version(), j->light, j->survey.survey.n_tiles);
    const cn_qgis qgis = { &j->m, &report, about };
    if (status == CN_OK) status = cn_qgis_write(&qgis, folder);
    if (status == CN_OK) cn_log(j->ctx, CN_LOG_INFO, "project for QGIS: %s/city.qgs", folder);
    free(ortho);
    free(dsm);
    return status;
}

/* By default write all three to CITY/export. */
static cn_status export_default(export_job *j)
{
    static const char *const names[] = { "export", "export/ortho.tif", "export/dsm.tif", "export/points.ply" };
    char *paths[4];
    cn_status status = CN_OK;
    for (int i = 0; i < 4; i++)
        if (!(paths[i] = cn_city_path(j->city, names[i]))) status = cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_folder_make(paths[0]);
    if (status == CN_OK) status = export_rasters(j, paths[1], paths[2], NULL);
    if (status == CN_OK) status = export_points(j, paths[3]);
    for (int i = 0; i < 4; i++)
        free(paths[i]);
    return status;
}

static cn_status export_all(export_job *j)
{
    const cn_city_export_options *o = j->options;
    CN_TRY(cn_city_survey_init(&j->survey, j->city, &j->m));
    CN_TRY(cn_colour_create(&j->colour, NULL));
    cn_survey *survey = &j->survey.survey;
    survey->colour = j->colour;
    survey->appearance = tile_appearance;
    survey->appearance_user = j;
    cn_appearance_spec_describe(&j->spec, j->light, sizeof j->light);
    survey->light = j->light;
    survey->exposure_ev += o->exposure_ev;
    if (o->view) survey->view = o->view;
    if (o->look) survey->look = o->look;
    float probe[3] = { 0 };
    CN_TRY(cn_colour_to_display(j->colour, &(cn_display_transform){ .view = survey->view, .look = survey->look }, probe,
                                1, 3)); /* report a wrong view now, not after the export */
    if (!o->ortho && !o->dsm && !o->points && !o->mesh && !o->qgis && !o->dtm && !o->tileset && !o->splats)
        return export_default(j);
    CN_TRY(export_rasters(j, o->ortho, o->dsm, NULL));
    CN_TRY(export_ground(j, o->dtm, o->dsm));
    CN_TRY(export_points(j, o->points));
    CN_TRY(export_mesh(j, o->mesh, false));
    CN_TRY(export_tiles(j, o->tileset));
    CN_TRY(export_splats(j, o->splats));
    return export_qgis(j, o->qgis);
}

/* Aligns the appearance between all tiles. */
static cn_status align_appearance(export_job *j)
{
    CN_TRY(cn_renderer_open(&j->renderer, j->ctx, j->city, &j->m, "tiles"));
    CN_TRY(cn_renderer_align(j->renderer, j->ctx, &j->spec, true, NULL));
    cn_tile_cache_close(&j->renderer->tiles); /* the export opens tiles itself */
    return CN_OK;
}

static cn_status check_mesh(const cn_city_export_options *o)
{
    if (o->texture_px != 0 && !(o->texture_px >= 64 && o->texture_px <= 16384))
        return cn_fail(CN_ERR_USAGE, "--texture %g: give the side of a texture, 64 to 16384 texels", o->texture_px);
    if (!(o->texels_per_m >= 0 && o->texels_per_m <= 10000))
        return cn_fail(CN_ERR_USAGE, "--texels %g: give texels a metre, above 0, to 10000", o->texels_per_m);
    if (!(o->triangles >= 0 && o->triangles <= 4e9))
        return cn_fail(CN_ERR_USAGE, "--triangles %g: give a number from 1 to 4 billion", o->triangles);
    if ((o->texture_px > 0 || o->texels_per_m > 0) && !o->mesh && !o->tileset)
        return cn_fail(CN_ERR_USAGE, "--texture and --texels are for a mesh; give --mesh or --3dtiles");
    if (o->triangles > 0 && !o->mesh) return cn_fail(CN_ERR_USAGE, "--triangles is for a mesh; give --mesh");
    return CN_OK;
}

/* Other programs choose their reader by the ending. */
static cn_status check_raster(const char *path)
{
    const char *dot = path ? strrchr(cn_path_base(path), '.') : NULL;
    if (!path || (dot && (strcasecmp(dot, ".tif") == 0 || strcasecmp(dot, ".tiff") == 0))) return CN_OK;
    return cn_fail(CN_ERR_USAGE, "%s: a GeoTIFF ends with .tif or .tiff", path);
}

/* Files are written after hours, one kind after another: a name that cannot be is said before. */
static cn_status check_files(const cn_city_export_options *o)
{
    const char *const files[] = { o->ortho, o->dsm, o->dtm, o->points, o->mesh, o->splats };
    bool las;
    for (size_t i = 0; i < 3; i++)
        CN_TRY(check_raster(files[i]));
    for (size_t i = 0; i < sizeof files / sizeof *files; i++)
        for (size_t j = 0; j < i; j++)
            if (files[i] && files[j] && strcmp(files[i], files[j]) == 0)
                return cn_fail(CN_ERR_USAGE, "%s is named for two exports; give each a file of its own", files[i]);
    if (o->points) CN_TRY(cn_point_file_kind(o->points, &las));
    if (o->mesh) CN_TRY(cn_mesh_check_path(o->mesh, o->texture_px > 0));
    if (o->splats) CN_TRY(cn_splats_check_path(o->splats));
    if (o->splats_from && !cn_file_exists(o->splats_from))
        return cn_fail(CN_ERR_IO, "cannot read %s: there is no such file", o->splats_from);
    for (size_t i = 0; i < sizeof files / sizeof *files; i++)
        if (files[i]) CN_TRY(cn_file_check(files[i]));
    return CN_OK;
}

static cn_status check_folder(const char *folder, const char *file)
{
    if (!folder) return CN_OK;
    CN_TRY(cn_folder_make(folder));
    char *path = cn_path_join(folder, file);
    const cn_status status = path ? cn_file_check(path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(path);
    return status;
}

/* What a city must have, then folders, which are made. */
static cn_status check_city(const cn_dataset *m, const cn_city_export_options *o)
{
    static const char *const advice = "this city has no GPS; give photos with GPS, or control points (poses.control)";
    if (o->qgis && !m->frame.georeferenced)
        return cn_fail(CN_ERR_DATA, "%s: a project for QGIS needs a place on Earth, and %s", o->qgis, advice);
    if (o->dtm && !m->frame.georeferenced)
        return cn_fail(CN_ERR_DATA, "%s: a ground model needs metres, and %s", o->dtm, advice);
    CN_TRY(check_folder(o->tileset, "tileset.json"));
    return check_folder(o->qgis, "city.qgs");
}

cn_status cn_city_export(const cn_context *ctx, cn_city *city, const cn_city_export_options *options)
{
    if (options->gsd_m < 0 || !isfinite(options->gsd_m))
        return cn_fail(CN_ERR_USAGE, "--gsd %g: give metres above 0", options->gsd_m);
    CN_TRY(check_mesh(options));
    CN_TRY(check_files(options));
    export_job j = { .ctx = ctx, .city = city, .options = options };
    CN_TRY(cn_dataset_load(ctx, city, true, &j.m));
    cn_status status = check_city(&j.m, options);
    if (status == CN_OK) status = cn_appearance_spec_parse(&j.spec, options->appearance, city, &j.m.photos);
    if (status == CN_OK) status = align_appearance(&j);
    if (status == CN_OK) status = export_all(&j);
    cn_appearance_spec_deinit(&j.spec);
    cn_renderer_destroy(&j.renderer);
    cn_colour_destroy(&j.colour);
    cn_city_survey_deinit(&j.survey);
    cn_dataset_deinit(&j.m);
    return status;
}
