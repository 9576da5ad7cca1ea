#include "app.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static cn_status list(const cn_context *ctx, cn_city *city)
{
    cn_appearance_list l;
    CN_TRY(cn_city_appearance_list(ctx, city, &l));
    printf("%-40s %10s %6s\n", "photo", "EXIF stops", "tiles");
    for (uint32_t i = 0; i < l.n; i++) {
        const cn_appearance_entry *e = &l.entries[i];
        char ev[24] = "-";
        if (e->exposure_ev - e->exposure_ev == 0) snprintf(ev, sizeof ev, "%.2f", e->exposure_ev);
        printf("%-40s %10s %6u%s\n", e->name, ev, e->n_tiles, e->held_out ? "  held out: fitted when asked for" : "");
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

static cn_status act(const cn_context *ctx, cn_city *city, const char *verb, const char *const words[2],
                     const char *out, double width)
{
    if (strcmp(verb, "list") == 0) return list(ctx, city);
    if (strcmp(verb, "show") == 0) return show(ctx, city, words[0]);
    if (strcmp(verb, "export") == 0 && words[0] && words[1])
        return cn_city_appearance_export(ctx, city, words[0], words[1]);
    if (strcmp(verb, "import") == 0 && words[0] && words[1])
        return cn_city_appearance_import(ctx, city, words[0], words[1]);
    if (strcmp(verb, "sheet") == 0)
        return cn_city_appearance_sheet(ctx, city, words[0], (uint32_t)width, out ? out : "sheet.png");
    if (strcmp(verb, "transient") == 0 && words[0])
        return cn_city_appearance_transient(ctx, city, words[0], out ? out : "transient.png");
    return cn_fail(CN_ERR_USAGE, "appearance %s: unknown, or a word is missing; see conurb appearance --help", verb);
}

static cn_status run_appearance(const cn_context *ctx, const cn_app_args *args)
{
    const char *words[4] = { 0 }, *out = NULL, *folder;
    double width = 0;
    int n = 0;
    cn_app_args rest = { 0, args->words };
    /* Up to four words stand for themselves; options go to the parser. */
    for (int i = 0; i < args->n; i++) {
        char *word = args->words[i];
        if (word[0] != '-' && n < 4)
            words[n++] = word;
        else
            rest.words[rest.n++] = word;
        if (word[0] == '-' && i + 1 < args->n) rest.words[rest.n++] = args->words[++i];
    }
    if (n < 2)
        return cn_fail(CN_ERR_USAGE,
                       "give a city and list, show, export, import, sheet or transient; see conurb appearance --help");
    char *city_word = strdup(words[0]);
    if (!city_word) return cn_fail(CN_ERR_NOMEM, "out of memory");
    char *with_city[16] = { city_word };
    cn_app_args parsed = { 1, with_city };
    for (int i = 0; i < rest.n && parsed.n < 16; i++)
        with_city[parsed.n++] = rest.words[i];
    const cn_app_option options[] = { { "--out", &out, NULL, NULL }, { "--width", NULL, &width, NULL }, { 0 } };
    cn_city *city = NULL;
    cn_status status = cn_app_parse(&parsed, &folder, options);
    if (status == CN_OK && (width < 0 || width > 4096)) status = cn_fail(CN_ERR_USAGE, "--width goes to 4096");
    if (status == CN_OK) status = cn_city_open(&city, folder);
    if (status == CN_OK) status = act(ctx, city, words[1], (const char *const[2]){ words[2], words[3] }, out, width);
    cn_city_close(&city);
    free(city_word);
    return status;
}

const cn_app_command cn_app_appearance = {
    "appearance",
    "the lights that a city can be shown in, by name",
    "usage: conurb appearance CITY list\n"
    "       conurb appearance CITY show CODE\n"
    "       conurb appearance CITY export CODE FILE.json\n"
    "       conurb appearance CITY import FILE.json NAME\n"
    "       conurb appearance CITY sheet [PHOTO] [--out F.png] [--width PX]\n"
    "       conurb appearance CITY transient PHOTO [--out F.png]\n\n"
    "  CODE           PHOTO, mean, A:B:0.3, FILE.json, fit:PHOTO, or a NAME that was imported.\n"
    "                 fit: of the collection or any photo of the place, whose pose COLMAP then finds\n"
    "  sheet          one view (PHOTO's, or the first) under the mean and every photo's light\n"
    "  transient      PHOTO beside what training took for standing in it only, and how surely\n\n"
    "example: conurb appearance beach export noon.jpg:dusk.jpg:0.5 between.json",
    run_appearance,
};
