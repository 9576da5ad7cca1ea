/* Light maps: what reaches each texel from the sky and, after one bounce, from sunlit and lamplit walls. */
#include "synth/world.h"

#include "base/units.h"
#include "synth/noise.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { RAYS = 40, CHUNK = 256, STREAM_BAKE = 3 };

typedef struct baking {
    const cn_world *world;
    uint32_t first, n;  /* runs */
    float **maps;       /* [n] */
    bool *buried;       /* texels inside a building */
    uint32_t *chart_of; /* of the first texel of each chunk */
    const cn_context *ctx;
} baking;

static float dot(const float a[3], const float b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Van der Corput's radical inverse in base 2. */
static float radical_inverse(uint32_t i)
{
    i = i << 16 | i >> 16;
    i = (i & 0x55555555u) << 1 | (i & 0xaaaaaaaau) >> 1;
    i = (i & 0x33333333u) << 2 | (i & 0xccccccccu) >> 2;
    i = (i & 0x0f0f0f0fu) << 4 | (i & 0xf0f0f0f0u) >> 4;
    i = (i & 0x00ff00ffu) << 8 | (i & 0xff00ff00u) >> 8;
    return (float)(i >> 8) * 0x1p-24f;
}

/* Direction i of RAYS about the normal, denser where the cosine is large, turned by the texel's own angle. */
static void direction(const cn_chart *chart, uint32_t i, const float turn[2], double d[3])
{
    const float a = 2 * (float)CN_PI * (((float)i + turn[0]) / RAYS), r2 = fmodf(radical_inverse(i) + turn[1], 1);
    const float r = sqrtf(r2), up = sqrtf(1 - r2);
    float v[3];
    /* The chart's own v may not be at right angles to u. */
    v[0] = chart->normal[1] * chart->u[2] - chart->normal[2] * chart->u[1];
    v[1] = chart->normal[2] * chart->u[0] - chart->normal[0] * chart->u[2];
    v[2] = chart->normal[0] * chart->u[1] - chart->normal[1] * chart->u[0];
    for (int k = 0; k < 3; k++)
        d[k] = r * cosf(a) * chart->u[k] + r * sinf(a) * v[k] + up * chart->normal[k];
}

/* Adds the light that a place met by a ray sends back, for each run. */
static void bounce(const baking *b, const cn_hit *hit, const double from[3], const double d[3], float sums[][3])
{
    const cn_world *w = b->world;
    cn_surface_place place;
    cn_surface surface;
    cn_world_place(&w->mesh, hit, 2, &place);
    cn_texture(&w->town, &place, &surface);
    const float *n = place.patch->normal;
    double at[3];
    for (int k = 0; k < 3; k++)
        at[k] = from[k] + hit->t * d[k] + 2e-3 * n[k];
    for (uint32_t r = 0; r < b->n; r++) {
        const cn_light *light = &w->lights[b->first + r];
        const float cosine = dot(n, light->sun_direction), open = 0.55f * (0.6f + 0.4f * n[2]);
        float e[3];
        for (int c = 0; c < 3; c++)
            e[c] = (float)CN_PI * open * 0.5f * (light->zenith[c] + light->horizon[c]);
        if (light->sun[0] > 0 && cosine > 0) {
            const double to[3] = { light->sun_direction[0], light->sun_direction[1], light->sun_direction[2] };
            if (!cn_tracer_blocked(w->tracer, at, to, 400))
                for (int c = 0; c < 3; c++)
                    e[c] += cosine * light->sun[c];
        }
        if (light->lamp > 0) cn_world_lamps(w, b->first + r, &(cn_facet){ at, n, 0 }, true, e);
        for (int c = 0; c < 3; c++)
            sums[r][c] += surface.albedo[c] / (float)CN_PI * e[c] + light->glow * surface.glow[c];
    }
}

static void bake_texel(const baking *b, const cn_chart *chart, uint32_t texel)
{
    const uint32_t i = texel - chart->first, x = i % chart->nu, y = i / chart->nu;
    const float s = ((float)x + 0.5f) / (float)chart->nu * chart->width_m,
                t = ((float)y + 0.5f) / (float)chart->nv * chart->height_m;
    const float turn[2] = { cn_rng_float(0, STREAM_BAKE, 2 * (uint64_t)texel),
                            cn_rng_float(0, STREAM_BAKE, 2 * (uint64_t)texel + 1) };
    float sums[CN_SYNTH_RUNS][3] = { { 0 } };
    uint32_t behind = 0;
    double from[3];
    for (int k = 0; k < 3; k++)
        from[k] = chart->corner[k] + s * chart->u[k] + t * chart->v[k] + 0.02f * chart->normal[k];
    for (uint32_t ray = 0; ray < RAYS; ray++) {
        double d[3];
        cn_hit hit;
        direction(chart, ray, turn, d);
        if (cn_tracer_hit(b->world->tracer, from, d, 500, &hit)) {
            const cn_patch *patch = &b->world->mesh.patches[hit.patch];
            const float df[3] = { (float)d[0], (float)d[1], (float)d[2] };
            if (patch->material != CN_MAT_LEAF && dot(patch->normal, df) > 0) behind++;
            bounce(b, &hit, from, d, sums);
            continue;
        }
        for (uint32_t r = 0; r < b->n; r++) {
            float sky[3];
            cn_light_sky(&b->world->lights[b->first + r], (float[3]){ (float)d[0], (float)d[1], (float)d[2] }, sky);
            for (int c = 0; c < 3; c++)
                sums[r][c] += sky[c];
        }
    }
    for (uint32_t r = 0; r < b->n; r++)
        for (int c = 0; c < 3; c++)
            b->maps[r][3 * (size_t)texel + (uint32_t)c] = (float)CN_PI / RAYS * sums[r][c];
    b->buried[texel] = behind > RAYS / 3;
}

static void bake_chunk(void *user, size_t item, unsigned worker)
{
    const baking *b = user;
    (void)worker;
    if (cn_stopping(b->ctx)) return;
    const cn_mesh *mesh = &b->world->mesh;
    const uint32_t from = (uint32_t)item * CHUNK, to = from + CHUNK < mesh->n_texels ? from + CHUNK : mesh->n_texels;
    uint32_t chart = b->chart_of[item];
    for (uint32_t texel = from; texel < to; texel++) {
        while (texel >= mesh->charts[chart].first + mesh->charts[chart].nu * mesh->charts[chart].nv)
            chart++;
        bake_texel(b, &mesh->charts[chart], texel);
    }
}

/* Averages each texel with its neighbours that are not buried: this reduces noise and fills buried texels. */
static void smooth(const cn_chart *chart, const bool *buried, const float *in, float *out)
{
    for (uint32_t i = 0; i < chart->nu * chart->nv; i++) {
        const int32_t x = (int32_t)(i % chart->nu), y = (int32_t)(i / chart->nu);
        float sum[3] = { 0, 0, 0 }, weight = 0;
        for (int32_t reach = 1; reach <= 2 && weight == 0; reach++)
            for (int32_t dy = -reach; dy <= reach; dy++)
                for (int32_t dx = -reach; dx <= reach; dx++) {
                    const int32_t u = x + dx, v = y + dy;
                    if (u < 0 || v < 0 || u >= (int32_t)chart->nu || v >= (int32_t)chart->nv) continue;
                    const size_t j = chart->first + (uint32_t)v * chart->nu + (uint32_t)u;
                    const float k = buried[j] ? 0 : (dx == 0 ? 2.0f : 1) * (dy == 0 ? 2.0f : 1);
                    weight += k;
                    for (int c = 0; c < 3; c++)
                        sum[c] += k * in[3 * j + (uint32_t)c];
                }
        const size_t at = 3 * ((size_t)chart->first + i);
        for (int c = 0; c < 3; c++)
            out[at + (uint32_t)c] = weight > 0 ? sum[c] / weight : in[at + (uint32_t)c];
    }
}

static cn_status bake(baking *b)
{
    const cn_mesh *mesh = &b->world->mesh;
    const size_t n_chunks = (mesh->n_texels + CHUNK - 1) / CHUNK, bytes = 3 * sizeof(float) * (size_t)mesh->n_texels;
    float *rough = malloc(bytes);
    b->buried = calloc(mesh->n_texels, sizeof *b->buried);
    b->chart_of = calloc(n_chunks, sizeof *b->chart_of);
    bool good = rough && b->buried && b->chart_of;
    for (uint32_t chart = 0, chunk = 0; good && chunk < n_chunks; chunk++) {
        while (chunk * CHUNK >= mesh->charts[chart].first + mesh->charts[chart].nu * mesh->charts[chart].nv)
            chart++;
        b->chart_of[chunk] = chart;
    }
    if (good) cn_pool_run(b->ctx ? b->ctx->pool : NULL, n_chunks, bake_chunk, b);
    for (uint32_t r = 0; r < b->n && good; r++) {
        memcpy(rough, b->maps[r], bytes);
        for (uint32_t i = 0; i < mesh->n_charts; i++)
            if (mesh->charts[i].nu * mesh->charts[i].nv > 1) smooth(&mesh->charts[i], b->buried, rough, b->maps[r]);
    }
    free(rough);
    free(b->buried);
    free(b->chart_of);
    return good ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the light of the city; give a smaller --size");
}

cn_status cn_world_bake(const cn_context *ctx, cn_world *world, uint32_t first, uint32_t n)
{
    baking b = { .world = world, .first = first, .n = n, .maps = world->ambient + first, .ctx = ctx };
    for (uint32_t r = 0; r < n; r++) {
        free(b.maps[r]);
        b.maps[r] = calloc((size_t)world->mesh.n_texels * 3, sizeof(float));
        if (!b.maps[r]) return cn_fail(CN_ERR_NOMEM, "out of memory for the light of the city; give a smaller --size");
    }
    CN_TRY(bake(&b));
    return cn_stopping(ctx) ? cn_fail(CN_ERR_INTERRUPTED, "stopped while lighting the city") : CN_OK;
}
