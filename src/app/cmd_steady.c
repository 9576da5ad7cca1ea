#include "app.h"

#include <inttypes.h>
#include <stdio.h>

static void print_number(const char *key, double value)
{
    if (value - value == 0) printf(", \"%s\": %.6f", key, value);
    else printf(", \"%s\": null", key);
}

static void print_figures(const cn_steady_figures *f, bool json)
{
    if (!json) {
        printf("at borders:        %12" PRIu64 " residuals, mean %.5f, median %.5f\n", f->n_border, f->border_mean, f->border_median);
        printf("away from borders: %12" PRIu64 " residuals, mean %.5f, median %.5f\n", f->n_away, f->away_mean, f->away_median);
        printf("ratio at equal texture: %.3f\n", f->ratio);
        return;
    }
    printf("{\"n_border\": %" PRIu64 ", \"n_away\": %" PRIu64, f->n_border, f->n_away);
    print_number("border_mean", f->border_mean);
    print_number("away_mean", f->away_mean);
    print_number("border_median", f->border_median);
    print_number("away_median", f->away_median);
    print_number("ratio", f->ratio);
    printf("}\n");
}

static cn_status run_steady(const cn_context *ctx, const cn_app_args *args)
{
    cn_city_render_options o = {0};
    cn_steady_figures figures;
    double width = 0, frames = 0;
    const char *folder;
    bool json = false;
    const cn_app_option options[] = {{"--path", &o.path, NULL, NULL}, {"--orbit", &o.orbit, NULL, NULL}, {"--height", NULL, &o.height_m, NULL},
                                   {"--appearance", &o.appearance, NULL, NULL}, {"--width", NULL, &width, NULL},
                                   {"--frames", NULL, &frames, NULL}, {"--blend", &o.blend, NULL, NULL}, {"--json", NULL, NULL, &json}, {0}};
    cn_city *city;
    CN_TRY(cn_app_parse(args, &folder, options));
    if (width < 0 || width > 16384 || frames < 0 || frames > 1e6) return cn_fail(CN_ERR_USAGE, "--width goes to 16384 and --frames to 1000000");
    o.width_px = (uint32_t)width;
    o.n_frames = (uint32_t)frames;
    CN_TRY(cn_city_open(&city, folder));
    const cn_status status = cn_city_steady(ctx, city, &o, &figures);
    cn_city_close(&city);
    if (status == CN_OK) print_figures(&figures, json);
    return status;
}

const cn_app_command cn_app_steady = {
    "steady",
    "measure whether a path flickers where tiles meet",
    "usage: conurb steady CITY [--path FILE|photos | --orbit PLACE] [--height M] [--appearance CODE] [--width PX]\n"
    "                     [--frames N] [--blend NAME] [--json]\n\n"
    "Renders the path (by default the default flight) and looks each frame up in the one before by its own depth. The residual is the mean\n"
    "absolute difference of display-encoded RGB; at borders, where a second tile has 5 % of a pixel or more, it should be what it is\n"
    "elsewhere on the same texture: a ratio of 1. Options as those of `conurb render`; no frame is kept.\n\n"
    "example: conurb steady beach --blend ownership",
    run_steady,
};
