/* The two small networks behind an encoding: density, then colour (Mueller et al. 2022).
 *
 * Weights: one flat buffer of row-major [out][in] matrices without biases, in the order density 0 [density_width]
 * [rows of features], density 1 [16][density_width], colour 0 [colour_width][16 + conditioning], colour 1
 * [colour_width] [colour_width], colour 2 [4][colour_width] (row 3 is padding). Row 0 of the 16 geometry features is
 * the density logit. Colour is cn_field_light(output), linear light. */
#ifndef CONURB_FIELD_MLP_H
#define CONURB_FIELD_MLP_H
#include "base/arena.h"
#include "conurb/base.h"
#include "field/acts.h"
#include "kernel/kernel.h"

enum { CN_LAYER_DENSITY0, CN_LAYER_DENSITY1, CN_LAYER_COLOUR0, CN_LAYER_COLOUR1, CN_LAYER_COLOUR2, CN_LAYERS };
typedef struct cn_layer {
    uint32_t out, in;
    size_t offset; /* in floats in the weight buffer */
} cn_layer;

typedef struct cn_mlp {
    uint32_t enc_rows, colour_in; /* both padded to a multiple of 4. An encoding may have more rows than those that the
                                     density network reads: then the type raises enc_rows after cn_mlp_layout. */
    uint32_t density_width, colour_width;
    cn_layer layer[CN_LAYERS];
    size_t n_weights; /* a multiple of 8 */
} cn_mlp;

/* conditioning: number of values per ray that the colour network takes besides the geometry features; padded to a
 * multiple of 4. CN_ERR_CONFIG: a width is not a multiple of 4 from 4 to 256. */
CN_NODISCARD cn_status cn_mlp_layout(cn_mlp *mlp, uint32_t enc_rows, uint32_t density_width, uint32_t colour_width,
                                     uint32_t conditioning);
/* Uniform initialisation of He et al. (2015). */
void cn_mlp_init(const cn_mlp *mlp, uint64_t seed, float *weights);
/* Every matrix transposed to [in][out], at the same offsets. */
void cn_mlp_transpose(const cn_mlp *mlp, const float *weights, float *transposed);

typedef struct cn_mlp_params {
    const float *weights, *transposed;
} cn_mlp_params;

/* Indices of the hidden layers in cn_field_acts.own. */
enum { CN_MLP_HIDDEN, CN_MLP_COLOUR0, CN_MLP_COLOUR1 };
void cn_mlp_acts_take(const cn_mlp *mlp, cn_arena *arena, size_t n_panels, cn_field_acts *acts);

/* Density logits only: logit[n_panels][CN_PANEL], from acts->enc; the rest of acts is scratch of one panel. */
void cn_mlp_logits(const cn_mlp *mlp, const cn_kernel *k, const cn_mlp_params *params, const cn_field_acts *acts,
                   size_t n_panels, float *logit);
/* All geometry features, geo[n_panels][CN_GEO][CN_PANEL], from acts->enc; the rest of acts is scratch of one panel. */
void cn_mlp_geometry(const cn_mlp *mlp, const cn_kernel *k, const cn_mlp_params *params, const cn_field_acts *acts,
                     size_t n_panels, float *geo);
/* The density network; writes the first 16 rows of acts->in. */
void cn_mlp_density(const cn_mlp *mlp, const cn_kernel *k, const cn_mlp_params *params, const cn_field_acts *acts,
                    size_t n_panels);
/* The colour network. The conditioning must be in acts->in. */
void cn_mlp_colour(const cn_mlp *mlp, const cn_kernel *k, const cn_mlp_params *params, const cn_field_acts *acts,
                   size_t n_panels);
/* Backward of the colour network alone, to d->in, without weight gradients. */
void cn_mlp_colour_backward(const cn_mlp *mlp, const cn_kernel *k, const cn_mlp_params *params,
                            const cn_field_acts *acts, const cn_field_acts *d, size_t n_panels);
/* Backward of both. d->acts->out holds the gradient of acts->out, d->logit that of the density logits (added to row 0).
 * On return d->acts->in holds the gradient of the colour network's input, d->acts->enc that of the encoding, and
 * d->weights (n_weights) has the weight gradients added. */
void cn_mlp_backward(const cn_mlp *mlp, const cn_kernel *k, const cn_mlp_params *params, const cn_field_acts *acts,
                     const cn_field_gradient *d, size_t n_panels);
#endif
