/* Vignetting. A lens shows the corners of a picture darker than its middle, by half a stop or more at full aperture.
 * Without this effect a place that lies in the middle of one photo and in a corner of another has two colours. View
 * dependence or the photo's code then explain that, wrongly: it does not change with the direction.
 *
 * It is found before training from the tracked points' colours (tracks.h), for each camera: least squares of the log2
 * luminance over points, photos' gains, and two terms of the distance from the picture's middle. Training then sees the
 * photos without it. A comparison with a photo puts it onto the render (stage/eval.c); other renders have none. Nothing
 * of it is in the tile but its name.
 *
 * Evidence, in stops: how much darker the corners are, the mean over the tile's photos, less twice the standard
 * error. */
#include "effect/vignetting.h"

#include "effect/effect.h"
#include "effect/tracks.h"
#include "image/image.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { TERMS = 2, CENTRE_ROUNDS = 8, FIT_ROUNDS = 6 };
/* Errors beyond so many stops count linearly (Huber), for a point may lie at an edge. Not measured apart. */
#define OUTLIER 0.15
/* A camera's terms are drawn to those of all cameras, and these to 0, as by an observation at the corners. */
#define PRIOR 1.0
/* No lens is brighter, or darker by more, at its corners. */
#define BRIGHTEST 0.0
#define DARKEST (-3.0)
/* Between a made city in four lights (0.17, 0.22), whose camera has none, and sceaux (0.36); lund 0.47 to 0.59,
 * herz-jesus 0.53, castle 0.63; brighton, sacre-coeur and five other made cities below 0.02. */
#define THRESHOLD 0.3

/* Normal equations of the terms. */
typedef struct normal {
    double a[TERMS][TERMS], b[TERMS];
} normal;

/* Columns of one observation: the terms and the luminance, each less its mean over the point and over the photo. */
typedef double columns[TERMS + 1];

typedef struct lens_fit {
    const cn_tracks *tracks;
    columns *columns;
    uint32_t n_cameras;
    double (*terms)[TERMS]; /* [n_cameras + 1]; the last: of all cameras */
    double variance;        /* of the sum of the terms of all cameras */
} lens_fit;

static void centre_points(const lens_fit *f)
{
    const cn_track_observation *o = f->tracks->observations;
    for (size_t i = 0, end; i < f->tracks->n; i = end) {
        columns mean = { 0 };
        for (end = i; end < f->tracks->n && o[end].point == o[i].point; end++)
            for (int c = 0; c <= TERMS; c++)
                mean[c] += f->columns[end][c];
        for (size_t k = i; k < end; k++)
            for (int c = 0; c <= TERMS; c++)
                f->columns[k][c] -= mean[c] / (double)(end - i);
    }
}

static void centre_photos(const lens_fit *f, columns *mean, double *count)
{
    const cn_tracks *t = f->tracks;
    memset(mean, 0, t->n_photos * sizeof *mean);
    memset(count, 0, t->n_photos * sizeof *count);
    for (size_t i = 0; i < t->n; i++) {
        count[t->observations[i].photo]++;
        for (int c = 0; c <= TERMS; c++)
            mean[t->observations[i].photo][c] += f->columns[i][c];
    }
    for (size_t i = 0; i < t->n; i++)
        for (int c = 0; c <= TERMS; c++)
            f->columns[i][c] -= mean[t->observations[i].photo][c] / count[t->observations[i].photo];
}

/* Takes the points' colours and the photos' gains out of the columns. */
static bool make_columns(lens_fit *f)
{
    const cn_tracks *t = f->tracks;
    columns *mean = malloc((t->n_photos + 1u) * sizeof *mean);
    double *count = malloc((t->n_photos + 1u) * sizeof *count);
    for (size_t i = 0; i < t->n; i++) {
        const cn_track_observation *o = &t->observations[i];
        f->columns[i][0] = (double)o->square;
        f->columns[i][1] = (double)o->square * (double)o->square;
        f->columns[i][TERMS] = (double)o->log2_luminance;
    }
    for (int round = 0; mean && count && round < CENTRE_ROUNDS; round++) {
        centre_points(f);
        centre_photos(f, mean, count);
    }
    const bool room = mean && count;
    free(mean);
    free(count);
    return room;
}

static double error_of(const lens_fit *f, size_t i, const double terms[TERMS])
{
    double error = f->columns[i][TERMS];
    for (int c = 0; c < TERMS; c++)
        error -= terms[c] * f->columns[i][c];
    return error;
}

static double weight_of(double error)
{
    return fabs(error) > OUTLIER ? OUTLIER / fabs(error) : 1;
}

static void add(normal *n, const double *row, double weight)
{
    for (int r = 0; r < TERMS; r++) {
        for (int c = 0; c < TERMS; c++)
            n->a[r][c] += weight * row[r] * row[c];
        n->b[r] += weight * row[r] * row[TERMS];
    }
}

/* Draws the terms to `prior` and solves. corner: how the sum of the terms, which is what the corners have, follows from
 * the right-hand side. */
static void solve(normal *n, const double prior[TERMS], double terms[TERMS], double corner[TERMS])
{
    for (int r = 0; r < TERMS; r++) {
        n->a[r][r] += PRIOR;
        n->b[r] += PRIOR * prior[r];
    }
    const double det = n->a[0][0] * n->a[1][1] - n->a[0][1] * n->a[1][0];
    terms[0] = (n->b[0] * n->a[1][1] - n->b[1] * n->a[0][1]) / det;
    terms[1] = (n->b[1] * n->a[0][0] - n->b[0] * n->a[1][0]) / det;
    corner[0] = (n->a[1][1] - n->a[0][1]) / det;
    corner[1] = (n->a[0][0] - n->a[0][1]) / det;
}

/* The variance of the sum of the terms. Errors of one photo go together, for its light differs from place to place, so
 * the photos' sums count (Liang and Zeger 1986). */
static double variance_of(const lens_fit *f, const double corner[TERMS], const double terms[TERMS])
{
    const cn_tracks *t = f->tracks;
    double *sum = calloc(t->n_photos + 1u, sizeof *sum), variance = 0;
    for (size_t i = 0; sum && i < t->n; i++) {
        const double e = error_of(f, i, terms);
        for (int c = 0; c < TERMS; c++)
            sum[t->observations[i].photo] += weight_of(e) * e * corner[c] * f->columns[i][c];
    }
    for (uint32_t p = 0; sum && p < t->n_photos; p++)
        variance += sum[p] * sum[p];
    const bool room = sum != NULL;
    free(sum);
    return room ? variance : INFINITY;
}

/* The terms of all cameras together. */
static void fit_all(lens_fit *f)
{
    static const double none[TERMS] = { 0 };
    const cn_tracks *t = f->tracks;
    double *terms = f->terms[f->n_cameras], corner[TERMS];
    for (int round = 0; round < FIT_ROUNDS; round++) {
        normal n = { 0 };
        for (size_t i = 0; i < t->n; i++)
            add(&n, f->columns[i], weight_of(error_of(f, i, terms)));
        solve(&n, none, terms, corner);
    }
    f->variance = variance_of(f, corner, terms);
}

/* The terms of each camera. Those of a camera without observations are the terms of all. */
static bool fit_cameras(lens_fit *f)
{
    const cn_tracks *t = f->tracks;
    const double *all = f->terms[f->n_cameras];
    normal *n = malloc((f->n_cameras + 1u) * sizeof *n);
    for (uint32_t c = 0; c < f->n_cameras; c++)
        memcpy(f->terms[c], all, sizeof f->terms[c]);
    for (int round = 0; n && round < FIT_ROUNDS; round++) {
        memset(n, 0, f->n_cameras * sizeof *n);
        for (size_t i = 0; i < t->n; i++) {
            const uint32_t camera = t->observations[i].camera;
            add(&n[camera], f->columns[i], weight_of(error_of(f, i, f->terms[camera])));
        }
        for (uint32_t c = 0; c < f->n_cameras; c++)
            solve(&n[c], all, f->terms[c], (double[TERMS]){ 0 });
    }
    const bool room = n != NULL;
    free(n);
    return room;
}

/* To what lenses can do. A picture of all directions has no corners. */
static void limit(const cn_camera *camera, double terms[TERMS])
{
    if (camera->lens == CN_LENS_EQUIRECTANGULAR) terms[0] = terms[1] = 0;
    const double corner = terms[0] + terms[1], limited = fmin(fmax(corner, DARKEST), BRIGHTEST);
    if (limited != corner) {
        terms[0] = limited;
        terms[1] = 0;
    }
}

static void lens_fit_deinit(lens_fit *f)
{
    free(f->columns);
    free(f->terms);
}

static cn_status lens_fit_make(lens_fit *f, const cn_tracks *tracks, const cn_scene *scene)
{
    *f = (lens_fit){ tracks, malloc((tracks->n + 1) * sizeof *f->columns), scene->n_cameras,
                     calloc(scene->n_cameras + 1u, sizeof *f->terms), 0 };
    bool room = f->columns && f->terms && make_columns(f);
    if (room) fit_all(f);
    room = room && fit_cameras(f);
    for (uint32_t c = 0; room && c < scene->n_cameras; c++)
        limit(&scene->cameras[c], f->terms[c]);
    if (room) return CN_OK;
    lens_fit_deinit(f);
    return cn_fail(CN_ERR_NOMEM, "out of memory while measuring vignetting");
}

/* The caller calls lens_fit_deinit and cn_tracks_deinit, unless this fails. */
static cn_status find(lens_fit *f, cn_tracks *tracks, const cn_plan_input *input, const cn_plan_tile *tile)
{
    CN_TRY(cn_tracks_gather(tracks, input, tile, CN_TRACKS_FINE));
    const cn_status status = lens_fit_make(f, tracks, input->scene);
    if (status != CN_OK) cn_tracks_deinit(tracks);
    return status;
}

cn_status cn_vignetting_find(const cn_plan_input *input, const cn_plan_tile *tile, uint32_t n, const uint32_t *views,
                             cn_vignetting *of)
{
    cn_tracks tracks;
    lens_fit f;
    CN_TRY(find(&f, &tracks, input, tile));
    for (uint32_t i = 0; i < n; i++) {
        const double *terms = f.terms[input->scene->views[views[i]].camera];
        of[i] = (cn_vignetting){ (float)terms[0], (float)terms[1] };
    }
    lens_fit_deinit(&f);
    cn_tracks_deinit(&tracks);
    return CN_OK;
}

float cn_vignetting_factor(const cn_vignetting *v, cn_pixel_extent size, double x, double y)
{
    const float s = (float)cn_track_square(x, y, size.width, size.height);
    return exp2f(s * (v->square + s * v->fourth));
}

void cn_vignetting_remove(const cn_vignetting *v, cn_pixel_extent size, uint32_t x, uint32_t y, float rgb[3])
{
    const float factor = cn_vignetting_factor(v, size, x + 0.5, y + 0.5);
    for (int c = 0; c < 3; c++)
        rgb[c] = cn_half_to_float(cn_half_from_float(rgb[c] / factor));
}

static double evidence(const cn_plan_input *input, const cn_plan_tile *tile)
{
    cn_tracks tracks;
    lens_fit f;
    if (find(&f, &tracks, input, tile) != CN_OK) return NAN;
    double darker = 0;
    for (uint32_t i = 0; i < tile->n_photos; i++) {
        const double *terms = f.terms[input->scene->views[tile->photos[i]].camera];
        darker -= (terms[0] + terms[1]) / tile->n_photos;
    }
    const double sure = darker - 2 * sqrt(f.variance);
    lens_fit_deinit(&f);
    cn_tracks_deinit(&tracks);
    return fmax(sure, 0);
}

extern const cn_effect cn_effect_vignetting;
const cn_effect cn_effect_vignetting = {
    .name = "vignetting",
    .summary = "lenses show the corners darker",
    .threshold = THRESHOLD,
    .training_only = true,
    .wants_vignetting = true,
    .unprobed = true,
    .evidence = evidence,
};
