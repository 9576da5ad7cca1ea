/* Finds the up direction from the cameras alone. People and drones hold cameras level, so the cameras' right axes are
 * horizontal: up is the direction most perpendicular to all of them. When they are all parallel (a straight track), up
 * is known only to lie in a plane. If the cameras move forwards, up is also perpendicular to the track, whether they
 * look ahead, down or between. If they move sideways, up is the pictures' own up. */
#include "math/linalg.h"
#include "pose/align.h"
#include "pose/similarity.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define NADIR_COSINE 0.9396926207859084 /* 20 degrees */
#define SAME_WAY_UP 0.7071067811865476  /* 45 degrees */
#define MOST 0.6                        /* of the photos. Like the angle above not measured apart */
#define FLAT_SHARE 0.5 /* relief divided by camera height above which perspective determines the focal length */

static void remove_along(double v[3], const double axis[3])
{
    double along = cn_dot3(v, axis);
    for (int k = 0; k < 3; k++)
        v[k] -= along * axis[k];
}

/* The main axis of the camera centres; false when they are not on a line. */
static bool track_axis(const cn_scene *scene, double track[3])
{
    double(*centres)[3] = calloc(scene->n_views + (size_t)1, sizeof *centres), deviation[3], axes[9];
    if (!centres) return false;
    for (uint32_t i = 0; i < scene->n_views; i++)
        cn_view_centre(&scene->views[i], centres[i]);
    cn_spread(scene->n_views, (const double(*)[3])centres, NULL, deviation, axes);
    free(centres);
    for (int k = 0; k < 3; k++)
        track[k] = axes[3 * k + 2];
    return deviation[1] < 0.2 * deviation[2];
}

/* down: sum of the cameras' y axes; ahead: of their z axes. */
static bool up_of_track(const cn_scene *scene, const double right[3], const double down[3], const double ahead[3],
                        double up[3])
{
    double track[3];
    bool forwards = track_axis(scene, track) && fabs(cn_dot3(track, right)) < 0.5;
    for (int k = 0; k < 3; k++)
        up[k] = forwards ? -down[k] - ahead[k] : -down[k];
    remove_along(up, right);
    if (forwards) {
        remove_along(track, right);
        if (!cn_normalize3(track)) return false;
        remove_along(up, track);
    }
    return cn_norm3(up) > 0.05 * scene->n_views && cn_normalize3(up);
}

/* The direction to which most pictures' down is near; false where there is none. Pictures that stand on their side or
 * on their head are then left out: photos lose the EXIF that says how they were held. Two of ten such photos made a
 * street look like a view from the air. */
static bool most_agree(const cn_scene *scene, double down[3])
{
    uint32_t n = 0;
    memset(down, 0, 3 * sizeof *down);
    for (uint32_t i = 0; i < scene->n_views; i++)
        for (int k = 0; k < 3; k++)
            down[k] += scene->views[i].rotation[3 + k];
    if (!cn_normalize3(down)) return false;
    for (uint32_t i = 0; i < scene->n_views; i++)
        n += cn_dot3(scene->views[i].rotation + 3, down) > SAME_WAY_UP;
    return n >= MOST * scene->n_views;
}

bool cn_align_up(const cn_scene *scene, double up[3])
{
    double gram[9] = { 0 }, values[3], axes[9], down[3] = { 0 }, ahead[3] = { 0 }, right[3], way[3];
    const bool agree = most_agree(scene, way);
    for (uint32_t i = 0; i < scene->n_views; i++) {
        const double *r = scene->views[i].rotation;
        if (agree && cn_dot3(r + 3, way) <= SAME_WAY_UP) continue;
        for (int a = 0; a < 9; a++)
            gram[a] += r[a / 3] * r[a % 3];
        for (int k = 0; k < 3; k++) {
            down[k] += r[3 + k];
            ahead[k] += r[6 + k];
        }
    }
    cn_eigen_symmetric(3, gram, values, axes);
    for (int k = 0; k < 3; k++)
        right[k] = axes[3 * k + 2];
    if (!(values[1] > 0.02 * values[2])) return up_of_track(scene, right, down, ahead, up);
    for (int k = 0; k < 3; k++)
        up[k] = axes[3 * k];
    /* Up is -y for street cameras, and -z for cameras that look down, whose -y is only a heading. */
    double side = -cn_dot3(up, down) - cn_dot3(up, ahead);
    for (int k = 0; k < 3 && side < 0.0; k++)
        up[k] = -up[k];
    return fabs(side) > 0.05 * scene->n_views;
}

static int compare_doubles(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* The range of the middle 80 % of the points' heights, compared with the cameras' height above the median. */
static bool is_flat(const cn_scene *scene)
{
    enum { FEWEST = 20 };
    uint32_t n = scene->n_points;
    double camera = 0.0, *heights = n < FEWEST ? NULL : malloc(n * sizeof *heights);
    if (!heights) return true; /* the relief is unknown: warn, to be safe */
    for (uint32_t i = 0; i < n; i++)
        heights[i] = scene->points[i].xyz[2];
    qsort(heights, n, sizeof *heights, compare_doubles);
    double relief = heights[n - 1 - n / 10] - heights[n / 10], ground = heights[n / 2];
    free(heights);
    for (uint32_t i = 0; i < scene->n_views; i++) {
        double centre[3];
        cn_view_centre(&scene->views[i], centre);
        camera += centre[2] / scene->n_views;
    }
    return relief < FLAT_SHARE * (camera - ground);
}

bool cn_align_is_nadir(const cn_scene *scene)
{
    for (uint32_t i = 0; i < scene->n_views; i++)
        if (!(-scene->views[i].rotation[8] > NADIR_COSINE)) return false;
    return scene->n_views > 0 && is_flat(scene);
}
