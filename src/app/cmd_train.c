#include "app.h"

typedef struct options {
    const char *tile, *quality;
    double time_budget_s;
    bool view;
} options;

static const cn_app_option table[] = {
    { "tile", "ID", "train only this tile; CITY/plan/plan.json lists the tiles", CN_APP_TEXT, offsetof(options, tile),
      NULL },
    { "quality", "NAME", "preset, instead of the one in city.yaml; its other settings hold", CN_APP_CHOICE,
      offsetof(options, quality), CN_APP_QUALITIES },
    { "time-budget", "T",
      "training time for each tile: 90s, 20m, 2h. When neither --quality nor city.yaml sets a quality, "
      "samples_per_step, march_step or a key of field, the settings are chosen to suit it",
      CN_APP_TIME, offsetof(options, time_budget_s), NULL },
    { "view", NULL, "also show the city in the browser, as `conurb view` does, until Ctrl-C", CN_APP_FLAG,
      offsetof(options, view), NULL },
    { 0 }
};

static cn_status run_train(const cn_context *ctx, const cn_app_call *call)
{
    const options *o = call->options;
    cn_city *city;
    pid_t page = 0;
    CN_TRY(cn_city_open(&city, call->operands[0]));
    cn_status status = o->view ? cn_app_page_start(call, &page) : CN_OK;
    if (status == CN_OK) status = cn_city_train(ctx, city, o->tile, cn_app_quality(o->quality), o->time_budget_s);
    if (page) cn_app_page_end(ctx, page, status == CN_OK);
    cn_city_close(&city);
    return status;
}

const cn_app_command cn_app_train = {
    .name = "train",
    .summary = "train all tiles, or one",
    .forms = "CITY",
    .about =
        "Training writes a checkpoint once a minute. After a stop, run the same command again: it resumes from there. "
        "On a graphics processor, which it uses where there is one, it does the same (see --device, or train.device in "
        "city.yaml), and a checkpoint goes from one to the other.",
    .example = "conurb train beach --quality preview",
    .min_operands = 1,
    .max_operands = 1,
    .options = table,
    .size = sizeof(options),
    .computes = true,
    .run = run_train,
};
