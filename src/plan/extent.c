/* A tile's ground height, bounds, near and far, from what its photos see. */
#include "plan/plan.h"

#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MAX_SAMPLES 20000u /* enough for percentiles; memory does not grow with the tile */

typedef struct samples {
    double *x[3], *distance;
    size_t n;
} samples;

static double percentile(double *values, size_t n, double part)
{
    return cn_select(values, n, (size_t)((double)(n - 1) * part + 0.5));
}

/* Every stride-th observation of a point by the tile's photos. */
static cn_status gather(samples *s, const cn_plan_tile *tile, const cn_plan_views *views, const cn_scene *scene)
{
    uint64_t total = 0, at = 0;
    for (uint32_t i = 0; i < tile->n_photos; i++)
        total += views->views[tile->photos[i]].n_points;
    uint64_t stride = total / MAX_SAMPLES + 1, room = total / stride + 1;
    double *block = malloc(sizeof *block * 4 * room);
    if (!block) return cn_fail(CN_ERR_NOMEM, "out of memory for the points of tile %s", tile->id);
    *s = (samples){ .x = { block, block + room, block + 2 * room }, .distance = block + 3 * room };
    for (uint32_t i = 0; i < tile->n_photos; i++) {
        const cn_plan_view *v = &views->views[tile->photos[i]];
        for (; at < v->n_points; at += stride) {
            const double *p = scene->points[views->seen[v->first_point + at]].xyz;
            double squared = 0;
            for (int c = 0; c < 3; c++) {
                s->x[c][s->n] = p[c];
                squared += (v->centre[c] - p[c]) * (v->centre[c] - p[c]);
            }
            s->distance[s->n++] = sqrt(squared);
        }
        at -= v->n_points; /* offset into the next photo */
    }
    return CN_OK;
}

static bool within(const samples *s, size_t i, const double centre[3], double reach)
{
    const double x = s->x[0][i] - centre[0], y = s->x[1][i] - centre[1];
    return x * x + y * y <= reach * reach;
}

/* Keeps the samples that are horizontally near the centre and were seen from at most `far`. Keeps all when none would
 * be left. */
static void keep_near_field(samples *s, const double centre[3], double reach, double far)
{
    size_t n = 0;
    for (size_t i = 0; i < s->n; i++) {
        if (!within(s, i, centre, reach) || s->distance[i] > far) continue;
        for (int c = 0; c < 3; c++)
            s->x[c][n] = s->x[c][i];
        s->distance[n++] = s->distance[i];
    }
    if (n > 0) s->n = n;
}

static double ground(const samples *s, const double centre[3], double radius, double *scratch)
{
    size_t n = 0;
    for (size_t i = 0; i < s->n; i++)
        if (within(s, i, centre, radius)) scratch[n++] = s->x[2][i];
    if (n == 0) memcpy(scratch, s->x[2], sizeof *scratch * (n = s->n));
    return percentile(scratch, n, 0.5);
}

/* Rays begin at this fraction of the distance of the nearest sparse points. A smooth road or yard in front of the
 * camera has no points, but is nearer than those that have. Tuned on castle (points from 20 m on, its yard from 5 m):
 * half-photo 25.1 dB at 0.5, 25.8 at 0.15, preview; lund's road loses its gaps. sceaux and herz-jesus change by less
 * than 0.4 dB. */
#define NEAR 0.15
/* Rays end at this multiple of the distance of the farthest points. Not measured apart. */
#define FAR 1.5

static cn_status from_points(cn_plan_tile *tile, samples *s)
{
    double *scratch = malloc(sizeof *scratch * s->n);
    if (!scratch) return cn_fail(CN_ERR_NOMEM, "out of memory for the points of tile %s", tile->id);
    memcpy(scratch, s->distance, sizeof *scratch * s->n);
    double nearest = percentile(scratch, s->n, 0.005), farthest = percentile(scratch, s->n, 0.995);
    double median = percentile(scratch, s->n, 0.5);
    tile->near_m = fmax(NEAR * nearest, 1e-3 * median);
    tile->far_m = FAR * farthest;
    tile->centre[2] = ground(s, tile->centre, tile->radius_m, scratch);
    free(scratch);
    keep_near_field(s, tile->centre, 1.5 * fmax(tile->radius_m, median), 3 * median);
    for (int k = 0; k < 3; k++) {
        tile->bounds_min[k] = percentile(s->x[k], s->n, 0.01);
        tile->bounds_max[k] = percentile(s->x[k], s->n, 0.99);
    }
    return CN_OK;
}

/* Without points: the disc of the tile, and half a viewing distance above and below the place where the optical axes
 * meet. */
static void from_cameras(cn_plan_tile *tile, const cn_plan_views *views)
{
    double height = 0;
    for (uint32_t i = 0; i < tile->n_photos; i++)
        height += views->views[tile->photos[i]].anchor[2] / tile->n_photos;
    tile->centre[2] = height;
    for (int k = 0; k < 3; k++) {
        double half = k < 2 ? tile->radius_m : 0.5 * views->distance_m;
        tile->bounds_min[k] = tile->centre[k] - half;
        tile->bounds_max[k] = tile->centre[k] + half;
    }
    tile->near_m = 0.05 * fmax(views->guess_m, 0.1 * views->distance_m); /* neighbours in a film are very near */
    tile->far_m = 50 * views->span_m;
}

/* A camera is held by the box when it is at most this many median distances of the tile's cameras from the middle of
 * what they see. One far away would make the box, and so the field's cells, many times as large for what all photos
 * show; outside the box space is contracted, and rays begin there too. Tiles of nine photo sets have 3.4 at most. */
#define FARTHEST 5

static void hold(cn_plan_tile *tile, const double place[3], const double middle[3], double reach)
{
    if (cn_distance3(place, middle) > reach) return;
    for (int k = 0; k < 3; k++) {
        tile->bounds_min[k] = fmin(tile->bounds_min[k], place[k]);
        tile->bounds_max[k] = fmax(tile->bounds_max[k], place[k]);
    }
}

static cn_status hold_cameras(cn_plan_tile *tile, const cn_plan_views *views)
{
    double middle[3], *away = malloc(sizeof *away * (tile->n_photos + (size_t)1)), reach = views->distance_m;
    if (!away) return cn_fail(CN_ERR_NOMEM, "out of memory for the cameras of tile %s", tile->id);
    for (int k = 0; k < 3; k++)
        middle[k] = (tile->bounds_min[k] + tile->bounds_max[k]) / 2;
    for (uint32_t i = 0; i < tile->n_photos; i++)
        away[i] = cn_distance3(views->views[tile->photos[i]].centre, middle);
    if (tile->n_photos) reach = fmax(reach, cn_select(away, tile->n_photos, tile->n_photos / 2));
    free(away);
    for (uint32_t i = 0; i < tile->n_photos; i++)
        hold(tile, views->views[tile->photos[i]].centre, middle, FARTHEST * reach);
    for (uint32_t i = 0; i < tile->n_held_out; i++)
        hold(tile, views->views[tile->held_out[i]].centre, middle, FARTHEST * reach);
    return CN_OK;
}

/* What the photo sees from farthest must not lie behind the end of the rays. */
static void reach_what_all_see(cn_plan_tile *tile, const cn_plan_views *views)
{
    double farthest = 0;
    for (uint32_t i = 0; i < tile->n_photos; i++)
        farthest = fmax(farthest, views->views[tile->photos[i]].distance_m);
    for (uint32_t i = 0; i < tile->n_held_out; i++)
        farthest = fmax(farthest, views->views[tile->held_out[i]].distance_m);
    tile->far_m = fmax(tile->far_m, FAR * farthest);
}

cn_status cn_plan_extent(cn_plan_tile *tile, const cn_plan_views *views, const cn_scene *scene)
{
    samples s = { 0 };
    CN_TRY(gather(&s, tile, views, scene));
    cn_status status = CN_OK;
    if (s.n > 0)
        status = from_points(tile, &s);
    else
        from_cameras(tile, views);
    free(s.x[0]);
    CN_TRY(status);
    double diagonal = 0;
    CN_TRY(hold_cameras(tile, views));
    reach_what_all_see(tile, views);
    for (int k = 0; k < 3; k++)
        diagonal = hypot(diagonal, tile->bounds_max[k] - tile->bounds_min[k]);
    for (int k = 0; k < 3; k++) {
        tile->bounds_min[k] -= 0.05 * diagonal;
        tile->bounds_max[k] += 0.05 * diagonal;
    }
    return CN_OK;
}
