/* One tile's picture of one view: blocks of pixels on the pool, marched front to back in rounds, so that a ray which has become opaque
 * costs nothing beyond its surface. */
#include "conurb/render.h"

#include "base/arena.h"
#include "tile/model.h"

#include <math.h>
#include <stdlib.h>

enum {
    BLOCK = 8,                /* pixels a side of a block */
    MAX_RAYS = BLOCK * BLOCK,
    ROUND = 12,               /* samples of a ray before it is asked whether it sees anything beyond */
    CAP = MAX_RAYS * ROUND    /* 16 panels */
};
#define MIN_WEIGHT 5e-4f
#define MAX_LOGIT 15.0f

cn_render_options cn_render_options_default(void) { return (cn_render_options){.min_transmittance = 1e-3}; }

cn_status cn_picture_init(cn_picture *picture, uint32_t width, uint32_t height)
{
    *picture = (cn_picture){.width = width, .height = height};
    if (!width || !height || width > 65535 || height > 65535)
        return cn_fail(CN_ERR_USAGE, "a picture of %u x %u pixels cannot be made; give 1 to 65535 a side", width, height);
    picture->rgba = calloc((size_t)width * height * 4, sizeof(float));
    picture->depth = calloc((size_t)width * height, sizeof(float));
    if (!picture->rgba || !picture->depth) {
        cn_picture_deinit(picture);
        return cn_fail(CN_ERR_NOMEM, "out of memory for a picture of %u x %u pixels", width, height);
    }
    return CN_OK;
}

void cn_picture_deinit(cn_picture *picture)
{
    free(picture->rgba);
    free(picture->depth);
    *picture = (cn_picture){0};
}

/* A pixel's ray on its way: where it goes on, and what it has gathered. */
typedef struct traveller { cn_ray ray; size_t pixel; float at, transmittance, depth, rgb[3]; } traveller;

/* Scratch of one thread: the rays of a block, and the samples of a round. */
typedef struct worker {
    cn_field_acts acts;
    float *pos, *length, *t_at, *geo, *weight;
    uint32_t *live, *live_ray;
    float *columns, *keep;
    uint32_t n_rays, n_going, n_samples;
    uint32_t going[MAX_RAYS], samples[MAX_RAYS]; /* rays still on their way, and their samples in this round */
    traveller ray[MAX_RAYS];
} worker;

typedef struct job {
    const cn_context *ctx;
    const cn_tile *tile;
    const cn_kernel *kernel;
    const cn_render_options *options;
    float *rgba, *depth;       /* what is made, a pixel each */
    uint32_t width, height;    /* of a picture */
    cn_shooter shooter;
    size_t n_rays;             /* instead of a picture: rays by origin and direction */
    const double (*origin)[3], (*direction)[3];
    const cn_effect_pack *pack; /* one row */
    cn_appearance appearance;
    cn_effect_state effects;
    float gain, inv_extent;
    uint32_t blocks_x;
    worker *workers;
} job;

static void carve(const job *j, cn_arena *arena, worker *w)
{
    const size_t panels = CAP / CN_PANEL;
    cn_field_acts_take(&j->tile->field, arena, panels, &w->acts);
    w->pos = CN_ARENA_NEW(arena, float, 3 * CAP);
    w->length = CN_ARENA_NEW(arena, float, CAP);
    w->t_at = CN_ARENA_NEW(arena, float, CAP);
    w->geo = CN_ARENA_NEW(arena, float, CN_GEO * CAP);
    w->weight = CN_ARENA_NEW(arena, float, CAP);
    w->live = CN_ARENA_NEW(arena, uint32_t, CAP);
    w->live_ray = CN_ARENA_NEW(arena, uint32_t, CAP);
    w->columns = CN_ARENA_NEW(arena, float, (size_t)MAX_RAYS * j->tile->field.columns);
    w->keep = CN_ARENA_NEW(arena, float, j->tile->pack.keep * CN_EFFECT_RAYS);
}

/* Marches every ray that is still on its way by at most ROUND samples. A ray that found less is at its end. */
static void march_round(const job *j, worker *w)
{
    const cn_box *box = &j->tile->box;
    uint32_t kept = 0;
    w->n_samples = 0;
    for (uint32_t i = 0; i < w->n_going; i++) {
        traveller *r = &w->ray[w->going[i]];
        const cn_march march = {r->at, box->far_m, 1 + box->step, 0};
        float *t = w->t_at + w->n_samples;
        const uint32_t n = j->kernel->march(&r->ray.kray, &march, j->tile->occupancy, t, ROUND);
        if (!n) continue;
        j->kernel->place(&r->ray.kray, t, n, box->step, j->inv_extent, w->n_samples, w->pos, w->length + w->n_samples);
        r->at = n < ROUND ? INFINITY : t[n - 1] * march.ratio;
        w->going[kept] = w->going[i];
        w->samples[kept++] = n;
        w->n_samples += n;
    }
    w->n_going = kept;
}

/* The density logit is the first geometry feature. */
static float logit_of(const worker *w, uint32_t i) { return w->geo[(size_t)(i / CN_PANEL) * CN_GEO * CN_PANEL + i % CN_PANEL]; }

/* Weights from the logits; the features of what is visible move together. */
static uint32_t gather_visible(const job *j, worker *w)
{
    uint32_t at = 0, i = 0;
    for (uint32_t g = 0; g < w->n_going; g++) {
        traveller *r = &w->ray[w->going[g]];
        const uint32_t end = i + w->samples[g];
        for (; i < end && r->transmittance > (float)j->options->min_transmittance; i++) {
            const float after = r->transmittance * expf(-expf(fminf(logit_of(w, i), MAX_LOGIT)) * w->length[i]);
            const float weight = r->transmittance - after;
            r->transmittance = after;
            r->depth += weight * w->t_at[i];
            if (!(weight > MIN_WEIGHT)) continue;
            w->weight[at] = weight;
            w->live[at] = i;
            w->live_ray[at++] = w->going[g];
        }
        i = end;
    }
    const size_t rows = j->tile->field.colour_in;
    for (uint32_t k = 0; k < at; k++) {
        const size_t sample = w->live[k];
        float *to = w->acts.in + k / CN_PANEL * rows * CN_PANEL + k % CN_PANEL;
        const float *from = w->geo + sample / CN_PANEL * CN_GEO * CN_PANEL + sample % CN_PANEL;
        for (size_t r = 0; r < CN_GEO; r++) to[r * CN_PANEL] = from[r * CN_PANEL];
    }
    return at;
}

static cn_effect_rays effect_rays(const worker *w, float dir[MAX_RAYS][3])
{
    static const uint32_t first_row[MAX_RAYS];
    for (uint32_t r = 0; r < w->n_rays; r++) memcpy(dir[r], w->ray[r].ray.dir, sizeof dir[r]);
    return (cn_effect_rays){w->n_rays, &dir[0][0], NULL, first_row};
}

static void fill_columns(const job *j, worker *w, uint32_t n_live)
{
    const uint32_t columns = j->tile->field.columns;
    for (uint32_t i = 0; i < n_live; i++) {
        float *at = w->acts.in + ((size_t)(i / CN_PANEL) * j->tile->field.colour_in + CN_GEO) * CN_PANEL + i % CN_PANEL;
        const float *row = w->columns + (size_t)w->live_ray[i] * columns;
        for (uint32_t c = 0; c < columns; c++) at[(size_t)c * CN_PANEL] = row[c];
    }
}

/* Evaluates a round's samples and adds them to their rays. */
static void evaluate(const job *j, worker *w)
{
    const cn_field *field = &j->tile->field;
    const size_t panels = (w->n_samples + CN_PANEL - 1) / CN_PANEL;
    for (size_t i = w->n_samples; i % CN_PANEL; i++)
        for (size_t a = 0; a < 3; a++) w->pos[(i / CN_PANEL * 3 + a) * CN_PANEL + i % CN_PANEL] = 0;
    for (uint32_t l = 0; l < field->config.levels; l++)
        cn_field_encode_level(field, j->kernel, j->tile->params.table, l, w->pos, panels, w->acts.enc);
    cn_field_geometry(field, j->kernel, &j->tile->params, w->acts.enc, panels, w->acts.hidden, w->geo);
    const uint32_t n_live = gather_visible(j, w);
    const size_t live_panels = (n_live + CN_PANEL - 1) / CN_PANEL;
    fill_columns(j, w, n_live);
    cn_field_colour(field, j->kernel, &j->tile->params, &w->acts, live_panels);
    for (uint32_t i = 0; i < n_live; i++)
        for (size_t c = 0; c < 3; c++) {
            const float x = w->acts.out[((size_t)(i / CN_PANEL) * 4 + c) * CN_PANEL + i % CN_PANEL];
            w->ray[w->live_ray[i]].rgb[c] += w->weight[i] * expf(fminf(x, 8.0f));
        }
}

/* Rays that are opaque or at their end leave. */
static void drop_finished(const job *j, worker *w)
{
    uint32_t kept = 0;
    for (uint32_t i = 0; i < w->n_going; i++) {
        const traveller *r = &w->ray[w->going[i]];
        if (r->at < j->tile->box.far_m && r->transmittance > (float)j->options->min_transmittance) w->going[kept++] = w->going[i];
    }
    w->n_going = kept;
}

static void finish_pixels(const job *j, worker *w)
{
    float rgb[MAX_RAYS][3], dir[MAX_RAYS][3], transmittance[MAX_RAYS];
    const cn_effect_rays rays = effect_rays(w, dir);
    for (uint32_t r = 0; r < w->n_rays; r++) {
        memcpy(rgb[r], w->ray[r].rgb, sizeof rgb[r]);
        transmittance[r] = w->ray[r].transmittance;
    }
    cn_effects_shade(j->pack, &rays, &j->effects, transmittance, &rgb[0][0], w->keep);
    /* A background makes every pixel opaque; it has no depth. */
    const bool opaque = j->pack->background.n > 0;
    for (uint32_t r = 0; r < w->n_rays; r++) {
        const traveller *ray = &w->ray[r];
        const float alpha = 1 - ray->transmittance;
        float *out = j->rgba + 4 * ray->pixel;
        for (int c = 0; c < 3; c++) out[c] = rgb[r][c] * j->gain;
        out[3] = opaque ? 1 : alpha;
        j->depth[ray->pixel] = alpha > (opaque ? 0.5f : 0) ? ray->depth / alpha : 0;
    }
}

/* Sends the ray of w->ray[w->n_rays] on its way. */
static void add_ray(const job *j, worker *w)
{
    w->ray[w->n_rays].at = j->tile->box.near_m * sqrtf(1 + j->tile->box.step);
    w->going[w->n_going++] = w->n_rays++;
}

static void add_pixel(const job *j, worker *w, uint32_t x, uint32_t y)
{
    traveller *r = &w->ray[w->n_rays];
    *r = (traveller){.pixel = (size_t)y * j->width + x, .transmittance = 1};
    /* Where the lens has no ray the pixel is left transparent. */
    if (cn_shooter_ray(&j->shooter, x + 0.5, y + 0.5, &r->ray)) add_ray(j, w);
}

static void add_block(const job *j, worker *w, size_t block)
{
    const uint32_t x0 = (uint32_t)(block % j->blocks_x) * BLOCK, y0 = (uint32_t)(block / j->blocks_x) * BLOCK;
    for (uint32_t y = y0; y < y0 + BLOCK && y < j->height; y++)
        for (uint32_t x = x0; x < x0 + BLOCK && x < j->width; x++) add_pixel(j, w, x, y);
}

static void add_listed(const job *j, worker *w, size_t block)
{
    for (size_t i = block * MAX_RAYS; i < (block + 1) * MAX_RAYS && i < j->n_rays; i++) {
        traveller *r = &w->ray[w->n_rays];
        *r = (traveller){.pixel = i, .transmittance = 1};
        cn_ray_make(&j->tile->box, j->origin[i], j->direction[i], &r->ray);
        add_ray(j, w);
    }
}

static void render_block(void *user, size_t block, unsigned thread)
{
    const job *j = user;
    if (cn_stopping(j->ctx)) return;
    worker *w = &j->workers[thread];
    w->n_rays = w->n_going = 0;
    if (j->n_rays) add_listed(j, w, block);
    else add_block(j, w, block);
    float dir[MAX_RAYS][3];
    const cn_effect_rays rays = effect_rays(w, dir);
    cn_effects_field_in(j->pack, &rays, &j->effects, w->columns, j->tile->field.columns);
    while (w->n_going) {
        march_round(j, w);
        if (w->n_going) evaluate(j, w);
        drop_finished(j, w);
    }
    finish_pixels(j, w);
}

static cn_status prepare(job *j, cn_arena *arena)
{
    const cn_tile *tile = j->tile;
    const unsigned threads = cn_pool_threads(j->ctx->pool);
    cn_arena counter;
    cn_arena_count(&counter);
    worker counted;
    for (unsigned i = 0; i < threads; i++) carve(j, &counter, &counted);
    cn_arena_take(&counter, threads, sizeof(worker));
    CN_TRY(cn_arena_init(arena, counter.used));
    j->workers = CN_ARENA_NEW(arena, worker, threads);
    for (unsigned i = 0; i < threads; i++) carve(j, arena, &j->workers[i]);
    j->kernel = cn_kernel_best();
    j->pack = &tile->one;
    if (j->options->appearance) j->appearance = *j->options->appearance;
    else CN_TRY(cn_tile_appearance(tile, NULL, &j->appearance));
    if (j->appearance.n != tile->one.n_constants + tile->one.n_photo)
        return cn_fail(CN_ERR_USAGE, "the appearance was made for another tile than %s", tile->id);
    j->effects = (cn_effect_state){j->kernel, j->appearance.row, j->appearance.row + tile->one.n_constants, tile->shared, tile->derived};
    j->gain = (float)exp2(j->options->exposure_ev);
    j->inv_extent = cn_box_inv_extent(&tile->box);
    return CN_OK;
}

static cn_status render_blocks(job *j, size_t blocks)
{
    cn_arena arena = {0};
    cn_status status = prepare(j, &arena);
    if (status == CN_OK) {
        cn_pool_run(j->ctx->pool, blocks, render_block, j);
        if (cn_stopping(j->ctx)) status = cn_fail(CN_ERR_INTERRUPTED, "stopped while rendering; run the same command to go on");
    }
    cn_arena_deinit(&arena);
    return status;
}

cn_status cn_render_tile(const cn_context *ctx, const cn_tile *tile, const cn_camera *camera, const cn_view *view,
                         const cn_render_options *options, cn_picture *picture)
{
    if (camera->width != picture->width || camera->height != picture->height)
        return cn_fail(CN_ERR_USAGE, "the camera is %u x %u pixels but the picture %u x %u", camera->width, camera->height,
                       picture->width, picture->height);
    job j = {.ctx = ctx, .tile = tile, .options = options, .rgba = picture->rgba, .depth = picture->depth,
             .width = picture->width, .height = picture->height, .blocks_x = (picture->width + BLOCK - 1) / BLOCK};
    cn_shooter_init(&j.shooter, camera, view, &tile->box);
    return render_blocks(&j, (size_t)j.blocks_x * ((picture->height + BLOCK - 1) / BLOCK));
}

cn_status cn_render_rays(const cn_context *ctx, const cn_tile *tile, size_t n, const double (*origin_m)[3],
                         const double (*direction)[3], const cn_render_options *options, float *rgba, float *depth_m)
{
    if (!n) return CN_OK;
    job j = {.ctx = ctx, .tile = tile, .options = options, .rgba = rgba, .depth = depth_m, .n_rays = n, .origin = origin_m,
             .direction = direction};
    return render_blocks(&j, (n + MAX_RAYS - 1) / MAX_RAYS);
}
