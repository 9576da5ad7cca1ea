#include "train/looks.h"

#include "effect/sky_hints.h"
#include "base/units.h"
#include "field/occupancy.h"
#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define LOWEST -0.15 /* sine of the elevation at which a sky ends */

/* Whether a photo looks that way; hint: what it shows there. */
static bool looks(const cn_sampler *s, uint32_t photo, const float dir[3], cn_sky_hint *hint)
{
    const cn_ray_generator *g = &s->photos[photo].generator;
    const double world[3] = { (double)dir[0], (double)dir[1], (double)dir[2] };
    double cam[3], at[2];
    *hint = CN_SKY_UNKNOWN;
    cn_mat3_tvec(g->world_from_cam, world, cam);
    if (!cn_camera_project(&g->camera, cam, at)) return false;
    if (!(at[0] >= 0 && at[1] >= 0 && at[0] < g->camera.width && at[1] < g->camera.height)) return false;
    const uint32_t x = (uint32_t)(at[0] * CN_SKY_HINT_X / g->camera.width),
                   y = (uint32_t)(at[1] * CN_SKY_HINT_Y / g->camera.height);
    if (s->sky_hint) *hint = (cn_sky_hint)s->sky_hint[(size_t)photo * CN_SKY_HINTS + y * CN_SKY_HINT_X + x];
    return true;
}

static cn_look look_of(const cn_sampler *s, const float dir[3])
{
    cn_look most = CN_LOOK_NONE;
    for (uint32_t i = 0; i < s->n_photos && most != CN_LOOK_SKY; i++) {
        cn_sky_hint hint;
        if (looks(s, i, dir, &hint)) most = hint == CN_SKY_SHOWN ? CN_LOOK_SKY : CN_LOOK_SOMETHING;
    }
    return most;
}

void cn_looks_find(const cn_sampler *s, float (*dir)[3], uint8_t *look)
{
    const double golden = CN_PI * (3 - sqrt(5));
    for (uint32_t i = 0; i < CN_LOOKS; i++) {
        const double z = LOWEST + (1 - LOWEST) * (i + 0.5) / CN_LOOKS, r = sqrt(1 - z * z);
        dir[i][0] = (float)(r * cos(golden * i));
        dir[i][1] = (float)(r * sin(golden * i));
        dir[i][2] = (float)z;
        look[i] = (uint8_t)look_of(s, dir[i]);
    }
}

static void find_matter(const cn_sampler *s, uint8_t *matter)
{
    for (uint32_t i = 0; i < CN_SEEN_DIRECTIONS; i++) {
        float dir[3];
        uint32_t n[CN_SKY_SHOWN + 1] = { 0 };
        cn_seen_direction(i, dir);
        for (uint32_t p = 0; p < s->n_photos; p++) {
            cn_sky_hint hint;
            if (looks(s, p, dir, &hint)) n[hint]++;
        }
        const uint32_t tell = n[CN_SKY_NONE] + n[CN_SKY_SHOWN];
        matter[i] = (uint8_t)(tell ? 255 * n[CN_SKY_NONE] / tell : 0);
    }
}

/* Of the samples within some degrees of a direction, at least so many tell how far away matter is. */
enum { DISTANCE_SAMPLES = 10, DISTANCE_MOST = 8192 };
static const double WIDTHS[] = { 4, 8, 16 };

typedef struct sparse_ray {
    float dir[3], distance_m, height; /* height: of its end, in box units */
    float end[3];                     /* metres from the box's centre */
} sparse_ray;

static uint32_t sparse_rays(const cn_sampler *s, sparse_ray *rays)
{
    uint32_t n = 0;
    const uint32_t stride = s->n_sparse / DISTANCE_MOST + 1;
    for (uint32_t i = 0; i < s->n_sparse; i += stride) {
        const cn_sparse_sample *sample = &s->sparse[i];
        cn_ray ray;
        if (!cn_ray_generator_ray(&s->photos[sample->photo].generator, sample->x + 0.5, sample->y + 0.5, &ray))
            continue;
        memcpy(rays[n].dir, ray.dir, sizeof ray.dir);
        rays[n].height = ray.box_ray.origin[2] + sample->distance_m * ray.box_ray.dir[2];
        for (int a = 0; a < 3; a++)
            rays[n].end[a] = (float)s->photos[sample->photo].generator.origin[a] + sample->distance_m * ray.dir[a];
        rays[n++].distance_m = sample->distance_m;
    }
    return n;
}

static float dot(const float a[3], const float b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* From the first to the third quartile. */
static double spread(double *values, size_t n)
{
    const double upper = cn_select(values, n, 3 * n / 4);
    return upper - cn_select(values, n, n / 4);
}

/* How far away matter is, from the photos and from the box's centre. room: for 2 n. */
static void find_distance(const sparse_ray *rays, uint32_t n, double *room, const cn_looks *l)
{
    double *near = room, *far = room + n;
    for (uint32_t i = 0; i < CN_SEEN_DIRECTIONS; i++) {
        float dir[3];
        cn_seen_direction(i, dir);
        l->distance[i] = 0;
        l->reach[i] = -INFINITY;
        for (size_t w = 0; w < sizeof WIDTHS / sizeof *WIDTHS && !(l->distance[i] > 0); w++) {
            const float least = (float)cos(WIDTHS[w] * CN_PI / 180);
            size_t m = 0;
            for (uint32_t k = 0; k < n; k++)
                if (dot(dir, rays[k].dir) >= least) {
                    near[m] = (double)rays[k].distance_m;
                    far[m++] = (double)dot(dir, rays[k].end);
                }
            if (m < DISTANCE_SAMPLES) continue;
            l->distance[i] = (float)cn_select(near, m, m / 2);
            if (spread(far, m) < spread(near, m)) l->reach[i] = (float)cn_select(far, m, m / 2);
        }
    }
}

/* The height that all but a hundredth of the points are below. */
static float find_top(const sparse_ray *rays, uint32_t n, double *height)
{
    for (uint32_t i = 0; i < n; i++)
        height[i] = (double)rays[i].height;
    return n ? (float)cn_select(height, n, n - 1 - n / 100) : INFINITY;
}

/* Above nearly all sparse points there is no matter either, though no photo looks there: a flight does, and so does a
 * picture of the whole sky. top: a height in box units. */
static void find_places(const uint8_t *usable, float top, uint32_t *places)
{
    enum { WIDE = CN_OCC_RES / CN_SEEN_RES };
    memset(places, 0, sizeof *places * (CN_SEEN_PLACES / 32));
    for (uint32_t i = 0; i < CN_OCC_CELLS; i++) {
        const uint32_t x = i % CN_OCC_RES / WIDE, y = i / CN_OCC_RES % CN_OCC_RES / WIDE,
                       z = i / (CN_OCC_RES * CN_OCC_RES) / WIDE, place = (z * CN_SEEN_RES + y) * CN_SEEN_RES + x;
        float centre[3];
        cn_occupancy_centre(i, centre);
        if (usable[i] || centre[2] > top) places[place / 32] |= (uint32_t)1 << (place % 32);
    }
}

void cn_looks_carve(cn_looks *l, cn_arena *arena)
{
    l->places = CN_ARENA_NEW(arena, uint32_t, CN_SEEN_PLACES / 32);
    l->matter = CN_ARENA_NEW(arena, uint8_t, CN_SEEN_DIRECTIONS);
    l->distance = CN_ARENA_NEW(arena, float, CN_SEEN_DIRECTIONS);
    l->reach = CN_ARENA_NEW(arena, float, CN_SEEN_DIRECTIONS);
}

cn_status cn_looks_begin(cn_looks *l, const cn_sampler *s, const uint8_t *usable)
{
    sparse_ray *rays = malloc(sizeof *rays * DISTANCE_MOST);
    double *room = malloc(sizeof *room * 2 * DISTANCE_MOST);
    if (rays && room) {
        const uint32_t n = sparse_rays(s, rays);
        find_distance(rays, n, room, l);
        find_places(usable, find_top(rays, n, room), l->places);
        find_matter(s, l->matter);
    }
    const bool done = rays && room;
    free(rays);
    free(room);
    return done ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory at the start of training");
}

/* Passes over a photo's hints down and up, each of which carries distances on. */
static void find_clearance(const uint8_t *hint, uint8_t *clearance)
{
    enum { X = CN_SKY_HINT_X, Y = CN_SKY_HINT_Y };
    for (int i = 0; i < CN_SKY_HINTS; i++)
        clearance[i] = hint[i] == CN_SKY_SHOWN ? UINT8_MAX : 0;
    for (int pass = 0; pass < 2; pass++)
        for (int k = 0; k < CN_SKY_HINTS; k++) {
            const int i = pass ? CN_SKY_HINTS - 1 - k : k, x = i % X, y = i / X, from = pass ? 1 : -1;
            const int next[4][2] = { { x + from, y }, { x - 1, y + from }, { x, y + from }, { x + 1, y + from } };
            for (int n = 0; n < 4; n++) {
                const bool inside = next[n][0] >= 0 && next[n][0] < X && next[n][1] >= 0 && next[n][1] < Y;
                if (!inside) continue;
                const int reach = clearance[next[n][1] * X + next[n][0]] + 1;
                if (reach < clearance[i]) clearance[i] = (uint8_t)reach;
            }
        }
}

/* Copies the generators, because the record of a photo holds more than its generator. */
cn_status cn_looks_clear(const cn_sampler *s, cn_pool *pool, const cn_box *box, uint8_t *usable)
{
    uint8_t *clearance = malloc((s->n_photos + 1u) * (size_t)CN_SKY_HINTS);
    cn_ray_generator *generators = malloc((s->n_photos + 1u) * sizeof *generators);
    bool room = clearance && generators;
    for (uint32_t i = 0; room && i < s->n_photos; i++) {
        generators[i] = s->photos[i].generator;
        find_clearance(s->sky_hint + (size_t)i * CN_SKY_HINTS, clearance + (size_t)i * CN_SKY_HINTS);
    }
    const cn_seeing_views views = { .n = s->n_photos, .generators = generators };
    const cn_clear_maps maps = { CN_SKY_HINT_X, CN_SKY_HINT_Y, clearance };
    room = room && cn_rays_clear_cells(pool, box, &views, &maps, usable);
    free(clearance);
    free(generators);
    return room ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory at the start of training");
}
