/* A field of a feature grid and two small networks; the types hash and dense share it. */
#ifndef CONURB_FIELD_GRID_MLP_H
#define CONURB_FIELD_GRID_MLP_H
#include "field/field.h"

/* Sizes, blocks and sections from the options levels, base_resolution, finest_resolution, density_width and
 * colour_width. most_entries: as in cn_grid_layout. table_name: name of the table's tensor. */
CN_NODISCARD cn_status cn_grid_mlp_layout(cn_field *field, uint32_t most_entries, const char *table_name);
/* The settings of both networks, as entries of cn_field_type's options. */
#define CN_GRID_MLP_WIDTHS                                                                                             \
    { "density_width", "units of the density network's hidden layer", 4, 256, { 64, 64, 64, 64, 64 }, true },          \
    {                                                                                                                  \
        "colour_width", "units of the colour network's two hidden layers", 4, 256, { 64, 64, 64, 64, 64 }, true        \
    }
/* Every member of a cn_field_type after `layout`. */
#define CN_GRID_MLP_PASSES                                                                                             \
    .init = cn_grid_mlp_init, .prepare = cn_grid_mlp_prepare, .acts_take = cn_grid_mlp_acts_take,                      \
    .encode = cn_grid_mlp_encode, .encode_backward = cn_grid_mlp_encode_backward,                                      \
    .position_gradient = cn_grid_mlp_position_gradient, .logits = cn_grid_mlp_logits,                                  \
    .geometry = cn_grid_mlp_geometry, .density_pass = cn_grid_mlp_density, .colour_pass = cn_grid_mlp_colour,          \
    .colour_backward = cn_grid_mlp_colour_backward, .backward = cn_grid_mlp_backward, .describe = cn_grid_mlp_describe
void cn_grid_mlp_init(const cn_field *field, uint64_t seed, float *table, float *weights);
void cn_grid_mlp_prepare(const cn_field *field, const float *weights, float *derived);
void cn_grid_mlp_acts_take(const cn_field *field, cn_arena *arena, size_t n_panels, cn_field_acts *acts);
void cn_grid_mlp_encode(const cn_field *field, const cn_kernel *k, uint32_t encoder, const cn_field_encoding *of);
void cn_grid_mlp_encode_backward(const cn_field *field, const cn_kernel *k, const uint32_t *table, uint32_t section,
                                 const cn_encode_gradient *in);
void cn_grid_mlp_position_gradient(const cn_field *field, const uint32_t *table, const float *pos, const float *d_enc,
                                   uint32_t n, float (*d_pos)[3]);
void cn_grid_mlp_logits(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                        const cn_field_acts *acts, size_t n_panels, float *logit);
void cn_grid_mlp_geometry(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                          const cn_field_acts *acts, size_t n_panels, float *geo);
void cn_grid_mlp_density(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                         const cn_field_acts *acts, size_t n_panels);
void cn_grid_mlp_colour(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                        const cn_field_acts *acts, size_t n_panels);
void cn_grid_mlp_colour_backward(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                                 const cn_field_acts *acts, const cn_field_acts *d, size_t n_panels);
void cn_grid_mlp_backward(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                          const cn_field_acts *acts, const cn_field_gradient *d, size_t n_panels);
void cn_grid_mlp_describe(const cn_field *field, const cn_field_params *params, cn_device_field *described);
#endif
