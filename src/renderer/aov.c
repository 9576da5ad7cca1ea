/* Normals and openness come from the density about the surface that the picture's depth gives. */
#include "renderer/aov.h"

#include "base/rng.h"
#include "math/linalg.h"
#include "render/density.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const char *const names[CN_AOV_COUNT] = { "depth", "normal", "opacity", "ambient_occlusion", "coverage" };
enum { DEPTH, NORMAL, OPACITY, AMBIENT_OCCLUSION, COVERAGE };

const char *cn_aov_name(unsigned i)
{
    return i < CN_AOV_COUNT ? names[i] : NULL;
}

unsigned cn_aov_channels(unsigned i)
{
    return i == NORMAL ? 3 : 1;
}

cn_status cn_aov_parse(const char *text, unsigned *aovs)
{
    *aovs = 0;
    for (const char *at = text; *at || at == text;) {
        const size_t length = strcspn(at, ",");
        unsigned i = 0;
        while (i < CN_AOV_COUNT && (strlen(names[i]) != length || strncmp(names[i], at, length) != 0))
            i++;
        if (i == CN_AOV_COUNT)
            return cn_fail(CN_ERR_USAGE,
                           "'%.*s' is no channel; there are depth, normal, opacity, ambient_occlusion and coverage",
                           length > 64 ? 64 : (int)length, at);
        *aovs |= 1u << i;
        at += length;
        if (*at && !*++at) return cn_fail(CN_ERR_USAGE, "'%s' ends with a comma; name a channel after it", text);
    }
    return CN_OK;
}

cn_status cn_aovs_init(cn_aovs *a, uint32_t width, uint32_t height, unsigned which)
{
    *a = (cn_aovs){ .width = width, .height = height };
    for (unsigned i = 0; i < CN_AOV_COUNT; i++) {
        if (!(which >> i & 1)) continue;
        a->values[i] = calloc((size_t)width * height * cn_aov_channels(i) + 1, sizeof(float));
        if (a->values[i]) continue;
        cn_aovs_deinit(a);
        return cn_fail(CN_ERR_NOMEM, "out of memory for %s of %u x %u pixels", names[i], width, height);
    }
    return CN_OK;
}

void cn_aovs_deinit(cn_aovs *a)
{
    for (int i = 0; i < CN_AOV_COUNT; i++)
        free(a->values[i]);
    *a = (cn_aovs){ 0 };
}

bool cn_aov_needs_owner(unsigned which)
{
    return which & (CN_AOV_NORMAL | CN_AOV_AMBIENT_OCCLUSION | CN_AOV_COVERAGE);
}

/* ---- what a tile says of its pixels, row by row ---- */

/* Per pixel: the density at the corners of a tetrahedron, at three depths; then along rays of the hemisphere. */
enum { CORNERS = 4, DEPTHS = 3, NORMAL_PLACES = CORNERS * DEPTHS, RAYS = 8, STEPS = 6, OPEN_PLACES = RAYS * STEPS };
static const double corner[CORNERS][3] = { { 1, -1, -1 }, { -1, -1, 1 }, { -1, 1, -1 }, { 1, 1, 1 } };

typedef struct shading {
    const cn_context *ctx;
    const cn_aov_source *source;
    cn_aovs *out;
    uint32_t which; /* tile */
    double eye[3], span_m, pixel, half_m;
    const cn_photo_depths *depths;
    cn_density_probe *probes; /* [threads], or NULL */
} shading;

typedef struct pixel {
    double at[3], away[3], normal[3], step_m;
    float density_normal[NORMAL_PLACES], density_open[OPEN_PLACES];
    double place[OPEN_PLACES][3], length_m[STEPS];
} pixel;

/* Where the pixel's surface is. False where it has none, or is of another tile. */
static bool surface(const shading *s, uint32_t x, uint32_t y, pixel *p)
{
    const cn_aov_source *from = s->source;
    const size_t i = (size_t)y * from->picture->width + x;
    const double depth = (double)from->picture->depth[i];
    double dir[3];
    if ((from->owner ? from->owner[i] : from->tile) != s->which || !(depth > 0)) return false;
    if (cn_camera_unproject(from->camera, x + 0.5, y + 0.5, dir) != CN_OK) return false;
    cn_mat3_tvec(from->view->rotation, dir, p->away);
    for (int k = 0; k < 3; k++)
        p->at[k] = s->eye[k] + depth * p->away[k];
    /* Two pixels wide, and not finer than what the field resolves. */
    p->step_m = fmax(2 * depth * s->pixel, s->half_m / 256);
    return true;
}

/* Opacity over a step instead of density: bounded, so that one hard cell does not outweigh all others. */
static void find_normal(cn_density_probe *probe, pixel *p)
{
    const double h = p->step_m;
    for (int d = 0; d < DEPTHS; d++)
        for (int c = 0; c < CORNERS; c++)
            for (int k = 0; k < 3; k++)
                p->place[d * CORNERS + c][k] = p->at[k] + (d - 1) * h * p->away[k] + h * corner[c][k];
    cn_density_probe_at(probe, NORMAL_PLACES, (const double(*)[3])p->place, p->density_normal);
    for (int i = 0; i < NORMAL_PLACES; i++)
        for (int k = 0; k < 3; k++)
            p->normal[k] += exp(-h * (double)p->density_normal[i]) * corner[i % CORNERS][k];
    if (!cn_normalize3(p->normal)) /* an even density: the surface is where the ray met it */
        for (int k = 0; k < 3; k++)
            p->normal[k] = -p->away[k];
    /* A visible surface faces the camera. Mirrored, not turned round: a wall that is seen at a slant stays that wall.
     */
    const double facing = cn_dot3(p->normal, p->away);
    for (int k = 0; k < 3 && facing > 0; k++)
        p->normal[k] -= 2 * facing * p->away[k];
}

/* The i-th of RAYS directions about a normal, by the cosine (Malley's method); turned differently in each pixel. */
static void hemisphere(const double n[3], int i, double turn, double out[3])
{
    const double angle = 2.399963229728653 * i + turn, radius = sqrt((i + 0.5) / RAYS), up = sqrt(1 - radius * radius);
    const double helper[3] = { fabs(n[0]) < 0.5, fabs(n[0]) >= 0.5, 0 };
    double u[3], v[3];
    cn_cross3(n, helper, u);
    (void)cn_normalize3(u);
    cn_cross3(n, u, v);
    for (int k = 0; k < 3; k++)
        out[k] = radius * cos(angle) * u[k] + radius * sin(angle) * v[k] + up * n[k];
}

/* Steps grow with the square of their number. The first ones leave the surface itself out. */
static double openness(const shading *s, cn_density_probe *probe, uint64_t seed, pixel *p)
{
    const double turn = (double)(cn_rng_mix(seed) >> 11) * 0x1p-53 * 6.283185307179586,
                 lift = fmin(3 * p->step_m, s->span_m / 4);
    double open = 0;
    for (int r = 0; r < RAYS; r++) {
        double dir[3];
        hemisphere(p->normal, r, turn, dir);
        for (int i = 0; i < STEPS; i++) {
            const double a = (double)i / STEPS, b = (i + 1.0) / STEPS, t = s->span_m * (a * a + b * b) / 2;
            p->length_m[i] = s->span_m * (b * b - a * a);
            for (int k = 0; k < 3; k++)
                p->place[r * STEPS + i][k] = p->at[k] + lift * p->normal[k] + t * dir[k];
        }
    }
    cn_density_probe_at(probe, OPEN_PLACES, (const double(*)[3])p->place, p->density_open);
    for (int r = 0; r < RAYS; r++) {
        double depth = 0;
        for (int i = 0; i < STEPS; i++)
            depth += p->length_m[i] * (double)p->density_open[r * STEPS + i];
        open += exp(-depth) / RAYS;
    }
    return open;
}

static void shade_row(void *user, size_t y, unsigned worker)
{
    const shading *s = user;
    float *const *values = s->out->values;
    const uint32_t width = s->out->width;
    if (cn_stopping(s->ctx)) return;
    for (uint32_t x = 0; x < width; x++) {
        const size_t i = y * width + x;
        pixel p = { 0 };
        if (!surface(s, x, (uint32_t)y, &p)) continue;
        if (s->probes) find_normal(&s->probes[worker], &p);
        for (size_t k = 0; k < 3 && values[NORMAL]; k++)
            values[NORMAL][3 * i + k] = (float)p.normal[k];
        if (values[AMBIENT_OCCLUSION]) values[AMBIENT_OCCLUSION][i] = (float)openness(s, &s->probes[worker], i, &p);
        if (values[COVERAGE]) values[COVERAGE][i] = (float)cn_photo_depths_count(s->depths, p.at);
    }
}

static bool same_file(const struct stat *a, const struct stat *b)
{
    return a->st_ino == b->st_ino && a->st_mtim.tv_sec == b->st_mtim.tv_sec && a->st_mtim.tv_nsec == b->st_mtim.tv_nsec;
}

/* The depths of the photos of an open tile: rendered at the first call, and again when the tile has changed. */
static cn_status find_depths(cn_tile_cache *g, const shading *s, const cn_tile *tile, const cn_photo_depths **out)
{
    const uint32_t of_plan = g->which[s->which], coarse = s->source->coarse ? s->source->coarse : 1;
    const cn_plan_tile *plan = &g->plan->tiles[of_plan];
    if (!g->depths) g->depths = calloc(g->plan->n_tiles, sizeof *g->depths);
    if (!g->depths) return cn_fail(CN_ERR_NOMEM, "out of memory for the depths of photos");
    cn_photo_depths *d = &g->depths[of_plan];
    *out = d;
    if (!d->photos || !same_file(&d->file, &g->files[of_plan])) {
        cn_photo_depths_deinit(d);
        d->file = g->files[of_plan];
        cn_log(s->ctx, CN_LOG_INFO, "%s: rendering the depths of its %u photos, for coverage", plan->id,
               plan->n_photos);
    }
    const cn_photo_views of = { &g->dataset->scene, plan->photos, plan->n_photos };
    return cn_photo_depths_render(d, s->ctx, tile, &of, CN_PHOTO_DEPTHS_WIDTH / coarse);
}

static cn_status shade(cn_tile_cache *g, shading *s)
{
    const cn_tile *tile;
    const unsigned threads = cn_pool_threads(s->ctx->pool);
    cn_status status = CN_OK;
    CN_TRY(cn_tile_cache_tile(g, g->which[s->which], &tile));
    if (s->out->values[COVERAGE]) CN_TRY(find_depths(g, s, tile, &s->depths));
    s->half_m = 1 / (double)cn_box_inv_extent(&tile->box);
    s->span_m = 0.1 * s->half_m;
    s->pixel = 1 / fmax(s->source->camera->params[0], 1e-9);
    if (s->out->values[NORMAL] || s->out->values[AMBIENT_OCCLUSION]) {
        s->probes = calloc(threads, sizeof *s->probes);
        if (!s->probes) return cn_fail(CN_ERR_NOMEM, "out of memory for normals");
        for (unsigned t = 0; t < threads && status == CN_OK; t++)
            status = cn_density_probe_init(&s->probes[t], s->ctx, tile);
    }
    if (status == CN_OK) cn_pool_run(s->ctx->pool, s->out->height, shade_row, s);
    for (unsigned t = 0; s->probes && t < threads; t++)
        cn_density_probe_deinit(&s->probes[t]);
    free(s->probes);
    s->probes = NULL;
    return status == CN_OK && cn_stopping(s->ctx)
               ? cn_fail(CN_ERR_INTERRUPTED, "stopped while rendering; run the same command to go on")
               : status;
}

static bool has_pixels(const cn_aov_source *source, uint32_t which)
{
    if (!source->owner) return which == source->tile;
    for (size_t i = 0; i < (size_t)source->picture->width * source->picture->height; i++)
        if (source->owner[i] == which) return true;
    return false;
}

cn_status cn_aovs_fill(cn_tile_cache *g, const cn_context *ctx, const cn_aov_source *source, cn_aovs *out)
{
    const size_t n = (size_t)out->width * out->height;
    shading s = { .ctx = ctx, .source = source, .out = out };
    bool of_tiles = false;
    if (out->values[DEPTH]) memcpy(out->values[DEPTH], source->picture->depth, n * sizeof(float));
    for (size_t i = 0; i < n && out->values[OPACITY]; i++)
        out->values[OPACITY][i] = source->picture->rgba[4 * i + 3];
    for (size_t i = 0; i < n && out->values[AMBIENT_OCCLUSION]; i++)
        out->values[AMBIENT_OCCLUSION][i] = 1;
    for (unsigned i = 0; i < CN_AOV_COUNT; i++)
        of_tiles = of_tiles || (out->values[i] && cn_aov_needs_owner(1u << i));
    cn_view_centre(source->view, s.eye);
    for (s.which = 0; s.which < g->n && of_tiles; s.which++)
        if (has_pixels(source, s.which)) CN_TRY(shade(g, &s));
    return CN_OK;
}
