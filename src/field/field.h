/* A field: a type, its settings, and what follows from them. The passes are those of its type (type.h). */
#ifndef CONURB_FIELD_FIELD_H
#define CONURB_FIELD_FIELD_H
#include "field/type.h"

/* What conditions the colour, values a ray. */
typedef struct cn_field_inputs {
    uint32_t n;         /* all of them */
    uint32_t harmonics; /* so many at the front are real spherical harmonics of the ray's direction: 0 or 16 */
} cn_field_inputs;

struct cn_field {
    const cn_field_type *type;
    cn_field_options options;
    cn_field_inputs inputs; /* values a ray that the effects give */
    /* Set by the type's layout. */
    uint32_t enc_rows, conditioning, colour_in; /* multiples of 4; colour_in is geo_rows + conditioning */
    uint32_t geo_rows;                          /* geometry features, a multiple of 4; row 0 is the density logit */
    uint32_t n_encoders, n_sections;
    cn_field_section section[CN_MAX_LEVELS];
    size_t entries;              /* of the whole table; 0: the type has none */
    size_t n_weights, n_derived; /* floats; n_weights is a multiple of 8 */
    cn_field_block block[CN_FIELD_BLOCKS];
    uint32_t n_blocks;
    /* The parts of the types that have them. */
    cn_grid grid;
    cn_mlp mlp;
    cn_stack stack;
};

/* CN_ERR_CONFIG for an unknown type and for sizes that make no sense. */
CN_NODISCARD cn_status cn_field_layout(cn_field *field, const cn_field_options *options, cn_field_inputs inputs);

/* For a type's layout: an option's value; another block. */
double cn_field_option_of(const cn_field *field, const char *name);
void cn_field_add_block(cn_field *field, const char *name, cn_field_storage storage, uint64_t rows, uint64_t columns,
                        size_t offset);

/* Light from what the colour pass gives: exp below 1, so that it stays positive and dark tones are even; a line above,
 * so that a place that training never saw cannot outshine all by a few units. */
static inline float cn_field_light(float x)
{
    return x < 0 ? expf(x) : 1 + fminf(x, 1e6f);
}
/* Its gradient, from the light. */
static inline float cn_field_light_gradient(float light)
{
    return light < 1 ? light : 1;
}

/* From the gradient of a contracted place to that of the place itself, x in box units. */
void cn_field_uncontract_gradient(const float x[3], const float d_pos[3], float d_x[3]);
#endif
