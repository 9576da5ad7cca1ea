#include "app.h"

typedef struct options {
    const char *photos, *import;
    double width;
} options;

static const cn_app_option table[] = {
    { "photos", "DIR", "folder of the photos (JPEG, PNG, TIFF, EXR). Masks go in DIR/masks/NAME.png", CN_APP_TEXT,
      offsetof(options, photos), NULL },
    { "import", "FILE",
      "take the poses from another tool: a COLMAP model folder or a file (see the README), and do not run COLMAP",
      CN_APP_TEXT, offsetof(options, import), NULL },
    { "width", "PX", "width in pixels to which the photos are scaled down; by default 800", CN_APP_NUMBER,
      offsetof(options, width), NULL },
    { 0 }
};

static cn_status run_init(const cn_context *ctx, const cn_app_call *call)
{
    const options *o = call->options;
    if (o->width < 0 || o->width > 65535) return cn_fail(CN_ERR_USAGE, "--width: give 16 to 65535 pixels");
    const cn_init_options init = { .photos = o->photos, .import = o->import, .width_px = (uint32_t)o->width };
    return cn_city_init(ctx, call->operands[0], &init);
}

const cn_app_command cn_app_init = {
    .name = "init",
    .summary = "make a city: a folder with a commented city.yaml",
    .forms = "CITY",
    .about =
        "Writes CITY/city.yaml. Each key in it has a comment that says what it does. The photos stay where they are.",
    .example = "conurb init beach --photos photos --width 1000",
    .min_operands = 1,
    .max_operands = 1,
    .options = table,
    .size = sizeof(options),
    .run = run_init,
};
