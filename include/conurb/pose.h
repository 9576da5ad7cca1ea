/* conurb/pose.h: cameras, views and sparse points, in the city's local frame (east-north-up metres, double). */
#ifndef CONURB_POSE_H
#define CONURB_POSE_H
#include "conurb/base.h"
#include "conurb/geo.h"
#include "conurb/photo.h"
#ifdef __cplusplus
extern "C" {
#endif

/* COLMAP's model ids and parameter order. */
typedef enum cn_lens {
    CN_LENS_SIMPLE_PINHOLE = 0, /* f cx cy */
    CN_LENS_PINHOLE = 1,        /* fx fy cx cy */
    CN_LENS_SIMPLE_RADIAL = 2,  /* f cx cy k */
    CN_LENS_RADIAL = 3,         /* f cx cy k1 k2 */
    CN_LENS_OPENCV = 4,         /* fx fy cx cy k1 k2 p1 p2 */
    CN_LENS_OPENCV_FISHEYE = 5  /* fx fy cx cy k1 k2 k3 k4 */
} cn_lens;

typedef struct cn_camera {
    uint32_t id;
    cn_lens lens;
    uint32_t width, height; /* pixels of the photos as posed */
    double params[8];
} cn_camera;

/* Camera frame: x right, y down, z forward. x_cam = rotation * x_world + translation. Pixel (0,0) is the top left
 * corner of the top left pixel, whose centre is (0.5, 0.5). */
typedef struct cn_view {
    char *name;         /* the photo's name */
    uint32_t camera;    /* index into cameras */
    uint32_t photo;     /* index into the photo index; UINT32_MAX if unknown */
    double rotation[9]; /* cam_from_world, row-major */
    double translation[3];
} cn_view;

/* Where a view saw a sparse point. Pixels of the view's camera. */
typedef struct cn_observation {
    uint32_t view;
    float x_px, y_px;
} cn_observation;
typedef struct cn_point {
    double xyz[3];
    uint8_t rgb[3];
    float error_px; /* mean reprojection error */
    uint32_t first_observation, n_observations;
} cn_point;

typedef struct cn_scene {
    cn_camera *cameras;
    uint32_t n_cameras;
    cn_view *views;
    uint32_t n_views; /* sorted by name */
    cn_point *points;
    uint32_t n_points; /* may be 0 */
    cn_observation *observations;
    uint64_t n_observations;
} cn_scene;

CN_API void cn_scene_deinit(cn_scene *scene); /* frees what the members own; the scene is empty after */

/* Lenses. Pure functions of their arguments, for any thread. Distortion after Brown 1966 (OPENCV and below) and Kannala
 * and Brandt 2006 (OPENCV_FISHEYE, whose angle from the axis may reach 180 degrees), as COLMAP and OpenCV have them. */

/* Normalised ray direction in the camera frame (z forward; unit length) through pixel (x, y). CN_ERR_DATA when the
 * distortion has no inverse there (after 100 Newton steps, or past the fold of the lens); dir is then the undistorted
 * pinhole ray. */
CN_API CN_NODISCARD cn_status cn_camera_unproject(const cn_camera *camera, double x_px, double y_px, double dir[3]);
/* Pixel of a point in the camera frame; false when it is behind the camera or beyond the lens (past the radius or angle
 * at which the distortion folds back). The pixel may lie outside the picture. */
CN_API bool cn_camera_project(const cn_camera *camera, const double xyz[3], double xy_px[2]);
/* The same camera for photos resized to width x height. Lenses with one focal length become PINHOLE or OPENCV where the
 * two scales differ. out may be camera itself. */
CN_API void cn_camera_resize(const cn_camera *camera, uint32_t width, uint32_t height, cn_camera *out);
/* Camera centre in the world. */
CN_API void cn_view_centre(const cn_view *view, double centre[3]);

/* COLMAP models. Reads DIR/{cameras,images,points3D}.{bin,txt} (.bin where there are both); newer folders with rigs and
 * frames beside them too, whose images file still holds every photo's own pose. Hostile or truncated files, lens models
 * other than cn_lens: CN_ERR_FORMAT naming file and byte or line. No folder: CN_ERR_IO. Views are sorted by name; photo
 * is UINT32_MAX. On failure the scene is empty. */
CN_API CN_NODISCARD cn_status cn_scene_read_colmap(cn_scene *scene, const char *dir);
/* Writes binary COLMAP 3.8 files, each atomically; makes the folder. Ids are indices + 1; keypoints that no point uses
 * are not kept by a scene and so not written. */
CN_API CN_NODISCARD cn_status cn_scene_write_colmap(const cn_scene *scene, const char *dir);
/* transforms.json (Nerfstudio, instant-ngp). Frames whose photo is not in the index are left out, counted and named in
 * the log; no frame left is CN_ERR_DATA. file_path is relative to the json, with or without extension. Axes are kept (z
 * up), units too; OpenGL cameras are turned to x right, y down, z forward. applied_transform, scale and offset tell how
 * the json's coordinates came about: they are not undone, so positions agree with the file's. Intrinsics stand in the
 * file or in the frame, which wins. Cameras are brought to the photos' size; another aspect ratio is CN_ERR_DATA, a
 * matrix that is not rigid CN_ERR_FORMAT. There are no sparse points. */
CN_API CN_NODISCARD cn_status cn_scene_read_transforms(const cn_context *ctx, cn_scene *scene, const char *path,
                                                       const cn_photo_index *index);

typedef enum cn_matcher { CN_MATCH_AUTO, CN_MATCH_GPS, CN_MATCH_EXHAUSTIVE, CN_MATCH_SEQUENTIAL } cn_matcher;
typedef enum cn_tristate { CN_AUTO, CN_ON, CN_OFF } cn_tristate;

typedef struct cn_pose_options {
    const char *import;       /* a COLMAP model folder, a transforms.json, or NULL to run COLMAP */
    const char *colmap;       /* program, "colmap" by default */
    cn_matcher matcher;       /* auto: GPS neighbours when most photos have GPS, else every pair */
    uint32_t neighbours;      /* photos to match each photo with, when by GPS (default 20) */
    uint32_t max_image_px;    /* SIFT on photos at most this size (default 1600) */
    uint32_t max_features;    /* default 8192 */
    cn_tristate refine_focal; /* auto: off when the set is near nadir and EXIF has a focal length */
    bool single_camera;       /* one lens for photos of the same camera model and size (default true) */
    double max_error_m;       /* robust alignment threshold against GPS (default 5) */
} cn_pose_options;
CN_API cn_pose_options cn_pose_options_default(void);

typedef struct cn_pose_report {
    uint32_t n_registered, n_unregistered, n_models; /* sub-models found; the largest is used */
    char **unregistered;                             /* names */
    double mean_error_px;
} cn_pose_report;
CN_API void cn_pose_report_deinit(cn_pose_report *report);

/* The poses stage. Works in `dir` (CITY/poses): runs COLMAP (stage by stage, resumed after the last complete one, log
 * appended to dir/colmap.log) or imports, aligns to local east-north-up, and writes dir/model/ (COLMAP binary, local
 * frame), frame_path and, last, dir/poses.json. Cameras are turned and resized to the photos as the index has them.
 * Fewer than 3 posed photos with GPS, or all at one place: the frame stays local, the log says why; an import keeps its
 * coordinates, COLMAP's own are levelled by how the cameras are held, and centred. Cameras on a line leave the turn
 * about it open, and it is taken from how they are held. Photos that look straight down on flat ground are mapped again
 * with the focal length of EXIF and SIMPLE_RADIAL (unless refine_focal is on).
 * CN_ERR_TOOL: COLMAP is missing or failed; CN_ERR_DATA: no poses, or no photo of the import is in the index;
 * CN_ERR_INTERRUPTED: ctx->stop. Caller frees the report (empty on failure). One call a folder at a time. */
CN_API CN_NODISCARD cn_status cn_pose_run(const cn_context *ctx, const cn_photo_index *index, const char *dir,
                                          const char *frame_path, const cn_pose_options *options,
                                          cn_pose_report *report);
/* Loads dir/model and ties each view to its photo by name (views whose photo is gone are dropped with a warning; none
 * left is CN_ERR_DATA). CN_ERR_VERSION when a newer Conurb made it. */
CN_API CN_NODISCARD cn_status cn_pose_load(const cn_context *ctx, const char *dir, const cn_photo_index *index,
                                           cn_scene *scene);
/* A collection whose poses are known. Borrowed. */
typedef struct cn_pose_collection {
    const cn_photo_index *index;
    const cn_scene *scene;
    const char *dir; /* of the poses stage */
    const cn_pose_options *options;
} cn_pose_collection;
/* Finds the pose of a photo that is not of the collection. The collection's own poses do not change. COLMAP registers
 * the photo in the model that the poses stage left in collection->dir, by features matched with up to 60 photos (the
 * nearest by GPS, else spread over the collection). Where poses were imported, COLMAP first goes through the collection
 * (minutes for tens of photos) and keeps what it finds in dir/colmap. The answer is in the frame of collection->scene.
 * work: an empty folder of the caller's, for a copy of the features. *query: the index of that one photo; *out: its one
 * view, and camera. CN_ERR_DATA: it cannot be read, or no pose is found; CN_ERR_TOOL as cn_pose_run. Caller frees both
 * (empty on failure). One call a `dir` at a time. */
CN_API CN_NODISCARD cn_status cn_pose_locate(const cn_context *ctx, const cn_pose_collection *collection,
                                             const char *photo, const char *work, cn_photo_index *query, cn_scene *out);
/* target = scale * rotation * source + translation */
typedef struct cn_similarity {
    double scale, rotation[9], translation[3];
} cn_similarity;
/* What to fit, and how far off a pair may be. */
typedef struct cn_similarity_task {
    uint32_t n;
    const double (*source)[3], (*target)[3];
    double max_error_m;
    double vertical_weight; /* of the third coordinate in the error: 1, or less where heights are noisy */
    uint64_t seed;
} cn_similarity_task;
/* Robust similarity from n point pairs: RANSAC (Fischler and Bolles
 * 1981) around Horn's closed form (1987) with Umeyama's scale (1991), refitted on the inliers. The same seed gives the
 * same answer. inlier[n] is filled; it may be NULL. CN_ERR_DATA for fewer than 3 pairs, collinear points, or when no 3
 * pairs agree within max_error_m. */
CN_API CN_NODISCARD cn_status cn_pose_fit_similarity(const cn_similarity_task *task, cn_similarity *out, bool *inlier);

#ifdef __cplusplus
}
#endif
#endif
