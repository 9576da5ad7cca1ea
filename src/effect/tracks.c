#include "effect/tracks.h"

#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_POINTS = 3000, MIN_POINTS = 50, MAX_OBSERVATIONS = 64, MIN_SIGHTINGS = 3, GAIN_ROUNDS = 4 };

uint32_t *cn_tracks_rows(const cn_plan_input *input, const cn_plan_tile *tile)
{
    uint32_t *row = malloc(sizeof *row * (input->scene->n_views + 1u));
    if (!row) return NULL;
    memset(row, 0xff, sizeof *row * input->scene->n_views);
    for (uint32_t i = 0; i < tile->n_photos; i++)
        row[tile->photos[i]] = i;
    return row;
}

double cn_track_side(cn_pixel_extent size, uint32_t across)
{
    return fmax(1, (double)size.width / across);
}

enum { MAX_SIDE = 4 }; /* samples along a patch's side */

/* Mean of a patch about a place in a photo of the store; false: part of it is masked. */
static bool patch_mean(const cn_plan_input *input, uint32_t photo, double x, double y, uint32_t across, float rgb[3])
{
    const cn_pixel_extent size = cn_pixel_store_extent(input->pixels, photo);
    const double side = cn_track_side(size, across);
    const size_t k = side > MAX_SIDE ? MAX_SIDE : (size_t)ceil(side), n = k * k;
    uint32_t photos[MAX_SIDE * MAX_SIDE];
    uint16_t px[MAX_SIDE * MAX_SIDE], py[MAX_SIDE * MAX_SIDE];
    float rgbw[4 * MAX_SIDE * MAX_SIDE];
    for (size_t i = 0; i < n; i++) {
        const double at_x = x + (((double)(i % k) + 0.5) / (double)k - 0.5) * side,
                     at_y = y + (((double)(i / k) + 0.5) / (double)k - 0.5) * side;
        photos[i] = photo;
        px[i] = (uint16_t)fmin(fmax(at_x, 0), size.width - 1.0);
        py[i] = (uint16_t)fmin(fmax(at_y, 0), size.height - 1.0);
    }
    if (cn_pixel_store_gather(input->pixels, n, photos, px, py, rgbw) != CN_OK) return false;
    rgb[0] = rgb[1] = rgb[2] = 0;
    for (size_t i = 0; i < n; i++) {
        if (rgbw[4 * i + 3] < 0.5f) return false;
        for (size_t c = 0; c < 3; c++)
            rgb[c] += rgbw[4 * i + c] / (float)n;
    }
    return true;
}

bool cn_tracks_colour(const cn_plan_input *input, const cn_view *view, double x_px, double y_px, cn_track_patch patch,
                      cn_track_observation *observation)
{
    const cn_camera *camera = &input->scene->cameras[view->camera];
    if (view->photo >= cn_pixel_store_count(input->pixels)) return false;
    const cn_pixel_extent size = cn_pixel_store_extent(input->pixels, view->photo);
    const double x = x_px * size.width / camera->width, y = y_px * size.height / camera->height;
    if (!(x >= 0 && y >= 0 && x < size.width && y < size.height)) return false;
    float rgb[3];
    if (!patch_mean(input, view->photo, x, y, patch.across, rgb)) return false;
    const float y_linear = 0.2722f * rgb[0] + 0.6741f * rgb[1] + 0.0537f * rgb[2]; /* luminance of AP1 */
    /* Colours near black and near white are left out: a JPEG's tone curve and noise falsify them. Not measured
     * apart. */
    if (y_linear < patch.darkest || y_linear > 0.85f) return false;
    for (int c = 0; c < 3; c++)
        observation->log2_rgb[c] = log2f(fmaxf(rgb[c], 0.25f * patch.darkest));
    observation->log2_luminance = log2f(y_linear);
    return true;
}

double cn_track_square(double x, double y, uint32_t width, uint32_t height)
{
    const double half_w = 0.5 * width, half_h = 0.5 * height, u = x - half_w, v = y - half_h;
    return (u * u + v * v) / (half_w * half_w + half_h * half_h);
}

#define DARKEST 0.01f

static bool observe(const cn_plan_input *input, const cn_point *point, const cn_observation *o, uint32_t across,
                    cn_track_observation *observation)
{
    const cn_view *view = &input->scene->views[o->view];
    const cn_track_patch patch = { across, DARKEST };
    if (!cn_tracks_colour(input, view, o->x_px, o->y_px, patch, observation)) return false;
    const cn_camera *camera = &input->scene->cameras[view->camera];
    observation->camera = view->camera;
    observation->square = (float)cn_track_square(o->x_px, o->y_px, camera->width, camera->height);
    double centre[3], dir[3];
    cn_view_centre(view, centre);
    for (int a = 0; a < 3; a++)
        dir[a] = centre[a] - point->xyz[a];
    observation->distance_m = (float)sqrt(dir[0] * dir[0] + dir[1] * dir[1] + dir[2] * dir[2]);
    if (!cn_normalize3(dir)) return false;
    for (int a = 0; a < 3; a++)
        observation->dir[a] = (float)dir[a];
    return true;
}

/* The mean of each point's colours, once the photos' gains are known. */
static void fit_points(cn_tracks *t)
{
    for (size_t i = 0; i < t->n;) {
        cn_track_point *p = &t->points[t->observations[i].point];
        double sum[4] = { 0 }, n = 0;
        for (const uint32_t point = t->observations[i].point; i < t->n && t->observations[i].point == point; i++, n++) {
            const cn_track_observation *l = &t->observations[i];
            for (int c = 0; c < 3; c++)
                sum[c] += l->log2_rgb[c] - t->gain[l->photo];
            sum[3] += l->log2_luminance - t->gain[l->photo];
        }
        for (int c = 0; c < 3; c++)
            p->log2_rgb[c] = (float)(sum[c] / n);
        p->log2_luminance = (float)(sum[3] / n);
    }
}

/* Estimates point means and photo gains in turn: an additive model in stops. */
static cn_status fit_gains(cn_tracks *t)
{
    double *sum = calloc(t->n_photos + 1u, 2 * sizeof *sum);
    if (!sum) return cn_fail(CN_ERR_NOMEM, "out of memory while measuring effects");
    for (int round = 0; round < GAIN_ROUNDS; round++) {
        fit_points(t);
        memset(sum, 0, t->n_photos * 2 * sizeof *sum);
        for (size_t i = 0; i < t->n; i++) {
            const cn_track_observation *l = &t->observations[i];
            sum[2 * (size_t)l->photo] += l->log2_luminance - t->points[l->point].log2_luminance;
            sum[2 * (size_t)l->photo + 1] += 1;
        }
        for (size_t p = 0; p < t->n_photos; p++)
            t->gain[p] = (float)(sum[2 * p] / fmax(sum[2 * p + 1], 1));
    }
    fit_points(t);
    for (size_t i = 0; i < t->n; i++)
        t->observations[i].residual = t->observations[i].log2_luminance -
                                      t->points[t->observations[i].point].log2_luminance -
                                      t->gain[t->observations[i].photo];
    free(sum);
    return CN_OK;
}

static uint32_t count_sightings(const cn_scene *scene, const cn_point *point, const uint32_t *row)
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < point->n_observations; i++)
        n += row[scene->observations[(size_t)point->first_observation + i].view] != UINT32_MAX;
    return n;
}

/* Adds what the tile's photos show of a point. Returns how many observations. */
static size_t gather_point(cn_tracks *t, const cn_plan_input *input, uint32_t point, const uint32_t *row,
                           uint32_t across)
{
    const cn_point *p = &input->scene->points[point];
    const size_t first = t->n;
    for (uint32_t i = 0; i < p->n_observations && t->n - first < MAX_OBSERVATIONS; i++) {
        const cn_observation *o = &input->scene->observations[(size_t)p->first_observation + i];
        if (row[o->view] == UINT32_MAX) continue;
        cn_track_observation *observation = &t->observations[t->n];
        observation->point = t->n_points;
        observation->photo = row[o->view];
        if (observe(input, p, o, across, observation)) t->n++;
    }
    return t->n - first;
}

/* Takes points that the tile's photos see often enough. Others do not count when they are thinned: of a large city's
 * points only few are a tile's. */
static void gather_points(cn_tracks *t, const cn_plan_input *input, const uint32_t *row, uint32_t across)
{
    const cn_scene *scene = input->scene;
    uint32_t n = 0, at = 0;
    for (uint32_t p = 0; p < scene->n_points; p++)
        n += count_sightings(scene, &scene->points[p], row) >= MIN_SIGHTINGS;
    const uint32_t stride = n / (3 * MAX_POINTS) + 1; /* more than needed, because some are masked, dark or white */
    for (uint32_t p = 0; p < scene->n_points && t->n_points < MAX_POINTS; p++) {
        if (count_sightings(scene, &scene->points[p], row) < MIN_SIGHTINGS || at++ % stride) continue;
        const size_t first = t->n;
        if (gather_point(t, input, p, row, across) < MIN_SIGHTINGS)
            t->n = first;
        else
            t->points[t->n_points++].scene_point = p;
    }
}

cn_status cn_tracks_gather(cn_tracks *tracks, const cn_plan_input *input, const cn_plan_tile *tile, uint32_t across)
{
    memset(tracks, 0, sizeof *tracks);
    if (!input->pixels || input->scene->n_points < MIN_POINTS)
        return cn_fail(CN_ERR_DATA, "tile %s has too few tracked points to measure effects from", tile->id);
    uint32_t *row = cn_tracks_rows(input, tile);
    tracks->observations = malloc(sizeof *tracks->observations * MAX_OBSERVATIONS * (MAX_POINTS + 1));
    tracks->points = calloc(MAX_POINTS, sizeof *tracks->points);
    tracks->gain = calloc(tile->n_photos ? tile->n_photos : 1, sizeof *tracks->gain);
    tracks->n_photos = tile->n_photos;
    if (!row || !tracks->observations || !tracks->points || !tracks->gain) {
        free(row);
        cn_tracks_deinit(tracks);
        return cn_fail(CN_ERR_NOMEM, "out of memory while measuring effects of tile %s", tile->id);
    }
    gather_points(tracks, input, row, across);
    free(row);
    const cn_status status =
        tracks->n_points < MIN_POINTS
            ? cn_fail(CN_ERR_DATA, "tile %s has only %u points seen three times", tile->id, tracks->n_points)
            : fit_gains(tracks);
    if (status != CN_OK) cn_tracks_deinit(tracks);
    return status;
}

void cn_tracks_deinit(cn_tracks *tracks)
{
    free(tracks->observations);
    free(tracks->points);
    free(tracks->gain);
    memset(tracks, 0, sizeof *tracks);
}
