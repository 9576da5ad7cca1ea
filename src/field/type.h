/* Types of field: one file and one constant descriptor each; registry.c lists them.
 *
 * A field turns a place in contracted space, and what conditions its colour (view direction, appearance code), into a
 * density and a colour. It works in passes over panels of samples (kernel.h):
 *   encode     place -> rows of features, by `n_encoders` passes that may run at the same time
 *   logits     features -> what the density activation takes, of all samples
 *   density    the same for the samples that count, with what the colour needs kept
 *   colour     geometry features and conditioning -> colour
 *   backward   of colour and density: gradients of the features and of the weights
 *   encode_backward, position_gradient: from gradients of features to those of the table and of the place
 *
 * Parameters are of two kinds. A table has pairs of features, stored as bfloat16, and gradients for few entries a step:
 * it lies in sections (a level of a grid, say), each updated by itself. Weights are plain floats with a gradient each.
 * `block` names them all: the sections of a tile's file follow from it. */
#ifndef CONURB_FIELD_TYPE_H
#define CONURB_FIELD_TYPE_H
#include "conurb/field.h"
#include "device/trace.h"
#include "field/acts.h"
#include "field/grid.h"
#include "field/mlp.h"
#include "field/stack.h"

#include <math.h>

typedef struct cn_field cn_field;

/* What evaluation needs. table: pairs of bfloat16. derived: what `prepare` made of the weights. */
typedef struct cn_field_params {
    const uint32_t *table;
    const float *weights, *derived;
    float prior; /* in training: the weight of a sample in what the field itself asks of places (smoothness); else 0 */
} cn_field_params;

typedef enum cn_field_storage { CN_FIELD_TABLE, CN_FIELD_WEIGHTS } cn_field_storage;

/* A named block of parameters: a tensor of the tile's file. */
typedef struct cn_field_block {
    const char *name; /* static: "hash.table", "density.0" */
    cn_field_storage storage;
    uint64_t dims[2];
    size_t offset; /* in entries of the table, or floats of the weights */
} cn_field_block;
enum { CN_FIELD_BLOCKS = 16 };

/* Entries of the table that are updated together. */
typedef struct cn_field_section {
    uint32_t first, entries;
} cn_field_section;

/* How a logit becomes density, in 1 / box unit of contracted space. Large logits are cut, so that exp stays finite. */
typedef enum cn_density_activation { CN_DENSITY_EXP, CN_DENSITY_SOFTPLUS } cn_density_activation;
#define CN_DENSITY_MAX_LOGIT 15.0f

static inline float cn_density(cn_density_activation activation, float logit)
{
    const float x = fminf(logit, CN_DENSITY_MAX_LOGIT);
    return activation == CN_DENSITY_EXP ? expf(x) : x > 0 ? x + log1pf(expf(-x)) : log1pf(expf(x));
}
/* Of the density, by the logit. */
static inline float cn_density_gradient(cn_density_activation activation, float logit, float density)
{
    return activation == CN_DENSITY_EXP ? density : 1 / (1 + expf(-fminf(logit, CN_DENSITY_MAX_LOGIT)));
}

typedef struct cn_field_type {
    const char *name, *summary;
    const cn_field_option *options;
    uint32_t n_options;
    cn_density_activation density;
    double weight_rate; /* learning rate of the weights over that of the table; 0 stands for 1 */
    /* Fills the parts, sizes, blocks and sections of a field whose options and conditioning are set. CN_ERR_CONFIG. */
    cn_status (*layout)(cn_field *field);
    /* First values. The same seed gives the same values. table has 2 floats an entry. */
    void (*init)(const cn_field *field, uint64_t seed, float *table, float *weights);
    /* Makes of the weights what the passes read beside them; n_derived floats. */
    void (*prepare)(const cn_field *field, const float *weights, float *derived);
    /* Buffers for the activations of n_panels panels. */
    void (*acts_take)(const cn_field *field, cn_arena *arena, size_t n_panels, cn_field_acts *acts);
    void (*encode)(const cn_field *field, const cn_kernel *k, const uint32_t *table, uint32_t encoder, const float *pos,
                   size_t n_panels, float *enc);
    /* Gradients of entries of a section, from those of the features. */
    void (*encode_backward)(const cn_field *field, const cn_kernel *k, uint32_t section, const cn_encode_gradient *in);
    /* Gradients of n places in [0,1] from those of their features, both in panels; d_pos[n][3] is overwritten. */
    void (*position_gradient)(const cn_field *field, const uint32_t *table, const float *pos, const float *d_enc,
                              uint32_t n, float (*d_pos)[3]);
    /* logit[n_panels][CN_PANEL] from enc; acts is scratch of one panel. */
    void (*logits)(const cn_field *field, const cn_kernel *k, const cn_field_params *params, const cn_field_acts *acts,
                   const float *enc, size_t n_panels, float *logit);
    /* geo[n_panels][geo_rows][CN_PANEL] from acts->enc; the rest of acts is scratch. */
    void (*geometry)(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                     const cn_field_acts *acts, size_t n_panels, float *geo);
    /* From acts->enc to the first geo_rows rows of acts->in. */
    void (*density_pass)(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                         const cn_field_acts *acts, size_t n_panels);
    /* From acts->in to acts->out. */
    void (*colour_pass)(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                        const cn_field_acts *acts, size_t n_panels);
    /* From d->out to d->in, without gradients of weights. */
    void (*colour_backward)(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                            const cn_field_acts *acts, const cn_field_acts *d, size_t n_panels);
    /* From d->out and d_logit[n_panels][CN_PANEL] to d->in, d->enc, and weight gradients that are added to dw. */
    void (*backward)(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                     const cn_field_acts *acts, const cn_field_acts *d, const float *d_logit, size_t n_panels,
                     float *dw);
    /* What the field itself asks of n_panels panels of places, as params->prior weighs it: `backward` gives its
     * gradient. After density_pass; for tests. NULL: nothing. */
    double (*prior_loss)(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                         const cn_field_acts *acts, size_t n_panels);
    /* The field as other devices know it, but for what lies around it (occupancy). NULL: the processor alone evaluates
     * fields of this type. */
    void (*describe)(const cn_field *field, const cn_field_params *params, cn_device_field *described);
} cn_field_type;

extern const cn_field_type *const cn_field_types[];
extern const uint32_t cn_field_n_types;
const cn_field_type *cn_field_type_find(const char *name); /* NULL when unknown */
#endif
