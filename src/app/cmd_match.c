#include "app.h"

static cn_status run_match(const cn_context *ctx, const cn_app_args *args)
{
    const char *folder, *appearance = NULL;
    const cn_app_option options[] = { { "--appearance", &appearance, NULL, NULL }, { 0 } };
    cn_city *city;
    CN_TRY(cn_app_parse(args, &folder, options));
    CN_TRY(cn_city_open(&city, folder));
    const cn_status status = cn_city_match(ctx, city, appearance);
    cn_city_close(&city);
    return status;
}

const cn_app_command cn_app_match = {
    "match",
    "give all tiles the same light, from a root tile on",
    "usage: conurb match CITY [--appearance PHOTO|mean|A:B:0.3|fit:PHOTO]\n\n"
    "  --appearance   the light to match; by default mean. Any light is matched when it is first rendered, too\n\n"
    "Each tile is fitted to its neighbours that are matched already, in places that both see. Prints how much the "
    "renders of each two\n"
    "neighbours differ (RMSE of display-encoded colours). The rows are kept in CITY/match until a tile changes.\n\n"
    "example: conurb match beach --appearance DJI_0018.JPG",
    run_match,
};
