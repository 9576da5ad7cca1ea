/* Places models beside each other by Ceres: one similarity each, that all agree with the points that two models share
 * and with surveyed places. No exception leaves it. */
#ifndef CONURB_BRIDGE_JOIN_H
#define CONURB_BRIDGE_JOIN_H
#include "conurb/base.h"
#ifdef __cplusplus
extern "C" {
#endif

/* world = scale * rotation * (x - centre) + place. centre: a point in the middle of the model, which stays; scale,
 * rotation (row-major) and place are changed. */
typedef struct cn_join_model {
    double scale, rotation[9], centre[3], place[3];
    bool fixed;
} cn_join_model;
/* The same point in two models. sigma: standard deviation of each coordinate of the difference, in the world. */
typedef struct cn_join_tie {
    uint32_t a, b;
    double in_a[3], in_b[3], sigma;
} cn_join_tie;
/* A point of a model, and where it is in the world; sigma 0: nothing is known of the axis. */
typedef struct cn_join_anchor {
    uint32_t model;
    double at[3], place[3], sigma[3];
} cn_join_anchor;
typedef struct cn_join_problem {
    cn_join_model *models;
    const cn_join_tie *ties;
    const cn_join_anchor *anchors;
    uint32_t n_models;
    size_t n_ties, n_anchors;
} cn_join_problem;

/* Moves the models that are not fixed to the least squares, with Cauchy's loss of 3 sigmas. Without anchors at least
 * one model must be fixed. One thread: the same problem gives the same bytes. On failure nothing is changed.
 * CN_ERR_DATA: a value is not finite, an index is out of range, or Ceres finds no step. CN_ERR_INTERRUPTED: asked to
 * stop. */
CN_NODISCARD cn_status cn_ceres_join(const cn_context *ctx, const cn_join_problem *problem);

#ifdef __cplusplus
}
#endif
#endif
