#include "app.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* One option of a command: takes a text, a number or nothing (flag). */
typedef struct option_spec { const char *name; const char **text; double *number; bool *flag; } option_spec;

static cn_status take_option(const option_spec *o, const char *value)
{
    if (!value) return cn_fail(CN_ERR_USAGE, "%s wants a value", o->name);
    if (o->text) *o->text = value;
    if (!o->number) return CN_OK;
    char *end;
    *o->number = strtod(value, &end);
    /* "60s" is as good as "60"; so are minutes and hours. */
    if (*end == 'm') *o->number *= 60, end++;
    else if (*end == 'h') *o->number *= 3600, end++;
    else if (*end == 's') end++;
    return *end || end == value ? cn_fail(CN_ERR_USAGE, "%s wants a number, not '%s'", o->name, value) : CN_OK;
}

/* The city, then options; the list ends with a NULL name. */
static cn_status parse(const cn_app_args *args, const char **city, const option_spec *options)
{
    *city = NULL;
    for (int i = 0; i < args->n; i++) {
        const char *word = args->words[i];
        const option_spec *o = options;
        while (o->name && strcmp(o->name, word) != 0) o++;
        if (o->name && o->flag) {
            *o->flag = true;
        } else if (o->name) {
            CN_TRY(take_option(o, i + 1 < args->n ? args->words[i + 1] : NULL));
            i++;
        } else if (word[0] == '-') {
            return cn_fail(CN_ERR_USAGE, "no option '%s'; see --help", word);
        } else if (*city) {
            return cn_fail(CN_ERR_USAGE, "'%s' is one word too many; see --help", word);
        } else {
            *city = word;
        }
    }
    return *city ? CN_OK : cn_fail(CN_ERR_USAGE, "name the city (its folder); see --help");
}

static cn_status parse_quality(const char *name, int *quality)
{
    static const char *const names[] = {"preview", "standard", "high", "reference"};
    *quality = -1;
    for (int i = 0; name && i < 4; i++)
        if (strcmp(names[i], name) == 0) *quality = i;
    return name && *quality < 0 ? cn_fail(CN_ERR_USAGE, "--quality %s: give preview, standard, high or reference", name) : CN_OK;
}

static cn_status run_init(const cn_context *ctx, const cn_app_args *args)
{
    cn_init_options o = {0};
    double width = 0;
    const char *city;
    const option_spec options[] = {{"--photos", &o.photos, NULL, NULL}, {"--import", &o.import, NULL, NULL}, {"--width", NULL, &width, NULL}, {0}};
    CN_TRY(parse(args, &city, options));
    if (width < 0 || width > 65535) return cn_fail(CN_ERR_USAGE, "--width: give 16 to 65535 pixels");
    o.width_px = (uint32_t)width;
    return cn_city_init(ctx, city, &o);
}

static cn_status run_poses(const cn_context *ctx, const cn_app_args *args)
{
    const char *folder;
    const option_spec none[] = {{0}};
    cn_city *city;
    CN_TRY(parse(args, &folder, none));
    CN_TRY(cn_city_open(&city, folder));
    const cn_status status = cn_city_poses(ctx, city);
    cn_city_close(&city);
    return status;
}

static cn_status run_plan(const cn_context *ctx, const cn_app_args *args)
{
    const char *folder;
    bool dry = false;
    const option_spec options[] = {{"--dry-run", NULL, NULL, &dry}, {0}};
    cn_city *city;
    CN_TRY(parse(args, &folder, options));
    CN_TRY(cn_city_open(&city, folder));
    const cn_status status = cn_city_plan(ctx, city, dry);
    cn_city_close(&city);
    return status;
}

static cn_status run_train(const cn_context *ctx, const cn_app_args *args)
{
    const char *folder, *tile = NULL, *quality_name = NULL;
    double budget = 0;
    int quality;
    const option_spec options[] = {{"--tile", &tile, NULL, NULL}, {"--quality", &quality_name, NULL, NULL}, {"--time-budget", NULL, &budget, NULL}, {0}};
    cn_city *city;
    CN_TRY(parse(args, &folder, options));
    CN_TRY(parse_quality(quality_name, &quality));
    CN_TRY(cn_city_open(&city, folder));
    const cn_status status = cn_city_train(ctx, city, tile, quality, budget);
    cn_city_close(&city);
    return status;
}

static cn_status run_render(const cn_context *ctx, const cn_app_args *args)
{
    cn_city_render_options o = {0};
    double width = 0, frames = 0;
    const char *folder;
    const option_spec options[] = {{"--path", &o.path, NULL, NULL}, {"--photo", &o.photo, NULL, NULL}, {"--out", &o.out, NULL, NULL},
                                   {"--appearance", &o.appearance, NULL, NULL}, {"--view", &o.view, NULL, NULL}, {"--look", &o.look, NULL, NULL},
                                   {"--exposure", NULL, &o.exposure_ev, NULL}, {"--width", NULL, &width, NULL}, {"--frames", NULL, &frames, NULL}, {0}};
    cn_city *city;
    CN_TRY(parse(args, &folder, options));
    if (width < 0 || width > 16384 || frames < 0 || frames > 1e6) return cn_fail(CN_ERR_USAGE, "--width goes to 16384 and --frames to 1000000");
    o.width_px = (uint32_t)width;
    o.n_frames = (uint32_t)frames;
    CN_TRY(cn_city_open(&city, folder));
    const cn_status status = cn_city_render(ctx, city, &o);
    cn_city_close(&city);
    return status;
}

/* A number as JSON: it has no infinities. */
static void print_json_number(const char *key, double value)
{
    if (value - value == 0) printf("\"%s\": %.6f", key, value);
    else printf("\"%s\": null", key);
}

static void print_eval_json(const cn_eval *eval)
{
    printf("{");
    print_json_number("psnr", eval->psnr);
    printf(", ");
    print_json_number("ssim", eval->ssim);
    printf(", \"photos\": [");
    for (uint32_t i = 0; i < eval->n_photos; i++) {
        printf("%s{\"name\": \"", i ? ", " : "");
        for (const char *c = eval->photos[i].name; *c; c++) printf(*c == '"' || *c == '\\' ? "\\%c" : "%c", *c);
        printf("\", ");
        print_json_number("psnr", eval->photos[i].psnr);
        printf(", ");
        print_json_number("ssim", eval->photos[i].ssim);
        printf("}");
    }
    printf("]}\n");
}

static cn_status run_eval(const cn_context *ctx, const cn_app_args *args)
{
    const char *folder;
    bool json = false;
    const option_spec options[] = {{"--json", NULL, NULL, &json}, {0}};
    cn_city *city;
    cn_eval eval;
    CN_TRY(parse(args, &folder, options));
    CN_TRY(cn_city_open(&city, folder));
    const cn_status status = cn_city_eval(ctx, city, &eval);
    cn_city_close(&city);
    CN_TRY(status);
    if (json) {
        print_eval_json(&eval);
    } else {
        for (uint32_t i = 0; i < eval.n_photos; i++)
            printf("%-32s %-22s %6.2f dB  SSIM %.4f\n", eval.photos[i].name, eval.photos[i].tile, eval.photos[i].psnr, eval.photos[i].ssim);
        printf("%-32s %-22s %6.2f dB  SSIM %.4f\n", "mean", "", eval.psnr, eval.ssim);
    }
    cn_eval_deinit(&eval);
    return CN_OK;
}

static cn_status run_run(const cn_context *ctx, const cn_app_args *args)
{
    const char *folder, *quality_name = NULL;
    int quality;
    const option_spec options[] = {{"--quality", &quality_name, NULL, NULL}, {0}};
    cn_city *city;
    CN_TRY(parse(args, &folder, options));
    CN_TRY(parse_quality(quality_name, &quality));
    CN_TRY(cn_city_open(&city, folder));
    const cn_status status = cn_city_run(ctx, city, quality);
    cn_city_close(&city);
    return status;
}

const cn_app_command cn_app_commands[] = {
    {"init", "make a city: a folder with a commented city.yaml",
     "usage: conurb init CITY --photos DIR [--import MODEL|transforms.json] [--width PX]\n\n"
     "  --photos DIR   the photos (JPEG, PNG, TIFF, EXR); masks in DIR/masks/NAME.png\n"
     "  --import X     poses from a COLMAP model folder or a transforms.json instead of running COLMAP\n"
     "  --width PX     working width (default 800)\n\nexample: conurb init beach --photos photos --width 1000", run_init},
    {"poses", "find or import the photos' poses, and place them on Earth",
     "usage: conurb poses CITY\n\nRuns COLMAP (its log is CITY/poses/colmap.log) or imports, aligns to GPS. Resumes.\n\nexample: conurb poses beach", run_poses},
    {"plan", "split the city into overlapping tiles, and say what they will cost",
     "usage: conurb plan CITY [--dry-run]\n\n  --dry-run      print the plan, write nothing\n\nexample: conurb plan beach && xdg-open beach/plan/plan.svg", run_plan},
    {"train", "train one tile or all; resumes",
     "usage: conurb train CITY [--tile ID] [--quality preview|standard|high|reference] [--time-budget 60s]\n\n"
     "  --tile ID      only that tile of CITY/plan/plan.json\n  --quality Q    instead of city.yaml's\n  --time-budget T  a tile: 90s, 20m, 2h\n\nexample: conurb train beach --quality preview", run_train},
    {"render", "render a flight, a path or a photo's own view: EXR and PNG",
     "usage: conurb render CITY [--path FILE | --photo NAME] [--out DIR] [--appearance PHOTO|mean] [--view sRGB|ACES] [--look NAME]\n"
     "                     [--exposure STOPS] [--width PX] [--frames N]\n\n"
     "  --path FILE    JSON keyframes; the format is in jobs/README.md\n  --photo NAME   the view of that photo\n"
     "  --appearance   the light and exposure of a photo, by name\n\nexample: conurb render beach --path flight.json --view ACES", run_render},
    {"eval", "PSNR and SSIM on the held-out photos",
     "usage: conurb eval CITY [--json]\n\nWrites CITY/eval/eval.json and a picture of truth, render and error for each photo.\n\nexample: conurb eval beach --json", run_eval},
    {"run", "all of the above in order, skipping what is done",
     "usage: conurb run CITY [--quality preview|standard|high|reference]\n\nexample: conurb init beach --photos photos && conurb run beach", run_run},
};
const int cn_app_n_commands = sizeof cn_app_commands / sizeof *cn_app_commands;
