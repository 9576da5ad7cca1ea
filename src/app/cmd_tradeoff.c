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
    /* Recommends the fastest setting within half a decibel of the best. */
    quick = best;
    for (uint32_t i = 0; i < t->n; i++)
        if (t->rows[i].psnr > t->rows[best].psnr - 0.5 && t->rows[i].train_s < t->rows[quick].train_s) quick = i;
    printf("Best: %s. %s\n", t->rows[best].name, quick == best ? "No faster setting is within 0.5 dB of it." : "");
    if (quick != best)
        printf("%s takes %.0f %% of its training time for %.2f dB less.\n", t->rows[quick].name,
               100 * t->rows[quick].train_s / t->rows[best].train_s, t->rows[best].psnr - t->rows[quick].psnr);
}

typedef struct options {
    const char *tile, *quality;
    double steps, time_budget_s;
    bool effects, fields;
} options;

static const cn_app_option table[] = {
    { "effects", NULL, "compare effects: switch each one against the plan. Writes CITY/tradeoff-effects.csv and .svg",
      CN_APP_FLAG, offsetof(options, effects), NULL },
    { "fields", NULL, "compare field types, each at two sizes. Writes CITY/tradeoff-fields.csv and .svg", CN_APP_FLAG,
      offsetof(options, fields), NULL },
    { "tile", "ID", "tile to train; by default the one with the most photos", CN_APP_TEXT, offsetof(options, tile),
      NULL },
    { "quality", "NAME", "preset, instead of the one in city.yaml; its other settings hold", CN_APP_CHOICE,
      offsetof(options, quality), CN_APP_QUALITIES },
    { "steps", "N", "training steps of each run", CN_APP_NUMBER, offsetof(options, steps), NULL },
    { "time-budget", "T", "time for all runs: 90s, 20m, 2h. The next call resumes", CN_APP_TIME,
      offsetof(options, time_budget_s), NULL },
    { 0 }
};

static cn_status run_tradeoff(const cn_context *ctx, const cn_app_call *call)
{
    const options *o = call->options;
    if (o->steps < 0 || o->steps > 1e7) return cn_fail(CN_ERR_USAGE, "--steps: give 0 to 10000000");
    if (o->effects && o->fields) return cn_fail(CN_ERR_USAGE, "give --effects or --fields, not both");
    const cn_tradeoff_options tradeoff = { .effects = o->effects,
                                           .fields = o->fields,
                                           .tile = o->tile,
                                           .quality = cn_app_quality(o->quality),
                                           .budget_s = o->time_budget_s,
                                           .steps = (uint32_t)o->steps };
    cn_city *city;
    cn_tradeoff t;
    CN_TRY(cn_city_open(&city, call->operands[0]));
    const cn_status status = cn_city_tradeoff(ctx, city, &tradeoff, &t);
    cn_city_close(&city);
    CN_TRY(status);
    if (o->effects)
        print_effects(&t);
    else
        print_grid(&t);
    cn_tradeoff_deinit(&t);
    return CN_OK;
}

const cn_app_command cn_app_tradeoff = {
    .name = "tradeoff",
    .summary = "measure accuracy against training time, and the gain of each effect",
    .forms = "CITY",
    .about = "Trains one tile several times in CITY/tradeoff, and scores each run on the held-out photos. Without "
             "--effects and --fields it changes one setting at a time (steps, samples, march, table, levels, MLP, "
             "width of the photos, precision), and writes CITY/tradeoff.csv and .svg. After a stop, run the same "
             "command again: it resumes.",
    .example = "conurb tradeoff beach --quality preview --time-budget 20m",
    .min_operands = 1,
    .max_operands = 1,
    .options = table,
    .size = sizeof(options),
    .run = run_tradeoff,
};
