#include "app.h"

#include <stdio.h>
#include <string.h>

/* A number as JSON: it has no infinities. */
static void print_json_number(const char *key, double value)
{
    if (value - value == 0)
        printf("\"%s\": %.6f", key, value);
    else
        printf("\"%s\": null", key);
}

static void print_json_score(const char *key, cn_score score)
{
    printf(", \"%s\": {", key);
    print_json_number("psnr", score.psnr);
    printf(", ");
    print_json_number("ssim", score.ssim);
    printf("}");
}

static void print_json_text(const char *key, const char *text)
{
    printf("\"%s\": \"", key);
    for (const char *c = text; *c; c++)
        if ((unsigned char)*c < 0x20)
            printf("\\u%04x", (unsigned)*c);
        else
            printf(*c == '"' || *c == '\\' ? "\\%c" : "%c", *c);
    printf("\"");
}

static void print_eval_json(const cn_eval *eval)
{
    printf("{");
    print_json_number("psnr", eval->plain.psnr);
    printf(", ");
    print_json_number("ssim", eval->plain.ssim);
    print_json_score("half", eval->half);
    print_json_score("unfitted", eval->unfitted);
    print_json_score("corrected", eval->corrected);
    printf(", ");
    print_json_number("render_s", eval->render_s);
    printf(", \"photos\": [");
    for (uint32_t i = 0; i < eval->n_photos; i++) {
        const cn_eval_photo *p = &eval->photos[i];
        printf(i ? ", {" : "{");
        print_json_text("name", p->name);
        printf(", ");
        print_json_text("tile", p->tile);
        printf(", ");
        print_json_number("psnr", p->plain.psnr);
        printf(", ");
        print_json_number("ssim", p->plain.ssim);
        print_json_score("half", p->half);
        print_json_score("unfitted", p->unfitted);
        print_json_score("corrected", p->corrected);
        printf("}");
    }
    printf("]}");
}

static void print_row(const char *name, const char *tile, const cn_score scores[4])
{
    printf("%-32s %-22s", name, tile);
    for (int i = 0; i < 4; i++)
        printf(" %6.2f dB  %.4f  ", scores[i].psnr, scores[i].ssim);
    printf("\n");
}

/* Every blending on the same photos. */
static cn_status compare_blends(const cn_context *ctx, cn_city *city, bool json)
{
    if (!json)
        printf("%-12s %-18s   %-18s   %s\n", "blending", "plain PSNR, SSIM", "right half, fitted", "s a picture");
    for (int blend = CN_BLEND_NEAREST; blend <= CN_BLEND_OWNERSHIP; blend++) {
        const char *name = cn_blend_name((cn_blend)blend);
        cn_eval eval;
        CN_TRY(cn_city_eval(ctx, city, name, &eval));
        if (json) {
            printf("%s\"%s\": ", blend == CN_BLEND_NEAREST ? "{" : ", ", name);
            print_eval_json(&eval);
        } else {
            printf("%-12s %6.2f dB  %.4f   %6.2f dB  %.4f   %.2f\n", name, eval.plain.psnr, eval.plain.ssim,
                   eval.half.psnr, eval.half.ssim, eval.render_s);
        }
        cn_eval_deinit(&eval);
    }
    if (json) printf("}\n");
    return CN_OK;
}

static void print_distances(const char *what, const cn_surface_distances *d)
{
    printf("%-28s %9llu  %8.3f  %8.3f", what, (unsigned long long)d->n, d->median_m, d->mean_m);
    for (int t = 0; t < CN_SURFACE_THRESHOLDS; t++)
        printf("  %5.1f %%", 100 * d->within[t]);
    printf("\n");
}

/* Prints CITY/eval/geometry.json, which was written just now. */
static cn_status print_fit_file(const char *folder)
{
    char path[4096], part[4096];
    size_t n;
    snprintf(path, sizeof path, "%s/eval/geometry.json", folder);
    FILE *file = fopen(path, "rb");
    if (!file) return cn_fail(CN_ERR_IO, "cannot read %s", path);
    while ((n = fread(part, 1, sizeof part, file)) > 0)
        fwrite(part, 1, n, stdout);
    fclose(file);
    return CN_OK;
}

static void print_fit(const cn_surface_fit *fit)
{
    printf("distance in %-16s %9s  %8s  %8s", strcmp(fit->unit, "m") == 0 ? "metres" : fit->unit, "places", "median",
           "mean");
    for (int t = 0; t < CN_SURFACE_THRESHOLDS; t++)
        printf("  < %4.2f ", cn_surface_thresholds_m[t]);
    printf("\n");
    print_distances(fit->sparse ? "sparse points to mesh" : "completeness (to mesh)", &fit->from_reference);
    if (fit->sparse) return;
    print_distances("accuracy (from mesh)", &fit->from_mesh);
    printf("%-28s %9s  %8s  %8s", "F-score", "", "", "");
    for (int t = 0; t < CN_SURFACE_THRESHOLDS; t++)
        printf("  %7.3f", fit->f_score[t]);
    printf("\nChamfer distance %.3f %s\n", fit->chamfer_m, fit->unit);
}

typedef struct options {
    const char *blend, *geometry, *depths;
    double cube_m;
    bool json;
} options;

static const cn_app_option table[] = { { "json", NULL, "print JSON", CN_APP_FLAG, offsetof(options, json), NULL },
                                       { "blend", "NAME",
                                         "how tiles are blended, instead of as in city.yaml; the result goes to "
                                         "CITY/eval-NAME. all: score every way and print a table",
                                         CN_APP_CHOICE, offsetof(options, blend), CN_APP_BLENDS " all" },
                                       { "geometry", "REF.ply",
                                         "score the surface instead: a mesh of the city (CITY/eval/mesh.ply) against "
                                         "points or triangles in the same local metres; points: against the sparse "
                                         "points of the poses. Writes CITY/eval/geometry.json",
                                         CN_APP_TEXT, offsetof(options, geometry), "points" },
                                       { "gsd", "METRES",
                                         "with --geometry: length of a triangle's side; by default as fine as the "
                                         "photos",
                                         CN_APP_NUMBER, offsetof(options, cube_m), NULL },
                                       { "depths", "FROM",
                                         "with --geometry: where the mesh's depths come from, as in `conurb export`",
                                         CN_APP_CHOICE, offsetof(options, depths), "stereo field" },
                                       { 0 } };

static cn_status check_options(const options *o)
{
    if (o->cube_m < 0) return cn_fail(CN_ERR_USAGE, "--gsd %g: give metres above 0", o->cube_m);
    if (!o->geometry && (o->cube_m > 0 || o->depths))
        return cn_fail(CN_ERR_USAGE, "%s: it is for a mesh; give --geometry too", o->cube_m > 0 ? "--gsd" : "--depths");
    if (o->geometry && o->blend)
        return cn_fail(CN_ERR_USAGE, "--blend: it is for pictures; leave it out with --geometry");
    return CN_OK;
}

static cn_status eval_geometry(const cn_context *ctx, cn_city *city, const options *o, const char *folder)
{
    const char *reference = strcmp(o->geometry, "points") == 0 ? NULL : o->geometry;
    cn_surface_fit fit;
    CN_TRY(cn_city_eval_geometry(ctx, city, reference, o->cube_m, o->depths, &fit));
    if (o->json) return print_fit_file(folder);
    print_fit(&fit);
    return CN_OK;
}

static cn_status run_eval(const cn_context *ctx, const cn_app_call *call)
{
    const options *o = call->options;
    cn_city *city;
    cn_eval eval;
    CN_TRY(check_options(o));
    CN_TRY(cn_city_open(&city, call->operands[0]));
    if (o->geometry) {
        const cn_status fitted = eval_geometry(ctx, city, o, call->operands[0]);
        cn_city_close(&city);
        return fitted;
    }
    const bool all = o->blend && strcmp(o->blend, "all") == 0;
    const cn_status status = all ? compare_blends(ctx, city, o->json) : cn_city_eval(ctx, city, o->blend, &eval);
    cn_city_close(&city);
    CN_TRY(status);
    if (all) return CN_OK;
    if (o->json) {
        print_eval_json(&eval);
        printf("\n");
    } else if (!eval.n_photos) {
        printf("There is no score: no photo is held out. Set plan.hold_out_every in city.yaml, or add photos.\n");
    } else {
        printf("%-32s %-22s %-18s   %-18s   %-18s   %-18s\n", "photo", "tile", "plain PSNR, SSIM", "right half, fitted",
               "the same, no fit", "colour-corrected");
        for (uint32_t i = 0; i < eval.n_photos; i++) {
            const cn_eval_photo *p = &eval.photos[i];
            print_row(p->name, p->tile, (const cn_score[4]){ p->plain, p->half, p->unfitted, p->corrected });
        }
        print_row("mean", "", (const cn_score[4]){ eval.plain, eval.half, eval.unfitted, eval.corrected });
        printf("%.2f s a picture (median)\n", eval.render_s);
    }
    cn_eval_deinit(&eval);
    return CN_OK;
}

const cn_app_command cn_app_eval = {
    .name = "eval",
    .summary = "score the city on its held-out photos: PSNR and SSIM",
    .forms = "CITY",
    .about =
        "Held-out photos are those that training never saw. There are four scores. Plain: the whole photo, with "
        "the mean appearance of its capture run, aligned between tiles, and its EXIF exposure. Right half, fitted: "
        "the appearance is fitted to the left half of the photo, and the right half is scored (the protocol of "
        "NeRF-W). The same, no fit: the right half without that fit. Colour-corrected: plain, after the best "
        "affine transform of colour.\n\nWrites CITY/eval/eval.json, and for each photo a picture of truth, render and "
        "error side by side.",
    .example = "conurb eval beach --json",
    .min_operands = 1,
    .max_operands = 1,
    .options = table,
    .size = sizeof(options),
    .computes = true,
    .run = run_eval,
};
