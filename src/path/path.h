/* Helpers for all kinds of camera paths. */
#ifndef CONURB_PATH_PATH_H
#define CONURB_PATH_PATH_H
#include "conurb/path.h"

#include <jansson.h>

typedef struct cn_keyframe {
    double time_s, vfov_deg, roll_deg, heading_deg;
    double position[3], target[3]; /* local metres */
    bool has_target;
    double quat[4]; /* cam_from_world */
} cn_keyframe;

/* ---- path.c ---- */
/* Of a view, as if its photo stood upright: its vertical field of view, degrees, and its rotation as a quaternion. */
double cn_path_vfov_deg(const cn_scene *scene, uint32_t view);
void cn_path_rotation(const cn_scene *scene, uint32_t view, double quat[4]);
/* The views in the order of their photos' names by cn_path_compare. The caller frees the list; NULL when out of memory.
 */
uint32_t *cn_path_by_name(const cn_scene *scene);
/* Room for n frames, zeroed. On failure the path is empty. */
CN_NODISCARD cn_status cn_path_allocate(cn_path *path, uint32_t n_frames, double fps);
/* Room for a path of that duration, or of options->n_frames where that is given. where: the file, for messages. */
CN_NODISCARD cn_status cn_path_start(cn_path *path, const char *where, double duration_s, double fps,
                                     const cn_path_options *options);
/* A picture by a pinhole camera at `centre`. */
typedef struct cn_path_shot {
    double time_s, vfov_deg;
    uint32_t width, height; /* px */
    double cam_from_world[9], centre[3];
} cn_path_shot;
/* Fills frame i. */
CN_NODISCARD cn_status cn_path_place(cn_path *path, uint32_t i, const cn_path_shot *shot);

/* ---- keyframes.c, street.c, track.c: one a format. On failure the caller empties the path. ---- */
CN_NODISCARD cn_status cn_path_from_keyframes(cn_path *path, const char *file, const json_t *root,
                                              const cn_path_options *options);
CN_NODISCARD cn_status cn_path_from_geojson(cn_path *path, const char *file, const json_t *root,
                                            const cn_path_options *options);
CN_NODISCARD cn_status cn_path_from_kml(cn_path *path, const char *file, const cn_path_options *options);

/* ---- spline.c ---- */
/* Rows right, down, forward: heading clockwise from north, pitch up, roll clockwise as seen from behind the camera. */
void cn_path_angles(double heading_deg, double pitch_deg, double roll_deg, double cam_from_world[9]);
/* The direction from position to target; false when they coincide. heading_deg sets the picture's up when the target
 * is straight above or below. */
bool cn_path_look(const double position[3], const double target[3], double heading_deg, double roll_deg,
                  double cam_from_world[9]);
/* Fills every frame, evenly from the first keyframe to the last of n. */
CN_NODISCARD cn_status cn_path_fly(cn_path *path, const cn_keyframe *keys, size_t n, uint32_t width, uint32_t height);

/* ---- ground.c ---- */
/* Local z of the ground below n places: options->sound, with gaps filled from the neighbours in the list. CN_ERR_DATA
 * naming `where` when there is no ground at all. */
CN_NODISCARD cn_status cn_path_ground(const cn_path_options *options, const char *where, size_t n,
                                      const double (*xy_m)[2], double *ground_m);
/* A smooth line that is never below the median of the heights around it: median, maximum and Hann mean over +- reach
 * samples. z in place. */
CN_NODISCARD cn_status cn_path_smooth_above(size_t n, double *z, size_t reach);
/* Hann mean over +- reach samples of a line of n points with `width` coordinates; the line is continued straight
 * beyond its ends, so that they do not move. out may not alias. */
void cn_path_smooth(size_t n, int width, const double *points, size_t reach, double *out);
#endif
