#include "synth/world.h"

#include "synth/noise.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define SUN_RADIUS 0.009f /* radians; the sun's own is half of it, but a sample a corner makes soft edges noisy */

cn_status cn_world_init(cn_world *world, const cn_synth_options *options)
{
    memset(world, 0, sizeof *world);
    world->options = *options;
    world->n_lights = options->n_runs;
    world->lights = calloc(options->n_runs, sizeof *world->lights);
    world->ambient = calloc(options->n_runs, sizeof *world->ambient);
    cn_status status = world->lights && world->ambient ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the lights");
    if (status == CN_OK) status = cn_town_init(&world->town, options);
    if (status == CN_OK) status = cn_town_build(&world->town, &world->mesh);
    if (status == CN_OK) status = cn_lamp_grid_init(&world->lamps, &world->town);
    if (status == CN_OK) status = cn_device_create(&world->device);
    if (status == CN_OK) status = cn_tracer_create(&world->tracer, world->device, &world->mesh);
    for (uint32_t i = 0; i < options->n_runs && status == CN_OK; i++)
        cn_light_make(options, i, &world->lights[i]);
    if (status != CN_OK) cn_world_deinit(world);
    return status;
}

void cn_world_deinit(cn_world *world)
{
    for (uint32_t i = 0; i < world->n_lights && world->ambient; i++)
        free(world->ambient[i]);
    free(world->ambient);
    free(world->lights);
    cn_tracer_destroy(&world->tracer);
    cn_device_destroy(&world->device);
    cn_lamp_grid_deinit(&world->lamps);
    cn_mesh_deinit(&world->mesh);
    cn_town_deinit(&world->town);
    memset(world, 0, sizeof *world);
}

void cn_world_place(const cn_mesh *mesh, const cn_hit *hit, float footprint_m, cn_surface_place *place)
{
    const cn_patch *patch = &mesh->patches[hit->patch];
    const cn_chart *chart = &mesh->charts[patch->chart];
    *place = (cn_surface_place){ .patch = patch, .chart = chart, .a = hit->a, .b = hit->b, .footprint_m = footprint_m };
    for (int i = 0; i < 3; i++) {
        place->position[i] = patch->corner[i] + hit->a * patch->u[i] + hit->b * patch->v[i];
        place->s += (place->position[i] - chart->corner[i]) * chart->u[i];
        place->t += (place->position[i] - chart->corner[i]) * chart->v[i];
    }
}

/* Bilinear in the chart's texels. */
static void ambient_at(const cn_chart *chart, const float *map, float s, float t, float out[3])
{
    const float x = s / chart->width_m * (float)chart->nu - 0.5f, y = t / chart->height_m * (float)chart->nv - 0.5f;
    const float cx = fminf(fmaxf(x, 0), (float)(chart->nu - 1)), cy = fminf(fmaxf(y, 0), (float)(chart->nv - 1));
    const uint32_t ix = (uint32_t)cx, iy = (uint32_t)cy;
    const uint32_t jx = ix + 1 < chart->nu ? ix + 1 : ix, jy = iy + 1 < chart->nv ? iy + 1 : iy;
    const float u = cx - (float)ix, v = cy - (float)iy;
    const float *p[4] = { map + 3 * ((size_t)chart->first + iy * chart->nu + ix),
                          map + 3 * ((size_t)chart->first + iy * chart->nu + jx),
                          map + 3 * ((size_t)chart->first + jy * chart->nu + ix),
                          map + 3 * ((size_t)chart->first + jy * chart->nu + jx) };
    for (int c = 0; c < 3; c++)
        out[c] = (p[0][c] * (1 - u) + p[1][c] * u) * (1 - v) + (p[2][c] * (1 - u) + p[3][c] * u) * v;
}

static float dot(const float a[3], const float b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* A direction to a place on the sun's disc. */
static void sun_direction(const cn_light *light, const float jitter[2], double d[3])
{
    const float r = SUN_RADIUS * sqrtf(jitter[0]), a = 6.2831853f * jitter[1];
    const float *s = light->sun_direction;
    const float side = hypotf(s[0], s[1]) + 1e-6f, x[3] = { -s[1] / side, s[0] / side, 0 };
    const float y[3] = { -x[1] * s[2], x[0] * s[2], side };
    for (int i = 0; i < 3; i++)
        d[i] = s[i] + r * (cosf(a) * x[i] + sinf(a) * y[i]);
}

/* What light a place sends back: `direct` is the sun's part, so that a shadow can take it away. */
typedef struct shaded {
    float all[3], direct[3], normal[3];
    double outside[3];
    float mirror;
} shaded;

static void shade(const cn_world *world, uint32_t run, const cn_mesh *mesh, const cn_hit *hit, const cn_ray_query *q,
                  shaded *out)
{
    const cn_light *light = &world->lights[run];
    const cn_patch *patch = &mesh->patches[hit->patch];
    cn_surface_place place;
    cn_surface surface;
    float view[3];
    for (int i = 0; i < 3; i++)
        view[i] = (float)q->direction[i];
    const float facing = dot(view, patch->normal), sign = facing > 0 && patch->material != CN_MAT_LEAF ? -1 : 1;
    for (int i = 0; i < 3; i++)
        out->normal[i] = sign * patch->normal[i];
    cn_world_place(mesh, hit, q->cone * (float)hit->t / sqrtf(fmaxf(fabsf(facing), 0.12f)), &place);
    cn_texture(&world->town, &place, &surface);
    for (int i = 0; i < 3; i++)
        out->outside[i] = place.position[i] + 1.5e-3 * out->normal[i];
    float e[3] = { 0, 0, 0 };
    if (mesh == &world->mesh) {
        ambient_at(place.chart, world->ambient[run], place.s, place.t, e);
    } else {
        /* The crowd has no light map: half the sky, more from above. */
        const float open = 0.62f + 0.38f * out->normal[2];
        for (int c = 0; c < 3; c++)
            e[c] = 1.9f * open * (0.5f * light->zenith[c] + 0.5f * light->horizon[c]);
    }
    const float cosine = (dot(out->normal, light->sun_direction) + surface.wrap) / (1 + surface.wrap);
    float sun[3] = { 0, 0, 0 };
    if (cosine > 0 && light->sun[0] > 0) {
        double to[3];
        sun_direction(light, q->jitter, to);
        if (!cn_tracer_blocked(world->tracer, out->outside, to, 400))
            for (int c = 0; c < 3; c++)
                sun[c] = cosine * light->sun[c];
    }
    const cn_facet facet = { out->outside, out->normal, surface.wrap };
    if (light->lamp > 0) cn_world_lamps(world, run, &facet, false, e);
    for (int c = 0; c < 3; c++) {
        const float reflect = surface.albedo[c] * 0.31830989f;
        out->direct[c] = reflect * sun[c];
        out->all[c] = out->direct[c] + reflect * e[c] + light->glow * surface.glow[c];
    }
    out->mirror = surface.mirror;
}

/* What glass mirrors, after Schlick 1994; the mirrored place itself does not mirror again. */
static void add_mirror(const cn_world *world, uint32_t run, const cn_ray_query *q, shaded *s)
{
    float view[3], to[3];
    for (int i = 0; i < 3; i++)
        view[i] = (float)q->direction[i];
    const float cosine = -dot(view, s->normal),
                share = s->mirror + (0.75f - s->mirror) * powf(cn_clamp01(1 - cosine), 5);
    cn_ray_query next = { .cone = 4 * q->cone, .jitter = { q->jitter[1], q->jitter[0] } };
    for (int i = 0; i < 3; i++) {
        to[i] = view[i] + 2 * cosine * s->normal[i];
        next.direction[i] = to[i];
        next.origin[i] = s->outside[i];
    }
    float light[3];
    cn_hit hit;
    if (cn_tracer_hit(world->tracer, next.origin, next.direction, 2000, &hit)) {
        shaded mirrored;
        shade(world, run, &world->mesh, &hit, &next, &mirrored);
        memcpy(light, mirrored.all, sizeof light);
    } else {
        cn_light_sky(&world->lights[run], to, light);
    }
    for (int c = 0; c < 3; c++) {
        s->all[c] = (1 - share) * s->all[c] + share * light[c];
        s->direct[c] *= 1 - share;
    }
}

static float haze(const cn_light *light, double distance)
{
    return 1 - expf(-(float)distance / light->haze_m);
}

void cn_world_look(const cn_world *world, uint32_t run, const cn_crowd *crowd, const cn_ray_query *q,
                   cn_ray_answer *answer)
{
    const cn_light *light = &world->lights[run];
    memset(answer, 0, sizeof *answer);
    cn_hit hit, near;
    shaded s = { .mirror = 0 };
    const bool city = cn_tracer_hit(world->tracer, q->origin, q->direction, 4000, &hit);
    if (city) {
        answer->distance_m = hit.t;
        shade(world, run, &world->mesh, &hit, q, &s);
        if (s.mirror > 0) add_mirror(world, run, q, &s);
        memcpy(answer->clean, s.all, sizeof s.all);
        cn_mix3(answer->clean, light->horizon, haze(light, hit.t));
    } else {
        cn_light_sky(light, (float[3]){ (float)q->direction[0], (float)q->direction[1], (float)q->direction[2] },
                     answer->clean);
    }
    memcpy(answer->seen, answer->clean, sizeof answer->seen);
    if (!crowd || !crowd->tracer) return;
    if (cn_tracer_hit(crowd->tracer, q->origin, q->direction, city ? hit.t : 4000, &near)) {
        shaded other;
        shade(world, run, &crowd->mesh, &near, q, &other);
        if (other.mirror > 0) add_mirror(world, run, q, &other);
        memcpy(answer->seen, other.all, sizeof other.all);
        cn_mix3(answer->seen, light->horizon, haze(light, near.t));
        answer->disturbed = true;
    } else if (city && s.direct[0] > 0) {
        double to[3];
        sun_direction(light, q->jitter, to);
        if (!cn_tracer_blocked(crowd->tracer, s.outside, to, 60)) return;
        for (int c = 0; c < 3; c++)
            answer->seen[c] -= s.direct[c] * (1 - haze(light, hit.t));
        answer->disturbed = true;
    }
}
