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

static void say_protocol(const cn_tradeoff *t)
{
    if (t->fitted)
        printf("Photos have lights of their own: PSNR is of right halves, with the light fitted to the left ones.\n");
}

static void print_grid(const cn_tradeoff *t)
{
    uint32_t best = 0, quick = 0;
    printf("%-20s %10s %12s %10s %10s\n", "settings", "training", "a photo", "memory", "PSNR");
    for (uint32_t i = 0; i < t->n; i++) {
        const cn_tradeoff_row *r = &t->rows[i];
        printf("%-20s %8.1f s %10.2f s %7.0f MB %7.2f dB\n", r->name, r->train_s, r->render_s, r->bytes / 1e6,
               cn_tradeoff_db(t, r));
        if (cn_tradeoff_db(t, r) > cn_tradeoff_db(t, &t->rows[best])) best = i;
    }
    say_protocol(t);
    /* Recommends the fastest setting within half a decibel of the best. */
    quick = best;
    for (uint32_t i = 0; i < t->n; i++)
        if (cn_tradeoff_db(t, &t->rows[i]) > cn_tradeoff_db(t, &t->rows[best]) - 0.5 &&
            t->rows[i].train_s < t->rows[quick].train_s)
            quick = i;
    printf("Best: %s. %s\n", t->rows[best].name, quick == best ? "No faster setting is within 0.5 dB of it." : "");
    if (quick != best)
        printf("%s takes %.0f %% of its training time for %.2f dB less.\n", t->rows[quick].name,
               100 * t->rows[quick].train_s / t->rows[best].train_s,
               cn_tradeoff_db(t, &t->rows[best]) - cn_tradeoff_db(t, &t->rows[quick]));
}

/* A row that is at least so good, with the least of a figure. */
typedef double (*figure)(const cn_tradeoff_row *r);
static double train_s(const cn_tradeoff_row *r)
{
    return r->train_s;
}
static double render_s(const cn_tradeoff_row *r)
{
    return r->render_s;
}
static double disk_bytes(const cn_tradeoff_row *r)
{
    return r->disk_bytes;
}

static const cn_tradeoff_row *least(const cn_tradeoff *t, double psnr, figure of)
{
    const cn_tradeoff_row *found = NULL;
    for (uint32_t i = 0; i < t->n; i++)
        if (cn_tradeoff_db(t, &t->rows[i]) >= psnr && (!found || of(&t->rows[i]) < of(found))) found = &t->rows[i];
    return found;
}

static void advise(const cn_tradeoff *t, double best)
{
    enum { NEAR_DB = 1 };
    const struct {
        const char *purpose, *unit;
        figure of;
        double scale;
    } of[] = { { "least training", "s", train_s, 1 },
               { "fast pictures", "s a photo", render_s, 1 },
               { "a small file", "MB", disk_bytes, 1e-6 } };
    printf("Within %d dB of the best (%.2f dB):", NEAR_DB, best);
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        const cn_tradeoff_row *r = least(t, best - NEAR_DB, of[i].of);
        if (r)
            printf("%s for %s take %s (%.2f dB, %.3g %s)", i ? ";" : "", of[i].purpose, r->name, cn_tradeoff_db(t, r),
                   of[i].scale * of[i].of(r), of[i].unit);
    }
    printf(".\n");
}

/* What to take in a given time: the best among those that train no longer, from the quickest on. */
static void advise_by_time(const cn_tradeoff *t)
{
    double psnr = -INFINITY;
    const char *between = "";
    printf("By time:");
    for (double after = -1;;) {
        const cn_tradeoff_row *next = NULL;
        for (uint32_t i = 0; i < t->n; i++) {
            const cn_tradeoff_row *r = &t->rows[i];
            if (r->train_s > after && cn_tradeoff_db(t, r) > psnr && (!next || r->train_s < next->train_s)) next = r;
        }
        if (!next) break;
        printf("%s from %.0f s %s (%.2f dB)", between, next->train_s, next->name, cn_tradeoff_db(t, next));
        between = ",";
        after = next->train_s;
        psnr = cn_tradeoff_db(t, next);
    }
    printf(".\n");
}

static void print_fields(const cn_tradeoff *t)
{
    const cn_tradeoff_row *shape = NULL;
    double best = -INFINITY;
    printf("%-16s %10s %12s %9s %9s %8s %12s\n", "field", "training", "a photo", "on disk", "PSNR", "SSIM",
           "depth error");
    for (uint32_t i = 0; i < t->n; i++) {
        const cn_tradeoff_row *r = &t->rows[i];
        printf("%-16s %8.1f s %10.2f s %6.1f MB %6.2f dB %8.4f", r->name, r->train_s, r->render_s, r->disk_bytes / 1e6,
               cn_tradeoff_db(t, r), r->ssim);
        if (isfinite(r->depth_error_m))
            printf(" %10.3f m", r->depth_error_m);
        else if (isfinite(r->depth_within)) /* most pixels have no depth */
            printf(" %12s", "none");
        printf("\n");
        if (cn_tradeoff_db(t, r) > best) best = cn_tradeoff_db(t, r);
        if (isfinite(r->depth_within) && (!shape || r->depth_within > shape->depth_within)) shape = r;
    }
    say_protocol(t);
    advise_by_time(t);
    advise(t, best);
    for (uint32_t i = 0; i < t->n; i++)
        if (t->rows[i].why[0]) printf("%s lacks: %s.\n", t->rows[i].name, t->rows[i].why);
    if (shape)
        printf("For geometry take %s: %.0f %% of the pixels within 10 cm.\n", shape->name, 100 * shape->depth_within);
}

typedef struct options {
    const char *tile, *quality, *truth;
    double steps, time_budget_s;
    bool effects, fields;
} options;

static const cn_app_option table[] = {
    { "effects", NULL, "compare effects: switch each one against the plan. Writes CITY/tradeoff-effects.csv and .svg",
      CN_APP_FLAG, offsetof(options, effects), NULL },
    { "fields", NULL, "compare field types, each at two sizes, and advise. Writes CITY/tradeoff-fields.csv and .svg",
      CN_APP_FLAG, offsetof(options, fields), NULL },
    { "truth", "DIR",
      "with --fields: maps of true depth along the ray, named as the photos; an error of depth is measured",
      CN_APP_TEXT, offsetof(options, truth), NULL },
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
    if (o->truth && !o->fields) return cn_fail(CN_ERR_USAGE, "--truth goes with --fields");
    const cn_tradeoff_options tradeoff = { .effects = o->effects,
                                           .fields = o->fields,
                                           .truth = o->truth,
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
    else if (o->fields)
        print_fields(&t);
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
    .computes = true,
    .run = run_tradeoff,
};
