/* The sizes of a grid of tiny networks. Private to field/. */
#ifndef CONURB_FIELD_TINY_H
#define CONURB_FIELD_TINY_H
#include "field/mlp.h"

typedef struct cn_kilo {
    uint32_t cells, networks;              /* cells along an axis; networks, a power of two */
    uint32_t frequencies, inputs, entries; /* inputs of a network, and entries of the table that it takes */
    cn_layer colour[2];
} cn_kilo;
#endif
