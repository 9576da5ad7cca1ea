/* Photos and the pairs of them that were verified, as COLMAP's database has them: what the global mapper starts from.
 */
#ifndef CONURB_POSE_VIEW_GRAPH_H
#define CONURB_POSE_VIEW_GRAPH_H
#include "conurb/pose.h"

/* Photo i of the index. */
typedef struct cn_graph_view {
    char *name;         /* as COLMAP sees it */
    uint32_t camera;    /* index into cameras */
    uint32_t n;         /* features */
    float (*xy)[2];     /* their places, pixels */
    float (*rays)[3];   /* by cn_graph_relate: their directions in the camera frame, of unit length; zeros: none */
    double rotation[9]; /* cam_from_world, by cn_graph_average */
    bool placed;        /* whether that is known */
} cn_graph_view;
/* a < b. Of feature pairs[k][0] of a and pairs[k][1] of b, x_b = rotation * x_a + translation, up to a scale. */
typedef struct cn_graph_pair {
    uint32_t a, b, n;
    uint32_t (*pairs)[2];
    bool used;         /* false: its relative pose is not known, or contradicts the others */
    bool is_essential; /* what matrix is: an essential matrix, or a fundamental one */
    double matrix[9];  /* COLMAP's, row-major: b' matrix a = 0 */
    double rotation[9], translation[3];
} cn_graph_pair;
typedef struct cn_view_graph {
    cn_camera *cameras;
    cn_graph_view *views;
    cn_graph_pair *pairs;
    uint32_t n_cameras, n_views, n_pairs;
    bool *knows_focal; /* of each camera, from EXIF */
} cn_view_graph;

/* Reads all of the database at `path`. The caller frees the graph with cn_view_graph_deinit; on failure it is empty. */
CN_NODISCARD cn_status cn_view_graph_read(const cn_photo_index *index, bool linked, const char *path,
                                          cn_view_graph *graph);
void cn_view_graph_deinit(cn_view_graph *graph);

/* Finds the focal length of cameras that have none from EXIF: the one with which the fundamental matrices of pairs of
 * this camera become essential matrices, whose two singular values are the same. False: a camera's pairs do not
 * determine it. */
bool cn_graph_calibrate(cn_view_graph *graph);
/* The relative pose of every pair, from its matrix, refined on its matches. Pairs whose matches do not determine it are
 * no longer used. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_graph_relate(const cn_context *ctx, cn_view_graph *graph);
/* Rotations of all views that pairs connect, from the pairs' relative rotations (Chatterjee and Govindu 2013: least
 * absolute errors first, then reweighted least squares). Pairs that are far from the result are no longer used, and of
 * what then hangs together the largest part is `placed`. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_graph_average(cn_view_graph *graph, uint32_t *n_placed);
/* A scene of the placed views, without places yet: translations are 0, points are at the origin. Its points are chains
 * of matches, those that most photos see first, until each photo has enough. The caller frees the scene; it is
 * empty on failure. */
CN_NODISCARD cn_status cn_graph_tracks(const cn_view_graph *graph, cn_scene *scene);
#endif
