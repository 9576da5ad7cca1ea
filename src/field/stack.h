/* Layers of a deep network, for types whose depth is a setting. Row-major [out][in] matrices in one buffer; a row of
 * ones in the encoding stands for the biases of the layers that read it. Private to field/. */
#ifndef CONURB_FIELD_STACK_H
#define CONURB_FIELD_STACK_H
#include "field/mlp.h"

enum { CN_STACK_DEPTH = 8 };

typedef struct cn_stack {
    uint32_t depth, width,
        skip; /* number of hidden layers; their units; the layer that reads the encoding again, 0: none */
    uint32_t frequencies, direction_rows; /* of place; rows of the direction's encoding, a multiple of 4 */
    uint32_t row[CN_STACK_DEPTH];         /* first row of a hidden layer among the kept ones */
    uint32_t rows;                        /* all kept rows of a panel */
    cn_layer hidden[CN_STACK_DEPTH], head, colour[2];
} cn_stack;
#endif
