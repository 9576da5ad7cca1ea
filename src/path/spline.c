/* From keyframes to pictures: positions on a centripetal Catmull-Rom spline, directions by slerp or by places looked
 * at. */
#include "path/path.h"

#include "base/units.h"
#include "math/linalg.h"

#include <math.h>
#include <string.h>

void cn_path_angles(double heading_deg, double pitch_deg, double roll_deg, double cam_from_world[9])
{
    double h = cn_radians(heading_deg), p = cn_radians(pitch_deg), r = cn_radians(roll_deg);
    double forward[3] = { sin(h) * cos(p), cos(h) * cos(p), sin(p) }, right[3] = { cos(h), -sin(h), 0 }, down[3];
    cn_cross3(forward, right, down);
    double *m = cam_from_world;
    for (int k = 0; k < 3; k++) {
        m[k] = cos(r) * right[k] + sin(r) * down[k];
        m[3 + k] = cos(r) * down[k] - sin(r) * right[k];
        m[6 + k] = forward[k];
    }
}

bool cn_path_look(const double position[3], const double target[3], double heading_deg, double roll_deg, double m[9])
{
    double d[3] = { target[0] - position[0], target[1] - position[1], target[2] - position[2] };
    double across = hypot(d[0], d[1]), length = hypot(across, d[2]);
    if (!(length > 1e-9)) return false;
    double heading = across > 1e-6 * length ? cn_degrees(atan2(d[0], d[1])) : heading_deg;
    cn_path_angles(heading, cn_degrees(atan2(d[2], across)), roll_deg, m);
    return true;
}

typedef double point3[3];

static void lerp3(const double a[3], const double b[3], double t, double out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = a[k] + t * (b[k] - a[k]);
}

/* Centripetal Catmull-Rom between p[1] and p[2] (Barry and Goldman's pyramid): no loops or cusps within a segment. */
static void catmull_rom(const point3 p[4], double t, double out[3])
{
    double knot[4] = { 0 }, step[3];
    for (int i = 0; i < 3; i++)
        step[i] = sqrt(cn_distance3(p[i], p[i + 1]));
    if (!(step[1] > 0)) {
        memcpy(out, p[1], sizeof(point3));
        return;
    }
    /* For coinciding neighbours any positive knot distance works. */
    if (step[0] < 1e-6 * step[1]) step[0] = step[1];
    if (step[2] < 1e-6 * step[1]) step[2] = step[1];
    for (int i = 0; i < 3; i++)
        knot[i + 1] = knot[i] + step[i];
    double u = knot[1] + t * step[1];
    point3 a[3], b[2];
    for (int i = 0; i < 3; i++)
        lerp3(p[i], p[i + 1], (u - knot[i]) / (knot[i + 1] - knot[i]), a[i]);
    for (int i = 0; i < 2; i++)
        lerp3(a[i], a[i + 1], (u - knot[i]) / (knot[i + 2] - knot[i]), b[i]);
    lerp3(b[0], b[1], t, out);
}

/* A flight from keyframe to keyframe. */
typedef struct flight {
    const cn_keyframe *keys;
    size_t n;
    bool splined_targets; /* every keyframe has a target */
} flight;

/* The spline's four points for segment i; beyond the ends the neighbour is mirrored. target: of look-at points. */
static void segment_points(const flight *fl, size_t i, bool target, point3 p[4])
{
    const cn_keyframe *keys = fl->keys;
    for (int j = 1; j <= 2; j++) {
        const cn_keyframe *k = &keys[i + (size_t)j - 1];
        memcpy(p[j], target ? k->target : k->position, sizeof(point3));
    }
    if (i > 0)
        memcpy(p[0], target ? keys[i - 1].target : keys[i - 1].position, sizeof(point3));
    else
        lerp3(p[1], p[2], -1, p[0]);
    if (i + 2 < fl->n)
        memcpy(p[3], target ? keys[i + 2].target : keys[i + 2].position, sizeof(point3));
    else
        lerp3(p[2], p[1], -1, p[3]);
}

/* What the camera takes at shot->time_s, between keyframes i and i + 1. */
static void aim(const flight *fl, size_t i, cn_path_shot *shot)
{
    const cn_keyframe *a = &fl->keys[i], *b = i + 1 < fl->n ? &fl->keys[i + 1] : a;
    double t = b == a ? 0 : (shot->time_s - a->time_s) / (b->time_s - a->time_s);
    t = fmin(fmax(t, 0), 1);
    double smooth = t * t * (3 - 2 * t), target[3], quat[4];
    shot->vfov_deg = a->vfov_deg + smooth * (b->vfov_deg - a->vfov_deg);
    point3 p[4];
    memcpy(shot->centre, a->position, sizeof shot->centre);
    memcpy(target, a->target, sizeof target);
    if (b != a) {
        segment_points(fl, i, false, p);
        catmull_rom((const point3 *)p, t, shot->centre);
    }
    if (b != a && fl->splined_targets) {
        segment_points(fl, i, true, p);
        catmull_rom((const point3 *)p, t, target);
    }
    double roll = a->roll_deg + smooth * (b->roll_deg - a->roll_deg);
    double heading = a->heading_deg + smooth * remainder(b->heading_deg - a->heading_deg, 360);
    /* At its target the camera has no direction: keep the one interpolated between the keyframes. */
    if (!fl->splined_targets || !cn_path_look(shot->centre, target, heading, roll, shot->cam_from_world)) {
        cn_quat_slerp(a->quat, b->quat, t, quat);
        cn_quat_to_mat3(quat, shot->cam_from_world);
    }
}

cn_status cn_path_fly(cn_path *path, const cn_keyframe *keys, size_t n, uint32_t width, uint32_t height)
{
    flight fl = { keys, n, true };
    for (size_t i = 0; i < n; i++)
        fl.splined_targets = fl.splined_targets && keys[i].has_target;
    double first = keys[0].time_s, last = keys[n - 1].time_s;
    size_t segment = 0;
    for (uint32_t f = 0; f < path->n_frames; f++) {
        cn_path_shot shot = { .width = width, .height = height };
        shot.time_s = path->n_frames > 1 ? first + (last - first) * f / (path->n_frames - 1) : first;
        while (segment + 2 < n && shot.time_s >= keys[segment + 1].time_s)
            segment++;
        aim(&fl, segment, &shot);
        CN_TRY(cn_path_place(path, f, &shot));
    }
    return CN_OK;
}
