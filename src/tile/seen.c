#include "tile/seen.h"

#include "base/contraction.h"
#include "base/units.h"

#include <math.h>

/* Matter is expected where photos show it in this direction: at their median distance, from half to twice that. If at
 * least half of these places are unseen, there may be matter. STEPS places are asked. Found on lund, sacre-coeur,
 * sceaux and castle (tests/bench/experiments.md). With places from near the camera to twice the tile's extent instead,
 * the sky of sacre-coeur and sceaux went too: a photo from farther back begins where no other photo looks. */
#define NEARER 0.5f
#define FARTHER 2.0f
#define UNSEEN_LEAST 0.4f
#define UNSEEN_SURE 0.6f
/* Share of the photos that show matter in the direction. */
#define MATTER_LEAST 0.2f
#define MATTER_SURE 0.5f
enum { STEPS = 32 };

void cn_seen_direction(uint32_t cell, float dir[3])
{
    const double up = (cell / CN_SEEN_AROUND + 0.5) / CN_SEEN_UP,
                 azimuth = 2 * CN_PI * (cell % CN_SEEN_AROUND + 0.5) / CN_SEEN_AROUND;
    const double z = (double)CN_SEEN_LOWEST + (1 - (double)CN_SEEN_LOWEST) * up, r = sqrt(1 - z * z);
    dir[0] = (float)(r * cos(azimuth));
    dir[1] = (float)(r * sin(azimuth));
    dir[2] = (float)z;
}

/* The four cells around a direction, and their weights. */
typedef struct around {
    uint32_t cell[4];
    float weight[4];
} around;

static around cells_of(const float dir[3])
{
    around a;
    const float up = (dir[2] - CN_SEEN_LOWEST) / (1 - CN_SEEN_LOWEST) * CN_SEEN_UP - 0.5f;
    const float turn = (atan2f(dir[1], dir[0]) / (float)(2 * CN_PI) + 1) * CN_SEEN_AROUND - 0.5f;
    const float u = fminf(fmaxf(turn, 0), 2 * CN_SEEN_AROUND), v = fminf(fmaxf(up, 0), CN_SEEN_UP - 1);
    const float column = floorf(u), row = floorf(v), right = u - column, above = v - row;
    for (uint32_t i = 0; i < 4; i++) {
        const uint32_t x = ((uint32_t)column + i % 2) % CN_SEEN_AROUND, y = (uint32_t)row + i / 2;
        a.weight[i] = (i % 2 ? right : 1 - right) * (i / 2 ? above : 1 - above);
        a.cell[i] = (y < CN_SEEN_UP ? y : CN_SEEN_UP - 1) * CN_SEEN_AROUND + x;
    }
    return a;
}

static float matter_at(const cn_seen *seen, const around *a)
{
    float sum = 0;
    for (uint32_t i = 0; i < 4; i++)
        sum += a->weight[i] * (float)seen->matter[a->cell[i]] / 255;
    return sum;
}

/* How far along a direction a ray begins, from the box's centre, in metres. */
static float start_of(const cn_box_ray *ray, const float dir[3])
{
    float sum = 0;
    for (int a = 0; a < 3; a++)
        if (fabsf(ray->dir[a]) > 0) sum += ray->origin[a] / ray->dir[a] * dir[a] * dir[a];
    return sum;
}

/* How far away matter is expected: as far as from the photos. Where a front stands at one place, whatever the photos'
 * distance from it, a ray that begins farther back than they do reaches it later. 0 where no photo tells. */
static float distance_at(const cn_seen *seen, const around *a, const cn_box_ray *ray, const float dir[3])
{
    const float start = seen->reach ? start_of(ray, dir) : 0;
    float sum = 0, weights = 0;
    for (uint32_t i = 0; i < 4; i++) {
        const float near = seen->distance[a->cell[i]], far = seen->reach ? seen->reach[a->cell[i]] - start : 0;
        if (!(near > 0)) continue;
        sum += a->weight[i] * logf(fmaxf(near, far));
        weights += a->weight[i];
    }
    return weights > 0 ? expf(sum / weights) : 0;
}

static bool is_seen(const cn_seen *seen, const cn_box_ray *ray, float t)
{
    float x[3], largest = 0;
    for (int a = 0; a < 3; a++) {
        x[a] = ray->origin[a] + t * ray->dir[a];
        largest = fmaxf(largest, fabsf(x[a]));
    }
    const float factor = cn_contraction_float(largest);
    uint32_t place = 0;
    for (int a = 2; a >= 0; a--) {
        const float u = (x[a] * factor * 0.25f + 0.5f) * CN_SEEN_RES;
        place = place * CN_SEEN_RES + (uint32_t)fminf(fmaxf(u, 0), CN_SEEN_RES - 1);
    }
    return seen->places[place / 32] >> (place % 32) & 1;
}

static float smooth(float from, float to, float x)
{
    const float t = fminf(fmaxf((x - from) / (to - from), 0), 1);
    return t * t * (3 - 2 * t);
}

/* How likely a ray that meets no matter has missed some, 0 to 1. */
static float may_miss(const cn_seen *seen, const cn_box_ray *ray, const float dir[3])
{
    const around a = cells_of(dir);
    const float matter = smooth(MATTER_LEAST, MATTER_SURE, matter_at(seen, &a));
    const float distance = matter > 0 ? distance_at(seen, &a, ray, dir) : 0;
    if (!(distance > 0)) return 0;
    const float ratio = powf(FARTHER / NEARER, 1.0f / (STEPS - 1));
    float t = NEARER * distance;
    uint32_t unseen = 0;
    for (uint32_t i = 0; i < STEPS; i++, t *= ratio)
        unseen += !is_seen(seen, ray, t);
    return matter * smooth(UNSEEN_LEAST, UNSEEN_SURE, (float)unseen / STEPS);
}

/* A wall stands on the ground: where a ray may have missed one, rays below it down to the horizon may have, too. */
float cn_seen_open(const cn_seen *seen, const cn_box_ray *ray, const float dir[3])
{
    static const float lower[] = { 0.5f, 0 };
    float least = may_miss(seen, ray, dir);
    for (size_t i = 0; i < sizeof lower / sizeof *lower && dir[2] > 0 && least > 0; i++) {
        const float z = lower[i] * dir[2], length = sqrtf(dir[0] * dir[0] + dir[1] * dir[1] + z * z);
        if (!(length > 0)) break;
        const float k = 1 / length, turned[3] = { k * dir[0], k * dir[1], k * z };
        const cn_box_ray below = { { ray->origin[0], ray->origin[1], ray->origin[2] },
                                   { k * ray->dir[0], k * ray->dir[1], k * lower[i] * ray->dir[2] } };
        least = fminf(least, may_miss(seen, &below, turned));
    }
    return 1 - least;
}
