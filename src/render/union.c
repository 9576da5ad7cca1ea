/* Several tiles marched as one field, by a partition of unity over the map. A ray is marched in short ranges of t; in
 * each only the tiles that may own something of it take part, and of their samples only those are evaluated in which
 * they do. All tiles share one grid of t, so that where two have a part of a place both speak of the same place. */
#include "render/batch.h"

#include "conurb/render.h"
#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>

enum { BLOCK = 8 };
_Static_assert(BLOCK *BLOCK == CN_BATCH_RAYS, "a block is a batch");
#define SPAN 2.0f /* of one range: its end over its beginning */

/* A tile of the union; x, y: its centre on the map relative to the camera. */
typedef struct part {
    cn_lit lit;
    float x, y, band, back;
} part;

typedef struct traveller {
    float at, end, transmittance, depth, across, dir[3];
    size_t pixel;
} traveller;

/* What a thread holds of one tile: a round of samples, and what its rays have gathered from it. */
typedef struct layer {
    cn_batch batch;
    float *phi;                                      /* of each sample */
    bool lit;                                        /* the columns of these rays are filled */
    uint32_t first[CN_BATCH_RAYS], n[CN_BATCH_RAYS]; /* samples of each ray in this round */
    cn_box_ray ray[CN_BATCH_RAYS];
    float near[CN_BATCH_RAYS], far[CN_BATCH_RAYS];
    float rgb[CN_BATCH_RAYS][3], share[CN_BATCH_RAYS];
    float owed[CN_BATCH_RAYS]; /* weight that has no colour yet: too little a sample */
} layer;

typedef struct worker {
    cn_field_acts acts;
    layer *layer; /* [n_parts] */
    uint32_t n_rays, n_going, going[CN_BATCH_RAYS];
    traveller ray[CN_BATCH_RAYS];
} worker;

typedef struct job {
    const cn_context *ctx;
    const cn_render_options *options;
    cn_picture *picture;
    float *border;
    uint32_t *owner;
    part part[CN_UNION_MAX];
    uint32_t n_parts, blocks_x;
    cn_camera camera;
    double world_from_cam[9], centre[3];
    float step, ratio, half_ratio, log_ratio, near, gain;
    worker *workers;
} job;

/* Without what the library's own do for NaN, which costs a call. */
static inline float lesser(float a, float b)
{
    return a < b ? a : b;
}
static inline float greater(float a, float b)
{
    return a > b ? a : b;
}

/* Each part at a place relative to the camera: the distance to its centre with its setback; returns the smallest. */
static float distances(const job *j, float x, float y, float *d)
{
    float least = INFINITY;
    for (uint32_t p = 0; p < j->n_parts; p++) {
        const float dx = x - j->part[p].x, dy = y - j->part[p].y;
        d[p] = sqrtf(dx * dx + dy * dy) + j->part[p].back;
        least = lesser(least, d[p]);
    }
    return least;
}

static void shares(const job *j, float x, float y, float *phi)
{
    const float least = distances(j, x, y, phi);
    float sum = 0;
    for (uint32_t p = 0; p < j->n_parts; p++) {
        const float g = greater(1 - (phi[p] - least) / j->part[p].band, 0);
        phi[p] = g * g;
        sum += phi[p];
    }
    for (uint32_t p = 0; p < j->n_parts; p++)
        phi[p] /= sum;
}

/* Keeps of the samples that a tile found on a ray those before `cut` of which it owns something. */
static uint32_t keep_owned(const job *j, const traveller *r, layer *l, uint32_t which, bool alone, float near,
                           float cut, uint32_t n)
{
    cn_batch *b = &l->batch;
    float *t = b->t_at + b->n_samples, *phi = l->phi + b->n_samples;
    uint32_t kept = 0;
    for (uint32_t i = 0; i < n && t[i] < cut; i++) {
        float all[CN_UNION_MAX];
        if (t[i] < near) continue;
        if (!alone) shares(j, t[i] * r->dir[0], t[i] * r->dir[1], all);
        if (!alone && !(all[which] > 0)) continue;
        phi[kept] = alone ? 1 : all[which];
        t[kept++] = t[i];
    }
    return kept;
}

static uint32_t nearest(const job *j, const float *d)
{
    uint32_t first = 0;
    for (uint32_t p = 1; p < j->n_parts; p++)
        if (d[p] < d[first]) first = p;
    return first;
}

/* The tiles that own something between t0 and *t1, where the range ends. A distance changes by no more than what the
 * ray moves on the map, and a difference of two by twice that: where one tile has a lead the range goes on for as long
 * as it lasts. In a short range between two places of the same tile another has a part only if it has one at an end:
 * what a gentle curve could dip between is less than a thousandth. */
static uint32_t find_active(const job *j, const traveller *r, float t0, float *t1, uint32_t active[CN_UNION_MAX])
{
    float d[CN_UNION_MAX], e[CN_UNION_MAX], lead = INFINITY;
    uint32_t n = 0;
    const float least = distances(j, t0 * r->dir[0], t0 * r->dir[1], d);
    const uint32_t first = active[0] = nearest(j, d);
    for (uint32_t p = 0; p < j->n_parts; p++)
        if (p != first) lead = lesser(lead, d[p] - least - j->part[p].band);
    *t1 = lesser(t0 * SPAN, r->end);
    if (lead > 2 * (*t1 - t0) * r->across) {
        *t1 = lesser(t0 + lead / greater(2 * r->across, 1e-9f), r->end);
        return 1;
    }
    const float there = distances(j, *t1 * r->dir[0], *t1 * r->dir[1], e);
    const float slack = nearest(j, e) == first ? 0 : 2 * (*t1 - t0) * r->across;
    for (uint32_t p = 0; p < j->n_parts; p++)
        if (lesser(d[p] - least, e[p] - there) < j->part[p].band + slack) active[n++] = p;
    return n;
}

/* One range of one ray, as far as `room` samples of a tile go. Returns how many there are now of the tile that has the
 * most of them. */
static uint32_t march_range(const job *j, worker *w, uint32_t ray)
{
    traveller *r = &w->ray[ray];
    const float t0 = r->at;
    float t1, last = 0;
    uint32_t active[CN_UNION_MAX], found[CN_UNION_MAX], most = 0;
    const uint32_t n = find_active(j, r, t0, &t1, active);
    float cut = t1;
    for (uint32_t i = 0; i < n; i++) {
        layer *l = &w->layer[active[i]];
        const cn_lit *lit = &j->part[active[i]].lit;
        const cn_march march = { t0, lesser(t1, l->far[ray]), j->ratio, 0 };
        const uint32_t room = CN_BATCH_ROUND - l->n[ray];
        float *t = l->batch.t_at + l->batch.n_samples;
        found[i] = march.far_t > t0 ? lit->kernel->march(&l->ray[ray], &march, lit->tile->occupancy, t, room) : 0;
        if (found[i] < room || t[found[i] - 1] >= cut) continue;
        last = t[found[i] - 1];
        cut = last * j->half_ratio;
    }
    for (uint32_t i = 0; i < n; i++) {
        layer *l = &w->layer[active[i]];
        cn_batch *b = &l->batch;
        const cn_lit *lit = &j->part[active[i]].lit;
        const uint32_t mine = keep_owned(j, r, l, active[i], n == 1, l->near[ray], cut, found[i]);
        if (mine) {
            lit->kernel->place(&l->ray[ray], b->t_at + b->n_samples, mine, j->step, lit->inv_extent, b->n_samples,
                               b->pos, b->length + b->n_samples);
            if (!l->n[ray]) l->first[ray] = b->n_samples;
            l->n[ray] += mine;
            b->n_samples += mine;
        }
        if (l->n[ray] > most) most = l->n[ray];
    }
    if (last > 0)
        r->at = last * j->ratio;
    else
        r->at = t1 < r->end ? t0 * expf(ceilf(logf(t1 / t0) / j->log_ratio) * j->log_ratio) : INFINITY;
    return most;
}

static void march_round(const job *j, worker *w)
{
    uint32_t kept = 0;
    for (uint32_t p = 0; p < j->n_parts; p++) {
        w->layer[p].batch.n_samples = 0;
        memset(w->layer[p].n, 0, sizeof w->layer[p].n);
    }
    for (uint32_t i = 0; i < w->n_going; i++) {
        const uint32_t ray = w->going[i];
        bool found = false;
        for (uint32_t most = 0; most < CN_BATCH_ROUND && w->ray[ray].at<w->ray[ray].end; found |= most> 0)
            most = march_range(j, w, ray);
        if (found) w->going[kept++] = ray;
    }
    w->n_going = kept;
}

/* The samples of all tiles that stand at the ray's next t. */
static float next_group(const job *j, const worker *w, uint32_t ray, const uint32_t *done, float *tau, float *sum)
{
    float t = INFINITY;
    *sum = 0;
    for (uint32_t p = 0; p < j->n_parts; p++) {
        const layer *l = &w->layer[p];
        if (done[p] < l->n[ray]) t = fminf(t, l->batch.t_at[l->first[ray] + done[p]]);
    }
    for (uint32_t p = 0; p < j->n_parts; p++) {
        const layer *l = &w->layer[p];
        const uint32_t i = l->first[ray] + done[p];
        tau[p] = -1;
        if (done[p] >= l->n[ray] || l->batch.t_at[i] > t * (1 + 0.25f * j->step)) continue;
        tau[p] = l->phi[i] * cn_batch_depth(&l->batch, i);
        *sum += tau[p];
    }
    return t;
}

/* Part of what a sample shows. What is too little for a colour of its own is owed to the tile's next. */
static void show(layer *l, uint32_t ray, uint32_t sample, float mine)
{
    l->share[ray] += mine;
    l->owed[ray] += mine;
    if (!(l->owed[ray] > CN_BATCH_MIN_WEIGHT)) return;
    cn_batch_show(&l->batch, sample, ray, l->owed[ray]);
    l->owed[ray] = 0;
}

/* A ray all of whose samples in this round are of one tile: most are. */
static void composite_alone(const job *j, traveller *r, layer *l, uint32_t ray)
{
    const uint32_t end = l->first[ray] + l->n[ray];
    for (uint32_t i = l->first[ray]; i < end && r->transmittance > (float)j->options->min_transmittance; i++) {
        const float after = r->transmittance * expf(-l->phi[i] * cn_batch_depth(&l->batch, i)),
                    weight = r->transmittance - after;
        r->transmittance = after;
        r->depth += weight * l->batch.t_at[i];
        show(l, ray, i, weight);
    }
}

static void composite_shared(const job *j, worker *w, uint32_t ray)
{
    traveller *r = &w->ray[ray];
    uint32_t done[CN_UNION_MAX] = { 0 };
    while (r->transmittance > (float)j->options->min_transmittance) {
        float tau[CN_UNION_MAX], sum;
        const float t = next_group(j, w, ray, done, tau, &sum);
        if (t == INFINITY) return;
        const float after = r->transmittance * expf(-sum), weight = r->transmittance - after;
        r->transmittance = after;
        r->depth += weight * t;
        for (uint32_t p = 0; p < j->n_parts; p++) {
            layer *l = &w->layer[p];
            if (tau[p] < 0) continue;
            show(l, ray, l->first[ray] + done[p]++, sum > 0 ? weight * tau[p] / sum : 0);
        }
    }
}

static void composite_ray(const job *j, worker *w, uint32_t ray)
{
    layer *only = NULL;
    uint32_t n = 0;
    for (uint32_t p = 0; p < j->n_parts; p++)
        if (w->layer[p].n[ray]) only = &w->layer[p], n++;
    if (n == 1)
        composite_alone(j, &w->ray[ray], only, ray);
    else if (n)
        composite_shared(j, w, ray);
}

static cn_effect_rays effect_rays(const worker *w, float dir[CN_BATCH_RAYS][3])
{
    static const uint32_t first_row[CN_BATCH_RAYS];
    for (uint32_t r = 0; r < w->n_rays; r++)
        memcpy(dir[r], w->ray[r].dir, sizeof dir[r]);
    return (cn_effect_rays){ w->n_rays, &dir[0][0], NULL, first_row };
}

static void colour(const job *j, worker *w, bool all)
{
    for (uint32_t p = 0; p < j->n_parts; p++) {
        layer *l = &w->layer[p];
        if (l->lit) cn_batch_colour(&j->part[p].lit, &l->batch, &w->acts, all, l->rgb);
    }
}

static void evaluate(const job *j, worker *w)
{
    float dir[CN_BATCH_RAYS][3];
    const cn_effect_rays rays = effect_rays(w, dir);
    for (uint32_t p = 0; p < j->n_parts; p++) {
        layer *l = &w->layer[p];
        if (!l->batch.n_samples) continue;
        if (!l->lit) cn_batch_light(&j->part[p].lit, &l->batch, &rays);
        l->lit = true;
        cn_batch_density(&j->part[p].lit, &l->batch, &w->acts);
    }
    for (uint32_t i = 0; i < w->n_going; i++)
        composite_ray(j, w, w->going[i]);
    colour(j, w, false);
    uint32_t kept = 0;
    for (uint32_t i = 0; i < w->n_going; i++) {
        const traveller *r = &w->ray[w->going[i]];
        if (r->at < r->end && r->transmittance > (float)j->options->min_transmittance) w->going[kept++] = w->going[i];
    }
    w->n_going = kept;
}

/* Where a ray leaves a tile's box: what it sees of a tile may lie beyond the tile's own range when the camera is far
 * from its photos. */
static float box_exit(const cn_box_ray *ray)
{
    float out = INFINITY;
    for (int a = 0; a < 3; a++)
        if (ray->dir[a] != 0)
            out = fminf(out, fmaxf((1 - ray->origin[a]) / ray->dir[a], (-1 - ray->origin[a]) / ray->dir[a]));
    return out;
}

static void add_pixel(const job *j, worker *w, uint32_t x, uint32_t y)
{
    const uint32_t ray = w->n_rays;
    traveller *r = &w->ray[ray];
    double in_camera[3], dir[3];
    *r = (traveller){ .pixel = (size_t)y * j->picture->width + x, .transmittance = 1, .at = j->near * j->half_ratio };
    if (j->owner) j->owner[r->pixel] = UINT32_MAX;
    if (cn_camera_unproject(&j->camera, x + 0.5, y + 0.5, in_camera) != CN_OK) return;
    cn_mat3_vec(j->world_from_cam, in_camera, dir);
    for (int a = 0; a < 3; a++)
        r->dir[a] = (float)dir[a];
    r->across = hypotf(r->dir[0], r->dir[1]);
    for (uint32_t p = 0; p < j->n_parts; p++) {
        layer *l = &w->layer[p];
        const cn_box *box = &j->part[p].lit.tile->box;
        cn_ray made;
        cn_ray_make(box, j->centre, dir, &made);
        l->ray[ray] = made.box_ray;
        l->near[ray] = box->near_m;
        l->far[ray] = fmaxf(box->far_m, box_exit(&made.box_ray));
        r->end = fmaxf(r->end, l->far[ray]);
    }
    w->going[w->n_going++] = w->n_rays++;
}

static void tell_shares(const job *j, const worker *w, uint32_t ray)
{
    float first = 0, second = 0, sum = 0;
    uint32_t owner = UINT32_MAX;
    for (uint32_t p = 0; p < j->n_parts; p++) {
        const float share = w->layer[p].share[ray];
        if (share > first) owner = p;
        second = fmaxf(second, fminf(first, share));
        first = fmaxf(first, share);
        sum += share;
    }
    if (j->border) j->border[w->ray[ray].pixel] = sum > 0 ? second / sum : 0;
    if (j->owner) j->owner[w->ray[ray].pixel] = owner;
}

static void finish_pixels(const job *j, worker *w)
{
    float dir[CN_BATCH_RAYS][3], left[CN_BATCH_RAYS], phi[CN_BATCH_RAYS][CN_UNION_MAX];
    float rgba[CN_BATCH_RAYS][4] = { { 0 } };
    const cn_effect_rays rays = effect_rays(w, dir);
    bool any_opaque = false;
    for (uint32_t r = 0; r < w->n_rays; r++)
        shares(j, w->ray[r].end * w->ray[r].dir[0], w->ray[r].end * w->ray[r].dir[1], phi[r]);
    for (uint32_t p = 0; p < j->n_parts; p++) {
        layer *l = &w->layer[p];
        const cn_lit *lit = &j->part[p].lit;
        const bool opaque = lit->pack->background.n > 0;
        any_opaque |= opaque;
        if (!opaque && !l->lit) continue;
        /* What lies behind belongs to the tile in which the ray ends. */
        for (uint32_t r = 0; r < w->n_rays; r++)
            left[r] = w->ray[r].transmittance * phi[r][p];
        cn_effects_shade(lit->pack, &rays, &lit->effects, left, &l->rgb[0][0], l->batch.keep);
        for (uint32_t r = 0; r < w->n_rays; r++) {
            for (int c = 0; c < 3; c++)
                rgba[r][c] += l->rgb[r][c] * j->gain;
            rgba[r][3] += opaque ? left[r] : 0;
        }
    }
    for (uint32_t r = 0; r < w->n_rays; r++) {
        const traveller *ray = &w->ray[r];
        const float alpha = 1 - ray->transmittance;
        rgba[r][3] += alpha;
        memcpy(j->picture->rgba + 4 * ray->pixel, rgba[r], sizeof rgba[r]);
        j->picture->depth[ray->pixel] = alpha > (any_opaque ? 0.5f : 0) ? ray->depth / alpha : 0;
        tell_shares(j, w, r);
    }
}

static void render_block(void *user, size_t block, unsigned thread)
{
    const job *j = user;
    if (cn_stopping(j->ctx)) return;
    worker *w = &j->workers[thread];
    const uint32_t x0 = (uint32_t)(block % j->blocks_x) * BLOCK, y0 = (uint32_t)(block / j->blocks_x) * BLOCK;
    w->n_rays = w->n_going = 0;
    for (uint32_t p = 0; p < j->n_parts; p++) {
        layer *l = &w->layer[p];
        l->lit = false;
        memset(l->rgb, 0, sizeof l->rgb);
        memset(l->share, 0, sizeof l->share);
        memset(l->owed, 0, sizeof l->owed);
    }
    for (uint32_t y = y0; y < y0 + BLOCK && y < j->picture->height; y++)
        for (uint32_t x = x0; x < x0 + BLOCK && x < j->picture->width; x++)
            add_pixel(j, w, x, y);
    while (w->n_going) {
        march_round(j, w);
        if (w->n_going) evaluate(j, w);
    }
    colour(j, w, true);
    finish_pixels(j, w);
}

/* Activations with room for any of the tiles, whose fields may differ in size. */
static cn_field largest_field(const job *j)
{
    cn_field most = j->part[0].lit.tile->field;
    for (uint32_t p = 1; p < j->n_parts; p++) {
        const cn_field *f = &j->part[p].lit.tile->field;
        if (f->enc_rows > most.enc_rows) most.enc_rows = f->enc_rows;
        if (f->colour_in > most.colour_in) most.colour_in = f->colour_in;
        if (f->config.density_width > most.config.density_width) most.config.density_width = f->config.density_width;
        if (f->config.colour_width > most.config.colour_width) most.config.colour_width = f->config.colour_width;
    }
    return most;
}

static void carve(const job *j, cn_arena *arena, unsigned threads, worker **workers)
{
    const cn_field field = largest_field(j);
    worker counted;
    layer counted_layer;
    *workers = CN_ARENA_NEW(arena, worker, threads);
    for (unsigned i = 0; i < threads; i++) {
        worker *w = *workers ? &(*workers)[i] : &counted;
        cn_field_acts_take(&field, arena, CN_BATCH_PANELS, &w->acts);
        w->layer = CN_ARENA_NEW(arena, layer, j->n_parts);
        for (uint32_t p = 0; p < j->n_parts; p++) {
            layer *l = w->layer ? &w->layer[p] : &counted_layer;
            cn_batch_take(j->part[p].lit.tile, arena, &l->batch);
            l->phi = CN_ARENA_NEW(arena, float, CN_BATCH_CAP);
        }
    }
}

static cn_status prepare(job *j, uint32_t n, const cn_union_part *parts, const cn_view *view)
{
    cn_mat3_transpose(view->rotation, j->world_from_cam);
    cn_view_centre(view, j->centre);
    j->n_parts = n;
    j->step = INFINITY;
    j->near = INFINITY;
    for (uint32_t i = 0; i < n; i++) {
        const cn_box *box = &parts[i].tile->box;
        part *p = &j->part[i];
        CN_TRY(cn_lit_init(&p->lit, parts[i].tile, parts[i].appearance));
        p->x = (float)(parts[i].centre_m[0] - j->centre[0]);
        p->y = (float)(parts[i].centre_m[1] - j->centre[1]);
        p->band = (float)parts[i].band_m;
        p->back = (float)parts[i].back_m;
        j->step = fminf(j->step, box->step);
        j->near = fminf(j->near, box->near_m);
    }
    j->ratio = 1 + j->step;
    j->half_ratio = sqrtf(j->ratio);
    j->log_ratio = logf(j->ratio);
    j->gain = (float)exp2(j->options->exposure_ev);
    return CN_OK;
}

cn_status cn_render_union(const cn_context *ctx, uint32_t n, const cn_union_part *parts, const cn_camera *camera,
                          const cn_view *view, const cn_render_options *options, cn_picture *picture, float *border,
                          uint32_t *owner)
{
    if (camera->width != picture->width || camera->height != picture->height)
        return cn_fail(CN_ERR_USAGE, "the camera is %u x %u pixels but the picture %u x %u", camera->width,
                       camera->height, picture->width, picture->height);
    if (n < 1 || n > CN_UNION_MAX) return cn_fail(CN_ERR_USAGE, "a union of %u tiles: give 1 to %d", n, CN_UNION_MAX);
    job *j = calloc(1, sizeof *j);
    if (!j) return cn_fail(CN_ERR_NOMEM, "out of memory for a union of %u tiles", n);
    *j = (job){ .ctx = ctx,
                .options = options,
                .picture = picture,
                .border = border,
                .owner = owner,
                .camera = *camera,
                .blocks_x = (picture->width + BLOCK - 1) / BLOCK };
    const unsigned threads = cn_pool_threads(ctx->pool);
    cn_arena counter, arena = { 0 };
    worker *unused;
    cn_status status = prepare(j, n, parts, view);
    cn_arena_count(&counter);
    if (status == CN_OK) carve(j, &counter, threads, &unused);
    if (status == CN_OK) status = cn_arena_init(&arena, counter.used);
    if (status == CN_OK) {
        carve(j, &arena, threads, &j->workers);
        cn_pool_run(ctx->pool, (size_t)j->blocks_x * ((picture->height + BLOCK - 1) / BLOCK), render_block, j);
        if (cn_stopping(ctx))
            status = cn_fail(CN_ERR_INTERRUPTED, "stopped while rendering; run the same command to go on");
    }
    cn_arena_deinit(&arena);
    free(j);
    return status;
}

void cn_union_shares(uint32_t n, const cn_union_part *parts, const double xy_m[2], double *share)
{
    job j = { .n_parts = n };
    float phi[CN_UNION_MAX];
    for (uint32_t i = 0; i < n; i++) {
        j.part[i].x = (float)(parts[i].centre_m[0] - xy_m[0]);
        j.part[i].y = (float)(parts[i].centre_m[1] - xy_m[1]);
        j.part[i].band = (float)parts[i].band_m;
        j.part[i].back = (float)parts[i].back_m;
    }
    shares(&j, 0, 0, phi);
    for (uint32_t i = 0; i < n; i++)
        share[i] = (double)phi[i];
}
