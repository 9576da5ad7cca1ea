#include "render_options.h"

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
    print_figure("from frame to frame, pixels (jumps):", "pixels", &f->pixels);
    print_figure("from frame to frame, light of blocks (drift):", "blocks", &f->light);
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

typedef struct options {
    cn_city_render_options render;
    double width, frames;
    bool json;
} options;

static const cn_app_option table[] = { CN_OPTION_PATH,
                                       CN_OPTION_ORBIT,
                                       CN_OPTION_HEIGHT,
                                       CN_OPTION_APPEARANCE,
                                       CN_OPTION_WIDTH,
                                       { "frames", "N", "number of pictures, spread evenly over the path",
                                         CN_APP_NUMBER, offsetof(options, frames), NULL },
                                       CN_OPTION_BLEND,
                                       { "json", NULL, "print JSON", CN_APP_FLAG, offsetof(options, json), NULL },
                                       { 0 } };

static cn_status run_steady(const cn_context *ctx, const cn_app_call *call)
{
    const options *o = call->options;
    cn_city_render_options render = o->render;
    cn_temporal_figures figures;
    cn_seam_figures seam;
    if (o->width < 0 || o->width > 16384 || o->frames < 0 || o->frames > 1e6)
        return cn_fail(CN_ERR_USAGE, "--width: give 0 to 16384 pixels; --frames: give 0 to 1000000");
    render.width_px = (uint32_t)o->width;
    render.n_frames = (uint32_t)o->frames;
    cn_city *city;
    CN_TRY(cn_city_open(&city, call->operands[0]));
    const cn_status status = cn_city_temporal_consistency(ctx, city, &render, &figures, &seam);
    cn_city_close(&city);
    CN_TRY(status);
    if (o->json)
        print_figures_json(&figures, &seam);
    else
        print_figures(&figures, &seam);
    return CN_OK;
}

const cn_app_command cn_app_steady = {
    .name = "steady",
    .summary = "measure whether a path flickers where tiles meet",
    .forms = "CITY",
    .about =
        "Renders the path, by default the default flight, and keeps no frame. Each frame is compared with the frame "
        "before it, which is first warped to the new view by its depth. The residual is the mean absolute difference "
        "of display-encoded RGB.\n\nA pixel is at a border when a second tile contributes 5 % or more to it. The ratio "
        "compares residuals at borders with those away from borders, at places of the same texture; it should be 1. It "
        "is printed for pixels, and for the mean light of blocks of 8 x 8 pixels, where texture averages out.\n\nWith "
        "--blend ownership, borders stay at one place. Then the command also prints the step of light across borders "
        "within a frame, compared with the same step in each tile's own render.",
    .example = "conurb steady beach --blend ownership",
    .min_operands = 1,
    .max_operands = 1,
    .options = table,
    .size = sizeof(options),
    .run = run_steady,
};
