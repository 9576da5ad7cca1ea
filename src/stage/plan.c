#include "conurb/stage.h"
#include "stage/effect_probe.h"
#include "stage/device.h"
#include "stage/forecast.h"
#include "city/lock.h"
#include "city/workspace.h"

#include "base/file.h"
#include "base/number.h"
#include "record/record.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void cost(void *user, const cn_plan_tile *tile, double *seconds, uint64_t *bytes)
{
    cn_train_cost(user, tile, seconds, bytes);
}

/* The registry's rules with the settings of city.yaml. Both are in the order of the registry. */
static uint32_t gather_rules(const cn_config *config, cn_effect_rule rules[CN_MAX_EFFECTS])
{
    uint32_t n;
    const cn_effect_rule *known = cn_effect_rules(&n);
    for (uint32_t i = 0; i < n; i++) {
        rules[i] = known[i];
        rules[i].wanted = config->effects[i];
    }
    return n;
}

static void print_plan(const cn_context *ctx, const cn_train_options *train, const cn_plan *plan, const cn_dataset *m)
{
    const cn_device_info *device = cn_forecast_device(ctx);
    const cn_frame *frame = &m->frame;
    for (uint32_t i = 0; i < plan->n_tiles; i++) {
        const cn_plan_tile *t = &plan->tiles[i];
        char on_device[300] = "";
        const cn_train_input input = { &m->scene, &m->photos, m->pixels, t };
        if (device)
            cn_print(on_device, sizeof on_device, ", and %.0f MB on %s with %.0f MB of photos",
                     (double)cn_forecast_device_bytes(train, &input) / 1e6, device->name,
                     (double)cn_train_device_photo_bytes(train, &input) / 1e6);
        cn_log(ctx, CN_LOG_INFO, "tile %s: radius %.3g %s, %u photos, %u held out, %.0f s, %.0f MB%s", t->id,
               t->radius_m, cn_frame_unit(frame), t->n_photos, t->n_held_out, t->estimate_s,
               (double)t->estimate_bytes / 1e6, on_device);
        cn_log(ctx, CN_LOG_INFO, "    %-16s %9s %9s  %-3s %-35s %8s %9s", "effect", "evidence", "threshold", "is",
               "because of", "time", "memory");
        for (uint32_t e = 0; e < t->n_effects; e++) {
            const cn_plan_effect *f = &t->effects[e];
            char evidence[16] = "-";
            if (isfinite(f->evidence)) cn_print(evidence, sizeof evidence, "%.3f", f->evidence);
            cn_log(ctx, CN_LOG_INFO, "    %-16s %9s %9.3f  %-3s %-35s %+6.0f s %+6.1f MB", f->name, evidence,
                   f->threshold, f->on ? "on" : "off", f->reason, f->cost_s, (double)f->cost_bytes / 1e6);
        }
    }
    for (uint32_t i = 0; i < plan->n_warnings; i++)
        cn_log(ctx, CN_LOG_WARN, "%s", plan->warnings[i]);
}

/* kind: "depth" or "normal". folder NULL: there are no such maps. */
static void say_maps(const cn_context *ctx, const cn_photo_index *index, const char *kind, const char *folder)
{
    uint32_t n = 0;
    const char *without = NULL;
    for (uint32_t i = 0; i < index->n_photos; i++) {
        const cn_photo *photo = &index->photos[i];
        const char *map = *kind == 'd' ? photo->depth : photo->normal;
        n += map != NULL;
        if (!map && !without) without = photo->name;
    }
    if (!folder) return;
    if (without)
        cn_log(ctx, CN_LOG_WARN, "%u of %u photos have a %s map in %s; %s has none", n, index->n_photos, kind, folder,
               without);
    else
        cn_log(ctx, CN_LOG_INFO, "all %u photos have a %s map", n, kind);
}

static cn_status make_plan(const cn_context *ctx, cn_city *city, cn_dataset *m, bool dry_run, bool forecast)
{
    char *pixels = cn_city_path(city, "pixels.bin"), *dir = cn_city_path(city, "plan");
    cn_effect_rule rules[CN_MAX_EFFECTS];
    cn_plan_options options = city->config.plan;
    cn_train_options train = city->config.train;
    options.n_rules = gather_rules(&city->config, rules);
    options.rules = rules;
    options.cost = cost;
    options.cost_user = &train;
    cn_status status = pixels && dir ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    say_maps(ctx, &m->photos, "depth", city->config.maps.depth);
    say_maps(ctx, &m->photos, "normal", city->config.maps.normal);
    if (status == CN_OK) status = cn_pixel_store_build(ctx, &m->photos, city->config.width_px, pixels);
    if (status == CN_OK) status = cn_pixel_store_open(&m->pixels, pixels);
    const cn_plan_input input = { &m->scene, &m->photos, &m->frame, m->pixels };
    cn_plan plan = { 0 };
    if (status == CN_OK) status = cn_plan_make(ctx, &input, &options, &plan);
    if (status == CN_OK) status = cn_probe_plan(ctx, city, m, &plan, dry_run);
    if (status == CN_OK) print_plan(ctx, &train, &plan, m);
    if (status == CN_OK && forecast) status = cn_forecast(ctx, &city->config, &plan, m);
    if (status == CN_OK && !dry_run) status = cn_folder_make(dir);
    if (status == CN_OK && !dry_run) status = cn_plan_save(&plan, &input, dir);
    cn_plan_deinit(&plan);
    free(pixels);
    free(dir);
    return status;
}

static cn_status show_plan(const cn_context *ctx, const cn_city *city, cn_dataset *m)
{
    char *dir = cn_city_path(city, "plan");
    const cn_status status = dir ? cn_plan_load(&m->plan, &m->scene, dir) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) {
        cn_log(ctx, CN_LOG_INFO, "the plan is done");
        print_plan(ctx, &city->config.train, &m->plan, m);
    }
    free(dir);
    return status;
}

/* Needs the plan's lock: two processes that build the store would write one file. */
static cn_status use_plan(const cn_context *ctx, const cn_city *city, cn_dataset *m)
{
    char *pixels = cn_city_path(city, "pixels.bin");
    const cn_status status = pixels ? cn_pixel_store_build(ctx, &m->photos, city->config.width_px, pixels)
                                    : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(pixels);
    return status == CN_OK ? show_plan(ctx, city, m) : status;
}

static cn_status plan_alone(const cn_context *ctx, cn_city *city, const cn_stage *stage, cn_dataset *m)
{
    cn_city_lock lock;
    CN_TRY(cn_city_lock_take(&lock, ctx, city, "plan", "the plan"));
    cn_status status = cn_folder_sweep(city->folder, "pixels", 0);
    if (status == CN_OK)
        status = cn_stage_done(city, stage, NULL) ? use_plan(&lock.ctx, city, m)
                                                  : make_plan(&lock.ctx, city, m, false, false);
    if (status == CN_OK) status = cn_stage_finish(city, stage);
    cn_city_lock_drop(&lock);
    return status;
}

/* For the plan on disk, which a dry run does not write. */
static cn_status forecast_saved(const cn_context *ctx, cn_city *city)
{
    cn_context own = *ctx;
    cn_dataset m;
    cn_device *device;
    CN_TRY(cn_stage_device(ctx, city, &device)); /* that would train */
    if (device) own.device = device;
    cn_status status = cn_dataset_load(ctx, city, true, &m);
    if (status == CN_OK) {
        status = cn_forecast(&own, &city->config, &m.plan, &m);
        cn_dataset_deinit(&m);
    }
    cn_device_destroy(&device);
    return status;
}

cn_status cn_city_plan(const cn_context *ctx, cn_city *city, bool dry_run, bool forecast)
{
    cn_stage stage;
    cn_dataset m;
    CN_TRY(cn_stage_plan(city, &stage));
    bool done = !dry_run && cn_stage_done(city, &stage, NULL);
    CN_TRY(cn_dataset_load(ctx, city, false, &m));
    /* Check the store even when the plan is done: a stopped run may have left it at another width. */
    cn_status status = done ? cn_dataset_pixels_current(&m, &done) : CN_OK;
    if (status == CN_OK)
        status = dry_run ? make_plan(ctx, city, &m, true, forecast)
                 : done  ? show_plan(ctx, city, &m)
                         : plan_alone(ctx, city, &stage, &m);
    if (status == CN_OK && done) cn_city_lock_tidy(city, "plan");
    cn_dataset_deinit(&m);
    return status == CN_OK && forecast && !dry_run ? forecast_saved(ctx, city) : status;
}
