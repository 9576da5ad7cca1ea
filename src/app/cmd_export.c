#include "app.h"

#include "conurb/view.h"

typedef struct options {
    cn_city_export_options export;
    const char *page;
} options;

static const cn_app_option table[] = {
    { "ortho", "F.tif",
      "orthophoto, the city seen straight from above: cloud-optimised GeoTIFF, 8-bit sRGB with alpha, UTM", CN_APP_TEXT,
      offsetof(options, export.ortho), NULL },
    { "dsm", "F.tif", "surface model, heights in metres: cloud-optimised GeoTIFF", CN_APP_TEXT,
      offsetof(options, export.dsm), NULL },
    { "points", "F.ply", "coloured points in local metres. F.frame.json beside it places them on Earth", CN_APP_TEXT,
      offsetof(options, export.points), NULL },
    { "mesh", "F.ply",
      "triangles with colours and normals, in local metres: F.ply, F.obj or F.glb (glTF, y up). F.frame.json beside it "
      "places them on Earth",
      CN_APP_TEXT, offsetof(options, export.mesh), NULL },
    { "page", "DIR",
      "folder for a web page, to open from disk or to put on a web server: views, films, the plan, lights, scores",
      CN_APP_TEXT, offsetof(options, page), NULL },
    { "gsd", "METRES",
      "size of a pixel on the ground, distance between points, and length of a triangle's side; by default as fine as "
      "the photos",
      CN_APP_NUMBER, offsetof(options, export.gsd_m), NULL },
    { "appearance", "LIGHT", "the light to show, as in `conurb render`", CN_APP_TEXT,
      offsetof(options, export.appearance), NULL },
    { "view", "NAME", "how linear colours are encoded for the screen", CN_APP_TEXT, offsetof(options, export.view),
      "sRGB ACES" },
    { "look", "NAME", "a look of the colour config, applied before the view", CN_APP_TEXT,
      offsetof(options, export.look), NULL },
    { "exposure", "STOPS", "make the picture brighter (or darker, below 0) by so many stops", CN_APP_NUMBER,
      offsetof(options, export.exposure_ev), NULL },
    { 0 }
};

static cn_status run_export(const cn_context *ctx, const cn_app_call *call)
{
    const options *o = call->options;
    cn_city *city;
    CN_TRY(cn_city_open(&city, call->operands[0]));
    const bool others = o->export.ortho || o->export.dsm || o->export.points || o->export.mesh || !o->page;
    cn_status status = others ? cn_city_export(ctx, city, &o->export) : CN_OK;
    if (status == CN_OK && o->page) status = cn_viewer_export(ctx, city, o->page);
    cn_city_close(&city);
    return status;
}

const cn_app_command cn_app_export = {
    .name = "export",
    .summary = "write an orthophoto, a surface model, points or a mesh of the whole city",
    .forms = "CITY",
    .about = "Give one or more of --ortho, --dsm, --points, --mesh and --page. Without any, the orthophoto, the "
             "surface model "
             "and the points are written to CITY/export.",
    .example = "conurb export beach --ortho beach.tif --gsd 0.1",
    .min_operands = 1,
    .max_operands = 1,
    .options = table,
    .size = sizeof(options),
    .run = run_export,
};
