/* conurb/pose.h: cameras, views and sparse points, in the city's local frame (east-north-up metres, double). */
#ifndef CONURB_POSE_H
#define CONURB_POSE_H
#include "conurb/base.h"
#include "conurb/geo.h"
#include "conurb/photo.h"
#ifdef __cplusplus
extern "C" {
#endif

/* Lens models, with COLMAP's ids and its order of parameters. */
typedef enum cn_lens {
    CN_LENS_SIMPLE_PINHOLE = 0,  /* f cx cy */
    CN_LENS_PINHOLE = 1,         /* fx fy cx cy */
    CN_LENS_SIMPLE_RADIAL = 2,   /* f cx cy k */
    CN_LENS_RADIAL = 3,          /* f cx cy k1 k2 */
    CN_LENS_OPENCV = 4,          /* fx fy cx cy k1 k2 p1 p2 */
    CN_LENS_OPENCV_FISHEYE = 5,  /* fx fy cx cy k1 k2 k3 k4 */
    CN_LENS_EQUIRECTANGULAR = 17 /* w h: the size of the picture, which shows all directions; see below */
} cn_lens;

typedef struct cn_camera {
    uint32_t id;
    cn_lens lens;
    uint32_t width, height; /* size of the photos that were posed, pixels */
    double params[8];
} cn_camera;

/* The pose of one photo: x_cam = rotation * x_world + translation. Camera frame: x right, y down, z forward. Pixel
 * coordinates: (0, 0) is the top left corner of the picture, (0.5, 0.5) the centre of the top left pixel. */
typedef struct cn_view {
    char *name;         /* the photo's name */
    uint32_t camera;    /* index into cameras */
    uint32_t photo;     /* index into the photo index; UINT32_MAX if unknown */
    double rotation[9]; /* cam_from_world, row-major */
    double translation[3];
} cn_view;

/* Where a view saw a sparse point, in pixels of the view's camera. */
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

CN_API void cn_scene_deinit(cn_scene *scene); /* frees the arrays and the names; the scene is empty then */

/* Cameras and lenses. These functions keep no state; any thread may call them. Distortion: Brown 1966 for OPENCV and
 * the models above it in cn_lens, Kannala and Brandt 2006 for OPENCV_FISHEYE (angles to the axis up to 180 degrees),
 * with the parameters of COLMAP and OpenCV. EQUIRECTANGULAR, as in COLMAP 4: x is the angle about the camera's y axis,
 * 360 degrees from edge to edge with z forward in the middle and x to the right of it; y is the angle from the horizon,
 * 180 degrees from edge to edge. */

/* The direction of the ray through pixel (x, y), of unit length, in the camera frame. CN_ERR_DATA: the distortion has
 * no inverse there (100 Newton steps did not converge, or the pixel lies beyond the radius where the distortion folds
 * back); dir is then the ray of the pinhole without distortion. */
CN_API CN_NODISCARD cn_status cn_camera_unproject(const cn_camera *camera, double x_px, double y_px, double dir[3]);
/* The pixel of a point in the camera frame. The pixel may lie outside the picture. false: the point is behind the
 * camera, or beyond the radius or angle where the distortion folds back. */
CN_API bool cn_camera_project(const cn_camera *camera, const double xyz[3], double xy_px[2]);
/* The same camera for photos of width x height pixels. When the two scales differ, a lens with one focal length
 * becomes PINHOLE or OPENCV. out may be camera itself. */
CN_API void cn_camera_resize(const cn_camera *camera, uint32_t width, uint32_t height, cn_camera *out);
/* The vertical field of view of the camera's pinhole part, 1 to 170 degrees. An equirectangular camera has none; it is
 * 60 then, for pinhole pictures that are drawn from its place. */
CN_API double cn_camera_vfov_deg(const cn_camera *camera);
/* The camera's centre in the local frame, metres. */
CN_API void cn_view_centre(const cn_view *view, double centre[3]);
/* A side of a photo, as it is stored. */
typedef enum cn_side { CN_SIDE_TOP, CN_SIDE_LEFT, CN_SIDE_RIGHT, CN_SIDE_BOTTOM } cn_side;
/* The side of a view's photo that is up in the local frame. A view that looks more than 60 degrees down or up has none,
 * and counts as CN_SIDE_TOP. */
CN_API cn_side cn_view_side_up(const cn_view *view);
/* Turns a view's rotation, as if its photo were turned until that side is at the top. */
CN_API void cn_side_turn(cn_side up, double cam_from_world[9]);

/* Reads a COLMAP model, DIR/{cameras,images,points3D}.{bin,txt}; .bin when both exist. Newer models with rigs and
 * frames work too: their images file still holds the pose of every photo. Views are sorted by name; view.photo is
 * UINT32_MAX. The caller frees the scene with cn_scene_deinit; on failure it is empty. Cameras with COLMAP's
 * FULL_OPENCV, FOV, SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE or THIN_PRISM_FISHEYE become the nearest of cn_lens.
 * CN_ERR_FORMAT: a file is damaged, or it has another lens model, or none of cn_lens is near enough; the message names
 * the file and the byte or line. CN_ERR_IO: there is no such folder. */
CN_API CN_NODISCARD cn_status cn_scene_read_colmap(cn_scene *scene, const char *dir);
/* Writes binary files of COLMAP 3.8, each atomically, and makes the folder. Ids are indices + 1. Keypoints without a
 * point are not written, because a scene does not hold them. */
CN_API CN_NODISCARD cn_status cn_scene_write_colmap(const cn_scene *scene, const char *dir);
/* Reads a transforms.json (Nerfstudio, instant-ngp). file_path is relative to the json, with or without extension.
 * Intrinsics are in the file or in a frame; those in the frame win. Cameras are resized to the photos. The scene has
 * no sparse points.
 *
 * Axes (z up) and units do not change. OpenGL cameras become x right, y down, z forward. applied_transform, scale and
 * offset are not undone: positions agree with the file.
 *
 * Frames whose photo is not in the index are left out, counted and named in the log. CN_ERR_DATA: no frame is left, or
 * a photo has another aspect ratio than its camera. CN_ERR_FORMAT: the file is damaged, or a pose matrix is not rigid.
 * On failure the scene is empty. */
CN_API CN_NODISCARD cn_status cn_scene_read_transforms(const cn_context *ctx, cn_scene *scene, const char *path,
                                                       const cn_photo_index *index);

/* Which pairs are matched. Retrieval: each photo with those whose largest features match its own. Auto: by GPS where
 * most photos have it; else every pair of up to 200 photos, and retrieval for more. */
typedef enum cn_matcher {
    CN_MATCH_AUTO,
    CN_MATCH_GPS,
    CN_MATCH_EXHAUSTIVE,
    CN_MATCH_SEQUENTIAL,
    CN_MATCH_RETRIEVAL
} cn_matcher;
/* What compares the features of two photos. Conurb: every pair of descriptors, in whole numbers, then COLMAP's
 * geometric verification. COLMAP: its own matcher, which searches approximately and takes much longer. */
typedef enum cn_match_with { CN_MATCH_WITH_CONURB, CN_MATCH_WITH_COLMAP } cn_match_with;
/* What finds the poses from the matches. Auto: all photos at once, and where that does not hold COLMAP's mapper, which
 * adds one photo after the other. Incremental: only that. */
typedef enum cn_mapper { CN_MAP_AUTO, CN_MAP_INCREMENTAL } cn_mapper;
typedef enum cn_tristate { CN_AUTO, CN_ON, CN_OFF } cn_tristate;

/* What the heights of control points are measured from: the WGS84 ellipsoid, or the sea, by EGM96. */
typedef enum cn_control_heights { CN_CONTROL_ELLIPSOID, CN_CONTROL_SEA_LEVEL } cn_control_heights;

typedef struct cn_pose_options {
    const char *import;       /* poses of another tool, or NULL to run COLMAP; see cn_pose_run */
    const char *colmap;       /* the COLMAP program; default "colmap" */
    cn_matcher matcher;       /* default: auto */
    cn_match_with match_with; /* default: Conurb; guided matching is always COLMAP's */
    cn_mapper mapper;         /* default: auto */
    uint32_t neighbours;      /* GPS matching: neighbours to match each photo with (default 20) */
    uint32_t max_image_px;    /* longer side of the photos for SIFT at most (default 1600) */
    uint32_t max_features;    /* SIFT features per photo at most (default 8192) */
    cn_tristate refine_focal; /* auto: off when the photos look straight down and EXIF has a focal length */
    cn_tristate check_import; /* auto: up to 200 photos; see cn_pose_run */
    bool single_camera;       /* photos of the same camera model and size share one lens (default true) */
    double max_error_m;       /* GPS alignment: inlier threshold (default 5) */
    uint32_t attempts;        /* ways to map that are tried at most, 1 to 5 (default 5); see cn_pose_run */
    uint32_t group_photos;    /* photos of a group at most (default 200), 0: no groups; see cn_pose_is_grouped */
    const char *control;      /* file of control points, or NULL; see cn_pose_run */
    const char *check;        /* names of those that are only measured, separated by commas; NULL: as the file says */
    cn_control_heights control_heights; /* of points whose coordinate system does not say it */
} cn_pose_options;
CN_API cn_pose_options cn_pose_options_default(void);

typedef struct cn_pose_report {
    uint32_t n_registered, n_unregistered, n_models; /* n_models: models that COLMAP found; the largest is used */
    char **unregistered;                             /* names of the photos without a pose */
    double mean_error_px;
    uint32_t n_control, n_check;       /* control and check points that the photos show from different sides */
    double control_rms_m, check_rms_m; /* distance from their surveyed places, RMS; NaN without them */
} cn_pose_report;
CN_API void cn_pose_report_deinit(cn_pose_report *report);

/* The poses stage, in the folder `dir` (CITY/poses). It runs COLMAP step by step, or imports poses, and aligns them to
 * local east-north-up. It writes dir/model/ (COLMAP binary, local frame), frame_path and, last, dir/poses.json. COLMAP
 * resumes after its last complete step; its log is dir/colmap.log. Cameras are rotated and resized to the photos of
 * the index.
 *
 * With fewer than 3 posed photos with GPS, or all at one place, there is no georeference, and the log says why.
 * COLMAP's poses are then levelled by the cameras' up direction, and centred. So are imported models of COLMAP, Bundler
 * and VisualSfM, whose axes mean nothing, where their z axis is more than 30 degrees from that direction; other
 * imported poses keep their coordinates. When all cameras stand on a line, GPS leaves the rotation about the line open,
 * and the cameras' up direction gives it. When the photos look straight down on flat ground, the poses are adjusted
 * with the focal length of EXIF and SIMPLE_RADIAL, unless refine_focal is on.
 *
 * The photos' features are COLMAP's. Conurb matches them (options->match_with), and COLMAP verifies the matches. A run
 * that is killed in between goes on with the matches that it had.
 *
 * The first attempt maps all photos at once (GLOMAP, Pan et al. 2024, on Ceres): rotations of pairs are averaged
 * (Chatterjee and Govindu 2013), cameras and points are placed together and adjusted, and COLMAP finds the other
 * points, adjusts, and adds photos that were left out. It needs focal lengths, from EXIF or from pairs of photos of
 * one camera. Where it does not hold, or options->mapper is incremental, COLMAP maps one photo after the other. When
 * that poses too few photos, further attempts follow, with SIMPLE_RADIAL cameras: the same matches mapped from photos
 * that move forwards and see things under small angles, then with looser thresholds (both while fewer than 95 % of the
 * photos have a pose, or the mean reprojection error is above 1.5 px), then more features of affine shape (Baumberg
 * 2000; DSP-SIFT, Dong and Soatto 2015) with guided matches (below 80 %, up to 500 photos).
 * Of a group, these shares count for the photos of its core; 60 % of those that it shares with its neighbours will do.
 * The model with the most photos is kept. The log has a line for each attempt.
 *
 * 360 degree photos (photo.equirectangular) are cut into six pinhole views for COLMAP, in dir/rig-views. The poses
 * of a photo's views become one: that on which most of them agree, adjusted so that all have one centre (Ceres). Such a
 * photo has the camera EQUIRECTANGULAR. cn_pose_locate finds no pose among such photos.
 *
 * Imports: a COLMAP model folder, a transforms.json (nerfstudio, instant-ngp), the reconstruction.json of OpenSfM and
 * ODM, the bundle.out of Bundler with its list.txt, all also inside the folder of a project, the .nvm of VisualSfM, the
 * cameras.xml of Metashape, a table of RealityCapture, or the folder of a capture by Polycam or Record3D. When the file
 * states where its origin lies (reference_lla), the poses keep their place, unless the median photo's GPS is more than
 * max_error_m off. A lens with terms that cn_lens lacks is approximated; the log says how well.
 *
 * When fewer than 60 % of at least 8 photos agree with their GPS, imported poses are in doubt. Then (check_import) the
 * poses are found anew from the photos, and used if clearly more photos agree with their GPS; the log says so.
 *
 * Control points (options->control) are surveyed places with marks in photos: a gcp_list.txt of ODM, a
 * ground_control_points.json of OpenSfM, or a table (see src/pose/control.h). From three on that are not on a line,
 * they place the poses by a similarity instead of GPS. Then bundle adjustment brings poses, sparse points and lenses to
 * the best agreement with tie points (by their error), marks (0.5 px), control points (as stated, else 2 cm) and
 * GPS (stated uncertainty, else what the alignment left over), with Cauchy's loss for tie points and GPS. Check points
 * are measured afterwards. Poses that COLMAP found are adjusted to GPS alone when at least three photos state that
 * theirs is better than 0.5 m (RTK). Imported poses without sparse points are only moved as a whole.
 *
 * Only one call at a time per folder. The caller frees the report; on failure it is empty. CN_ERR_TOOL: COLMAP is
 * missing or failed. CN_ERR_DATA: no poses were found, or no imported photo is in the index. CN_ERR_INTERRUPTED: asked
 * to stop. */
CN_API CN_NODISCARD cn_status cn_pose_run(const cn_context *ctx, const cn_photo_index *index, const char *dir,
                                          const char *frame_path, const cn_pose_options *options,
                                          cn_pose_report *report);
/* ---- Poses of a city, in groups ----
 *
 * Incremental mapping takes more than twice as long for twice the photos, and one machine's memory ends it. So many
 * photos are split by place (by GPS; else by their order, or by which photos look alike) into overlapping groups, each
 * is mapped on its own (by several processes or machines, if need be), and the models are merged: see
 * src/pose/groups.h and src/pose/merge.h. Where the installed COLMAP has a global mapper (COLMAP 4; GLOMAP, Pan et al.
 * 2024), it maps the groups, else Conurb's does. Where that fails, COLMAP's incremental mapper follows.
 *
 * The steps share dir/groups. Each can be killed and run again; COLMAP's part of a group resumes after its last
 * complete step. */

/* Whether the photos are posed in groups: they are more than twice options->group_photos, and no poses are imported. */
CN_API bool cn_pose_is_grouped(const cn_photo_index *index, const cn_pose_options *options);
/* Borrowed. key: a text that changes with the photos and the options; groups of another key are made anew. */
typedef struct cn_pose_work {
    const cn_photo_index *index;
    const char *dir;
    const cn_pose_options *options;
    const char *key;
} cn_pose_work;
/* Splits the photos and writes dir/groups/groups.json and photos.json, unless that is done. Without GPS this runs
 * COLMAP's features of all photos. Errors as cn_pose_run. */
CN_API CN_NODISCARD cn_status cn_pose_split(const cn_context *ctx, const cn_pose_work *work, uint32_t *n_groups);
typedef enum cn_pose_group_state {
    CN_POSE_GROUP_DUE,
    CN_POSE_GROUP_DONE,
    CN_POSE_GROUP_HOPELESS, /* no poses were found; another try would find none either */
    CN_POSE_GROUP_FAILED    /* for another reason, such as a full disk; worth another try */
} cn_pose_group_state;
/* Group 0 is the first; in folders and messages it has the number 1. */
CN_API cn_pose_group_state cn_pose_group_look(const cn_pose_work *work, uint32_t group);
/* Maps a group. Its model and group.json, or the reason of a failure in error.json, are in dir/groups/NNN. One call at
 * a time per group. CN_ERR_USAGE: there is no such group. Other errors as cn_pose_run. */
CN_API CN_NODISCARD cn_status cn_pose_map_group(const cn_context *ctx, const cn_pose_work *work, uint32_t group);
/* Merges the groups and writes what cn_pose_run writes. Groups that failed are left out; the log and the report name
 * them. CN_ERR_DATA: a group is neither mapped nor failed, or none has a model. */
CN_API CN_NODISCARD cn_status cn_pose_merge(const cn_context *ctx, const cn_pose_work *work, const char *frame_path,
                                            cn_pose_report *report);

/* Loads dir/model and finds each view's photo by its name. Views without a photo are dropped with a warning. The
 * caller frees the scene. CN_ERR_DATA: no view is left. CN_ERR_VERSION: a newer Conurb made it. */
CN_API CN_NODISCARD cn_status cn_pose_load(const cn_context *ctx, const char *dir, const cn_photo_index *index,
                                           cn_scene *scene);
/* A collection whose poses are known. Borrowed. */
typedef struct cn_pose_collection {
    const cn_photo_index *index;
    const cn_scene *scene;
    const char *dir; /* the folder of the poses stage */
    const cn_pose_options *options;
} cn_pose_collection;
/* Finds the pose of a query photo, which is not in the collection. The collection's own poses do not change. COLMAP
 * registers the photo in the model in collection->dir. It matches features with up to 60 photos: the nearest by GPS,
 * where the query and more than half of the collection have it, else spread over the collection. When the poses were
 * imported, COLMAP first processes the whole collection (minutes for tens of photos) and keeps the result in
 * dir/colmap. Where they were made in groups, COLMAP works with the group that has the most of these photos; without
 * GPS, that is CN_ERR_DATA.
 *
 * The result is in the frame of collection->scene. *query: an index with only this photo. *out: a scene with its view
 * and camera. work: an empty folder for temporary files. The caller frees query and out; both are empty on failure.
 * Only one call at a time per `dir`. CN_ERR_DATA: the photo cannot be read, or no pose is found. CN_ERR_TOOL: COLMAP
 * is missing or failed. */
CN_API CN_NODISCARD cn_status cn_pose_locate(const cn_context *ctx, const cn_pose_collection *collection,
                                             const char *photo, const char *work, cn_photo_index *query, cn_scene *out);
/* A similarity transform: target = scale * rotation * source + translation. rotation is row-major. */
typedef struct cn_similarity {
    double scale, rotation[9], translation[3];
} cn_similarity;
/* n pairs of points to fit, and the inlier threshold. */
typedef struct cn_similarity_task {
    uint32_t n;
    const double (*source)[3], (*target)[3];
    double max_error_m;
    double vertical_weight; /* weight of the third coordinate in the error: 1, or less when heights are noisy */
    uint64_t seed;
    /* NULL, or a flag for each pair: without it the target's third coordinate, which has to be finite, is not known and
     * counts neither for the fit nor as an error. */
    const bool *has_height;
} cn_similarity_task;
/* Fits a similarity transform to the pairs: RANSAC (Fischler and Bolles 1981) around Horn's closed form (1987) with
 * Umeyama's scale (1991), refitted to the inliers. The same seed gives the same result. inlier: NULL, or n flags to
 * fill. Any thread. CN_ERR_DATA: fewer than 3 pairs, collinear points, or no 3 pairs that agree within max_error_m. */
CN_API CN_NODISCARD cn_status cn_pose_fit_similarity(const cn_similarity_task *task, cn_similarity *out, bool *inlier);

#ifdef __cplusplus
}
#endif
#endif
