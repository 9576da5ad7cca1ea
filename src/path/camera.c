#include "path/camera.h"

#include "base/units.h"
#include "math/linalg.h"

#include <math.h>
#include <string.h>

#define SNAP 0.01 /* of a frame's length */

static void y_up(const double from[3], double to[3])
{
    const double v[3] = { from[0], from[2], -from[1] };
    memcpy(to, v, sizeof v);
}

static void z_up(const double from[3], double to[3])
{
    const double v[3] = { from[0], -from[2], from[1] };
    memcpy(to, v, sizeof v);
}

cn_path_sample cn_path_sample_of(const cn_path_frame *frame)
{
    cn_path_sample s = { .time_s = frame->time_s, .vfov_deg = cn_camera_vfov_deg(&frame->camera) };
    double centre[3], axes[3][3];
    cn_view_centre(&frame->view, centre);
    y_up(centre, s.centre);
    for (int a = 0; a < 3; a++) /* the rows are right, down, forward */
        y_up(frame->view.rotation + 3 * a, axes[a]);
    for (int k = 0; k < 3; k++) {
        s.rotation[3 * k] = axes[0][k];
        s.rotation[3 * k + 1] = -axes[1][k];
        s.rotation[3 * k + 2] = -axes[2][k];
    }
    return s;
}

static void pose_of(const cn_path_sample *s, double cam_from_world[9], double centre[3])
{
    z_up(s->centre, centre);
    for (int a = 0; a < 3; a++) {
        const double sign = a ? -1 : 1;
        const double axis[3] = { sign * s->rotation[a], sign * s->rotation[3 + a], sign * s->rotation[6 + a] };
        z_up(axis, cam_from_world + 3 * a);
    }
}

static void between(const cn_path_sample *a, const cn_path_sample *b, double t, cn_path_sample *out)
{
    double from[4], to[4], q[4];
    *out = *a;
    for (int k = 0; k < 3; k++)
        out->centre[k] += t * (b->centre[k] - a->centre[k]);
    out->vfov_deg += t * (b->vfov_deg - a->vfov_deg);
    cn_mat3_to_quat(a->rotation, from);
    cn_mat3_to_quat(b->rotation, to);
    cn_quat_slerp(from, to, t, q);
    cn_quat_to_mat3(q, out->rotation);
}

/* The camera at a time; *at is where the search began, and begins the next time. */
static cn_path_sample sample_at(const cn_path_sample *samples, size_t n, double time_s, double snap_s, size_t *at)
{
    while (*at + 2 < n && samples[*at + 1].time_s <= time_s)
        ++*at;
    for (size_t i = *at; i < n && i < *at + 2; i++)
        if (fabs(samples[i].time_s - time_s) <= snap_s) return samples[i];
    if (n < 2) return samples[0];
    const cn_path_sample *a = &samples[*at], *b = a + 1;
    cn_path_sample out;
    between(a, b, fmin(fmax((time_s - a->time_s) / (b->time_s - a->time_s), 0), 1), &out);
    return out;
}

cn_status cn_path_from_samples(cn_path *path, const char *file, const cn_path_sample *samples, size_t n, double fps,
                               const cn_path_options *options)
{
    const double first = samples[0].time_s, duration_s = samples[n - 1].time_s - first;
    size_t at = 0;
    CN_TRY(cn_path_start(path, file, duration_s, fps, options));
    const double step_s = path->n_frames > 1 ? duration_s / (path->n_frames - 1) : 0;
    for (uint32_t i = 0; i < path->n_frames; i++) {
        cn_path_sample s = sample_at(samples, n, first + i * step_s, SNAP * step_s, &at);
        cn_path_shot shot = {
            .time_s = i * step_s, .vfov_deg = s.vfov_deg, .width = options->width, .height = options->height
        };
        pose_of(&s, shot.cam_from_world, shot.centre);
        CN_TRY(cn_path_place(path, i, &shot));
    }
    return CN_OK;
}
