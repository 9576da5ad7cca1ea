/* The light of a capture run: the sun, the sky and the lamps. */
#ifndef CONURB_SYNTH_LIGHT_H
#define CONURB_SYNTH_LIGHT_H
#include "synth/synth.h"

typedef enum cn_weather {
    CN_WEATHER_CLEAR,
    CN_WEATHER_OVERCAST,
    CN_WEATHER_LOW_SUN,
    CN_WEATHER_NIGHT,
    CN_WEATHER_KINDS
} cn_weather;

/* Irradiance and radiance are about 1 on a sunny day: a photo at the reference exposure shows radiance unchanged. */
typedef struct cn_light {
    char name[24]; /* "run2-night" */
    cn_weather weather;
    int64_t start_s;                           /* seconds since 1970, local time */
    double sun_elevation_deg, sun_azimuth_deg; /* azimuth from north over east */
    float sun_direction[3];                    /* towards the sun */
    float sun[3];                              /* irradiance across its rays; 0 at night */
    float zenith[3], horizon[3], below[3];     /* radiance */
    float halo;                                /* brightness around the sun, relative to the horizon */
    float clouds;                              /* cover, 0 to 1 */
    float haze_m;                              /* distance at which haze has taken 1 - 1/e of the light */
    float lamp;                                /* radiant intensity of a street lamp; 0 by day */
    float glow;                                /* radiance of emitters: windows, lamps */
    uint32_t seed;
} cn_light;

/* The reference exposure as log2(shutter * ISO / 100 / f^2): 1/100 s, ISO 100, f/16. */
#define CN_SYNTH_REFERENCE_EV (-14.643856189774724)

void cn_light_make(const cn_synth_options *options, uint32_t run, cn_light *light);
/* Radiance of the sky in a direction of unit length, the sun's disc left out. */
void cn_light_sky(const cn_light *light, const float direction[3], float radiance[3]);
/* Elevation and azimuth of the sun, degrees, at a local mean time. */
void cn_light_sun(double latitude_deg, int day_of_year, double hour, double *elevation_deg, double *azimuth_deg);
#endif
