/* A field: a type, its settings, and what follows from them. The passes are those of its type (type.h). */
#ifndef CONURB_FIELD_FIELD_H
#define CONURB_FIELD_FIELD_H
#include "field/cloud.h"
#include "field/tiny.h"
#include "field/type.h"

/* The inputs of the colour that are equal along a ray. */
typedef struct cn_field_inputs {
    uint32_t n;         /* all of them */
    uint32_t harmonics; /* the first 0 or 16 values are real spherical harmonics of the ray's direction */
} cn_field_inputs;

struct cn_field {
    const cn_field_type *type;
    cn_field_options options;
    cn_field_inputs inputs; /* values per ray that the effects give */
    /* Set by the type's layout. */
    uint32_t enc_rows, conditioning, colour_in; /* multiples of 4; colour_in is geo_rows + conditioning */
    uint32_t geo_rows;                          /* geometry features, a multiple of 4; row 0 is the density logit */
    uint32_t n_encoders, n_sections;
    cn_field_section section[CN_MAX_LEVELS];
    size_t entries;              /* of the whole table; 0: the type has none */
    size_t fixed;                /* the last entries of the table, so many, belong to no section */
    size_t n_weights, n_derived; /* floats; n_weights is a multiple of 8 */
    cn_field_block block[CN_FIELD_BLOCKS];
    uint32_t n_blocks;
    /* Parts that only some types have. */
    cn_grid grid;
    cn_mlp mlp;
    cn_stack stack;
    cn_cloud cloud;
    cn_kilo kilo;
};

/* CN_ERR_CONFIG: an unknown type, or invalid sizes. */
CN_NODISCARD cn_status cn_field_layout(cn_field *field, const cn_field_options *options, cn_field_inputs inputs);

/* For a type's layout: read an option's value; add a block. */
double cn_field_option_of(const cn_field *field, const char *name);
void cn_field_add_block(cn_field *field, const char *name, cn_field_storage storage, uint64_t rows, uint64_t columns,
                        size_t offset);

/* Linear light from the output of the colour pass. Below 1 it is exp, which stays positive and resolves dark tones.
 * Above it is linear, so that places that training never saw cannot become extremely bright. */
static inline float cn_field_light(float x)
{
    return x < 0 ? expf(x) : 1 + fminf(x, 1e6f);
}
/* Its derivative, computed from the light. */
static inline float cn_field_light_gradient(float light)
{
    return light < 1 ? light : 1;
}

/* Converts the gradient of a contracted position to that of the position x, in box units. */
void cn_field_uncontract_gradient(const float x[3], const float d_pos[3], float d_x[3]);
#endif
