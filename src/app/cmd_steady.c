#include "app.h"

#include <inttypes.h>
#include <stdio.h>

static void print_number(const char *key, double value)
{
    if (value - value == 0)
        printf(", \"%s\": %.6f", key, value);
    else
        printf(", \"%s\": null", key);
}

static void print_figure(const char *what, const char *unit, const cn_temporal_figure *f)
{
    printf("%s\n", what);
    printf("  at borders         %10" PRIu64 " %s, mean %.5f, median %.5f\n", f->n_border, unit, f->border_mean,
           f->border_median);
    printf("  away from borders  %10" PRIu64 " %s, mean %.5f, median %.5f\n", f->n_away, unit, f->away_mean,
           f->away_median);
    printf("  ratio at equal texture %.3f\n", f->ratio);
}

static void print_figure_json(const char *key, const cn_temporal_figure *f)
{
    printf("\"%s\": {\"n_border\": %" PRIu64 ", \"n_away\": %" PRIu64, key, f->n_border, f->n_away);
    print_number("border_mean", f->border_mean);
    print_number("away_mean", f->away_mean);
    print_number("border_median", f->border_median);
    print_number("away_median", f->away_median);
    print_number("ratio", f->ratio);
    printf("}");
}

static void print_figures(const cn_temporal_figures *f, const cn_seam_figures *seam)
{
    print_figure("from frame to frame, pixels (what jumps):", "pixels", &f->pixels);
    print_figure("from frame to frame, light of blocks (what drifts):", "blocks", &f->light);
    if (!seam->n) return;
    printf("across borders within a frame:\n  %" PRIu64
           " crossings, step %.5f, in one tile's own render %.5f\n  ratio %.3f\n",
           seam->n, seam->step, seam->own_step, seam->ratio);
}

static void print_figures_json(const cn_temporal_figures *f, const cn_seam_figures *seam)
{
    printf("{");
    print_figure_json("pixels", &f->pixels);
    printf(", ");
    print_figure_json("light", &f->light);
    printf(", \"seam\": {\"n\": %" PRIu64, seam->n);
    print_number("step", seam->step);
    print_number("own_step", seam->own_step);
    print_number("ratio", seam->ratio);
    printf("}}\n");
}

static cn_status run_steady(const cn_context *ctx, const cn_app_args *args)
{
    cn_city_render_options o = { 0 };
    cn_temporal_figures figures;
    cn_seam_figures seam;
    double width = 0, frames = 0;
    const char *folder;
    bool json = false;
    const cn_app_option options[] = { { "--path", &o.path, NULL, NULL },
                                      { "--orbit", &o.orbit, NULL, NULL },
                                      { "--height", NULL, &o.height_m, NULL },
                                      { "--appearance", &o.appearance, NULL, NULL },
                                      { "--width", NULL, &width, NULL },
                                      { "--frames", NULL, &frames, NULL },
                                      { "--blend", &o.blend, NULL, NULL },
                                      { "--json", NULL, NULL, &json },
                                      { 0 } };
    cn_city *city;
    CN_TRY(cn_app_parse(args, &folder, options));
    if (width < 0 || width > 16384 || frames < 0 || frames > 1e6)
        return cn_fail(CN_ERR_USAGE, "--width goes to 16384 and --frames to 1000000");
    o.width_px = (uint32_t)width;
    o.n_frames = (uint32_t)frames;
    CN_TRY(cn_city_open(&city, folder));
    const cn_status status = cn_city_steady(ctx, city, &o, &figures, &seam);
    cn_city_close(&city);
    CN_TRY(status);
    if (json)
        print_figures_json(&figures, &seam);
    else
        print_figures(&figures, &seam);
    return CN_OK;
}

const cn_app_command cn_app_steady = {
    "steady",
    "measure whether a path flickers where tiles meet",
    "usage: conurb steady CITY [--path FILE|photos | --orbit PLACE] [--height M] [--appearance CODE] [--width PX]\n"
    "                     [--frames N] [--blend NAME] [--json]\n\n"
    "Renders the path (by default the default flight) and looks each frame up in the one before by its own depth. The "
    "residual is the mean\n"
    "absolute difference of display-encoded RGB; at borders, where a second tile has 5 % of a pixel or more, it should "
    "be what it is\n"
    "elsewhere on the same texture: a ratio of 1. It is told of pixels, and of the mean light of blocks of 8 x 8, in "
    "which texture\n"
    "averages out. By ownership, where borders stand still: also the step of light from one tile's part of a frame to "
    "the next one's,\n"
    "over that in either tile's own render. Options as those of `conurb render`; no frame is kept.\n\n"
    "example: conurb steady beach --blend ownership",
    run_steady,
};
