/* The default flight: a uniform cubic B-spline over some of the scene's views. A B-spline never leaves the convex hull
 * of its control points, which a Catmull-Rom spline does at sharp turns, and there the photos show nothing. It is also
 * smooth when the views are not. */
#include "path/path.h"

#include "base/units.h"
#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MAX_CONTROLS 24u
#define STEPS_PER_SEGMENT 32u

typedef struct control {
    double centre[3], quat[4];
} control;

typedef struct spline {
    control controls[MAX_CONTROLS];
    uint32_t n;
} spline;

static int compare_doubles(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Median over the views of the vertical field of view of their pinhole part. */
static cn_status median_vfov(const cn_scene *scene, double *vfov_deg)
{
    double *angles = malloc(sizeof *angles * scene->n_views);
    if (!angles) return cn_fail(CN_ERR_NOMEM, "out of memory for the default camera path");
    for (uint32_t i = 0; i < scene->n_views; i++) {
        angles[i] = cn_camera_vfov_deg(&scene->cameras[scene->views[i].camera]);
    }
    qsort(angles, scene->n_views, sizeof *angles, compare_doubles);
    *vfov_deg = angles[scene->n_views / 2];
    free(angles);
    return CN_OK;
}

/* For every i, moves the control point nearest to controls[i] to index i + 1: a greedy tour from the first. */
static void order_by_nearest(spline *s)
{
    for (uint32_t i = 0; i + 2 < s->n; i++) {
        uint32_t best = i + 1;
        for (uint32_t j = i + 2; j < s->n; j++)
            if (cn_distance3(s->controls[i].centre, s->controls[j].centre) <
                cn_distance3(s->controls[i].centre, s->controls[best].centre))
                best = j;
        control moved = s->controls[best];
        s->controls[best] = s->controls[i + 1];
        s->controls[i + 1] = moved;
    }
}

static double tour_length(const spline *s)
{
    double length = 0;
    for (uint32_t i = 0; i + 1 < s->n; i++)
        length += cn_distance3(s->controls[i].centre, s->controls[i + 1].centre);
    return length;
}

static void choose_controls(const cn_scene *scene, spline *s)
{
    s->n = scene->n_views < MAX_CONTROLS ? scene->n_views : MAX_CONTROLS;
    for (uint32_t i = 0; i < s->n; i++) {
        uint64_t view = s->n > 1 ? (uint64_t)i * (scene->n_views - 1) / (s->n - 1) : 0;
        cn_view_centre(&scene->views[view], s->controls[i].centre);
        cn_mat3_to_quat(scene->views[view].rotation, s->controls[i].quat);
    }
    /* Names of photos by different people have no order: then fly from each view to the nearest one left. */
    spline by_nearest = *s;
    order_by_nearest(&by_nearest);
    if (tour_length(s) > 1.6 * tour_length(&by_nearest)) *s = by_nearest;
    for (uint32_t i = 1; i < s->n;
         i++) { /* q and -q are the same rotation; choose signs so that neighbours do not cancel in the mean */
        double *q = s->controls[i].quat, *before = s->controls[i - 1].quat, dot = 0;
        for (int k = 0; k < 4; k++)
            dot += q[k] * before[k];
        for (int k = 0; k < 4 && dot < 0; k++)
            q[k] = -q[k];
    }
}

/* u in [0, segments]. The end points are repeated three times, so the flight begins and ends at views. */
static double segments(const spline *s)
{
    return s->n + 1.0;
}

static void evaluate(const spline *s, double u, double centre[3], double quat[4])
{
    double first = fmin(floor(u), segments(s) - 1), t = u - first;
    double basis[4] = { (1 - t) * (1 - t) * (1 - t) / 6, (3 * t * t * t - 6 * t * t + 4) / 6,
                        (-3 * t * t * t + 3 * t * t + 3 * t + 1) / 6, t * t * t / 6 };
    memset(centre, 0, sizeof(double[3]));
    memset(quat, 0, sizeof(double[4]));
    for (int j = 0; j < 4; j++) {
        double index = fmin(fmax(first + j - 2, 0), s->n - 1.0);
        const control *c = &s->controls[(uint32_t)index];
        for (int k = 0; k < 3; k++)
            centre[k] += basis[j] * c->centre[k];
        for (int k = 0; k < 4; k++)
            quat[k] += basis[j] * c->quat[k];
    }
}

/* Lengths along the spline up to each of its steps, so that frames can be spaced evenly over the ground. */
static uint32_t measure(const spline *s, double length[(MAX_CONTROLS + 1) * STEPS_PER_SEGMENT + 1])
{
    uint32_t n = (uint32_t)segments(s) * STEPS_PER_SEGMENT;
    double before[3], here[3], quat[4];
    length[0] = 0;
    evaluate(s, 0, before, quat);
    for (uint32_t i = 1; i <= n; i++) {
        evaluate(s, (double)i / STEPS_PER_SEGMENT, here, quat);
        length[i] = length[i - 1] + cn_distance3(before, here);
        memcpy(before, here, sizeof before);
    }
    return n;
}

static cn_status fly(cn_path *path, const spline *s, double vfov_deg, uint32_t width, uint32_t height)
{
    double length[(MAX_CONTROLS + 1) * STEPS_PER_SEGMENT + 1], quat[4];
    cn_path_shot shot = { .vfov_deg = vfov_deg, .width = width, .height = height };
    uint32_t n = measure(s, length), step = 0;
    for (uint32_t f = 0; f < path->n_frames; f++) {
        double part = path->n_frames > 1 ? (double)f / (path->n_frames - 1) : 0, want = part * length[n], u = part * n;
        if (length[n] > 0) {
            while (step + 1 < n && length[step + 1] < want)
                step++;
            double gap = length[step + 1] - length[step];
            u = step + (gap > 0 ? fmin((want - length[step]) / gap, 1) : 0);
        }
        evaluate(s, u / STEPS_PER_SEGMENT, shot.centre, quat);
        cn_quat_to_mat3(quat, shot.cam_from_world);
        shot.time_s = f / path->fps;
        CN_TRY(cn_path_place(path, f, &shot));
    }
    return CN_OK;
}

cn_status cn_path_default(cn_path *path, const cn_scene *scene, uint32_t n_frames, uint32_t width, uint32_t height)
{
    *path = (cn_path){ 0 };
    if (n_frames == 0 || width == 0 || height == 0)
        return cn_fail(CN_ERR_USAGE, "a camera path needs at least one frame and a picture size above 0 x 0");
    if (scene->n_views == 0)
        return cn_fail(CN_ERR_DATA, "no default flight: no photo has a pose; run `conurb poses` first");
    double vfov_deg = 0;
    spline s;
    CN_TRY(median_vfov(scene, &vfov_deg));
    choose_controls(scene, &s);
    CN_TRY(cn_path_allocate(path, n_frames, 24));
    cn_status status = fly(path, &s, vfov_deg, width, height);
    if (status != CN_OK) cn_path_deinit(path);
    return status;
}
