#include "splat/fit.h"

#include "base/clock.h"
#include "base/rng.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Adam's steps, at the start; they fall to LAST_RATE of that. Places move by a part of the Gaussian's own size, so that
 * near and far ones learn alike. */
#define RATE_CENTRE 0.04f
#define RATE_SCALE 0.03f
#define RATE_ROTATION 0.02f
#define RATE_OPACITY 0.08f
#define RATE_COLOUR 0.02f
#define RATE_HARMONICS 0.004f
#define LAST_RATE 0.05f
#define MOMENT 0.9f
#define SQUARES 0.99f
#define TINY 1e-8f
#define MOST_LOGIT 8.0f
#define LEAST_WIDTH 0.4f /* standard deviation along the surface, by the pixel's footprint */

#define LEAST_WEIGHT 0.1f /* pixels' worth in all pictures of a round, below which a Gaussian goes */
#define ADDED_WIDTH 0.35  /* standard deviation of an added Gaussian, by the spacing of the seeds there */
#define LAST_ADDED 0.6    /* part of the rounds after which none is added */

typedef struct fit {
    cn_splat_set *set;
    const cn_context *ctx;
    const cn_targets *targets;
    const cn_splat_options *options;
    cn_splat_report *report;
    cn_raster raster;
    cn_splat_camera camera; /* of the step's picture */
    float *moments, *squares, *weights, rates[CN_ROW_MOST];
    uint16_t *steps;  /* of each Gaussian */
    float *footprint; /* of each Gaussian: width in metres of a pixel there, in the picture nearest to it */
    double *errors;   /* of each target, in the round */
    uint32_t *order, round, length;
    float near_m;
    double started;
} fit;

/* ---- one step ---- */

/* Moves a row by Adam's rule. */
static void move(fit *f, uint32_t s, const float *gradient)
{
    float *row = f->set->rows + (size_t)s * f->length, *m = f->moments + (size_t)s * f->length;
    float *v = f->squares + (size_t)s * f->length;
    f->steps[s] += f->steps[s] < UINT16_MAX;
    const float t = f->steps[s], first = 1 / (1 - powf(MOMENT, t)), second = 1 / (1 - powf(SQUARES, t));
    const float size = expf((row[CN_ROW_SCALE] + row[CN_ROW_SCALE + 1] + row[CN_ROW_SCALE + 2]) / 3);
    for (uint32_t k = 0; k < f->length; k++) {
        m[k] = MOMENT * m[k] + (1 - MOMENT) * gradient[k];
        v[k] = SQUARES * v[k] + (1 - SQUARES) * gradient[k] * gradient[k];
        const float rate = f->rates[k] * (k < CN_ROW_SCALE ? size : 1);
        row[k] -= rate * first * m[k] / (sqrtf(second * v[k]) + TINY);
    }
    row[CN_ROW_OPACITY] = fminf(fmaxf(row[CN_ROW_OPACITY], -MOST_LOGIT), MOST_LOGIT);
    /* What is narrower than a pixel cannot be told from these pictures, and leaves gaps in closer ones (Yu et al. 2024,
     * "Mip-Splatting"). The third axis is that across the surface. */
    f->footprint[s] = fminf(f->footprint[s], f->raster.flats[s].depth / f->camera.f[0]);
    const float least = logf(LEAST_WIDTH * f->footprint[s]);
    for (int k = 0; k < 2; k++)
        row[CN_ROW_SCALE + k] = fmaxf(row[CN_ROW_SCALE + k], least);
}

static void move_chunk(void *user, size_t i, unsigned worker)
{
    (void)worker;
    fit *f = user;
    const cn_raster *r = &f->raster;
    const size_t first = (size_t)r->n_visible * i / CN_RASTER_CHUNKS;
    const size_t end = (size_t)r->n_visible * (i + 1) / CN_RASTER_CHUNKS;
    for (size_t k = first; k < end; k++) {
        const uint32_t s = r->visible[k];
        float sums[CN_SPLAT_SUMS], gradient[CN_ROW_MOST], all = 0;
        cn_raster_sums(r, s, sums);
        if (!(sums[CN_SUM_WEIGHT] > 0)) continue; /* hidden */
        f->weights[s] += sums[CN_SUM_WEIGHT];
        cn_splat_project_back(&f->camera, f->set->rows + (size_t)s * f->length, f->set->degree, &r->flats[s], sums,
                              gradient);
        for (uint32_t c = 0; c < f->length; c++)
            all += gradient[c];
        if (isfinite(all)) move(f, s, gradient);
    }
}

static cn_status step(fit *f, uint32_t target)
{
    const cn_target *t = &f->targets->list[target];
    const cn_splat_rows rows = { f->set->rows, f->set->n, f->set->degree };
    f->camera = cn_splat_camera_of(&t->camera, &t->view, f->set->origin, f->near_m);
    CN_TRY(cn_raster_bin(&f->raster, &f->camera, &rows));
    f->errors[target] = cn_raster_step(&f->raster, &f->camera, f->targets->pictures + t->pixels);
    cn_pool_run(f->ctx->pool, CN_RASTER_CHUNKS, move_chunk, f);
    return CN_OK;
}

static void set_rates(fit *f, double done)
{
    const float fall = LAST_RATE + (1 - LAST_RATE) * 0.5f * (1 + cosf((float)(3.14159265 * done)));
    for (uint32_t k = 0; k < f->length; k++) {
        const float rate = k < CN_ROW_SCALE         ? RATE_CENTRE
                           : k < CN_ROW_ROTATION    ? RATE_SCALE
                           : k < CN_ROW_OPACITY     ? RATE_ROTATION
                           : k < CN_ROW_COLOUR      ? RATE_OPACITY
                           : k < CN_ROW_COLOUR + 3u ? RATE_COLOUR
                                                    : RATE_HARMONICS;
        f->rates[k] = fall * rate;
    }
}

/* ---- between rounds ---- */

/* Whether a Gaussian contributes, and stays out of the photos' way. weighed: the whole round tells what it contributes.
 */
static bool is_wanted(const fit *f, size_t s, bool weighed)
{
    const float *row = f->set->rows + s * f->length, *centre = row + CN_ROW_CENTRE, *scale = row + CN_ROW_SCALE;
    const double at[3] = { (double)centre[0], (double)centre[1], (double)centre[2] };
    const double width_m = exp((double)fmaxf(scale[0], fmaxf(scale[1], scale[2])));
    return (!weighed || f->weights[s] >= LEAST_WEIGHT) && !cn_seed_is_in_clear(f->set, f->targets, at, width_m);
}

/* Removes those that are not wanted. Returns how many. */
static size_t prune(fit *f, bool weighed)
{
    cn_splat_set *set = f->set;
    const size_t length = f->length, before = set->n;
    size_t kept = 0;
    for (size_t s = 0; s < before; s++) {
        if (!is_wanted(f, s, weighed)) continue;
        if (kept != s) {
            memcpy(set->rows + kept * length, set->rows + s * length, length * sizeof(float));
            memcpy(f->moments + kept * length, f->moments + s * length, length * sizeof(float));
            memcpy(f->squares + kept * length, f->squares + s * length, length * sizeof(float));
            f->steps[kept] = f->steps[s];
            f->footprint[kept] = f->footprint[s];
        }
        kept++;
    }
    set->n = kept;
    return before - kept;
}

static void add_at(fit *f, uint32_t target, uint32_t pixel)
{
    cn_splat_set *set = f->set;
    const size_t at = set->n * f->length;
    cn_seed seed;
    if (set->n == set->room || !cn_seed_at(set, f->targets, target, pixel, &seed)) return;
    const double width_m = ADDED_WIDTH * set->spacing * seed.footprint_m;
    if (cn_seed_is_in_clear(set, f->targets, seed.xyz, width_m)) return;
    cn_seed_row(set, f->targets, &seed, width_m, set->rows + at);
    memset(f->moments + at, 0, f->length * sizeof(float));
    memset(f->squares + at, 0, f->length * sizeof(float));
    f->footprint[set->n] = INFINITY;
    f->steps[set->n++] = 0;
}

/* The squared difference of a pixel's colour. */
static float error_of(const fit *f, const cn_target *t, const float *rgb, uint32_t pixel)
{
    const uint32_t x = pixel % t->camera.width, y = pixel / t->camera.width;
    const size_t tile = (size_t)(y / CN_SPLAT_TILE) * f->raster.tiles_x + x / CN_SPLAT_TILE;
    const uint8_t *wanted = f->targets->pictures + t->pixels + tile * 4 * CN_SPLAT_TILE_PIXELS +
                            y % CN_SPLAT_TILE * CN_SPLAT_TILE + x % CN_SPLAT_TILE;
    float sum = 0;
    for (size_t k = 0; k < 3; k++) {
        const float off = rgb[3 * (size_t)pixel + k] - (float)wanted[k * CN_SPLAT_TILE_PIXELS] / 255;
        sum += off * off;
    }
    return sum;
}

/* Puts n Gaussians into a picture, more where it differs more: at even steps of the summed differences. */
static cn_status add_in(fit *f, uint32_t target, size_t n)
{
    const cn_target *t = &f->targets->list[target];
    const uint32_t pixels = t->camera.width * t->camera.height;
    const cn_splat_rows rows = { f->set->rows, f->set->n, f->set->degree };
    float *rgb = malloc((size_t)pixels * 3 * sizeof *rgb);
    double sum = 0, at = 0;
    f->camera = cn_splat_camera_of(&t->camera, &t->view, f->set->origin, f->near_m);
    cn_status status = rgb ? cn_raster_bin(&f->raster, &f->camera, &rows)
                           : cn_fail(CN_ERR_NOMEM, "out of memory for a picture of splats");
    if (status == CN_OK) {
        cn_raster_draw(&f->raster, &f->camera, rgb, NULL);
        for (uint32_t i = 0; i < pixels; i++)
            sum += (double)error_of(f, t, rgb, i);
        const double stride = sum / (double)n;
        double next = stride * (double)cn_rng_float(f->round, 2, target);
        for (uint32_t i = 0; i < pixels && sum > 0; i++) {
            at += (double)error_of(f, t, rgb, i);
            if (at < next) continue;
            add_at(f, target, i);
            while (next <= at) /* one Gaussian a pixel */
                next += stride;
        }
    }
    free(rgb);
    return status;
}

static cn_status add(fit *f)
{
    const size_t room = f->set->room - f->set->n;
    double sum = 0;
    for (uint32_t i = 0; i < f->targets->n; i++)
        sum += f->errors[i];
    for (uint32_t i = 0; i < f->targets->n && sum > 0; i++) {
        const size_t n = (size_t)((double)room * f->errors[i] / sum);
        if (n) CN_TRY(add_in(f, i, n));
    }
    return CN_OK;
}

/* ---- rounds ---- */

static double psnr_of(const fit *f)
{
    double sum = 0, pixels = 0;
    for (uint32_t i = 0; i < f->targets->n; i++) {
        sum += f->errors[i];
        pixels += (double)f->targets->list[i].camera.width * f->targets->list[i].camera.height;
    }
    return -10 * log10(fmax(sum / (3 * pixels), 1e-10));
}

/* Another order each round. */
static void shuffle(fit *f)
{
    for (uint32_t i = f->targets->n; i > 1; i--) {
        const uint32_t other = cn_rng_below(f->round, 1, i, i), kept = f->order[i - 1];
        f->order[i - 1] = f->order[other];
        f->order[other] = kept;
    }
}

static void tell(const fit *f, uint32_t step, double part)
{
    char detail[64];
    const double elapsed = cn_now_s() - f->started;
    const double all = (double)f->options->rounds * f->targets->n;
    snprintf(detail, sizeof detail, "PSNR %.2f dB, %.2f M splats", f->round ? f->report->psnr : 0.0,
             1e-6 * (double)f->set->n);
    const cn_progress_report report = { "export",
                                        "splats: fit",
                                        step,
                                        all,
                                        elapsed,
                                        part > 0 ? elapsed / part * (1 - part) : -1,
                                        f->round ? detail : NULL };
    cn_progress(f->ctx, &report);
}

/* How much of the fit is done: rounds, or seconds, whichever ends first. */
static double part_done(const fit *f, uint32_t step)
{
    const double by_rounds = (double)step / ((double)f->options->rounds * f->targets->n);
    return f->options->limit_s > 0 ? fmax(by_rounds, (cn_now_s() - f->started) / f->options->limit_s) : by_rounds;
}

static cn_status run(fit *f)
{
    const uint32_t n = f->targets->n;
    uint32_t steps = 0;
    for (f->round = 0; f->round < f->options->rounds; f->round++) {
        shuffle(f);
        memset(f->weights, 0, f->set->room * sizeof *f->weights);
        for (uint32_t i = 0; i < n; i++, steps++) {
            const double part = part_done(f, steps);
            if (part >= 1) break;
            if (cn_stopping(f->ctx)) return cn_fail(CN_ERR_INTERRUPTED, "stopped while fitting splats");
            set_rates(f, part);
            CN_TRY(step(f, f->order[i]));
            tell(f, steps + 1, part);
        }
        f->report->n_steps = steps;
        const double part = part_done(f, steps);
        if (part >= 1 && steps < (f->round + 1) * n) { /* the round was cut */
            f->report->n_pruned += prune(f, false);
            break;
        }
        f->report->psnr = psnr_of(f);
        f->report->n_pruned += prune(f, true);
        if (part < LAST_ADDED) CN_TRY(add(f));
    }
    return CN_OK;
}

/* Distance from which a picture shows Gaussians: nearer than all that the photos show, however far the scene reaches.
 */
static float near_of(const cn_splat_set *set, const cn_targets *targets)
{
    const double near_m = 1e-3 * set->far_m, clear_m = targets->clear.near_m;
    return (float)(clear_m > 0 ? fmin(near_m, 0.5 * clear_m) : near_m);
}

cn_status cn_splat_fit(cn_splat_set *set, const cn_context *ctx, const cn_targets *targets,
                       const cn_splat_options *options, cn_splat_report *report)
{
    fit f = { .set = set,
              .ctx = ctx,
              .targets = targets,
              .options = options,
              .report = report,
              .length = cn_row_length(set->degree),
              .near_m = near_of(set, targets),
              .started = cn_now_s() };
    f.moments = calloc(set->room, f.length * sizeof *f.moments);
    f.squares = calloc(set->room, f.length * sizeof *f.squares);
    f.weights = calloc(set->room, sizeof *f.weights);
    f.steps = calloc(set->room, sizeof *f.steps);
    f.footprint = malloc(set->room * sizeof *f.footprint);
    f.errors = calloc(targets->n, sizeof *f.errors);
    f.order = calloc(targets->n, sizeof *f.order);
    cn_status status = f.moments && f.squares && f.weights && f.steps && f.footprint && f.errors && f.order
                           ? cn_raster_init(&f.raster, ctx->pool, cn_splat_kernel_best(), set->room)
                           : cn_fail(CN_ERR_NOMEM, "out of memory for %zu splats; give a smaller --budget", set->room);
    for (size_t i = 0; status == CN_OK && i < set->n; i++)
        f.footprint[i] = INFINITY;
    for (uint32_t i = 0; status == CN_OK && i < targets->n; i++)
        f.order[i] = i;
    if (status == CN_OK) status = run(&f);
    report->fit_s = cn_now_s() - f.started;
    cn_raster_deinit(&f.raster);
    free(f.moments);
    free(f.squares);
    free(f.weights);
    free(f.steps);
    free(f.footprint);
    free(f.errors);
    free(f.order);
    return status;
}
