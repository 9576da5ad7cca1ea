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

static const char *view_name(const void *scene, uint32_t view)
{
    const char *name = ((const cn_scene *)scene)->views[view].name;
    return name ? name : "";
}

uint32_t *cn_path_by_name(const cn_scene *scene)
{
    return cn_path_order(scene->n_views, view_name, scene);
}

double cn_path_vfov_deg(const cn_scene *scene, uint32_t view)
{
    const cn_side up = cn_view_side_up(&scene->views[view]);
    cn_camera camera = scene->cameras[scene->views[view].camera];
    /* Pixels are nearly square. */
    if (up == CN_SIDE_LEFT || up == CN_SIDE_RIGHT) camera.height = camera.width;
    return cn_camera_vfov_deg(&camera);
}

void cn_path_rotation(const cn_scene *scene, uint32_t view, double quat[4])
{
    double rotation[9];
    memcpy(rotation, scene->views[view].rotation, sizeof rotation);
    cn_side_turn(cn_view_side_up(&scene->views[view]), rotation);
    cn_mat3_to_quat(rotation, quat);
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

/* Rows right, down, forward, of which only the heading is kept. */
static void level(double rotation[9])
{
    double right[3] = { rotation[0], rotation[1], 0 };
    if (!cn_normalize3(right)) {
        /* The camera lies on its side: the direction of view has the heading. */
        right[0] = rotation[7];
        right[1] = -rotation[6];
        if (!cn_normalize3(right)) right[0] = 1;
    }
    const double rows[9] = { right[0], right[1], 0, 0, 0, -1, -right[1], right[0], 0 };
    memcpy(rotation, rows, sizeof rows);
}

cn_status cn_path_look_around(cn_path *path)
{
    for (uint32_t i = 0; i < path->n_frames; i++) {
        cn_path_frame *frame = &path->frames[i];
        const uint32_t width = frame->camera.width;
        double centre[3];
        if (frame->camera.lens == CN_LENS_EQUIRECTANGULAR) continue;
        if (width % 2)
            return cn_fail(CN_ERR_USAGE, "a picture of all directions is twice as wide as high; %u px is odd", width);
        cn_view_centre(&frame->view, centre);
        level(frame->view.rotation);
        cn_mat3_vec(frame->view.rotation, centre, frame->view.translation);
        for (int k = 0; k < 3; k++)
            frame->view.translation[k] = -frame->view.translation[k];
        frame->camera = (cn_camera){
            .lens = CN_LENS_EQUIRECTANGULAR, .width = width, .height = width / 2, .params = { width, width / 2 }
        };
    }
    return CN_OK;
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
