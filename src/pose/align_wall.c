/* Finds a wall in the sparse points: a plane that holds much of them. Photos of a front from the street look up, all
 * nearly one way: then nothing in the cameras tells their pitch, but walls are upright. */
#include "base/rng.h"
#include "math/linalg.h"
#include "pose/align_up.h"
#include "pose/similarity.h"

#include <math.h>
#include <stdlib.h>

enum { MIN_TRACK = 3, FEWEST = 100, MOST = 4000, TRIES = 1000, ROUNDS = 5 };
/* Measured on ten models of fronts by COLMAP: the largest plane holds 0.30 (sacre-coeur: towers and domes) to 0.99 of
 * the points, and its second deviation is 0.05 to 0.25 of the distance. lund, along a street, has 0.27. */
#define THICK 0.01 /* of the distance from the cameras */
#define SHARE 0.4
#define WIDE 0.05 /* of that distance: the plane's points are not on a line */
/* Sine of 40 degrees to the up that the cameras tell. The ground leans more in photos from the air that look less than
 * 50 degrees down; below that neither it nor the cameras tell up. */
#define LEANS 0.643

typedef struct wall_search {
    double (*points)[3];
    bool *on;
    uint32_t n;
    double distance, thickness;
    const double *up;
} wall_search;

/* The points that are used, evenly chosen, and how far they are from the cameras. */
static bool choose_points(const cn_scene *scene, wall_search *s)
{
    double cameras[3] = { 0 }, *distances = malloc(MOST * sizeof *distances);
    s->points = malloc(MOST * sizeof *s->points);
    s->on = malloc(MOST * sizeof *s->on);
    for (uint32_t i = 0; i < scene->n_views; i++) {
        double centre[3];
        cn_view_centre(&scene->views[i], centre);
        for (int k = 0; k < 3; k++)
            cameras[k] += centre[k] / scene->n_views;
    }
    const uint32_t step = scene->n_points / MOST + 1;
    for (uint32_t i = 0; distances && s->points && s->on && i < scene->n_points && s->n < MOST; i += step) {
        const cn_point *point = &scene->points[i];
        double away[3];
        if (point->n_observations < MIN_TRACK) continue;
        for (int k = 0; k < 3; k++) {
            s->points[s->n][k] = point->xyz[k];
            away[k] = point->xyz[k] - cameras[k];
        }
        distances[s->n++] = cn_norm3(away);
    }
    const bool enough = s->n >= FEWEST;
    if (enough) s->distance = cn_select(distances, s->n, s->n / 2);
    s->thickness = THICK * s->distance;
    free(distances);
    return enough;
}

/* Marks the points on a plane. Returns how many. */
static uint32_t mark(const wall_search *s, const double normal[3], double offset)
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < s->n; i++) {
        s->on[i] = fabs(cn_dot3(normal, s->points[i]) - offset) < s->thickness;
        n += s->on[i];
    }
    return n;
}

/* The plane through three points that most points are on, of those that may be upright. */
static uint32_t largest_plane(const wall_search *s, double normal[3], double *offset)
{
    uint32_t most = 0;
    for (uint32_t try = 0; try < TRIES; try++) {
        const double *p[3];
        double side[2][3], across[3];
        for (uint32_t k = 0; k < 3; k++)
            p[k] = s->points[cn_rng_below(1, k, try, s->n)];
        for (int k = 0; k < 3; k++) {
            side[0][k] = p[1][k] - p[0][k];
            side[1][k] = p[2][k] - p[0][k];
        }
        cn_cross3(side[0], side[1], across);
        if (!cn_normalize3(across) || fabs(cn_dot3(across, s->up)) > LEANS) continue;
        const uint32_t n = mark(s, across, cn_dot3(across, p[0]));
        if (n <= most) continue;
        most = n;
        *offset = cn_dot3(across, p[0]);
        for (int k = 0; k < 3; k++)
            normal[k] = across[k];
    }
    return most;
}

/* Fits the plane to its own points. */
static bool refine(const wall_search *s, double normal[3], double *offset)
{
    double deviation[3] = { 0 }, axes[9];
    uint32_t n = 0;
    for (int round = 0; round < ROUNDS; round++) {
        double middle[3] = { 0 };
        n = mark(s, normal, *offset);
        if (n < SHARE * s->n) return false;
        for (uint32_t i = 0; i < s->n; i++)
            for (int k = 0; k < 3 && s->on[i]; k++)
                middle[k] += s->points[i][k] / n;
        cn_spread(s->n, (const double(*)[3])s->points, s->on, deviation, axes);
        for (int k = 0; k < 3; k++)
            normal[k] = axes[3 * k];
        *offset = cn_dot3(normal, middle);
    }
    return deviation[1] > WIDE * s->distance && fabs(cn_dot3(normal, s->up)) <= LEANS;
}

bool cn_align_wall(const cn_scene *scene, const double up[3], double normal[3])
{
    wall_search s = { .up = up };
    double offset;
    const bool found = choose_points(scene, &s) && largest_plane(&s, normal, &offset) && refine(&s, normal, &offset);
    free(s.points);
    free(s.on);
    return found;
}
