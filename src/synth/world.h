/* A built city under lights: what rays meet, and what light comes back along them. */
#ifndef CONURB_SYNTH_WORLD_H
#define CONURB_SYNTH_WORLD_H
#include "synth/light.h"
#include "synth/texture.h"
#include "synth/trace.h"

/* Lamps by squares of the ground: those that reach each square. */
typedef struct cn_lamp_grid {
    float (*bulbs)[3];
    uint32_t n_bulbs, side; /* side * side squares about the origin */
    uint32_t *first, *list; /* square i has list[first[i]] to list[first[i + 1]] */
} cn_lamp_grid;
CN_NODISCARD cn_status cn_lamp_grid_init(cn_lamp_grid *grid, const cn_town *town);
void cn_lamp_grid_deinit(cn_lamp_grid *grid);

typedef struct cn_world {
    cn_synth_options options;
    cn_town town;
    cn_mesh mesh;
    cn_device *device;
    cn_tracer *tracer;
    cn_lamp_grid lamps;
    cn_light *lights; /* one a run */
    uint32_t n_lights;
    float **ambient; /* [run]: NULL, or a texel's irradiance from all but sun and lamps, n_texels * 3 */
} cn_world;

CN_NODISCARD cn_status cn_world_init(cn_world *world, const cn_synth_options *options);
void cn_world_deinit(cn_world *world);
/* Makes the light maps of runs [first, first + n). */
CN_NODISCARD cn_status cn_world_bake(const cn_context *ctx, cn_world *world, uint32_t first, uint32_t n);

/* People and cars of one photo. */
typedef struct cn_crowd {
    cn_mesh mesh;
    cn_tracer *tracer;
} cn_crowd;

/* Radiance that comes along a ray. `jitter` in [0, 1)^2 picks a place on the sun's disc; cone: what a pixel subtends.
 */
typedef struct cn_ray_query {
    double origin[3], direction[3]; /* unit length */
    float cone, jitter[2];
} cn_ray_query;
typedef struct cn_ray_answer {
    float clean[3], seen[3]; /* without and with the crowd */
    bool disturbed;          /* the crowd hides the place or shades it */
    double distance_m;       /* to the city, 0 for the sky */
} cn_ray_answer;
void cn_world_look(const cn_world *world, uint32_t run, const cn_crowd *crowd, const cn_ray_query *query,
                   cn_ray_answer *answer);
/* A place on a surface, which light reaches from the side of the normal, and by `wrap` from behind it. */
typedef struct cn_facet {
    const double *place; /* 3 */
    const float *normal; /* 3 */
    float wrap;
} cn_facet;
/* Adds the direct light of lamps, with shadows unless `quick`. */
void cn_world_lamps(const cn_world *world, uint32_t run, const cn_facet *facet, bool quick, float irradiance[3]);
void cn_world_place(const cn_mesh *mesh, const cn_hit *hit, float footprint_m, cn_surface_place *place);
#endif
