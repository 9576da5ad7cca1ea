#include "app.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static void print_effects(const cn_tradeoff *t)
{
    printf("%-20s %-5s %10s %12s\n", "effect", "plan", "dB gained", "seconds paid");
    for (uint32_t i = 1; i < t->n; i++) {
        const bool on = strncmp(t->rows[i].name, "without", 7) == 0;
        const double sign = on ? 1 : -1;
        printf("%-20s %-5s %+10.2f %+12.1f\n", strchr(t->rows[i].name, '-') + 1, on ? "on" : "off",
               sign * (t->rows[0].half_psnr - t->rows[i].half_psnr), sign * (t->rows[0].train_s - t->rows[i].train_s));
    }
}

static void print_grid(const cn_tradeoff *t)
{
    uint32_t best = 0, quick = 0;
    printf("%-20s %10s %12s %10s %10s\n", "settings", "training", "a photo", "memory", "PSNR");
    for (uint32_t i = 0; i < t->n; i++) {
        const cn_tradeoff_row *r = &t->rows[i];
        printf("%-20s %8.1f s %10.2f s %7.0f MB %7.2f dB\n", r->name, r->train_s, r->render_s, r->bytes / 1e6, r->psnr);
        if (r->psnr > t->rows[best].psnr) best = i;
    }
    /* Advice: the quickest that is within half a decibel of the best. */
    quick = best;
    for (uint32_t i = 0; i < t->n; i++)
        if (t->rows[i].psnr > t->rows[best].psnr - 0.5 && t->rows[i].train_s < t->rows[quick].train_s) quick = i;
    printf("Best: %s. %s\n", t->rows[best].name, quick == best ? "Nothing quicker comes within 0.5 dB of it." : "");
    if (quick != best)
        printf("%s takes %.0f %% of its training time for %.2f dB less.\n", t->rows[quick].name,
               100 * t->rows[quick].train_s / t->rows[best].train_s, t->rows[best].psnr - t->rows[quick].psnr);
}

static cn_status run_tradeoff(const cn_context *ctx, const cn_app_args *args)
{
    cn_tradeoff_options o = { 0 };
    const char *folder, *quality = NULL;
    double steps = 0;
    const cn_app_option options[] = { { "--effects", NULL, NULL, &o.effects },      { "--tile", &o.tile, NULL, NULL },
                                      { "--quality", &quality, NULL, NULL },        { "--steps", NULL, &steps, NULL },
                                      { "--time-budget", NULL, &o.budget_s, NULL }, { 0 } };
    CN_TRY(cn_app_parse(args, &folder, options));
    CN_TRY(cn_app_parse_quality(quality, &o.quality));
    if (steps < 0 || steps > 1e7) return cn_fail(CN_ERR_USAGE, "--steps goes to 10000000");
    o.steps = (uint32_t)steps;
    cn_city *city;
    cn_tradeoff t;
    CN_TRY(cn_city_open(&city, folder));
    const cn_status status = cn_city_tradeoff(ctx, city, &o, &t);
    cn_city_close(&city);
    CN_TRY(status);
    if (o.effects)
        print_effects(&t);
    else
        print_grid(&t);
    cn_tradeoff_deinit(&t);
    return CN_OK;
}

const cn_app_command cn_app_tradeoff = {
    "tradeoff",
    "what accuracy costs in time, and what each effect is worth",
    "usage: conurb tradeoff CITY [--effects] [--tile ID] [--quality preview|standard|high|reference] [--steps N] "
    "[--time-budget T]\n\n"
    "Trains one tile again and again below CITY/tradeoff/, and measures each on its held-out photos. Resumes.\n\n"
    "  --effects        each effect turned on or off against the plan: CITY/tradeoff-effects.{csv,svg}\n"
    "                   otherwise one setting at a time (steps, samples, march, table, levels, MLP,\n"
    "                   width of the photos, precision): CITY/tradeoff.{csv,svg}\n"
    "  --time-budget T  stop before it is over (90s, 20m, 2h); the next call goes on\n\n"
    "example: conurb tradeoff beach --quality preview --time-budget 20m",
    run_tradeoff,
};
