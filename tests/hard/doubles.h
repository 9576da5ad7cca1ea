/* The kernels in double, in the plainest way: what floats are held against. Positions, tables and inputs are those that
 * the kernels get. */
#ifndef CONURB_TESTS_DOUBLES_H
#define CONURB_TESTS_DOUBLES_H
#include "kernel/kernel.h"

/* Cell, fraction and entry of the eight corners round a position, and their weights. */
typedef struct double_corners {
    uint32_t index[8];
    double weight[8];
} double_corners;
double_corners double_corners_of(const cn_level *level, const float pos[3]);
/* Contracted position and local scale of a point in box units. */
double double_contract(const double x[3], double u[3]);
#endif
