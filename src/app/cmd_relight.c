#include "app.h"

#include <stdio.h>
#include <stdlib.h>

static cn_status run_relight(const cn_context *ctx, const cn_app_args *args)
{
    cn_city_render_options o = { 0 };
    double width = 0, frames = 48;
    const char *folder, *from = NULL, *to = NULL;
    const cn_app_option options[] = { { "--from", &from, NULL, NULL },
                                      { "--to", &to, NULL, NULL },
                                      { "--sequence", &o.sequence, NULL, NULL },
                                      { "--path", &o.path, NULL, NULL },
                                      { "--photo", &o.photo, NULL, NULL },
                                      { "--orbit", &o.orbit, NULL, NULL },
                                      { "--height", NULL, &o.height_m, NULL },
                                      { "--out", &o.out, NULL, NULL },
                                      { "--view", &o.view, NULL, NULL },
                                      { "--look", &o.look, NULL, NULL },
                                      { "--exposure", NULL, &o.exposure_ev, NULL },
                                      { "--width", NULL, &width, NULL },
                                      { "--frames", NULL, &frames, NULL },
                                      { 0 } };
    CN_TRY(cn_app_parse(args, &folder, options));
    if (width < 0 || width > 16384 || frames < 2 || frames > 1e6)
        return cn_fail(CN_ERR_USAGE, "--width goes to 16384 and --frames from 2 to 1000000");
    if ((from && to) == (o.sequence != NULL)) return cn_fail(CN_ERR_USAGE, "give --from A --to B, or --sequence A,B,C");
    char pair[1024];
    if (!o.sequence) {
        const int n = snprintf(pair, sizeof pair, "%s,%s", from, to);
        if (n < 0 || (size_t)n >= sizeof pair) return cn_fail(CN_ERR_USAGE, "--from and --to are too long");
        o.sequence = pair;
    }
    o.width_px = (uint32_t)width;
    o.n_frames = (uint32_t)frames;
    cn_city *city;
    CN_TRY(cn_city_open(&city, folder));
    const cn_status status = cn_city_render(ctx, city, &o);
    cn_city_close(&city);
    return status;
}

const cn_app_command cn_app_relight = {
    "relight",
    "let the light change over a fixed view or a flight",
    "usage: conurb relight CITY (--from A --to B | --sequence A,B,C) [--frames N] [--photo NAME | --path FILE | "
    "--orbit PLACE]\n"
    "                      [--exposure STOPS] [--view sRGB|ACES] [--look NAME] [--width PX] [--out DIR]\n\n"
    "  A, B, C        lights: PHOTO, mean, A:B:0.3, FILE.json, fit:PHOTO, or a name that was imported.\n"
    "                 fit: of the collection or any photo of the place, whose pose COLMAP then finds\n"
    "  --photo NAME   the fixed view of that photo; without it, the path or the default flight\n"
    "  --exposure     in stops\n\n"
    "example: conurb relight beach --from noon.jpg --to dusk.jpg --photo noon.jpg --frames 48",
    run_relight,
};
