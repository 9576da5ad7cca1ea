/* The radiance field: multiresolution hash grid, density MLP, colour MLP, as in Mueller et al. 2022 (Instant-NGP).
 *
 * Layout of the parameters. Table: [entries][2], level after level. Weights: one flat buffer of row-major [out][in]
 * matrices without biases, in order density 0 [width][2 * levels], density 1 [16][width], colour 0 [width][16 +
 * columns], colour 1 [width][width], colour 2 [4][width] (row 3 is padding). Row 0 of the 16 geometry features is the
 * density logit: sigma = exp(logit), in 1 / box unit of contracted space. Colour is cn_field_light(output), linear
 * light. `columns` are the effects' inputs of the colour head, one value a ray each, padded to a multiple of 4. */
#ifndef CONURB_FIELD_FIELD_H
#define CONURB_FIELD_FIELD_H
#include "conurb/base.h"
#include "base/arena.h"
#include "kernel/kernel.h"

#include <math.h>

#define CN_GEO 16 /* geometry features */

typedef struct cn_field_config {
    uint32_t levels, log2_table, base_resolution, finest_resolution;
    uint32_t density_width, colour_width; /* multiples of 4 */
    uint32_t columns;                     /* as wanted by the effects; padded in the layout */
} cn_field_config;

enum { CN_LAYER_DENSITY0, CN_LAYER_DENSITY1, CN_LAYER_COLOUR0, CN_LAYER_COLOUR1, CN_LAYER_COLOUR2, CN_LAYERS };
typedef struct cn_layer {
    uint32_t out, in;
    size_t offset;
} cn_layer; /* offset in floats in the weight buffer */

typedef struct cn_field {
    cn_field_config config;
    cn_level level[CN_MAX_LEVELS];
    uint32_t enc_rows, columns, colour_in; /* 2 * levels padded to 4; padded columns; 16 + columns */
    size_t entries;                        /* of the whole table */
    cn_layer layer[CN_LAYERS];
    size_t n_weights; /* multiple of 8 */
} cn_field;

/* CN_ERR_CONFIG when a size is out of range (levels 1..24, log2_table 8..24, widths 4..256 in fours). */
CN_NODISCARD cn_status cn_field_layout(cn_field *field, const cn_field_config *config);
/* Table uniform in +-1e-4, weights uniform by He; same seed, same values. table has 2 * entries floats. */
void cn_field_init(const cn_field *field, uint64_t seed, float *table, float *weights);
/* Every matrix transposed to [in][out], at the same offsets. */
void cn_field_transpose(const cn_field *field, const float *weights, float *transposed);

/* Light from what the colour head gives: exp below 1, so that it stays positive and dark tones are even; a line above,
 * so that a place that training never saw cannot outshine all by a few units. */
static inline float cn_field_light(float x)
{
    return x < 0 ? expf(x) : 1 + fminf(x, 1e6f);
}
/* Its slope, from the light. */
static inline float cn_field_light_slope(float light)
{
    return light < 1 ? light : 1;
}

/* What evaluation needs: bfloat16 pairs and both weight layouts. */
typedef struct cn_field_params {
    const uint32_t *table;
    const float *weights, *transposed;
} cn_field_params;

/* Activations of a run of panels, each [n_panels][rows][CN_PANEL]. */
typedef struct cn_field_acts {
    float *enc;     /* enc_rows */
    float *hidden;  /* density_width */
    float *in;      /* colour_in: geometry features, then columns (filled by the caller before cn_field_colour) */
    float *c0, *c1; /* colour_width */
    float *out;     /* 4: colour, before cn_field_light */
} cn_field_acts;
void cn_field_acts_take(const cn_field *field, cn_arena *arena, size_t n_panels, cn_field_acts *acts);

/* Encodes one level of n_panels panels into enc. */
void cn_field_encode_level(const cn_field *field, const cn_kernel *k, const uint32_t *table, uint32_t level,
                           const float *pos, size_t n_panels, float *enc);
/* Density logits only: logit[n_panels][CN_PANEL]. hidden is scratch of one panel (density_width rows), geo of CN_GEO
 * rows. */
void cn_field_logits(const cn_field *field, const cn_kernel *k, const cn_field_params *params, const float *enc,
                     size_t n_panels, float *hidden, float *geo, float *logit);
/* All geometry features, geo[n_panels][CN_GEO][CN_PANEL]; hidden is scratch of one panel. */
void cn_field_geometry(const cn_field *field, const cn_kernel *k, const cn_field_params *params, const float *enc,
                       size_t n_panels, float *hidden, float *geo);
/* Density MLP into the first 16 rows of acts->in, keeping acts->hidden; then, once the columns are filled, the colour
 * MLP. */
void cn_field_density(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                      const cn_field_acts *acts, size_t n_panels);
void cn_field_colour(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                     const cn_field_acts *acts, size_t n_panels);
/* Backward of the colour MLP alone, to d->in, without weight gradients. */
void cn_field_colour_backward(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                              const cn_field_acts *acts, const cn_field_acts *d, size_t n_panels);
/* Backward of both. d->out holds the gradient of acts->out, d_logit[n_panels][CN_PANEL] that of the density logits
 * (added to row 0). On return d->in holds the gradient of the colour head's input, d->enc that of the encoding, and dw
 * (n_weights) has the weight gradients added. */
void cn_field_backward(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                       const cn_field_acts *acts, const cn_field_acts *d, const float *d_logit, size_t n_panels,
                       float *dw);
/* Gradients of n samples' positions (in [0,1]) from those of their encodings; pos and d_enc in panels, d_pos[n][3]. */
void cn_field_slope(const cn_field *field, const uint32_t *table, const float *pos, const float *d_enc, uint32_t n,
                    float (*d_pos)[3]);
/* From the gradient of a contracted position to that of the uncontracted one x (box units). */
void cn_field_uncontract_slope(const float x[3], const float d_pos[3], float d_x[3]);
#endif
