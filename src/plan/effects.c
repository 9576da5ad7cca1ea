/* Decides which effects a tile's photos need. */
#include "plan/plan.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* The cost of an effect: training with it minus training without it. */
static void price(cn_plan_tile *tile, cn_plan_effect *effect, const cn_plan_options *options)
{
    if (!options->cost) return;
    const bool on = effect->on;
    double with_s, without_s;
    uint64_t with, without;
    effect->on = true;
    options->cost(options->cost_user, tile, &with_s, &with);
    effect->on = false;
    options->cost(options->cost_user, tile, &without_s, &without);
    effect->on = on;
    effect->cost_s = with_s - without_s;
    effect->cost_bytes = (int64_t)with - (int64_t)without;
}

cn_status cn_plan_effects(cn_plan_tile *tile, const cn_plan_input *input, const cn_plan_options *options)
{
    if (options->n_rules > CN_MAX_EFFECTS)
        return cn_fail(CN_ERR_INTERNAL, "%u effects are more than a plan holds (%d)", options->n_rules, CN_MAX_EFFECTS);
    tile->n_effects = options->n_rules;
    for (uint32_t i = 0; i < options->n_rules; i++) {
        const cn_effect_rule *rule = &options->rules[i];
        cn_plan_effect *effect = &tile->effects[i];
        snprintf(effect->name, sizeof effect->name, "%s", rule->name);
        effect->threshold = rule->threshold;
        /* The evidence is measured even where city.yaml decides, so that the plan can show both. */
        effect->evidence = rule->evidence ? rule->evidence(input, tile) : NAN;
        bool measured = !isnan(effect->evidence);
        effect->on = measured ? effect->evidence >= rule->threshold : rule->on_unmeasured;
        if (rule->wanted != CN_AUTO) effect->on = rule->wanted == CN_ON;
        snprintf(effect->reason, sizeof effect->reason, "%s",
                 rule->wanted != CN_AUTO ? "city.yaml"
                 : measured              ? "evidence"
                                         : "not measurable");
    }
    for (uint32_t i = 0; i < tile->n_effects; i++)
        price(tile, &tile->effects[i], options);
    return CN_OK;
}
