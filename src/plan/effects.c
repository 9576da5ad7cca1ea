/* Which effects a tile's photos call for. */
#include "plan/plan.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

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
        /* Measured even when city.yaml decides: the plan then shows what it was decided against. */
        effect->evidence = rule->evidence ? rule->evidence(input, tile) : NAN;
        bool measured = !isnan(effect->evidence);
        effect->on = measured ? effect->evidence >= rule->threshold : rule->on_unmeasured;
        if (rule->wanted != CN_AUTO) effect->on = rule->wanted == CN_ON;
        snprintf(effect->reason, sizeof effect->reason, "%s",
                 rule->wanted != CN_AUTO ? "city.yaml" : measured ? "evidence" : "not measurable");
    }
    return CN_OK;
}
