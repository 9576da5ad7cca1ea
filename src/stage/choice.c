#include "stage/choice.h"

#include "base/file.h"
#include "base/hash.h"
#include "base/json.h"
#include "stage/forecast.h"

#include <stdlib.h>
#include <string.h>

static bool read_known(const char *path, const char *key, cn_train_choice *choice)
{
    json_t *root = NULL;
    bool good = false;
    if (!cn_file_exists(path) || cn_json_load(path, &root) != CN_OK) return false;
    const char *made_for = json_string_value(json_object_get(root, "key")),
               *name = json_string_value(json_object_get(root, "settings"));
    for (int q = 0; made_for && name && q < CN_PRESETS; q++)
        if (strcmp(made_for, key) == 0 && strcmp(cn_preset_names[q], name) == 0) {
            choice->quality = (cn_quality)q;
            choice->options.steps = (uint32_t)json_integer_value(json_object_get(root, "steps"));
            good = choice->options.steps > 0;
        }
    json_decref(root);
    return good;
}

static cn_status write_known(const char *path, const char *key, const cn_train_choice *choice)
{
    json_t *root = json_pack("{s:s,s:s,s:I}", "key", key, "settings", cn_preset_names[choice->quality], "steps",
                             (json_int_t)choice->options.steps);
    const cn_status status = root ? cn_json_save(root, path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    json_decref(root);
    return status;
}

static cn_status choose(const cn_context *ctx, const cn_city *city, const cn_train_options *request,
                        const cn_plan_tile *tile, cn_train_choice *choice)
{
    cn_train_speed *speed;
    CN_TRY(cn_speed_open(&speed));
    const cn_status status = cn_train_choose(ctx, speed, request, tile, cn_forecast_room(&city->config), choice);
    cn_train_speed_destroy(&speed);
    return status;
}

cn_status cn_choice_make(const cn_context *ctx, const cn_city *city, const cn_train_options *request,
                         const cn_plan_tile *tile, const cn_stage *stage, cn_train_options *chosen)
{
    char key[17];
    cn_train_choice choice = { 0 };
    *chosen = *request;
    if (!request->choose) return CN_OK;
    cn_hash_hex(cn_stage_hash(stage), key);
    char *path = cn_format("%s/tiles/%s/choice.json", city->folder, tile->id);
    cn_status status = path ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK && !read_known(path, key, &choice)) {
        status = choose(ctx, city, request, tile, &choice);
        if (status == CN_OK) status = write_known(path, key, &choice);
    }
    free(path);
    CN_TRY(status);
    *chosen = cn_train_options_within(request, choice.quality);
    chosen->steps = choice.options.steps;
    cn_log(ctx, CN_LOG_INFO, "tile %s: in %.0f s the settings of %s, for about %u steps, are expected to score best",
           tile->id, request->time_budget_s, cn_preset_names[choice.quality], chosen->steps);
    return CN_OK;
}
