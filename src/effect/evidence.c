/* Evidence for or against an effect, measured from the colours of tracked points. */
#include "effect/tracks.h"

#include "base/units.h"
#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

double cn_tracks_spread(const cn_tracks *tracks, double low_deg, double high_deg)
{
    enum { MAX_PAIRS = 200000, MIN_PAIRS = 50 };
    double *difference = malloc(sizeof *difference * MAX_PAIRS);
    if (!difference) return NAN;
    const double low = cos(cn_radians(high_deg)), high = cos(cn_radians(low_deg));
    size_t n = 0;
    for (size_t i = 0; i < tracks->n; i++) {
        const cn_track_observation *a = &tracks->observations[i];
        for (size_t j = i + 1; j < tracks->n && tracks->observations[j].point == a->point && n < MAX_PAIRS; j++) {
            const cn_track_observation *b = &tracks->observations[j];
            const double c = a->dir[0] * b->dir[0] + a->dir[1] * b->dir[1] + a->dir[2] * b->dir[2];
            if (c < low || c > high) continue;
            difference[n++] = fabs((double)a->residual - b->residual);
        }
    }
    const double median = n >= MIN_PAIRS ? cn_select(difference, n, n / 2) : NAN;
    free(difference);
    return median;
}

double cn_tracks_gain(const cn_tracks *tracks)
{
    double sum = 0, squares = 0;
    for (uint32_t i = 0; i < tracks->n_photos; i++) {
        sum += tracks->gain[i];
        squares += (double)tracks->gain[i] * tracks->gain[i];
    }
    const double n = tracks->n_photos, mean = sum / n;
    return sqrt(fmax(squares / n - mean * mean, 0));
}

enum { MIN_OBSERVATIONS = 30 };

/* Squared stops that one photo's colour cast and contrast explain. scratch holds as many doubles as there are
 * observations. NaN: too few observations. */
static double light_of(const cn_tracks *t, uint32_t photo, double *scratch)
{
    double cast = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
    size_t n = 0;
    for (int c = 0; c < 3; c += 2) { /* red and blue */
        n = 0;
        for (size_t i = 0; i < t->n; i++) {
            const cn_track_observation *l = &t->observations[i];
            if (l->photo != photo) continue;
            const cn_track_point *p = &t->points[l->point];
            scratch[n++] = (double)(l->log2_rgb[c] - p->log2_rgb[c]) - (double)(l->log2_luminance - p->log2_luminance);
        }
        if (n < MIN_OBSERVATIONS) return NAN;
        const double median = cn_select(scratch, n, n / 2);
        cast += 0.5 * median * median;
    }
    for (size_t i = 0; i < t->n; i++) {
        const cn_track_observation *l = &t->observations[i];
        if (l->photo != photo) continue;
        const double x = t->points[l->point].log2_luminance, y = l->residual;
        sx += x, sy += y, sxx += x * x, sxy += x * y;
    }
    const double count = (double)n, var = sxx / count - sx * sx / (count * count),
                 cov = sxy / count - sx * sy / (count * count);
    return cast + (var > 1e-6 ? cov * cov / var : 0); /* slope^2 var */
}

double cn_tracks_light(const cn_tracks *tracks)
{
    double *scratch = malloc(sizeof *scratch * (tracks->n + 1)), sum = 0;
    uint32_t n = 0;
    for (uint32_t p = 0; scratch && p < tracks->n_photos; p++) {
        const double light = light_of(tracks, p, scratch);
        if (isnan(light)) continue;
        sum += light;
        n++;
    }
    free(scratch);
    return n ? sqrt(sum / n) : NAN;
}

/* A place that a photo shows, from its camera, and the residual there. */
typedef struct lit_place {
    float xyz_m[3], distance_m, square, residual;
} lit_place;

/* Takes the mean, and a slope over the squared distance from the picture's middle, out of a photo's residuals. What
 * darkens towards the corners is the lens, not the light. */
static void remove_gain_and_vignetting(lit_place *places, size_t n)
{
    double x = 0, y = 0, xx = 0, xy = 0;
    for (size_t i = 0; i < n; i++) {
        x += (double)places[i].square, xx += (double)places[i].square * (double)places[i].square;
        y += (double)places[i].residual, xy += (double)places[i].square * (double)places[i].residual;
    }
    const double count = (double)n, var = xx - x * x / count, slope = var > 1e-6 ? (xy - x * y / count) / var : 0;
    for (size_t i = 0; i < n; i++)
        places[i].residual -= (float)(y / count + slope * ((double)places[i].square - x / count));
}

/* What neighbours are: how far apart, over the distance of the camera. Nearer ones share a wrong track or a pixel. */
#define LEAST_APART 0.01
#define MOST_APART 0.04

/* Sums the products of neighbouring residuals of one photo. */
static void sum_neighbours(const lit_place *places, size_t n, double *sum, size_t *pairs)
{
    for (size_t i = 0; i < n; i++)
        for (size_t j = i + 1; j < n; j++) {
            const lit_place *a = &places[i], *b = &places[j];
            const float d[3] = { a->xyz_m[0] - b->xyz_m[0], a->xyz_m[1] - b->xyz_m[1], a->xyz_m[2] - b->xyz_m[2] };
            const double apart =
                sqrt((double)(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])) / (double)fminf(a->distance_m, b->distance_m);
            if (apart < LEAST_APART || apart > MOST_APART) continue;
            *sum += (double)a->residual * (double)b->residual;
            (*pairs)++;
        }
}

double cn_tracks_local_light(const cn_tracks *tracks)
{
    enum { MIN_PAIRS = 500 };
    lit_place *places = malloc(sizeof *places * (tracks->n + 1)); /* a point may be twice in a photo */
    double sum = 0;
    size_t pairs = 0;
    for (uint32_t p = 0; places && p < tracks->n_photos; p++) {
        size_t n = 0;
        for (size_t i = 0; i < tracks->n; i++) {
            const cn_track_observation *l = &tracks->observations[i];
            if (l->photo != p) continue;
            lit_place *at = &places[n++];
            for (int a = 0; a < 3; a++)
                at->xyz_m[a] = -l->dir[a] * l->distance_m;
            at->distance_m = l->distance_m;
            at->square = l->square;
            at->residual = fminf(fmaxf(l->residual, -1), 1); /* a wrong track may be off by any number of stops */
        }
        if (n < MIN_OBSERVATIONS) continue;
        remove_gain_and_vignetting(places, n);
        sum_neighbours(places, n, &sum, &pairs);
    }
    free(places);
    return pairs < MIN_PAIRS ? NAN : sqrt(fmax(sum / (double)pairs, 0));
}

/* Finds the one among a point's observations [first, last) whose direction is nearest to that of a camera centre.
 * *cosine: of the angle between the two. */
static const cn_track_observation *nearest_observation(const cn_tracks *t, size_t first, size_t last,
                                                       const double dir[3], double *cosine)
{
    const cn_track_observation *best = NULL;
    *cosine = -1;
    for (size_t i = first; i < last; i++) {
        const cn_track_observation *l = &t->observations[i];
        const double c = dir[0] * l->dir[0] + dir[1] * l->dir[1] + dir[2] * l->dir[2];
        if (c > *cosine) *cosine = c, best = l;
    }
    return best;
}

/* Only points that at least this many views track are used: those stand still. */
enum { MIN_TRACK = 3 };

int cn_track_cell(const cn_camera *camera, double x_px, double y_px)
{
    const double x = floor(x_px * CN_TRACK_COLUMNS / camera->width), y = floor(y_px * CN_TRACK_ROWS / camera->height);
    return x >= 0 && y >= 0 && x < CN_TRACK_COLUMNS && y < CN_TRACK_ROWS ? (int)y * CN_TRACK_COLUMNS + (int)x : -1;
}

/* nearest[photo * CN_TRACK_CELLS + cell] of the tile's photos: the distance of the nearest tracked surface, metres;
 * INFINITY where the photo tracks no point. Caller frees. */
static float *nearest_surfaces(const cn_plan_input *input, const cn_plan_tile *tile)
{
    const cn_scene *scene = input->scene;
    float *nearest = malloc(sizeof *nearest * CN_TRACK_CELLS * (tile->n_photos + 1u));
    uint32_t *row = cn_tracks_rows(input, tile);
    for (size_t i = 0; nearest && row && i < (size_t)CN_TRACK_CELLS * tile->n_photos; i++)
        nearest[i] = INFINITY;
    for (uint32_t p = 0; nearest && row && p < scene->n_points; p++) {
        const cn_point *point = &scene->points[p];
        for (uint32_t i = 0; point->n_observations >= MIN_TRACK && i < point->n_observations; i++) {
            const cn_observation *o = &scene->observations[point->first_observation + i];
            if (row[o->view] == UINT32_MAX) continue;
            const cn_view *view = &scene->views[o->view];
            const int cell = cn_track_cell(&scene->cameras[view->camera], o->x_px, o->y_px);
            if (cell < 0) continue;
            double centre[3];
            cn_view_centre(view, centre);
            float *at = &nearest[(size_t)row[o->view] * CN_TRACK_CELLS + (size_t)cell];
            *at = fminf(*at, (float)cn_distance3(centre, point->xyz));
        }
    }
    if (!row) {
        free(nearest);
        nearest = NULL;
    }
    free(row);
    return nearest;
}

/* Without this rule a wall behind a parked tractor counts as changing, although nothing moves. Found on castle:
 * evidence 0.070 without it. */
#define HIDES 0.85
bool cn_track_is_hidden(const float nearest[CN_TRACK_CELLS], int cell, double distance)
{
    const int x = cell % CN_TRACK_COLUMNS, y = cell / CN_TRACK_COLUMNS;
    for (int v = y > 0 ? y - 1 : 0; v <= y + 1 && v < CN_TRACK_ROWS; v++)
        for (int u = x > 0 ? x - 1 : 0; u <= x + 1 && u < CN_TRACK_COLUMNS; u++)
            if ((double)nearest[v * CN_TRACK_COLUMNS + u] < HIDES * distance) return true;
    return false;
}

/* What tells whether an untracked point has changed. */
typedef struct untracked {
    const cn_plan_input *input;
    const cn_plan_tile *tile;
    const cn_tracks *tracks;
    const float *nearest;
} untracked;

/* The least residual of the patches about a place. At an edge a small error of the pose shows another colour, which
 * is not a change of the scene. */
static bool least_residual(const untracked *u, const cn_view *view, const double xy[2], float expected, float *residual)
{
    const cn_camera *camera = &u->input->scene->cameras[view->camera];
    if (view->photo >= cn_pixel_store_count(u->input->pixels)) return false;
    const cn_pixel_extent size = cn_pixel_store_extent(u->input->pixels, view->photo);
    const double side = cn_track_side(size, CN_TRACKS_FINE);
    const cn_track_patch patch = { CN_TRACKS_FINE, 0.003f };
    bool found = false;
    for (int i = 0; i < 9; i++) {
        const double x = xy[0] + (i % 3 - 1) * side * camera->width / size.width,
                     y = xy[1] + (i / 3 - 1) * side * camera->height / size.height;
        cn_track_observation observation;
        if (!cn_tracks_colour(u->input, view, x, y, patch, &observation)) continue;
        const float r = observation.log2_luminance - expected;
        if (!found || fabsf(r) < fabsf(*residual)) *residual = r;
        found = true;
    }
    return found;
}

/* Cosine of 5 degrees: from farther aside, a surface that stands still hides other points. With 10 degrees, a smooth
 * statue that hides the wall behind it counted as changing (evidence 0.295, of 7 photos; transients cost it 1.5 dB).
 * With 5, castle goes from 0.007 to -0.004, two synthetic cities without people from 0.011 and 0.031 to 0.014 both, and
 * with people from 0.27 and 0.34 to 0.28 and 0.40. */
#define SAME_DIRECTION 0.9962

/* Residual of a point in a photo that does not track it, although another photo tracks it from nearly the same
 * direction. */
static bool untracked_residual(const untracked *u, size_t first, size_t last, uint32_t photo, float *residual)
{
    const cn_tracks *t = u->tracks;
    const cn_scene *scene = u->input->scene;
    const cn_view *view = &scene->views[u->tile->photos[photo]];
    const cn_camera *camera = &scene->cameras[view->camera];
    const cn_track_point *p = &t->points[t->observations[first].point];
    const double *x = scene->points[p->scene_point].xyz;
    double centre[3], dir[3], cam[3], xy[2], cosine;
    cn_view_centre(view, centre);
    for (int a = 0; a < 3; a++)
        dir[a] = centre[a] - x[a];
    const double distance = sqrt(dir[0] * dir[0] + dir[1] * dir[1] + dir[2] * dir[2]);
    if (!cn_normalize3(dir)) return false;
    const cn_track_observation *near = nearest_observation(t, first, last, dir, &cosine);
    if (!near || cosine < SAME_DIRECTION || distance > 1.3 * (double)near->distance_m ||
        distance < 0.75 * (double)near->distance_m)
        return false;
    cn_mat3_vec(view->rotation, x, cam);
    for (int a = 0; a < 3; a++)
        cam[a] += view->translation[a];
    if (!cn_camera_project(camera, cam, xy)) return false;
    const int cell = cn_track_cell(camera, xy[0], xy[1]);
    if (cell < 0 || cn_track_is_hidden(u->nearest + (size_t)photo * CN_TRACK_CELLS, cell, distance)) return false;
    return least_residual(u, view, xy, p->log2_luminance + t->gain[photo], residual);
}

/* Whether a view tracks a scene's point. Not every observation of it is among those of the tracks. */
static bool tracks_it(const cn_scene *scene, uint32_t point, uint32_t view)
{
    const cn_point *p = &scene->points[point];
    for (uint32_t i = 0; i < p->n_observations; i++)
        if (scene->observations[(size_t)p->first_observation + i].view == view) return true;
    return false;
}

/* Standard errors that a share exceeds by chance in one case of twenty. sacre-coeur has 570 such places. Photos 480 and
 * 800 px wide gave 0.023 and 0.038 without this (threshold 0.030), and transients cost it 0.5 to 1.2 dB. */
#define ONE_SIDED 1.645

static double outlier_share(const untracked *u, float limit)
{
    const cn_tracks *t = u->tracks;
    enum { MIN_UNTRACKED = 200 };
    size_t outliers = 0, n = 0, tracked_outliers = 0;
    for (size_t i = 0; i < t->n; i++)
        tracked_outliers += fabsf(t->observations[i].residual) > limit;
    for (size_t first = 0, last; first < t->n; first = last) {
        last = first;
        while (last < t->n && t->observations[last].point == t->observations[first].point)
            last++;
        const uint32_t point = t->points[t->observations[first].point].scene_point;
        for (uint32_t p = 0; p < u->tile->n_photos; p++) {
            float residual;
            if (tracks_it(u->input->scene, point, u->tile->photos[p]) ||
                !untracked_residual(u, first, last, p, &residual))
                continue;
            n++;
            outliers += fabsf(residual) > limit;
        }
    }
    if (n < MIN_UNTRACKED) return NAN;
    const double share = (double)outliers / (double)n, error = sqrt(share * (1 - share) / (double)n);
    return share - ONE_SIDED * error - (double)tracked_outliers / (double)t->n;
}

double cn_tracks_transient(const cn_plan_input *input, const cn_plan_tile *tile)
{
    cn_tracks t;
    if (cn_tracks_gather(&t, input, tile, CN_TRACKS_FINE) != CN_OK) return NAN;
    double *size = malloc(sizeof *size * t.n), share = NAN;
    float *nearest = nearest_surfaces(input, tile);
    if (size && nearest) {
        for (size_t i = 0; i < t.n; i++)
            size[i] = fabs((double)t.observations[i].residual);
        /* An outlier is off by a stop, or by four standard deviations, estimated from the median. Not measured
         * apart. */
        const float limit = (float)fmax(1, 4 * 1.4826 * cn_select(size, t.n, t.n / 2));
        share = outlier_share(&(untracked){ input, tile, &t, nearest }, limit);
    }
    free(size);
    free(nearest);
    cn_tracks_deinit(&t);
    return share;
}
