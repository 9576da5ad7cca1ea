/* An orbit round a place, and the photos' own order. */
#include "path/path.h"

#include "base/number.h"
#include "base/units.h"
#include "math/linalg.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

cn_status cn_path_orbit(cn_path *path, const char *orbit, const cn_path_options *options)
{
    const cn_frame *frame = options->frame;
    double v[4], centre[3], fps = options->fps > 0 ? options->fps : 24;
    int end = 0;
    *path = (cn_path){ 0 };
    if (options->width == 0 || options->height == 0)
        return cn_fail(CN_ERR_USAGE, "a camera path needs a picture size above 0 x 0");
    const locale_t before = cn_number_begin();
    const int n = sscanf(orbit, "%lf,%lf,%lf,%lf%n", &v[0], &v[1], &v[2], &v[3], &end);
    cn_number_end(before);
    if (n != 4 || orbit[end] || !isfinite(v[0]) || !isfinite(v[1]) || !(v[2] > 0 && v[2] < 1e6) || !(fabs(v[3]) < 1e6))
        return cn_fail(CN_ERR_USAGE, "--orbit %s: give %s,RADIUS_M,HEIGHT_M, the radius above 0, without spaces", orbit,
                       frame->georeferenced ? "LAT,LON" : "X,Y (in the units of the poses: this city has no GPS)");
    if (frame->georeferenced) {
        const double place[3] = { v[0], v[1], frame->height_m };
        if (!(fabs(v[0]) <= 90 && fabs(v[1]) <= 360) || cn_frame_from_geodetic(frame, place, centre) != CN_OK)
            return cn_fail(CN_ERR_USAGE, "--orbit %s: latitude %g, longitude %g is not on Earth", orbit, v[0], v[1]);
    } else {
        memcpy(centre, v, sizeof(double[2]));
    }
    char where[160];
    snprintf(where, sizeof where, "--orbit %.140s", orbit);
    CN_TRY(cn_path_ground(options, where, 1, (const double(*)[2])centre, &centre[2]));
    CN_TRY(cn_path_start(path, where, 10, fps, options));
    cn_status status = CN_OK;
    for (uint32_t f = 0; f < path->n_frames && status == CN_OK; f++) {
        /* The last frame is one step before the first, so that the video can loop. */
        const double turn = 2 * CN_PI * f / path->n_frames;
        cn_path_shot shot = {
            .time_s = f / fps,
            .vfov_deg = 60,
            .width = options->width,
            .height = options->height,
            .centre = { centre[0] - v[2] * sin(turn), centre[1] - v[2] * cos(turn), centre[2] + v[3] },
        };
        /* a radius above 0: never one place */
        (void)cn_path_look(shot.centre, centre, cn_degrees(turn), 0, shot.cam_from_world);
        status = cn_path_place(path, f, &shot);
    }
    if (status != CN_OK) cn_path_deinit(path);
    return status;
}

cn_status cn_path_photos(cn_path *path, const cn_scene *scene, const cn_path_options *options)
{
    const size_t n = scene->n_views;
    *path = (cn_path){ 0 };
    if (options->width == 0 || options->height == 0)
        return cn_fail(CN_ERR_USAGE, "a camera path needs a picture size above 0 x 0");
    if (n == 0) return cn_fail(CN_ERR_DATA, "no photo has a pose; run `conurb poses` first");
    uint32_t *order = cn_path_by_name(scene);
    cn_keyframe *keys = order ? calloc(n, sizeof *keys) : NULL;
    double length = 0;
    for (size_t i = 0; keys && i < n; i++) {
        cn_view_centre(&scene->views[order[i]], keys[i].position);
        cn_path_rotation(scene, order[i], keys[i].quat);
        keys[i].vfov_deg = cn_path_vfov_deg(scene, order[i]);
        if (i) length += cn_distance3(keys[i - 1].position, keys[i].position);
    }
    free(order);
    if (!keys) return cn_fail(CN_ERR_NOMEM, "out of memory for a camera path through %zu photos", n);
    /* Constant speed; photos from the same place get a little time too, to turn. */
    for (size_t i = 1; i < n; i++) {
        double step = length > 0 ? cn_distance3(keys[i - 1].position, keys[i].position) / length * (double)(n - 1) : 1;
        keys[i].time_s = keys[i - 1].time_s + fmax(step, 0.05);
    }
    cn_status status =
        cn_path_start(path, "the photos' path", keys[n - 1].time_s, options->fps > 0 ? options->fps : 24, options);
    if (status == CN_OK) status = cn_path_fly(path, keys, n, options->width, options->height);
    free(keys);
    if (status != CN_OK) cn_path_deinit(path);
    return status;
}
