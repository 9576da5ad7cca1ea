#include "render_options.h"

typedef struct options {
    cn_city_render_options render;
    double width, frames;
} options;

static const cn_app_option table[] = {
    { "from", "A", "the first light", CN_APP_TEXT, offsetof(options, render.from), NULL },
    { "to", "B", "the last light", CN_APP_TEXT, offsetof(options, render.to), NULL },
    { "sequence", "A,B,C", "instead of --from and --to: one light after another", CN_APP_TEXT,
      offsetof(options, render.sequence), NULL },
    { "photo", "NAME", "keep the camera at the view of this photo", CN_APP_TEXT, offsetof(options, render.photo),
      NULL },
    CN_OPTION_PATH,
    CN_OPTION_ORBIT,
    CN_OPTION_HEIGHT,
    CN_OPTION_CAMERA,
    CN_OPTION_VIEW,
    CN_OPTION_LOOK,
    CN_OPTION_EXPOSURE,
    CN_OPTION_WIDTH,
    { "frames", "N", "number of pictures; by default 48", CN_APP_NUMBER, offsetof(options, frames), NULL },
    CN_OPTION_OUT,
    { 0 }
};

static cn_status run_relight(const cn_context *ctx, const cn_app_call *call)
{
    const options *o = call->options;
    cn_city_render_options render = o->render;
    if (o->width < 0 || o->width > 16384 || o->frames < 2 || o->frames > 1e6)
        return cn_fail(CN_ERR_USAGE, "--width: give 0 to 16384 pixels; --frames: give 2 to 1000000");
    if (!render.from != !render.to || (render.from != NULL) == (render.sequence != NULL))
        return cn_fail(CN_ERR_USAGE, "give --from A --to B, or --sequence A,B,C");
    render.width_px = (uint32_t)o->width;
    render.n_frames = (uint32_t)o->frames;
    cn_city *city;
    CN_TRY(cn_city_open(&city, call->operands[0]));
    const cn_status status = cn_city_render(ctx, city, &render);
    cn_city_close(&city);
    return status;
}

const cn_app_command cn_app_relight = {
    .name = "relight",
    .summary = "render a view or a flight while the light changes",
    .forms = "CITY",
    .about = "A light is PHOTO (the light of that photo), mean, A:B:0.3 (a mix of A and B), FILE.json, fit:PHOTO, or "
             "an imported name. fit:PHOTO takes any photo of the place; COLMAP finds its pose. Without --photo, --path "
             "or --orbit the camera takes the default flight.",
    .example = "conurb relight beach --from noon.jpg --to dusk.jpg --photo noon.jpg",
    .defaults = &(const options){ .frames = 48 },
    .min_operands = 1,
    .max_operands = 1,
    .options = table,
    .size = sizeof(options),
    .computes = true,
    .run = run_relight,
};
