/* Exposure. A photo's linear light is the scene's times 2^EV. EV = log2(shutter * ISO / 100 / f^2) from EXIF,
 * relative to the tile's mean, and what is learned for each photo on top of it, with zero mean. Where EXIF does not
 * say, or lacks the ISO or the f-number that other photos have, all of EV is learned.
 *
 * EXIF gives the camera's settings. It does not say how the camera developed the picture: tracked points of brighton,
 * lund and sceaux have gains that are 0.16 to 0.28 stops (rms) off EXIF's. With what is learned on top, sceaux goes
 * from 14.9, 20.4 to 15.3, 21.3 dB (plain, right halves), brighton from 21.2, 21.3 to 21.1, 21.3. Nor does it say how
 * bright the day was. Photos of several capture runs (runs.h), such as by sun and by night, therefore take EV relative
 * to the mean of their own run, as far as it is trained on; a held-out photo of a run that nobody trains on has 0, for
 * how bright that day was is not known. Otherwise the appearance codes would have to explain ten stops, and geometry
 * gets worse (3 dB on a synthetic city under four lights).
 *
 * Evidence, in stops: the standard deviation of EV over the tile's photos, where at least half of them have it, or that
 * of the gains that the tracked points' colours show between photos (tracks.h), whichever is larger. Photos with one
 * exposure by EXIF still have gains when they were edited, or when the day's brightness changed. */
#include "effect/effect.h"
#include "effect/runs.h"
#include "effect/tracks.h"

#include <math.h>
#include <stdlib.h>

/* A photo's constants: EV, and 1 where something is learned on top: everywhere, but not in tiles of earlier
 * versions. */
enum { EV, UNKNOWN, CONSTANTS };

/* Gains cost half of this times their square. A code of appearance can stand for a gain, and then nothing holds either:
 * of 20 frames of a street, in grey and without EXIF, one had a gain of -2.9 stops, with a code and a sky that made up
 * for it, and its neighbour that was not trained on came out too bright. Found on that street (experiments.md, "Gains
 * that nothing holds"). A gain of a stop that the photo does show moves by about a thousandth of a
 * stop, as calculated for a mid grey. */
#define PRIOR 2e-4f

/* A photo's EV by EXIF. NaN also where it lacks a setting that others tell, or tells one that they lack: a guess of the
 * f-number would be off by some stops. */
static double ev_of(const cn_photo *photo, cn_effect_settings told)
{
    const bool alike = (photo->iso > 0) == told.iso && (photo->f_number > 0) == told.f_number;
    return alike ? cn_photo_exposure_ev(photo) : NAN;
}

static void constants_of(const cn_photo *photo, cn_effect_settings told, float *row)
{
    row[EV] = (float)ev_of(photo, told);
    row[UNKNOWN] = cn_run_time(photo); /* for `centre` */
}

/* The mean EV of the run's photos that are trained on; NaN when none of them has one. */
static float mean_ev(const float *rows, uint32_t n_trained, bool any_run, float run)
{
    double sum = 0;
    uint32_t known = 0;
    for (uint32_t i = 0; i < n_trained; i++) {
        const float *row = rows + CONSTANTS * (size_t)i;
        if (!isfinite(row[EV]) || !(any_run || row[UNKNOWN] == run)) continue;
        sum += row[EV];
        known++;
    }
    return known ? (float)(sum / known) : NAN;
}

static void centre(float *rows, uint32_t n, uint32_t n_trained)
{
    const bool one = cn_runs_find_trained(rows + UNKNOWN, CONSTANTS, n, n_trained) == 1;
    float *mean = malloc(sizeof *mean * (n + (size_t)1));
    for (uint32_t i = 0; mean && i < n; i++) {
        const float run = rows[CONSTANTS * (size_t)i + UNKNOWN];
        mean[i] = mean_ev(rows, n_trained, one && run >= 0, run);
    }
    for (uint32_t i = 0; i < n; i++) {
        float *row = rows + CONSTANTS * (size_t)i;
        row[UNKNOWN] = 1;
        row[EV] = mean && isfinite(row[EV] - mean[i]) ? row[EV] - mean[i] : 0;
    }
    free(mean);
}

static void project(const cn_effect_photos *photos, float *rows, double progress)
{
    (void)progress;
    cn_effect_zero_mean(photos->n, 1, rows);
}

static void unfreeze(float *constants)
{
    constants[UNKNOWN] = 1;
}

static float gain(const cn_effect_data *data, uint32_t photo)
{
    const float *row = data->constants + CONSTANTS * (size_t)photo;
    return exp2f(row[EV] + row[UNKNOWN] * data->photo[photo]);
}

static void pixel(const cn_effect_rays *rays, const cn_effect_data *data, float *rgb, float *saved)
{
    for (uint32_t i = 0; i < rays->n; i++) {
        const float g = gain(data, rays->photo[i]);
        for (int c = 0; c < 3; c++) {
            rgb[3 * (size_t)i + (size_t)c] *= g;
            saved[3 * (size_t)i + (size_t)c] = rgb[3 * (size_t)i + (size_t)c];
        }
    }
}

/* Gains have a cost, as codes of skies have (sky.c). */
static double loss(const cn_effect_rays *rays, const cn_effect_data *data, const cn_effect_residuals *residuals,
                   float *factor, float *saved)
{
    (void)factor;
    double sum = 0;
    for (uint32_t i = 0; i < rays->n; i++) {
        const float stops = data->photo[rays->photo[i]], cost = PRIOR * residuals->scale[i];
        saved[3 * CN_EFFECT_RAYS + i] = cost * stops;
        sum += (double)(0.5f * cost * stops * stops);
    }
    return sum;
}

static void pixel_backward(const cn_effect_rays *rays, const cn_effect_data *data, float *d_rgb, float *saved,
                           const cn_effect_grad *grad)
{
    for (uint32_t i = 0; i < rays->n; i++) {
        const uint32_t photo = rays->photo[i];
        const float g = gain(data, photo), unknown = data->constants[CONSTANTS * (size_t)photo + UNKNOWN];
        grad->photo[photo] += saved[3 * CN_EFFECT_RAYS + i];
        for (int c = 0; c < 3; c++) {
            float *d = &d_rgb[3 * (size_t)i + (size_t)c];
            grad->photo[photo] += unknown * 0.69314718f * *d * saved[3 * (size_t)i + (size_t)c];
            *d *= g;
        }
    }
}

/* The standard deviation of EV by EXIF; NaN where fewer than half of the photos, or only one, have it. */
static double exif_spread(const cn_plan_input *input, const cn_plan_tile *tile)
{
    double sum = 0, squares = 0;
    uint32_t n = 0;
    const cn_effect_settings told = cn_effect_settings_told(input->photos, input->scene, tile);
    for (uint32_t i = 0; i < tile->n_photos; i++) {
        const uint32_t photo = input->scene->views[tile->photos[i]].photo;
        if (photo >= input->photos->n_photos) continue;
        const double ev = ev_of(&input->photos->photos[photo], told);
        if (!isfinite(ev)) continue;
        sum += ev;
        squares += ev * ev;
        n++;
    }
    if (n < 2 || 2 * n < tile->n_photos) return NAN;
    const double mean = sum / n;
    return sqrt(fmax(squares / n - mean * mean, 0));
}

static double evidence(const cn_plan_input *input, const cn_plan_tile *tile)
{
    const double by_exif = exif_spread(input, tile);
    cn_tracks tracks;
    if (cn_tracks_gather(&tracks, input, tile, CN_TRACKS_FINE) != CN_OK) return by_exif;
    const double by_colours = cn_tracks_gain(&tracks);
    cn_tracks_deinit(&tracks);
    return fmax(by_exif, by_colours);
}

extern const cn_effect cn_effect_exposure;
const cn_effect cn_effect_exposure = {
    .name = "exposure",
    .summary = "each photo has its own gain: from EXIF where it says, and learned",
    .threshold = 0.1,
    .spread = 0.5f,
    .rate = 4, /* gains converge before view dependence explains them */
    .evidence = evidence,
    .photo_constants = CONSTANTS,
    .photo_params = 1,
    .saved = 4,
    .constants = constants_of,
    .centre = centre,
    .unfreeze = unfreeze,
    .project = project,
    .pixel = pixel,
    .pixel_backward = pixel_backward,
    .loss = loss,
};
