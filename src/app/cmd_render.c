#include "app.h"

#include <inttypes.h>
#include <stdio.h>

typedef struct options {
    cn_city_render_options render;
    const char *chunk;
    double width, frames;
} options;

static const cn_app_option table[] = {
    { "path", "FILE",
      "camera path: JSON keyframes, a GeoJSON LineString or KML with a gx:Track (jobs/README.md describes them). The "
      "word photos stands for the photos in the order of their names",
      CN_APP_TEXT, offsetof(options, render.path), NULL },
    { "orbit", "PLACE",
      "a circle: LAT,LON,RADIUS_M,HEIGHT_M, or X,Y,RADIUS,HEIGHT in a city without GPS. The height is above the ground "
      "of that place",
      CN_APP_TEXT, offsetof(options, render.orbit), NULL },
    { "photo", "NAME", "the view of this photo", CN_APP_TEXT, offsetof(options, render.photo), NULL },
    { "height", "M", "height above the ground, for LineStrings and for tracks on the ground", CN_APP_NUMBER,
      offsetof(options, render.height_m), NULL },
    { "appearance", "LIGHT",
      "a light: PHOTO, mean, A:B:0.3 (a mix of A and B), FILE.json, fit:PHOTO, or a name that was imported"
      ". fit: takes any photo of the place; COLMAP finds its pose",
      CN_APP_TEXT, offsetof(options, render.appearance), NULL },
    { "view", "NAME", "how colours are brought to the screen", CN_APP_TEXT, offsetof(options, render.view),
      "sRGB ACES" },
    { "look", "NAME", "a look of the colour config, applied before the view", CN_APP_TEXT,
      offsetof(options, render.look), NULL },
    { "exposure", "STOPS", "make the picture brighter (or darker, below 0) by so many stops", CN_APP_NUMBER,
      offsetof(options, render.exposure_ev), NULL },
    { "width", "PX", "width of the pictures; by default as in city.yaml", CN_APP_NUMBER, offsetof(options, width),
      NULL },
    { "frames", "N", "number of pictures, spread evenly over the path", CN_APP_NUMBER, offsetof(options, frames),
      NULL },
    { "blend", "NAME", "how tiles are blended; by default as in city.yaml", CN_APP_TEXT,
      offsetof(options, render.blend), CN_APP_BLENDS },
    { "out", "DIR", "folder for the pictures; by default one in CITY/renders", CN_APP_TEXT,
      offsetof(options, render.out), NULL },
    { "chunk", "I/N",
      "render only part I (from 1) of N parts of the frames, so that several processes or machines share the work. The "
      "last of them makes the film",
      CN_APP_TEXT, offsetof(options, chunk), NULL },
    { 0 }
};

static cn_status run_render(const cn_context *ctx, const cn_app_call *call)
{
    const options *o = call->options;
    cn_city_render_options render = o->render;
    if (o->width < 0 || o->width > 16384 || o->frames < 0 || o->frames > 1e6)
        return cn_fail(CN_ERR_USAGE, "--width goes to 16384 and --frames to 1000000");
    char rest;
    if (o->chunk && (sscanf(o->chunk, "%" SCNu32 "/%" SCNu32 "%c", &render.chunk, &render.n_chunks, &rest) != 2 ||
                     !render.n_chunks))
        return cn_fail(CN_ERR_USAGE, "--chunk %s: give I/N, as 3/8 for the third of eight parts", o->chunk);
    render.width_px = (uint32_t)o->width;
    render.n_frames = (uint32_t)o->frames;
    cn_city *city;
    CN_TRY(cn_city_open(&city, call->operands[0]));
    const cn_status status = cn_city_render(ctx, city, &render);
    cn_city_close(&city);
    return status;
}

const cn_app_command cn_app_render = {
    .name = "render",
    .summary = "render a flight, a path or a photo's own view: EXR and PNG",
    .forms = "CITY",
    .about = "Without --path, --orbit or --photo it renders a default flight near the photos. PNG files are for the "
             "screen. EXR files hold linear colours (ACEScg), depth, camera and place. Two frames or more also make a "
             "film, flight.mp4. Frames that are there already are kept.",
    .example = "conurb render beach --path flight.json --view ACES",
    .min_operands = 1,
    .max_operands = 1,
    .options = table,
    .size = sizeof(options),
    .run = run_render,
};
