#include "train/trainer.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* The box that maps to [-1,1]^3: the plan's bounds about the tile's centre. No side is much shorter than the others,
 * so that the grid's cells are about as deep as wide. */
static void make_box(cn_box *box, const cn_plan_tile *tile, double step)
{
    double largest = 0;
    for (int a = 0; a < 3; a++) {
        box->centre[a] = 0.5 * (tile->bounds_min[a] + tile->bounds_max[a]);
        box->half_extent[a] = 0.5 * (tile->bounds_max[a] - tile->bounds_min[a]);
        largest = fmax(largest, box->half_extent[a]);
    }
    if (!(largest > 0)) largest = 1;
    for (int a = 0; a < 3; a++)
        box->half_extent[a] = fmax(box->half_extent[a], 0.4 * largest);
    box->near_m = (float)tile->near_m;
    box->far_m = (float)tile->far_m;
    box->step = (float)step;
}

static cn_status refuse_held_out(const cn_plan_tile *tile, const cn_scene *scene)
{
    for (uint32_t i = 0, j = 0; i < tile->n_photos && j < tile->n_held_out;) {
        if (tile->photos[i] == tile->held_out[j])
            return cn_fail(CN_ERR_INTERNAL, "tile %s would train on held-out photo %s; run `conurb plan` again",
                           tile->id, scene->views[tile->photos[i]].name);
        if (tile->photos[i] < tile->held_out[j])
            i++;
        else
            j++;
    }
    return CN_OK;
}

cn_status cn_trainer_plan(cn_trainer *t, const cn_train_input *input, const cn_train_options *options,
                          unsigned n_workers)
{
    const cn_plan_tile *tile = input->tile;
    t->input = input;
    t->options = *options;
    t->options.steps = cn_train_steps(options, tile);
    t->kernel = cn_device_kernel(t->ctx, options->precision == CN_PRECISION_FLOAT);
    t->n_workers = n_workers;
    if (input->scene) CN_TRY(refuse_held_out(tile, input->scene));
    if (options->samples_per_step < 4096 || options->samples_per_step > 1u << 22)
        return cn_fail(CN_ERR_CONFIG, "train.samples_per_step is %u; give 4096 to 4194304", options->samples_per_step);
    CN_TRY(cn_train_effects_size(&t->effects, tile));
    const cn_effect_pack *pack = &t->effects.pack;
    make_box(&t->box, tile, options->march_step);
    t->inv_extent = cn_box_inv_extent(&t->box);
    CN_TRY(cn_field_layout(&t->parameters.field, &options->field,
                           (cn_field_inputs){ pack->conditioning, pack->harmonics }));
    cn_parameters_size(&t->parameters, pack->n_photo, pack->n_shared, n_workers);
    cn_batch_size(&t->batch, options->samples_per_step, t->parameters.field.enc_rows);
    t->sampler.seed = options->seed;
    t->sampler.depth_along_ray = options->depth_along == CN_DEPTH_ALONG_RAY;
    t->sampler.n_photos = t->support.n_photos = tile->n_photos;
    t->optimiser.learning_rate = options->learning_rate;
    return CN_OK;
}

void cn_trainer_carve(cn_trainer *t, cn_arena *arena)
{
    const cn_effect_pack *pack = &t->effects.pack;
    cn_sampler_carve(&t->sampler, arena, pack->wants_sky_hints);
    cn_train_effects_carve(&t->effects, arena);
    cn_parameters_carve(&t->parameters, arena);
    cn_optimiser_carve(&t->optimiser, arena, t->parameters.n, pack);
    cn_occupancy_take(&t->occ, arena);
    t->usable = CN_ARENA_NEW(arena, uint8_t, CN_OCC_CELLS);
    if (pack->wants_sky_hints) cn_looks_carve(&t->looks, arena);
    cn_batch_carve(&t->batch, arena,
                   (cn_batch_wants){ .uv = pack->wants_uv,
                                     .sky_hint = pack->wants_sky_hints,
                                     .measured = t->options.depth_maps || pack->wants_stereo,
                                     .planes = t->options.normal_maps });
    cn_reactivation_carve(&t->reactivation, arena);
    if (pack->wants_support) cn_support_carve(&t->support, arena, t->batch.panel_cap * CN_PANEL);
    t->slot_grad = CN_ARENA_NEW(arena, float, CN_SLOTS * t->parameters.n);
    cn_train_device_carve(&t->device, t, arena);
    cn_worker *workers = CN_ARENA_NEW(arena, cn_worker, t->n_workers);
    cn_worker counted;
    for (unsigned i = 0; i < t->n_workers; i++) {
        cn_worker *w = workers ? &workers[i] : &counted;
        cn_worker_carve(&t->parameters.field, pack, arena, w);
        cn_parameters_carve_scratch(&t->parameters, arena, &w->part);
    }
    t->workers = workers;
}

/* Each step of a march multiplies the distance by a factor, starting at near. With near 0, or a factor that a float
 * rounds to 1, the march would never end. The same holds for a tile on disk. */
static cn_status check_march(const cn_trainer *t)
{
    const cn_box *box = &t->box;
    if (!(t->options.march_step > 1e-5 && t->options.march_step < 1))
        return cn_fail(CN_ERR_CONFIG, "train options: march_step is %g; give more than 0.00001 and less than 1",
                       t->options.march_step);
    if (!(box->near_m > 0 && box->far_m > box->near_m && isfinite(box->far_m)))
        return cn_fail(CN_ERR_DATA, "tile %s: its rays would run from %g m to %g m; run `conurb plan` again",
                       t->input->tile->id, (double)box->near_m, (double)box->far_m);
    return CN_OK;
}

/* Lets the field place its own entries, if its type does that, about the sparse points. */
static cn_status place_field(cn_trainer *t)
{
    const cn_field *field = &t->parameters.field;
    const cn_scene *scene = t->input->scene;
    const size_t n = scene ? scene->n_points : 0;
    if (!field->type->place) return CN_OK;
    cn_field_change change = cn_parameters_change(&t->parameters, t->options.seed, 0);
    float(*points)[3] = malloc(sizeof *points * (n + 1));
    if (!points) return cn_fail(CN_ERR_NOMEM, "out of memory at the start of tile %s", t->input->tile->id);
    for (size_t i = 0; i < n; i++)
        cn_box_contract(&t->box, scene->points[i].xyz, points[i]);
    change.points = (const float(*)[3])points;
    change.n_points = n;
    change.usable = t->usable;
    field->type->place(field, &change);
    free(points);
    return CN_OK;
}

cn_status cn_trainer_begin(cn_trainer *t)
{
    CN_TRY(check_march(t));
    CN_TRY(cn_sampler_begin(&t->sampler, t->input, &t->box));
    if (t->effects.pack.wants_vignetting) CN_TRY(cn_sampler_find_vignetting(&t->sampler, t->input));
    /* Depth maps that come with the photos know better than stereo. */
    if (t->options.depth_maps)
        CN_TRY(cn_sampler_fit_depth(&t->sampler, t->ctx, t->input, t->options.depth_kind));
    else if (t->effects.pack.wants_stereo)
        CN_TRY(cn_sampler_find_stereo(&t->sampler, t->ctx, t->input));
    if (t->options.normal_maps) cn_sampler_find_normals(&t->sampler);
    if (t->support.photo) cn_support_begin(&t->support, t->input->scene, &t->box);
    CN_TRY(cn_parameters_init(&t->parameters, t->options.seed));
    cn_parameters_derive(&t->parameters);
    cn_train_effects_begin(&t->effects, t->input, &t->sampler, t->inv_extent, t->options.seed, &t->parameters);
    CN_TRY(cn_distil_begin(&t->distil, t->input, &t->box, &t->effects, &t->parameters));
    CN_TRY(cn_sampler_usable_cells(&t->sampler, t->ctx->pool, &t->box, t->usable));
    if (t->looks.places) {
        CN_TRY(cn_looks_begin(&t->looks, &t->sampler, t->usable));
        CN_TRY(cn_looks_clear(&t->sampler, t->ctx->pool, &t->box, t->usable));
    }
    cn_occupancy_reset(&t->occ, t->usable);
    cn_distil_occupy(&t->distil, &t->occ, t->usable);
    cn_train_device_begin(t);
    return place_field(t);
}

cn_status cn_trainer_restart(cn_trainer *t)
{
    memset(t->arena.base, 0, t->arena.size);
    t->arena.used = 0;
    cn_trainer_carve(t, &t->arena);
    t->step = 0;
    CN_TRY(cn_trainer_begin(t));
    return cn_device_forget(t->ctx, &t->device.step);
}

void cn_trainer_deinit(cn_trainer *t)
{
    cn_sampler_deinit(&t->sampler);
    cn_distil_close(&t->distil);
    cn_device_arena_deinit(t->ctx, &t->arena);
}

enum { COUNTERS = 4 };

/* A checkpoint with a step length of 0 or less is damaged. */
static bool pace_is_valid(const void *data)
{
    const double *pace = data;
    return pace[0] >= 1 && pace[1] > 0;
}

static void list_state(cn_trainer *t, uint64_t counters[COUNTERS], cn_checkpoint *c)
{
    c->n = 0;
    cn_parameters_list(&t->parameters, c);
    cn_optimiser_list(&t->optimiser, c);
    cn_checkpoint_add(c, "occupancy.seen", CN_F32, CN_OCC_CELLS, t->occ.seen);
    cn_train_effects_list(&t->effects, c);
    cn_support_list(&t->support, c);
    cn_checkpoint_add(c, "state.counters", CN_U64, COUNTERS, counters);
    cn_checkpoint_add(c, "state.pace", CN_F64, CN_PACE_VALUES, &t->sampler.pace);
    c->array[c->n - 1].valid = pace_is_valid;
    cn_monitor_list(&t->monitor, c);
}

cn_status cn_trainer_save_checkpoint(cn_trainer *t, const char *key, const char *path)
{
    uint64_t counters[COUNTERS] = { t->step, t->bad_rays, t->options.steps, t->ending };
    cn_checkpoint checkpoint;
    CN_TRY(cn_device_fetch(t->ctx, &t->device.step));
    list_state(t, counters, &checkpoint);
    return cn_checkpoint_save(&checkpoint, key, path);
}

cn_status cn_trainer_load_checkpoint(cn_trainer *t, const char *key, const char *path, bool *resumed)
{
    uint64_t counters[COUNTERS];
    cn_checkpoint checkpoint;
    CN_TRY(cn_device_fetch(t->ctx, &t->device.step));
    list_state(t, counters, &checkpoint);
    CN_TRY(cn_checkpoint_load(&checkpoint, key, path, resumed));
    if (!*resumed) return CN_OK;
    t->step = (uint32_t)counters[0];
    t->bad_rays = counters[1];
    t->options.steps = (uint32_t)counters[2];
    t->ending = counters[3] != 0;
    cn_parameters_derive(&t->parameters);
    cn_train_effects_derive(&t->effects, &t->parameters);
    cn_occupancy_restore(&t->occ);
    return cn_device_forget(t->ctx, &t->device.step);
}
