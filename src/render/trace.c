/* The processor makes the rays and their conditioning before, and adds the effects behind and after them. */
#include "render/trace.h"

_Static_assert((int)CN_BATCH_RAYS == (int)CN_TRACE_RAYS, "a block is an item");

bool cn_march_describe(const cn_raymarch *m, cn_trace *trace)
{
    const cn_tile *tile = m->shading->tile;
    if (m->n_parts > 1 || m->options->fine_depth || !tile->field.type->describe) return false;
    *trace = (cn_trace){ .march = { .ratio = m->ratio,
                                    .step = m->step,
                                    .inv_extent = m->shading->inv_extent,
                                    .min_transmittance = (float)m->options->min_transmittance,
                                    .depth_left = (float)m->options->depth_left,
                                    .min_weight = CN_BATCH_MIN_WEIGHT },
                         .samples = m->options->samples };
    tile->field.type->describe(&tile->field, &tile->params, &trace->field);
    trace->field.occupancy = tile->occupancy;
    return true;
}

void cn_march_pack(void *user, unsigned thread, const cn_op_packed *packed)
{
    const cn_raymarch *m = user;
    cn_march_worker *w = &m->workers[thread];
    cn_march_layer *l = w->layer;
    const cn_trace_buffers *to = packed->buffers;
    cn_march_kept *kept = packed->kept;
    const size_t at = packed->place * CN_TRACE_RAYS;
    const uint32_t columns = m->shading->tile->field.conditioning;
    float dir[CN_BATCH_RAYS][3];
    const cn_effect_rays rays = cn_march_effect_rays(w, dir);
    if (w->n_rays) cn_batch_condition(m->shading, &l->batch, &rays);
    memset(to->rays + at, 0, CN_TRACE_RAYS * sizeof *to->rays);
    memset(to->states + at, 0, CN_TRACE_RAYS * sizeof *to->states);
    for (uint32_t r = 0; r < w->n_rays; r++) {
        cn_device_ray *ray = &to->rays[at + r];
        memcpy(ray->origin, l->ray[r].origin, sizeof ray->origin);
        memcpy(ray->dir, l->ray[r].dir, sizeof ray->dir);
        ray->end = w->ray[r].end;
        to->states[at + r].at = w->ray[r].at;
        to->states[at + r].transmittance = 1;
    }
    memcpy(to->columns + at * columns, l->batch.conditioning, (size_t)w->n_rays * columns * sizeof *to->columns);
    memcpy(kept->ray, w->ray, w->n_rays * sizeof *w->ray);
    kept->n_rays = w->n_rays;
}

void cn_march_unpack(void *user, unsigned thread, const cn_op_packed *packed)
{
    const cn_raymarch *m = user;
    cn_march_worker *w = &m->workers[thread];
    cn_march_layer *l = w->layer;
    const cn_trace_buffers *buffers = packed->buffers;
    const cn_march_kept *kept = packed->kept;
    w->n_rays = kept->n_rays;
    memcpy(w->ray, kept->ray, w->n_rays * sizeof *w->ray);
    l->begun = false;
    for (uint32_t r = 0; r < w->n_rays; r++) {
        const cn_device_state *from = &buffers->states[packed->place * CN_TRACE_RAYS + r];
        w->ray[r].transmittance = from->transmittance;
        w->ray[r].depth = from->depth;
        w->ray[r].surface = from->surface;
        memcpy(l->rgb[r], from->rgb, sizeof from->rgb);
        l->weight[r] = from->weight;
        l->begun = l->begun || from->weight > 0;
    }
}
