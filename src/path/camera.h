/* Cameras of compositing programs: Nuke's .chan and glTF. Both have y up, as glTF does: x east, y up, z south, in
 * metres from the frame's origin (without georeference: the poses' x, z and -y). Their camera looks along its -z, with
 * +y up in the picture. */
#ifndef CONURB_PATH_CAMERA_H
#define CONURB_PATH_CAMERA_H
#include "path/path.h"

/* A camera at a moment, with y up. */
typedef struct cn_path_sample {
    double time_s, vfov_deg;
    double centre[3];   /* m */
    double rotation[9]; /* world_from_cam, row-major; the columns are the camera's right, up and back */
} cn_path_sample;

cn_path_sample cn_path_sample_of(const cn_path_frame *frame);
/* Fills a path from n samples in rising order of time: options->n_frames frames spread evenly, or fps of them a second.
 * Between samples places are linear and directions go by slerp. A frame within 1 % of its length from a sample is that
 * sample. On failure the caller empties the path. */
CN_NODISCARD cn_status cn_path_from_samples(cn_path *path, const char *file, const cn_path_sample *samples, size_t n,
                                            double fps, const cn_path_options *options);

/* ---- chan.c: a line for each frame: number, x y z (m), rotations about x, y and z (degrees), vertical field of view
 * (degrees). The rotation order is ZXY, Nuke's default for cameras: first about z (roll), then x (pitch), then y. ----
 */
/* From 0, as the files of a render are numbered. Rotations go on past 360 degrees rather than jump. */
void cn_chan_write(FILE *stream, const cn_path *path);
CN_NODISCARD cn_status cn_path_from_chan(cn_path *path, const char *file, const cn_path_options *options);

/* ---- gltf_write.c, gltf_read.c: a GLB (glTF 2.0) with a perspective camera. Two or more frames are an animation of
 * its node: LINEAR translation and rotation (quaternions). A field of view that changes is animated by
 * KHR_animation_pointer. ---- */
CN_NODISCARD cn_status cn_gltf_write(FILE *stream, const cn_path *path, const cn_path_note *note);
/* The first node with a perspective camera; nodes above it may move too. It lasts from the first key of all channels to
 * the last, at options->fps, or at the rate of its keys where they are even and ten a second or more. */
CN_NODISCARD cn_status cn_path_from_gltf(cn_path *path, const char *file, const cn_path_options *options);
#endif
