#include "app.h"

#include <inttypes.h>
#include <stdio.h>

static cn_status run_render(const cn_context *ctx, const cn_app_args *args)
{
    cn_city_render_options o = { 0 };
    double width = 0, frames = 0;
    const char *folder, *chunk = NULL;
    const cn_app_option options[] = { { "--path", &o.path, NULL, NULL },
                                      { "--orbit", &o.orbit, NULL, NULL },
                                      { "--height", NULL, &o.height_m, NULL },
                                      { "--photo", &o.photo, NULL, NULL },
                                      { "--out", &o.out, NULL, NULL },
                                      { "--appearance", &o.appearance, NULL, NULL },
                                      { "--view", &o.view, NULL, NULL },
                                      { "--look", &o.look, NULL, NULL },
                                      { "--exposure", NULL, &o.exposure_ev, NULL },
                                      { "--width", NULL, &width, NULL },
                                      { "--frames", NULL, &frames, NULL },
                                      { "--chunk", &chunk, NULL, NULL },
                                      { "--blend", &o.blend, NULL, NULL },
                                      { 0 } };
    cn_city *city;
    CN_TRY(cn_app_parse(args, &folder, options));
    if (width < 0 || width > 16384 || frames < 0 || frames > 1e6)
        return cn_fail(CN_ERR_USAGE, "--width goes to 16384 and --frames to 1000000");
    char rest;
    if (chunk && (sscanf(chunk, "%" SCNu32 "/%" SCNu32 "%c", &o.chunk, &o.n_chunks, &rest) != 2 || !o.n_chunks))
        return cn_fail(CN_ERR_USAGE, "--chunk %s: give I/N, as 3/8 for the third of eight parts", chunk);
    o.width_px = (uint32_t)width;
    o.n_frames = (uint32_t)frames;
    CN_TRY(cn_city_open(&city, folder));
    const cn_status status = cn_city_render(ctx, city, &o);
    cn_city_close(&city);
    return status;
}

const cn_app_command cn_app_render = {
    "render",
    "render a flight, a path or a photo's own view: EXR and PNG",
    "usage: conurb render CITY [--path FILE|photos | --orbit PLACE | --photo NAME] [--height M] [--out DIR]\n"
    "                     [--appearance LIGHT] [--view sRGB|ACES] [--look NAME]\n"
    "                     [--exposure STOPS] [--width PX] [--frames N] [--chunk I/N]\n"
    "                     [--blend nearest|distance_2d|distance_3d|visibility|ownership]\n\n"
    "  --path FILE    JSON keyframes, a GeoJSON LineString or KML with a gx:Track; jobs/README.md has the formats\n"
    "  --path photos  through the photos in the order of their names\n"
    "  --orbit LAT,LON,RADIUS_M,HEIGHT_M   round a place, at a height above its ground (X,Y,... in a city without "
    "GPS)\n"
    "  --height M     above the ground, for LineStrings and tracks on the ground\n  --photo NAME   the view of that "
    "photo\n"
    "  --appearance   PHOTO, mean, A:B:0.3, FILE.json, fit:PHOTO, or a name that was imported.\n"
    "                 fit: of the collection or any photo of the place, whose pose COLMAP then finds\n"
    "  --chunk I/N    only part I (from 1) of N of the frames: several processes or machines share the work, and the "
    "last makes the film\n\n"
    "example: conurb render beach --path flight.json --view ACES",
    run_render,
};
