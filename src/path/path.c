/* Camera paths: memory, and which format a file is in. */
#include "path/path.h"

#include "base/file.h"
#include "base/json.h"
#include "base/units.h"
#include "math/linalg.h"

#include <ctype.h>
#include <math.h>
#include <stdio.h>
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

cn_status cn_path_place(cn_path *path, uint32_t i, double time_s, double vfov_deg, uint32_t width, uint32_t height,
                        const double cam_from_world[9], const double centre[3])
{
    cn_path_frame *frame = &path->frames[i];
    double focal = height / 2.0 / tan(cn_radians(vfov_deg / 2));
    frame->time_s = time_s;
    frame->camera = (cn_camera){
        .lens = CN_LENS_PINHOLE, .width = width, .height = height, .params = { focal, focal, width / 2.0, height / 2.0 }
    };
    frame->view.photo = UINT32_MAX;
    memcpy(frame->view.rotation, cam_from_world, sizeof frame->view.rotation);
    cn_mat3_vec(cam_from_world, centre, frame->view.translation);
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
                       "%s: %.0f frames are more than %d; lower the frames a second or the duration, or ask "
                       "for fewer frames",
                       where, frames, MAX_FRAMES);
    return cn_path_allocate(path, (uint32_t)frames, fps);
}

/* XML begins with '<', which JSON never does. */
static cn_status is_xml(const char *file, bool *xml)
{
    FILE *stream = fopen(file, "rb");
    if (!stream) return cn_fail(CN_ERR_IO, "cannot read the camera path %s; name a file that is there", file);
    int c = fgetc(stream);
    while (c != EOF && (isspace(c) || c == 0xEF || c == 0xBB || c == 0xBF))
        c = fgetc(stream);
    *xml = c == '<';
    fclose(stream);
    return CN_OK;
}

static cn_status load_json(cn_path *path, const char *file, const cn_path_options *options)
{
    json_t *root;
    CN_TRY(cn_json_load(file, &root));
    cn_status status = json_object_get(root, "type") ? cn_path_from_geojson(path, file, root, options)
                                                     : cn_path_from_keyframes(path, file, root, options);
    json_decref(root);
    return status;
}

cn_status cn_path_load(cn_path *path, const char *file, const cn_path_options *options)
{
    bool xml = false;
    *path = (cn_path){ 0 };
    if (options->width == 0 || options->height == 0)
        return cn_fail(CN_ERR_USAGE, "a camera path needs a picture size above 0 x 0");
    CN_TRY(is_xml(file, &xml));
    cn_status status = xml ? cn_path_from_kml(path, file, options) : load_json(path, file, options);
    if (status != CN_OK) cn_path_deinit(path);
    return status;
}
