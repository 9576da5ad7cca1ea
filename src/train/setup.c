/* Sizes, carving and the state before the first step. */
#include "train/trainer.h"

#include "effect/runs.h"

#include <math.h>
#include <stdlib.h>

/* The box that maps to [-1,1]^3: the plan's bounds about the tile's centre, with no side much flatter than the others,
 * so that the grid's cells keep a sensible shape. */
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

/* Enough parts that every thread finds work, though a level's samples are gone through once for each. */
static uint32_t parts_for(unsigned threads, uint32_t levels)
{
    uint32_t parts = 1;
    while (parts * levels < 2 * threads && parts < CN_MAX_PARTS)
        parts *= 2;
    return parts;
}

cn_status cn_trainer_plan(cn_trainer *t, const cn_train_input *input, const cn_train_options *options,
                          unsigned n_workers)
{
    const cn_plan_tile *tile = input->tile;
    t->input = input;
    t->options = *options;
    t->kernel = options->precision == CN_PRECISION_FLOAT ? cn_kernel_float() : cn_kernel_best();
    t->n_workers = n_workers;
    t->n_photos = tile->n_photos;
    if (input->scene) CN_TRY(refuse_held_out(tile, input->scene));
    if (options->samples_per_step < 4096 || options->samples_per_step > 1u << 22)
        return cn_fail(CN_ERR_CONFIG, "train.samples_per_step is %u; give 4096 to 4194304", options->samples_per_step);
    const char *names[CN_MAX_EFFECTS];
    uint32_t n = 0;
    for (uint32_t i = 0; i < tile->n_effects; i++)
        if (tile->effects[i].on) names[n++] = tile->effects[i].name;
    CN_TRY(cn_effect_pack_make(&t->pack, n, names, t->n_photos));
    make_box(&t->box, tile, options->march_step);
    t->inv_extent = cn_box_inv_extent(&t->box);
    const cn_field_config config = { options->levels,          options->log2_table,
                                     options->base_resolution, options->finest_resolution,
                                     options->density_width,   options->colour_width,
                                     t->pack.columns };
    CN_TRY(cn_field_layout(&t->field, &config));
    t->table_n = 2 * t->field.entries;
    t->state_n = (t->table_n / 16 + config.levels + 1) * CN_STATE_BLOCK;
    t->level_parts = parts_for(n_workers, config.levels);
    t->photo_at = (t->field.n_weights + 15) & ~(size_t)15;
    t->shared_at = (t->photo_at + t->pack.n_photo + 15) & ~(size_t)15;
    t->panel_cap = options->samples_per_step / CN_PANEL * 5 / 4 + CN_MAX_GROUPS;
    return CN_OK;
}

/* Entries of the largest part of a level. */
static size_t largest_part(const cn_trainer *t)
{
    size_t largest = 0;
    for (uint32_t l = 0; l < t->field.config.levels; l++) {
        const cn_range first = cn_trainer_part(t, l, 0);
        if (first.count > largest) largest = first.count;
    }
    return largest;
}

static void carve_parameters(cn_arena *arena, cn_parameters *p, size_t n)
{
    p->n = (n + 15) & ~(size_t)15;
    p->value = CN_ARENA_NEW(arena, float, p->n);
    p->m = CN_ARENA_NEW(arena, float, p->n);
    p->v = CN_ARENA_NEW(arena, float, p->n);
    p->grad = CN_ARENA_NEW(arena, float, p->n);
}

void cn_trainer_carve_worker(const cn_field *field, const cn_effect_pack *pack, cn_arena *arena, cn_worker *w)
{
    const size_t panels = CN_GROUP_CAP / CN_PANEL, cap = CN_GROUP_CAP;
    cn_field_acts_take(field, arena, panels, &w->acts);
    cn_field_acts_take(field, arena, panels, &w->d);
    w->logit = CN_ARENA_NEW(arena, float, cap);
    w->d_logit = CN_ARENA_NEW(arena, float, cap);
    w->weight = CN_ARENA_NEW(arena, float, cap);
    w->behind = CN_ARENA_NEW(arena, float, cap);
    w->tau = CN_ARENA_NEW(arena, float, cap);
    w->live = CN_ARENA_NEW(arena, uint32_t, cap);
    w->live_ray = CN_ARENA_NEW(arena, uint32_t, cap);
    w->colour = CN_ARENA_NEW(arena, float, 3 * cap);
    w->columns = CN_ARENA_NEW(arena, float, (size_t)CN_GROUP * field->columns);
    w->d_columns = CN_ARENA_NEW(arena, float, (size_t)CN_GROUP * field->columns);
    w->keep = CN_ARENA_NEW(arena, float, pack->keep *CN_EFFECT_RAYS);
    w->d_pos = pack->moves_rays ? cn_arena_take(arena, cap, sizeof *w->d_pos) : NULL;
}

void cn_trainer_carve(cn_trainer *t, cn_arena *arena)
{
    const size_t lanes = t->panel_cap * CN_PANEL;
    t->photos = CN_ARENA_NEW(arena, cn_train_photo, t->n_photos);
    t->constants = CN_ARENA_NEW(arena, float, t->pack.n_constants);
    t->run = t->pack.wants_runs ? CN_ARENA_NEW(arena, float, t->n_photos) : NULL;
    t->place = t->pack.moves_rays ? cn_arena_take(arena, t->n_photos, sizeof *t->place) : NULL;
    t->ties = CN_ARENA_NEW(arena, cn_tie, CN_MAX_TIES);
    t->ray_hole = CN_ARENA_NEW(arena, uint8_t, CN_MAX_RAYS);
    t->ray_tie = CN_ARENA_NEW(arena, float, CN_MAX_RAYS);
    t->table = CN_ARENA_NEW(arena, uint16_t, t->table_n);
    t->table_state = CN_ARENA_NEW(arena, uint16_t, t->state_n);
    carve_parameters(arena, &t->flat, t->shared_at + t->pack.n_shared);
    t->derived = CN_ARENA_NEW(arena, float, t->pack.n_shared);
    t->rows_before = t->pack.own_rates ? CN_ARENA_NEW(arena, float, t->pack.n_photo) : NULL;
    t->transposed = CN_ARENA_NEW(arena, float, t->field.n_weights);
    cn_occupancy_take(&t->occ, arena);
    t->witness = t->pack.wants_witnesses ? CN_ARENA_NEW(arena, float, CN_WITNESS_CELLS) : NULL;
    t->changed = t->pack.wants_witnesses ? CN_ARENA_NEW(arena, float, CN_WITNESS_CELLS) : NULL;
    t->alone = t->pack.wants_witnesses ? CN_ARENA_NEW(arena, float, CN_WITNESS_CELLS) : NULL;
    t->usable = CN_ARENA_NEW(arena, uint8_t, CN_OCC_CELLS);
    t->rays = CN_ARENA_NEW(arena, cn_ray, CN_MAX_RAYS);
    t->dirs = CN_ARENA_NEW(arena, float, 3 * CN_MAX_RAYS);
    t->uv = t->pack.wants_uv ? CN_ARENA_NEW(arena, float, 2 * CN_MAX_RAYS) : NULL;
    t->ray_photo = CN_ARENA_NEW(arena, uint32_t, CN_MAX_RAYS);
    t->ray_samples = CN_ARENA_NEW(arena, uint32_t, CN_MAX_RAYS);
    t->target = CN_ARENA_NEW(arena, float, 4 * CN_MAX_RAYS);
    t->march_t = CN_ARENA_NEW(arena, float, (size_t)CN_MAX_GROUPS *CN_GROUP_CAP);
    t->group_samples = CN_ARENA_NEW(arena, uint32_t, CN_MAX_GROUPS);
    t->group_live = CN_ARENA_NEW(arena, uint32_t, CN_MAX_GROUPS);
    t->group_panel = CN_ARENA_NEW(arena, size_t, CN_MAX_GROUPS);
    t->pos = CN_ARENA_NEW(arena, float, 3 * lanes);
    t->enc = CN_ARENA_NEW(arena, float, t->field.enc_rows *lanes);
    t->length = CN_ARENA_NEW(arena, float, lanes);
    t->visit_cell = CN_ARENA_NEW(arena, uint32_t, lanes);
    t->visit_witness = t->pack.wants_witnesses ? CN_ARENA_NEW(arena, uint32_t, lanes) : NULL;
    t->visit_seen = CN_ARENA_NEW(arena, float, lanes);
    t->slot_grad = CN_ARENA_NEW(arena, float, CN_SLOTS * t->flat.n);
    cn_worker *workers = CN_ARENA_NEW(arena, cn_worker, t->n_workers);
    cn_worker counted;
    for (unsigned i = 0; i < t->n_workers; i++) {
        cn_worker *w = workers ? &workers[i] : &counted;
        cn_trainer_carve_worker(&t->field, &t->pack, arena, w);
        w->part_grad = CN_ARENA_NEW(arena, float, 2 * largest_part(t));
        w->touched = CN_ARENA_NEW(arena, uint8_t, largest_part(t) / CN_TOUCH + 1);
    }
    t->workers = workers;
}

void cn_train_constants(const cn_train_input *input, const cn_effect_pack *pack, float *constants)
{
    const cn_plan_tile *tile = input->tile;
    for (uint32_t e = 0; e < pack->n_on; e++) {
        const cn_effect *effect = pack->on[e].effect;
        const uint32_t width = effect->photo_constants;
        float *rows = constants + pack->on[e].constants;
        for (uint32_t i = 0; width && i < pack->n_rows; i++) {
            const uint32_t view = i < tile->n_photos ? tile->photos[i] : tile->held_out[i - tile->n_photos];
            effect->constants(&input->photos->photos[input->scene->views[view].photo], rows + (size_t)i * width);
        }
    }
    cn_effects_centre(pack, tile->n_photos, constants);
}

static void find_runs(cn_trainer *t)
{
    for (uint32_t i = 0; i < t->n_photos; i++)
        t->run[i] = cn_run_time(&t->input->photos->photos[t->input->scene->views[t->input->tile->photos[i]].photo]);
    (void)cn_runs_find(t->run, 1, t->n_photos);
}

static cn_status prepare_photos(cn_trainer *t)
{
    const cn_scene *scene = t->input->scene;
    for (uint32_t i = 0; i < t->n_photos; i++) {
        const cn_view *view = &scene->views[t->input->tile->photos[i]];
        if (view->photo >= cn_pixel_store_count(t->input->pixels))
            return cn_fail(CN_ERR_DATA, "photo %s is not in the pixel store; run `conurb plan` again", view->name);
        cn_train_photo *p = &t->photos[i];
        p->store = view->photo;
        p->size = cn_pixel_store_extent(t->input->pixels, view->photo);
        cn_camera camera;
        cn_camera_resize(&scene->cameras[view->camera], p->size.width, p->size.height, &camera);
        cn_ray_generator_init(&p->generator, &camera, view, &t->box);
        for (int a = 0; t->place && a < 3; a++)
            t->place[i][a] = (float)p->generator.origin[a] * t->inv_extent;
    }
    return CN_OK;
}

/* Cells near two views or more; the generators are copied, since a photo's record holds more than its generator. */
static cn_status find_usable_cells(cn_trainer *t)
{
    cn_ray_generator *generators = malloc(sizeof *generators * (t->n_photos ? t->n_photos : 1));
    if (!generators) return cn_fail(CN_ERR_NOMEM, "out of memory at the start of tile %s", t->input->tile->id);
    for (uint32_t i = 0; i < t->n_photos; i++)
        generators[i] = t->photos[i].generator;
    cn_rays_visible_cells(t->ctx->pool, &t->box, t->n_photos, generators, t->usable);
    free(generators);
    return CN_OK;
}

static bool tie_of(const cn_trainer *t, const cn_point *point, const cn_observation *o, uint32_t photo, cn_tie *tie)
{
    const cn_view *view = &t->input->scene->views[o->view];
    const cn_camera *camera = &t->input->scene->cameras[view->camera];
    const cn_pixel_extent size = t->photos[photo].size;
    const double x = (double)o->x_px * size.width / camera->width, y = (double)o->y_px * size.height / camera->height;
    if (!(x >= 0 && y >= 0 && x < size.width && y < size.height)) return false;
    double centre[3], squared = 0;
    cn_view_centre(view, centre);
    for (int a = 0; a < 3; a++)
        squared += (point->xyz[a] - centre[a]) * (point->xyz[a] - centre[a]);
    *tie = (cn_tie){ photo, (uint16_t)x, (uint16_t)y, (float)sqrt(squared) };
    return tie->distance_m > t->box.near_m && tie->distance_m < t->box.far_m;
}

/* Sparse points as the training photos see them, evenly thinned to what there is room for. */
static cn_status find_ties(cn_trainer *t)
{
    const cn_scene *scene = t->input->scene;
    uint32_t *row = malloc(sizeof *row * (scene->n_views + 1u));
    if (!row) return cn_fail(CN_ERR_NOMEM, "out of memory at the start of tile %s", t->input->tile->id);
    memset(row, 0xff, sizeof *row * scene->n_views);
    for (uint32_t i = 0; i < t->n_photos; i++)
        row[t->input->tile->photos[i]] = i;
    uint64_t seen = 0, n = 0;
    for (uint64_t i = 0; i < scene->n_observations; i++)
        n += row[scene->observations[i].view] != UINT32_MAX;
    const uint64_t stride = n / CN_MAX_TIES + 1;
    for (uint32_t p = 0; p < scene->n_points; p++)
        for (uint32_t k = 0; k < scene->points[p].n_observations; k++) {
            const cn_observation *o = &scene->observations[scene->points[p].first_observation + k];
            if (row[o->view] == UINT32_MAX || seen++ % stride || t->n_ties == CN_MAX_TIES) continue;
            if (tie_of(t, &scene->points[p], o, row[o->view], &t->ties[t->n_ties])) t->n_ties++;
        }
    free(row);
    return CN_OK;
}

static cn_status first_parameters(cn_trainer *t)
{
    float *table = malloc(sizeof *table * t->table_n);
    if (!table) return cn_fail(CN_ERR_NOMEM, "out of memory at the start of tile %s", t->input->tile->id);
    cn_field_init(&t->field, t->options.seed, table, t->flat.value);
    for (uint32_t l = 0; l < t->field.config.levels; l++) {
        const size_t first = 2 * (size_t)t->field.level[l].offset;
        for (size_t i = 0; i < 2 * (size_t)t->field.level[l].entries; i++)
            cn_float_split(table[first + i], &t->table[first + i], cn_state_at(cn_trainer_state(t, l), i));
    }
    free(table);
    return CN_OK;
}

/* A march grows from near by a factor a step: from 0, or by a factor that float cannot tell from 1, it would never
 * arrive. A tile on disk is held to the same. */
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

cn_status cn_trainer_begin(cn_trainer *t)
{
    CN_TRY(check_march(t));
    CN_TRY(prepare_photos(t));
    CN_TRY(find_ties(t));
    if (t->witness) cn_witness_begin(t);
    cn_train_constants(t->input, &t->pack, t->constants);
    if (t->run) find_runs(t);
    CN_TRY(first_parameters(t));
    cn_field_transpose(&t->field, t->flat.value, t->transposed);
    cn_effects_init(&t->pack, t->options.seed, t->flat.value + t->shared_at);
    cn_effects_derive(&t->pack, t->flat.value + t->shared_at, t->derived);
    CN_TRY(find_usable_cells(t));
    cn_occupancy_reset(&t->occ, t->usable);
    t->samples_per_group = CN_GROUP_CAP;
    t->march_step = CN_LONGEST_STEP;
    return CN_OK;
}

cn_status cn_trainer_restart(cn_trainer *t)
{
    memset(t->arena.base, 0, t->arena.size);
    t->arena.used = 0;
    cn_trainer_carve(t, &t->arena);
    t->step = 0;
    t->n_ties = 0;
    return cn_trainer_begin(t);
}

void cn_trainer_deinit(cn_trainer *t)
{
    cn_arena_deinit(&t->arena);
}
