/* Fits an appearance to rays whose colours are known; the tile itself does not change. The densities are computed
 * once. Each step repeats only the colour head and the effects' rows. An appearance is a few numbers, so a subset of
 * the rays determines it. It is also enough to take a few samples of each ray, at equal steps of its weight. The cost
 * of a step therefore depends neither on the size of the photo nor on how much fog the tile holds.
 *
 * A row that fits these rays may be wrong for others. A sky's code that fits a wall on the left may turn the wall on
 * the right into sky. The rays are therefore divided into two halves. A row is fitted to each half and tested on the
 * other. Each effect takes over only as much of its part of the row as helps in these tests, and as the two halves
 * agree on; all take over all of it where that is far better in these tests. */
#include "train/fit.h"
#include "train/composite.h"
#include "train/shade.h"
#include "train/trainer.h"

#include "base/rng.h"
#include "tile/model.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* An appearance is a few numbers: four times the rays and twice the steps change the right halves of castle,
 * sacre-coeur and entry-P10 by 0.0, -0.2 and 0.0 dB. */
enum { STEPS = 60, MIN_RAYS = 64, MAX_RAYS = 512, MAX_LIVE = 8 /* the most samples of a ray */, OFFSETS = 3 };
enum { STREAM_PICK = 32 };
#define RATE 0.05
/* A ray whose error is more than this many times the lower quartile has less weight (Geman-McClure). A tree or a
 * passer-by that only this photo shows says nothing about its light. For normal errors the limit is four times the
 * median. The quartile is taken because a tree may fill half of the rays, and the median would then be that of the
 * tree. Found on sceaux. */
#define OUTLIER 8
#define LEAST_OUTLIER 0.0075 /* a twentieth of white in each channel; for a clipped sky, where all errors are 0 */
/* A change of an effect's part of the row has to lower the squared error of the other half by at least this part. */
#define PAYS 0.01
/* The cost of a row that is as far from the mean of the trained photos' rows as these are on average. It is a part of
 * the error at which an outlier counts half. Without this cost, a sky's code is fitted to the tree before the sky.
 * Found on sceaux (one training: right half of 100_7100 7.8 dB at 0, 19.5 at 0.05, 18.8 at 0.1); castle and herz-jesus
 * change by less than 0.3 dB. */
#define PRIOR 0.05
/* All of each half's change is tested on the other half too. Where its error is below this part of that of the parts
 * that would be taken over, all of the change is. Both halves found the light then, but put it in different numbers: a
 * gain may stand for a code. Found on reichstag, in three trainings: right halves +0.5, +0.4 and 0.0 dB; at 0.85 one
 * photo loses 2 dB. castle does not change. */
#define WHOLE 0.7
#define OPEN 0.1f /* opacity of a ray that sees the background. Not measured apart */

/* One group of rays, after its densities are computed: what the colour head needs of its live samples. */
typedef struct fit_group {
    uint32_t n_live;
    cn_span span[CN_GROUP];
    float dir[3 * CN_GROUP], target[4 * CN_GROUP];
    float given[CN_GROUP], error[CN_GROUP]; /* weights as given; squared errors of the last pass */
    float *geo, *weight;                    /* [kept panels][geo_rows][CN_PANEL]; [n_live] of kept samples */
    uint32_t *live_ray;
} fit_group;

typedef struct fit {
    const cn_context *ctx;
    const cn_tile *tile;
    const cn_kernel *kernel;
    size_t n, n_given; /* rays that are used, of those given */
    const double (*origin)[3], (*direction)[3];
    const float *target;
    bool new_light; /* see cn_lit_rays */
    cn_arena arena;
    cn_worker *workers;
    float *pos, *length, *at, *enc; /* [threads][group] */
    fit_group *groups;
    uint32_t n_groups;
    uint32_t first, end;               /* groups of a pass */
    uint64_t n_kept, n_open;           /* rays with a weight; of these, rays that see the background */
    double outlier;                    /* the squared error at which a ray counts half */
    cn_fit_prior prior;                /* of the trained photos' rows */
    double start_error[CN_FIT_STARTS]; /* with the rows of some trained photos; of the last fit_groups */
    cn_appearance row;
    float *slot_grad; /* [CN_SLOTS][row parameters, shared parameters] */
    size_t grad_size;
    cn_step_stats stats[CN_SLOTS];
    cn_status status[CN_SLOTS];
} fit;

static void carve(fit *f, cn_arena *arena, unsigned threads)
{
    const cn_field *field = &f->tile->field;
    cn_worker counted, *workers = CN_ARENA_NEW(arena, cn_worker, threads);
    for (unsigned i = 0; i < threads; i++)
        cn_worker_carve(field, &f->tile->one, arena, workers ? &workers[i] : &counted);
    f->workers = workers;
    f->pos = CN_ARENA_NEW(arena, float, (size_t)threads *CN_GROUP_CAP * 3);
    f->length = CN_ARENA_NEW(arena, float, (size_t)threads *CN_GROUP_CAP);
    f->at = CN_ARENA_NEW(arena, float, (size_t)threads *CN_GROUP_CAP);
    f->enc = CN_ARENA_NEW(arena, float, (size_t)threads *CN_GROUP_CAP * field->enc_rows);
    f->groups = CN_ARENA_NEW(arena, fit_group, f->n_groups);
    f->slot_grad = CN_ARENA_NEW(arena, float, CN_SLOTS * f->grad_size);
}

/* Which of a ray's live samples are kept, and the weight that each then stands for. All of them, or those at the
 * middles of MAX_LIVE equal parts of the ray's weight. */
static uint32_t pick_samples(const cn_span *span, const float *weight, uint32_t *pick, float *stands_for)
{
    if (span->n <= MAX_LIVE) {
        for (uint32_t i = 0; i < span->n; i++)
            pick[i] = span->first + i, stands_for[i] = weight[span->first + i];
        return span->n;
    }
    const float share = span->total / MAX_LIVE;
    float behind = 0;
    uint32_t n = 0, shares = 0;
    for (uint32_t i = span->first; i < span->first + span->n && shares < MAX_LIVE; i++) {
        uint32_t here = 0;
        behind += weight[i];
        const bool last = i + 1 == span->first + span->n;
        for (; shares < MAX_LIVE && (last || ((float)shares + 0.5f) * share < behind); shares++)
            here++;
        if (!here) continue;
        pick[n] = i;
        stands_for[n++] = (float)here * share;
    }
    return n;
}

/* Keeps what the steps need of a group's live samples; the spans become those of the kept ones. */
static cn_status keep_group(const fit *f, fit_group *g, const cn_worker *w)
{
    const size_t rows = f->tile->field.colour_in, n_geo = f->tile->field.geo_rows, most = (size_t)CN_GROUP * MAX_LIVE;
    const size_t room = g->n_live < most ? g->n_live : most, panels = (room + CN_PANEL - 1) / CN_PANEL;
    if (!g->n_live) return CN_OK;
    g->geo = calloc(panels * n_geo * CN_PANEL, sizeof *g->geo);
    g->weight = malloc(room * sizeof *g->weight);
    g->live_ray = malloc(room * sizeof *g->live_ray);
    if (!g->geo || !g->weight || !g->live_ray)
        return cn_fail(CN_ERR_NOMEM, "out of memory while fitting an appearance");
    uint32_t at = 0;
    for (uint32_t r = 0; r < CN_GROUP; r++) {
        uint32_t pick[MAX_LIVE];
        const uint32_t n = pick_samples(&g->span[r], w->weight, pick, g->weight + at);
        for (uint32_t k = 0; k < n; k++) {
            const size_t to = at + k, from = pick[k];
            float *geo = g->geo + to / CN_PANEL * n_geo * CN_PANEL + to % CN_PANEL;
            const float *in = w->acts.in + from / CN_PANEL * rows * CN_PANEL + from % CN_PANEL;
            for (size_t c = 0; c < n_geo; c++)
                geo[c * CN_PANEL] = in[c * CN_PANEL];
            g->live_ray[to] = r;
        }
        g->span[r].first = at;
        g->span[r].n = n;
        at += n;
    }
    g->n_live = at;
    return CN_OK;
}

/* The ray that stands for the k-th of n equal runs of those given. */
static size_t given_ray(const fit *f, size_t k)
{
    const size_t first = f->n_given * k / f->n, end = f->n_given * (k + 1) / f->n;
    return first + cn_rng_below(1, STREAM_PICK, k, (uint32_t)(end - first));
}

/* Marches the rays of a group; samples[CN_GROUP]. Rays that hit nothing, or that do not fit, are left out. */
static uint32_t march_group(const fit *f, fit_group *g, size_t first, cn_ray *rays, float *at, uint32_t *samples)
{
    const cn_box *box = &f->tile->box;
    const cn_march march = { box->near_m, box->far_m, 1 + box->step, 0.5f };
    uint32_t used = 0;
    for (uint32_t i = 0; i < CN_GROUP; i++) {
        samples[i] = 0;
        if (first + i >= f->n) continue;
        const size_t given = given_ray(f, first + i);
        memcpy(g->target + 4 * (size_t)i, f->target + 4 * given, 4 * sizeof(float));
        cn_ray_make(box, f->origin[given], f->direction[given], &rays[i]);
        memcpy(g->dir + 3 * (size_t)i, rays[i].dir, sizeof rays[i].dir);
        const uint32_t room = CN_GROUP_CAP - used,
                       n = f->kernel->march(&rays[i].box_ray, &march, f->tile->occupancy, at + used, room);
        samples[i] = n < room ? n : 0;
        if (n >= room || (!n && !f->tile->one.background.n)) g->target[4 * (size_t)i + 3] = 0;
        used += samples[i];
    }
    return used;
}

static cn_status gather_group(const fit *f, fit_group *g, size_t first, unsigned thread)
{
    const cn_field *field = &f->tile->field;
    cn_worker *w = &f->workers[thread];
    float *pos = f->pos + (size_t)thread * CN_GROUP_CAP * 3, *length = f->length + (size_t)thread * CN_GROUP_CAP;
    float *at = f->at + (size_t)thread * CN_GROUP_CAP, *enc = f->enc + (size_t)thread * CN_GROUP_CAP * field->enc_rows;
    cn_ray rays[CN_GROUP];
    uint32_t samples[CN_GROUP];
    const uint32_t used = march_group(f, g, first, rays, at, samples);
    const size_t panels = (used + CN_PANEL - 1) / CN_PANEL;
    if (panels) memset(pos + (panels - 1) * 3 * CN_PANEL, 0, 3 * CN_PANEL * sizeof *pos);
    for (uint32_t i = 0, done = 0; i < CN_GROUP; done += samples[i++])
        f->kernel->place(&rays[i].box_ray, at + done, samples[i],
                         (cn_spacing){ f->tile->box.step, cn_box_inv_extent(&f->tile->box) }, (cn_lanes){ pos, done },
                         length + done);
    for (uint32_t e = 0; e < field->n_encoders; e++)
        field->type->encode(field, f->kernel, e, &(cn_field_encoding){ f->tile->params.table, pos, panels, enc });
    cn_field_acts all = w->acts;
    all.enc = enc;
    field->type->logits(field, f->kernel, &f->tile->params, &all, panels, w->logit);
    const cn_composite_samples all_samples = { CN_GROUP, samples, length, enc, pos, 0, NULL };
    g->n_live = cn_composite_gather(field, &all_samples, w, g->span);
    cn_shade_clear_tail(field, g->n_live, w);
    field->type->density_pass(field, f->kernel, &f->tile->params, &w->acts, (g->n_live + CN_PANEL - 1) / CN_PANEL);
    return keep_group(f, g, w);
}

static void gather_slot(void *user, size_t slot, unsigned thread)
{
    fit *f = user;
    for (size_t g = slot; g < f->n_groups && f->status[slot] == CN_OK; g += CN_SLOTS)
        f->status[slot] = gather_group(f, &f->groups[g], g * CN_GROUP, thread);
}

static void shade_group(const fit *f, fit_group *g, cn_worker *w, float *grad, cn_step_stats *stats)
{
    static const uint32_t first_row[CN_GROUP];
    const cn_tile *tile = f->tile;
    const cn_effect_pack *one = &tile->one;
    const size_t rows = tile->field.colour_in, n_geo = tile->field.geo_rows,
                 panels = (g->n_live + CN_PANEL - 1) / CN_PANEL;
    const cn_shade shade = {
        .kernel = f->kernel,
        .field = &tile->field,
        .params = tile->params,
        .pack = one,
        .effects = { f->kernel, f->row.row, f->row.row + one->n_constants, tile->shared, tile->derived },
        .rays = { CN_GROUP, g->dir, NULL, first_row, NULL },
        .target = g->target,
        .scale = 1.0f / (3.0f * (float)f->n_kept),
        .error = g->error,
    };
    const cn_effect_grad effect_grad = { grad, grad + one->n_photo };
    for (size_t p = 0; p < panels; p++)
        memcpy(w->acts.in + p * rows * CN_PANEL, g->geo + p * n_geo * CN_PANEL, n_geo * CN_PANEL * sizeof *g->geo);
    memcpy(w->weight, g->weight, g->n_live * sizeof *g->weight);
    memcpy(w->live_ray, g->live_ray, g->n_live * sizeof *g->live_ray);
    memset(w->d_colour, 0, 3 * (size_t)g->n_live * sizeof *w->d_colour);
    cn_shade_forward(&shade, g->n_live, w);
    cn_shade_grad shade_grad;
    cn_shade_loss(&shade, g->span, w, &shade_grad, &effect_grad, stats);
    for (uint32_t r = 0; r < CN_GROUP; r++)
        cn_shade_colours_backward(&g->span[r], shade_grad.pixel[r], w);
    for (size_t i = 0; i < panels; i++)
        memset(w->d.out + (i * 4 + 3) * CN_PANEL, 0, CN_PANEL * sizeof(float));
    tile->field.type->colour_backward(&tile->field, f->kernel, &tile->params, &w->acts, &w->d, panels);
    cn_shade_conditioning_backward(&shade, g->n_live, w, &effect_grad);
}

static void shade_slot(void *user, size_t slot, unsigned thread)
{
    fit *f = user;
    float *grad = f->slot_grad + slot * f->grad_size;
    memset(grad, 0, f->grad_size * sizeof *grad);
    f->stats[slot] = (cn_step_stats){ 0 };
    for (size_t g = f->first + slot; g < f->end; g += CN_SLOTS)
        shade_group(f, &f->groups[g], &f->workers[thread], grad, &f->stats[slot]);
}

/* Mean squared error of the rays of the last pass, with less weight for outliers. Sets the weights for the next pass.
 */
static double robust_error(fit *f)
{
    double sum = 0;
    uint64_t rays = 0;
    for (uint32_t g = f->first; g < f->end; g++)
        for (uint32_t i = 0; i < CN_GROUP; i++) {
            fit_group *of = &f->groups[g];
            if (!(of->given[i] > 0)) continue;
            const double part = 1 / (1 + (double)of->error[i] / f->outlier);
            of->target[4 * (size_t)i + 3] = of->given[i] * (float)(part * part);
            sum += (double)of->error[i] * part;
            rays++;
        }
    return rays ? sum / (3.0 * (double)rays) : NAN;
}

static int by_size(const void *a, const void *b)
{
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* Sets the limit of outliers from the errors of the last pass, which used all rays. */
static cn_status find_outlier(fit *f)
{
    float *errors = malloc(sizeof *errors * (f->n_kept + 1));
    size_t n = 0;
    if (!errors) return cn_fail(CN_ERR_NOMEM, "out of memory while fitting an appearance");
    for (uint32_t g = 0; g < f->n_groups; g++)
        for (uint32_t i = 0; i < CN_GROUP; i++)
            if (f->groups[g].given[i] > 0) errors[n++] = f->groups[g].error[i];
    qsort(errors, n, sizeof *errors, by_size);
    f->outlier = fmax(OUTLIER * (double)errors[n / 4], LEAST_OUTLIER);
    free(errors);
    return CN_OK;
}

/* One pass over the rays with the present row. *error: mean squared error, with less weight for outliers. grad[n_photo]
 * is summed in slot order. */
static cn_status measure(fit *f, double *grad, double *error)
{
    static const cn_op shade = { .kind = CN_OP_SHADE, .item = shade_slot };
    const cn_chain chain = { &shade, 1, CN_SLOTS, f };
    CN_TRY(cn_device_run(f->ctx, &chain, 1));
    for (size_t i = 0; i < f->tile->one.n_photo; i++)
        grad[i] = 0;
    for (size_t s = 0; s < CN_SLOTS; s++) {
        for (size_t i = 0; i < f->tile->one.n_photo; i++)
            grad[i] += (double)f->slot_grad[s * f->grad_size + i];
    }
    *error = robust_error(f);
    return CN_OK;
}

/* The cost of a row that is unlike those of the trained photos, as an error, and its gradient. */
static double add_prior(const fit *f, double *grad)
{
    const size_t first = f->tile->one.n_constants, n = f->tile->one.n_photo;
    const double weight = PRIOR * f->outlier / (3.0 * (double)(n ? n : 1));
    double sum = 0;
    for (size_t i = 0; i < n; i++) {
        const double off = (double)f->row.row[first + i] - f->prior.mean[i];
        sum += weight * off * off * f->prior.precision[i];
        grad[i] += 2 * weight * off * f->prior.precision[i];
    }
    return sum;
}

/* From f->row: what is known to vary more than between the trained photos is tried in steps of two deviations. */
static cn_status choose_offsets(fit *f, double least)
{
    const cn_effect_pack *one = &f->tile->one;
    cn_appearance best = f->row;
    for (uint32_t e = 0; e < one->n_on; e++)
        for (uint32_t c = 0; one->on[e].effect->spread > 0 && c < one->on[e].effect->photo_params; c++) {
            const size_t at = one->n_constants + one->on[e].photo + c;
            const float middle = best.row[at];
            for (int k = -OFFSETS; k <= OFFSETS && !cn_stopping(f->ctx); k++) {
                double grad[CN_APPEARANCE_MAX], error;
                f->row = best;
                f->row.row[at] = middle + 2 * (float)k * one->on[e].effect->spread;
                CN_TRY(measure(f, grad, &error));
                error += add_prior(f, grad);
                if (error < least) least = error, best = f->row;
            }
        }
    f->row = best;
    return CN_OK;
}

/* Starts from the row of the trained photo whose light is nearest, if it is nearer than the given row. A descent from
 * the mean light to a night is long, and has local minima. */
static cn_status choose_start(fit *f)
{
    const cn_tile *tile = f->tile;
    double grad[CN_APPEARANCE_MAX], least, error;
    CN_TRY(measure(f, grad, &least));
    least += add_prior(f, grad);
    cn_appearance best = f->row, photo;
    for (uint32_t i = 0; i < cn_fit_starts(tile) && !cn_stopping(f->ctx); i++) {
        f->start_error[i] = INFINITY;
        if (cn_tile_appearance(tile, cn_fit_start_name(tile, i), &photo) != CN_OK) continue;
        memcpy(f->row.row + tile->one.n_constants, photo.row + tile->one.n_constants,
               tile->one.n_photo * sizeof *photo.row);
        CN_TRY(measure(f, grad, &error));
        f->start_error[i] = error;
        error += add_prior(f, grad);
        if (error < least) least = error, best = f->row;
    }
    f->row = best;
    return choose_offsets(f, least);
}

/* Optimises the row by Adam, and keeps the best one. */
static cn_status descend(fit *f, cn_appearance *best)
{
    const cn_effect_pack *one = &f->tile->one;
    double grad[CN_APPEARANCE_MAX], m[CN_APPEARANCE_MAX] = { 0 }, v[CN_APPEARANCE_MAX] = { 0 };
    double least = INFINITY;
    *best = f->row;
    for (int step = 1; step <= STEPS + 1; step++) {
        if (cn_stopping(f->ctx))
            return cn_fail(CN_ERR_INTERRUPTED, "stopped while fitting an appearance; run the same command again");
        double error;
        CN_TRY(measure(f, grad, &error));
        error += add_prior(f, grad);
        if (!isfinite(error)) break;
        if (error < least) least = error, *best = f->row;
        const double rate = RATE * pow(0.1, (double)step / STEPS) * sqrt(1 - pow(0.99, step)) / (1 - pow(0.9, step));
        for (size_t i = 0; i < one->n_photo; i++) {
            m[i] = 0.9 * m[i] + 0.1 * grad[i];
            v[i] = 0.99 * v[i] + 0.01 * grad[i] * grad[i];
            f->row.row[one->n_constants + i] -= (float)(rate * m[i] / (sqrt(v[i]) + 1e-12));
        }
    }
    return isfinite(least)
               ? CN_OK
               : cn_fail(CN_ERR_DATA,
                         "tile %s: an appearance cannot be fitted: no value is finite; train the tile again",
                         f->tile->id);
}

/* Fits a row to the groups from first to end, starting from a given row. */
static cn_status fit_groups(fit *f, uint32_t first, uint32_t end, const cn_appearance *start, cn_appearance *fitted)
{
    f->first = first;
    f->end = end;
    f->row = *start;
    CN_TRY(choose_start(f));
    return descend(f, fitted);
}

/* Sets each effect's part of the row to so many quarters of the way from start to fitted. */
static void part_way(const fit *f, const cn_appearance *start, const cn_appearance *fitted, const int *quarters,
                     cn_appearance *row)
{
    const cn_effect_pack *one = &f->tile->one;
    *row = *start;
    for (uint32_t e = 0; e < one->n_on; e++)
        for (uint32_t c = 0; c < one->on[e].effect->photo_params; c++) {
            const size_t i = one->n_constants + one->on[e].photo + c;
            row->row[i] += 0.25f * (float)quarters[e] * (fitted->row[i] - start->row[i]);
        }
}

/* Mean squared error of each half, with so much of the row that was fitted to the other half. */
static cn_status error_beside(fit *f, const cn_appearance *start, const cn_appearance fitted[2], const int *quarters,
                              double *error)
{
    double half_error, grad[CN_APPEARANCE_MAX];
    *error = 0;
    const uint32_t half = f->n_groups / 2;
    for (int k = 0; k < 2; k++) {
        f->first = k ? 0 : half;
        f->end = k ? half : f->n_groups;
        part_way(f, start, &fitted[k], quarters, &f->row);
        CN_TRY(measure(f, grad, &half_error));
        *error += half_error / 2;
    }
    return CN_OK;
}

/* How many quarters of an effect's part may be taken over. A background is left to the tests: often one half alone
 * shows it. */
static int most_quarters(const fit *f, uint32_t effect, const cn_appearance *start, const cn_appearance fitted[2])
{
    const cn_effect_step *on = &f->tile->one.on[effect];
    const size_t at = f->tile->one.n_constants + on->photo;
    const float *const rows[2] = { fitted[0].row + at, fitted[1].row + at };
    if (on->effect->background) return 4;
    return (int)lround(
        4 * cn_fit_agreement(on->effect->photo_params, start->row + at, rows, f->prior.precision + on->photo));
}

/* Chooses how much of each effect's part is taken over. Goes over the effects twice. */
static cn_status choose_parts(fit *f, const cn_appearance *start, int *quarters)
{
    const cn_effect_pack *one = &f->tile->one;
    cn_appearance fitted[2];
    for (int k = 0; k < 2; k++) {
        const uint32_t half = f->n_groups / 2;
        CN_TRY(fit_groups(f, k ? half : 0, k ? f->n_groups : half, start, &fitted[k]));
    }
    for (int round = 0; round < 2; round++)
        for (uint32_t e = 0; e < one->n_on; e++) {
            double least = INFINITY;
            if (!one->on[e].effect->photo_params) continue;
            int best = 0;
            const int most = most_quarters(f, e, start, fitted);
            for (int q = 0; q <= most; q++) {
                quarters[e] = q;
                double error;
                CN_TRY(error_beside(f, start, fitted, quarters, &error));
                if (isfinite(error) && error < (q && !best ? (1 - PAYS) * least : least)) least = error, best = q;
            }
            quarters[e] = best;
        }
    int whole[CN_MAX_EFFECTS];
    double of_parts, of_whole;
    for (uint32_t e = 0; e < CN_MAX_EFFECTS; e++)
        whole[e] = 4;
    CN_TRY(error_beside(f, start, fitted, quarters, &of_parts));
    CN_TRY(error_beside(f, start, fitted, whole, &of_whole));
    if (of_whole < WHOLE * of_parts) memcpy(quarters, whole, sizeof whole);
    return CN_OK;
}

/* Counts the rays with a weight in a half. */
static uint32_t kept_in(const fit *f, uint32_t first, uint32_t end)
{
    uint32_t kept = 0;
    for (uint32_t g = first; g < end; g++)
        for (uint32_t i = 0; i < CN_GROUP; i++)
            kept += g * (size_t)CN_GROUP + i < f->n && f->groups[g].target[4 * (size_t)i + 3] > 0;
    return kept;
}

/* Root mean square error of the last pass. */
static double plain_error(const fit *f)
{
    double sum = 0;
    for (uint32_t g = 0; g < f->n_groups; g++)
        for (uint32_t i = 0; i < CN_GROUP; i++)
            sum += f->groups[g].given[i] > 0 ? (double)f->groups[g].error[i] : 0;
    return sqrt(sum / (3.0 * (double)f->n_kept));
}

/* Fits to all rays, and takes over as much as the tests on the halves allow. There is no test when a half has too few
 * rays. */
static cn_status fit_all(fit *f, cn_appearance *appearance, double *rmse)
{
    cn_appearance start = *appearance, fitted;
    int quarters[CN_MAX_EFFECTS];
    double error, grad[CN_APPEARANCE_MAX];
    for (uint32_t e = 0; e < CN_MAX_EFFECTS; e++)
        quarters[e] = 4;
    /* Outliers can be told only near the right light, so this runs twice. */
    for (int round = 0; round < 2; round++) {
        f->row = round ? fitted : start;
        f->first = 0;
        f->end = f->n_groups;
        f->outlier = 1;
        CN_TRY(measure(f, grad, &error));
        CN_TRY(find_outlier(f));
        CN_TRY(fit_groups(f, 0, f->n_groups, &start, &fitted));
    }
    if (f->new_light) cn_fit_expect_background(f->tile, f->start_error, &start);
    const uint32_t half = f->n_groups / 2;
    if (kept_in(f, 0, half) >= MIN_RAYS / 2 && kept_in(f, half, f->n_groups) >= MIN_RAYS / 2)
        CN_TRY(choose_parts(f, &start, quarters));
    part_way(f, &start, &fitted, quarters, &f->row);
    f->first = 0;
    f->end = f->n_groups;
    CN_TRY(measure(f, grad, &error));
    *rmse = plain_error(f);
    *appearance = f->row;
    return CN_OK;
}

static cn_status gather(fit *f)
{
    static const cn_op op = { .kind = CN_OP_RAYS, .item = gather_slot };
    const cn_chain chain = { &op, 1, CN_SLOTS, f };
    CN_TRY(cn_device_run(f->ctx, &chain, 1));
    for (uint32_t g = 0; g < f->n_groups; g++)
        for (uint32_t i = 0; i < CN_GROUP; i++) {
            f->groups[g].error[i] = 0;
            f->groups[g].given[i] = g * (size_t)CN_GROUP + i < f->n ? f->groups[g].target[4 * (size_t)i + 3] : 0;
            f->n_open += f->groups[g].given[i] > 0 && f->groups[g].span[i].total < OPEN;
        }
    for (int s = 0; s < CN_SLOTS; s++)
        if (f->status[s] != CN_OK) return cn_fail(f->status[s], "out of memory while fitting an appearance");
    f->n_kept = kept_in(f, 0, f->n_groups);
    return f->n_kept >= MIN_RAYS
               ? CN_OK
               : cn_fail(CN_ERR_DATA, "tile %s sees too little of the photo to fit an appearance (%llu rays)",
                         f->tile->id, (unsigned long long)f->n_kept);
}

cn_status cn_fit_appearance(const cn_context *ctx, const cn_tile *tile, const cn_lit_rays *lit,
                            cn_appearance *appearance, double *rmse)
{
    const cn_ray_list *rays = &lit->rays;
    const size_t used = rays->n < MAX_RAYS ? rays->n : MAX_RAYS;
    fit f = { .ctx = ctx,
              .tile = tile,
              .kernel = cn_device_kernel(ctx, false),
              .n = used,
              .n_given = rays->n,
              .origin = rays->origin_m,
              .direction = rays->direction,
              .target = lit->target,
              .new_light = lit->new_light,
              .n_groups = (uint32_t)((used + CN_GROUP - 1) / CN_GROUP),
              .row = *appearance,
              .grad_size = tile->one.n_photo + tile->one.n_shared };
    if (appearance->n != tile->one.n_constants + tile->one.n_photo)
        return cn_fail(CN_ERR_USAGE, "the appearance was made for another tile than %s", tile->id);
    cn_arena counter;
    cn_arena_count(&counter);
    carve(&f, &counter, cn_pool_threads(ctx->pool));
    CN_TRY(cn_device_arena_init(ctx, &f.arena, counter.used));
    carve(&f, &f.arena, cn_pool_threads(ctx->pool));
    cn_status status = gather(&f);
    if (status == CN_OK) {
        f.prior = cn_fit_prior_of(tile, (double)f.n_open / (double)f.n_kept);
        status = fit_all(&f, appearance, rmse);
    }
    for (uint32_t g = 0; g < f.n_groups; g++)
        free(f.groups[g].geo), free(f.groups[g].weight), free(f.groups[g].live_ray);
    cn_device_arena_deinit(ctx, &f.arena);
    return status;
}
