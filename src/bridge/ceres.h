/* A C interface of Ceres: bundle adjustment (Triggs et al. 2000) with priors on camera centres and points. One call at
 * a time per problem; calls on different problems may run in different threads. No exception leaves it. It raises the
 * level of glog's messages to fatal ones in the whole process. */
#ifndef CONURB_BRIDGE_CERES_H
#define CONURB_BRIDGE_CERES_H
#include "conurb/base.h"
#ifdef __cplusplus
extern "C" {
#endif

/* lens: COLMAP's id of a lens model, as cn_lens; params in COLMAP's order. */
#define CN_ADJUST_SPHERE 17 /* EQUIRECTANGULAR */
typedef struct cn_adjust_camera {
    int lens;
    uint32_t fixed;             /* bit i: params[i] stays as it is; CN_ADJUST_ALL_FIXED: the whole camera */
    double params[8], sigma[8]; /* sigma: standard deviation of what params are at the start; 0: nothing is known */
} cn_adjust_camera;
#define CN_ADJUST_ALL_FIXED 0xffu

/* x_cam = rotation * x_world + translation, as cn_view. The prior is of the camera's centre. */
typedef struct cn_adjust_pose {
    double rotation[9], translation[3];
    uint32_t camera; /* index into cameras */
    bool fixed;
    double place[3], place_sigma[3]; /* standard deviation of each axis of the prior; 0: no prior on this axis */
} cn_adjust_pose;

/* A tie point, or with a prior a control point. */
typedef struct cn_adjust_point {
    double xyz[3];
    bool fixed;
    double place[3], place_sigma[3]; /* as above */
} cn_adjust_point;

/* Where a pose's photo shows a point; pixels as in cn_observation. */
typedef struct cn_adjust_observation {
    uint32_t pose, point;
    float x_px, y_px, sigma_px; /* sigma_px: standard deviation, above 0 */
} cn_adjust_observation;

typedef struct cn_adjust_options {
    uint32_t max_iterations;
    unsigned n_threads;  /* 1: the same problem gives the same bytes; more: its last digits vary. 0 is 1 */
    size_t max_bytes;    /* memory at most, by an estimate; 0: no limit */
    double loss_sigmas;  /* Cauchy's loss of observations: errors far above this weigh little; 0: squares */
    double place_sigmas; /* the same for the priors of centres */
    double point_sigmas; /* the same for the priors of points */
    const char *stage;   /* for progress: "poses" */
} cn_adjust_options;
/* 100 iterations, one thread, no limit of memory, a loss of 2 sigmas for observations and of 3 for priors. */
cn_adjust_options cn_adjust_options_default(void);

/* The arrays are the caller's; poses, cameras and points are changed in place. */
typedef struct cn_adjust_problem {
    cn_adjust_camera *cameras;
    cn_adjust_pose *poses;
    cn_adjust_point *points;
    const cn_adjust_observation *observations;
    uint32_t n_cameras, n_poses, n_points;
    uint64_t n_observations;
} cn_adjust_problem;

typedef struct cn_adjust_result {
    uint32_t iterations;
    bool converged;           /* false: it stopped at max_iterations */
    double cost, cost_before; /* half the sum of losses of errors over their sigmas */
    uint64_t n_behind;        /* observations of points behind their camera, which were left out */
} cn_adjust_result;

/* Moves poses, points and cameras to where observations and priors agree best. Without priors and fixed poses, place,
 * turn and scale of the whole are not determined, and stay about as they were. On failure nothing is changed.
 * Progress: an iteration a unit. CN_ERR_DATA: a value is not finite, an index is out of range, or Ceres finds no step.
 * CN_ERR_NOMEM: it would need more than max_bytes; the message says how much. CN_ERR_INTERRUPTED: asked to stop. */
CN_NODISCARD cn_status cn_ceres_adjust(const cn_context *ctx, const cn_adjust_problem *problem,
                                       const cn_adjust_options *options, cn_adjust_result *result);
/* The memory that the problem needs, in bytes; an estimate on the large side. */
size_t cn_ceres_bytes(const cn_adjust_problem *problem);

/* From the centre of a camera to a point: a direction of unit length, in the world's axes. */
typedef struct cn_bearing {
    uint32_t centre, point;
    double direction[3];
} cn_bearing;
typedef struct cn_bearings {
    double (*centres)[3], (*points)[3]; /* the caller's; changed in place */
    const cn_bearing *bearings;
    uint32_t n_centres, n_points;
    uint64_t n_bearings;
} cn_bearings;
/* Places cameras and points, whose start may be drawn at random, so that they agree with all directions (global
 * positioning of GLOMAP, Pan et al. 2024): of direction - d * (point - centre), with a d of at least 0 for each
 * direction, the sum of Huber's losses is least. Place, and scale, of the whole are not determined. Of the options
 * max_iterations, n_threads and stage count. Errors as cn_ceres_adjust; on failure nothing is changed. */
CN_NODISCARD cn_status cn_ceres_place(const cn_context *ctx, const cn_bearings *problem,
                                      const cn_adjust_options *options, cn_adjust_result *result);

#ifdef __cplusplus
}
#endif
#endif
