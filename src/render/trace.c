/* The processor makes the rays and their conditioning before, and does the effects on pixels after them. */
#include "render/trace.h"

#include <math.h>

#define FAR_AWAY 1e30f /* metres: the offset of a part that owns nothing, as a number for shaders */
_Static_assert((int)CN_BATCH_RAYS == (int)CN_TRACE_RAYS, "a block is an item");

_Static_assert((int)CN_UNION_MAX <= (int)CN_TRACE_PARTS, "a part of the union is a part of the trace");

bool cn_march_describe(const cn_raymarch *m, cn_trace *trace)
{
    bool sky = !m->options->crop_m && !m->range;
    *trace = (cn_trace){ .n_parts = m->n_parts,
                         .march = { .ratio = m->ratio,
                                    .step = m->step,
                                    .min_transmittance = (float)m->options->min_transmittance,
                                    .depth_left = (float)m->options->depth_left,
                                    .min_weight = CN_BATCH_MIN_WEIGHT,
                                    .fine_depth = m->options->fine_depth },
                         .samples = m->options->samples };
    for (uint32_t p = 0; p < m->n_parts; p++) {
        const cn_tile *tile = m->shading[p].tile;
        const cn_partition_tile *place = &m->partition.tile[p];
        cn_device_part *part = &trace->part[p];
        if (!tile->field.type->describe) return false;
        *part = (cn_device_part){ .inv_extent = m->shading[p].inv_extent,
                                  .x = place->x,
                                  .y = place->y,
                                  .blend_width = place->blend_width,
                                  .offset = fminf(place->offset, FAR_AWAY) };
        tile->field.type->describe(&tile->field, &tile->params, &part->field);
        part->field.occupancy = tile->occupancy;
        part->field.serial = tile->serial;
        sky = cn_effects_describe(m->shading[p].pack, &m->shading[p].effects, &part->sky) && sky;
    }
    trace->march.sky = sky;
    return true;
}

/* The ray in the box of a part. A part that owns nothing has no samples. */
static void pack_ray(const cn_raymarch *m, const cn_march_worker *w, uint32_t p, uint32_t r, cn_device_ray *ray)
{
    const cn_march_layer *l = &w->layer[p];
    memcpy(ray->origin, l->ray[r].origin, sizeof ray->origin);
    memcpy(ray->dir, l->ray[r].dir, sizeof ray->dir);
    ray->begin = l->near;
    ray->end = m->partition.tile[p].offset < FAR_AWAY ? l->far[r] : 0;
}

static uint32_t columns_of(const cn_raymarch *m)
{
    uint32_t n = 0;
    for (uint32_t p = 0; p < m->n_parts; p++)
        n += m->shading[p].tile->field.conditioning;
    return n;
}

/* to[ray][columns]: the conditioning of all parts. */
static void pack_columns(const cn_raymarch *m, cn_march_worker *w, float *to)
{
    float dir[CN_BATCH_RAYS][3];
    const cn_effect_rays rays = cn_march_effect_rays(w, dir);
    const uint32_t columns = columns_of(m);
    uint32_t at = 0;
    for (uint32_t p = 0; p < m->n_parts; p++) {
        const uint32_t n = m->shading[p].tile->field.conditioning;
        cn_batch *batch = &w->layer[p].batch;
        cn_batch_condition(&m->shading[p], batch, &rays);
        for (size_t r = 0; r < w->n_rays; r++)
            memcpy(to + r * columns + at, batch->conditioning + r * n, n * sizeof *to);
        at += n;
    }
}

void cn_march_pack(void *user, unsigned thread, const cn_op_packed *packed)
{
    const cn_raymarch *m = user;
    cn_march_worker *w = &m->workers[thread];
    const cn_trace_buffers *to = packed->buffers;
    cn_march_kept *kept = packed->kept;
    const size_t first = packed->place * CN_TRACE_RAYS, parts = m->n_parts;
    memset(to->rays + first * parts, 0, CN_TRACE_RAYS * parts * sizeof *to->rays);
    memset(to->states + first, 0, CN_TRACE_RAYS * sizeof *to->states);
    memset(to->sums + first * parts, 0, CN_TRACE_RAYS * parts * sizeof *to->sums);
    for (uint32_t r = 0; r < w->n_rays; r++) {
        const cn_march_ray *ray = &w->ray[r];
        to->states[first + r] = (cn_device_state){
            .transmittance = 1, .at = ray->at, .end = ray->end, .dir = { ray->dir[0], ray->dir[1], ray->dir[2] }
        };
        for (uint32_t p = 0; p < m->n_parts; p++)
            pack_ray(m, w, p, r, &to->rays[(first + r) * parts + p]);
    }
    if (w->n_rays) pack_columns(m, w, to->columns + first * columns_of(m));
    memcpy(kept->ray, w->ray, w->n_rays * sizeof *w->ray);
    kept->n_rays = w->n_rays;
}

void cn_march_unpack(void *user, unsigned thread, const cn_op_packed *packed)
{
    const cn_raymarch *m = user;
    cn_march_worker *w = &m->workers[thread];
    const cn_trace_buffers *buffers = packed->buffers;
    const cn_march_kept *kept = packed->kept;
    const size_t first = packed->place * CN_TRACE_RAYS;
    w->n_rays = kept->n_rays;
    w->has_sky = m->describes_sky;
    memcpy(w->ray, kept->ray, w->n_rays * sizeof *w->ray);
    for (uint32_t r = 0; r < w->n_rays; r++) {
        const cn_device_state *from = &buffers->states[first + r];
        w->ray[r].transmittance = from->transmittance;
        w->ray[r].depth = from->depth;
        w->ray[r].surface = from->surface;
    }
    for (uint32_t p = 0; p < m->n_parts; p++) {
        cn_march_layer *l = &w->layer[p];
        l->begun = false;
        for (uint32_t r = 0; r < w->n_rays; r++) {
            const cn_device_sum *from = &buffers->sums[(first + r) * m->n_parts + p];
            memcpy(l->rgb[r], from->rgb, sizeof from->rgb);
            l->weight[r] = from->weight;
            l->begun = l->begun || from->weight > 0;
        }
    }
}
