#include "app.h"

static cn_status run_export(const cn_context *ctx, const cn_app_args *args)
{
    cn_city_export_options o = { 0 };
    const char *folder;
    const cn_app_option options[] = { { "--ortho", &o.ortho, NULL, NULL },
                                      { "--dsm", &o.dsm, NULL, NULL },
                                      { "--points", &o.points, NULL, NULL },
                                      { "--gsd", NULL, &o.gsd_m, NULL },
                                      { "--appearance", &o.appearance, NULL, NULL },
                                      { "--view", &o.view, NULL, NULL },
                                      { "--look", &o.look, NULL, NULL },
                                      { "--exposure", NULL, &o.exposure_ev, NULL },
                                      { 0 } };
    cn_city *city;
    CN_TRY(cn_app_parse(args, &folder, options));
    CN_TRY(cn_city_open(&city, folder));
    const cn_status status = cn_city_export(ctx, city, &o);
    cn_city_close(&city);
    return status;
}

const cn_app_command cn_app_export = {
    "export",
    "orthophoto, surface model and coloured points of the whole city",
    "usage: conurb export CITY [--ortho F.tif] [--dsm F.tif] [--points F.ply] [--gsd METRES]\n"
    "                     [--appearance CODE] [--view sRGB|ACES] [--look NAME] [--exposure STOPS]\n\n"
    "  --ortho F.tif   what is seen straight from above: cloud-optimised GeoTIFF, 8-bit sRGB with alpha, UTM\n"
    "  --dsm F.tif     heights of the surface: cloud-optimised GeoTIFF, metres\n"
    "  --points F.ply  coloured points in local metres, with F.frame.json that places them on Earth\n"
    "  --gsd METRES    a pixel, and the distance of points; by default as fine as the photos\n"
    "  --appearance    the light to show, as in `conurb render`\n"
    "Without any of the three files: all of them, in CITY/export.\n\nexample: conurb export beach --ortho beach.tif "
    "--gsd 0.1",
    run_export,
};
