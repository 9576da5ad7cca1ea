#include "app.h"

static cn_status run_run(const cn_context *ctx, const cn_app_args *args)
{
    const char *folder, *quality_name = NULL;
    int quality;
    const cn_app_option options[] = {{"--quality", &quality_name, NULL, NULL}, {0}};
    cn_city *city;
    CN_TRY(cn_app_parse(args, &folder, options));
    CN_TRY(cn_app_parse_quality(quality_name, &quality));
    CN_TRY(cn_city_open(&city, folder));
    const cn_status status = cn_city_run(ctx, city, quality);
    cn_city_close(&city);
    return status;
}

const cn_app_command cn_app_run = {
    "run",
    "all of the above in order, skipping what is done",
    "usage: conurb run CITY [--quality preview|standard|high|reference]\n\nexample: conurb init beach --photos photos && conurb run beach",
    run_run,
};
