#include "render_options.h"

#include "conurb/view.h"

#include <string.h>

#define PAGE_MB 32

typedef struct options {
    cn_city_export_options export;
    cn_viewer_page page;
    const char *camera;
    cn_city_render_options render; /* of the camera */
    double width, frames, budget, minutes;
} options;

static const cn_app_option table[] = {
    { "ortho", "F.tif",
      "orthophoto, the city seen straight from above: cloud-optimised GeoTIFF, 8-bit sRGB with alpha, UTM", CN_APP_TEXT,
      offsetof(options, export.ortho), NULL },
    { "dsm", "F.tif", "surface model, heights in metres: cloud-optimised GeoTIFF", CN_APP_TEXT,
      offsetof(options, export.dsm), NULL },
    { "dtm", "F.tif",
      "ground model, the surface model without houses, trees and cars: cloud-optimised GeoTIFF. Not in a city without "
      "GPS, whose unit is not the metre",
      CN_APP_TEXT, offsetof(options, export.dtm), NULL },
    { "points", "F.ply",
      "coloured points: F.ply in local metres, with F.frame.json beside it to place them on Earth, or F.las (LAS 1.4) "
      "in UTM",
      CN_APP_TEXT, offsetof(options, export.points), NULL },
    { "mesh", "F.ply",
      "triangles with colours and normals, in local metres: F.ply, F.obj or F.glb (glTF, y up). F.frame.json beside it "
      "places them on Earth",
      CN_APP_TEXT, offsetof(options, export.mesh), NULL },
    { "texture", "PX",
      "textures of the mesh (.glb or .obj) and of 3D Tiles instead of colours of vertices: side of a texture, 64 to "
      "16384 texels, such as 4096",
      CN_APP_NUMBER, offsetof(options, export.texture_px), NULL },
    { "texels", "N", "texels of a texture a metre of the surface; by default one a --gsd", CN_APP_NUMBER,
      offsetof(options, export.texels_per_m), NULL },
    { "triangles", "N", "number of triangles of the mesh; more where its border needs them", CN_APP_NUMBER,
      offsetof(options, export.triangles), NULL },
    { "depths", "FROM",
      "where the mesh's depths come from. stereo (by default): the depths that the tiles show, moved to where the "
      "photos match. field: as the tiles show them",
      CN_APP_CHOICE, offsetof(options, export.depths), "stereo field" },
    { "3dtiles", "DIR", "the mesh as 3D Tiles 1.1 on Earth, with levels of detail: tileset.json and GLB files",
      CN_APP_TEXT, offsetof(options, export.tileset), NULL },
    { "content", "WHAT",
      "what 3D Tiles hold: mesh (by default); splats, Gaussians by KHR_gaussian_splatting; or spz, the same "
      "compressed, which CesiumJS wants",
      CN_APP_CHOICE, offsetof(options, export.tileset_content), "mesh splats spz" },
    { "splats", "F.ply",
      "Gaussians that 3DGS viewers show, in one light, fitted to the tiles' own pictures: F.ply in local metres, z up, "
      "or F.spz, y up. F.frame.json beside it places them on Earth",
      CN_APP_TEXT, offsetof(options, export.splats), NULL },
    { "budget", "N", "number of splats at most, 1000 to 50 million; by default a million", CN_APP_NUMBER,
      offsetof(options, budget), NULL },
    { "minutes", "N", "end the fit of the splats after so many minutes; by default it ends when it is done",
      CN_APP_NUMBER, offsetof(options, minutes), NULL },
    { "qgis", "DIR", "folder with a project for QGIS, city.qgs: orthophoto, surface model, tiles, the photos' places",
      CN_APP_TEXT, offsetof(options, export.qgis), NULL },
    { "page", "DIR",
      "folder for a web page, to open from disk or to put on a web server: views, films, the plan, lights, scores",
      CN_APP_TEXT, offsetof(options, page.dir), NULL },
    { "live", NULL,
      "with --page: also the city in 3D, as Gaussians in live.html with a viewer of its own (WebGL 2), with a slider "
      "between the lights of --lights",
      CN_APP_FLAG, offsetof(options, page.live), NULL },
    { "lights", "A,B,...",
      "with --live: lights as --appearance takes them, NAME=LIGHT to give one a name; the first is that of the "
      "Gaussians. By default the light of --appearance alone",
      CN_APP_TEXT, offsetof(options, page.lights), NULL },
    { "size", "MB", "with --live: how large the files may be; the number of Gaussians follows. By default 32",
      CN_APP_NUMBER, offsetof(options, page.size_mb), NULL },
    { "from", "F.ply",
      "for --live and --content: Gaussians that `conurb export --splats` wrote under the first light. Without it they "
      "are made in --minutes, for --live as many as --size has room for",
      CN_APP_TEXT, offsetof(options, page.splats), NULL },
    { "camera", "F.chan",
      "cameras of the flight that `conurb render` makes with the same --path, --orbit, --width and --frames: F.chan "
      "(Nuke) or F.glb (glTF), y up. `conurb render --path` reads both",
      CN_APP_TEXT, offsetof(options, camera), NULL },
    CN_OPTION_PATH,
    CN_OPTION_ORBIT,
    CN_OPTION_HEIGHT,
    CN_OPTION_WIDTH,
    { "frames", "N", "number of the camera's frames, spread evenly over the path", CN_APP_NUMBER,
      offsetof(options, frames), NULL },
    { "gsd", "METRES",
      "size of a pixel on the ground, distance between points, and length of a triangle's side; by default as fine as "
      "the photos",
      CN_APP_NUMBER, offsetof(options, export.gsd_m), NULL },
    { "appearance", "LIGHT", "the light to show, as in `conurb render`", CN_APP_TEXT,
      offsetof(options, export.appearance), NULL },
    { "view", "NAME", "how linear colours are encoded for the screen: sRGB, ACES, Raw, or a view of $OCIO", CN_APP_TEXT,
      offsetof(options, export.view), "sRGB ACES" },
    { "look", "NAME", "a look of the colour config, applied before the view", CN_APP_TEXT,
      offsetof(options, export.look), NULL },
    { "exposure", "STOPS", "make the picture brighter (or darker, below 0) by so many stops", CN_APP_NUMBER,
      offsetof(options, export.exposure_ev), NULL },
    { 0 }
};

static cn_status export_page(const cn_context *ctx, cn_city *city, const options *o)
{
    cn_viewer_page page = o->page;
    if (!page.lights) page.lights = o->export.appearance;
    if (!page.size_mb) page.size_mb = PAGE_MB;
    page.view = o->export.view;
    page.look = o->export.look;
    page.exposure_ev = o->export.exposure_ev;
    page.limit_s = 60 * o->minutes;
    return cn_viewer_export(ctx, city, &page);
}

static bool has_splat_tiles(const cn_city_export_options *o)
{
    return o->tileset && o->tileset_content && strcmp(o->tileset_content, "mesh") != 0;
}

static cn_status check_page(const cn_viewer_page *page, const cn_city_export_options *others)
{
    if (others->tileset_content && !others->tileset)
        return cn_fail(CN_ERR_USAGE, "--content: give the folder of the tiles by --3dtiles DIR");
    if (page->live && !page->dir) return cn_fail(CN_ERR_USAGE, "--live: give the page's folder by --page DIR");
    if (!page->live && (page->lights || page->size_mb))
        return cn_fail(CN_ERR_USAGE, "--lights and --size belong to --page DIR --live");
    if (page->splats && !page->live && !has_splat_tiles(others))
        return cn_fail(CN_ERR_USAGE, "--from belongs to --page DIR --live and to --3dtiles DIR --content splats");
    return CN_OK;
}

/* What only a camera takes would be ignored without one, and all that is due by default be exported instead. */
static cn_status check_camera(const options *o)
{
    const cn_city_render_options *r = &o->render;
    if (o->camera || !(r->path || r->orbit || o->width > 0 || o->frames > 0)) return CN_OK;
    return cn_fail(CN_ERR_USAGE,
                   "--path, --orbit, --width and --frames are for a camera; give --camera F.chan or F.glb");
}

static cn_status run_export(const cn_context *ctx, const cn_app_call *call)
{
    const options *o = call->options;
    cn_city_render_options render = o->render;
    cn_city *city;
    if (o->width < 0 || o->width > 16384 || o->frames < 0 || o->frames > 1e6)
        return cn_fail(CN_ERR_USAGE, "--width: give 0 to 16384 pixels; --frames: give 0 to 1000000");
    CN_TRY(check_page(&o->page, &o->export));
    CN_TRY(check_camera(o));
    render.width_px = (uint32_t)o->width;
    render.n_frames = (uint32_t)o->frames;
    if (o->budget != 0 && !(o->budget >= 1000 && o->budget <= 5e7))
        return cn_fail(CN_ERR_USAGE, "--budget %g: give 1000 to 50000000 splats", o->budget);
    if (!(o->minutes >= 0 && o->minutes < 1e6))
        return cn_fail(CN_ERR_USAGE, "--minutes %g: give minutes above 0", o->minutes);
    cn_city_export_options export = o->export;
    export.splat_budget = (uint32_t)o->budget;
    export.splat_limit_s = 60 * o->minutes;
    export.splats_from = o->page.splats;
    CN_TRY(cn_city_open(&city, call->operands[0]));
    const bool named = o->page.dir || o->camera;
    const bool others = o->export.ortho || o->export.dsm || o->export.dtm || o->export.points || o->export.mesh ||
                        o->export.qgis || o->export.tileset || o->export.splats || !named;
    cn_status status = o->camera ? cn_city_export_camera(ctx, city, &render, o->camera) : CN_OK; /* takes seconds */
    if (status == CN_OK && others) status = cn_city_export(ctx, city, &export);
    if (status == CN_OK && o->page.dir) status = export_page(ctx, city, o);
    cn_city_close(&city);
    return status;
}

const cn_app_command cn_app_export = {
    .name = "export",
    .summary = "write orthophoto, surface model, points, mesh, splats, cameras of the whole city",
    .forms = "CITY",
    .about = "Give one or more of --ortho, --dsm, --dtm, --points, --mesh, --3dtiles, --splats, --qgis, --camera and "
             "--page. "
             "Without any, the "
             "orthophoto, "
             "the surface model and the points are written to CITY/export.",
    .example = "conurb export beach --ortho beach.tif --gsd 0.1",
    .min_operands = 1,
    .max_operands = 1,
    .options = table,
    .size = sizeof(options),
    .computes = true,
    .run = run_export,
};
