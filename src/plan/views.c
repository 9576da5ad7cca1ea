/* Computes what each view sees. */
#include "plan/plan.h"

#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

void cn_plan_views_deinit(cn_plan_views *views)
{
    free(views->views);
    free(views->seen);
    *views = (cn_plan_views){ 0 };
}

/* Counting sort of the tracks by view: each view's points, each once. */
static cn_status gather_seen(cn_plan_views *out, const cn_scene *scene)
{
    uint64_t total = 0;
    for (uint32_t p = 0; p < scene->n_points; p++) {
        const cn_point *point = &scene->points[p];
        for (uint32_t k = 0; k < point->n_observations; k++)
            out->views[scene->observations[point->first_observation + k].view].n_points++;
    }
    for (uint32_t v = 0; v < out->n; v++) {
        out->views[v].first_point = total;
        total += out->views[v].n_points;
        out->views[v].n_points = 0;
    }
    out->seen = malloc(sizeof *out->seen * (total ? total : 1));
    if (!out->seen) return cn_fail(CN_ERR_NOMEM, "out of memory for the tracks of %u points", scene->n_points);
    for (uint32_t p = 0; p < scene->n_points; p++) {
        const cn_point *point = &scene->points[p];
        for (uint32_t k = 0; k < point->n_observations; k++) {
            cn_plan_view *view = &out->views[scene->observations[point->first_observation + k].view];
            uint32_t *slot = out->seen + view->first_point + view->n_points;
            if (view->n_points > 0 && slot[-1] == p) continue; /* a track may have a photo twice */
            *slot = p;
            view->n_points++;
        }
    }
    return CN_OK;
}

/* A photo of all directions has no axis. */
static bool has_axis(const cn_plan_view *v)
{
    return cn_norm3(v->forward) > 0;
}

/* The place nearest to all optical axes, by least squares; false when they are near parallel or meet behind the
 * cameras. */
static bool meet_of_axes(const cn_plan_views *views, double meet[3])
{
    double a[9] = { 0 }, b[3] = { 0 }, values[3], vectors[9];
    uint32_t n_axes = 0;
    for (uint32_t i = 0; i < views->n; i++) {
        const cn_plan_view *v = &views->views[i];
        if (!has_axis(v)) continue;
        n_axes++;
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++) {
                double m = (r == c) - v->forward[r] * v->forward[c];
                a[3 * r + c] += m;
                b[r] += m * v->centre[c];
            }
    }
    cn_eigen_symmetric(3, a, values, vectors);
    /* The smallest eigenvalue is the mean square of the sine between the axes and their common direction: 3 degrees at
     * least. */
    if (!(values[0] > n_axes * 0.0027)) return false;
    memset(meet, 0, sizeof(double[3]));
    for (int k = 0; k < 3; k++) {
        double dot = 0;
        for (int r = 0; r < 3; r++)
            dot += vectors[3 * r + k] * b[r];
        for (int r = 0; r < 3; r++)
            meet[r] += vectors[3 * r + k] * dot / values[k];
    }
    uint32_t in_front = 0;
    for (uint32_t i = 0; i < views->n; i++) {
        const cn_plan_view *v = &views->views[i];
        double d[3] = { meet[0] - v->centre[0], meet[1] - v->centre[1], meet[2] - v->centre[2] };
        in_front += cn_dot3(d, v->forward) > 0;
    }
    return in_front >
           0.75 * n_axes; /* axes that spread from one place also meet there, but half of them behind the camera */
}

/* Largest side of the box around the camera centres, and its middle. */
static double camera_spread(const cn_plan_views *views, double middle[3])
{
    double spread = 0;
    for (int k = 0; k < 3; k++) {
        double low = INFINITY, high = -INFINITY;
        for (uint32_t i = 0; i < views->n; i++) {
            low = fmin(low, views->views[i].centre[k]);
            high = fmax(high, views->views[i].centre[k]);
        }
        middle[k] = (low + high) / 2;
        spread = fmax(spread, high - low);
    }
    return spread;
}

/* Median distance of each view to its points (0 without points); *scene_median over the views that have any, 0 if none.
 */
static cn_status distances(cn_plan_views *out, const cn_scene *scene, double *scene_median)
{
    uint32_t most = out->n, n_with = 0;
    for (uint32_t i = 0; i < out->n; i++)
        most = out->views[i].n_points > most ? out->views[i].n_points : most;
    double *scratch = malloc(sizeof *scratch * most);
    if (!scratch) return cn_fail(CN_ERR_NOMEM, "out of memory for the distances of %u points", most);
    for (uint32_t i = 0; i < out->n; i++) {
        cn_plan_view *v = &out->views[i];
        for (uint32_t k = 0; k < v->n_points; k++)
            scratch[k] = cn_distance3(v->centre, scene->points[out->seen[v->first_point + k]].xyz);
        v->distance_m = v->n_points ? cn_select(scratch, v->n_points, v->n_points / 2) : 0;
    }
    for (uint32_t i = 0; i < out->n; i++)
        if (out->views[i].n_points) scratch[n_with++] = out->views[i].distance_m;
    *scene_median = n_with ? cn_select(scratch, n_with, n_with / 2) : 0;
    free(scratch);
    return CN_OK;
}

/* Photos of a street stand this many times nearer to each other than to what they show. Not measured apart. */
#define NEIGHBOURS_AWAY 3
/* At most this many cameras are asked for their neighbour: enough for a median. */
enum { MAX_ASKED = 512 };

static double nearest_neighbour(const cn_plan_views *views, uint32_t of, double apart)
{
    double nearest = INFINITY;
    for (uint32_t i = 0; i < views->n; i++) {
        const double distance = cn_distance3(views->views[i].centre, views->views[of].centre);
        if (distance > apart) nearest = fmin(nearest, distance);
    }
    return nearest;
}

/* How far views see at least, of which only the cameras' places are known: a few times the distance of neighbours. The
 * spread of the cameras may be the length of a street. Cameras at one place, as those of a rig, are no neighbours. */
static double guess_distance(const cn_plan_views *views, double spread)
{
    double nearest[MAX_ASKED];
    const uint32_t n = views->n < MAX_ASKED ? views->n : MAX_ASKED;
    for (uint32_t i = 0; i < n; i++)
        nearest[i] = nearest_neighbour(views, (uint32_t)((uint64_t)i * views->n / n), 1e-5 * spread);
    return NEIGHBOURS_AWAY * cn_select(nearest, n, n / 2);
}

static cn_status median_distance_to(cn_plan_views *views, const double place[3], double *median)
{
    double *scratch = malloc(sizeof *scratch * views->n);
    if (!scratch) return cn_fail(CN_ERR_NOMEM, "out of memory for %u views", views->n);
    for (uint32_t i = 0; i < views->n; i++)
        scratch[i] = cn_distance3(views->views[i].centre, place);
    *median = cn_select(scratch, views->n, views->n / 2);
    free(scratch);
    return CN_OK;
}

static void set_anchors(cn_plan_views *out)
{
    for (uint32_t i = 0; i < out->n; i++) {
        cn_plan_view *v = &out->views[i];
        if (!(v->distance_m > 0)) v->distance_m = out->guess_m;
        /* Views towards the horizon must not move tiles to places that hardly any photo shows well. */
        double distance = fmin(v->distance_m, 2 * out->distance_m);
        for (int k = 0; k < 3; k++)
            v->anchor[k] = v->centre[k] + distance * v->forward[k];
    }
}

cn_status cn_plan_views_make(cn_plan_views *out, const cn_scene *scene, double spacing_m)
{
    double middle[3];
    *out = (cn_plan_views){ .views = calloc(scene->n_views, sizeof *out->views), .n = scene->n_views };
    if (!out->views) return cn_fail(CN_ERR_NOMEM, "out of memory for %u views", scene->n_views);
    for (uint32_t i = 0; i < out->n; i++) {
        cn_view_centre(&scene->views[i], out->views[i].centre);
        if (scene->cameras[scene->views[i].camera].lens != CN_LENS_EQUIRECTANGULAR)
            memcpy(out->views[i].forward, scene->views[i].rotation + 6, sizeof out->views[i].forward);
    }
    CN_TRY(gather_seen(out, scene));
    CN_TRY(distances(out, scene, &out->distance_m));
    double spread = camera_spread(out, middle);
    out->has_points = out->distance_m > 0;
    if (spread < 1e-9 * (1 + cn_norm3(middle))) spread = 0; /* rounding: one place */
    bool met = spread > 0 && meet_of_axes(out, out->focus);
    if (!(out->distance_m > 0) && met) CN_TRY(median_distance_to(out, out->focus, &out->distance_m));
    out->span_m = out->guess_m = out->distance_m;
    /* There are neither points nor a common place: parallel axes at an unknown distance, or photos of a room from
     * within. The box and the tiles follow the only known length, the spread of the cameras. */
    if (!(out->distance_m > 0)) {
        out->span_m = spread > 0 ? spread : 1;
        out->distance_m = spacing_m > 0 ? fmin(out->span_m, spacing_m) : out->span_m;
        out->guess_m = out->distance_m;
        if (spread > 0 && !(spacing_m > 0)) out->guess_m = fmin(spread, guess_distance(out, spread));
    }
    out->no_parallax = out->n > 1 && !(spread > 0.005 * out->distance_m);
    set_anchors(out);
    if (!met) {
        memset(out->focus, 0, sizeof out->focus);
        for (uint32_t i = 0; i < out->n; i++)
            for (int k = 0; k < 3; k++)
                out->focus[k] += out->views[i].anchor[k] / out->n;
    }
    return CN_OK;
}
