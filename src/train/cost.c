/* Estimates what training a tile takes: the memory exactly, the time from real steps on this machine. */
#include "train/probe.h"
#include "train/trainer.h"

#include "base/file.h"
#include "base/json.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { FORMAT = 1, MOST_KNOWN = 4096 };

struct cn_train_speed {
    char *cache, *machine; /* cache: may be NULL */
    json_t *known;         /* measured seconds of a step, if all samples were live */
};

static unsigned processors(void)
{
    const long online = sysconf(_SC_NPROCESSORS_ONLN);
    return online > 0 ? (unsigned)online : 1;
}

/* share: the time of a step with the effects, over that without, by their time_share; may be NULL. */
static uint64_t bytes_of(const cn_train_options *options, const cn_plan_tile *tile, unsigned threads, double *share)
{
    cn_trainer *trainer = calloc(1, sizeof *trainer);
    const cn_train_input input = { .tile = tile };
    cn_arena counter;
    cn_arena_count(&counter);
    uint64_t bytes = 0;
    if (share) *share = 1;
    if (trainer && cn_trainer_plan(trainer, &input, options, threads) == CN_OK) {
        cn_trainer_carve(trainer, &counter);
        bytes = counter.used;
        for (uint32_t i = 0; share && i < trainer->effects.pack.n_on; i++)
            *share += (double)trainer->effects.pack.on[i].effect->time_share;
    }
    free(trainer);
    return bytes;
}

void cn_train_cost(const cn_train_options *options, const cn_plan_tile *tile, double *seconds, uint64_t *bytes)
{
    const double samples_per_s = 0.8e6; /* a processor with AVX2; cn_train_speed_predict knows better */
    double share;
    *bytes = bytes_of(options, tile, processors(), &share);
    *seconds = options->time_budget_s > 0
                   ? options->time_budget_s
                   : share * cn_train_steps(options, tile) * options->samples_per_step / (samples_per_s * processors());
    if (options->time_budget_s > 0 || !cn_distil_makes_teacher(options)) return;
    const cn_train_options teacher = cn_distil_teacher(options);
    double more;
    uint64_t its_bytes;
    cn_train_cost(&teacher, tile, &more, &its_bytes);
    *seconds += more;
}

uint64_t cn_train_device_bytes(const cn_train_options *options, const cn_plan_tile *tile)
{
    cn_trainer *t = calloc(1, sizeof *t);
    const cn_train_input input = { .tile = tile };
    cn_arena counter;
    uint64_t bytes = 0;
    cn_arena_count(&counter);
    if (t && cn_trainer_plan(t, &input, options, 1) == CN_OK) {
        cn_trainer_carve(t, &counter);
        /* An array that is not there has no size, so the arrays are carved from an arena that hardly anything is
         * written to: it takes almost no memory. */
        if (cn_arena_init(&t->arena, counter.used) == CN_OK) {
            cn_trainer_carve(t, &t->arena);
            cn_train_device_begin(t);
            if (!t->device.step.unfit && !(cn_distil_share(&options->field) > 0))
                bytes = cn_device_step_bytes(&t->device.step);
            cn_arena_deinit(&t->arena);
        }
    }
    free(t);
    return bytes;
}

/* The maps of the tile's photos. */
static uint64_t map_bytes_of(cn_trainer *t, const cn_train_input *input)
{
    const cn_train_photos_wants wants = cn_train_photos_wanted(&t->options, &t->effects.pack);
    cn_arena arena, counter;
    cn_arena_count(&counter);
    (void)CN_ARENA_NEW(&counter, cn_train_photo, t->sampler.n_photos);
    cn_train_photos_carve(&t->device.photos, t->sampler.n_photos, &counter);
    if (cn_arena_init(&arena, counter.used) != CN_OK) return 0;
    t->sampler.photos = CN_ARENA_NEW(&arena, cn_train_photo, t->sampler.n_photos);
    cn_train_photos_carve(&t->device.photos, t->sampler.n_photos, &arena);
    uint64_t bytes = 0;
    if (cn_sampler_find_photos(&t->sampler, input, &t->box) == CN_OK) {
        cn_train_photos_list(&t->device.photos, &t->sampler, &wants);
        t->device.step.maps = (cn_step_maps){ .n = t->device.photos.n, .bytes = t->device.photos.bytes };
        bytes = cn_device_map_bytes(&t->device.step);
    }
    cn_arena_deinit(&arena);
    return bytes;
}

uint64_t cn_train_device_photo_bytes(const cn_train_options *options, const cn_train_input *input)
{
    cn_trainer *t = calloc(1, sizeof *t);
    uint64_t bytes = 0;
    if (t && input->pixels && cn_trainer_plan(t, input, options, 1) == CN_OK &&
        cn_train_device_does(&t->effects.pack) && t->parameters.field.type->describe &&
        !(cn_distil_share(&options->field) > 0))
        bytes = map_bytes_of(t, input);
    free(t);
    return bytes;
}

/* The measured figures hold for one processor, instruction set and build. */
static char *describe_machine(void)
{
    char model[128] = "unknown processor", line[256];
    FILE *info = fopen("/proc/cpuinfo", "r");
    while (info && fgets(line, sizeof line, info))
        if (strncmp(line, "model name", 10) == 0 && strchr(line, ':')) {
            snprintf(model, sizeof model, "%.100s", strchr(line, ':') + 2);
            model[strcspn(model, "\n")] = '\0';
            break;
        }
    if (info) fclose(info);
    return cn_format("%s, %s, Conurb %s, %s", model, cn_kernel_best()->name, cn_version(), __VERSION__);
}

/* The number of photos hardly changes the time of a step until there are thousands. A few sizes are therefore
 * enough. */
static uint32_t round_photos(uint32_t n)
{
    uint32_t rounded = 64;
    if (n <= 256) return rounded;
    while (rounded < n)
        rounded *= 2;
    return rounded;
}

static char *key_of(const cn_context *ctx, const cn_train_options *o, const cn_plan_tile *tile, uint32_t n_photos)
{
    const unsigned threads = cn_pool_threads(ctx ? ctx->pool : NULL);
    const cn_device_info *device = ctx && ctx->device ? cn_device_about(ctx->device) : NULL;
    const bool other = device && device->version[0]; /* not the processor */
    char effects[256] = "";
    for (uint32_t i = 0; i < tile->n_effects; i++) {
        const size_t used = strlen(effects);
        if (tile->effects[i].on) snprintf(effects + used, sizeof effects - used, " %s", tile->effects[i].name);
    }
    char field[256];
    cn_field_options_print(&o->field, field, sizeof field);
    return cn_format("threads=%u samples=%u field=%s march=%.6g precision=%d photos=%u%s%s%s", threads,
                     o->samples_per_step, field, o->march_step, (int)o->precision, n_photos, effects,
                     other ? " device=" : "", other ? device->name : "");
}

/* A cache that cannot be read counts as none. */
static json_t *read_cache(const char *path, const char *machine)
{
    json_t *root = NULL, *steps = NULL;
    if (!path || !cn_file_exists(path) || cn_json_load(path, &root) != CN_OK) return json_object();
    const char *made_on = json_string_value(json_object_get(root, "machine"));
    if (json_integer_value(json_object_get(root, "version")) == FORMAT && made_on && strcmp(made_on, machine) == 0)
        steps = json_object_get(root, "full_step_s");
    if (json_is_object(steps) && json_object_size(steps) < MOST_KNOWN)
        json_incref(steps);
    else
        steps = json_object();
    json_decref(root);
    return steps;
}

cn_status cn_train_speed_create(cn_train_speed **speed, const char *cache)
{
    *speed = calloc(1, sizeof **speed);
    if (*speed) {
        (*speed)->machine = describe_machine();
        (*speed)->cache = cache ? strdup(cache) : NULL;
        if ((*speed)->machine) (*speed)->known = read_cache((*speed)->cache, (*speed)->machine);
    }
    if (*speed && (*speed)->known && (!cache || (*speed)->cache)) return CN_OK;
    cn_train_speed_destroy(speed);
    return cn_fail(CN_ERR_NOMEM, "out of memory while measuring this machine");
}

void cn_train_speed_destroy(cn_train_speed **speed)
{
    if (!*speed) return;
    json_decref((*speed)->known);
    free((*speed)->machine);
    free((*speed)->cache);
    free(*speed);
    *speed = NULL;
}

/* An error is ignored: if the cache cannot be written, the next run measures again. */
static void write_cache(const cn_context *ctx, const cn_train_speed *speed)
{
    if (!speed->cache) return;
    json_t *root =
        json_pack("{s:i,s:s,s:O}", "version", FORMAT, "machine", speed->machine, "full_step_s", speed->known);
    if (root && cn_json_save(root, speed->cache) != CN_OK) cn_log(ctx, CN_LOG_DEBUG, "%s", cn_error_message());
    json_decref(root);
}

static cn_status step_seconds(const cn_context *ctx, cn_train_speed *speed, const cn_train_options *options,
                              const cn_plan_tile *tile, double *step_s)
{
    const uint32_t n_photos = round_photos(tile->n_photos);
    char *key = key_of(ctx, options, tile, n_photos);
    if (!key) return cn_fail(CN_ERR_NOMEM, "out of memory while measuring this machine");
    *step_s = json_number_value(json_object_get(speed->known, key));
    cn_status status = CN_OK;
    if (!(*step_s > 0)) {
        status = cn_train_probe(ctx, options, tile, n_photos, step_s);
        if (status != CN_OK && cn_device_gave_up(ctx, status)) {
            cn_context rest = *ctx;
            rest.device = NULL;
            free(key);
            return step_seconds(&rest, speed, options, tile, step_s); /* the processor will train, too */
        }
        if (status == CN_OK && json_object_set_new(speed->known, key, cn_json_real(*step_s)) == 0)
            write_cache(ctx, speed);
    }
    free(key);
    return status;
}

cn_status cn_train_speed_predict(const cn_context *ctx, cn_train_speed *speed, const cn_train_options *options,
                                 const cn_plan_tile *tile, double *seconds, uint64_t *bytes)
{
    double step_s;
    *bytes = bytes_of(options, tile, cn_pool_threads(ctx ? ctx->pool : NULL), NULL);
    *seconds = options->time_budget_s;
    if (options->time_budget_s > 0) return CN_OK;
    CN_TRY(step_seconds(ctx, speed, options, tile, &step_s));
    *seconds = cn_train_steps(options, tile) * step_s * cn_train_live_part(tile);
    if (!cn_distil_makes_teacher(options)) return CN_OK;
    const cn_train_options teacher = cn_distil_teacher(options);
    CN_TRY(step_seconds(ctx, speed, &teacher, tile, &step_s));
    *seconds += cn_train_steps(&teacher, tile) * step_s * cn_train_live_part(tile);
    return CN_OK;
}
