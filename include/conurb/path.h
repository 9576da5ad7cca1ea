/* conurb/path.h: camera paths: flights, streets, tracks, orbits. */
#ifndef CONURB_PATH_H
#define CONURB_PATH_H
#include "conurb/base.h"
#include "conurb/geo.h"
#include "conurb/pose.h"
#ifdef __cplusplus
extern "C" {
#endif

/* One picture of a path: view.name is "frame_00012", view.photo UINT32_MAX; the camera a pinhole. */
typedef struct cn_path_frame {
    cn_camera camera;
    cn_view view;
    double time_s;
} cn_path_frame;
typedef struct cn_path {
    cn_path_frame *frames;
    uint32_t n_frames;
    double fps;
} cn_path;
CN_API void cn_path_deinit(cn_path *path);

/* The surface below places, for heights above the ground: writes to ground_m[i] the local z of what a ray straight down
 * through xy_m[i] (local metres) meets first, NaN where it meets nothing. */
typedef cn_status (*cn_path_heights)(void *user, size_t n, const double (*xy_m)[2], double *ground_m);

typedef struct cn_path_options {
    const cn_frame *frame;  /* borrowed; required for cn_path_load and cn_path_orbit */
    uint32_t width, height; /* pixels of the pictures */
    uint32_t n_frames;      /* 0: as many as the file's times and speed give */
    double fps;             /* where a file names none; 0: 24 */
    double height_m;        /* above the ground, for streets and tracks on it; NaN: as the file says */
    cn_path_heights sound;  /* NULL: paths that follow the ground are refused (CN_ERR_USAGE) */
    void *sound_user;
} cn_path_options;
CN_API cn_path_options cn_path_options_default(void); /* no frame, no size, no sound */

/* A path from a file; its content tells the format, which is described in jobs/README.md: JSON keyframes (a centripetal
 * Catmull-Rom spline; Barry and Goldman 1988), a GeoJSON LineString (a street, at a height above the ground), KML with
 * a gx:Track. CN_ERR_FORMAT names file and keyframe, vertex (from 0) or line, also for latitudes in a frame without
 * georeference; CN_ERR_IO when the file cannot be read; CN_ERR_DATA when there is no ground below. On failure the path
 * is empty. Caller frees with cn_path_deinit. One thread a call. */
CN_API CN_NODISCARD cn_status cn_path_load(cn_path *path, const char *file, const cn_path_options *options);
/* A full circle (clockwise from the south) round a place and looking at it: "LAT,LON,RADIUS_M,HEIGHT_M", or
 * "X,Y,RADIUS,HEIGHT" in local metres without georeference; the height is above the ground in the middle.
 * options->n_frames frames (0: 10 s). CN_ERR_USAGE for text that is not that. */
CN_API CN_NODISCARD cn_status cn_path_orbit(cn_path *path, const char *orbit, const cn_path_options *options);
/* Through every view in the order of names, at an even speed, with each view's direction and field of view.
 * options->n_frames frames (0: one second a view). CN_ERR_DATA without views. */
CN_API CN_NODISCARD cn_status cn_path_photos(cn_path *path, const cn_scene *scene, const cn_path_options *options);
/* The default flight: a smooth path near the views of the scene in capture (name) order - or from each to the nearest,
 * where names tell no order - n_frames long, at width x height and the photos' median vertical field of view. Evenly
 * spaced over its length, 24 frames a second. Its centres lie in the convex hull of the views' (a cubic B-spline).
 * CN_ERR_DATA without views. */
CN_API CN_NODISCARD cn_status cn_path_default(cn_path *path, const cn_scene *scene, uint32_t n_frames, uint32_t width,
                                              uint32_t height);

#ifdef __cplusplus
}
#endif
#endif
