#include "train/reactivation.h"

#include "base/contraction.h"
#include "effect/sky_hints.h"

#include <math.h>

enum { MAX_RAYS = 64, MAX_CELLS = 512 }; /* rays of a step; cells of a ray */
#define FROM 0.1                         /* fraction of the schedule; before, there is fog everywhere */
/* It ends where what is known of the photos leads no more (sampler.c), if that is earlier. Not ended there, a synthetic
 * city of 224 photos in four lights loses 0.4 dB, and its median error of depth is 1.1 % in place of 0.8 %. */
#define TO 0.9
/* Density that an opened cell starts with. It is empty again after about twenty visits. Not measured apart. */
#define OPENED 0.5f
#define PACE 1.0078125f
#define HORIZON 0.0f /* z of a direction; above it a photo may show sky, where an effect has one */
#define NOTHING 0.5f /* transmittance at a ray's end */
/* Fractions of the schedule in which cells are filled again, and its fewest steps: a short one needs the fog gone soon.
 * Found on entry-P10, where the shaft of a column had gone, and castle, where cells that fill all at once lengthen the
 * march's steps and cost 0.2 to 1.0 dB. tests/bench/experiments.md has the figures. */
#define REFILL_FROM 0.3
#define REFILL_TO 0.6
enum { REFILL_STEPS = 3000, REFILL_ROUNDS = 2 };
/* Fraction of the schedule from which on corners are filled, and how often. Found on kitti; tests/bench/experiments.md
 * has six sets. */
#define CLOSE_FROM 0.8
enum { CLOSE_EVERY = 32 };

void cn_reactivation_carve(cn_reactivation *r, cn_arena *arena)
{
    r->missing = CN_ARENA_NEW(arena, uint8_t, CN_MAX_RAYS);
}

void cn_reactivation_note(cn_reactivation *r, const cn_batch *batch, uint32_t ray, float after, bool sky)
{
    const bool shows_none = batch->sky_hint && batch->sky_hint[ray] == CN_SKY_NONE,
               may_be_sky = sky && !shows_none && batch->dirs[3 * (size_t)ray + 2] > HORIZON;
    r->missing[ray] = after > NOTHING && !may_be_sky;
}

static uint32_t cell_at(const cn_box_ray *ray, float at, uint32_t c[3])
{
    float x[3], m = 1;
    for (int a = 0; a < 3; a++) {
        x[a] = ray->origin[a] + at * ray->dir[a];
        m = fmaxf(m, fabsf(x[a]));
    }
    for (int a = 0; a < 3; a++) {
        const float scaled = (x[a] * cn_contraction_float(m) + 2) * (CN_OCC_RES / 4.0f);
        c[a] = (uint32_t)fminf(fmaxf(scaled, 0), CN_OCC_RES - 1);
    }
    return c[0] + CN_OCC_RES * (c[1] + CN_OCC_RES * c[2]);
}

static bool is_full(const cn_occupancy *occ, uint32_t cell)
{
    return occ->bits[cell >> 5] >> (cell & 31) & 1;
}

/* An empty cell inside a hole of a surface has more than one full neighbour. One in front of a surface has one. */
static bool in_a_gap(const cn_occupancy *occ, uint32_t cell, const uint32_t c[3])
{
    static const uint32_t stride[3] = { 1, CN_OCC_RES, CN_OCC_RES * CN_OCC_RES };
    int full = 0;
    for (int a = 0; a < 3; a++) {
        full += c[a] > 0 && is_full(occ, cell - stride[a]);
        full += c[a] < CN_OCC_RES - 1 && is_full(occ, cell + stride[a]);
    }
    return full > 1;
}

/* First finds all cells of a ray, then opens them, so that no opened cell counts as a full neighbour. */
static void open_along(cn_occupancy *occ, const cn_box *box, const cn_box_ray *ray)
{
    uint32_t found[MAX_CELLS], n = 0, last = UINT32_MAX, c[3];
    for (float at = box->near_m; at < box->far_m && n < MAX_CELLS; at *= PACE) {
        const uint32_t cell = cell_at(ray, at, c);
        if (cell == last) continue;
        last = cell;
        if (occ->seen[cell] >= 0 && !is_full(occ, cell) && in_a_gap(occ, cell, c)) found[n++] = cell;
    }
    for (uint32_t i = 0; i < n; i++) {
        occ->seen[found[i]] = OPENED;
        occ->bits[found[i] >> 5] |= 1u << (found[i] & 31);
    }
}

void cn_reactivation_open(const cn_reactivation *r, const cn_batch *batch, const cn_box *box, cn_step_at at,
                          cn_occupancy *occ)
{
    if (!cn_reactivation_is_on(at)) return;
    for (uint32_t i = 0, done = 0; i < batch->n_rays && done < MAX_RAYS; i++) {
        if (!r->missing[i]) continue;
        open_along(occ, box, &batch->rays[i].box_ray);
        done++;
    }
}

bool cn_reactivation_refills(cn_step_at at, uint32_t *part)
{
    const uint32_t times = REFILL_ROUNDS * CN_REFILL_PARTS, first = (uint32_t)(REFILL_FROM * at.steps),
                   every = (uint32_t)((REFILL_TO - REFILL_FROM) * at.steps / times);
    if (at.steps < REFILL_STEPS || at.step < first || (at.step - first) % every) return false;
    const uint32_t time = (at.step - first) / every;
    *part = time % CN_REFILL_PARTS;
    return time < times;
}

bool cn_reactivation_closes(cn_step_at at)
{
    return at.step % CLOSE_EVERY == 0 && cn_step_progress(at) >= CLOSE_FROM;
}

bool cn_reactivation_is_on(cn_step_at at)
{
    const double progress = cn_step_progress(at);
    return progress >= FROM && progress <= fmin(TO, cn_lead_end(at.steps));
}

uint32_t cn_reactivation_steps(const cn_box *box, float *at)
{
    uint32_t n = 0;
    for (float t = box->near_m; t < box->far_m && n < CN_REACTIVATION_STEPS; t *= PACE)
        at[n++] = t;
    return n;
}
