/* Routes: about each crossing a ring of photos at eye level that look across it, walks along the streets that meet
 * there, and a spiral in the air, or in a survey strips over all crossings. Runs share the routes evenly, so that each
 * sees all of the city. */
#include "synth/rig.h"

#include "base/rng.h"
#include "base/units.h"
#include "math/linalg.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { STREAM_RIG = 4, STREAM_GPS = 5, SECONDS_APART = 4, RING = 24, CLIMB = 6, SURVEY_CLIMB = 10 };
#define STRIDE_M 5.0

typedef struct pose {
    double centre[3], target[3];
} pose;
typedef struct site {
    double x, y, reach[4];
} site; /* a crossing and how far one walks east, north, west, south */

static double chance(const cn_world *w, uint64_t counter, double low, double high)
{
    return low + (high - low) * cn_rng_float(w->options.seed, STREAM_RIG, counter);
}

static double gauss(uint64_t seed, uint64_t counter)
{
    const double u = 1 - cn_rng_float(seed, STREAM_GPS, 2 * counter),
                 v = cn_rng_float(seed, STREAM_GPS, 2 * counter + 1);
    return sqrt(-2 * log(u)) * cos(2 * CN_PI * v);
}

static void lens(cn_rig *rig, const cn_synth_options *o)
{
    const double w = o->width, h = o->height;
    /* 24 mm and 28 mm on a 36 mm frame. */
    const double wide = w * 24 / 36, air = w * 28 / 36;
    rig->cameras[CN_RIG_STREET] =
        (cn_camera){ 1,
                     CN_LENS_OPENCV,
                     o->width,
                     o->height,
                     { wide, wide, 0.5 * w + 2.1, 0.5 * h - 1.4, -0.055, 0.012, 0.0004, -0.0003 } };
    if (o->sphere) {
        for (uint32_t c = 0; c < CN_RIG_CAMERAS; c++)
            rig->cameras[c] = (cn_camera){ c + 1, CN_LENS_EQUIRECTANGULAR, o->width, o->height, { w, h } };
        return;
    }
    rig->cameras[CN_RIG_AERIAL] =
        (cn_camera){ 2, CN_LENS_SIMPLE_RADIAL, o->width, o->height, { air, 0.5 * w - 1.2, 0.5 * h + 0.8, -0.028 } };
}

/* ---- routes ---- */
static double walk(const float *axes, uint32_t n, uint32_t i, int step, double half)
{
    const uint32_t j = i + (uint32_t)step;
    const double gap = j < n ? fabs(axes[j] - axes[i]) / 2 + 4 : 30;
    const double left = half - (step > 0 ? axes[i] : -axes[i]);
    return fmax(10, fmin(gap + 8, left - 2));
}

static site *sites_of(const cn_town *t, uint32_t *n)
{
    site *sites = calloc((size_t)t->n_x * t->n_y, sizeof *sites);
    *n = 0;
    for (uint32_t iy = 0; iy < t->n_y && sites; iy++)
        for (uint32_t ix = 0; ix < t->n_x; ix++) {
            if (!cn_town_near(t, t->x[ix], t->y[iy], -12) && (ix != t->centre_x || iy != t->centre_y)) continue;
            site *s = &sites[(*n)++];
            *s = (site){ t->x[ix],
                         t->y[iy],
                         { walk(t->x, t->n_x, ix, 1, t->half_m), walk(t->y, t->n_y, iy, 1, t->half_m),
                           walk(t->x, t->n_x, ix, -1, t->half_m), walk(t->y, t->n_y, iy, -1, t->half_m) } };
        }
    return sites;
}

static pose ring_pose(const cn_world *w, const site *s, uint32_t i, uint32_t n, uint64_t key)
{
    const double a = 2 * CN_PI * (i + 0.37) / n, r = chance(w, key, 4.6, 6);
    const double aside = chance(w, key + 1, -0.06, 0.06);
    pose p = { { s->x + r * cos(a), s->y + r * sin(a), chance(w, key + 2, 1.6, 2.2) }, { 0, 0, 0 } };
    p.target[0] = p.centre[0] - 20 * cos(a + aside);
    p.target[1] = p.centre[1] - 20 * sin(a + aside);
    p.target[2] = p.centre[2] + chance(w, key + 3, 1.2, 3);
    return p;
}

/* Out along the four streets by turns, a few metres further each round, looking to the crossing: on the right pavement,
 * then on the left, then looking away from it. */
static pose walk_pose(const cn_world *w, const site *s, uint32_t i, uint64_t key)
{
    static const double out[4][2] = { { 1, 0 }, { 0, 1 }, { -1, 0 }, { 0, -1 } };
    const uint32_t arm = i % 4, steps = 1 + (uint32_t)fmax(0, (s->reach[arm] - 8) / STRIDE_M), k = i / 4 % steps,
                   lap = i / 4 / steps;
    const double *d = out[arm], at = 8 + STRIDE_M * k, side = lap % 2 ? -1 : 1,
                 across = side * chance(w, key, 3.5, 4.8);
    const bool away = lap % 4 >= 2;
    pose p = { { s->x + d[0] * at - d[1] * across, s->y + d[1] * at + d[0] * across, chance(w, key + 1, 1.65, 2) },
               { 0, 0, 0 } };
    const double turn =
        atan2(d[1], d[0]) + (away ? 0 : CN_PI) + chance(w, key + 2, -0.08, 0.08) + (away ? -1 : 1) * side * 0.16;
    p.target[0] = p.centre[0] + 20 * cos(turn);
    p.target[1] = p.centre[1] + 20 * sin(turn);
    p.target[2] = p.centre[2] + chance(w, key + 3, 0.8, 2.4);
    return p;
}

/* Up from the street, above the eastern one where no roof is in the way, then round the crossing above all roofs, each
 * turn higher and wider. Steps are small enough for neighbours to be told to show the same. */
static pose air_pose(const cn_world *w, const site *s, uint32_t i, uint32_t n, uint64_t key)
{
    const uint32_t most = w->options.survey ? SURVEY_CLIMB : n / 3 < CLIMB ? n / 3 : CLIMB;
    const uint32_t climb = most < n ? most : n, turning = n - climb;
    double roof = 12;
    for (int k = 0; k < 24; k++)
        roof = fmax(roof, cn_town_roof(&w->town, (float)(s->x + 27 * cos(CN_PI / 12 * k)),
                                       (float)(s->y + 27 * sin(CN_PI / 12 * k)), 5));
    const double rise = i < climb ? (i + 1.0) / (climb + 1) : 1, step = fmin(13, 3 * 360.0 / fmax(1, turning));
    const double turn = i < climb ? 0 : step * (i - climb), round = turn / 360;
    const double a = cn_radians(turn), r = 9 + 18 * rise + 7 * round, z = 2 + (roof + 5) * pow(rise, 1.4) + 7 * round;
    return (pose){ { s->x + r * cos(a), s->y + r * sin(a), z + chance(w, key, -0.5, 0.5) },
                   { s->x + chance(w, key + 1, -2, 2), s->y + chance(w, key + 2, -2, 2), 2.5 } };
}

/* In strips over the square, there and back, a fifth ahead of straight down. */
static pose strip_pose(const cn_world *w, uint32_t i, uint32_t n, uint64_t key)
{
    const uint32_t rows = (uint32_t)ceil(sqrt(n)), along = (n + rows - 1) / rows, row = i / along;
    const double half = w->town.half_m, way = row % 2 ? -1 : 1;
    const double roof = cn_town_roof(&w->town, 0, 0, (float)half), height = fmax(roof, 12) + 24;
    const double x = way * half * (along > 1 ? 2.0 * (i % along) / (along - 1) - 1 : 0);
    const double y = half * (rows > 1 ? 2.0 * row / (rows - 1) - 1 : 0);
    return (pose){ { x, y, height + chance(w, key, -1, 1) },
                   { x + way * 0.2 * height + chance(w, key + 1, -2, 2), y + chance(w, key + 2, -2, 2), 0 } };
}

/* True where something stands in the camera's way. */
static bool obstructed(const cn_world *w, const pose *p)
{
    double ahead[3];
    for (int a = 0; a < 3; a++)
        ahead[a] = (p->target[a] - p->centre[a]) / 20;
    const double side[3] = { -ahead[1], ahead[0], 0 };
    for (int i = -2; i <= 2; i++) {
        const double d[3] = { ahead[0] + 0.3 * i * side[0], ahead[1] + 0.3 * i * side[1], ahead[2] };
        if (cn_tracer_blocked(w->tracer, p->centre, d, i == 0 ? 5 : 2.5)) return true;
    }
    for (int i = 0; i < 12; i++) {
        const double d[3] = { cos(CN_PI / 6 * i), sin(CN_PI / 6 * i), 0 };
        if (cn_tracer_blocked(w->tracer, p->centre, d, 0.8)) return true;
    }
    return false;
}

/* Steps aside, ever further, until the view is free. */
static void step_aside(const cn_world *w, pose *p, uint64_t key)
{
    const pose wish = *p;
    for (uint32_t i = 1; i < 40 && obstructed(w, p); i++) {
        *p = wish;
        const double r = 0.15 * i, a = chance(w, key + 10 + i, 0, 2 * CN_PI), d[2] = { r * cos(a), r * sin(a) };
        for (int k = 0; k < 2; k++) {
            p->centre[k] += d[k];
            p->target[k] += d[k];
        }
    }
}

static pose route(const cn_world *w, const site *s, bool air, uint32_t i, uint32_t n, uint64_t key)
{
    pose p;
    if (air) return air_pose(w, s, i, n, key);
    const uint32_t full = w->options.survey ? RING / 2 : RING, ring = n < full ? n : full;
    p = i < ring ? ring_pose(w, s, i, ring, key) : walk_pose(w, s, i - ring, key);
    step_aside(w, &p, key);
    return p;
}

/* The photo from the air: up from each crossing, then strips over all of them. */
static pose survey_pose(const cn_world *w, const site *sites, uint32_t n_sites, uint32_t i, uint32_t n, uint64_t key)
{
    const uint32_t climbs = SURVEY_CLIMB * n_sites < 2 * n / 3 ? SURVEY_CLIMB * n_sites : 0;
    if (i < climbs) return air_pose(w, &sites[i / SURVEY_CLIMB], i % SURVEY_CLIMB, SURVEY_CLIMB, key);
    return strip_pose(w, i - climbs, n - climbs, key);
}

/* ---- shots ---- */
static void aim(cn_shot *shot, const pose *p, double roll)
{
    double z[3], up[3] = { 0, 0, 1 }, x[3], y[3];
    for (int a = 0; a < 3; a++)
        z[a] = p->target[a] - p->centre[a];
    cn_normalize3(z);
    cn_cross3(z, up, x);
    cn_normalize3(x);
    cn_cross3(z, x, y);
    for (int a = 0; a < 3; a++) {
        shot->rotation[a] = cos(roll) * x[a] + sin(roll) * y[a];
        shot->rotation[3 + a] = cos(roll) * y[a] - sin(roll) * x[a];
        shot->rotation[6 + a] = z[a];
        shot->centre[a] = p->centre[a];
    }
    double t[3];
    cn_mat3_vec(shot->rotation, p->centre, t);
    for (int a = 0; a < 3; a++)
        shot->translation[a] = -t[a];
}

void cn_rig_frame(const cn_synth_options *o, cn_frame *frame)
{
    cn_frame_init(frame);
    frame->georeferenced = true;
    frame->latitude_deg = o->latitude_deg;
    frame->longitude_deg = o->longitude_deg;
    frame->height_m = o->altitude_m;
}

static cn_status locate(const cn_world *w, cn_shot *shot, uint32_t i)
{
    cn_frame frame;
    double at[3], noise = w->options.gps_noise_m;
    cn_rig_frame(&w->options, &frame);
    for (uint32_t a = 0; a < 3; a++)
        at[a] = shot->centre[a] + (a == 2 ? 1.5 : 1) * noise * gauss(w->options.seed, 3 * i + a);
    return cn_frame_to_geodetic(&frame, at, shot->gps);
}

/* How the camera of a run is set, and how far off its automatic exposure and white balance are. */
static void set_camera(const cn_world *w, cn_shot *shot, uint64_t key)
{
    static const double ISO[CN_WEATHER_KINDS] = { 100, 200, 200, 800 }, F[CN_WEATHER_KINDS] = { 8, 4, 4, 2 };
    const cn_weather weather = w->lights[shot->run].weather;
    shot->iso = ISO[weather];
    shot->f_number = F[weather];
    shot->miss_ev = chance(w, key + 6, -1, 1) * w->options.exposure_spread_ev;
    shot->balance[0] = exp2(chance(w, key + 7, -0.08, 0.08));
    shot->balance[1] = 1;
    shot->balance[2] = exp2(chance(w, key + 8, -0.08, 0.08));
    if (w->options.plain) shot->miss_ev = 0, shot->balance[0] = shot->balance[2] = 1;
}

/* The run that is furthest behind its share. Day gets more photos than dusk and night. */
static uint32_t next_run(const cn_synth_options *o, uint32_t *taken)
{
    static const double SHARE[CN_WEATHER_KINDS] = { 0.4, 0.25, 0.2, 0.15 };
    uint32_t best = 0, total = 0;
    double all = 0, most = -1e9;
    for (uint32_t r = 0; r < o->n_runs; r++) {
        all += SHARE[r % CN_WEATHER_KINDS];
        total += taken[r];
    }
    for (uint32_t r = 0; r < o->n_runs; r++) {
        const double behind = SHARE[r % CN_WEATHER_KINDS] / all * (total + 1) - taken[r];
        if (behind > most + 1e-9) {
            most = behind;
            best = r;
        }
    }
    taken[best]++;
    return best;
}

static cn_status add_shots(cn_rig *rig, const cn_world *w, const site *sites, uint32_t n_sites, bool air, uint32_t n)
{
    uint32_t taken[CN_SYNTH_RUNS] = { 0 };
    for (uint32_t i = 0; i < n; i++) {
        const bool survey = air && w->options.survey;
        const uint32_t index = rig->n_shots++, each = (n + n_sites - 1) / n_sites;
        const uint64_t key = 64 * (uint64_t)index;
        cn_shot *shot = &rig->shots[index];
        const uint32_t s = i / each, here = s + 1 < n_sites ? each : n - each * s;
        pose p = survey ? survey_pose(w, sites, n_sites, i, n, key) : route(w, &sites[s], air, i % each, here, key);
        if (w->options.sphere) p.target[2] = p.centre[2]; /* such cameras are held upright */
        shot->camera = air ? CN_RIG_AERIAL : CN_RIG_STREET;
        /* Plain photos are all of the first run, under the names that they would have without it. */
        const uint32_t named = next_run(&w->options, taken), so_far = w->options.plain ? i : taken[named];
        shot->run = w->options.plain ? 0 : named;
        aim(shot, &p, chance(w, key + 5, -0.025, 0.025));
        /* The aircraft flies after the walk. */
        shot->time_s = w->lights[shot->run].start_s + (air ? 900 : 0) + SECONDS_APART * (int64_t)so_far;
        snprintf(shot->name, sizeof shot->name, "%s_%s_%04u.jpg", w->lights[named].name, air ? "air" : "street", i);
        set_camera(w, shot, key);
        CN_TRY(locate(w, shot, index));
    }
    return CN_OK;
}

static int by_name(const void *a, const void *b)
{
    return strcmp(((const cn_shot *)a)->name, ((const cn_shot *)b)->name);
}

cn_status cn_rig_init(cn_rig *rig, const cn_world *world)
{
    memset(rig, 0, sizeof *rig);
    const cn_synth_options *o = &world->options;
    uint32_t n_sites;
    site *sites = sites_of(&world->town, &n_sites);
    rig->shots = calloc(o->n_photos, sizeof *rig->shots);
    const uint32_t n_air = (uint32_t)lround(o->aerial * o->n_photos);
    cn_status status = sites && rig->shots ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for %u photos", o->n_photos);
    lens(rig, o);
    if (status == CN_OK) status = add_shots(rig, world, sites, n_sites, false, o->n_photos - n_air);
    if (status == CN_OK) status = add_shots(rig, world, sites, n_sites, true, n_air);
    free(sites);
    if (status != CN_OK) {
        cn_rig_deinit(rig);
        return status;
    }
    qsort(rig->shots, rig->n_shots, sizeof *rig->shots, by_name);
    return CN_OK;
}

void cn_rig_deinit(cn_rig *rig)
{
    free(rig->shots);
    memset(rig, 0, sizeof *rig);
}
