/* The kernels in double, as simple as possible. The float kernels are compared with them, for the same positions,
 * tables and inputs. */
#ifndef CONURB_TESTS_DOUBLES_H
#define CONURB_TESTS_DOUBLES_H
#include "kernel/kernel.h"

/* The eight corners around a position: cell, fraction, entries and weights. */
typedef struct double_corners {
    uint32_t index[8];
    double weight[8];
} double_corners;
double_corners double_corners_of(const cn_level *level, const float pos[3]);
/* Contracted position and local scale of a point in box units. */
double double_contract(const double x[3], double u[3]);
#endif
