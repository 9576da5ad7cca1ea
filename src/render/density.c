#include "render/density.h"

#include "device/device.h"
#include "device/trace.h"
#include "field/occupancy.h"
#include "rays/rays.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static void carve(cn_density_probe *p, cn_arena *arena)
{
    const cn_field *field = &p->tile->field;
    field->type->acts_take(field, arena, CN_DENSITY_PANELS, &p->acts);
    p->pos = CN_ARENA_NEW(arena, float, 3 * CN_DENSITY_PLACES);
    p->logit = CN_ARENA_NEW(arena, float, CN_DENSITY_PLACES);
}

cn_status cn_density_probe_init(cn_density_probe *p, const cn_context *ctx, const cn_tile *tile)
{
    cn_arena counter;
    *p = (cn_density_probe){ .tile = tile,
                             .kernel = cn_device_kernel(ctx, false),
                             .inv_extent = cn_box_inv_extent(&tile->box) };
    cn_arena_count(&counter);
    carve(p, &counter);
    CN_TRY(cn_arena_init(&p->memory, counter.used));
    carve(p, &p->memory);
    return CN_OK;
}

void cn_density_probe_deinit(cn_density_probe *p)
{
    cn_arena_deinit(&p->memory);
    *p = (cn_density_probe){ 0 };
}

/* The contracted place. Returns what turns the field's density into 1/m there. *empty: whether the tile is. */
static float contract(const cn_density_probe *p, const double xyz[3], float x[3], bool *empty)
{
    const float factor = (float)cn_box_contract(&p->tile->box, xyz, x);
    const uint32_t cell = cn_occupancy_cell(x[0], x[1], x[2]);
    *empty = !(p->tile->occupancy[cell / 32] >> cell % 32 & 1);
    return p->inv_extent * factor;
}

static void put(const cn_density_probe *p, size_t i, const float x[3])
{
    float *lane = p->pos + i / CN_PANEL * (3 * CN_PANEL) + i % CN_PANEL;
    for (size_t a = 0; a < 3; a++)
        lane[a * CN_PANEL] = x[a];
}

/* Puts the place into its lane; the rest as `contract`. */
static float place(const cn_density_probe *p, const double xyz[3], size_t i, bool *empty)
{
    float x[3];
    const float scale = contract(p, xyz, x, empty);
    put(p, i, x);
    return scale;
}

static void fill_panel(const cn_density_probe *p, size_t n)
{
    for (size_t i = n; i % CN_PANEL; i++)
        for (size_t a = 0; a < 3; a++)
            p->pos[i / CN_PANEL * (3 * CN_PANEL) + a * CN_PANEL + i % CN_PANEL] = 0.5f;
}

static void find_logits(const cn_density_probe *p, size_t n)
{
    const cn_field *field = &p->tile->field;
    const size_t panels = (n + CN_PANEL - 1) / CN_PANEL;
    for (uint32_t e = 0; e < field->n_encoders; e++)
        field->type->encode(field, p->kernel, e,
                            &(cn_field_encoding){ p->tile->params.table, p->pos, panels, p->acts.enc });
    field->type->logits(field, p->kernel, &p->tile->params, &p->acts, panels, p->logit);
}

static void evaluate(cn_density_probe *p, size_t n, const double (*xyz)[3], float *sigma)
{
    const cn_field *field = &p->tile->field;
    bool any = false, empty;
    fill_panel(p, n);
    for (size_t i = 0; i < n; i++) {
        const float scale = place(p, xyz[i], i, &empty);
        sigma[i] = empty ? 0 : scale;
        any = any || !empty;
    }
    if (!any) return;
    find_logits(p, n);
    for (size_t i = 0; i < n; i++)
        if (sigma[i] > 0) sigma[i] *= cn_density(field->type->density, p->logit[i]);
}

void cn_density_probe_at(cn_density_probe *p, size_t n, const double (*xyz)[3], float *sigma)
{
    for (size_t i = 0; i < n; i += CN_DENSITY_PLACES)
        evaluate(p, n - i < CN_DENSITY_PLACES ? n - i : CN_DENSITY_PLACES, xyz + i, sigma + i);
}

static void measure(cn_density_probe *p, size_t n, const double (*xyz)[3], float *distance_m)
{
    const cn_field *field = &p->tile->field;
    bool empty;
    fill_panel(p, n);
    for (size_t i = 0; i < n; i++)
        distance_m[i] = place(p, xyz[i], i, &empty);
    find_logits(p, n);
    for (size_t i = 0; i < n; i++)
        distance_m[i] = field->type->distance(field, p->tile->params.weights, p->logit[i]) / distance_m[i];
}

void cn_density_probe_distance(cn_density_probe *p, size_t n, const double (*xyz)[3], float *distance_m)
{
    for (size_t i = 0; i < n; i += CN_DENSITY_PLACES)
        measure(p, n - i < CN_DENSITY_PLACES ? n - i : CN_DENSITY_PLACES, xyz + i, distance_m + i);
}

/* ---- many places ---- */

enum { BLOCK = 4096 /* places of a task */ };

cn_status cn_density_field_init(cn_density_field *f, const cn_context *ctx, const cn_tile *tile, size_t most)
{
    const unsigned threads = cn_pool_threads(ctx->pool);
    *f = (cn_density_field){ .ctx = ctx, .tile = tile, .most = most };
    f->probes = calloc(threads, sizeof *f->probes);
    f->place = malloc((most + 1) * sizeof *f->place);
    f->logit = malloc((most + 1) * sizeof *f->logit);
    f->which = malloc((most + 1) * sizeof *f->which);
    cn_status status = f->probes && f->place && f->logit && f->which
                           ? CN_OK
                           : cn_fail(CN_ERR_NOMEM, "out of memory for the density at %zu places", most);
    for (unsigned t = 0; t < threads && status == CN_OK; t++)
        status = cn_density_probe_init(&f->probes[t], ctx, tile);
    if (status != CN_OK) cn_density_field_deinit(f);
    return status;
}

void cn_density_field_deinit(cn_density_field *f)
{
    for (unsigned t = 0; f->probes && t < cn_pool_threads(f->ctx->pool); t++)
        cn_density_probe_deinit(&f->probes[t]);
    free(f->probes);
    free(f->place);
    free(f->logit);
    free(f->which);
    *f = (cn_density_field){ 0 };
}

typedef struct query {
    const cn_density_field *field;
    size_t n, there; /* places; those that are not empty */
    const double (*xyz)[3];
    float *sigma;
} query;

/* sigma: what turns the field's density into 1/m, or 0 where the tile is empty. */
static void contract_block(void *user, size_t block, unsigned worker)
{
    const query *q = user;
    (void)worker;
    for (size_t i = block * BLOCK; i < (block + 1) * BLOCK && i < q->n; i++) {
        bool empty;
        const float scale = contract(q->field->probes, q->xyz[i], q->field->place[i], &empty);
        q->sigma[i] = empty ? 0 : scale;
    }
}

/* Moves the places that are not empty to the front. */
static void leave_out_empty(query *q)
{
    const cn_density_field *f = q->field;
    for (size_t i = 0; i < q->n; i++) {
        if (!(q->sigma[i] > 0)) continue;
        memmove(f->place[q->there], f->place[i], sizeof *f->place);
        f->which[q->there++] = (uint32_t)i;
    }
}

static void logits_op(void *user, size_t item, unsigned worker)
{
    const query *q = user;
    const cn_density_field *f = q->field;
    const cn_density_probe *p = &f->probes[worker];
    const size_t first = item * CN_DENSITY_PLACES, left = q->there - first;
    const size_t n = left < CN_DENSITY_PLACES ? left : CN_DENSITY_PLACES;
    if (cn_stopping(f->ctx)) return;
    fill_panel(p, n);
    for (size_t i = 0; i < n; i++)
        put(p, i, f->place[first + i]);
    find_logits(p, n);
    memcpy(f->logit + first, p->logit, n * sizeof *p->logit);
}

static void activate_block(void *user, size_t block, unsigned worker)
{
    const query *q = user;
    const cn_density_field *f = q->field;
    (void)worker;
    for (size_t k = block * BLOCK; k < (block + 1) * BLOCK && k < q->there; k++)
        q->sigma[f->which[k]] *= cn_density(f->tile->field.type->density, f->logit[k]);
}

cn_status cn_density_field_at(cn_density_field *f, size_t n, const double (*xyz)[3], float *sigma)
{
    const cn_tile *tile = f->tile;
    query q = { .field = f, .n = n, .xyz = xyz, .sigma = sigma };
    cn_density_query on_device;
    cn_pool_run(f->ctx->pool, (n + BLOCK - 1) / BLOCK, contract_block, &q);
    leave_out_empty(&q);
    if (tile->field.type->describe) {
        on_device = (cn_density_query){ .n = q.there, .place = (const float(*)[4])f->place, .logit = f->logit };
        tile->field.type->describe(&tile->field, &tile->params, &on_device.field);
        on_device.field.occupancy = tile->occupancy;
        on_device.field.serial = tile->serial;
    }
    const cn_op op = { .kind = CN_OP_DENSITY,
                       .item = logits_op,
                       .batch = tile->field.type->describe ? &on_device : NULL };
    const cn_chain chain = { &op, 1, (q.there + CN_DENSITY_PLACES - 1) / CN_DENSITY_PLACES, &q };
    CN_TRY(cn_device_run(f->ctx, &chain, 1));
    if (cn_stopping(f->ctx))
        return cn_fail(CN_ERR_INTERRUPTED, "stopped while rendering; run the same command to go on");
    cn_pool_run(f->ctx->pool, (q.there + BLOCK - 1) / BLOCK, activate_block, &q);
    return CN_OK;
}
