/* What the two makers of camera paths share. */
#ifndef CONURB_RENDER_PATH_H
#define CONURB_RENDER_PATH_H
#include "conurb/render.h"

/* Room for n frames, zeroed. On failure the path is empty. */
CN_NODISCARD cn_status cn_path_allocate(cn_path *path, uint32_t n_frames, double fps);
/* Fills frame i: a pinhole camera of that vertical field of view that stands at centre. */
CN_NODISCARD cn_status cn_path_place(cn_path *path, uint32_t i, double time_s, double vfov_deg, uint32_t width,
                                     uint32_t height, const double cam_from_world[9], const double centre[3]);
#endif
