#include "../field/options.h"
#include "block.h"

#include "field/occupancy.h"
#include "math/linalg.h"
#include "tile/model.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* All features are 1 and all weights 0.2, so every hidden value is known: the last layer is scaled to give the
 * logarithm of the colour. */
static void fill_weights(const cn_field *field, const float rgb[3], float *weights)
{
    for (size_t i = 0; i < field->n_weights; i++)
        weights[i] = 0.2f;
    const float hidden = 0.2f * (float)(2 * field->grid.n_levels),
                geo = 0.2f * hidden * (float)field->mlp.density_width;
    for (uint32_t o = 0; o < CN_GEO; o++) /* a density of e^6, whatever the sizes */
        for (uint32_t i = 0; i < field->mlp.density_width; i++)
            weights[field->mlp.layer[CN_LAYER_DENSITY1].offset + o * field->mlp.density_width + i] = 0.2f * 6 / geo;
    const uint32_t width = field->mlp.colour_width;
    const float c0 = 0.2f * 6 * CN_GEO, c1 = 0.2f * c0 * (float)width;
    const cn_layer *last = &field->mlp.layer[CN_LAYER_COLOUR2];
    for (uint32_t o = 0; o < 3; o++)
        for (uint32_t i = 0; i < width; i++)
            weights[last->offset + (size_t)o * width + i] = logf(rgb[o]) / (c1 * (float)width);
}

static void fill_ground(const cn_box *box, uint32_t *bits)
{
    for (uint32_t c = 0; c < CN_OCC_CELLS; c++) {
        float x[3];
        cn_occupancy_centre(c, x);
        const bool inside = fabsf(x[0]) <= 1 && fabsf(x[1]) <= 1 && fabsf(x[2]) <= 1;
        if (inside && x[2] * box->half_extent[2] + box->centre[2] < 0) bits[c / 32] |= 1u << c % 32;
    }
}

cn_status block_write(const block *b, const char *path)
{
    const cn_box box = { .centre = { b->x, b->y, 0 },
                         .half_extent = { BLOCK_EXTENT, BLOCK_EXTENT, BLOCK_EXTENT },
                         .near_m = 1,
                         .far_m = 30,
                         .step = 1.0f / 256 };
    const uint32_t width = b->width ? b->width : 16;
    const cn_field_options config = hash_options((hash_sizes){ .levels = b->levels ? b->levels : 4,
                                                               .log2_table = b->log2_table ? b->log2_table : 10,
                                                               .base_resolution = 16,
                                                               .finest_resolution = 512,
                                                               .density_width = width,
                                                               .colour_width = width });
    static const char *const names[BLOCK_PHOTOS] = { "dim.jpg", "bright.jpg" };
    static const float constants[2 * BLOCK_PHOTOS] = { -1, 0, 1, 0 }, nothing[4096];
    const char *effects[2];
    uint32_t n_effects = 0;
    if (b->exposure) effects[n_effects++] = "exposure";
    if (b->seen) effects[n_effects++] = "sky";
    cn_field field;
    cn_effect_pack pack;
    CN_TRY(cn_field_layout(&field, &config, (cn_field_inputs){ 0 }));
    CN_TRY(cn_effect_pack_make(&pack, n_effects, effects, BLOCK_PHOTOS));
    uint16_t *table = malloc(2 * field.entries * sizeof *table);
    float *weights = malloc(field.n_weights * sizeof *weights);
    uint32_t *bits = calloc(CN_OCC_CELLS / 32, sizeof *bits);
    for (size_t i = 0; i < 2 * field.entries; i++)
        table[i] = 0x3f80; /* 1 */
    fill_weights(&field, b->rgb, weights);
    fill_ground(&box, bits);
    const cn_tile_parts parts = { .id = b->id,
                                  .parent_hash = "",
                                  .radius_m = 6,
                                  .box = &box,
                                  .field = &field,
                                  .table = table,
                                  .weights = weights,
                                  .occupancy = bits,
                                  .seen = b->seen,
                                  .pack = &pack,
                                  .names = names,
                                  .n_names = BLOCK_PHOTOS,
                                  .n_trained = BLOCK_PHOTOS,
                                  .constants = constants,
                                  .effect_params = nothing,
                                  .shared = nothing,
                                  .steps = 1 };
    const cn_status status = cn_tile_save(&parts, path);
    free(table);
    free(weights);
    free(bits);
    return status;
}

void block_look_down(double x, double y, double z, cn_view *view)
{
    static const double down[9] = { 1, 0, 0, 0, -1, 0, 0, 0, -1 };
    const double centre[3] = { x, y, z };
    memcpy(view->rotation, down, sizeof down);
    cn_mat3_vec(down, centre, view->translation);
    for (int k = 0; k < 3; k++)
        view->translation[k] = -view->translation[k];
}
