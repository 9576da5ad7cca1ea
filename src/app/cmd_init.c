#include "app.h"

static cn_status run_init(const cn_context *ctx, const cn_app_args *args)
{
    cn_init_options o = { 0 };
    double width = 0;
    const char *city;
    const cn_app_option options[] = { { "--photos", &o.photos, NULL, NULL },
                                      { "--import", &o.import, NULL, NULL },
                                      { "--width", NULL, &width, NULL },
                                      { 0 } };
    CN_TRY(cn_app_parse(args, &city, options));
    if (width < 0 || width > 65535) return cn_fail(CN_ERR_USAGE, "--width: give 16 to 65535 pixels");
    o.width_px = (uint32_t)width;
    return cn_city_init(ctx, city, &o);
}

const cn_app_command cn_app_init = {
    "init",
    "make a city: a folder with a commented city.yaml",
    "usage: conurb init CITY --photos DIR [--import MODEL|transforms.json] [--width PX]\n\n"
    "  --photos DIR   the photos (JPEG, PNG, TIFF, EXR); masks in DIR/masks/NAME.png\n"
    "  --import X     poses from a COLMAP model folder or a transforms.json instead of running COLMAP\n"
    "  --width PX     working width (default 800)\n\nexample: conurb init beach --photos photos --width 1000",
    run_init,
};
