#include "render/batch.h"

#include <math.h>
#include <string.h>

cn_status cn_shading_init(cn_shading *shading, const cn_context *ctx, const cn_tile *tile, const cn_appearance *row)
{
    *shading = (cn_shading){ .tile = tile,
                             .kernel = cn_device_kernel(ctx, false),
                             .pack = &tile->one,
                             .inv_extent = cn_box_inv_extent(&tile->box) };
    if (row)
        shading->row = *row;
    else
        CN_TRY(cn_tile_appearance(tile, NULL, &shading->row));
    if (shading->row.n != tile->one.n_constants + tile->one.n_photo)
        return cn_fail(CN_ERR_USAGE, "the appearance was made for another tile than %s", tile->id);
    shading->effects = (cn_effect_state){ shading->kernel, shading->row.row, shading->row.row + tile->one.n_constants,
                                          tile->shared, tile->derived };
    return CN_OK;
}

void cn_batch_take(const cn_tile *tile, cn_arena *arena, cn_batch *b)
{
    b->pos = CN_ARENA_NEW(arena, float, 3 * CN_BATCH_CAP);
    b->length = CN_ARENA_NEW(arena, float, CN_BATCH_CAP);
    b->t_at = CN_ARENA_NEW(arena, float, CN_BATCH_CAP);
    b->geo = CN_ARENA_NEW(arena, float, (size_t)tile->field.geo_rows *CN_BATCH_CAP);
    b->density = tile->field.type->density;
    b->rows = (uint32_t)tile->field.colour_in;
    b->geo_rows = tile->field.geo_rows;
    b->in = CN_ARENA_NEW(arena, float, (size_t)CN_BATCH_PANELS *CN_PANEL * b->rows);
    b->weight = CN_ARENA_NEW(arena, float, CN_BATCH_PANELS *CN_PANEL);
    b->live_ray = CN_ARENA_NEW(arena, uint32_t, CN_BATCH_PANELS * CN_PANEL);
    b->conditioning = CN_ARENA_NEW(arena, float, (size_t)CN_BATCH_RAYS * tile->field.conditioning);
    b->saved = CN_ARENA_NEW(arena, float, tile->pack.saved *CN_EFFECT_RAYS);
}

void cn_batch_condition(const cn_shading *shading, cn_batch *b, const cn_effect_rays *rays)
{
    cn_effects_field_in(shading->pack, rays, &shading->effects, b->conditioning, shading->tile->field.conditioning);
    b->n_live = 0;
}

void cn_batch_density(const cn_shading *shading, cn_batch *b, const cn_field_acts *acts)
{
    const cn_field *field = &shading->tile->field;
    const size_t panels = (b->n_samples + CN_PANEL - 1) / CN_PANEL;
    for (size_t i = b->n_samples; i % CN_PANEL; i++)
        for (size_t a = 0; a < 3; a++)
            b->pos[(i / CN_PANEL * 3 + a) * CN_PANEL + i % CN_PANEL] = 0;
    for (uint32_t e = 0; e < field->n_encoders; e++)
        field->type->encode(field, shading->kernel, e,
                            &(cn_field_encoding){ shading->tile->params.table, b->pos, panels, acts->enc });
    field->type->geometry(field, shading->kernel, &shading->tile->params, acts, panels, b->geo);
}

/* The density logit is the first geometry feature. */
float cn_batch_depth(const cn_batch *b, uint32_t i)
{
    const float logit = b->geo[(size_t)(i / CN_PANEL) * b->geo_rows * CN_PANEL + i % CN_PANEL];
    return cn_density(b->density, logit) * b->length[i];
}

/* The input of the colour head: the features of the sample, then the conditioning of its ray. */
void cn_batch_show(cn_batch *b, uint32_t sample, uint32_t ray, float weight)
{
    const uint32_t k = b->n_live++, n_conditioning = b->rows - b->geo_rows;
    float *to = b->in + (size_t)(k / CN_PANEL) * b->rows * CN_PANEL + k % CN_PANEL;
    const float *from = b->geo + (size_t)(sample / CN_PANEL) * b->geo_rows * CN_PANEL + sample % CN_PANEL;
    for (size_t r = 0; r < b->geo_rows; r++)
        to[r * CN_PANEL] = from[r * CN_PANEL];
    to += (size_t)b->geo_rows * CN_PANEL;
    const float *row = b->conditioning + (size_t)ray * n_conditioning;
    for (size_t c = 0; c < n_conditioning; c++)
        to[c * CN_PANEL] = row[c];
    b->weight[k] = weight;
    b->live_ray[k] = ray;
}

void cn_batch_colour(const cn_shading *shading, cn_batch *b, const cn_field_acts *acts, bool all, float (*rgb)[3])
{
    const uint32_t panels = (b->n_live + (all ? CN_PANEL - 1 : 0)) / CN_PANEL, n = all ? b->n_live : panels * CN_PANEL;
    if (!panels) return;
    cn_field_acts with_in = *acts;
    with_in.in = b->in;
    shading->tile->field.type->colour_pass(&shading->tile->field, shading->kernel, &shading->tile->params, &with_in,
                                           panels);
    for (uint32_t i = 0; i < n; i++)
        for (size_t c = 0; c < 3; c++) {
            const float x = acts->out[((size_t)(i / CN_PANEL) * 4 + c) * CN_PANEL + i % CN_PANEL];
            rgb[b->live_ray[i]][c] += b->weight[i] * cn_field_light(x);
        }
    /* The rest, less than a panel, comes to the front. */
    b->n_live -= n;
    if (!b->n_live) return;
    memcpy(b->in, b->in + (size_t)panels * b->rows * CN_PANEL, (size_t)b->rows * CN_PANEL * sizeof *b->in);
    memcpy(b->weight, b->weight + n, b->n_live * sizeof *b->weight);
    memcpy(b->live_ray, b->live_ray + n, b->n_live * sizeof *b->live_ray);
}
