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

/* Sums of the normal equations of distance = scale * value + shift. */
typedef struct line_fit {
    double n, v, vv, d, vd, dd;
} line_fit;

static bool solve(const line_fit *f, float *scale, float *shift)
{
    const double det = f->n * f->vv - f->v * f->v;
    if (f->n < LEAST_OF_PHOTO || !(det > 1e-9 * f->n * f->vv)) return false;
    *scale = (float)((f->n * f->vd - f->v * f->d) / det);
    *shift = (float)((f->vv * f->d - f->v * f->vd) / det);
    const double spread = f->n * f->dd - f->d * f->d, together = f->n * f->vd - f->v * f->d;
    return *scale > 0 && together * together >= fmax(LEAST_EXPLAINED, EXPLAINED_BY_CHANCE / f->n) * det * spread;
}

static cn_status fit_lines(cn_sampler *s, const cn_context *ctx, const char *tile)
{
    line_fit *fit = calloc(s->n_photos + 1u, sizeof *fit);
    cn_status status = fit ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory at the start of tile %s", tile);
    for (uint32_t i = 0; i < s->n_sparse && status == CN_OK; i++) {
        float value;
        double d;
        status = compare(s, &s->sparse[i], &value, &d);
        if (status != CN_OK || !(value > 0)) continue;
        line_fit *f = &fit[s->sparse[i].photo];
        const double v = (double)value;
        *f = (line_fit){ f->n + 1, f->v + v, f->vv + v * v, f->d + d, f->vd + v * d, f->dd + d * d };
    }
    uint32_t left_out = 0;
    for (uint32_t i = 0; i < s->n_photos && status == CN_OK; i++) {
        cn_train_photo *p = &s->photos[i];
        if (!(p->depth_scale > 0) || solve(&fit[i], &p->depth_scale, &p->depth_shift)) continue;
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
    const cn_stereo_input photos = { input->scene, input->pixels, tile->photos, tile->n_photos, tile->id };
    cn_stereo_options options = cn_stereo_options_default();
    options.seed = s->seed;
    if (!s->stereo) {
        s->stereo = calloc(s->n_photos + 1u, sizeof *s->stereo);
        if (!s->stereo) return cn_fail(CN_ERR_NOMEM, "out of memory at the start of tile %s", tile->id);
        CN_TRY(cn_stereo_run(ctx, &photos, &options, s->stereo));
    }
    uint64_t known = 0, pixels = 0;
    s->n_depth = 0;
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
