#include "app.h"

static cn_status run_train(const cn_context *ctx, const cn_app_args *args)
{
    const char *folder, *tile = NULL, *quality_name = NULL;
    double budget = 0;
    int quality;
    const cn_app_option options[] = { { "--tile", &tile, NULL, NULL },
                                      { "--quality", &quality_name, NULL, NULL },
                                      { "--time-budget", NULL, &budget, NULL },
                                      { 0 } };
    cn_city *city;
    CN_TRY(cn_app_parse(args, &folder, options));
    CN_TRY(cn_app_parse_quality(quality_name, &quality));
    CN_TRY(cn_city_open(&city, folder));
    const cn_status status = cn_city_train(ctx, city, tile, quality, budget);
    cn_city_close(&city);
    return status;
}

const cn_app_command cn_app_train = {
    "train",
    "train one tile or all; resumes",
    "usage: conurb train CITY [--tile ID] [--quality preview|standard|high|reference] [--time-budget 60s]\n\n"
    "  --tile ID        only that tile of CITY/plan/plan.json\n  --quality Q      instead of city.yaml's\n"
    "  --time-budget T  a tile: 90s, 20m, 2h; where neither this nor city.yaml names\n"
    "                   quality or size, those expected to be best in it are chosen\n\nexample: conurb train beach "
    "--quality preview",
    run_train,
};
