/* One training step. Every phase is a run over fixed items (groups of rays, levels, ranges), and whatever is summed is
 * summed in item order, so a step gives the same bits on any number of threads. */
#include "train/trainer.h"

#include "base/rng.h"

#include <math.h>

enum { ENCODE_BLOCKS = 8 };

/* Random streams; 1 to 6 belong to the field. */
enum { STREAM_PHOTO = 16, STREAM_X, STREAM_Y, STREAM_JITTER };

/* The step's length over distance: as fine as SAMPLES_PER_RAY on average allows, down to the tile's own. While space is
 * still full of fog steps are long and rays many; as it empties, the same number of samples follows the surfaces, and
 * at the end, when these settle, a ray may have more: depth is no finer than the march. On a made city of wide streets,
 * where 20 samples left a step of 1.75 % of the distance, steps of 0.8 % for that last part alone bring the median
 * error of depth from 1.2 to 0.9 % and are worth 0.4 dB, in the same time. */
#define SAMPLES_PER_RAY 20.0
#define LAST_SAMPLES_PER_RAY 64.0
/* Where poses are refined a ray may have so many from the start, and sparse points tie the rays for this part of the
 * schedule only. On a made city, whose poses were 0.5 degrees and 15 cm off, moves that ended over 10 cm off end 6.6 cm
 * off so. */
#define MOVED_SAMPLES_PER_RAY 40.0
#define TIES_WHERE_RAYS_MOVE 0.1

static void adapt_march_step(cn_trainer *t)
{
    const double now = (double)t->stats.samples / (t->marched_rays ? t->marched_rays : 1);
    const bool last = t->step >= CN_RATE_HELD * t->options.steps;
    const double room = last ? LAST_SAMPLES_PER_RAY : t->pack.moves_rays ? MOVED_SAMPLES_PER_RAY : SAMPLES_PER_RAY;
    const double change = fmin(fmax(now / room, 0.98), 1.02);
    t->march_step = fmin(fmax(t->march_step * change, t->box.step), CN_LONGEST_STEP);
}

/* An effect's start is a fraction of the schedule, but of no more than so many steps: a surface is there by then
 * however long training goes on, and what an occluder has built by itself does not go away again. */
#define EFFECTS_BY 1500.0

static double progress_of(const cn_trainer *t)
{
    return t->options.steps ? (double)t->step / t->options.steps : 1;
}

static bool ties_hold(const cn_trainer *t)
{
    return t->n_ties && !(t->pack.moves_rays && progress_of(t) >= TIES_WHERE_RAYS_MOVE);
}

static void draw_ray(cn_trainer *t, uint32_t r, uint16_t *x, uint16_t *y)
{
    const uint64_t counter = (uint64_t)t->step * CN_MAX_RAYS + r, seed = t->options.seed;
    t->ray_tie[r] = 0;
    if (r % CN_TIE_EVERY == 0 && ties_hold(t)) {
        const cn_tie *tie = &t->ties[cn_rng_below(seed, STREAM_PHOTO, counter, t->n_ties)];
        *x = tie->x;
        *y = tie->y;
        t->ray_photo[r] = tie->photo;
        t->ray_tie[r] = tie->distance_m;
        return;
    }
    const uint32_t photo = cn_rng_below(seed, STREAM_PHOTO, counter, t->n_photos);
    const cn_train_photo *p = &t->photos[photo];
    *x = (uint16_t)cn_rng_below(seed, STREAM_X, counter, p->size.width);
    *y = (uint16_t)cn_rng_below(seed, STREAM_Y, counter, p->size.height);
    t->ray_photo[r] = photo;
}

static uint32_t march_ray(cn_trainer *t, uint32_t r, float *at, uint32_t room)
{
    const uint64_t counter = (uint64_t)t->step * CN_MAX_RAYS + r;
    const cn_march march = { t->box.near_m, t->box.far_m, (float)(1 + t->march_step),
                             cn_rng_float(t->options.seed, STREAM_JITTER, counter) };
    const uint32_t n = t->kernel->march(&t->rays[r].box_ray, &march, t->occ.bits, at, room);
    if (n < room) return n;
    t->target[4 * (size_t)r + 3] = 0; /* no room for the whole ray: it sits this step out */
    return 0;
}

static void note_place(cn_trainer *t, uint32_t r, uint16_t x, uint16_t y)
{
    const cn_pixel_extent size = t->photos[t->ray_photo[r]].size;
    t->uv[2 * (size_t)r] = 2 * ((float)x + 0.5f) / (float)size.width - 1;
    t->uv[2 * (size_t)r + 1] = 2 * ((float)y + 0.5f) / (float)size.height - 1;
}

/* Lets the effects move a group's rays: between box units and units of the mean half extent. */
static void move_rays(cn_trainer *t, uint32_t first)
{
    float origin[CN_GROUP][3], dir[CN_GROUP][3], unit[3];
    for (int a = 0; a < 3; a++)
        unit[a] = (float)t->box.half_extent[a] * t->inv_extent;
    for (uint32_t i = 0; i < CN_GROUP; i++)
        for (int a = 0; a < 3; a++) {
            origin[i][a] = t->rays[first + i].box_ray.origin[a] * unit[a];
            dir[i][a] = t->rays[first + i].dir[a];
        }
    const cn_effect_rays rays = { CN_GROUP, t->dirs + 3 * (size_t)first, t->uv ? t->uv + 2 * (size_t)first : NULL,
                                  t->ray_photo + first };
    const cn_effect_state state = { t->kernel, t->constants, t->flat.value + t->photo_at, t->flat.value + t->shared_at,
                                    t->derived };
    cn_effects_ray(&t->pack, &rays, &state, origin, dir);
    for (uint32_t i = 0; i < CN_GROUP; i++)
        for (int a = 0; a < 3; a++) {
            t->rays[first + i].box_ray.origin[a] = origin[i][a] / unit[a];
            t->rays[first + i].box_ray.dir[a] = dir[i][a] / (float)t->box.half_extent[a];
        }
}

/* Draws the pixels of a group, reads them and shoots their rays. A ray of weight 0 takes no part. */
static void shoot_group(cn_trainer *t, uint32_t g)
{
    uint16_t x[CN_GROUP], y[CN_GROUP];
    uint32_t store[CN_GROUP];
    const uint32_t first = g * CN_GROUP;
    for (uint32_t i = 0; i < CN_GROUP; i++) {
        draw_ray(t, first + i, &x[i], &y[i]);
        store[i] = t->photos[t->ray_photo[first + i]].store;
    }
    t->read_status[g] = cn_pixel_store_gather(t->input->pixels, CN_GROUP, store, x, y, t->target + 4 * (size_t)first);
    for (uint32_t i = 0; i < CN_GROUP; i++) {
        const uint32_t r = first + i;
        const cn_ray_generator *generator = &t->photos[t->ray_photo[r]].generator;
        if (!(t->target[4 * (size_t)r + 3] > 0) ||
            !cn_ray_generator_ray(generator, x[i] + 0.5, y[i] + 0.5, &t->rays[r]))
            t->target[4 * (size_t)r + 3] = 0;
        memcpy(t->dirs + 3 * (size_t)r, t->rays[r].dir, sizeof t->rays[r].dir);
        if (t->uv) note_place(t, r, x[i], y[i]);
    }
    if (t->pack.ray.n) move_rays(t, first);
}

static void gather_group(void *user, size_t g, unsigned worker)
{
    (void)worker;
    cn_trainer *t = user;
    uint32_t used = 0;
    shoot_group(t, (uint32_t)g);
    for (uint32_t r = (uint32_t)g * CN_GROUP; r < (g + 1) * CN_GROUP; r++) {
        t->ray_samples[r] = 0;
        t->ray_hole[r] = 0;
        if (!(t->target[4 * (size_t)r + 3] > 0)) continue;
        t->ray_samples[r] = march_ray(t, r, t->march_t + g * CN_GROUP_CAP + used, CN_GROUP_CAP - used);
        used += t->ray_samples[r];
        if (!t->ray_samples[r] && t->target[4 * (size_t)r + 3] > 0) cn_reopen_note(t, r, 1);
        /* A ray through nothing says something only where there is a background. */
        if (!t->ray_samples[r] && !t->pack.background.n) t->target[4 * (size_t)r + 3] = 0;
    }
    t->group_samples[g] = used;
}

/* Gives every group its panels, until they are used up. */
static void lay_out_groups(cn_trainer *t)
{
    size_t panels = 0;
    uint64_t samples = 0;
    t->kept_rays = t->marched_rays = 0;
    for (uint32_t g = 0; g < t->n_groups; g++) {
        const size_t wanted = (t->group_samples[g] + CN_PANEL - 1) / CN_PANEL;
        const bool fits = panels + wanted <= t->panel_cap;
        t->group_panel[g] = fits ? panels : SIZE_MAX;
        t->group_live[g] = 0;
        if (!fits) continue;
        panels += wanted;
        samples += t->group_samples[g];
        for (uint32_t i = g * CN_GROUP; i < (g + 1) * CN_GROUP; i++) {
            t->kept_rays += t->target[4 * (size_t)i + 3] > 0;
            t->marched_rays += t->ray_samples[i] > 0;
        }
    }
    t->n_panels = panels;
    t->stats = (cn_step_stats){ .samples = samples };
    t->samples_per_group = 0.8 * t->samples_per_group + 0.2 * fmax((double)samples / t->n_groups, CN_GROUP);
}

static void place_group(void *user, size_t g, unsigned worker)
{
    (void)worker;
    cn_trainer *t = user;
    if (t->group_panel[g] == SIZE_MAX) return;
    const size_t panels = (t->group_samples[g] + CN_PANEL - 1) / CN_PANEL;
    float *pos = t->pos + t->group_panel[g] * 3 * CN_PANEL, *length = t->length + t->group_panel[g] * CN_PANEL;
    if (panels) memset(pos + (panels - 1) * 3 * CN_PANEL, 0, 3 * CN_PANEL * sizeof *pos);
    const float *at = t->march_t + g * CN_GROUP_CAP;
    uint32_t done = 0;
    for (uint32_t i = 0; i < CN_GROUP; i++) {
        const uint32_t r = (uint32_t)g * CN_GROUP + i;
        t->kernel->place(&t->rays[r].box_ray, at + done, t->ray_samples[r], (float)t->march_step, t->inv_extent, done,
                         pos, length + done);
        done += t->ray_samples[r];
    }
}

static void encode_block(void *user, size_t item, unsigned worker)
{
    (void)worker;
    cn_trainer *t = user;
    const uint32_t level = (uint32_t)(item / ENCODE_BLOCKS);
    const size_t block = item % ENCODE_BLOCKS;
    const size_t first = t->n_panels * block / ENCODE_BLOCKS, last = t->n_panels * (block + 1) / ENCODE_BLOCKS;
    cn_field_encode_level(&t->field, t->kernel, (const uint32_t *)(const void *)t->table, level,
                          t->pos + first * 3 * CN_PANEL, last - first, t->enc + first * t->field.enc_rows * CN_PANEL);
}

static double sum_of_squares(const float *x, size_t n)
{
    float lanes[CN_PANEL] = { 0 }; /* many sums, so that they can be had at once */
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
    cn_trainer *t = user;
    float *grad = t->slot_grad + slot * t->flat.n;
    memset(grad, 0, t->flat.n * sizeof *grad);
    t->slot_stats[slot] = (cn_step_stats){ 0 };
    for (uint32_t g = (uint32_t)slot; g < t->n_groups; g += CN_SLOTS) {
        if (t->group_panel[g] == SIZE_MAX || (!t->group_samples[g] && !t->pack.background.n)) continue;
        cn_trainer_group(t, g, &t->workers[worker], grad, &t->slot_stats[slot]);
        /* What the table's gradients will be made of: the encodings' have taken their place. */
        const size_t panels = (t->group_live[g] + CN_PANEL - 1) / CN_PANEL,
                     panel = (size_t)t->field.enc_rows * CN_PANEL;
        t->slot_stats[slot].gradient += sum_of_squares(t->enc + t->group_panel[g] * panel, panels * panel);
    }
    t->slot_stats[slot].gradient += sum_of_squares(grad, t->flat.n);
}

/* Held for CN_RATE_HELD of the schedule, for what a long step has put in mid-air only a long step takes away; then it
 * falls to a twentieth, and the surfaces settle. On fox, a minute's training, this is worth 2 dB over a fall to 1/30
 * from the start. The first steps are short so that Adam's moments settle. */
#define RATE_LAST 0.05

static double learning_rate(const cn_trainer *t)
{
    const double done = t->options.steps ? fmin((double)t->step / t->options.steps, 1) : 0;
    const double warm = fmin(1, (t->step + 1) / 20.0);
    return t->options.learning_rate * cn_guard_rate(t) * warm *
           pow(RATE_LAST, fmax(0, done - CN_RATE_HELD) / (1 - CN_RATE_HELD));
}

/* Weights are pulled to 0 a little; what belongs to effects is not, for Adam would take that pull, alone until an
 * effect starts, at full length. Rows with a rate of their own have their step scaled afterwards. */
static void adam_flat(cn_trainer *t, const cn_adam *adam)
{
    size_t first[CN_MAX_EFFECTS + 1];
    float factor[CN_MAX_EFFECTS], *rows = t->flat.value + t->photo_at, *before = t->rows_before;
    const uint32_t n = cn_effects_rates(&t->pack, first, factor);
    if (before) memcpy(before, rows, t->pack.n_photo * sizeof *before);
    cn_adam free_of_pull = *adam;
    free_of_pull.decay = 0;
    const size_t n_weights = t->photo_at;
    const cn_parameters *p = &t->flat;
    t->kernel->adam(adam, p->value, p->m, p->v, p->grad, n_weights);
    t->kernel->adam(&free_of_pull, p->value + n_weights, p->m + n_weights, p->v + n_weights, p->grad + n_weights,
                    p->n - n_weights);
    for (uint32_t e = 0; before && e < n; e++)
        for (size_t i = first[e]; factor[e] != 1 && i < first[e + 1]; i++)
            rows[i] = before[i] + factor[e] * (rows[i] - before[i]);
}

static void update_flat(cn_trainer *t)
{
    const double n = t->step + 1.0;
    const cn_adam adam = { .rate = (float)(learning_rate(t) * sqrt(1 - pow(0.99, n)) / (1 - pow(0.9, n))),
                           .beta1 = 0.9f,
                           .beta2 = 0.99f,
                           .epsilon = 1e-15f,
                           .decay = 1e-6f };
    for (size_t s = 0; s < CN_SLOTS; s++)
        for (size_t i = 0; i < t->flat.n; i++)
            t->flat.grad[i] += t->slot_grad[s * t->flat.n + i];
    adam_flat(t, &adam);
    cn_field_transpose(&t->field, t->flat.value, t->transposed);
    const cn_effect_photos photos = { t->n_photos, t->constants, t->run, (const float(*)[3])t->place };
    cn_effects_settle(&t->pack, &photos, t->flat.value + t->photo_at, progress_of(t));
    cn_effects_derive(&t->pack, t->flat.value + t->shared_at, t->derived);
}

cn_range cn_trainer_part(const cn_trainer *t, uint32_t level, uint32_t part)
{
    const uint32_t entries = t->field.level[level].entries,
                   blocks = (entries + 7) / 8; /* a block of state has 8 entries */
    const uint32_t a = (blocks + t->level_parts - 1) / t->level_parts, first = a * part * 8, end = a * (part + 1) * 8;
    if (first >= entries) return (cn_range){ entries, 0 };
    return (cn_range){ first, (end < entries ? end : entries) - first };
}

uint16_t *cn_trainer_state(const cn_trainer *t, uint32_t level)
{
    return t->table_state + (t->field.level[level].offset / 8 + (size_t)level) * CN_STATE_BLOCK;
}

/* Gradients and Adam of one part of a level, in one go: the gradients never leave the cache. */
static void update_part(cn_trainer *t, uint32_t l, uint32_t part, cn_worker *w)
{
    const cn_level *level = &t->field.level[l];
    const cn_range range = cn_trainer_part(t, l, part);
    const size_t stride = (size_t)t->field.enc_rows * CN_PANEL;
    if (!range.count) return;
    for (uint32_t g = 0; g < t->n_groups; g++) {
        if (!t->group_live[g]) continue;
        const size_t panels = (t->group_live[g] + CN_PANEL - 1) / CN_PANEL, first = t->group_panel[g];
        t->kernel->encode_backward(level, t->pos + first * 3 * CN_PANEL,
                                   t->enc + first * stride + (size_t)l * 2 * CN_PANEL, stride, panels, &range,
                                   w->part_grad, w->touched);
    }
    /* No bias correction where an entry is updated only when it has a gradient: (1 - beta1) = sqrt(1 - beta2), so its
     * first step has full length as it is. The dither goes round the circle by the golden ratio. */
    const cn_adam adam = { .rate = (float)learning_rate(t),
                           .beta1 = 0.9f,
                           .beta2 = 0.99f,
                           .epsilon = 1e-15f,
                           .dither = (t->step * 2654435769u) >> 16 };
    t->kernel->adam_table(&adam, t->table + 2 * ((size_t)level->offset + range.first),
                          cn_state_at(cn_trainer_state(t, l), 2 * (size_t)range.first), w->part_grad, w->touched,
                          2 * (size_t)range.count);
}

static void update_occupancy(cn_trainer *t)
{
    for (uint32_t g = 0; g < t->n_groups; g++) {
        if (t->group_panel[g] == SIZE_MAX) continue;
        cn_occupancy_update(&t->occ, t->step + 1, t->group_samples[g], t->visit_cell + t->group_panel[g] * CN_PANEL,
                            t->visit_seen + t->group_panel[g] * CN_PANEL);
        if (t->witness) cn_witness_update(t, g);
    }
    cn_reopen_cells(t);
}

/* Levels finest (largest, slowest) first; beside them all else that a step changes. */
static void update_item(void *user, size_t item, unsigned worker)
{
    cn_trainer *t = user;
    if (item == 0)
        update_flat(t);
    else if (item == 1)
        update_occupancy(t);
    else {
        const uint32_t i = (uint32_t)item - 2;
        update_part(t, t->field.config.levels - 1 - i / t->level_parts, i % t->level_parts, &t->workers[worker]);
    }
}

static void sum_stats(cn_trainer *t)
{
    for (int s = 0; s < CN_SLOTS; s++) {
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

cn_status cn_trainer_step(cn_trainer *t)
{
    cn_pool *pool = t->ctx->pool;
    cn_effect_pack_at(&t->pack, fmax(progress_of(t), t->step / EFFECTS_BY));
    const double wanted = t->options.samples_per_step / t->samples_per_group;
    t->n_groups = (uint32_t)fmin(fmax(wanted, 4), CN_MAX_GROUPS);
    t->n_rays = t->n_groups * CN_GROUP;

    cn_pool_run(pool, t->n_groups, gather_group, t);
    for (uint32_t g = 0; g < t->n_groups; g++)
        if (t->read_status[g] != CN_OK)
            return cn_fail(t->read_status[g],
                           "the pixel store cannot be read; delete pixels.bin and run `conurb plan` again");
    lay_out_groups(t);
    cn_pool_run(pool, t->n_groups, place_group, t);
    cn_pool_run(pool, (size_t)t->field.config.levels * ENCODE_BLOCKS, encode_block, t);
    cn_pool_run(pool, CN_SLOTS, run_slot, t);
    sum_stats(t);
    if (cn_guard_takes(t)) cn_pool_run(pool, 2 + (size_t)t->field.config.levels * t->level_parts, update_item, t);
    adapt_march_step(t);
    t->step++;
    return CN_OK;
}
