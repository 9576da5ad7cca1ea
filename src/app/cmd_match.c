#include "app.h"

typedef struct options {
    const char *appearance;
} options;

static const cn_app_option table[] = { { "appearance", "LIGHT",
                                         "light to align: PHOTO, mean, A:B:0.3 or fit:PHOTO; by default mean",
                                         CN_APP_TEXT, offsetof(options, appearance), NULL },
                                       { 0 } };

static cn_status run_match(const cn_context *ctx, const cn_app_call *call)
{
    const options *o = call->options;
    cn_city *city;
    CN_TRY(cn_city_open(&city, call->operands[0]));
    const cn_status status = cn_city_align(ctx, city, o->appearance);
    cn_city_close(&city);
    return status;
}

const cn_app_command cn_app_match = {
    .name = "match",
    .summary = "align the light of all tiles",
    .forms = "CITY",
    .about =
        "Each tile learned light from its own photos. This command begins with one tile, the root. It fits each "
        "further tile to the neighbours that are aligned already, at places that both see. It prints how much the "
        "renders of each pair of neighbours differ (RMSE of display-encoded colours). The result is kept in CITY/match "
        "until a tile changes.\n\nYou rarely need this command: `conurb render` aligns the lights that it shows.",
    .example = "conurb match beach --appearance DJI_0018.JPG",
    .min_operands = 1,
    .max_operands = 1,
    .options = table,
    .size = sizeof(options),
    .computes = true,
    .run = run_match,
};
