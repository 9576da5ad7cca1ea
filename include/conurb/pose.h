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

/* Camera frame: x right, y down, z forward. x_cam = rotation * x_world + translation. Pixel (0,0) is the top left corner
 * of the top left pixel, whose centre is (0.5, 0.5). */
typedef struct cn_view {
    char *name;         /* the photo's name */
    uint32_t camera;    /* index into cameras */
    uint32_t photo;     /* index into the photo index; UINT32_MAX if unknown */
    double rotation[9]; /* cam_from_world, row-major */
    double translation[3];
} cn_view;

typedef struct cn_observation { uint32_t view; float x_px, y_px; } cn_observation;
typedef struct cn_point {
    double xyz[3];
    uint8_t rgb[3];
    float error_px;                     /* mean reprojection error */
    uint32_t first_observation, n_observations;
} cn_point;

typedef struct cn_scene {
    cn_camera *cameras; uint32_t n_cameras;
    cn_view *views; uint32_t n_views;   /* sorted by name */
    cn_point *points; uint32_t n_points; /* may be 0 */
    cn_observation *observations; uint64_t n_observations;
} cn_scene;

CN_API void cn_scene_deinit(cn_scene *scene);

/* Normalised ray direction in the camera frame (z forward; unit length) through pixel (x, y).
 * CN_ERR_DATA when the distortion has no inverse there (after 100 Newton steps); dir is then the undistorted pinhole ray. */
CN_API CN_NODISCARD cn_status cn_camera_unproject(const cn_camera *camera, double x_px, double y_px, double dir[3]);
/* Pixel of a point in the camera frame; false when it is behind the camera (or beyond the lens). */
CN_API bool cn_camera_project(const cn_camera *camera, const double xyz[3], double xy_px[2]);
/* The same camera for photos resized to width x height. */
CN_API void cn_camera_resize(const cn_camera *camera, uint32_t width, uint32_t height, cn_camera *out);
/* Camera centre in the world. */
CN_API void cn_view_centre(const cn_view *view, double centre[3]);

/* COLMAP models. Reads DIR/{cameras,images,points3D}.{bin,txt}; newer folders with rigs and frames beside them too.
 * Hostile or truncated files: CN_ERR_FORMAT naming file and offset or line. Views are sorted by name. */
CN_API CN_NODISCARD cn_status cn_scene_read_colmap(cn_scene *scene, const char *dir);
/* Writes binary COLMAP 3.8 files, each atomically. */
CN_API CN_NODISCARD cn_status cn_scene_write_colmap(const cn_scene *scene, const char *dir);
/* transforms.json (Nerfstudio, instant-ngp). Frames whose photo is not in the index are left out, counted and named in the log.
 * Axes are kept (z up), units too; OpenGL cameras are turned to x right, y down, z forward. */
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
    char **unregistered;      /* names */
    double mean_error_px;
} cn_pose_report;
CN_API void cn_pose_report_deinit(cn_pose_report *report);

/* The poses stage. Works in `dir` (CITY/poses): runs COLMAP (stage by stage, resumable, log kept in dir/colmap.log) or imports, aligns
 * to local east-north-up, writes dir/model/ (COLMAP binary, local frame) and frame_path. */
CN_API CN_NODISCARD cn_status cn_pose_run(const cn_context *ctx, const cn_photo_index *index, const char *dir,
                                          const char *frame_path, const cn_pose_options *options,
                                          cn_pose_report *report);
/* Loads dir/model and ties each view to its photo by name (views whose photo is gone are dropped with a warning). */
CN_API CN_NODISCARD cn_status cn_pose_load(const cn_context *ctx, const char *dir, const cn_photo_index *index,
                                           cn_scene *scene);
/* Robust similarity local = s R source + t (RANSAC + Umeyama) from n point pairs; inlier[i] may be NULL.
 * CN_ERR_DATA for fewer than 3 pairs or collinear points. */
CN_API CN_NODISCARD cn_status cn_pose_fit_similarity(uint32_t n, const double (*source)[3], const double (*target)[3],
                                                     double max_error_m, uint64_t seed, double *scale,
                                                     double rotation[9], double translation[3], bool *inlier);

#ifdef __cplusplus
}
#endif
#endif
