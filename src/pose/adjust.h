/* Bundle adjustment of a scene with priors, and places of points that photos show. */
#ifndef CONURB_POSE_ADJUST_H
#define CONURB_POSE_ADJUST_H
#include "bridge/ceres.h"
#include "conurb/pose.h"

/* A place with a standard deviation on each axis; 0: nothing is known of the axis. */
typedef struct cn_place_prior {
    double place[3], sigma[3];
} cn_place_prior;

/* Points beside those of the scene, such as control points. */
typedef struct cn_marked_point {
    double xyz[3]; /* in the scene's frame; changed by the adjustment */
    cn_place_prior prior;
} cn_marked_point;
typedef struct cn_point_mark {
    uint32_t point, view; /* indices into the marked points and the scene's views */
    double x_px, y_px;
} cn_point_mark;

typedef struct cn_scene_adjustment {
    const cn_place_prior *centres; /* one a view, in the scene's frame; NULL: none */
    const bool *fixed;             /* views that stay; NULL: none */
    cn_marked_point *points;
    const cn_point_mark *marks;
    uint32_t n_points, n_marks;
    double mark_sigma_px;                      /* of marks; that of tie points is measured */
    bool keep_lenses, keep_focal, keep_centre; /* centre: the principal point */
    cn_adjust_options options;
} cn_scene_adjustment;

/* Adjusts poses, sparse points, marked points, and the cameras' lenses. Principal points are held within some
 * thousandths of the picture of where they were, for near-parallel views leave them open. Lenses of cameras with few
 * observations stay, and those that it would bend beyond what lenses do. Tie points weigh by their median error before.
 * On failure the scene is as it was. Errors as cn_ceres_adjust. */
CN_NODISCARD cn_status cn_scene_adjust(const cn_context *ctx, cn_scene *scene, cn_scene_adjustment *how,
                                       cn_adjust_result *result);

/* Where a point is that n views show: nearest to the rays, then with the smallest reprojection error. *angle_deg: the
 * largest angle between two rays; below about one the place is hardly known. *error_px: mean reprojection error. False:
 * fewer than two views, parallel rays, or a mark that the lens cannot undo. */
typedef struct cn_triangulation {
    double xyz[3], angle_deg, error_px;
} cn_triangulation;
bool cn_scene_triangulate(const cn_scene *scene, const cn_point_mark *marks, uint32_t n, cn_triangulation *out);
#endif
