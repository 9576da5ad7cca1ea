#include "app.h"

typedef struct options {
    bool dry_run, no_forecast;
} options;

static const cn_app_option table[] = {
    { "dry-run", NULL, "print the plan and write nothing", CN_APP_FLAG, offsetof(options, dry_run), NULL },
    { "no-forecast", NULL, "do not measure this machine, and do not print time and memory for each preset", CN_APP_FLAG,
      offsetof(options, no_forecast), NULL },
    { 0 }
};

static cn_status run_plan(const cn_context *ctx, const cn_app_call *call)
{
    const options *o = call->options;
    cn_city *city;
    CN_TRY(cn_city_open(&city, call->operands[0]));
    const cn_status status = cn_city_plan(ctx, city, o->dry_run, !o->no_forecast);
    cn_city_close(&city);
    return status;
}

const cn_app_command cn_app_plan = {
    .name = "plan",
    .summary = "split the city into overlapping tiles, and predict what training costs",
    .forms = "CITY",
    .about =
        "Writes CITY/plan/plan.json and a map, CITY/plan/plan.svg. At the end it prints the time and the memory that "
        "training needs on this machine, for each preset but compact. The first call measures the machine for some "
        "seconds.",
    .example = "conurb plan beach && xdg-open beach/plan/plan.svg",
    .min_operands = 1,
    .max_operands = 1,
    .options = table,
    .size = sizeof(options),
    .computes = true,
    .run = run_plan,
};
