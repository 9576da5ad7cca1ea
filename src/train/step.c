/* One training step, as chains of operations that the context's device runs. Each is over fixed items (groups of rays,
 * levels, ranges), and whatever is summed is summed in item order, so a step gives the same bits on any number of
 * threads. */
#include "train/trainer.h"

#include <math.h>
#include <string.h>

/* An effect starts at a fraction of the schedule. A longer schedule counts as one of so many steps. There is a surface
 * by then, however long training goes on; and an occluder that the field has built without the effect does not
 * disappear later. Not measured apart. */
#define EFFECTS_BY 1500.0

/* The user of the operations. */
typedef struct work {
    cn_trainer *t;
    cn_lead lead;
    double rate;
} work;

static void draw_group(void *user, size_t g, unsigned worker)
{
    (void)worker;
    const work *k = user;
    cn_trainer *t = k->t;
    cn_sampler_draw(&t->sampler, t->step, k->lead, (uint32_t)g, &t->batch);
}

static void march_group(void *user, size_t g, unsigned worker)
{
    (void)worker;
    cn_trainer *t = ((const work *)user)->t;
    cn_batch *b = &t->batch;
    const bool background = t->effects.pack.background.n > 0;
    uint32_t used = 0;
    cn_batch_note_dirs(b, (uint32_t)g);
    if (t->effects.pack.ray.n) {
        const cn_effect_state state = cn_train_effects_state(&t->effects, t->kernel, &t->parameters);
        cn_train_effects_move(&t->effects, &state, &t->box, (uint32_t)g, b);
    }
    const cn_batch_march march = { t->kernel, &t->box, t->occ.bits, t->sampler.pace.march_step };
    for (uint32_t r = (uint32_t)g * CN_GROUP; r < (g + 1) * CN_GROUP; r++) {
        b->ray_samples[r] = 0;
        t->reactivation.missing[r] = 0;
        if (!(b->target[4 * (size_t)r + 3] > 0)) continue;
        b->ray_samples[r] = cn_batch_march_ray(b, r, &march, b->march_t + g * CN_GROUP_CAP + used, CN_GROUP_CAP - used);
        used += b->ray_samples[r];
        if (b->ray_samples[r]) continue;
        if (b->target[4 * (size_t)r + 3] > 0) cn_reactivation_note(&t->reactivation, b, r, 1, background);
        /* A ray without samples has a loss only where there is a background. */
        if (!background) b->target[4 * (size_t)r + 3] = 0;
    }
    b->group_samples[g] = used;
}

static void lay_out(void *user, size_t item, unsigned worker)
{
    (void)item, (void)worker;
    cn_batch_lay_out(&((const work *)user)->t->batch);
}

static void place_group(void *user, size_t g, unsigned worker)
{
    (void)worker;
    cn_trainer *t = ((const work *)user)->t;
    if (cn_batch_has(&t->batch, (uint32_t)g))
        cn_batch_place(&t->batch, t->kernel, (float)t->sampler.pace.march_step, t->inv_extent, (uint32_t)g);
}

static void encode_item(void *user, size_t item, unsigned worker)
{
    (void)worker;
    cn_trainer *t = ((const work *)user)->t;
    cn_parameters_encode(&t->parameters, t->kernel, item, &t->batch);
}

static double sum_of_squares(const float *x, size_t n)
{
    float lanes[CN_PANEL] = { 0 }; /* many sums, so that the processor can add them at once */
    double sum = 0;
    size_t i = 0;
    for (; i + CN_PANEL <= n; i += CN_PANEL)
        for (size_t q = 0; q < CN_PANEL; q++)
            lanes[q] += x[i + q] * x[i + q];
    for (size_t q = 0; i + q < n; q++)
        lanes[q] += x[i + q] * x[i + q];
    for (size_t q = 0; q < CN_PANEL; q++)
        sum += (double)lanes[q];
    return sum;
}

static void run_slot(void *user, size_t slot, unsigned worker)
{
    cn_trainer *t = ((const work *)user)->t;
    cn_batch *b = &t->batch;
    const size_t n = t->parameters.n, panel = (size_t)b->enc_rows * CN_PANEL;
    float *grad = t->slot_grad + slot * n;
    memset(grad, 0, n * sizeof *grad);
    t->slot_stats[slot] = (cn_step_stats){ 0 };
    memset(t->device.sums + slot * CN_STEP_SUM_KINDS, 0, CN_STEP_SUM_KINDS * sizeof *t->device.sums);
    for (uint32_t g = (uint32_t)slot; g < b->n_groups; g += CN_SLOTS) {
        if (!cn_batch_has(b, g) || (!b->group_samples[g] && !t->effects.pack.background.n)) continue;
        cn_batch_note_dirs(b, g);
        cn_trainer_group(t, g, &t->workers[worker], grad, &t->slot_stats[slot]);
        /* The input of the table's gradients. Here the gradients of the encodings have replaced the encodings. */
        t->slot_stats[slot].gradient +=
            sum_of_squares(b->enc + b->group_panel[g] * panel, cn_batch_panels(b->group_live[g]) * panel);
    }
    t->slot_stats[slot].gradient += sum_of_squares(grad, n);
}

static void update_weights(void *user, size_t item, unsigned worker)
{
    (void)item, (void)worker;
    const work *k = user;
    cn_trainer *t = k->t;
    cn_parameters *p = &t->parameters;
    for (size_t s = 0; s < CN_SLOTS; s++)
        for (size_t i = 0; i < p->n; i++)
            p->grad[i] += t->slot_grad[s * p->n + i];
    const cn_flat_step flat = { p->value, p->grad, p->photo_at, p->field.type->weight_rate, &t->effects.pack };
    cn_optimiser_step(&t->optimiser, t->kernel, k->rate, t->step, &flat);
    cn_parameters_derive(p);
    cn_train_effects_project(&t->effects, p, cn_step_progress(cn_trainer_at(t)));
}

static void update_occupancy(void *user, size_t item, unsigned worker)
{
    (void)item, (void)worker;
    cn_trainer *t = ((const work *)user)->t;
    const cn_batch *b = &t->batch;
    const float decay = cn_occupancy_decay(t->options.steps);
    for (uint32_t g = 0; g < b->n_groups; g++) {
        if (!cn_batch_has(b, g)) continue;
        const size_t first = b->group_panel[g] * CN_PANEL;
        cn_occupancy_update(&t->occ, t->step + 1, decay, b->group_samples[g], b->visit_cell + first,
                            b->visit_seen + first);
        if (t->support.photo) cn_support_update(&t->support, b, t->step, g);
    }
    cn_reactivation_open(&t->reactivation, b, &t->box, cn_trainer_at(t), &t->occ);
}

static void update_table(void *user, size_t item, unsigned worker)
{
    const work *k = user;
    cn_trainer *t = k->t;
    const double own = t->parameters.field.type->table_rate;
    const cn_adam adam = cn_optimiser_table_adam(own > 0 ? own * k->rate : k->rate, t->step);
    cn_parameters_update(&t->parameters, t->kernel, item, &t->batch, &adam, &t->workers[worker].part);
}

static void sum_stats(cn_trainer *t)
{
    const bool by_device = cn_train_device_stats(t, &t->stats);
    for (int s = 0; s < CN_SLOTS && !by_device; s++) {
        t->stats.squared_error += t->slot_stats[s].squared_error;
        t->stats.weighed_error += t->slot_stats[s].weighed_error;
        t->stats.weight += t->slot_stats[s].weight;
        t->stats.rays += t->slot_stats[s].rays;
        t->stats.live += t->slot_stats[s].live;
        t->stats.bad += t->slot_stats[s].bad;
        t->stats.gradient += t->slot_stats[s].gradient;
    }
    t->bad_rays += t->stats.bad;
}

static cn_status check_reads(const cn_trainer *t)
{
    for (uint32_t g = 0; g < t->batch.n_groups; g++)
        if (t->sampler.read_status[g] != CN_OK) return cn_sampler_unreadable(t->sampler.read_status[g]);
    return CN_OK;
}

/* ---- the step as operations of the device ---- */

/* All operations have the trainer's arrays as their batch. */
static cn_op op_of(const work *k, cn_op_kind kind, void (*item)(void *user, size_t item, unsigned worker))
{
    return (cn_op){ .kind = kind, .item = item, .batch = &k->t->device.step };
}

static cn_status gather(work *k)
{
    const cn_op ops[] = { op_of(k, CN_OP_RAYS, draw_group), op_of(k, CN_OP_MARCH, march_group) };
    const cn_chain chain = { ops, 2, k->t->batch.n_groups, k };
    return cn_device_run(k->t->ctx, &chain, 1);
}

static cn_status run_one(work *k, cn_op op, size_t items)
{
    const cn_chain chain = { &op, 1, items, k };
    return cn_device_run(k->t->ctx, &chain, 1);
}

static cn_status update(work *k)
{
    const cn_op weights = op_of(k, CN_OP_OPTIMISE, update_weights),
                occupancy = op_of(k, CN_OP_OCCUPANCY, update_occupancy),
                table = op_of(k, CN_OP_OPTIMISE_TABLE, update_table);
    const cn_chain chains[] = { { &weights, 1, 1, k },
                                { &occupancy, 1, 1, k },
                                { &table, 1, cn_parameters_update_items(&k->t->parameters), k } };
    return cn_device_run(k->t->ctx, chains, 3);
}

/* A field whose type does so changes its structure every ADAPT_EVERY steps, until ADAPT_UNTIL of the schedule, so that
 * what is new can still be learned. Not measured apart. */
enum { ADAPT_EVERY = 16 };
#define ADAPT_UNTIL 0.8

static void adapt_field(cn_trainer *t)
{
    const cn_field *field = &t->parameters.field;
    if (!field->type->adapt || t->step % ADAPT_EVERY || cn_step_progress(cn_trainer_at(t)) > ADAPT_UNTIL) return;
    cn_field_change change = cn_parameters_change(&t->parameters, t->options.seed, t->step);
    change.seen = t->occ.seen;
    change.bits = t->occ.bits;
    field->type->adapt(field, &change);
}

static void refill_part(void *user, size_t item, unsigned worker)
{
    (void)item, (void)worker;
    cn_trainer *t = ((const work *)user)->t;
    uint32_t part;
    if (cn_reactivation_refills(cn_trainer_at(t), &part)) cn_occupancy_refill(&t->occ, part, CN_REFILL_PARTS);
}

static void close_corners(void *user, size_t item, unsigned worker)
{
    (void)item, (void)worker;
    cn_occupancy_close(&((const work *)user)->t->occ);
}

/* Rays with few samples can look once more into space that was emptied too early. */
static cn_status refill(work *k, double samples_per_ray)
{
    const cn_trainer *t = k->t;
    const cn_step_at at = cn_trainer_at(t);
    uint32_t part;
    if (t->distil.teacher || !cn_reactivation_refills(at, &part) ||
        !cn_sampler_has_room(&t->sampler, samples_per_ray, at, t->effects.pack.moves_rays, (double)t->box.step))
        return CN_OK;
    return run_one(k, op_of(k, CN_OP_REFILL, refill_part), 1);
}

cn_status cn_trainer_step(cn_trainer *t)
{
    cn_batch *b = &t->batch;
    cn_effect_pack *pack = &t->effects.pack;
    const double progress = cn_step_progress(cn_trainer_at(t));
    work k = { t, cn_sampler_lead(&t->sampler, cn_trainer_at(t), pack->moves_rays), 0 };
    cn_effect_pack_at(pack, fmax(progress, t->step / EFFECTS_BY));
    const bool cue = t->sampler.stereo || t->options.depth_kind == CN_DEPTH_CUE;
    const cn_loss_scene scene = { .background = pack->background.n > 0,
                                  .sparse = k.lead.sparse,
                                  .measured = t->sampler.n_depth > 0 && !cue,
                                  .cue = t->sampler.n_depth > 0 && cue,
                                  .normals = t->sampler.n_normal > 0,
                                  .single_view = pack->single_view };
    cn_loss_pack_make(&t->losses, &scene);
    b->n_groups = cn_sampler_groups(&t->sampler, t->options.samples_per_step);
    b->n_rays = b->n_groups * CN_GROUP;
    cn_train_device_step(t, k.lead);

    CN_TRY(gather(&k));
    CN_TRY(check_reads(t));
    CN_TRY(run_one(&k, op_of(&k, CN_OP_LAY_OUT, lay_out), 1));
    CN_TRY(run_one(&k, op_of(&k, CN_OP_PLACE, place_group), b->n_groups));
    CN_TRY(run_one(&k, op_of(&k, CN_OP_ENCODE, encode_item), cn_parameters_encode_items(&t->parameters)));
    CN_TRY(run_one(&k, op_of(&k, CN_OP_SHADE, run_slot), CN_SLOTS));
    t->stats = (cn_step_stats){ .samples = b->counts->samples };
    cn_sampler_note_groups(&t->sampler, t->stats.samples, b->n_groups);
    sum_stats(t);
    if (cn_monitor_accepts(&t->monitor, &t->stats, pack, b)) {
        k.rate = cn_optimiser_rate(&t->optimiser, cn_trainer_at(t), cn_monitor_rate(&t->monitor));
        cn_train_device_update(t, k.rate);
        CN_TRY(update(&k));
    }
    const double samples_per_ray = (double)t->stats.samples / (b->counts->marched_rays ? b->counts->marched_rays : 1);
    cn_sampler_adapt_march(&t->sampler, samples_per_ray, cn_trainer_at(t), pack->moves_rays, (double)t->box.step);
    CN_TRY(refill(&k, samples_per_ray));
    if (cn_reactivation_closes(cn_trainer_at(t))) CN_TRY(run_one(&k, op_of(&k, CN_OP_REFILL, close_corners), 1));
    t->step++;
    adapt_field(t);
    return CN_OK;
}
