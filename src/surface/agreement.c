#include "surface/agreement.h"

#include "math/linalg.h"
#include "surface/lattice.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    NEIGHBOURS = 24, /* maps that a map is compared to: those from the nearest places */
    PATCH = 4,       /* pixels a side that share a band */
    SAMPLES = 4,     /* of a patch */
    FEWEST = 6       /* maps that show a place, for a wider band */
};
#define WIDTHS 4.0   /* the band, in medians of the difference */
#define FARTHER 2.0f /* a map from so many times as far away tells little */

typedef struct job {
    const cn_depth_maps *maps;
    uint32_t map, *neighbours, n_neighbours;
    uint32_t across; /* patches in a row */
    double cube_m;
    uint8_t *bands; /* of patches */
} job;

/* Adds what the other maps' depths differ by from a pixel's; those before which the place is hidden do not count. */
static size_t compare_pixel(const job *j, uint32_t x, uint32_t y, double *off)
{
    const cn_depth_map *map = &j->maps->maps[j->map];
    const cn_depth_pixel *pixel = j->maps->pixels + map->first + (size_t)y * map->camera.width + x;
    const double most_m = CN_DEPTH_WIDEST * j->cube_m;
    double away[3], xyz[3];
    size_t n = 0;
    if (!pixel->band || !isfinite(pixel->depth_m) || !cn_depth_map_ray(map, x, y, away)) return 0;
    for (int k = 0; k < 3; k++)
        xyz[k] = map->centre[k] + (double)pixel->depth_m * away[k];
    for (uint32_t o = 0; o < j->n_neighbours; o++) {
        cn_depth_sight sight;
        if (!cn_depth_map_look(j->maps, &j->maps->maps[j->neighbours[o]], xyz, &sight) || sight.sight_m < -most_m ||
            sight.distance_m > (double)(FARTHER * pixel->depth_m))
            continue;
        off[n++] = fmin(fabs(sight.sight_m), most_m);
    }
    return n;
}

static void band_of_row(void *user, size_t row, unsigned worker)
{
    static const uint32_t at[SAMPLES][2] = { { 0, 1 }, { 2, 0 }, { 3, 2 }, { 1, 3 } };
    const job *j = user;
    const cn_camera *camera = &j->maps->maps[j->map].camera;
    (void)worker;
    for (uint32_t column = 0; column < j->across; column++) {
        double off[SAMPLES * NEIGHBOURS];
        size_t n = 0;
        for (int s = 0; s < SAMPLES; s++) {
            const uint32_t x = column * PATCH + at[s][0], y = (uint32_t)row * PATCH + at[s][1];
            if (x < camera->width && y < camera->height) n += compare_pixel(j, x, y, off + n);
        }
        const double cubes = n >= FEWEST * SAMPLES ? WIDTHS * cn_select(off, n, n / 2) / j->cube_m : 0;
        j->bands[row * j->across + column] =
            cubes > CN_LATTICE_BAND && cubes <= CN_DEPTH_WIDEST ? (uint8_t)lround(cubes) : CN_LATTICE_BAND;
    }
}

static void set_bands(const job *j, cn_depth_maps *maps)
{
    const cn_depth_map *map = &maps->maps[j->map];
    const uint32_t width = map->camera.width;
    for (uint32_t y = 0; y < map->camera.height; y++)
        for (uint32_t x = 0; x < width; x++) {
            cn_depth_pixel *pixel = maps->pixels + map->first + (size_t)y * width + x;
            if (pixel->band && isfinite(pixel->depth_m))
                pixel->band = j->bands[(size_t)(y / PATCH) * j->across + x / PATCH];
        }
}

cn_status cn_depth_maps_agree(cn_depth_maps *maps, cn_pool *pool, uint32_t map, double cube_m)
{
    uint32_t nearest[1 + NEIGHBOURS]; /* the map itself, then the others */
    const cn_camera *camera = &maps->maps[map].camera;
    const uint32_t across = (camera->width + PATCH - 1) / PATCH, rows = (camera->height + PATCH - 1) / PATCH;
    job j = { .maps = maps,
              .map = map,
              .neighbours = nearest + 1,
              .n_neighbours = maps->n - 1 < NEIGHBOURS ? maps->n - 1 : NEIGHBOURS,
              .across = across,
              .cube_m = cube_m };
    CN_TRY(cn_depth_maps_nearest(maps, map, 1, 1 + j.n_neighbours, nearest));
    j.bands = malloc((size_t)rows * across);
    if (!j.bands) return cn_fail(CN_ERR_NOMEM, "out of memory for a depth map's bands");
    cn_pool_run(pool, rows, band_of_row, &j);
    set_bands(&j, maps);
    free(j.bands);
    return CN_OK;
}
