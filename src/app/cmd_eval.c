#include "app.h"

#include <stdio.h>

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
    const cn_app_option options[] = {{"--json", NULL, NULL, &json}, {0}};
    cn_city *city;
    cn_eval eval;
    CN_TRY(cn_app_parse(args, &folder, options));
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

const cn_app_command cn_app_eval = {
    "eval",
    "PSNR and SSIM on the held-out photos",
    "usage: conurb eval CITY [--json]\n\nWrites CITY/eval/eval.json and a picture of truth, render and error for each photo.\n\nexample: conurb eval beach --json",
    run_eval,
};
