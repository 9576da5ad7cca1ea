/* Types of field: each is one file with one constant descriptor; registry.c lists them.
 *
 * A field maps a position in contracted space, and the inputs of its colour (view direction, appearance code), into a
 * density and a colour. It works in passes over panels of samples (kernel.h):
 *   encode     place -> rows of features, by `n_encoders` passes that may run at the same time
 *   logits     features -> what the density activation takes, of all samples
 *   density    the same for the samples that count, with what the colour needs kept
 *   colour     geometry features and conditioning -> colour
 *   backward   of colour and density: gradients of the features and of the weights
 *   encode_backward, position_gradient: from gradients of features to those of the table and of the place
 *
 * There are two kinds of parameters. A table has pairs of features, stored as bfloat16; only few entries get a
 * gradient in a step. It has sections (such as the levels of a grid), each updated on its own; entries behind the
 * sections get no gradient. Weights are floats, and each gets a gradient. `block` names all parameters; the tensors of
 * a tile's file follow from it. */
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

/* The parameters for evaluation. table: pairs of bfloat16. derived: what `prepare` computed from the weights. */
typedef struct cn_field_params {
    const uint32_t *table;
    const float *weights, *derived;
    float prior; /* in training: a sample's weight in the field's own loss (prior_loss); else 0 */
    /* [n_panels][CN_PANEL], or NULL: the samples' weights in their pixels, which the own loss may be multiplied by. */
    const float *visible;
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
    uint32_t together; /* so many entries, from the first on, are never divided between threads; a multiple of CN_TOUCH;
                          0: any */
} cn_field_section;

/* The name of the option of a type that learns from a teacher: the share of the schedule that it does. */
#define CN_FIELD_DISTILLED "distilled"

/* Density from a logit, in 1 / box unit of contracted space. Large logits are clamped, so that exp stays finite. */
typedef enum cn_density_activation { CN_DENSITY_EXP, CN_DENSITY_SOFTPLUS } cn_density_activation;
#define CN_DENSITY_MAX_LOGIT 15.0f

static inline float cn_density(cn_density_activation activation, float logit)
{
    const float x = fminf(logit, CN_DENSITY_MAX_LOGIT);
    return activation == CN_DENSITY_EXP ? expf(x) : x > 0 ? x + log1pf(expf(-x)) : log1pf(expf(x));
}
/* Derivative of the density by the logit. */
static inline float cn_density_gradient(cn_density_activation activation, float logit, float density)
{
    return activation == CN_DENSITY_EXP ? density : 1 / (1 + expf(-fminf(logit, CN_DENSITY_MAX_LOGIT)));
}

/* Places to encode, and where their features go. */
typedef struct cn_field_encoding {
    const uint32_t *table;
    const float *pos; /* [panel][3][lane] in [0,1] */
    size_t n_panels;
    float *enc; /* [panel][enc_rows][lane] */
} cn_field_encoding;

/* What a type that places its entries itself learns of the scene, and the table that it changes. */
typedef struct cn_field_change {
    uint64_t seed;
    uint32_t step;            /* 0: before training */
    uint32_t *table;          /* pairs of bfloat16 */
    const float (*points)[3]; /* sparse points in contracted space [0,1], before training */
    size_t n_points;
    const uint8_t *usable; /* [CN_OCC_CELLS], before training: cells that may hold matter; NULL: all */
    const float *seen;     /* [CN_OCC_CELLS], in training: cn_occupancy */
    const uint32_t *bits;  /* [CN_OCC_CELLS / 32], in training: cn_occupancy */
    /* Gives n entries of a section new values, pairs[n][2], in training. */
    void (*set)(void *user, uint32_t section, uint32_t first, uint32_t n, const float (*pairs)[2]);
    void *user;
} cn_field_change;

typedef struct cn_field_type {
    const char *name, *summary;
    const cn_field_option *options;
    uint32_t n_options;
    cn_density_activation density;
    double table_rate;  /* learning rate of the table divided by the schedule's; 0 means 1 */
    double weight_rate; /* the same of the weights */
    /* Fills the parts, sizes, blocks and sections of a field whose options and conditioning are set. CN_ERR_CONFIG. */
    cn_status (*layout)(cn_field *field);
    /* Initial values. The same seed gives the same values. table has 2 floats per entry. */
    void (*init)(const cn_field *field, uint64_t seed, float *table, float *weights);
    /* Both may be NULL. place: after `init`, writes what the table holds besides its sections. adapt: changes that
     * between two steps of training, without allocation; the same state gives the same changes. */
    void (*place)(const cn_field *field, const cn_field_change *change);
    void (*adapt)(const cn_field *field, const cn_field_change *change);
    /* Computes from the weights what the passes need besides them: n_derived floats. */
    void (*prepare)(const cn_field *field, const float *weights, float *derived);
    /* Buffers for the activations of n_panels panels. */
    void (*acts_take)(const cn_field *field, cn_arena *arena, size_t n_panels, cn_field_acts *acts);
    void (*encode)(const cn_field *field, const cn_kernel *k, uint32_t encoder, const cn_field_encoding *of);
    /* Gradients of entries of a section, from those of the features; in->d_enc has all rows of the encoding. table:
     * only for entries of the range and those that belong to no section, because other threads update the rest
     * meanwhile. */
    void (*encode_backward)(const cn_field *field, const cn_kernel *k, const uint32_t *table, uint32_t section,
                            const cn_encode_gradient *in);
    /* Gradients of n positions in [0,1] from those of their features, both in panels; d_pos[n][3] is overwritten. */
    void (*position_gradient)(const cn_field *field, const uint32_t *table, const float *pos, const float *d_enc,
                              uint32_t n, float (*d_pos)[3]);
    /* logit[n_panels][CN_PANEL] from acts->enc; the rest of acts is scratch of one panel. */
    void (*logits)(const cn_field *field, const cn_kernel *k, const cn_field_params *params, const cn_field_acts *acts,
                   size_t n_panels, float *logit);
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
    /* From d->acts->out and d->logit to d->acts->in, d->acts->enc, and weight gradients that are added to d->weights.
     */
    void (*backward)(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                     const cn_field_acts *acts, const cn_field_gradient *d, size_t n_panels);
    /* The field's own loss over n_panels panels, weighted by params->prior. `backward` adds its gradient. Called after
     * density_pass; used by tests. NULL: there is none. */
    double (*prior_loss)(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                         const cn_field_acts *acts, size_t n_panels);
    /* Signed distance in half extents of contracted space, positive in free space, from a density logit. NULL: a
     * density of this type says nothing of that. */
    float (*distance)(const cn_field *field, const float *weights, float logit);
    /* Describes the field for other devices, without the occupancy. NULL: only the processor evaluates this type. */
    void (*describe)(const cn_field *field, const cn_field_params *params, cn_device_field *described);
} cn_field_type;

extern const cn_field_type *const cn_field_types[];
extern const uint32_t cn_field_n_types;
const cn_field_type *cn_field_type_find(const char *name); /* NULL when unknown */
#endif
