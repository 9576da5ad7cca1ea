/* Fits a scene to control points and to GPS of stated accuracy. */
#ifndef CONURB_POSE_CONTROL_FIT_H
#define CONURB_POSE_CONTROL_FIT_H
#include "pose/control.h"

/* What became of a point. Residuals: place by the photos minus surveyed place, east, north, up, metres. */
typedef struct cn_control_residual {
    bool measured;                     /* at least two posed photos show it from different sides */
    uint32_t n_views;                  /* posed photos with a mark */
    double pull_m[3];                  /* the same of its place in the adjustment, which knows the surveyed one too */
    double residual_m[3], before_m[3]; /* NaN where it is not measured; before: aligned by the photos' GPS alone */
    double error_px;                   /* mean distance of its marks from where its place projects to */
} cn_control_residual;
typedef struct cn_control_fit {
    cn_control_residual *points;           /* as many as the control points, in their order */
    uint32_t n_points, n_control, n_check; /* n_control, n_check: measured ones */
    bool georeferenced_before, adjusted;
    double control_rms_m[3], check_rms_m[3], check_before_m[3]; /* by axis; NaN where there are none */
} cn_control_fit;

/* Whether the photos' GPS is stated to be so accurate that the adjustment should use it. */
bool cn_control_has_accurate_gps(const cn_photo_index *index);
/* Brings the aligned scene nearer to the control points, and to GPS with its stated or measured uncertainty: first by a
 * similarity, where at least three control points that are not on a line are measured; then, where the scene has sparse
 * points, by bundle adjustment. Residuals of check points are only measured. `frame` is changed
 * with the scene; where photos have no GPS, it is made about the control points. The caller frees *fit. CN_ERR_DATA:
 * the photos have no GPS, and fewer than three control points can be measured. */
typedef struct cn_control_task {
    const cn_control *control; /* NULL: GPS alone */
    const cn_photo_index *index;
    const cn_pose_options *options;
} cn_control_task;
CN_NODISCARD cn_status cn_control_apply(const cn_context *ctx, const cn_control_task *task, cn_scene *scene,
                                        cn_frame *frame, cn_control_fit *fit);
void cn_control_fit_deinit(cn_control_fit *fit);

/* The parts: see control_place.c. Surveyed places in the local frame; it is made about them when it has no
 * georeference. */
CN_NODISCARD cn_status cn_control_places(const cn_control *control, cn_frame *frame, double (*places)[3]);
/* GPS of each view as a prior: stated accuracy, else what the alignment left over. */
struct cn_place_prior;
CN_NODISCARD cn_status cn_control_gps(const cn_scene *scene, const cn_photo_index *index, const cn_frame *frame,
                                      struct cn_place_prior *priors);
/* RMS of the views' centres from their GPS, of those within max_error_m, into the frame. */
CN_NODISCARD cn_status cn_control_measure_gps(const cn_scene *scene, const cn_photo_index *index, double max_error_m,
                                              cn_frame *frame);
#endif
