/* What the tracked points' colours say for and against an effect. */
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
        const cn_track_look *a = &tracks->looks[i];
        for (size_t j = i + 1; j < tracks->n && tracks->looks[j].point == a->point && n < MAX_PAIRS; j++) {
            const cn_track_look *b = &tracks->looks[j];
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

enum { MIN_LOOKS = 30 };

/* Squared stops that one photo's cast and contrast explain; scratch holds as many doubles as there are looks. NaN: too
 * few. */
static double light_of(const cn_tracks *t, uint32_t photo, double *scratch)
{
    double cast = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
    size_t n = 0;
    for (int c = 0; c < 3; c += 2) { /* red and blue */
        n = 0;
        for (size_t i = 0; i < t->n; i++) {
            const cn_track_look *l = &t->looks[i];
            if (l->photo != photo) continue;
            const cn_track_point *p = &t->points[l->point];
            scratch[n++] = (double)(l->log2_rgb[c] - p->log2_rgb[c]) - (double)(l->log2_luminance - p->log2_luminance);
        }
        if (n < MIN_LOOKS) return NAN;
        const double median = cn_select(scratch, n, n / 2);
        cast += 0.5 * median * median;
    }
    for (size_t i = 0; i < t->n; i++) {
        const cn_track_look *l = &t->looks[i];
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

/* The nearest look, by direction, of a point's looks [first, last) to a camera centre; *cosine of the angle between. */
static const cn_track_look *nearest_look(const cn_tracks *t, size_t first, size_t last, const double dir[3],
                                         double *cosine)
{
    const cn_track_look *best = NULL;
    *cosine = -1;
    for (size_t i = first; i < last; i++) {
        const cn_track_look *l = &t->looks[i];
        const double c = dir[0] * l->dir[0] + dir[1] * l->dir[1] + dir[2] * l->dir[2];
        if (c > *cosine) *cosine = c, best = l;
    }
    return best;
}

/* Residual of a point in a photo that does not track it although it looks at it much as another does. */
static bool untracked_residual(const cn_plan_input *input, const cn_tracks *t, size_t first, size_t last,
                               const cn_view *view, uint32_t photo, float *residual)
{
    const cn_track_point *p = &t->points[t->looks[first].point];
    const double *x = input->scene->points[p->scene_point].xyz;
    double centre[3], dir[3], cam[3], xy[2], cosine;
    cn_view_centre(view, centre);
    for (int a = 0; a < 3; a++)
        dir[a] = centre[a] - x[a];
    const double distance = sqrt(dir[0] * dir[0] + dir[1] * dir[1] + dir[2] * dir[2]);
    if (!cn_normalize3(dir)) return false;
    const cn_track_look *near = nearest_look(t, first, last, dir, &cosine);
    if (!near || cosine < 0.985 || distance > 1.3 * (double)near->distance_m ||
        distance < 0.75 * (double)near->distance_m)
        return false;
    cn_mat3_vec(view->rotation, x, cam);
    for (int a = 0; a < 3; a++)
        cam[a] += view->translation[a];
    cn_track_look look;
    if (!cn_camera_project(&input->scene->cameras[view->camera], cam, xy)) return false;
    if (!cn_tracks_colour(input, view, xy[0], xy[1], 0.003f, &look)) return false;
    *residual = look.log2_luminance - p->log2_luminance - t->gain[photo];
    return true;
}

static bool tracks_it(const cn_tracks *t, size_t first, size_t last, uint32_t photo)
{
    for (size_t i = first; i < last; i++)
        if (t->looks[i].photo == photo) return true;
    return false;
}

static double outlier_share(const cn_plan_input *input, const cn_plan_tile *tile, const cn_tracks *t, float limit)
{
    enum { MIN_UNTRACKED = 200 };
    size_t outliers = 0, n = 0, tracked_outliers = 0;
    for (size_t i = 0; i < t->n; i++)
        tracked_outliers += fabsf(t->looks[i].residual) > limit;
    for (size_t first = 0, last; first < t->n; first = last) {
        last = first;
        while (last < t->n && t->looks[last].point == t->looks[first].point)
            last++;
        for (uint32_t p = 0; p < tile->n_photos; p++) {
            float residual;
            if (tracks_it(t, first, last, p) ||
                !untracked_residual(input, t, first, last, &input->scene->views[tile->photos[p]], p, &residual))
                continue;
            n++;
            outliers += fabsf(residual) > limit;
        }
    }
    return n < MIN_UNTRACKED ? NAN : (double)outliers / (double)n - (double)tracked_outliers / (double)t->n;
}

double cn_tracks_transient(const cn_plan_input *input, const cn_plan_tile *tile)
{
    cn_tracks t;
    if (cn_tracks_gather(&t, input, tile) != CN_OK) return NAN;
    double *size = malloc(sizeof *size * t.n), share = NAN;
    if (size) {
        for (size_t i = 0; i < t.n; i++)
            size[i] = fabs((double)t.looks[i].residual);
        /* An outlier is a stop off, or six standard deviations as the median tells them. */
        const float limit = (float)fmax(1, 6 * 1.4826 * cn_select(size, t.n, t.n / 2));
        share = outlier_share(input, tile, &t, limit);
    }
    free(size);
    cn_tracks_deinit(&t);
    return share;
}

/* Cells of a photo: which hold a sparse point. */
enum { SKY_X = 16, SKY_Y = 12 };
typedef struct sky_photo {
    bool point[SKY_Y][SKY_X];
} sky_photo;

static bool supported(const sky_photo *p, int x, int y)
{
    for (int v = y - 1; v <= y + 1; v++)
        for (int u = x - 1; u <= x + 1; u++)
            if (u >= 0 && v >= 0 && u < SKY_X && v < SKY_Y && p->point[v][u]) return true;
    return false;
}

static bool above_horizon(const cn_plan_input *input, const cn_view *view, int x, int y)
{
    const cn_camera *camera = &input->scene->cameras[view->camera];
    double in_camera[3], dir[3];
    if (cn_camera_unproject(camera, (x + 0.5) * camera->width / SKY_X, (y + 0.5) * camera->height / SKY_Y, in_camera) !=
        CN_OK)
        return false;
    cn_mat3_tvec(view->rotation, in_camera, dir);
    return dir[2] > 0.05;
}

/* Cells of one photo, from its top down to the first that a point supports. */
static uint32_t sky_cells(const cn_plan_input *input, const cn_view *view, const sky_photo *photo)
{
    uint32_t n = 0;
    for (int x = 0; x < SKY_X; x++)
        for (int y = 0; y < SKY_Y && !supported(photo, x, y) && above_horizon(input, view, x, y); y++)
            n++;
    return n;
}

double cn_tracks_sky(const cn_plan_input *input, const cn_plan_tile *tile)
{
    const cn_scene *scene = input->scene;
    if (scene->n_points < 50 || !tile->n_photos) return NAN;
    sky_photo *photos = calloc(scene->n_views, sizeof *photos);
    if (!photos) return NAN;
    for (uint64_t i = 0; i < scene->n_observations; i++) {
        const cn_observation *o = &scene->observations[i];
        const cn_camera *camera = &scene->cameras[scene->views[o->view].camera];
        const int x = (int)((double)o->x_px * SKY_X / camera->width),
                  y = (int)((double)o->y_px * SKY_Y / camera->height);
        if (x >= 0 && y >= 0 && x < SKY_X && y < SKY_Y) photos[o->view].point[y][x] = true;
    }
    uint64_t cells = 0;
    for (uint32_t p = 0; p < tile->n_photos; p++)
        cells += sky_cells(input, &scene->views[tile->photos[p]], &photos[tile->photos[p]]);
    free(photos);
    return (double)cells / ((double)tile->n_photos * SKY_X * SKY_Y);
}
