/* Accuracy against time: experiments with one tile, as a table, a CSV file and a chart. */
#include "stage/experiment.h"
#include "stage/tradeoff_chart.h"

#include "base/clock.h"
#include "base/file.h"
#include "conurb/stage.h"
#include "kernel/kernel.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The tile that was asked for, or the one with the most photos that has held-out photos. */
static cn_status choose_tile(const cn_dataset *m, const char *id, const cn_plan_tile **out)
{
    const int64_t found = id ? cn_plan_find(&m->plan, id) : -1;
    *out = found >= 0 ? &m->plan.tiles[found] : NULL;
    if (id && found < 0) return cn_fail(CN_ERR_USAGE, "the plan has no tile '%s'; see plan/plan.json", id);
    for (uint32_t i = 0; !id && i < m->plan.n_tiles; i++) {
        const cn_plan_tile *t = &m->plan.tiles[i];
        if (t->n_held_out && (!*out || t->n_photos > (*out)->n_photos)) *out = t;
    }
    if (!*out || !(*out)->n_held_out)
        return cn_fail(CN_ERR_DATA,
                       "no held-out photo to measure with; set plan.hold_out_every and run `conurb plan` again");
    return CN_OK;
}

/* A series of experiments with one tile. */
typedef struct series {
    const cn_context *ctx;
    const cn_city *city;
    const cn_dataset *dataset;
    const cn_plan_tile *tile;
    cn_train_options base;
    const char *truth; /* as in cn_experiment */
    cn_tradeoff *results;
    double started, budget_s; /* budget_s 0: no limit */
    double factor;            /* correction of predicted times, from the last experiment */
    uint32_t total;           /* experiments, for the report */
} series;

static void report(const series *s)
{
    const cn_tradeoff *t = s->results;
    const double elapsed = cn_now_s() - s->started, done = t->n;
    const cn_tradeoff_row *last = &t->rows[t->n - 1];
    cn_log(s->ctx, CN_LOG_INFO,
           "%-28s %7.1f s training, %6.2f s a photo, %6.0f MB, held-out PSNR %.2f dB, half %.2f dB", last->name,
           last->train_s, last->render_s, last->bytes / 1e6, last->psnr, last->half_psnr);
    cn_progress(s->ctx, &(cn_progress_report){ "tradeoff", last->name, done, s->total, elapsed,
                                               elapsed / done * (s->total - done), NULL });
}

static cn_status add_experiment(series *s, cn_experiment *experiment)
{
    CN_TRY(cn_experiment_run(s->ctx, s->city, s->dataset, experiment));
    cn_tradeoff_row *row = &s->results->rows[s->results->n++];
    *row = (cn_tradeoff_row){ .train_s = experiment->train_s,
                              .render_s = experiment->render_s,
                              .bytes = (double)experiment->bytes,
                              .psnr = experiment->plain.psnr,
                              .half_psnr = experiment->half.psnr,
                              .disk_bytes = (double)experiment->disk,
                              .ssim = s->results->fitted ? experiment->half.ssim : experiment->plain.ssim,
                              .depth_error_m = experiment->depth_error_m,
                              .depth_within = experiment->depth_within,
                              .train_psnr = experiment->train_psnr };
    snprintf(row->name, sizeof row->name, "%s", experiment->name);
    report(s);
    return CN_OK;
}

/* The planned effects, then each effect switched in turn. */
static cn_status try_effects(series *s)
{
    const cn_plan_tile *tile = s->tile;
    s->total = tile->n_effects + 1;
    cn_experiment planned = { .name = "planned", .options = s->base, .tile = tile };
    CN_TRY(add_experiment(s, &planned));
    for (uint32_t e = 0; e < tile->n_effects; e++) {
        cn_plan_tile turned = *tile; /* lists are borrowed */
        turned.effects[e].on = !turned.effects[e].on;
        cn_experiment experiment = { .options = s->base, .tile = &turned };
        snprintf(experiment.name, sizeof experiment.name, "%s-%s", turned.effects[e].on ? "with" : "without",
                 turned.effects[e].name);
        CN_TRY(add_experiment(s, &experiment));
    }
    return CN_OK;
}

/* The experiments: base settings, each with one setting changed at a time. photos: working width; the last one is the
 * precision. */
typedef struct point {
    const char *name;
    double steps, samples, step;
    int table, levels, width;
    double photos;
    cn_precision precision;
} point;
static const point POINTS[] = {
    { "base", 1, 1, 1, 0, 0, 0, 1, 0 },
    { "steps-quarter", 0.25, 1, 1, 0, 0, 0, 1, 0 },
    { "steps-half", 0.5, 1, 1, 0, 0, 0, 1, 0 },
    { "steps-double", 2, 1, 1, 0, 0, 0, 1, 0 },
    { "samples-half", 1, 0.5, 1, 0, 0, 0, 1, 0 },
    { "samples-double", 1, 2, 1, 0, 0, 0, 1, 0 },
    { "march-coarse", 1, 1, 2, 0, 0, 0, 1, 0 },
    { "march-fine", 1, 1, 0.5, 0, 0, 0, 1, 0 },
    { "table-eighth", 1, 1, 1, -3, 0, 0, 1, 0 },
    { "table-quarter", 1, 1, 1, -2, 0, 0, 1, 0 },
    { "table-quadruple", 1, 1, 1, 2, 0, 0, 1, 0 },
    { "levels-12", 1, 1, 1, 0, -4, 0, 1, 0 },
    { "levels-8", 1, 1, 1, 0, -8, 0, 1, 0 },
    { "mlp-32", 1, 1, 1, 0, 0, 32, 1, 0 },
    { "mlp-128", 1, 1, 1, 0, 0, 128, 1, 0 },
    { "photos-half", 1, 1, 1, 0, 0, 0, 0.5, 0 },
    { "float", 1, 1, 1, 0, 0, 0, 1, CN_PRECISION_FLOAT },
    { "small-fast", 0.5, 0.5, 2, -3, -4, 32, 1, 0 },
};
enum { N_POINTS = sizeof POINTS / sizeof *POINTS };

/* Adds to a setting of the field, clamped to its range. A type without that setting does not change. */
static void change(cn_field_options *field, const char *name, double by)
{
    uint32_t n;
    const cn_field_option *options = cn_field_type_options(field->type, &n);
    for (uint32_t i = 0; i < n; i++)
        if (strcmp(options[i].name, name) == 0)
            field->value[i] = fmin(options[i].most, fmax(options[i].least, field->value[i] + by));
}

static cn_train_options options_of(const cn_train_options *base, const point *p)
{
    cn_train_options o = *base;
    o.steps = (uint32_t)fmax(1, round(o.steps * p->steps));
    o.samples_per_step = (uint32_t)fmax(4096, round(o.samples_per_step * p->samples));
    o.march_step *= p->step;
    change(&o.field, "log2_table", p->table);
    change(&o.field, "levels", p->levels);
    o.precision = p->precision ? p->precision : o.precision;
    if (p->width) {
        change(&o.field, "density_width", p->width - cn_field_options_get(&o.field, "density_width"));
        change(&o.field, "colour_width", p->width - cn_field_options_get(&o.field, "colour_width"));
    }
    return o;
}

static double guess_s(const cn_train_options *o, const cn_plan_tile *tile)
{
    double seconds;
    uint64_t bytes;
    cn_train_cost(o, tile, &seconds, &bytes);
    return seconds;
}

/* Runs an experiment, unless the time left is too short for it. */
static cn_status try_within(series *s, cn_experiment *experiment)
{
    const double guess = s->factor * guess_s(&experiment->options, experiment->tile);
    if (s->budget_s > 0 && s->results->n && cn_now_s() - s->started + guess > s->budget_s) {
        cn_log(s->ctx, CN_LOG_INFO, "%s would take %.0f s more than the time left: the next call does it",
               experiment->name, guess);
        return CN_OK;
    }
    CN_TRY(add_experiment(s, experiment));
    s->factor = experiment->train_s / fmax(guess_s(&experiment->options, experiment->tile), 1e-3);
    return CN_OK;
}

/* One setting at a time until the time is over. The log names the rest, and the next call does it. */
static cn_status try_grid(series *s)
{
    s->total = N_POINTS;
    for (uint32_t i = 0; i < N_POINTS; i++) {
        /* Without bfloat16 this experiment would equal the base. */
        if (POINTS[i].precision == CN_PRECISION_FLOAT && cn_kernel_float() == cn_kernel_best()) continue;
        cn_experiment experiment = { .options = options_of(&s->base, &POINTS[i]), .tile = s->tile };
        if (POINTS[i].photos != 1)
            experiment.width_px = (uint32_t)fmax(16, round(POINTS[i].photos * s->city->config.width_px));
        snprintf(experiment.name, sizeof experiment.name, "%s", POINTS[i].name);
        CN_TRY(try_within(s, &experiment));
    }
    return CN_OK;
}

/* Every field type, with the settings of the quality and of preview. */
static cn_status try_fields(series *s, int wanted)
{
    const int quality = wanted < 0 ? (int)s->city->config.quality : wanted;
    const int sizes = quality == CN_QUALITY_PREVIEW ? 1 : 2;
    const char *name, *summary;
    uint32_t types = 0;
    while (cn_field_type_at(types, &name, &summary))
        types++;
    s->total = types * (uint32_t)sizes;
    for (int small = sizes - 1; small >= 0; small--)
        for (uint32_t i = 0; cn_field_type_at(i, &name, &summary); i++) {
            cn_experiment experiment = { .options = s->base, .tile = s->tile, .truth = s->truth };
            CN_TRY(cn_field_options_preset(name, small ? CN_QUALITY_PREVIEW : (cn_quality)quality,
                                           &experiment.options.field));
            snprintf(experiment.name, sizeof experiment.name, "%s%s", name, small ? "-small" : "");
            CN_TRY(try_within(s, &experiment));
        }
    cn_tradeoff_say_why(s->results);
    return CN_OK;
}

static cn_status write_csv(const cn_tradeoff *t, const char *path)
{
    char *text = cn_format("name,train_seconds,render_seconds_a_photo,bytes,psnr,half_psnr,ssim,disk_bytes,"
                           "depth_error_m,depth_within_10cm,train_psnr\n");
    for (uint32_t i = 0; text && i < t->n; i++) {
        const cn_tradeoff_row *r = &t->rows[i];
        char depth[64] = ",";
        if (isfinite(r->depth_error_m))
            snprintf(depth, sizeof depth, "%.4f,%.4f", r->depth_error_m, r->depth_within);
        else if (isfinite(r->depth_within)) /* most pixels have no depth */
            snprintf(depth, sizeof depth, ",%.4f", r->depth_within);
        char *longer =
            cn_format("%s%s,%.3f,%.3f,%.0f,%.4f,%.4f,%.4f,%.0f,%s,%.4f\n", text, r->name, r->train_s, r->render_s,
                      r->bytes, r->psnr, r->half_psnr, r->ssim, r->disk_bytes, depth, r->train_psnr);
        free(text);
        text = longer;
    }
    const cn_status status = text ? cn_file_write(path, text, strlen(text)) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(text);
    return status;
}

typedef cn_status (*draw)(const cn_tradeoff *t, const char *path);

static cn_status finish(const cn_city *city, const char *stem, draw chart, const cn_tradeoff *t)
{
    char *csv = cn_format("%s/%s.csv", city->folder, stem), *svg = cn_format("%s/%s.svg", city->folder, stem);
    cn_status status = csv && svg ? write_csv(t, csv) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = chart(t, svg);
    free(csv);
    free(svg);
    return status;
}

cn_status cn_city_tradeoff(const cn_context *ctx, cn_city *city, const cn_tradeoff_options *o, cn_tradeoff *t)
{
    *t = (cn_tradeoff){ 0 };
    cn_dataset m;
    CN_TRY(cn_dataset_load(ctx, city, true, &m));
    series s = { .ctx = ctx,
                 .city = city,
                 .dataset = &m,
                 .base = cn_config_train(&city->config, o->quality, 0),
                 .truth = o->truth,
                 .results = t,
                 .started = cn_now_s(),
                 .budget_s = o->budget_s,
                 .factor = 1 };
    s.base.teacher = NULL; /* a teacher's time counts too */
    cn_status status = choose_tile(&m, o->tile, &s.tile);
    if (status == CN_OK) s.base.steps = o->steps ? o->steps : cn_train_steps(&s.base, s.tile);
    s.base.steps_per_photo = 0;
    t->rows = calloc(N_POINTS + CN_MAX_EFFECTS + 1, sizeof *t->rows);
    if (status == CN_OK && !t->rows) status = cn_fail(CN_ERR_NOMEM, "out of memory");
    for (uint32_t e = 0; status == CN_OK && e < s.tile->n_effects; e++)
        t->fitted = t->fitted || (s.tile->effects[e].on && strcmp(s.tile->effects[e].name, "appearance") == 0);
    if (status == CN_OK) status = o->effects ? try_effects(&s) : o->fields ? try_fields(&s, o->quality) : try_grid(&s);
    const char *stem = o->effects ? "tradeoff-effects" : o->fields ? "tradeoff-fields" : "tradeoff";
    const draw chart = o->effects  ? cn_tradeoff_draw_effects
                       : o->fields ? cn_tradeoff_draw_fields
                                   : cn_tradeoff_draw_front;
    if (status == CN_OK) status = finish(city, stem, chart, t);
    cn_dataset_deinit(&m);
    if (status != CN_OK) cn_tradeoff_deinit(t);
    return status;
}

void cn_tradeoff_deinit(cn_tradeoff *t)
{
    free(t->rows);
    *t = (cn_tradeoff){ 0 };
}
