/* Chooses the settings that are expected to score best in a given time. A larger table and a finer grid score higher in
 * the end, but each step takes longer. The time of a step is measured on this machine (probe.c). The score is a model:
 * the held-out PSNR is a ceiling less a power of the number of steps. The figures come from trainings of fox; they are
 * beside the table. */
#include "train/choose.h"

#include "train/probe.h"

#include <math.h>

#define POWER 1.2

/* ceiling_db: compared to that of standard. short_db: what is missing after 1000 steps. `high` has the settings of
 * standard and more steps. Tuned on fox at 270 px. Held-out dB of standard: 23.6, 27.6, 29.1, 30.0, 30.2, 30.5 after
 * 628, 1254, 2129, 4022, 6399, 14833 steps; 30.7 less 4.0 (steps / 1000)^-1.2 meets these to 0.1 dB. After 1600
 * steps on another day: preview 28.34, standard 28.49, reference 28.49. It was not measured on fox that reference
 * ends higher, because its photos are small; a finer grid should have that effect. Preview's ceiling comes from four
 * trainings with a budget of 60 s: preview 30.52 and 30.56 dB after 7342 and 7770 steps, standard 30.78 and 30.64 after
 * 5377 and 5121. */
static const struct curve {
    cn_quality quality;
    double ceiling_db, short_db;
} curves[] = {
    { CN_QUALITY_PREVIEW, -0.25, 4.0 },
    { CN_QUALITY_STANDARD, 0, 4.0 },
    { CN_QUALITY_REFERENCE, 0.1, 4.18 },
};
enum { CURVES = sizeof curves / sizeof *curves };

double cn_train_expected_db(cn_quality quality, double steps)
{
    const cn_quality like = quality == CN_QUALITY_HIGH ? CN_QUALITY_STANDARD : quality;
    if (!(steps >= 1)) return -INFINITY;
    for (size_t i = 0; i < CURVES; i++)
        if (curves[i].quality == like) return curves[i].ceiling_db - curves[i].short_db * pow(steps / 1000, -POWER);
    return -INFINITY;
}

size_t cn_train_choose_best(cn_candidate *candidates, size_t n, double budget_s)
{
    size_t best = 0;
    for (size_t i = 0; i < n; i++) {
        const double steps = candidates[i].step_s > 0 ? floor(budget_s / candidates[i].step_s) : 0;
        candidates[i].steps = (uint32_t)fmin(steps, 1e9);
        candidates[i].expected_db = cn_train_expected_db(candidates[i].quality, steps);
        if (candidates[i].expected_db > candidates[best].expected_db) best = i;
    }
    return best;
}

cn_train_options cn_train_options_within(const cn_train_options *request, cn_quality quality)
{
    cn_train_options o = cn_train_options_preset(quality);
    (void)!cn_field_options_preset(request->field.type, quality, &o.field);
    o.steps_per_photo = 0; /* the caller says how many steps */
    o.seed = request->seed;
    o.learning_rate = request->learning_rate;
    o.precision = request->precision;
    o.leave_out_occluders = request->leave_out_occluders;
    o.checkpoint_every_s = request->checkpoint_every_s;
    o.normal_maps = request->normal_maps;
    o.depth_maps = request->depth_maps;
    o.depth_kind = request->depth_kind;
    o.depth_along = request->depth_along;
    o.time_budget_s = request->time_budget_s;
    o.stop_gain_db = request->stop_gain_db;
    return o;
}

cn_status cn_train_choose(const cn_context *ctx, cn_train_speed *speed, const cn_train_options *request,
                          const cn_plan_tile *tile, uint64_t most_bytes, cn_train_choice *choice)
{
    cn_candidate candidates[CURVES];
    cn_train_options settings[CURVES];
    uint64_t bytes[CURVES];
    for (size_t i = 0; i < CURVES; i++) {
        double seconds;
        settings[i] = cn_train_options_within(request, curves[i].quality);
        settings[i].time_budget_s = 0;
        candidates[i] = (cn_candidate){ .quality = curves[i].quality };
        cn_train_cost(&settings[i], tile, &seconds, &bytes[i]);
        if (most_bytes && bytes[i] > most_bytes) continue;
        CN_TRY(cn_train_speed_predict(ctx, speed, &settings[i], tile, &seconds, &bytes[i]));
        candidates[i].step_s = seconds / settings[i].steps;
    }
    const size_t best = cn_train_choose_best(candidates, CURVES, request->time_budget_s);
    *choice = (cn_train_choice){ .options = settings[best], .quality = candidates[best].quality, .bytes = bytes[best] };
    choice->options.time_budget_s = request->time_budget_s;
    if (candidates[best].steps) choice->options.steps = candidates[best].steps;
    return CN_OK;
}
