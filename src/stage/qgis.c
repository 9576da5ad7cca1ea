#include "stage/qgis.h"

#include "base/file.h"
#include "base/json.h"
#include "base/number.h"
#include "base/units.h"
#include "export/projection.h"
#include "plan/plan.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* ---- the photos' places ---- */

static json_t *photo_feature(const cn_dataset *m, const cn_view *view, bool held_out)
{
    double centre[3], place[3];
    const double *forward = view->rotation + 6;
    cn_view_centre(view, centre);
    if (cn_frame_to_geodetic(&m->frame, centre, place) != CN_OK) return NULL;
    const double heading = cn_degrees(atan2(forward[0], forward[1]));
    return json_pack("{s:s, s:{s:s, s:[o, o, o]}, s:{s:s, s:o, s:o, s:o, s:b}}", "type", "Feature", "geometry", "type",
                     "Point", "coordinates", cn_json_real(place[1]), cn_json_real(place[0]), cn_json_real(place[2]),
                     "properties", "name", view->name, "height_m", cn_json_real(place[2]), "heading_deg",
                     cn_json_real(heading < 0 ? heading + 360 : heading), "pitch_deg",
                     cn_json_real(cn_degrees(asin(fmin(fmax(forward[2], -1), 1)))), "held_out", (int)held_out);
}

static cn_status write_photos(const cn_dataset *m, const char *path)
{
    const cn_scene *scene = &m->scene;
    json_t *features = json_array();
    bool *held_out = calloc(scene->n_views + (size_t)1, sizeof *held_out);
    cn_status status = held_out && features ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for %s", path);
    for (uint32_t t = 0; status == CN_OK && t < m->plan.n_tiles; t++)
        for (uint32_t i = 0; i < m->plan.tiles[t].n_held_out; i++)
            held_out[m->plan.tiles[t].held_out[i]] = true;
    for (uint32_t i = 0; status == CN_OK && i < scene->n_views; i++) {
        json_t *feature = photo_feature(m, &scene->views[i], held_out[i]);
        if (feature) json_array_append_new(features, feature);
    }
    json_t *root = json_pack("{s:s, s:o}", "type", "FeatureCollection", "features", features);
    if (status == CN_OK) status = root ? cn_json_save(root, path) : cn_fail(CN_ERR_NOMEM, "out of memory for %s", path);
    json_decref(root);
    free(held_out);
    return status;
}

/* ---- the project ---- */

typedef struct crs {
    int epsg;
    char *wkt;
} crs;

typedef struct layer {
    const char *id, *name, *source, *style;
    bool raster, in_utm, shown;
} layer;

#define SYMBOL(type, symbol, properties)                                                                               \
    "<renderer-v2 type=\"singleSymbol\"><symbols><symbol type=\"" type "\" name=\"0\"><layer class=\"" symbol          \
    "\" enabled=\"1\">" properties "</layer></symbol></symbols></renderer-v2>"
#define PROPERTY(key, value) "<prop k=\"" key "\" v=\"" value "\"/>"

/* From the top of the map to its bottom. QGIS gives a layer another id when its own has 10 letters or fewer. */
static const layer layers[] = {
    { "conurb_layer_photos", "Photos", "./photos.geojson",
      SYMBOL("marker", "SimpleMarker",
             PROPERTY("name", "circle") PROPERTY("color", "255,170,0,255") PROPERTY("size", "1.6")
                 PROPERTY("outline_color", "40,40,40,255")),
      false, false, true },
    { "conurb_layer_tiles", "Tiles", "./tiles.geojson|geometrytype=Polygon",
      SYMBOL("fill", "SimpleFill",
             PROPERTY("style", "no") PROPERTY("color", "0,0,0,0") PROPERTY("outline_color", "0,120,215,255")
                 PROPERTY("outline_width", "0.5")),
      false, false, true },
    { "conurb_layer_ortho", "Orthophoto", "./ortho.tif",
      "<pipe><rasterrenderer type=\"multibandcolor\" redBand=\"1\" greenBand=\"2\" blueBand=\"3\" alphaBand=\"4\" "
      "opacity=\"1\"/></pipe>",
      true, true, true },
    { "conurb_layer_dsm", "Surface model", "./dsm.tif",
      "<pipe><rasterrenderer type=\"hillshade\" band=\"1\" azimuth=\"315\" angle=\"45\" zfactor=\"1\" "
      "multidirection=\"0\" alphaBand=\"-1\" opacity=\"1\"/></pipe>",
      true, true, false },
};
enum { LAYERS = sizeof layers / sizeof *layers };

static void write_text(FILE *out, const char *text)
{
    for (; *text; text++) {
        const char *escaped = *text == '<' ? "&lt;" : *text == '>' ? "&gt;" : *text == '&' ? "&amp;" : NULL;
        if (escaped)
            fputs(escaped, out);
        else if ((unsigned char)*text >= ' ' || *text == '\n')
            fputc(*text, out);
    }
}

/* QGIS goes by the WKT. */
static void write_crs(FILE *out, const char *element, const crs *system)
{
    fprintf(out, "<%s><spatialrefsys><wkt>", element);
    write_text(out, system->wkt);
    fprintf(out, "</wkt><authid>EPSG:%d</authid></spatialrefsys></%s>\n", system->epsg, element);
}

static void write_layer(FILE *out, const layer *l, const crs *system)
{
    fprintf(out, "<maplayer type=\"%s\"%s>\n<id>%s</id><datasource>%s</datasource><layername>%s</layername>\n",
            l->raster ? "raster" : "vector",
            l->raster                     ? ""
            : strstr(l->source, "photos") ? " geometry=\"Point\" wkbType=\"PointZ\""
                                          : " geometry=\"Polygon\" wkbType=\"Polygon\"",
            l->id, l->source, l->name);
    write_crs(out, "srs", system);
    fprintf(out, "<provider%s>%s</provider>\n%s\n</maplayer>\n", l->raster ? "" : " encoding=\"UTF-8\"",
            l->raster ? "gdal" : "ogr", l->style);
}

/* systems: of the rasters, and WGS84. */
static void write_project(const cn_qgis *q, const crs systems[2], FILE *out)
{
    const cn_raster_report *r = q->rasters;
    fprintf(out, "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"
                 "<qgis version=\"3.22.16\" projectname=\"Conurb\">\n<title>Conurb</title>\n");
    write_crs(out, "projectCrs", &systems[0]);
    fputs("<projectMetadata><title>Conurb</title><abstract>", out);
    write_text(out, q->about);
    fputs("</abstract></projectMetadata>\n<layer-tree-group>\n", out);
    for (int i = 0; i < LAYERS; i++)
        fprintf(out,
                "<layer-tree-layer id=\"%s\" name=\"%s\" source=\"%s\" providerKey=\"%s\" checked=\"Qt::%s\" "
                "expanded=\"0\"/>\n",
                layers[i].id, layers[i].name, layers[i].source, layers[i].raster ? "gdal" : "ogr",
                layers[i].shown ? "Checked" : "Unchecked");
    fprintf(out,
            "</layer-tree-group>\n<mapcanvas name=\"theMapCanvas\"><units>meters</units><extent><xmin>%.4f</xmin>"
            "<ymin>%.4f</ymin><xmax>%.4f</xmax><ymax>%.4f</ymax></extent><rotation>0</rotation>\n",
            r->left_m, r->top_m - r->height * r->gsd_m, r->left_m + r->width * r->gsd_m, r->top_m);
    write_crs(out, "destinationsrs", &systems[0]);
    fputs("</mapcanvas>\n<projectlayers>\n", out);
    for (int i = 0; i < LAYERS; i++)
        write_layer(out, &layers[i], &systems[!layers[i].in_utm]);
    fputs("</projectlayers>\n<layerorder>\n", out);
    for (int i = 0; i < LAYERS; i++)
        fprintf(out, "<layer id=\"%s\"/>\n", layers[i].id);
    fputs("</layerorder>\n<properties><Paths><Absolute type=\"bool\">false</Absolute></Paths>"
          "<SpatialRefSys><ProjectionsEnabled "
          "type=\"int\">1</ProjectionsEnabled></SpatialRefSys></properties>\n</qgis>\n",
          out);
}

static cn_status save_project(const cn_qgis *q, const char *path)
{
    crs systems[2] = { { q->rasters->epsg, NULL }, { 4326, NULL } };
    cn_writer writer = { 0 };
    cn_status status = cn_epsg_wkt(systems[0].epsg, &systems[0].wkt);
    if (status == CN_OK) status = cn_epsg_wkt(systems[1].epsg, &systems[1].wkt);
    if (status == CN_OK) status = cn_writer_open(&writer, path);
    if (status == CN_OK) {
        const locale_t before = cn_number_begin();
        write_project(q, systems, writer.stream);
        cn_number_end(before);
        status = cn_writer_commit(&writer);
    }
    free(systems[0].wkt);
    free(systems[1].wkt);
    return status;
}

cn_status cn_qgis_write(const cn_qgis *q, const char *folder)
{
    const cn_dataset *m = q->dataset;
    const cn_plan_input input = { .scene = &m->scene, .photos = &m->photos, .frame = &m->frame };
    char *tiles = cn_path_join(folder, "tiles.geojson"), *photos = cn_path_join(folder, "photos.geojson");
    char *project = cn_path_join(folder, "city.qgs");
    cn_status status =
        tiles && photos && project ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the files in %s", folder);
    if (status == CN_OK) status = cn_plan_write_geojson(&m->plan, &input, tiles);
    if (status == CN_OK) status = write_photos(m, photos);
    if (status == CN_OK) status = save_project(q, project);
    free(tiles);
    free(photos);
    free(project);
    return status;
}
