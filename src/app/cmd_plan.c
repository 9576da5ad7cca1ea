#include "app.h"

static cn_status run_plan(const cn_context *ctx, const cn_app_args *args)
{
    const char *folder;
    bool dry = false, no_forecast = false;
    const cn_app_option options[] = { { "--dry-run", NULL, NULL, &dry },
                                      { "--no-forecast", NULL, NULL, &no_forecast },
                                      { 0 } };
    cn_city *city;
    CN_TRY(cn_app_parse(args, &folder, options));
    CN_TRY(cn_city_open(&city, folder));
    const cn_status status = cn_city_plan(ctx, city, dry, !no_forecast);
    cn_city_close(&city);
    return status;
}

const cn_app_command cn_app_plan = {
    "plan",
    "split the city into overlapping tiles, and say what they will cost",
    "usage: conurb plan CITY [--dry-run] [--no-forecast]\n\nEnds with the time and memory that each preset would take "
    "on this machine. The first "
    "time measures for some seconds.\n\n"
    "  --dry-run      print the plan, write nothing\n"
    "  --no-forecast  do not measure this machine: the plan alone\n\nexample: conurb plan beach && xdg-open "
    "beach/plan/plan.svg",
    run_plan,
};
