#include "render/batch.h"

#include <math.h>

cn_status cn_lit_init(cn_lit *lit, const cn_tile *tile, const cn_appearance *row)
{
    *lit = (cn_lit){.tile = tile, .kernel = cn_kernel_best(), .pack = &tile->one, .inv_extent = cn_box_inv_extent(&tile->box)};
    if (row) lit->row = *row;
    else CN_TRY(cn_tile_appearance(tile, NULL, &lit->row));
    if (lit->row.n != tile->one.n_constants + tile->one.n_photo)
        return cn_fail(CN_ERR_USAGE, "the appearance was made for another tile than %s", tile->id);
    lit->effects = (cn_effect_state){lit->kernel, lit->row.row, lit->row.row + tile->one.n_constants, tile->shared, tile->derived};
    return CN_OK;
}

void cn_batch_take(const cn_tile *tile, cn_arena *arena, cn_batch *b)
{
    b->pos = CN_ARENA_NEW(arena, float, 3 * CN_BATCH_CAP);
    b->length = CN_ARENA_NEW(arena, float, CN_BATCH_CAP);
    b->t_at = CN_ARENA_NEW(arena, float, CN_BATCH_CAP);
    b->geo = CN_ARENA_NEW(arena, float, CN_GEO * CN_BATCH_CAP);
    b->weight = CN_ARENA_NEW(arena, float, CN_BATCH_CAP);
    b->live = CN_ARENA_NEW(arena, uint32_t, CN_BATCH_CAP);
    b->live_ray = CN_ARENA_NEW(arena, uint32_t, CN_BATCH_CAP);
    b->columns = CN_ARENA_NEW(arena, float, (size_t)CN_BATCH_RAYS * tile->field.columns);
    b->keep = CN_ARENA_NEW(arena, float, tile->pack.keep * CN_EFFECT_RAYS);
}

void cn_batch_light(const cn_lit *lit, cn_batch *b, const cn_effect_rays *rays)
{
    cn_effects_field_in(lit->pack, rays, &lit->effects, b->columns, lit->tile->field.columns);
}

void cn_batch_density(const cn_lit *lit, cn_batch *b, const cn_field_acts *acts)
{
    const cn_field *field = &lit->tile->field;
    const size_t panels = (b->n_samples + CN_PANEL - 1) / CN_PANEL;
    for (size_t i = b->n_samples; i % CN_PANEL; i++)
        for (size_t a = 0; a < 3; a++) b->pos[(i / CN_PANEL * 3 + a) * CN_PANEL + i % CN_PANEL] = 0;
    for (uint32_t l = 0; l < field->config.levels; l++)
        cn_field_encode_level(field, lit->kernel, lit->tile->params.table, l, b->pos, panels, acts->enc);
    cn_field_geometry(field, lit->kernel, &lit->tile->params, acts->enc, panels, acts->hidden, b->geo);
    b->n_live = 0;
}

/* The density logit is the first geometry feature. */
float cn_batch_depth(const cn_batch *b, uint32_t i)
{
    const float logit = b->geo[(size_t)(i / CN_PANEL) * CN_GEO * CN_PANEL + i % CN_PANEL];
    return expf(fminf(logit, CN_BATCH_MAX_LOGIT)) * b->length[i];
}

/* What is visible moves together: features, then the columns of its ray. */
static void gather(const cn_lit *lit, const cn_batch *b, float *in)
{
    const size_t rows = lit->tile->field.colour_in, columns = lit->tile->field.columns;
    for (uint32_t k = 0; k < b->n_live; k++) {
        const size_t sample = b->live[k];
        float *to = in + k / CN_PANEL * rows * CN_PANEL + k % CN_PANEL;
        const float *from = b->geo + sample / CN_PANEL * CN_GEO * CN_PANEL + sample % CN_PANEL;
        for (size_t r = 0; r < CN_GEO; r++) to[r * CN_PANEL] = from[r * CN_PANEL];
        to += (size_t)CN_GEO * CN_PANEL;
        const float *row = b->columns + b->live_ray[k] * columns;
        for (size_t c = 0; c < columns; c++) to[c * CN_PANEL] = row[c];
    }
}

void cn_batch_colour(const cn_lit *lit, const cn_batch *b, const cn_field_acts *acts, float (*rgb)[3])
{
    gather(lit, b, acts->in);
    cn_field_colour(&lit->tile->field, lit->kernel, &lit->tile->params, acts, (b->n_live + CN_PANEL - 1) / CN_PANEL);
    for (uint32_t i = 0; i < b->n_live; i++)
        for (size_t c = 0; c < 3; c++) {
            const float x = acts->out[((size_t)(i / CN_PANEL) * 4 + c) * CN_PANEL + i % CN_PANEL];
            rgb[b->live_ray[i]][c] += b->weight[i] * cn_field_light(x);
        }
}
