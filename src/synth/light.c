#include "synth/light.h"

#include "base/rng.h"
#include "base/units.h"
#include "synth/noise.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { STREAM_LIGHT = 2, FIRST_DAY = 17322 /* 2017-06-05, days since 1970 */, FIRST_DAY_OF_YEAR = 156 };

/* Declination after Cooper 1969, "The absorption of radiation in solar stills"; no equation of time: the clock is the
 * sun's. */
void cn_light_sun(double latitude_deg, int day_of_year, double hour, double *elevation_deg, double *azimuth_deg)
{
    const double declination = cn_radians(23.45) * sin(2 * CN_PI * (284 + day_of_year) / 365);
    const double latitude = cn_radians(latitude_deg), angle = cn_radians((hour - 12) * 15);
    const double up = sin(latitude) * sin(declination) + cos(latitude) * cos(declination) * cos(angle);
    const double east = -cos(declination) * sin(angle);
    const double north = cos(latitude) * sin(declination) - sin(latitude) * cos(declination) * cos(angle);
    *elevation_deg = cn_degrees(asin(fmin(1, fmax(-1, up))));
    const double azimuth = cn_degrees(atan2(east, north));
    *azimuth_deg = azimuth < 0 ? azimuth + 360 : azimuth;
}

/* The minute of the day, forwards or backwards from noon, at which the sun is nearest to an elevation. */
static double hour_of(double latitude_deg, int day, double elevation_deg, bool afternoon)
{
    double best = 12, least = 1e9;
    for (int minute = 0; minute <= 715; minute++) {
        const double hour = 12 + (afternoon ? 1 : -1) * minute / 60.0;
        double elevation, azimuth;
        cn_light_sun(latitude_deg, day, hour, &elevation, &azimuth);
        if (fabs(elevation - elevation_deg) < least) {
            least = fabs(elevation - elevation_deg);
            best = hour;
        }
    }
    return best;
}

static void set3(float out[3], float r, float g, float b)
{
    out[0] = r;
    out[1] = g;
    out[2] = b;
}

static void colour(cn_light *light)
{
    light->haze_m = 2500;
    switch (light->weather) {
    case CN_WEATHER_CLEAR:
        set3(light->sun, 2.75f, 2.55f, 2.2f);
        set3(light->zenith, 0.1f, 0.2f, 0.46f);
        set3(light->horizon, 0.42f, 0.53f, 0.68f);
        set3(light->below, 0.2f, 0.2f, 0.19f);
        light->clouds = 0.42f;
        light->halo = 0.7f;
        break;
    case CN_WEATHER_OVERCAST:
        set3(light->zenith, 0.37f, 0.39f, 0.42f);
        set3(light->horizon, 0.27f, 0.285f, 0.31f);
        set3(light->below, 0.09f, 0.09f, 0.09f);
        light->clouds = 1;
        light->haze_m = 1800;
        break;
    case CN_WEATHER_LOW_SUN:
        set3(light->sun, 1.6f, 0.92f, 0.4f);
        set3(light->zenith, 0.1f, 0.13f, 0.24f);
        set3(light->horizon, 0.5f, 0.36f, 0.25f);
        set3(light->below, 0.12f, 0.1f, 0.09f);
        light->clouds = 0.5f;
        light->halo = 1.6f;
        light->haze_m = 2000;
        break;
    default:
        set3(light->zenith, 0.0006f, 0.0009f, 0.002f);
        set3(light->horizon, 0.0022f, 0.0019f, 0.0021f);
        set3(light->below, 0.0006f, 0.0006f, 0.0006f);
        light->clouds = 0.6f;
        light->lamp = 0.75f;
        light->glow = 0.016f;
        break;
    }
}

void cn_light_make(const cn_synth_options *options, uint32_t run, cn_light *light)
{
    static const char *const NAMES[] = { "clear", "overcast", "low-sun", "night" };
    memset(light, 0, sizeof *light);
    light->weather = (cn_weather)(run % CN_WEATHER_KINDS);
    light->seed = (uint32_t)(cn_rng_u64(options->seed, STREAM_LIGHT, run) >> 33);
    snprintf(light->name, sizeof light->name, "run%u-%s", run % 1000, NAMES[light->weather]);
    const float chance = cn_rng_float(options->seed, STREAM_LIGHT, 1000 + run);
    const int day = FIRST_DAY_OF_YEAR + 2 * (int)run;
    double hour = 9.5 + 5 * chance;
    if (light->weather == CN_WEATHER_LOW_SUN) hour = hour_of(options->latitude_deg, day, 12 + 5 * chance, run % 8 < 4);
    if (light->weather == CN_WEATHER_NIGHT) hour = 22.5 + chance;
    cn_light_sun(options->latitude_deg, day, hour, &light->sun_elevation_deg, &light->sun_azimuth_deg);
    light->start_s = (int64_t)(FIRST_DAY + 2 * (int)run) * 86400 + (int64_t)(hour * 3600);
    /* Near the poles a low sun or darkness may not come that day: the weather is what was asked for all the same. */
    if (light->weather == CN_WEATHER_CLEAR) light->sun_elevation_deg = fmax(light->sun_elevation_deg, 25);
    if (light->weather == CN_WEATHER_LOW_SUN) light->sun_elevation_deg = fmin(fmax(light->sun_elevation_deg, 10), 18);
    const double e = cn_radians(light->sun_elevation_deg), a = cn_radians(light->sun_azimuth_deg);
    set3(light->sun_direction, (float)(cos(e) * sin(a)), (float)(cos(e) * cos(a)), (float)sin(e));
    colour(light);
}

/* Clouds on a plane far above: soft, white towards the sun. */
static void add_clouds(const cn_light *light, const float d[3], float radiance[3])
{
    const float k = 1 / (d[2] + 0.12f), x = d[0] * k, y = d[1] * k;
    const float n = 0.5f + 0.5f * cn_noise_sum(x, y, light->seed, (cn_octaves){ 1.4f, 0.55f, 5 }, 0.02f);
    const float low = 1.05f - light->clouds;
    const float cover = cn_smooth(low, low + 0.35f, n) * cn_smooth(0.02f, 0.2f, d[2]);
    float white[3];
    const float bright = light->weather == CN_WEATHER_OVERCAST ? 0.75f + 0.4f * n : 1.25f;
    for (int c = 0; c < 3; c++)
        white[c] = bright * light->horizon[c] + 0.1f * light->sun[c];
    cn_mix3(radiance, white, 0.75f * cover);
}

void cn_light_sky(const cn_light *light, const float d[3], float radiance[3])
{
    if (d[2] < 0) {
        memcpy(radiance, light->below, 3 * sizeof *radiance);
        cn_mix3(radiance, light->horizon, expf(18 * d[2]));
        return;
    }
    const float up = powf(d[2], 0.55f);
    memcpy(radiance, light->horizon, 3 * sizeof *radiance);
    cn_mix3(radiance, light->zenith, up);
    if (light->halo > 0) {
        const float cosine =
            d[0] * light->sun_direction[0] + d[1] * light->sun_direction[1] + d[2] * light->sun_direction[2];
        const float near = cosine > 0 ? 0.25f * powf(cosine, 6) + 0.9f * powf(cosine, 90) : 0;
        for (int c = 0; c < 3; c++)
            radiance[c] += light->halo * near * (0.25f * light->sun[c] + 0.2f * light->horizon[c]);
    }
    add_clouds(light, d, radiance);
}
