#include "effect/tracks.h"

#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_POINTS = 3000, MIN_POINTS = 50, MAX_LOOKS = 64, GAIN_ROUNDS = 4 };

/* Row of each view in tile->photos, UINT32_MAX for others; caller frees. */
static uint32_t *rows_of_views(const cn_plan_input *input, const cn_plan_tile *tile)
{
    uint32_t *row = malloc(sizeof *row * (input->scene->n_views + 1u));
    if (!row) return NULL;
    memset(row, 0xff, sizeof *row * input->scene->n_views);
    for (uint32_t i = 0; i < tile->n_photos; i++) row[tile->photos[i]] = i;
    return row;
}

static bool look_at(const cn_plan_input *input, const cn_point *point, const cn_observation *o, cn_track_look *look)
{
    const cn_view *view = &input->scene->views[o->view];
    const cn_camera *camera = &input->scene->cameras[view->camera];
    if (view->photo >= cn_pixel_store_count(input->pixels)) return false;
    const cn_pixel_extent size = cn_pixel_store_extent(input->pixels, view->photo);
    const double x = o->x_px * size.width / camera->width, y = o->y_px * size.height / camera->height;
    if (!(x >= 0 && y >= 0 && x < size.width && y < size.height)) return false;
    const uint16_t px = (uint16_t)x, py = (uint16_t)y;
    float rgbw[4];
    if (cn_pixel_store_gather(input->pixels, 1, &view->photo, &px, &py, rgbw) != CN_OK) return false;
    const float y_linear = 0.2722f * rgbw[0] + 0.6741f * rgbw[1] + 0.0537f * rgbw[2]; /* luminance of AP1 */
    /* Near black and near white a JPEG's tone curve and noise hide the light. */
    if (rgbw[3] < 0.5f || y_linear < 0.01f || y_linear > 0.85f) return false;
    double centre[3], dir[3];
    cn_view_centre(view, centre);
    for (int a = 0; a < 3; a++) dir[a] = centre[a] - point->xyz[a];
    if (!cn_normalize3(dir)) return false;
    for (int a = 0; a < 3; a++) look->dir[a] = (float)dir[a];
    look->log2_luminance = log2f(y_linear);
    return true;
}

/* Alternates point means and photo gains: a robust-enough additive model in stops. */
static void fit_gains(cn_tracks *t, uint32_t n_points)
{
    double *sum = calloc((size_t)n_points + t->n_photos, 2 * sizeof *sum);
    float *mean = calloc(n_points ? n_points : 1, sizeof *mean);
    for (int round = 0; sum && mean && round < GAIN_ROUNDS; round++) {
        memset(sum, 0, ((size_t)n_points + t->n_photos) * 2 * sizeof *sum);
        for (size_t i = 0; i < t->n; i++) {
            sum[2 * t->looks[i].point] += t->looks[i].log2_luminance - t->gain[t->looks[i].photo];
            sum[2 * t->looks[i].point + 1] += 1;
        }
        for (uint32_t p = 0; p < n_points; p++) mean[p] = (float)(sum[2 * p] / fmax(sum[2 * p + 1], 1));
        double *photo = sum + 2 * (size_t)n_points;
        for (size_t i = 0; i < t->n; i++) {
            photo[2 * t->looks[i].photo] += t->looks[i].log2_luminance - mean[t->looks[i].point];
            photo[2 * t->looks[i].photo + 1] += 1;
        }
        for (uint32_t p = 0; p < t->n_photos; p++) t->gain[p] = (float)(photo[2 * p] / fmax(photo[2 * p + 1], 1));
    }
    for (size_t i = 0; mean && i < t->n; i++)
        t->looks[i].residual = t->looks[i].log2_luminance - mean[t->looks[i].point] - t->gain[t->looks[i].photo];
    free(sum);
    free(mean);
}

static uint32_t gather_points(cn_tracks *t, const cn_plan_input *input, const uint32_t *row)
{
    const cn_scene *scene = input->scene;
    const uint32_t stride = scene->n_points / (4 * MAX_POINTS) + 1; /* spread over the list; many lie outside the tile */
    uint32_t n_points = 0;
    for (uint32_t p = 0; p < scene->n_points && n_points < MAX_POINTS; p += stride) {
        const cn_point *point = &scene->points[p];
        const size_t first = t->n;
        for (uint32_t i = 0; i < point->n_observations && t->n - first < MAX_LOOKS; i++) {
            const cn_observation *o = &scene->observations[point->first_observation + i];
            if (row[o->view] == UINT32_MAX) continue;
            cn_track_look *look = &t->looks[t->n];
            look->point = n_points;
            look->photo = row[o->view];
            if (look_at(input, point, o, look)) t->n++;
        }
        if (t->n - first < 3)
            t->n = first;
        else
            n_points++;
    }
    return n_points;
}

cn_status cn_tracks_gather(cn_tracks *tracks, const cn_plan_input *input, const cn_plan_tile *tile)
{
    memset(tracks, 0, sizeof *tracks);
    if (!input->pixels || input->scene->n_points < MIN_POINTS)
        return cn_fail(CN_ERR_DATA, "tile %s has too few tracked points to measure effects from", tile->id);
    uint32_t *row = rows_of_views(input, tile);
    tracks->looks = malloc(sizeof *tracks->looks * MAX_LOOKS * (MAX_POINTS + 1));
    tracks->gain = calloc(tile->n_photos ? tile->n_photos : 1, sizeof *tracks->gain);
    tracks->n_photos = tile->n_photos;
    if (!row || !tracks->looks || !tracks->gain) {
        free(row);
        cn_tracks_deinit(tracks);
        return cn_fail(CN_ERR_NOMEM, "out of memory while measuring effects of tile %s", tile->id);
    }
    const uint32_t n_points = gather_points(tracks, input, row);
    free(row);
    if (n_points < MIN_POINTS) {
        cn_tracks_deinit(tracks);
        return cn_fail(CN_ERR_DATA, "tile %s has only %u points seen three times", tile->id, n_points);
    }
    fit_gains(tracks, n_points);
    return CN_OK;
}

void cn_tracks_deinit(cn_tracks *tracks)
{
    free(tracks->looks);
    free(tracks->gain);
    memset(tracks, 0, sizeof *tracks);
}

double cn_tracks_spread(const cn_tracks *tracks, double low_deg, double high_deg)
{
    enum { MAX_PAIRS = 200000 };
    double *difference = malloc(sizeof *difference * MAX_PAIRS);
    if (!difference) return NAN;
    const double low = cos(high_deg * 0.017453292519943295), high = cos(low_deg * 0.017453292519943295);
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
    const double median = n >= MIN_POINTS ? cn_select(difference, n, n / 2) : NAN;
    free(difference);
    return median;
}
