/* The options of a synthetic city: defaults and ranges. */
#include "synth/synth.h"

cn_synth_options cn_synth_options_default(void)
{
    return (cn_synth_options){ .seed = 1,
                               .n_photos = 40,
                               .n_runs = 4,
                               .width = 640,
                               .height = 427,
                               .size_m = 80,
                               .aerial = 0.4,
                               .gps_noise_m = 1,
                               .exposure_spread_ev = 0.7,
                               .latitude_deg = 48.137,
                               .longitude_deg = 11.575,
                               .altitude_m = 519 };
}

static cn_status range(const char *name, double value, double low, double high)
{
    if (value >= low && value <= high) return CN_OK;
    return cn_fail(CN_ERR_USAGE, "%s wants a number from %.10g to %.10g, not %g", name, low, high, value);
}

cn_status cn_synth_options_check(const cn_synth_options *o)
{
    CN_TRY(range("--seed", (double)o->seed, 0, 9007199254740992.0));
    CN_TRY(range("--photos", o->n_photos, 1, 100000));
    CN_TRY(range("--runs", o->n_runs, 1, CN_SYNTH_RUNS));
    CN_TRY(range("--width", o->width, 16, 16384));
    CN_TRY(range("--height", o->height, 16, 16384));
    if (o->sphere && o->width != 2 * o->height)
        return cn_fail(CN_ERR_USAGE, "--360: a photo of all directions is twice as wide as high, not %u x %u", o->width,
                       o->height);
    CN_TRY(range("--size", o->size_m, 40, 1000));
    CN_TRY(range("--aerial", o->aerial, 0, 1));
    CN_TRY(range("--gps-noise", o->gps_noise_m, 0, 100));
    CN_TRY(range("--exposure-spread", o->exposure_spread_ev, 0, 10));
    CN_TRY(range("latitude", o->latitude_deg, -90, 90));
    CN_TRY(range("longitude", o->longitude_deg, -180, 180));
    return range("altitude", o->altitude_m, -500, 9000);
}
