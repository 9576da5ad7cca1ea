/* Depth maps beside the photos, as distances along rays. */
#include "train/sampler.h"
#include "effect/sky_hints.h"

#include <math.h>
#include <stdlib.h>

enum {
    LEAST_SAMPLES = 32, /* the fewest samples of a tile, for a factor */
    LEAST_OF_PHOTO = 8  /* the fewest samples of a photo, for a scale and a shift */
};
/* Where stereo agrees for a smaller part of the pixels, what it gives is chance: the poses are inexact, or there is no
 * texture. Of lund, whose poses rest on 250 points a photo, it is 0.05, and depths cost 0.25 dB; of six other sets 0.20
 * (sacre-coeur), 0.33 (brighton) and more. */
#define LEAST_KNOWN 0.12
/* A map whose values explain less of the distances of its photo's sparse points is left out: it would hold matter where
 * none is. Of few points chance explains more, so these have to agree better. Not measured apart. */
#define LEAST_EXPLAINED 0.25
#define EXPLAINED_BY_CHANCE 6.0 /* over the number of points */
#define FAR_OFF 1.05            /* a factor that differs from 1 by more is logged */

/* Cosine between a ray and its camera's axis. A photo of all directions has none: its depths are along the rays. */
static double cosine(const cn_ray_generator *g, const cn_ray *ray)
{
    double sum = 0;
    if (g->camera.lens == CN_LENS_EQUIRECTANGULAR) return 1;
    for (int a = 0; a < 3; a++)
        sum += g->world_from_cam[3 * a + 2] * (double)ray->dir[a];
    return sum;
}

/* Compares a sparse depth sample with the depth map at its pixel. Gives the sample's distance in the way that the map
 * measures (along the ray or the axis), and the map's value. False where the map has no value. */
static cn_status compare(const cn_sampler *s, const cn_sparse_sample *sample, float *value, double *distance_m)
{
    const cn_train_photo *p = &s->photos[sample->photo];
    cn_ray ray;
    CN_TRY(cn_pixel_store_gather_depth(s->pixels, 1, &p->store, &sample->x, &sample->y, value));
    if (!cn_ray_generator_ray(&p->generator, sample->x + 0.5, sample->y + 0.5, &ray)) *value = 0;
    if (*value > 0) *distance_m = (double)sample->distance_m * (s->depth_along_ray ? 1 : cosine(&p->generator, &ray));
    return CN_OK;
}

static int by_size(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static cn_status fit_factor(cn_sampler *s, const cn_context *ctx, const char *tile)
{
    double *ratio = malloc((s->n_sparse + 1u) * sizeof *ratio), factor = 1;
    uint32_t n = 0;
    cn_status status = ratio ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory at the start of tile %s", tile);
    for (uint32_t i = 0; i < s->n_sparse && status == CN_OK; i++) {
        float value;
        double distance_m;
        status = compare(s, &s->sparse[i], &value, &distance_m);
        if (status == CN_OK && value > 0) ratio[n++] = distance_m / (double)value;
    }
    if (status == CN_OK && n >= LEAST_SAMPLES) {
        qsort(ratio, n, sizeof *ratio, by_size);
        factor = ratio[n / 2];
    }
    free(ratio);
    for (uint32_t i = 0; i < s->n_photos; i++)
        if (s->photos[i].depth_scale > 0) s->photos[i].depth_scale = (float)factor;
    if (factor > FAR_OFF || factor < 1 / FAR_OFF)
        cn_log(ctx, CN_LOG_WARN, "tile %s: its depth maps are scaled by %.4g, to agree with %u sparse points", tile,
               factor, n);
    return status;
}

/* A sparse point that a map has a value for. */
typedef struct pair {
    uint32_t photo;
    double value, distance;
} pair;

/* Sums of the normal equations of a line through values and distances, and that line: value = slope * distance +
 * offset. */
typedef struct line_fit {
    double n, v, vv, d, vd, dd;
    double slope, offset;
    double errors, points, mean_error; /* of a pass: sum and number of the errors; mean of an earlier pass */
} line_fit;

static void add(line_fit *f, const pair *at, double weight)
{
    const double v = at->value, d = at->distance;
    f->n += weight;
    f->v += weight * v;
    f->vv += weight * v * v;
    f->d += weight * d;
    f->vd += weight * v * d;
    f->dd += weight * d * d;
}

/* The line is that of values over distances, for the distances are exact and the values are not. A line of distances
 * over values is the flatter the more noise the values have: half as steep on one photo of the synthetic city. */
static bool solve(line_fit *f)
{
    const double spread = f->n * f->dd - f->d * f->d, together = f->n * f->vd - f->v * f->d;
    if (!(spread > 1e-9 * f->n * f->dd && together > 0)) return false;
    f->slope = together / spread;
    f->offset = (f->v - f->slope * f->d) / f->n;
    return true;
}

/* The same for sums without weights, where the map is of use. */
static bool solve_first(line_fit *f)
{
    if (f->n < LEAST_OF_PHOTO || !solve(f)) return false;
    const double of_values = f->n * f->vv - f->v * f->v, explained = f->slope * (f->n * f->vd - f->v * f->d);
    return explained >= fmax(LEAST_EXPLAINED, EXPLAINED_BY_CHANCE / f->n) * of_values;
}

/* Where a point lies at the edge of a wall, the map may have the distance of what is behind. So the line becomes first
 * that of the least sum of absolute errors, by reweighted squares; then that of least squares of the points that agree
 * with it, for it is more exact where errors are small. Errors are over the value. */
enum { PASSES = 12, ABSOLUTE_PASSES = 8 };
#define LEAST_ERROR 1e-3
#define AGREES 3.0 /* times the mean error */

static double weight_of(const line_fit *f, const pair *at, int pass, double *error)
{
    const double by_line = f->slope * at->distance + f->offset, size = fmax(by_line, 0.1 * at->value);
    *error = fabs(at->value - by_line) / size;
    if (pass < ABSOLUTE_PASSES) return 1 / (size * size * fmax(*error, LEAST_ERROR));
    return *error < AGREES * fmax(f->mean_error, LEAST_ERROR) ? 1 / (size * size) : 0;
}

static void solve_robust(line_fit *fit, uint32_t n_photos, const pair *pairs, uint32_t n)
{
    for (int pass = 0; pass < PASSES; pass++) {
        for (uint32_t i = 0; i < n_photos; i++)
            fit[i] = (line_fit){ .slope = fit[i].slope, .offset = fit[i].offset, .mean_error = fit[i].mean_error };
        for (uint32_t i = 0; i < n; i++) {
            line_fit *f = &fit[pairs[i].photo];
            double error;
            if (!(f->slope > 0)) continue;
            add(f, &pairs[i], weight_of(f, &pairs[i], pass, &error));
            f->errors += error;
            f->points++;
        }
        for (uint32_t i = 0; i < n_photos; i++) {
            if (fit[i].slope > 0 && !solve(&fit[i])) fit[i].slope = 0;
            if (pass < ABSOLUTE_PASSES) fit[i].mean_error = fit[i].errors / fmax(fit[i].points, 1);
        }
    }
}

static cn_status gather_pairs(const cn_sampler *s, pair *pairs, uint32_t *n)
{
    *n = 0;
    for (uint32_t i = 0; i < s->n_sparse; i++) {
        float value;
        pair *at = &pairs[*n];
        CN_TRY(compare(s, &s->sparse[i], &value, &at->distance));
        if (!(value > 0)) continue;
        at->photo = s->sparse[i].photo;
        at->value = (double)value;
        ++*n;
    }
    return CN_OK;
}

static cn_status fit_lines(cn_sampler *s, const cn_context *ctx, const char *tile)
{
    line_fit *fit = calloc(s->n_photos + 1u, sizeof *fit);
    pair *pairs = malloc((s->n_sparse + 1u) * sizeof *pairs);
    uint32_t n = 0;
    cn_status status = fit && pairs ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory at the start of tile %s", tile);
    if (status == CN_OK) status = gather_pairs(s, pairs, &n);
    for (uint32_t i = 0; i < n && status == CN_OK; i++)
        add(&fit[pairs[i].photo], &pairs[i], 1);
    for (uint32_t i = 0; i < s->n_photos && status == CN_OK; i++)
        if (!solve_first(&fit[i])) fit[i].slope = 0;
    if (status == CN_OK) solve_robust(fit, s->n_photos, pairs, n);
    uint32_t left_out = 0;
    for (uint32_t i = 0; i < s->n_photos && status == CN_OK; i++) {
        cn_train_photo *p = &s->photos[i];
        if (!(p->depth_scale > 0)) continue;
        if (fit[i].slope > 0) {
            p->depth_scale = (float)(1 / fit[i].slope);
            p->depth_shift = (float)(-fit[i].offset / fit[i].slope);
            continue;
        }
        p->depth_scale = p->depth_shift = 0;
        left_out++;
        s->n_depth--;
    }
    if (left_out)
        cn_log(
            ctx, CN_LOG_WARN,
            "tile %s: the depth maps of %u photos are left out: fewer than %d sparse points give their scale, or their "
            "values do not follow the points' distances",
            tile, left_out, LEAST_OF_PHOTO);
    free(pairs);
    free(fit);
    return status;
}

cn_status cn_sampler_fit_depth(cn_sampler *s, const cn_context *ctx, const cn_train_input *input, cn_depth_kind kind)
{
    s->n_depth = 0;
    for (uint32_t i = 0; i < s->n_photos; i++) {
        cn_train_photo *p = &s->photos[i];
        const bool has = cn_pixel_store_has_depth(s->pixels, p->store);
        p->depth_scale = has ? 1 : 0;
        p->depth_shift = 0;
        s->n_depth += has;
    }
    if (!s->n_depth) return CN_OK;
    return kind == CN_DEPTH_CUE ? fit_lines(s, ctx, input->tile->id) : fit_factor(s, ctx, input->tile->id);
}

cn_status cn_sampler_find_stereo(cn_sampler *s, const cn_context *ctx, const cn_train_input *input)
{
    const cn_plan_tile *tile = input->tile;
    const cn_stereo_input photos = {
        .scene = input->scene, .pixels = input->pixels, .views = tile->photos, .n = tile->n_photos, .name = tile->id
    };
    cn_stereo_options options = cn_stereo_options_default();
    options.seed = s->seed;
    if (!s->stereo) {
        s->stereo = calloc(s->n_photos + 1u, sizeof *s->stereo);
        if (!s->stereo) return cn_fail(CN_ERR_NOMEM, "out of memory at the start of tile %s", tile->id);
        CN_TRY(cn_stereo_run(ctx, &photos, &options, s->stereo));
    }
    uint64_t known = 0, pixels = 0;
    s->n_depth = 0;
    s->depth_along_ray = false; /* whatever the photos' own maps are measured along */
    for (uint32_t i = 0; i < s->n_photos; i++) {
        const cn_stereo_map *map = &s->stereo[i];
        const uint64_t n = (uint64_t)map->width * map->height;
        s->photos[i].depth_scale = n ? 1 : 0;
        s->n_depth += n > 0;
        pixels += n;
        for (uint64_t k = 0; k < n; k++)
            known += map->depth_m[k] > 0;
    }
    const double part = pixels ? (double)known / (double)pixels : 0;
    const bool useful = part >= LEAST_KNOWN;
    cn_log(ctx, CN_LOG_INFO, "tile %s: stereo finds depths in %u of %u photos, for %.0f %% of their pixels%s", tile->id,
           s->n_depth, s->n_photos, 100 * part, useful ? "" : "; they are left out, for so few may be chance");
    if (!useful) s->n_depth = 0;
    for (uint32_t i = 0; i < s->n_photos && !useful; i++)
        s->photos[i].depth_scale = 0;
    return CN_OK;
}

void cn_sampler_deinit(cn_sampler *s)
{
    for (uint32_t i = 0; s->stereo && i < s->n_photos; i++)
        cn_stereo_map_deinit(&s->stereo[i]);
    free(s->stereo);
    s->stereo = NULL;
}

/* The depth that stereo found at a pixel of a photo. */
static float stereo_at(const cn_stereo_map *map, cn_pixel_extent size, uint32_t x, uint32_t y)
{
    const uint32_t u = x * map->width / size.width, v = y * map->height / size.height;
    return map->depth_m ? map->depth_m[(size_t)v * map->width + u] : 0;
}

cn_status cn_sampler_read_depth(const cn_sampler *s, uint32_t group, const uint16_t *x, const uint16_t *y, cn_batch *b)
{
    const uint32_t first = group * CN_GROUP;
    uint32_t store[CN_GROUP];
    float value[CN_GROUP];
    for (uint32_t i = 0; i < CN_GROUP; i++)
        store[i] = s->photos[b->ray_photo[first + i]].store;
    if (!s->stereo) CN_TRY(cn_pixel_store_gather_depth(s->pixels, CN_GROUP, store, x, y, value));
    for (uint32_t i = 0; i < CN_GROUP; i++) {
        const uint32_t r = first + i;
        const cn_train_photo *p = &s->photos[b->ray_photo[r]];
        if (s->stereo) value[i] = stereo_at(&s->stereo[b->ray_photo[r]], p->size, x[i], y[i]);
        /* Stereo's windows reach over the edge of a roof into the sky. */
        if (s->stereo && b->sky_hint && b->sky_hint[r] == CN_SKY_SHOWN) value[i] = 0;
        const bool known = value[i] > 0 && p->depth_scale > 0 && b->target[4 * (size_t)r + 3] > 0;
        const double at = (double)(p->depth_scale * value[i] + p->depth_shift);
        b->measured_m[r] =
            known && at > 0 ? (float)(s->depth_along_ray ? at : at / cosine(&p->generator, &b->rays[r])) : 0;
    }
    return CN_OK;
}
