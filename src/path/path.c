/* Camera paths: memory, options, and one frame. */
#include "path/path.h"

#include "base/file.h"
#include "base/units.h"
#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MAX_FRAMES 1000000

cn_path_options cn_path_options_default(void)
{
    return (cn_path_options){ .height_m = NAN };
}

cn_status cn_path_allocate(cn_path *path, uint32_t n_frames, double fps)
{
    *path = (cn_path){ .frames = calloc(n_frames, sizeof *path->frames), .n_frames = n_frames, .fps = fps };
    if (path->frames) return CN_OK;
    path->n_frames = 0;
    return cn_fail(CN_ERR_NOMEM, "out of memory for a camera path of %u frames; ask for fewer", n_frames);
}

void cn_path_deinit(cn_path *path)
{
    for (uint32_t i = 0; i < path->n_frames; i++)
        free(path->frames[i].view.name);
    free(path->frames);
    *path = (cn_path){ 0 };
}

cn_status cn_path_place(cn_path *path, uint32_t i, const cn_path_shot *shot)
{
    cn_path_frame *frame = &path->frames[i];
    const double focal = shot->height / 2.0 / tan(cn_radians(shot->vfov_deg / 2));
    frame->time_s = shot->time_s;
    frame->camera = (cn_camera){ .lens = CN_LENS_PINHOLE,
                                 .width = shot->width,
                                 .height = shot->height,
                                 .params = { focal, focal, shot->width / 2.0, shot->height / 2.0 } };
    frame->view.photo = UINT32_MAX;
    memcpy(frame->view.rotation, shot->cam_from_world, sizeof frame->view.rotation);
    cn_mat3_vec(shot->cam_from_world, shot->centre, frame->view.translation);
    for (int k = 0; k < 3; k++)
        frame->view.translation[k] = -frame->view.translation[k];
    frame->view.name = cn_format("frame_%05u", i);
    return frame->view.name ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for a camera path");
}

cn_status cn_path_start(cn_path *path, const char *where, double duration_s, double fps, const cn_path_options *options)
{
    if (!(fps > 0 && fps <= 1000))
        return cn_fail(CN_ERR_FORMAT, "%s: \"fps\" %g must lie between 0 and 1000", where, fps);
    double frames = options->n_frames ? options->n_frames : floor(duration_s * fps + 0.5) + 1;
    if (!(frames <= MAX_FRAMES))
        return cn_fail(CN_ERR_FORMAT,
                       "%s: %.0f frames are more than %d; lower the frames per second or the duration, or ask "
                       "for fewer frames",
                       where, frames, MAX_FRAMES);
    return cn_path_allocate(path, (uint32_t)frames, fps);
}
