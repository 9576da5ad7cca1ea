/* From radiance to a photo as a camera writes it: exposure in thirds of a stop, white balance, noise, sRGB, EXIF. */
#include "synth/picture.h"

#include "base/rng.h"
#include "base/srgb.h"
#include "bridge/exiv2.h"
#include "bridge/oiio.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

enum { STREAM_NOISE = 8 };

/* Mean of the logarithm over the picture, as a camera's light meter measures. */
static double meter(const cn_film *film, size_t n)
{
    double sum = 0;
    for (size_t i = 0; i < n; i++) {
        const float *p = film->seen + 3 * i;
        sum += log2(0.2126 * p[0] + 0.7152 * p[1] + 0.0722 * p[2] + 1e-6);
    }
    return sum / (double)n;
}

static void set_shutter(const cn_world *world, cn_shot *shot, const cn_film *film, size_t n)
{
    const double set = log2(shot->iso / 100 / (shot->f_number * shot->f_number));
    /* The metered mean becomes a middle grey; plain photos all get the reference exposure. */
    const double wish = world->options.plain ? CN_SYNTH_REFERENCE_EV
                                             : CN_SYNTH_REFERENCE_EV + log2(0.19) - meter(film, n) + shot->miss_ev;
    shot->exposure_s = world->options.plain ? exp2(wish - set) : exp2(round(3 * (wish - set)) / 3);
    shot->gain = exp2(log2(shot->exposure_s) + set - CN_SYNTH_REFERENCE_EV);
}

/* Approximately normal, with mean 0 and deviation 1: the sum of four parts of one number. */
static float noise(uint64_t r)
{
    const float sum = (float)(r & 0xffff) + (float)(r >> 16 & 0xffff) + (float)(r >> 32 & 0xffff) + (float)(r >> 48);
    return (sum * 0x1p-16f - 2) * 1.7320508f;
}

static float encode(float x)
{
    if (!(x > 0)) return 0;
    if (x >= 1) return 1;
    float gradient;
    return cn_srgb_encode_float(x, &gradient);
}

static void print(const cn_world *world, const cn_shot *shot, uint32_t index, const cn_film *film, size_t n, float *rgb)
{
    /* An empty street keeps the exposure that was metered with its people. */
    const float grain = 3e-5f * (float)(shot->iso / 100), *light = world->options.empty ? film->clean : film->seen;
    for (size_t i = 0; i < 3 * n; i++) {
        const float x = light[i] * (float)(shot->gain * shot->balance[i % 3]);
        const float g = noise(cn_rng_u64(world->options.seed, STREAM_NOISE + 16 * (uint64_t)index, i));
        rgb[i] = encode(x + g * sqrtf(grain * (x > 0 ? x : 0) + 0.1f * grain * grain));
    }
}

static void sexagesimal(double degrees, double out[3])
{
    degrees = fabs(degrees);
    out[0] = floor(degrees);
    out[1] = floor((degrees - out[0]) * 60);
    out[2] = ((degrees - out[0]) * 60 - out[1]) * 60;
}

typedef struct exif {
    double latitude[3], longitude[3], altitude, below, exposure, f, iso, focal, focal35, orientation;
    char date[24], subsec[8];
} exif;

static exif exif_of(const cn_rig *rig, const cn_shot *shot, uint32_t index)
{
    const cn_camera *camera = &rig->cameras[shot->camera];
    exif e = { .altitude = fabs(shot->gps[2]),
               .below = shot->gps[2] < 0,
               .exposure = shot->exposure_s,
               .f = shot->f_number,
               .iso = shot->iso,
               .orientation = 1 };
    sexagesimal(shot->gps[0], e.latitude);
    sexagesimal(shot->gps[1], e.longitude);
    /* A small sensor, 6.4 mm across; a photo of all directions states no focal length. */
    const double focal = camera->lens == CN_LENS_EQUIRECTANGULAR ? 0 : camera->params[0] / camera->width;
    e.focal35 = round(focal * 36);
    e.focal = focal * 6.4;
    const time_t at = (time_t)shot->time_s;
    struct tm t;
    gmtime_r(&at, &t);
    strftime(e.date, sizeof e.date, "%Y:%m:%d %H:%M:%S", &t);
    snprintf(e.subsec, sizeof e.subsec, "%02u", index * 37 % 100);
    return e;
}

cn_status cn_shot_develop(const cn_world *world, const cn_rig *rig, cn_shot *shot, uint32_t index, const cn_film *film,
                          const char *path)
{
    const uint32_t width = world->options.width, height = world->options.height;
    const size_t n = (size_t)width * height;
    set_shutter(world, shot, film, n);
    float *rgb = malloc(3 * n * sizeof *rgb);
    if (!rgb) return cn_fail(CN_ERR_NOMEM, "out of memory while writing %s", path);
    print(world, shot, index, film, n, rgb);
    const exif e = exif_of(rig, shot, index);
    const cn_oiio_attribute attributes[] = { { "GPS:Latitude", NULL, e.latitude, 3 },
                                             { "GPS:LatitudeRef", shot->gps[0] < 0 ? "S" : "N", NULL, 0 },
                                             { "GPS:Longitude", NULL, e.longitude, 3 },
                                             { "GPS:LongitudeRef", shot->gps[1] < 0 ? "W" : "E", NULL, 0 },
                                             { "GPS:Altitude", NULL, &e.altitude, 1 },
                                             { "GPS:AltitudeRef", NULL, &e.below, 1 },
                                             { "ExposureTime", NULL, &e.exposure, 1 },
                                             { "FNumber", NULL, &e.f, 1 },
                                             { "Exif:PhotographicSensitivity", NULL, &e.iso, 1 },
                                             { "Exif:FocalLength", NULL, &e.focal, 1 },
                                             { "Exif:FocalLengthIn35mmFilm", NULL, &e.focal35, 1 },
                                             { "Exif:DateTimeOriginal", e.date, NULL, 0 },
                                             { "Exif:SubsecTimeOriginal", e.subsec, NULL, 0 },
                                             { "DateTime", e.date, NULL, 0 },
                                             { "Make", "Conurb", NULL, 0 },
                                             { "Model", shot->camera == CN_RIG_AERIAL ? "Swift A28" : "Walker S24",
                                               NULL, 0 },
                                             { "Orientation", NULL, &e.orientation, 1 },
                                             { NULL, NULL, NULL, 0 } };
    cn_status status = cn_oiio_write_jpeg(path, rgb, width, height, attributes);
    free(rgb);
    if (status == CN_OK && world->options.sphere) status = cn_exiv2_mark_equirectangular(path, width, height);
    return status;
}
