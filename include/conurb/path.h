/* conurb/path.h: camera paths: flights, streets, tracks, orbits. No two calls may use the same output at the same
 * time; otherwise any thread. */
#ifndef CONURB_PATH_H
#define CONURB_PATH_H
#include "conurb/base.h"
#include "conurb/geo.h"
#include "conurb/pose.h"
#ifdef __cplusplus
extern "C" {
#endif

/* One frame of a path. view.name is "frame_00012", view.photo is UINT32_MAX, and the camera is a pinhole, or
 * EQUIRECTANGULAR where the file or the caller (cn_path_look_around) wants it. */
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
/* Makes each frame a picture of all directions (CN_LENS_EQUIRECTANGULAR), as wide as it was and half as high, from the
 * same place. Its middle has the heading of the camera that it replaces, and its horizon is level. Frames that show all
 * directions already stay as they are. CN_ERR_USAGE: a width that is odd. */
CN_API CN_NODISCARD cn_status cn_path_look_around(cn_path *path);

/* Samples the height of the ground. For each xy_m[i] (local metres) it writes to ground_m[i] the local z of the first
 * surface that a ray straight down meets; NaN when it meets none. */
typedef cn_status (*cn_path_heights)(void *user, size_t n, const double (*xy_m)[2], double *ground_m);

typedef struct cn_path_options {
    const cn_frame *frame;  /* borrowed; required for cn_path_load and cn_path_orbit */
    uint32_t width, height; /* pixels of the pictures */
    uint32_t n_frames;      /* 0: from the file's times and speed */
    double fps;             /* frames per second when the file has none; 0: 24 */
    double height_m;        /* metres above the ground, for streets and for tracks on the ground; NaN: from the file */
    cn_path_heights sound;  /* NULL: a path that follows the ground fails (CN_ERR_USAGE) */
    void *sound_user;
} cn_path_options;
CN_API cn_path_options cn_path_options_default(void); /* frame and sound NULL, size 0, height_m NaN */

/* Reads a path from a file. The format is recognised by the content; jobs/README.md describes it: JSON keyframes (a
 * centripetal Catmull-Rom spline; Barry and Goldman 1988), a GeoJSON LineString (a street, at a height above the
 * ground), KML with a gx:Track, or a camera of a compositing program: Nuke's .chan or a glTF binary (.glb), in the
 * axes of cn_path_save. The caller frees the path with cn_path_deinit; on failure it is empty.
 * CN_ERR_FORMAT: the file is wrong, or it has latitudes and the frame has no georeference; the message names the file
 * and the keyframe, the vertex (from 0) or the line. CN_ERR_IO: the file cannot be read. CN_ERR_DATA: there is no
 * ground below. */
CN_API CN_NODISCARD cn_status cn_path_load(cn_path *path, const char *file, const cn_path_options *options);
/* What a camera's file says of itself. Borrowed; both may be NULL. */
typedef struct cn_path_note {
    const cn_frame *frame; /* also written beside the file, as F.frame.json */
    const char *flight;    /* name of the flight; only glTF has room for it */
} cn_path_note;
/* Writes the cameras of a path of one frame or more, atomically: F.chan (Nuke) or F.glb (glTF 2.0, a camera with an
 * animated node). Both have y up: x east, y up, z south, in metres from the frame's origin, as cn_surface_export's glTF
 * has them. The camera looks along -z of its own axes. A line of .chan is frame (from 0), x, y, z, rotation about x, y
 * and z in degrees in the order ZXY (first z; Nuke's default for cameras), vertical field of view in degrees. Nuke
 * wants the same picture size as the render. What neither format has: the principal point and the distortion of a
 * photo's lens. CN_ERR_USAGE: another ending, or a frame of all directions. CN_ERR_IO, CN_ERR_NOMEM: an old file stays.
 */
CN_API CN_NODISCARD cn_status cn_path_save(const cn_path *path, const char *file, const cn_path_note *note);
/* A full circle round a place, clockwise from the south, looking at the place. orbit: "LAT,LON,RADIUS_M,HEIGHT_M", or
 * "X,Y,RADIUS,HEIGHT" in local units without georeference. The height is above the ground at the centre.
 * options->n_frames frames (0: 10 s). CN_ERR_USAGE: the text has another form. */
CN_API CN_NODISCARD cn_status cn_path_orbit(cn_path *path, const char *orbit, const cn_path_options *options);
/* A path through every view in the order of names (photo2 before photo10), at constant speed, with each view's
 * direction and field of view, upright where a photo is not. options->n_frames frames (0: one second per view).
 * CN_ERR_DATA: the scene has no views. */
CN_API CN_NODISCARD cn_status cn_path_photos(cn_path *path, const cn_scene *scene, const cn_path_options *options);
/* The default flight: a smooth path of n_frames frames near the views of the scene, evenly spaced, at 24 frames per
 * second. It follows the views in the order of their names (the order of capture), or from each view to the nearest
 * when the names have no such order. The path is a cubic B-spline, so its centres lie in the convex hull of the views'
 * centres, unless lines of sight to the sparse points show that a way round a house or a wall is clearer than the
 * straight one. Parts of the city whose photos share no sparse point are flown one after the other, with a cut. Views
 * that stand alone, many times as far away as most, are left out. Pictures have width x height pixels and the median
 * vertical field of view of the photos, and stand upright where a photo does not. CN_ERR_DATA: the scene has no views.
 */
CN_API CN_NODISCARD cn_status cn_path_default(cn_path *path, const cn_scene *scene, uint32_t n_frames, uint32_t width,
                                              uint32_t height);

#ifdef __cplusplus
}
#endif
#endif
