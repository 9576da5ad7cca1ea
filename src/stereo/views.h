/* Views made ready for matching: grey pictures of pinhole cameras, and each view's sources. Private to stereo/. */
#ifndef CONURB_STEREO_VIEWS_H
#define CONURB_STEREO_VIEWS_H
#include "stereo/stereo.h"

typedef struct cn_stereo_view {
    const cn_view *pose;
    cn_camera camera;       /* the view's own lens, at the size of the picture */
    uint32_t width, height; /* 0: the view takes no part */
    float focal, cx, cy;    /* of the pinhole camera */
    float *grey;            /* [height][width] as the pinhole camera sees it; square root of linear luminance */
    float near_m, far_m;    /* range of depths to try */
    const uint32_t *points; /* [n_points] sparse points that it shows: indices into scene->points */
    uint32_t n_points;
    uint32_t sources[CN_STEREO_SOURCES], n_sources; /* other views, the best one first */
    float *depth; /* [height][width] along the pinhole camera's axis; NULL before the match, 0 where it is bad */
} cn_stereo_view;

typedef struct cn_stereo_views {
    cn_stereo_view *view; /* [n] */
    uint32_t n;
    uint32_t *points; /* of all views */
} cn_stereo_views;

/* Reads the pictures, and chooses sources. The caller calls cn_stereo_views_deinit, also after a failure. */
CN_NODISCARD cn_status cn_stereo_views_init(cn_stereo_views *views, const cn_stereo_input *input,
                                            const cn_stereo_options *options);
void cn_stereo_views_deinit(cn_stereo_views *views);
/* The point in the view's camera frame. */
void cn_stereo_to_camera(const cn_view *pose, const double xyz[3], double camera[3]);
#endif
