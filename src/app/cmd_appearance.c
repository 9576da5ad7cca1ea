#include "app.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static cn_status list(const cn_context *ctx, cn_city *city)
{
    cn_appearance_list l;
    CN_TRY(cn_city_appearance_list(ctx, city, &l));
    printf("%-40s %10s %6s\n", "photo or light", "EXIF stops", "tiles");
    for (uint32_t i = 0; i < l.n; i++) {
        const cn_appearance_entry *e = &l.entries[i];
        char ev[24] = "-";
        if (e->exposure_ev - e->exposure_ev == 0) snprintf(ev, sizeof ev, "%.2f", e->exposure_ev);
        if (e->is_light)
            printf("%-40s %10s %6s  a light with a name\n", e->name, ev, "-");
        else
            printf("%-40s %10s %6u%s\n", e->name, ev, e->n_tiles,
                   e->held_out ? "  held out: fitted when asked for" : "");
    }
    cn_appearance_list_deinit(&l);
    return CN_OK;
}

static cn_status show(const cn_context *ctx, cn_city *city, const char *code)
{
    char *json;
    CN_TRY(cn_city_appearance_show(ctx, city, code, &json));
    puts(json);
    free(json);
    return CN_OK;
}

/* Says what was written, once it is there. */
static cn_status written(cn_status status, const char *path)
{
    if (status == CN_OK) printf("wrote %s\n", path);
    return status;
}

static cn_status import(const cn_context *ctx, cn_city *city, const char *file, const char *name)
{
    CN_TRY(cn_city_appearance_import(ctx, city, file, name));
    printf("the light '%s' is there for --appearance now\n", name);
    return CN_OK;
}

static cn_status act(const cn_context *ctx, cn_city *city, const char *verb, const char *const words[2],
                     const char *out, double width)
{
    if (strcmp(verb, "list") == 0) return list(ctx, city);
    if (strcmp(verb, "show") == 0) return show(ctx, city, words[0]);
    if (strcmp(verb, "export") == 0 && words[0] && words[1])
        return written(cn_city_appearance_export(ctx, city, words[0], words[1]), words[1]);
    if (strcmp(verb, "import") == 0 && words[0] && words[1]) return import(ctx, city, words[0], words[1]);
    if (strcmp(verb, "sheet") == 0) {
        if (!out) out = "sheet.png";
        return written(cn_city_appearance_sheet(ctx, city, words[0], (uint32_t)width, out), out);
    }
    if (strcmp(verb, "transient") == 0 && words[0]) {
        if (!out) out = "transient.png";
        return written(cn_city_appearance_transient(ctx, city, words[0], out), out);
    }
    return cn_fail(
        CN_ERR_USAGE,
        "appearance %s: there is no such action, or a word after it is missing; see conurb appearance --help", verb);
}

typedef struct options {
    const char *out;
    double width;
} options;

static const cn_app_option table[] = { { "out", "F.png", "picture to write; by default sheet.png or transient.png",
                                         CN_APP_TEXT, offsetof(options, out), NULL },
                                       { "width", "PX", "width of one view of the sheet", CN_APP_NUMBER,
                                         offsetof(options, width), NULL },
                                       { 0 } };

static cn_status run_appearance(const cn_context *ctx, const cn_app_call *call)
{
    const options *o = call->options;
    if (call->n < 2)
        return cn_fail(
            CN_ERR_USAGE,
            "give a city and an action: list, show, export, import, sheet or transient; see conurb appearance --help");
    if (o->width < 0 || o->width > 4096) return cn_fail(CN_ERR_USAGE, "--width: give 0 to 4096 pixels");
    cn_city *city;
    CN_TRY(cn_city_open(&city, call->operands[0]));
    const cn_status status = act(ctx, city, call->operands[1], call->operands + 2, o->out, o->width);
    cn_city_close(&city);
    return status;
}

const cn_app_command cn_app_appearance = {
    .name = "appearance",
    .summary = "list, show, export and import the lights that a city can be shown in",
    .forms = "CITY list\n"
             "CITY show LIGHT\n"
             "CITY export LIGHT FILE.json\n"
             "CITY import FILE.json NAME\n"
             "CITY sheet [PHOTO]\n"
             "CITY transient PHOTO",
    .about =
        "LIGHT is PHOTO (the light of that photo), mean, A:B:0.3 (a mix of A and B, which are photos, mean or names), "
        "FILE.json, fit:PHOTO, or an imported NAME. fit:PHOTO takes any photo of the place; COLMAP finds its pose.\n\n"
        "list prints the photos whose light is known, and the lights with a name. show prints a light as JSON. export "
        "writes it to a file. import gives such a file a name. sheet makes a picture of one view (that of PHOTO, or of "
        "the first photo) in every light. transient makes a picture of PHOTO beside what training took for people or "
        "cars in it, and its alpha.",
    .example = "conurb appearance beach export noon.jpg:dusk.jpg:0.5 between.json",
    .verbs = "list show export import sheet transient",
    .max_operands = 4,
    .options = table,
    .size = sizeof(options),
    .computes = true,
    .run = run_appearance,
};
