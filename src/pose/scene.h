/* Builds and edits scenes. */
#ifndef CONURB_POSE_SCENE_H
#define CONURB_POSE_SCENE_H
#include "conurb/pose.h"

/* A model as COLMAP files have it: ids are names, tracks point into lists of keypoints. */
typedef struct cn_raw_view {
    uint32_t id, camera_id;
    char *name;
    double quaternion[4], translation[3];
    uint64_t first_keypoint, n_keypoints;
} cn_raw_view;
typedef struct cn_raw_track {
    uint32_t view_id, keypoint;
} cn_raw_track;
typedef struct cn_raw_model {
    cn_camera *cameras;
    uint32_t n_cameras;
    cn_raw_view *views;
    uint32_t n_views;
    float (*keypoints)[2];
    uint64_t n_keypoints;
    cn_point *points;
    uint32_t n_points; /* first_observation, n_observations: into tracks */
    cn_raw_track *tracks;
    uint64_t n_tracks;
    double lens_fit_px; /* as in cn_model_read */
} cn_raw_model;

void cn_raw_model_deinit(cn_raw_model *raw);
/* Checks ids, poses and numbers and fills `scene`, views sorted by name. `where` names the folder. */
CN_NODISCARD cn_status cn_scene_from_raw(cn_scene *scene, cn_raw_model *raw, const char *where);

/* Sets a camera's lens by COLMAP's id, one of cn_lens or of those in lens.h, with its parameters; id and size are set.
 * CN_ERR_FORMAT as cn_lens_from_foreign. */
CN_NODISCARD cn_status cn_raw_set_lens(cn_raw_model *raw, cn_camera *camera, int lens, const double *params,
                                       const char *path);

/* The two readers. `scene` files are DIR/{cameras,images,points3D}.{bin,txt}. */
CN_NODISCARD cn_status cn_raw_read_binary(cn_raw_model *raw, const char *dir);
CN_NODISCARD cn_status cn_raw_read_text(cn_raw_model *raw, const char *dir);
/* cn_scene_read_colmap. *lens_fit_px, which may be NULL: the largest error of a camera whose lens model cn_lens lacks,
 * by its nearest one; 0 where there is none. */
CN_NODISCARD cn_status cn_model_read(cn_scene *scene, const char *dir, double *lens_fit_px);
/* Whether a COLMAP model folder is read from its .bin files, not from its .txt files. */
bool cn_model_is_binary(const char *dir);
/* Number of registered photos of the model in DIR; 0 when there is none. */
uint32_t cn_model_photos(const char *dir);

CN_NODISCARD cn_status cn_scene_sort_views(cn_scene *scene);
/* Keeps the views i with keep[i], their observations, and the points that at least one view still sees. */
CN_NODISCARD cn_status cn_scene_keep_views(cn_scene *scene, const bool *keep);
/* local = scale * rotation * source + translation, for views and points. */
void cn_scene_transform(cn_scene *scene, double scale, const double rotation[9], const double translation[3]);
/* Adds a copy of the other scene, which shares no photo with it and is in the same frame; views stay sorted by name.
 * CN_ERR_NOMEM: the scene is as it was, or has all views unsorted. */
CN_NODISCARD cn_status cn_scene_append(cn_scene *scene, const cn_scene *other);
/* The median distance from cameras to points that they see, by a few hundred points; without points, between cameras;
 * 1 without these. */
double cn_scene_median_depth(const cn_scene *scene);
/* How far a point's projection is from where the view saw it, pixels. False when the view cannot see the point; some
 * models have such observations. */
bool cn_scene_error(const cn_scene *scene, const cn_point *point, const cn_observation *seen, double *error_px);
/* Removes observations that are off by more than this, and points that fewer than two views still see. Returns how
 * many observations. */
uint64_t cn_scene_drop_errors(cn_scene *scene, double most_px);
/* Sets every point's error_px to the mean distance of its projections from where it was seen (stored errors are wrong
 * after photos were resized, and after COLMAP's bundle_adjuster). Returns the mean over all observations, 0 without
 * points. */
double cn_scene_measure_errors(cn_scene *scene);

/* Finds every view's photo by name (UINT32_MAX: none); *n_lost: number of views without a photo. */
CN_NODISCARD cn_status cn_scene_tie(cn_scene *scene, const cn_photo_index *index, uint32_t *n_lost);
/* Resizes cameras to the photos of the index, with orientation applied. raw_pixels: the poses were made from the
 * stored pixels (as COLMAP does), so cameras are rotated by the EXIF orientation. Views without a photo do not change.
 * keep[i] becomes false for mirrored photos, which no camera can describe. CN_ERR_DATA: another aspect ratio; the
 * message has both sizes. */
CN_NODISCARD cn_status cn_scene_fit_photos(const cn_context *ctx, cn_scene *scene, const cn_photo_index *index,
                                           bool raw_pixels, bool *keep);
/* A place in the stored photo becomes the place in the upright one; pixels from the upper left corner. */
void cn_photo_upright(const cn_photo *photo, double xy_px[2]);
/* The index of the view of that name, or -1. */
int64_t cn_scene_find_view(const cn_scene *scene, const char *name);
#endif
