/* Normals and openness come from the density about the surface that the picture's depth gives. */
#include "renderer/aov.h"

#include "base/rng.h"
#include "math/linalg.h"
#include "pose/lens.h"
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

/* ---- what a tile says of its pixels, chunk by chunk ---- */

/* Per pixel: the density at the corners of a tetrahedron, at three depths; then along rays of the hemisphere. */
enum { CORNERS = 4, DEPTHS = 3, NORMAL_PLACES = CORNERS * DEPTHS, RAYS = 8, STEPS = 6, OPEN_PLACES = RAYS * STEPS };
enum { CHUNK = 1 << 14, BLOCK = 64 /* pixels of a chunk, and of a task */ };
static const double corner[CORNERS][3] = { { 1, -1, -1 }, { -1, -1, 1 }, { -1, 1, -1 }, { 1, 1, 1 } };

typedef struct pixel {
    size_t index;
    double at[3], away[3], normal[3], step_m;
    bool there;
} pixel;

typedef struct shading {
    const cn_context *ctx;
    const cn_aov_source *source;
    cn_aovs *out;
    uint32_t which; /* tile */
    double eye[3], span_m, pixel, half_m;
    const cn_photo_depths *depths;
    /* of a chunk */
    size_t first, n;
    pixel *pixels; /* [CHUNK]: all at first, then those with a surface of this tile */
    cn_density_field field;
    double (*place)[3]; /* [CHUNK][places of a pixel] */
    float *density;
} shading;

/* Where the pixel's surface is. False where it has none, or is of another tile. */
static bool surface(const shading *s, size_t i, pixel *p)
{
    const cn_aov_source *from = s->source;
    const uint32_t width = from->picture->width;
    const double depth = (double)from->picture->depth[i];
    double dir[3];
    if ((from->owner ? from->owner[i] : from->tile) != s->which || !(depth > 0)) return false;
    if (cn_camera_unproject(from->camera, (double)(i % width) + 0.5, (double)(i / width) + 0.5, dir) != CN_OK)
        return false;
    cn_mat3_tvec(from->view->rotation, dir, p->away);
    for (int k = 0; k < 3; k++)
        p->at[k] = s->eye[k] + depth * p->away[k];
    /* Two pixels wide, and not finer than what the field resolves. */
    p->step_m = fmax(2 * depth * s->pixel, s->half_m / 256);
    return true;
}

static void place_normal(const shading *s, size_t i)
{
    const pixel *p = &s->pixels[i];
    double(*place)[3] = s->place + i * NORMAL_PLACES;
    const double h = p->step_m;
    for (int d = 0; d < DEPTHS; d++)
        for (int c = 0; c < CORNERS; c++)
            for (int k = 0; k < 3; k++)
                place[d * CORNERS + c][k] = p->at[k] + (d - 1) * h * p->away[k] + h * corner[c][k];
}

/* Opacity over a step instead of density: bounded, so that one hard cell does not outweigh all others. */
static void find_normal(const shading *s, size_t at)
{
    pixel *p = &s->pixels[at];
    for (int i = 0; i < NORMAL_PLACES; i++)
        for (int k = 0; k < 3; k++)
            p->normal[k] +=
                exp(-p->step_m * (double)s->density[at * NORMAL_PLACES + (size_t)i]) * corner[i % CORNERS][k];
    if (!cn_normalize3(p->normal)) /* an even density: the surface is where the ray met it */
        for (int k = 0; k < 3; k++)
            p->normal[k] = -p->away[k];
    /* A visible surface faces the camera. Mirrored, not turned round: a wall that is seen at a slant stays that wall.
     */
    const double facing = cn_dot3(p->normal, p->away);
    for (int k = 0; k < 3 && facing > 0; k++)
        p->normal[k] -= 2 * facing * p->away[k];
    for (size_t k = 0; k < 3 && s->out->values[NORMAL]; k++)
        s->out->values[NORMAL][3 * p->index + k] = (float)p->normal[k];
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

/* Along a ray of the hemisphere. Steps grow with the square of their number. */
static double step_at(const shading *s, int i, double *length_m)
{
    const double a = (double)i / STEPS, b = (i + 1.0) / STEPS;
    *length_m = s->span_m * (b * b - a * a);
    return s->span_m * (a * a + b * b) / 2;
}

/* The first steps leave the surface itself out. */
static void place_openness(const shading *s, size_t at)
{
    const pixel *p = &s->pixels[at];
    const double turn = (double)(cn_rng_mix(p->index) >> 11) * 0x1p-53 * 6.283185307179586,
                 lift = fmin(3 * p->step_m, s->span_m / 4);
    double(*place)[3] = s->place + at * OPEN_PLACES;
    for (int r = 0; r < RAYS; r++) {
        double dir[3], length;
        hemisphere(p->normal, r, turn, dir);
        for (int i = 0; i < STEPS; i++) {
            const double t = step_at(s, i, &length);
            for (int k = 0; k < 3; k++)
                place[r * STEPS + i][k] = p->at[k] + lift * p->normal[k] + t * dir[k];
        }
    }
}

static void find_openness(const shading *s, size_t at)
{
    double open = 0, length;
    for (size_t r = 0; r < RAYS; r++) {
        double depth = 0;
        for (int i = 0; i < STEPS; i++) {
            (void)step_at(s, i, &length);
            depth += length * (double)s->density[at * OPEN_PLACES + r * STEPS + (size_t)i];
        }
        open += exp(-depth) / RAYS;
    }
    s->out->values[AMBIENT_OCCLUSION][s->pixels[at].index] = (float)open;
}

static void find_coverage(const shading *s, size_t at)
{
    const pixel *p = &s->pixels[at];
    s->out->values[COVERAGE][p->index] = (float)cn_photo_depths_count(s->depths, p->at);
}

static void find_surface(const shading *s, size_t at)
{
    pixel *p = &s->pixels[at];
    *p = (pixel){ .index = s->first + at };
    p->there = surface(s, p->index, p);
}

/* ---- the chunks ---- */

typedef struct task {
    const shading *shading;
    void (*one)(const shading *s, size_t at);
} task;

static void run_block(void *user, size_t block, unsigned worker)
{
    const task *t = user;
    (void)worker;
    for (size_t i = block * BLOCK; i < (block + 1) * BLOCK && i < t->shading->n; i++)
        t->one(t->shading, i);
}

static void each(const shading *s, void (*one)(const shading *s, size_t at))
{
    cn_pool_run(s->ctx->pool, (s->n + BLOCK - 1) / BLOCK, run_block, &(task){ s, one });
}

static void keep_surfaces(shading *s)
{
    size_t kept = 0;
    for (size_t i = 0; i < s->n; i++)
        if (s->pixels[i].there) s->pixels[kept++] = s->pixels[i];
    s->n = kept;
}

static cn_status shade_chunk(shading *s)
{
    float *const *values = s->out->values;
    each(s, find_surface);
    keep_surfaces(s);
    if (s->place) {
        each(s, place_normal);
        CN_TRY(cn_density_field_at(&s->field, s->n * NORMAL_PLACES, (const double(*)[3])s->place, s->density));
        each(s, find_normal);
    }
    if (values[AMBIENT_OCCLUSION]) {
        each(s, place_openness);
        CN_TRY(cn_density_field_at(&s->field, s->n * OPEN_PLACES, (const double(*)[3])s->place, s->density));
        each(s, find_openness);
    }
    if (values[COVERAGE]) each(s, find_coverage);
    return cn_stopping(s->ctx) ? cn_fail(CN_ERR_INTERRUPTED, "stopped while rendering; run the same command to go on")
                               : CN_OK;
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

static cn_status make_room(shading *s, const cn_tile *tile, size_t chunk)
{
    const size_t places = chunk * (s->out->values[AMBIENT_OCCLUSION] ? OPEN_PLACES : NORMAL_PLACES);
    s->pixels = malloc((chunk + 1) * sizeof *s->pixels);
    if (!s->pixels) return cn_fail(CN_ERR_NOMEM, "out of memory for channels");
    if (!s->out->values[NORMAL] && !s->out->values[AMBIENT_OCCLUSION]) return CN_OK;
    s->place = malloc((places + 1) * sizeof *s->place);
    s->density = malloc((places + 1) * sizeof *s->density);
    if (!s->place || !s->density) return cn_fail(CN_ERR_NOMEM, "out of memory for normals");
    return cn_density_field_init(&s->field, s->ctx, tile, places);
}

static void free_room(shading *s)
{
    cn_density_field_deinit(&s->field);
    free(s->pixels);
    free(s->place);
    free(s->density);
    s->pixels = NULL;
    s->place = NULL;
    s->density = NULL;
}

static cn_status shade(cn_tile_cache *g, shading *s)
{
    const size_t all = (size_t)s->out->width * s->out->height, chunk = all < CHUNK ? all : CHUNK;
    const cn_tile *tile;
    CN_TRY(cn_tile_cache_tile(g, g->which[s->which], &tile));
    if (s->out->values[COVERAGE]) CN_TRY(find_depths(g, s, tile, &s->depths));
    s->half_m = 1 / (double)cn_box_inv_extent(&tile->box);
    s->span_m = 0.1 * s->half_m;
    s->pixel = 1 / fmax(cn_lens_unpack(s->source->camera).fx, 1e-9);
    cn_status status = make_room(s, tile, chunk);
    for (s->first = 0; s->first < all && status == CN_OK; s->first += chunk) {
        s->n = all - s->first < chunk ? all - s->first : chunk;
        status = shade_chunk(s);
    }
    free_room(s);
    return status;
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
