/* One tile's picture of one view: blocks of pixels on the pool, marched front to back in rounds, so that a ray which
 * has become opaque costs nothing beyond its surface. */
#include "conurb/render.h"

#include "render/batch.h"

#include <math.h>
#include <stdlib.h>

enum { BLOCK = 8 }; /* pixels a side of a block */
_Static_assert(BLOCK *BLOCK == CN_BATCH_RAYS, "a block is a batch");

cn_render_options cn_render_options_default(void)
{
    return (cn_render_options){ .min_transmittance = 1e-3 };
}

cn_status cn_picture_init(cn_picture *picture, uint32_t width, uint32_t height)
{
    *picture = (cn_picture){ .width = width, .height = height };
    if (!width || !height || width > 65535 || height > 65535)
        return cn_fail(CN_ERR_USAGE, "a picture of %u x %u pixels cannot be made; give 1 to 65535 a side", width,
                       height);
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
    *picture = (cn_picture){ 0 };
}

/* A pixel's ray on its way: where it goes on, and what it has gathered. */
typedef struct traveller {
    cn_ray ray;
    size_t pixel;
    float at, transmittance, depth, owed, surface;
} traveller;

/* Scratch of one thread: the rays of a block, and the samples of a round. */
typedef struct worker {
    cn_field_acts acts;
    cn_batch batch;
    uint32_t n_rays, n_going;
    uint32_t going[CN_BATCH_RAYS],
        samples[CN_BATCH_RAYS]; /* rays still on their way, and their samples in this round */
    traveller ray[CN_BATCH_RAYS];
    float rgb[CN_BATCH_RAYS][3];
    uint64_t asked; /* samples of the field, in all */
} worker;

typedef struct job {
    const cn_context *ctx;
    const cn_tile *tile;
    const cn_render_options *options;
    float *rgba, *depth;    /* what is made, a pixel each */
    uint32_t width, height; /* of a picture */
    cn_ray_generator generator;
    size_t n_rays; /* instead of a picture: rays by origin and direction */
    const double (*origin)[3], (*direction)[3];
    cn_lit lit;
    float gain;
    uint32_t blocks_x;
    worker *workers;
} job;

static void carve(const job *j, cn_arena *arena, worker *w)
{
    cn_field_acts_take(&j->tile->field, arena, CN_BATCH_PANELS, &w->acts);
    cn_batch_take(j->tile, arena, &w->batch);
}

/* Marches every ray that is still on its way by at most CN_BATCH_ROUND samples. A ray that found less is at its end. */
static void march_round(const job *j, worker *w)
{
    const cn_box *box = &j->tile->box;
    const cn_kernel *kernel = j->lit.kernel;
    cn_batch *b = &w->batch;
    uint32_t kept = 0;
    b->n_samples = 0;
    for (uint32_t i = 0; i < w->n_going; i++) {
        traveller *r = &w->ray[w->going[i]];
        const cn_march march = { r->at, box->far_m, 1 + box->step, 0 };
        float *t = b->t_at + b->n_samples;
        const uint32_t n = kernel->march(&r->ray.box_ray, &march, j->tile->occupancy, t, CN_BATCH_ROUND);
        if (!n) continue;
        kernel->place(&r->ray.box_ray, t, n, box->step, j->lit.inv_extent, b->n_samples, b->pos,
                      b->length + b->n_samples);
        r->at = n < CN_BATCH_ROUND ? INFINITY : t[n - 1] * march.ratio;
        w->going[kept] = w->going[i];
        w->samples[kept++] = n;
        b->n_samples += n;
    }
    w->n_going = kept;
}

/* Weights from the densities. What is too little for a colour of its own is owed, and goes to the next sample that
 * shows enough: many thin samples would be black together. */
static void composite(const job *j, worker *w)
{
    cn_batch *b = &w->batch;
    uint32_t i = 0;
    for (uint32_t g = 0; g < w->n_going; g++) {
        traveller *r = &w->ray[w->going[g]];
        const uint32_t end = i + w->samples[g];
        for (; i < end && r->transmittance > (float)j->options->min_transmittance; i++) {
            const float after = r->transmittance * expf(-cn_batch_depth(b, i));
            const float weight = r->transmittance - after, left = (float)j->options->depth_left;
            if (after <= left && r->transmittance > left) r->surface = b->t_at[i];
            r->transmittance = after;
            r->depth += weight * b->t_at[i];
            r->owed += weight;
            if (!(r->owed > CN_BATCH_MIN_WEIGHT)) continue;
            cn_batch_show(b, i, w->going[g], r->owed);
            r->owed = 0;
        }
        i = end;
    }
}

static cn_effect_rays effect_rays(const worker *w, float dir[CN_BATCH_RAYS][3])
{
    static const uint32_t first_row[CN_BATCH_RAYS];
    for (uint32_t r = 0; r < w->n_rays; r++)
        memcpy(dir[r], w->ray[r].ray.dir, sizeof dir[r]);
    return (cn_effect_rays){ w->n_rays, &dir[0][0], NULL, first_row };
}

/* Rays that are opaque or at their end leave. */
static void drop_finished(const job *j, worker *w)
{
    uint32_t kept = 0;
    for (uint32_t i = 0; i < w->n_going; i++) {
        const traveller *r = &w->ray[w->going[i]];
        if (r->at < j->tile->box.far_m && r->transmittance > (float)j->options->min_transmittance)
            w->going[kept++] = w->going[i];
    }
    w->n_going = kept;
}

static void finish_pixels(const job *j, worker *w)
{
    float dir[CN_BATCH_RAYS][3], transmittance[CN_BATCH_RAYS];
    const cn_effect_rays rays = effect_rays(w, dir);
    for (uint32_t r = 0; r < w->n_rays; r++)
        transmittance[r] = w->ray[r].transmittance;
    cn_effects_shade(j->lit.pack, &rays, &j->lit.effects, transmittance, &w->rgb[0][0], w->batch.keep);
    /* A background makes every pixel opaque; it has no depth. */
    const bool opaque = j->lit.pack->background.n > 0;
    for (uint32_t r = 0; r < w->n_rays; r++) {
        const traveller *ray = &w->ray[r];
        const float alpha = 1 - ray->transmittance;
        float *out = j->rgba + 4 * ray->pixel;
        for (int c = 0; c < 3; c++)
            out[c] = w->rgb[r][c] * j->gain;
        out[3] = opaque ? 1 : alpha;
        const bool seen = alpha > (opaque ? 0.5f : 0);
        j->depth[ray->pixel] = !seen ? 0 : ray->surface > 0 ? ray->surface : ray->depth / alpha;
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
    *r = (traveller){ .pixel = (size_t)y * j->width + x, .transmittance = 1 };
    /* Where the lens has no ray the pixel is left transparent. */
    if (cn_ray_generator_ray(&j->generator, x + 0.5, y + 0.5, &r->ray)) add_ray(j, w);
}

static void add_block(const job *j, worker *w, size_t block)
{
    const uint32_t x0 = (uint32_t)(block % j->blocks_x) * BLOCK, y0 = (uint32_t)(block / j->blocks_x) * BLOCK;
    for (uint32_t y = y0; y < y0 + BLOCK && y < j->height; y++)
        for (uint32_t x = x0; x < x0 + BLOCK && x < j->width; x++)
            add_pixel(j, w, x, y);
}

static void add_listed(const job *j, worker *w, size_t block)
{
    for (size_t i = block * CN_BATCH_RAYS; i < (block + 1) * CN_BATCH_RAYS && i < j->n_rays; i++) {
        traveller *r = &w->ray[w->n_rays];
        *r = (traveller){ .pixel = i, .transmittance = 1 };
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
    if (j->n_rays)
        add_listed(j, w, block);
    else
        add_block(j, w, block);
    memset(w->rgb, 0, sizeof w->rgb);
    float dir[CN_BATCH_RAYS][3];
    const cn_effect_rays rays = effect_rays(w, dir);
    cn_batch_light(&j->lit, &w->batch, &rays);
    while (w->n_going) {
        march_round(j, w);
        if (!w->n_going) break;
        w->asked += w->batch.n_samples;
        cn_batch_density(&j->lit, &w->batch, &w->acts);
        composite(j, w);
        cn_batch_colour(&j->lit, &w->batch, &w->acts, false, w->rgb);
        drop_finished(j, w);
    }
    cn_batch_colour(&j->lit, &w->batch, &w->acts, true, w->rgb);
    finish_pixels(j, w);
}

static cn_status prepare(job *j, cn_arena *arena)
{
    const unsigned threads = cn_pool_threads(j->ctx->pool);
    cn_arena counter;
    cn_arena_count(&counter);
    worker counted;
    for (unsigned i = 0; i < threads; i++)
        carve(j, &counter, &counted);
    cn_arena_take(&counter, threads, sizeof(worker));
    CN_TRY(cn_arena_init(arena, counter.used));
    j->workers = CN_ARENA_NEW(arena, worker, threads);
    for (unsigned i = 0; i < threads; i++)
        carve(j, arena, &j->workers[i]);
    j->gain = (float)exp2(j->options->exposure_ev);
    return cn_lit_init(&j->lit, j->tile, j->options->appearance);
}

static void count_samples(const job *j)
{
    *j->options->samples = 0;
    for (unsigned i = 0; i < cn_pool_threads(j->ctx->pool); i++)
        *j->options->samples += j->workers[i].asked;
}

static cn_status render_blocks(job *j, size_t blocks)
{
    cn_arena arena = { 0 };
    cn_status status = prepare(j, &arena);
    if (status == CN_OK) {
        cn_pool_run(j->ctx->pool, blocks, render_block, j);
        if (j->options->samples) count_samples(j);
        if (cn_stopping(j->ctx))
            status = cn_fail(CN_ERR_INTERRUPTED, "stopped while rendering; run the same command to go on");
    }
    cn_arena_deinit(&arena);
    return status;
}

cn_status cn_render_tile(const cn_context *ctx, const cn_tile *tile, const cn_camera *camera, const cn_view *view,
                         const cn_render_options *options, cn_picture *picture)
{
    if (camera->width != picture->width || camera->height != picture->height)
        return cn_fail(CN_ERR_USAGE, "the camera is %u x %u pixels but the picture %u x %u", camera->width,
                       camera->height, picture->width, picture->height);
    job j = { .ctx = ctx,
              .tile = tile,
              .options = options,
              .rgba = picture->rgba,
              .depth = picture->depth,
              .width = picture->width,
              .height = picture->height,
              .blocks_x = (picture->width + BLOCK - 1) / BLOCK };
    cn_ray_generator_init(&j.generator, camera, view, &tile->box);
    return render_blocks(&j, (size_t)j.blocks_x * ((picture->height + BLOCK - 1) / BLOCK));
}

cn_status cn_render_rays(const cn_context *ctx, const cn_tile *tile, size_t n, const double (*origin_m)[3],
                         const double (*direction)[3], const cn_render_options *options, float *rgba, float *depth_m)
{
    if (!n) return CN_OK;
    job j = { .ctx = ctx,
              .tile = tile,
              .options = options,
              .rgba = rgba,
              .depth = depth_m,
              .n_rays = n,
              .origin = origin_m,
              .direction = direction };
    return render_blocks(&j, (n + CN_BATCH_RAYS - 1) / CN_BATCH_RAYS);
}
