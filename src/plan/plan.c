/* Default options, warnings, and freeing a plan. */
#include "plan/plan.h"

#include "base/file.h"
#include "base/number.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MAX_WARNINGS 100u

cn_plan_options cn_plan_options_default(void)
{
    return (cn_plan_options){ .layout = CN_LAYOUT_AUTO,
                              .overlap = 0.5,
                              .min_points_seen = 0.3,
                              .min_photos = 4,
                              .hold_out_every = 8,
                              .max_tile_bytes = UINT64_C(8000000000) };
}

void cn_plan_deinit(cn_plan *plan)
{
    for (uint32_t i = 0; i < plan->n_tiles; i++) {
        free(plan->tiles[i].photos);
        free(plan->tiles[i].held_out);
    }
    for (uint32_t i = 0; i < plan->n_warnings; i++)
        free(plan->warnings[i]);
    free(plan->tiles);
    free(plan->warnings);
    *plan = (cn_plan){ 0 };
}

cn_status cn_plan_warn(const cn_context *ctx, cn_plan *plan, const char *format, ...)
{
    char text[512];
    va_list args;
    va_start(args, format);
    cn_vprint(text, sizeof text, format, args);
    va_end(args);
    if (plan->n_warnings >= MAX_WARNINGS) return CN_OK; /* more warnings of the same kind do not help */
    cn_log(ctx, CN_LOG_WARN, "%s", text);
    char **warnings = realloc(plan->warnings, sizeof *warnings * (plan->n_warnings + 1));
    if (warnings) plan->warnings = warnings;
    char *copy = warnings ? strdup(text) : NULL;
    if (!copy) return cn_fail(CN_ERR_NOMEM, "out of memory for a warning of the plan");
    plan->warnings[plan->n_warnings++] = copy;
    return CN_OK;
}

const char *cn_layout_name(cn_layout layout)
{
    static const char *const names[] = { "auto", "grid", "centres" };
    return names[layout];
}
