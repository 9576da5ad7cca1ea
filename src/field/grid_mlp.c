#include "field/grid_mlp.h"

#include "base/rng.h"

cn_status cn_grid_mlp_layout(cn_field *field, uint32_t most_entries, const char *table_name)
{
    static const char *const names[CN_LAYERS] = { "density.0", "density.1", "colour.0", "colour.1", "colour.2" };
    const uint32_t levels = (uint32_t)cn_field_option_of(field, "levels");
    CN_TRY(cn_grid_layout(&field->grid, levels, (uint32_t)cn_field_option_of(field, "base_resolution"),
                          (uint32_t)cn_field_option_of(field, "finest_resolution"), most_entries));
    CN_TRY(cn_mlp_layout(&field->mlp, 2 * levels, (uint32_t)cn_field_option_of(field, "density_width"),
                         (uint32_t)cn_field_option_of(field, "colour_width"), field->inputs.n));
    field->enc_rows = field->mlp.enc_rows;
    field->colour_in = field->mlp.colour_in;
    field->geo_rows = CN_GEO;
    field->conditioning = field->colour_in - CN_GEO;
    field->n_encoders = field->n_sections = levels;
    for (uint32_t l = 0; l < levels; l++)
        field->section[l] = (cn_field_section){ field->grid.level[l].offset, field->grid.level[l].entries, 0 };
    field->entries = field->grid.entries;
    field->n_weights = field->n_derived = field->mlp.n_weights;
    cn_field_add_block(field, table_name, CN_FIELD_TABLE, field->entries, 2, 0);
    for (int i = 0; i < CN_LAYERS; i++) {
        const cn_layer *layer = &field->mlp.layer[i];
        cn_field_add_block(field, names[i], CN_FIELD_WEIGHTS, layer->out, layer->in, layer->offset);
    }
    return CN_OK;
}

/* Features are initialised uniformly in +-1e-4 (Mueller et al. 2022). */
void cn_grid_mlp_init(const cn_field *field, uint64_t seed, float *table, float *weights)
{
    for (size_t i = 0; i < 2 * field->entries; i++)
        table[i] = (2 * cn_rng_float(seed, 1, i) - 1) * 1e-4f;
    cn_mlp_init(&field->mlp, seed, weights);
}

void cn_grid_mlp_prepare(const cn_field *field, const float *weights, float *derived)
{
    cn_mlp_transpose(&field->mlp, weights, derived);
}

void cn_grid_mlp_acts_take(const cn_field *field, cn_arena *arena, size_t n_panels, cn_field_acts *acts)
{
    cn_mlp_acts_take(&field->mlp, arena, n_panels, acts);
}

void cn_grid_mlp_encode(const cn_field *field, const cn_kernel *k, uint32_t encoder, const cn_field_encoding *of)
{
    const cn_level *level = &field->grid.level[encoder];
    k->encode(level, of->table + level->offset, of->pos, of->n_panels, of->enc + (size_t)encoder * 2 * CN_PANEL,
              (size_t)field->enc_rows * CN_PANEL);
}

void cn_grid_mlp_encode_backward(const cn_field *field, const cn_kernel *k, const uint32_t *table, uint32_t section,
                                 const cn_encode_gradient *in)
{
    cn_encode_gradient of_level = *in;
    (void)table;
    of_level.d_enc += (size_t)section * 2 * CN_PANEL;
    k->encode_backward(&field->grid.level[section], &of_level);
}

void cn_grid_mlp_position_gradient(const cn_field *field, const uint32_t *table, const float *pos, const float *d_enc,
                                   uint32_t n, float (*d_pos)[3])
{
    const cn_panel_rows rows = { d_enc, (size_t)field->enc_rows * CN_PANEL, field->enc_rows };
    cn_grid_position_gradient(&field->grid, table, pos, &rows, n, d_pos);
}

static cn_mlp_params mlp_params(const cn_field_params *params)
{
    return (cn_mlp_params){ params->weights, params->derived };
}

void cn_grid_mlp_logits(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                        const cn_field_acts *acts, size_t n_panels, float *logit)
{
    const cn_mlp_params of_mlp = mlp_params(params);
    cn_mlp_logits(&field->mlp, k, &of_mlp, acts, n_panels, logit);
}

void cn_grid_mlp_geometry(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                          const cn_field_acts *acts, size_t n_panels, float *geo)
{
    const cn_mlp_params of_mlp = mlp_params(params);
    cn_mlp_geometry(&field->mlp, k, &of_mlp, acts, n_panels, geo);
}

void cn_grid_mlp_density(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                         const cn_field_acts *acts, size_t n_panels)
{
    const cn_mlp_params of_mlp = mlp_params(params);
    cn_mlp_density(&field->mlp, k, &of_mlp, acts, n_panels);
}

void cn_grid_mlp_colour(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                        const cn_field_acts *acts, size_t n_panels)
{
    const cn_mlp_params of_mlp = mlp_params(params);
    cn_mlp_colour(&field->mlp, k, &of_mlp, acts, n_panels);
}

void cn_grid_mlp_colour_backward(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                                 const cn_field_acts *acts, const cn_field_acts *d, size_t n_panels)
{
    const cn_mlp_params of_mlp = mlp_params(params);
    cn_mlp_colour_backward(&field->mlp, k, &of_mlp, acts, d, n_panels);
}

void cn_grid_mlp_backward(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                          const cn_field_acts *acts, const cn_field_gradient *d, size_t n_panels)
{
    const cn_mlp_params of_mlp = mlp_params(params);
    cn_mlp_backward(&field->mlp, k, &of_mlp, acts, d, n_panels);
}

void cn_grid_mlp_describe(const cn_field *field, const cn_field_params *params, cn_device_field *described)
{
    *described = (cn_device_field){ .level = field->grid.level,
                                    .levels = field->grid.n_levels,
                                    .enc_rows = field->enc_rows,
                                    .density_width = field->mlp.density_width,
                                    .colour_width = field->mlp.colour_width,
                                    .columns = field->conditioning,
                                    .softplus = field->type->density == CN_DENSITY_SOFTPLUS,
                                    .table = params->table,
                                    .entries = field->entries,
                                    .weights = params->derived,
                                    .n_weights = field->n_weights };
}
