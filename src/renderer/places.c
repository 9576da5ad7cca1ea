/* Short rays through places of the city: the light of the tile that owns each. */
#include "renderer/renderer.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct shading_job {
    cn_renderer *renderer;
    const cn_context *ctx;
    const cn_renderer_light *light;
    const cn_ray_list *rays;
    float *rgba;
    double (*place)[2];
    float *share; /* [rays][parts] */
    cn_union_part parts[CN_UNION_MAX];
    uint32_t which[CN_UNION_MAX], n_parts; /* tiles that may own a place */
    uint32_t *list;                        /* rays that a tile has a share of */
    double (*origin)[3], (*direction)[3], (*range)[2];
    float *one;
} shading_job;

static double find_places(shading_job *j, double middle[2])
{
    const cn_ray_list *r = j->rays;
    double low[2] = { INFINITY, INFINITY }, high[2] = { -INFINITY, -INFINITY };
    for (size_t i = 0; i < r->n; i++)
        for (int k = 0; k < 2; k++) {
            const double t = (j->light->range_m[i][0] + j->light->range_m[i][1]) / 2;
            j->place[i][k] = r->origin_m[i][k] + t * r->direction[i][k];
            low[k] = fmin(low[k], j->place[i][k]);
            high[k] = fmax(high[k], j->place[i][k]);
        }
    for (int k = 0; k < 2; k++)
        middle[k] = (low[k] + high[k]) / 2;
    return hypot(high[0] - low[0], high[1] - low[1]) / 2;
}

/* The nearest tiles to the places' middle; those too far to own any of them are left out. */
static void choose_tiles(shading_job *j, const double middle[2], double radius)
{
    const cn_tile_cache *g = &j->renderer->tiles;
    double nearest = INFINITY;
    for (uint32_t i = 0; i < g->n; i++)
        nearest = fmin(nearest, hypot(g->centres[i][0] - middle[0], g->centres[i][1] - middle[1]));
    for (uint32_t i = 0; i < g->n; i++) {
        const double width = CN_TILE_CACHE_BLEND_WIDTH * g->radii[i];
        const double distance = hypot(g->centres[i][0] - middle[0], g->centres[i][1] - middle[1]);
        if (distance > nearest + 2 * radius + width) continue;
        uint32_t at = j->n_parts < CN_UNION_MAX ? j->n_parts : CN_UNION_MAX - 1;
        cn_union_part part = { .blend_width_m = width };
        memcpy(part.centre_m, g->centres[i], sizeof part.centre_m);
        if (j->n_parts == CN_UNION_MAX) { /* in place of the farthest */
            for (uint32_t p = 0; p < CN_UNION_MAX; p++)
                if (hypot(j->parts[p].centre_m[0] - middle[0], j->parts[p].centre_m[1] - middle[1]) >
                    hypot(j->parts[at].centre_m[0] - middle[0], j->parts[at].centre_m[1] - middle[1]))
                    at = p;
            if (hypot(j->parts[at].centre_m[0] - middle[0], j->parts[at].centre_m[1] - middle[1]) < distance) continue;
        } else {
            j->n_parts++;
        }
        j->parts[at] = part;
        j->which[at] = i;
    }
}

static cn_status add_tile(shading_job *j, uint32_t p)
{
    const cn_tile_cache *g = &j->renderer->tiles;
    const cn_tile *tile;
    cn_render_options options = *j->light->options;
    cn_appearance row;
    uint32_t n = 0;
    for (size_t i = 0; i < j->rays->n; i++) {
        if (!(j->share[i * j->n_parts + p] > 0)) continue;
        memcpy(j->origin[n], j->rays->origin_m[i], sizeof *j->origin);
        memcpy(j->direction[n], j->rays->direction[i], sizeof *j->direction);
        memcpy(j->range[n], j->light->range_m[i], sizeof *j->range);
        j->list[n++] = (uint32_t)i;
    }
    if (!n) return CN_OK;
    CN_TRY(cn_tile_cache_tile(&j->renderer->tiles, g->which[j->which[p]], &tile));
    CN_TRY(cn_appearance_spec_row(j->light->appearance, j->ctx, g->dataset, tile, &j->renderer->tiles.fits, &row));
    options.appearance = &row;
    options.range_m = (const double(*)[2])j->range;
    const cn_ray_list mine = { n, (const double(*)[3])j->origin, (const double(*)[3])j->direction };
    CN_TRY(cn_render_rays(j->ctx, tile, &mine, &options, j->one, j->one + 4 * (size_t)n));
    for (uint32_t i = 0; i < n; i++)
        for (size_t k = 0; k < 4; k++)
            j->rgba[4 * (size_t)j->list[i] + k] += j->share[j->list[i] * (size_t)j->n_parts + p] * j->one[4 * i + k];
    return CN_OK;
}

static cn_status shade(shading_job *j)
{
    const size_t n = j->rays->n;
    double middle[2];
    const double radius = find_places(j, middle);
    choose_tiles(j, middle, radius);
    j->share = malloc((n * j->n_parts + 1) * sizeof *j->share);
    if (!j->share) return cn_fail(CN_ERR_NOMEM, "out of memory for %zu rays", n);
    for (size_t i = 0; i < n; i++) {
        double share[CN_UNION_MAX] = { 0 };
        cn_union_shares(j->n_parts, j->parts, j->place[i], share);
        for (uint32_t p = 0; p < j->n_parts; p++)
            j->share[i * j->n_parts + p] = (float)share[p];
    }
    memset(j->rgba, 0, n * 4 * sizeof *j->rgba);
    for (uint32_t p = 0; p < j->n_parts; p++)
        CN_TRY(add_tile(j, p));
    return CN_OK;
}

cn_status cn_renderer_shade(cn_renderer *renderer, const cn_context *ctx, const cn_renderer_light *light,
                            const cn_ray_list *rays, float *rgba)
{
    const size_t n = rays->n;
    shading_job j = { .renderer = renderer, .ctx = ctx, .light = light, .rays = rays, .rgba = rgba };
    if (!n) return CN_OK;
    j.place = malloc(n * sizeof *j.place);
    j.list = malloc(n * sizeof *j.list);
    j.origin = malloc(n * sizeof *j.origin);
    j.direction = malloc(n * sizeof *j.direction);
    j.range = malloc(n * sizeof *j.range);
    j.one = malloc(n * 5 * sizeof *j.one);
    cn_status status = CN_OK;
    if (!j.place || !j.list || !j.origin || !j.direction || !j.range || !j.one)
        status = cn_fail(CN_ERR_NOMEM, "out of memory for %zu rays", n);
    pthread_mutex_lock(&renderer->turn);
    if (status == CN_OK) status = shade(&j);
    pthread_mutex_unlock(&renderer->turn);
    free(j.place);
    free(j.share);
    free(j.list);
    free(j.origin);
    free(j.direction);
    free(j.range);
    free(j.one);
    return status;
}
