/* A training step for other devices than the processor: the trainer's arrays, and the numbers of a step. */
#include "train/trainer.h"

#include "conurb/colour.h"
#include "effect/pose.h"
#include "effect/sky_hints.h"

#include <math.h>
#include <string.h>

#define A(name) CN_STEP_BIT(CN_STEP_##name)

void cn_train_device_carve(cn_train_device *d, const cn_trainer *t, cn_arena *arena)
{
    const size_t columns = t->parameters.field.conditioning;
    d->conditioning = CN_ARENA_NEW(arena, float, CN_MAX_RAYS *columns);
    d->d_columns = CN_ARENA_NEW(arena, float, CN_MAX_RAYS *columns);
    d->pixel = CN_ARENA_NEW(arena, float, 4 * CN_MAX_RAYS);
    d->d_pixel = CN_ARENA_NEW(arena, float, 4 * CN_MAX_RAYS);
    d->d_rays = t->effects.pack.moves_rays ? CN_ARENA_NEW(arena, float, 8 * CN_MAX_RAYS) : NULL;
    d->sums = CN_ARENA_NEW(arena, float, CN_SLOTS *CN_STEP_SUM_KINDS);
    d->factor = CN_ARENA_NEW(arena, float, t->parameters.n);
    d->open_t = CN_ARENA_NEW(arena, float, CN_REACTIVATION_STEPS);
    cn_train_photos_carve(&d->photos, t->sampler.n_photos, arena);
}

/* ---- the trainer's arrays ---- */

static void add(cn_train_device *d, cn_step_array which, void *data, size_t n, size_t size)
{
    d->step.array[which] = (cn_step_host){ data, data ? n * size : 0 };
}
#define ADD(which, data, n) add(&t->device, CN_STEP_##which, data, n, sizeof *(data))

static void list_parameters(cn_trainer *t)
{
    const cn_parameters *p = &t->parameters;
    ADD(TABLE, p->table, p->table_n);
    ADD(STATE, p->table_state, p->state_n);
    ADD(VALUES, p->value, p->n);
    ADD(MOMENT_M, t->optimiser.m, p->n);
    ADD(MOMENT_V, t->optimiser.v, p->n);
    ADD(DERIVED, p->derived, p->field.n_derived);
    ADD(EFFECTS_DERIVED, t->effects.derived, t->effects.pack.n_shared);
    ADD(SEEN, t->occ.seen, CN_OCC_CELLS);
    ADD(VISITED, t->occ.visited, CN_OCC_CELLS);
    ADD(BITS, t->occ.bits, CN_OCC_CELLS / 32);
    ADD(SUPPORT_PHOTO, t->support.photo, CN_SUPPORT_CELLS);
    ADD(SUPPORT_SINCE, t->support.since, CN_SUPPORT_CELLS);
    ADD(SUPPORT_TIMES, t->support.times, CN_SUPPORT_CELLS);
    ADD(SLOT_GRAD, t->slot_grad, CN_SLOTS * p->n);
    ADD(FACTOR, t->device.factor, p->n);
    ADD(CONSTANTS, t->effects.constants, t->effects.pack.n_constants);
    ADD(RUN, t->effects.run, t->effects.n_photos);
    ADD(TREND, t->effects.trend, t->effects.n_photos);
    ADD(OPEN_T, t->device.open_t, CN_REACTIVATION_STEPS);
}

_Static_assert(sizeof(cn_sparse_sample) == 3 * sizeof(uint32_t), "shaders read three words of a sparse sample");
static void list_photos(cn_trainer *t)
{
    const cn_sampler *s = &t->sampler;
    ADD(PHOTOS, t->device.photos.record, s->n_photos);
    ADD(SPARSE, s->sparse, CN_MAX_SPARSE);
    ADD(SKY_HINTS, s->sky_hint, (size_t)s->n_photos * CN_SKY_HINTS);
}

static void list_rays(cn_trainer *t)
{
    const cn_batch *b = &t->batch;
    const cn_train_device *d = &t->device;
    const size_t columns = t->parameters.field.conditioning;
    ADD(RAYS, b->rays, CN_MAX_RAYS);
    ADD(FIRST_T, b->first_t, CN_MAX_RAYS);
    ADD(TARGET, b->target, 4 * (size_t)CN_MAX_RAYS);
    ADD(DEPTH, b->depth_m, CN_MAX_RAYS);
    ADD(MEASURED, b->measured_m, CN_MAX_RAYS);
    ADD(PLANE_LOG, b->plane_log, CN_MAX_RAYS);
    ADD(PLANE_WIDTH, b->plane_width, CN_MAX_RAYS);
    ADD(SKY_HINT, b->sky_hint, CN_MAX_RAYS);
    ADD(RAY_PHOTO, b->ray_photo, CN_MAX_RAYS);
    ADD(RAY_UV, b->uv, 2 * (size_t)CN_MAX_RAYS);
    ADD(CONDITIONING, d->conditioning, CN_MAX_RAYS * columns);
    ADD(D_COLUMNS, d->d_columns, CN_MAX_RAYS * columns);
    ADD(PIXEL, d->pixel, 4 * (size_t)CN_MAX_RAYS);
    ADD(D_PIXEL, d->d_pixel, 4 * (size_t)CN_MAX_RAYS);
    ADD(D_RAYS, d->d_rays, 8 * (size_t)CN_MAX_RAYS);
    ADD(SUMS, d->sums, CN_SLOTS * (size_t)CN_STEP_SUM_KINDS);
    ADD(MISSING, t->reactivation.missing, CN_MAX_RAYS);
}

static void list_samples(cn_trainer *t)
{
    const cn_batch *b = &t->batch;
    const size_t lanes = b->panel_cap * CN_PANEL;
    ADD(MARCH_T, b->march_t, (size_t)CN_MAX_GROUPS * CN_GROUP_CAP);
    ADD(RAY_SAMPLES, b->ray_samples, CN_MAX_RAYS);
    ADD(GROUP_SAMPLES, b->group_samples, CN_MAX_GROUPS);
    ADD(GROUP_LIVE, b->group_live, CN_MAX_GROUPS);
    ADD(GROUP_PANEL, b->group_panel, CN_MAX_GROUPS);
    ADD(COUNTS, b->counts, 1);
    ADD(POS, b->pos, 3 * lanes);
    ADD(ENC, b->enc, b->enc_rows * lanes);
    ADD(LENGTH, b->length, lanes);
    ADD(VISIT_CELL, b->visit_cell, lanes);
    ADD(VISIT_SEEN, b->visit_seen, lanes);
    ADD(SUPPORT_CELL, t->support.visit, lanes);
}

/* What the functions for the processor read and overwrite. */
static void list_uses(cn_train_device *d)
{
    const uint64_t groups = A(RAY_SAMPLES) | A(GROUP_SAMPLES) | A(GROUP_PANEL) | A(COUNTS),
                   rays = A(RAYS) | A(TARGET) | A(DEPTH) | A(MEASURED) | A(PLANE_LOG) | A(PLANE_WIDTH) | A(SKY_HINT) |
                          A(RAY_PHOTO) | A(RAY_UV),
                   cells = A(SEEN) | A(VISITED) | A(BITS),
                   support = A(SUPPORT_PHOTO) | A(SUPPORT_SINCE) | A(SUPPORT_TIMES),
                   visits = A(VISIT_CELL) | A(VISIT_SEEN) | A(SUPPORT_CELL),
                   values = A(VALUES) | A(DERIVED) | A(EFFECTS_DERIVED), moments = A(MOMENT_M) | A(MOMENT_V);
    uint64_t *reads = d->step.reads, *writes = d->step.writes;
    reads[CN_OP_RAYS] = 0;
    writes[CN_OP_RAYS] = rays | A(FIRST_T);
    reads[CN_OP_MARCH] = rays | A(FIRST_T) | A(BITS) | A(VALUES);
    writes[CN_OP_MARCH] = A(RAYS) | A(TARGET) | A(MARCH_T) | A(RAY_SAMPLES) | A(GROUP_SAMPLES) | A(MISSING);
    reads[CN_OP_LAY_OUT] = A(TARGET) | A(RAY_SAMPLES) | A(GROUP_SAMPLES);
    writes[CN_OP_LAY_OUT] = A(GROUP_PANEL) | A(GROUP_LIVE) | A(COUNTS);
    reads[CN_OP_PLACE] = groups | A(RAYS) | A(MARCH_T);
    writes[CN_OP_PLACE] = A(POS) | A(LENGTH);
    reads[CN_OP_ENCODE] = A(TABLE) | A(POS) | A(COUNTS);
    writes[CN_OP_ENCODE] = A(ENC);
    reads[CN_OP_SHADE] = groups | rays | values | A(TABLE) | A(MARCH_T) | A(POS) | A(ENC) | A(LENGTH) | A(MISSING) |
                         A(GROUP_LIVE) | support;
    writes[CN_OP_SHADE] = visits | A(POS) | A(ENC) | A(GROUP_LIVE) | A(MISSING) | A(SLOT_GRAD) | A(SUMS);
    reads[CN_OP_OPTIMISE] = A(SLOT_GRAD) | values | moments;
    writes[CN_OP_OPTIMISE] = values | moments;
    reads[CN_OP_OCCUPANCY] = groups | cells | visits | support | A(MISSING) | A(RAYS) | A(RAY_PHOTO);
    writes[CN_OP_OCCUPANCY] = cells | support;
    reads[CN_OP_REFILL] = writes[CN_OP_REFILL] = cells;
    reads[CN_OP_OPTIMISE_TABLE] = groups | A(GROUP_LIVE) | A(POS) | A(ENC) | A(TABLE) | A(STATE);
    writes[CN_OP_OPTIMISE_TABLE] = A(TABLE) | A(STATE);
}

static cn_status read_map(void *user, const cn_context *ctx, uint32_t map, void *to)
{
    const cn_trainer *t = user;
    return cn_train_photos_read(&t->device.photos, &t->sampler, ctx, map, to);
}

/* A device draws the rays where it does all that is done with them. Without a pixel store the photos are not known:
 * only the sizes of the arrays are asked for. */
static void set_maps(cn_trainer *t)
{
    cn_train_device *d = &t->device;
    if (!t->sampler.pixels || !cn_train_device_does(&t->effects.pack)) return;
    const cn_train_photos_wants wants = cn_train_photos_wanted(&t->options, &t->effects.pack);
    cn_train_photos_list(&d->photos, &t->sampler, &wants);
    d->step.maps = (cn_step_maps){ d->photos.n, d->photos.bytes, read_map, t };
}

static void set_constants(cn_trainer *t)
{
    cn_train_device *d = &t->device;
    const cn_effect_pack *pack = &t->effects.pack;
    size_t first[CN_MAX_EFFECTS + 1];
    float factor[CN_MAX_EFFECTS];
    const uint32_t n = cn_effects_rates(pack, first, factor);
    for (size_t i = 0; i < t->parameters.n; i++)
        d->factor[i] = 1;
    for (uint32_t e = 0; e < n; e++)
        for (size_t i = first[e]; i < first[e + 1]; i++)
            d->factor[t->parameters.photo_at + i] = factor[e];
    d->step.settings.open_steps = cn_reactivation_steps(&t->box, d->open_t);
}

static void set_shapes(cn_trainer *t)
{
    cn_step_settings *s = &t->device.step.settings;
    const cn_field *field = &t->parameters.field;
    *s = (cn_step_settings){ .panel_cap = (uint32_t)t->batch.panel_cap,
                             .levels = field->grid.n_levels,
                             .enc_rows = field->enc_rows,
                             .density_width = field->mlp.density_width,
                             .colour_width = field->mlp.colour_width,
                             .colour_in = field->colour_in,
                             .n_weights = (uint32_t)t->parameters.photo_at,
                             .n_values = (uint32_t)t->parameters.n,
                             .softplus = field->type->density == CN_DENSITY_SOFTPLUS,
                             .has_hints = t->batch.sky_hint != NULL,
                             .has_measured = t->batch.measured_m != NULL,
                             .has_planes = t->batch.plane_width != NULL,
                             .has_uv = t->batch.uv != NULL,
                             .depth_along_ray = t->sampler.depth_along_ray,
                             .stereo = t->sampler.stereo != NULL,
                             .seed = { (uint32_t)t->sampler.seed, (uint32_t)(t->sampler.seed >> 32) },
                             .n_photos = t->effects.n_photos,
                             .at_shared = (uint32_t)t->parameters.shared_at,
                             .support_cells = t->support.photo ? CN_SUPPORT_CELLS : 0,
                             .remembered = cn_support_remembered(&t->support),
                             .near_t = t->box.near_m,
                             .far_t = t->box.far_m,
                             .inv_extent = t->inv_extent };
    const cn_box_units units = cn_box_units_of(&t->box);
    memcpy(s->to_mean, units.to_mean, sizeof s->to_mean);
    memcpy(s->from_mean, units.from_mean, sizeof s->from_mean);
    memcpy(s->from_m, units.from_m, sizeof s->from_m);
    for (int i = 0; i < 9; i++)
        s->srgb[i] = (float)cn_srgb_from_acescg[i];
}

void cn_train_device_begin(cn_trainer *t)
{
    cn_train_device *d = &t->device;
    memset(&d->step, 0, sizeof d->step);
    d->step.level = t->parameters.field.grid.level;
    list_parameters(t);
    list_photos(t);
    list_rays(t);
    list_samples(t);
    list_uses(d);
    set_shapes(t);
    set_constants(t);
    set_maps(t);
    if (!t->parameters.field.type->describe || t->distil.teacher)
        d->step.unfit = "a graphics processor trains fields of a grid and two networks";
}

/* ---- the numbers of a step ---- */

/* False where a term is on that the shaders do not know. */
static bool set_terms(const cn_loss_pack *losses, uint32_t *terms)
{
    static const struct {
        const char *name;
        uint32_t bit;
    } known[] = { { "colour", 0 },
                  { "glow", CN_TERM_GLOW },
                  { "openness", CN_TERM_OPENNESS },
                  { "ground", CN_TERM_GROUND },
                  { "spread", CN_TERM_SPREAD },
                  { "sparse depth", CN_TERM_SPARSE },
                  { "measured depth", CN_TERM_MEASURED },
                  { "depth cue", CN_TERM_CUE },
                  { "normal cue", CN_TERM_NORMAL },
                  { "single view", CN_TERM_SINGLE_VIEW } };
    enum { KNOWN = sizeof known / sizeof *known };
    *terms = 0;
    for (uint32_t i = 0; i < losses->n; i++) {
        uint32_t k = 0;
        while (k < KNOWN && strcmp(known[k].name, losses->term[i]->name) != 0)
            k++;
        if (k == KNOWN) return false;
        *terms |= known[k].bit;
    }
    return true;
}

void cn_train_device_step(cn_trainer *t, cn_lead lead)
{
    cn_train_device *d = &t->device;
    cn_step_settings *s = &d->step.settings;
    s->n_rays = t->batch.n_rays;
    s->n_groups = t->batch.n_groups;
    s->step = t->step;
    s->background = t->effects.pack.background.n > 0;
    s->march_step = (float)t->sampler.pace.march_step;
    s->ratio = (float)(1 + t->sampler.pace.march_step);
    s->log_ratio = logf(s->ratio);
    s->n_sparse = lead.sparse ? t->sampler.n_sparse : 0;
    s->no_sky = lead.no_sky;
    s->late = cn_trainer_late(t);
    s->cue_weight = cn_trainer_cue_weight(t);
    s->cue_deviation = cn_trainer_cue_deviation(t);
    s->prior_weight = cn_monitor_prior_weight(&t->monitor);
    d->step.by_processor[CN_OP_SHADE] = !set_terms(&t->losses, &s->terms);
    cn_train_device_effects(t);
    d->step.by_processor[CN_OP_RAYS] = d->step.by_processor[CN_OP_SHADE] || s->effects_by_processor;
}

void cn_train_device_update(cn_trainer *t, double rate)
{
    cn_step_settings *s = &t->device.step.settings;
    const cn_adam flat = cn_optimiser_flat_adam(rate, t->step), table = cn_optimiser_table_adam(rate, t->step);
    const double weight_rate = t->parameters.field.type->weight_rate;
    s->rate_others = flat.rate;
    s->rate_weights = flat.rate * (weight_rate > 0 ? (float)weight_rate : 1);
    s->rate_table = table.rate;
    s->beta1 = flat.beta1;
    s->beta2 = flat.beta2;
    s->epsilon = flat.epsilon;
    s->decay = flat.decay;
    s->dither = table.dither;
    s->pose_keep = cn_pose_keep(cn_step_progress(cn_trainer_at(t)));
    s->opens = cn_reactivation_is_on(cn_trainer_at(t));
    s->cell_decay = cn_occupancy_decay(t->options.steps);
}

bool cn_train_device_stats(const cn_trainer *t, cn_step_stats *stats)
{
    if (!(t->device.sums[CN_SUM_BY_DEVICE] > 0)) return false;
    for (size_t slot = 0; slot < CN_SLOTS; slot++) {
        const float *sums = t->device.sums + slot * CN_STEP_SUM_KINDS;
        stats->squared_error += (double)sums[CN_SUM_ERROR];
        stats->weighed_error += (double)sums[CN_SUM_WEIGHED_ERROR];
        stats->weight += (double)sums[CN_SUM_WEIGHT];
        stats->rays += (uint64_t)sums[CN_SUM_RAYS];
        stats->live += (uint64_t)sums[CN_SUM_LIVE];
        stats->bad += (uint64_t)sums[CN_SUM_BAD];
        stats->gradient += (double)sums[CN_SUM_GRADIENT];
        stats->colours += (double)sums[CN_SUM_COLOURS];
        for (int c = 0; c < 3; c++) {
            stats->colour[c] += (double)sums[CN_SUM_COLOUR + c];
            stats->colour_squared[c] += (double)sums[CN_SUM_COLOUR_SQUARED + c];
        }
    }
    return true;
}
