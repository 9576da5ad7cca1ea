#include "render_options.h"

#include <inttypes.h>
#include <stdio.h>

typedef struct options {
    cn_city_render_options render;
    const char *chunk, *aov;
    double width, frames;
} options;

static const cn_app_option table[] = {
    CN_OPTION_PATH,
    CN_OPTION_ORBIT,
    { "photo", "NAME", "the view of this photo", CN_APP_TEXT, offsetof(options, render.photo), NULL },
    CN_OPTION_HEIGHT,
    CN_OPTION_CAMERA,
    CN_OPTION_APPEARANCE,
    CN_OPTION_VIEW,
    CN_OPTION_LOOK,
    CN_OPTION_EXPOSURE,
    CN_OPTION_WIDTH,
    { "frames", "N", "number of pictures, spread evenly over the path", CN_APP_NUMBER, offsetof(options, frames),
      NULL },
    CN_OPTION_BLEND,
    CN_OPTION_OUT,
    { "aov", "LIST",
      "channels beside the colour, as layers of the EXR files and as a PNG each: any of depth, normal, opacity, "
      "ambient_occlusion and coverage, separated by commas; coverage counts the photos that see the surface. "
      "Example: --aov depth,normal",
      CN_APP_TEXT, offsetof(options, aov), "depth normal opacity ambient_occlusion coverage" },
    { "chunk", "I/N",
      "render only part I (from 1) of N parts of the frames, so that several "
      "processes or machines share the work. The last one to finish makes the film",
      CN_APP_TEXT, offsetof(options, chunk), NULL },
    { 0 }
};

static cn_status run_render(const cn_context *ctx, const cn_app_call *call)
{
    const options *o = call->options;
    cn_city_render_options render = o->render;
    if (o->width < 0 || o->width > 16384 || o->frames < 0 || o->frames > 1e6)
        return cn_fail(CN_ERR_USAGE, "--width: give 0 to 16384 pixels; --frames: give 0 to 1000000");
    char rest;
    if (o->chunk && (sscanf(o->chunk, "%" SCNu32 "/%" SCNu32 "%c", &render.chunk, &render.n_chunks, &rest) != 2 ||
                     !render.n_chunks))
        return cn_fail(CN_ERR_USAGE, "--chunk %s: give I/N, such as 3/8 for the third of eight parts", o->chunk);
    if (o->aov) CN_TRY(cn_aov_parse(o->aov, &render.aovs));
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
             "screen. EXR files hold linear colours (ACEScg), depth, the camera and its position. Two or more frames "
             "also become a film, flight.mp4. Frames that are done already are kept.",
    .example = "conurb render beach --path flight.json --view ACES",
    .min_operands = 1,
    .max_operands = 1,
    .options = table,
    .size = sizeof(options),
    .computes = true,
    .run = run_render,
};
