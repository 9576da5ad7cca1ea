/* Predicts what each preset takes on this machine. The result is printed and not kept in the plan, which is the same
 * on every machine. */
#include "stage/forecast.h"

#include "base/clock.h"
#include "base/file.h"
#include "base/number.h"

#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

enum { LISTED = 40 };
const char *const cn_preset_names[CN_PRESETS] = { "preview", "standard", "high", "reference" };

/* $XDG_CACHE_HOME/conurb/speed.json, or below ~/.cache; NULL when neither is known. The caller frees it. */
static char *cache_path(void)
{
    const char *cache = getenv("XDG_CACHE_HOME"), *home = getenv("HOME");
    char *folder = cache && *cache == '/' ? cn_format("%s/conurb", cache)
                   : home && *home == '/' ? cn_format("%s/.cache/conurb", home)
                                          : NULL;
    char *path = folder && cn_folder_make(folder) == CN_OK ? cn_path_join(folder, "speed.json") : NULL;
    free(folder);
    return path;
}

static void write_time(double seconds, char text[24])
{
    if (seconds < 90)
        cn_print(text, 24, "%.0f s", seconds);
    else if (seconds < 5400)
        cn_print(text, 24, "%.0f min", seconds / 60);
    else if (seconds < 172800)
        cn_print(text, 24, "%.1f h", seconds / 3600);
    else
        cn_print(text, 24, "%.1f days", seconds / 86400);
}

cn_status cn_speed_open(cn_train_speed **speed)
{
    char *cache = cache_path();
    const cn_status status = cn_train_speed_create(speed, cache);
    free(cache);
    return status;
}

static uint64_t memory_here(void)
{
    const long pages = sysconf(_SC_PHYS_PAGES), size = sysconf(_SC_PAGESIZE);
    return pages <= 0 || size <= 0 ? UINT64_MAX : (uint64_t)(0.7 * (double)pages * (double)size);
}

uint64_t cn_forecast_room(const cn_config *config)
{
    const uint64_t here = memory_here(), wanted = config->plan.max_tile_bytes;
    return wanted && wanted < here ? wanted : here;
}

enum { LINE = 48 };
typedef struct sum {
    double seconds;
    uint64_t most, most_on_device, least_on_device; /* of a tile; least: without the photos */
    bool whole;
} sum;

const cn_device_info *cn_forecast_device(const cn_context *ctx)
{
    const cn_device_info *about = ctx->device ? cn_device_about(ctx->device) : NULL;
    return about && about->version[0] ? about : NULL;
}

static void write_cell(const cn_context *ctx, const char *time, uint64_t bytes, uint64_t on_device, char line[LINE])
{
    if (cn_forecast_device(ctx))
        cn_print(line, LINE, "%8s %5.2f +%5.2f GB", time, (double)bytes / 1e9, (double)on_device / 1e9);
    else
        cn_print(line, LINE, "%8s %5.2f GB", time, (double)bytes / 1e9);
}

uint64_t cn_forecast_device_bytes(const cn_train_options *options, const cn_train_input *input)
{
    const uint64_t bytes = cn_train_device_bytes(options, input->tile);
    return bytes ? bytes + cn_train_device_photo_bytes(options, input) : 0;
}

/* Adds a tile at one preset to the sums. */
static cn_status predict(const cn_context *ctx, cn_train_speed *speed, const cn_train_options *options,
                         const cn_train_input *input, sum *all, char line[LINE])
{
    const cn_plan_tile *tile = input->tile;
    double seconds;
    uint64_t bytes;
    char time[24] = "no room";
    cn_train_cost(options, tile, &seconds, &bytes);
    const uint64_t on_device = cn_forecast_device(ctx) ? cn_forecast_device_bytes(options, input) : 0;
    const uint64_t least = on_device ? cn_train_device_bytes(options, tile) : 0;
    if (bytes > all->most) all->most = bytes;
    if (least > all->least_on_device) all->least_on_device = least;
    if (on_device > all->most_on_device) all->most_on_device = on_device;
    if (bytes < memory_here()) { /* a preset that needs more memory than this machine has is not measured */
        CN_TRY(cn_train_speed_predict(ctx, speed, options, tile, &seconds, &bytes));
        all->seconds += seconds;
        write_time(seconds, time);
    } else {
        all->whole = false;
    }
    write_cell(ctx, time, bytes, on_device, line);
    return CN_OK;
}

typedef struct prediction {
    cn_train_options options[CN_PRESETS];
    sum all[CN_PRESETS];
    char lines[LISTED + 1][CN_PRESETS][LINE]; /* of the first tiles; the last is of one beyond them */
} prediction;

/* Trying steps takes seconds a preset, and more on a busy machine. How long is not known before. */
static void report(const cn_context *ctx, double begun, uint32_t done, uint32_t n_tiles, int preset)
{
    const cn_progress_report r = { .stage = "trying steps",
                                   .item = cn_preset_names[preset],
                                   .done = done,
                                   .total = (double)n_tiles * CN_PRESETS,
                                   .elapsed_s = cn_now_s() - begun,
                                   .left_s = -1 };
    cn_progress(ctx, &r);
}

static cn_status predict_tiles(const cn_context *ctx, cn_train_speed *speed, prediction *all, const cn_plan *plan,
                               const cn_dataset *m)
{
    const double begun = cn_now_s();
    for (uint32_t i = 0; i < plan->n_tiles; i++) {
        if (cn_stopping(ctx))
            return cn_fail(CN_ERR_INTERRUPTED, "stopped while predicting training; the plan itself is done");
        const cn_train_input input = { &m->scene, &m->photos, m->pixels, &plan->tiles[i] };
        for (int p = 0; p < CN_PRESETS; p++) {
            report(ctx, begun, i * CN_PRESETS + (uint32_t)p, plan->n_tiles, p);
            CN_TRY(predict(ctx, speed, &all->options[p], &input, &all->all[p], all->lines[i < LISTED ? i : LISTED][p]));
        }
    }
    return CN_OK;
}

static void log_heading(const cn_context *ctx)
{
    const cn_device_info *device = cn_forecast_device(ctx);
    const int width = device ? 24 : 17;
    if (device)
        cn_log(ctx, CN_LOG_INFO,
               "training on %s, by steps tried on it, with the memory of this machine + of the device:", device->name);
    else
        cn_log(ctx, CN_LOG_INFO, "training on this machine, by steps tried on it:");
    cn_log(ctx, CN_LOG_INFO, "%-20s %*s  %*s  %*s  %*s", "", width, cn_preset_names[0], width, cn_preset_names[1],
           width, cn_preset_names[2], width, cn_preset_names[3]);
}

static void log_tiles(const cn_context *ctx, const cn_plan *plan, const prediction *all)
{
    for (uint32_t i = 0; i < plan->n_tiles && i < LISTED; i++) {
        const char(*line)[LINE] = all->lines[i];
        cn_log(ctx, CN_LOG_INFO, "%-20s %s  %s  %s  %s", plan->tiles[i].id, line[0], line[1], line[2], line[3]);
    }
    if (plan->n_tiles > LISTED) cn_log(ctx, CN_LOG_INFO, "and %u tiles more", plan->n_tiles - LISTED);
}

static void log_sums(const cn_context *ctx, const sum all[CN_PRESETS])
{
    char line[CN_PRESETS][LINE], time[24];
    for (int p = 0; p < CN_PRESETS; p++) {
        write_time(all[p].seconds, time);
        write_cell(ctx, all[p].whole ? time : "no room", all[p].most, all[p].most_on_device, line[p]);
    }
    cn_log(ctx, CN_LOG_INFO, "%-20s %s  %s  %s  %s", "the city", line[0], line[1], line[2], line[3]);
    const cn_device_info *device = cn_forecast_device(ctx);
    for (int p = 0; device && p < CN_PRESETS; p++)
        if (all[p].most_on_device > device->free_bytes)
            cn_log(ctx, CN_LOG_WARN, "%s has %.2f GB free: at %s the processor %s the tiles that need more",
                   device->name, (double)device->free_bytes / 1e9, cn_preset_names[p],
                   all[p].least_on_device > device->free_bytes ? "trains" : "draws the rays of");
}

/* The settings that the time budget of city.yaml would choose, counted over the tiles. */
static cn_status log_choices(const cn_context *ctx, cn_train_speed *speed, const cn_config *config, const cn_plan *plan)
{
    const cn_train_options request = cn_config_train(config, -1, 0);
    uint32_t tiles[CN_PRESETS] = { 0 };
    uint64_t steps[CN_PRESETS] = { 0 }, most[CN_PRESETS] = { 0 };
    for (uint32_t i = 0; request.choose && i < plan->n_tiles; i++) {
        cn_train_choice choice;
        CN_TRY(cn_train_choose(ctx, speed, &request, &plan->tiles[i], cn_forecast_room(config), &choice));
        tiles[choice.quality]++;
        steps[choice.quality] += choice.options.steps;
        if (choice.bytes > most[choice.quality]) most[choice.quality] = choice.bytes;
    }
    if (request.time_budget_s > 0 && !request.choose)
        cn_log(ctx, CN_LOG_INFO, "city.yaml gives each tile %.0f s, at the settings that it names",
               request.time_budget_s);
    for (int p = 0; p < CN_PRESETS; p++)
        if (tiles[p])
            cn_log(ctx, CN_LOG_INFO,
                   "in %.0f s a tile: the settings of %s for %u of %u tiles, some %.0f steps, %.2f GB",
                   request.time_budget_s, cn_preset_names[p], tiles[p], plan->n_tiles, (double)steps[p] / tiles[p],
                   (double)most[p] / 1e9);
    return CN_OK;
}

cn_status cn_forecast(const cn_context *ctx, const cn_config *config, const cn_plan *plan, const cn_dataset *dataset)
{
    cn_train_speed *speed;
    prediction *all = calloc(1, sizeof *all);
    if (!all) return cn_fail(CN_ERR_NOMEM, "out of memory for the forecast of training");
    for (int p = 0; p < CN_PRESETS; p++) {
        all->options[p] = cn_config_train(config, p, 0);
        all->options[p].time_budget_s = 0;
        all->all[p].whole = true;
    }
    cn_status status = cn_speed_open(&speed);
    if (status == CN_OK) {
        status = predict_tiles(ctx, speed, all, plan, dataset);
        if (status == CN_OK) {
            log_heading(ctx);
            log_tiles(ctx, plan, all);
            log_sums(ctx, all->all);
            status = log_choices(ctx, speed, config, plan);
        }
        cn_train_speed_destroy(&speed);
    }
    free(all);
    return status;
}
