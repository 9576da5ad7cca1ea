/* Blocks of rays rendered by the context's device, many at once. The processor makes the rays and their conditioning
 * before, and adds the effects behind and after them. */
#include "render/on_device.h"

#include "device/tracer.h"
#include "field/grid_mlp.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { BLOCKS = 512, MAX_RAYS = BLOCKS * CN_BATCH_RAYS }; /* of one batch */

typedef struct batch {
    const cn_raymarch *march;
    size_t first; /* block */
    cn_device_ray *rays;
    cn_device_state *states;
    float *columns;
    cn_march_ray *kept;
    uint32_t *n_rays; /* of each block; the lens may have no ray for some pixels */
} batch;

static void fill_block(void *user, size_t block, unsigned thread)
{
    const batch *b = user;
    const cn_raymarch *m = b->march;
    cn_march_worker *w = &m->workers[thread];
    cn_march_layer *l = w->layer;
    const uint32_t columns = m->shading->tile->field.conditioning;
    const size_t at = block * CN_BATCH_RAYS;
    float dir[CN_BATCH_RAYS][3];
    cn_march_block_begin(m, w, b->first + block);
    const cn_effect_rays rays = cn_march_effect_rays(w, dir);
    if (w->n_rays) cn_batch_condition(m->shading, &l->batch, &rays);
    memset(b->rays + at, 0, CN_BATCH_RAYS * sizeof *b->rays);
    memset(b->states + at, 0, CN_BATCH_RAYS * sizeof *b->states);
    for (uint32_t r = 0; r < w->n_rays; r++) {
        cn_device_ray *to = &b->rays[at + r];
        memcpy(to->origin, l->ray[r].origin, sizeof to->origin);
        memcpy(to->dir, l->ray[r].dir, sizeof to->dir);
        to->end = w->ray[r].end;
        b->states[at + r].at = w->ray[r].at;
        b->states[at + r].transmittance = 1;
    }
    memcpy(b->columns + at * columns, l->batch.conditioning, (size_t)w->n_rays * columns * sizeof *b->columns);
    memcpy(b->kept + at, w->ray, w->n_rays * sizeof *w->ray);
    b->n_rays[block] = w->n_rays;
}

static void write_block(void *user, size_t block, unsigned thread)
{
    const batch *b = user;
    cn_march_worker *w = &b->march->workers[thread];
    cn_march_layer *l = w->layer;
    const size_t at = block * CN_BATCH_RAYS;
    w->n_rays = b->n_rays[block];
    memcpy(w->ray, b->kept + at, w->n_rays * sizeof *w->ray);
    l->begun = false;
    for (uint32_t r = 0; r < w->n_rays; r++) {
        const cn_device_state *from = &b->states[at + r];
        w->ray[r].transmittance = from->transmittance;
        w->ray[r].depth = from->depth;
        w->ray[r].surface = from->surface;
        memcpy(l->rgb[r], from->rgb, sizeof from->rgb);
        l->weight[r] = from->weight;
        l->begun = l->begun || from->weight > 0;
    }
    cn_march_block_write(b->march, w);
}

/* Types of field whose passes are a grid's and two networks'. */
static cn_status describe(const cn_tile *tile, cn_device_field *field)
{
    const cn_field *f = &tile->field;
    if (f->type->geometry != cn_grid_mlp_geometry || f->type->colour_pass != cn_grid_mlp_colour)
        return cn_fail(CN_ERR_TOOL, "a device does not render fields of type %s", f->type->name);
    *field = (cn_device_field){ .level = f->grid.level,
                                .levels = f->grid.n_levels,
                                .enc_rows = f->enc_rows,
                                .density_width = f->mlp.density_width,
                                .colour_width = f->mlp.colour_width,
                                .columns = f->conditioning,
                                .softplus = f->type->density == CN_DENSITY_SOFTPLUS,
                                .table = tile->params.table,
                                .entries = f->entries,
                                .weights = tile->params.derived,
                                .n_weights = f->n_weights,
                                .occupancy = tile->occupancy };
    return CN_OK;
}

static cn_status run_batches(batch *b, cn_tracer *tracer, size_t blocks)
{
    const cn_raymarch *m = b->march;
    const cn_device_march march = { .ratio = m->ratio,
                                    .step = m->step,
                                    .inv_extent = m->shading->inv_extent,
                                    .min_transmittance = (float)m->options->min_transmittance,
                                    .depth_left = (float)m->options->depth_left,
                                    .min_weight = CN_BATCH_MIN_WEIGHT };
    uint64_t samples = 0;
    for (b->first = 0; b->first < blocks; b->first += BLOCKS) {
        const size_t n = blocks - b->first < BLOCKS ? blocks - b->first : BLOCKS;
        const cn_device_batch rays = { (uint32_t)n * CN_BATCH_RAYS, b->rays, b->columns, b->states };
        cn_pool_run(m->ctx->pool, n, fill_block, b);
        CN_TRY(cn_tracer_run(tracer, m->ctx, &march, &rays, &samples));
        cn_pool_run(m->ctx->pool, n, write_block, b);
    }
    if (m->options->samples) __atomic_fetch_add(m->options->samples, samples, __ATOMIC_RELAXED);
    return CN_OK;
}

static cn_status render(const cn_raymarch *m, size_t blocks)
{
    cn_device_field field;
    CN_TRY(describe(m->shading->tile, &field));
    const size_t n_blocks = blocks < BLOCKS ? blocks : BLOCKS, n = n_blocks * CN_BATCH_RAYS;
    batch b = { .march = m,
                .rays = malloc(n * sizeof *b.rays),
                .states = malloc(n * sizeof *b.states),
                .columns = malloc((n * field.columns + 1) * sizeof *b.columns),
                .kept = malloc(n * sizeof *b.kept),
                .n_rays = malloc(n_blocks * sizeof *b.n_rays) };
    cn_tracer *tracer = NULL;
    cn_status status = b.rays && b.states && b.columns && b.kept && b.n_rays
                           ? cn_tracer_create(m->ctx->device, &field, (uint32_t)n, &tracer)
                           : cn_fail(CN_ERR_NOMEM, "out of memory for the rays of a picture");
    if (status == CN_OK) status = run_batches(&b, tracer, blocks);
    cn_tracer_destroy(&tracer);
    free(b.rays);
    free(b.states);
    free(b.columns);
    free(b.kept);
    free(b.n_rays);
    return status;
}

static bool render_or_say(const cn_raymarch *m, size_t blocks)
{
    cn_status status = CN_OK;
    if (m->n_parts > 1)
        status = cn_fail(CN_ERR_TOOL, "a device renders one tile at a time, and here several share space");
    else
        status = render(m, blocks);
    if (status == CN_OK || status == CN_ERR_INTERRUPTED) return true;
    if (cn_device_say_once(m->ctx->device))
        cn_log(m->ctx, CN_LOG_WARN, "%s; the processor renders instead", cn_error_message());
    return false;
}

void cn_raymarch_use_device(cn_raymarch *march)
{
    if (march->ctx->device) march->other_way = render_or_say;
}
