#include "scale_city.h"

#include "base/rng.h"
#include "base/units.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define SIDE_M 1000.0
#define BLOCK_M 50.0      /* between streets */
#define HALF_STREET_M 9.0 /* from its middle to the houses */
enum { STREETS = 21, TRACK = 6, BINS = 100 /* of a street's length */ };
enum { STREAM_PLACE = 1, STREAM_POINT, STREAM_SIGHT };

static void *must(void *memory)
{
    if (memory) return memory;
    fputs("out of memory for the synthetic city\n", stderr);
    exit(1);
}

/* Streets 0 to 20 run east, 21 to 41 north. Position along and across to local metres. */
static void on_street(uint32_t street, double along, double across, double xy[2])
{
    const double line = BLOCK_M * (street % STREETS) - SIDE_M / 2;
    const bool north = street >= STREETS;
    xy[north] = along - SIDE_M / 2;
    xy[!north] = line + (north ? -across : across);
}

/* The car drives one street after another and takes 12 photos at every step. It begins again on the next day. */
static void place_of(uint32_t view, uint32_t n, uint32_t *street, double *along)
{
    const uint32_t moments = (n + CAMERAS - 1) / CAMERAS, days = moments / 10000 + 1;
    const uint32_t a_day = (moments + days - 1) / days, moment = view / CAMERAS;
    const double at = (moment % a_day + (double)cn_rng_float(1, STREAM_PLACE, moment)) / a_day * 2 * STREETS;
    *street = (uint32_t)fmin(at, 2 * STREETS - 1);
    *along = SIDE_M * (at - *street);
}

static void make_views(scale_city *c, uint32_t n)
{
    cn_scene *s = &c->scene;
    s->views = must(calloc(n, sizeof *s->views));
    c->photos.photos = must(calloc(n, sizeof *c->photos.photos));
    s->n_views = c->photos.n_photos = n;
    for (uint32_t v = 0; v < n; v++) {
        uint32_t street;
        double along, centre[3] = { 0, 0, 2 };
        place_of(v, n, &street, &along);
        on_street(street, along, 2, centre);
        const double turn = v % CAMERAS * 2 * CN_PI / CAMERAS, f[2] = { cos(turn), sin(turn) };
        cn_view *view = &s->views[v];
        char name[40];
        snprintf(name, sizeof name, "drive/%07u_%02u.jpg", v / CAMERAS, v % CAMERAS);
        view->name = must(strdup(name));
        memcpy(view->rotation, (double[9]){ f[1], -f[0], 0, 0, 0, -1, f[0], f[1], 0 }, sizeof view->rotation);
        for (int r = 0; r < 3; r++)
            for (int k = 0; k < 3; k++)
                view->translation[r] -= view->rotation[3 * r + k] * centre[k];
        view->photo = UINT32_MAX;
        c->photos.photos[v] = (cn_photo){ .name = view->name,
                                          .width = 1200,
                                          .height = 900,
                                          .orientation = 1,
                                          .camera = "made",
                                          .exposure_s = 0.01 * exp2(v % 5 * 0.1),
                                          .iso = 100,
                                          .f_number = 4,
                                          .hash = v };
    }
}

/* The k-th point that a view sees, on the houses around it. Points are numbered street by street, bin by bin. */
static uint32_t sight(uint32_t view, uint32_t k, uint32_t n, uint32_t n_points)
{
    uint32_t street;
    double along;
    place_of(view, n, &street, &along);
    const uint32_t a_bin = n_points / (2 * STREETS * BINS);
    const double reach = (double)cn_rng_float(2, STREAM_SIGHT, (uint64_t)view * SIGHTS + k),
                 turn = view % CAMERAS * 2 * CN_PI / CAMERAS;
    const double to = along + (street >= STREETS ? sin(turn) : cos(turn)) * (5 + 35 * reach * reach);
    const uint32_t bin = (uint32_t)fmin(fmax(to / SIDE_M * BINS, 0), BINS - 1);
    return (street * BINS + bin) * a_bin + cn_rng_below(3, STREAM_SIGHT, (uint64_t)view * SIGHTS + k, a_bin);
}

static void make_points(scale_city *c, uint32_t n)
{
    cn_scene *s = &c->scene;
    const uint32_t a_bin = (uint32_t)((uint64_t)n * SIGHTS / TRACK / (2 * STREETS * BINS)) + 1;
    s->n_points = a_bin * 2 * STREETS * BINS;
    s->points = must(calloc(s->n_points, sizeof *s->points));
    for (uint32_t p = 0; p < s->n_points; p++) {
        const uint32_t bin = p / a_bin;
        const double along = SIDE_M / BINS * (bin % BINS + (double)cn_rng_float(4, STREAM_POINT, p));
        on_street(bin / BINS, along, p % 2 ? HALF_STREET_M : -HALF_STREET_M, s->points[p].xyz);
        s->points[p].xyz[2] = 12 * (double)cn_rng_float(5, STREAM_POINT, p);
        memset(s->points[p].rgb, 80 + (int)(p % 90), 3);
    }
}

/* Makes the tracks in two passes over the same observations: counts them, then fills the arrays. */
static void make_tracks(scale_city *c, uint32_t n)
{
    cn_scene *s = &c->scene;
    s->n_observations = (uint64_t)n * SIGHTS;
    s->observations = must(malloc(sizeof *s->observations * s->n_observations));
    for (uint32_t v = 0; v < n; v++)
        for (uint32_t k = 0; k < SIGHTS; k++)
            s->points[sight(v, k, n, s->n_points)].n_observations++;
    uint32_t first = 0;
    for (uint32_t p = 0; p < s->n_points; p++) {
        s->points[p].first_observation = first;
        first += s->points[p].n_observations;
        s->points[p].n_observations = 0;
    }
    for (uint32_t v = 0; v < n; v++)
        for (uint32_t k = 0; k < SIGHTS; k++) {
            cn_point *p = &s->points[sight(v, k, n, s->n_points)];
            const float x = (float)(k * 211 % 1200), y = (float)(300 + k * 97 % 600);
            s->observations[p->first_observation + p->n_observations++] = (cn_observation){ v, x, y };
        }
}

void scale_city_make(scale_city *c, uint32_t n)
{
    memset(c, 0, sizeof *c);
    c->scene.cameras = must(calloc(1, sizeof *c->scene.cameras));
    c->scene.cameras[0] =
        (cn_camera){ .id = 1, .lens = CN_LENS_PINHOLE, .width = 1200, .height = 900, .params = { 900, 900, 600, 450 } };
    c->scene.n_cameras = 1;
    cn_frame_init(&c->frame);
    c->frame.georeferenced = true;
    c->frame.latitude_deg = 37.7764;
    c->frame.longitude_deg = -122.4346;
    make_views(c, n);
    make_points(c, n);
    make_tracks(c, n);
}

void scale_city_free(scale_city *c)
{
    cn_scene_deinit(&c->scene);
    free(c->photos.photos); /* the views own the names */
}
