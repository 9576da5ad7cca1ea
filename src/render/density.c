#include "render/density.h"

#include "base/contraction.h"
#include "device/device.h"
#include "field/occupancy.h"

#include <math.h>

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

/* Writes the contracted place to its lane. Returns what turns the field's density into 1/m there. *empty: whether the
 * tile is. */
static float place(const cn_density_probe *p, const double xyz[3], size_t i, bool *empty)
{
    const cn_box *box = &p->tile->box;
    float x[3], *lane = p->pos + i / CN_PANEL * (3 * CN_PANEL) + i % CN_PANEL;
    for (int a = 0; a < 3; a++)
        x[a] = (float)((xyz[a] - box->centre[a]) / box->half_extent[a]);
    const float s = cn_contraction_float(fmaxf(fabsf(x[0]), fmaxf(fabsf(x[1]), fabsf(x[2]))));
    for (int a = 0; a < 3; a++)
        x[a] = x[a] * s * 0.25f + 0.5f;
    for (size_t a = 0; a < 3; a++)
        lane[a * CN_PANEL] = x[a];
    const uint32_t cell = cn_occupancy_cell(x[0], x[1], x[2]);
    *empty = !(p->tile->occupancy[cell / 32] >> cell % 32 & 1);
    return p->inv_extent * s;
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
