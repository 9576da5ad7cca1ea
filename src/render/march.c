/* All tiles share one grid of t along a ray: where two tiles have a part of a place, their samples are of the same
 * place. A ray is marched in ranges of t. In each range only the tiles that have a part of it are asked for samples,
 * and only samples of which the tile has a part are evaluated. */
#include "render/march.h"

#include "render/trace.h"

#include <math.h>
#include <stdlib.h>

typedef cn_march_layer layer;
typedef cn_march_worker worker;
typedef cn_march_ray ray_state;

enum { BLOCK = 8 }; /* pixels a side of a block */
_Static_assert(BLOCK *BLOCK == CN_BATCH_RAYS, "a block is a batch");

/* ---- samples of a round ---- */

/* Keeps those of a tile's samples on a ray that lie before `cut` and of which the tile has a share. */
static uint32_t keep_owned(const cn_raymarch *m, const ray_state *r, layer *l, uint32_t which, float cut, uint32_t n)
{
    cn_batch *b = &l->batch;
    float *t = b->t_at + b->n_samples, *share = l->share + b->n_samples;
    uint32_t kept = 0;
    for (uint32_t i = 0; i < n && t[i] < cut; i++) {
        float all[CN_UNION_MAX];
        if (t[i] < l->near) continue;
        cn_partition_shares(&m->partition, t[i] * r->dir[0], t[i] * r->dir[1], all);
        if (!(all[which] > 0)) continue;
        share[kept] = all[which];
        t[kept++] = t[i];
    }
    return kept;
}

/* The same when the tile is the only one in the range. With a single tile every share is 1. */
static uint32_t keep_all(const cn_raymarch *m, layer *l, float cut, uint32_t n)
{
    cn_batch *b = &l->batch;
    float *t = b->t_at + b->n_samples, *share = l->share + b->n_samples;
    if (m->n_parts == 1) return n;
    uint32_t kept = 0;
    for (uint32_t i = 0; i < n && t[i] < cut; i++) {
        if (t[i] < l->near) continue;
        share[kept] = 1;
        t[kept++] = t[i];
    }
    return kept;
}

/* One range of one ray, as far as the room for samples of a tile goes. Returns how many there are now of the tile that
 * has the most of them. */
static uint32_t march_range(const cn_raymarch *m, worker *w, uint32_t ray)
{
    ray_state *r = &w->ray[ray];
    const float t0 = r->at;
    float t1 = r->end, last = 0;
    uint32_t active[CN_UNION_MAX], found[CN_UNION_MAX], most = 0;
    const cn_map_ray on_map = { r->dir[0], r->dir[1], r->map_length };
    const uint32_t n = cn_partition_active(&m->partition, &on_map, t0, &t1, active);
    float cut = t1;
    for (uint32_t i = 0; i < n; i++) {
        layer *l = &w->layer[active[i]];
        const cn_shading *shading = &m->shading[active[i]];
        const cn_march march = { t0, t1 < l->far[ray] ? t1 : l->far[ray], m->ratio, 0 };
        const uint32_t room = CN_BATCH_ROUND - l->n[ray];
        float *t = l->batch.t_at + l->batch.n_samples;
        found[i] =
            march.far_t > t0 ? shading->kernel->march(&l->ray[ray], &march, shading->tile->occupancy, t, room) : 0;
        if (found[i] < room || t[found[i] - 1] >= cut) continue;
        last = t[found[i] - 1];
        cut = last * m->half_ratio;
    }
    for (uint32_t i = 0; i < n; i++) {
        layer *l = &w->layer[active[i]];
        cn_batch *b = &l->batch;
        const cn_shading *shading = &m->shading[active[i]];
        const uint32_t mine = n == 1 ? keep_all(m, l, cut, found[i]) : keep_owned(m, r, l, active[i], cut, found[i]);
        if (mine) {
            shading->kernel->place(&l->ray[ray], b->t_at + b->n_samples, mine,
                                   (cn_spacing){ m->step, shading->inv_extent }, (cn_lanes){ b->pos, b->n_samples },
                                   b->length + b->n_samples);
            if (!l->n[ray]) l->first[ray] = b->n_samples;
            l->n[ray] += mine;
            b->n_samples += mine;
        }
        if (l->n[ray] > most) most = l->n[ray];
    }
    if (last > 0)
        r->at = last * m->ratio;
    else
        r->at = t1 < r->end ? t0 * expf(ceilf(logf(t1 / t0) / m->log_ratio) * m->log_ratio) : INFINITY;
    return most;
}

/* Marches every active ray by at most CN_BATCH_ROUND samples of a tile. Rays without samples end. */
static void march_round(const cn_raymarch *m, worker *w)
{
    uint32_t kept = 0;
    for (uint32_t p = 0; p < m->n_parts; p++) {
        w->layer[p].batch.n_samples = 0;
        memset(w->layer[p].n, 0, sizeof w->layer[p].n);
    }
    for (uint32_t i = 0; i < w->n_going; i++) {
        const uint32_t ray = w->going[i];
        bool found = false;
        for (uint32_t most = 0; most < CN_BATCH_ROUND && w->ray[ray].at < w->ray[ray].end; found |= (most > 0))
            most = march_range(m, w, ray);
        if (found) w->going[kept++] = ray;
    }
    w->n_going = kept;
}

/* ---- weights from densities ---- */

/* Takes what a sample of a tile shows. A weight that is too small for a colour of its own is carried to the tile's next
 * sample on the ray: without it many thin samples would be black together. */
static void take_weight(layer *l, uint32_t ray, uint32_t sample, float weight)
{
    l->weight[ray] += weight;
    l->carried[ray] += weight;
    if (!(l->carried[ray] > CN_BATCH_MIN_WEIGHT)) return;
    cn_batch_show(&l->batch, sample, ray, l->carried[ray]);
    l->carried[ray] = 0;
}

/* Where in a step light ends, on average: -1/2 at its beginning, 1/2 at its end. With optical depth tau in the step it
 * is 1 / tau - 1 / (e^tau - 1) from the beginning. */
static float mean_in_step(float before, float after)
{
    const float tau = logf(before / fmaxf(after, 1e-30f));
    if (!(tau > 1e-2f)) return -tau / 12;
    return 1 / tau - 1 / expm1f(fminf(tau, 60)) - 0.5f;
}

/* Attenuates the ray by a sample at t. Returns the sample's weight. */
static float pass(const cn_raymarch *m, ray_state *r, float t, float after)
{
    const float weight = r->transmittance - after, left = (float)m->options->depth_left;
    const float at = m->options->fine_depth ? t * (1 + m->step * mean_in_step(r->transmittance, after)) : t;
    if (left > 0 && after <= left && r->transmittance > left) r->surface = at;
    r->transmittance = after;
    r->depth += weight * at;
    return weight;
}

/* A ray whose samples in this round are all of one tile, which is the usual case. */
static void composite_alone(const cn_raymarch *m, ray_state *r, layer *l, uint32_t ray)
{
    const uint32_t end = l->first[ray] + l->n[ray];
    const float least = (float)m->options->min_transmittance;
    for (uint32_t i = l->first[ray]; i < end && r->transmittance > least; i++) {
        const float after = r->transmittance * expf(-l->share[i] * cn_batch_depth(&l->batch, i));
        take_weight(l, ray, i, pass(m, r, l->batch.t_at[i], after));
    }
}

/* The samples of all tiles that stand at the ray's next t. tau: each tile's optical depth there, -1 without a sample.
 */
static float next_group(const cn_raymarch *m, const worker *w, uint32_t ray, const uint32_t *done, float *tau,
                        float *sum)
{
    float t = INFINITY;
    *sum = 0;
    for (uint32_t p = 0; p < m->n_parts; p++) {
        const layer *l = &w->layer[p];
        if (done[p] < l->n[ray]) t = fminf(t, l->batch.t_at[l->first[ray] + done[p]]);
    }
    for (uint32_t p = 0; p < m->n_parts; p++) {
        const layer *l = &w->layer[p];
        const uint32_t i = l->first[ray] + done[p];
        tau[p] = -1;
        if (done[p] >= l->n[ray] || l->batch.t_at[i] > t * (1 + 0.25f * m->step)) continue;
        tau[p] = l->share[i] * cn_batch_depth(&l->batch, i);
        *sum += tau[p];
    }
    return t;
}

static void composite_shared(const cn_raymarch *m, worker *w, uint32_t ray)
{
    ray_state *r = &w->ray[ray];
    uint32_t done[CN_UNION_MAX] = { 0 };
    while (r->transmittance > (float)m->options->min_transmittance) {
        float tau[CN_UNION_MAX], sum;
        const float t = next_group(m, w, ray, done, tau, &sum);
        if (t == INFINITY) return;
        const float weight = pass(m, r, t, r->transmittance * expf(-sum));
        for (uint32_t p = 0; p < m->n_parts; p++) {
            layer *l = &w->layer[p];
            if (tau[p] < 0) continue;
            take_weight(l, ray, l->first[ray] + done[p]++, sum > 0 ? weight * tau[p] / sum : 0);
        }
    }
}

static void composite_ray(const cn_raymarch *m, worker *w, uint32_t ray)
{
    layer *only = NULL;
    uint32_t n = 0;
    for (uint32_t p = 0; p < m->n_parts; p++)
        if (w->layer[p].n[ray]) only = &w->layer[p], n++;
    if (n == 1)
        composite_alone(m, &w->ray[ray], only, ray);
    else if (n)
        composite_shared(m, w, ray);
}

/* ---- a block ---- */

static void colour(const cn_raymarch *m, worker *w, bool all)
{
    for (uint32_t p = 0; p < m->n_parts; p++) {
        layer *l = &w->layer[p];
        if (l->begun) cn_batch_colour(&m->shading[p], &l->batch, &l->acts, all, l->rgb);
    }
}

/* Evaluates the samples of a round. Rays that are opaque or at their end are removed. */
static void evaluate(const cn_raymarch *m, worker *w)
{
    float dir[CN_BATCH_RAYS][3];
    const cn_effect_rays rays = cn_march_effect_rays(w, dir);
    for (uint32_t p = 0; p < m->n_parts; p++) {
        layer *l = &w->layer[p];
        if (!l->batch.n_samples) continue;
        if (!l->begun) cn_batch_condition(&m->shading[p], &l->batch, &rays);
        l->begun = true;
        w->n_evaluated += l->batch.n_samples;
        cn_batch_density(&m->shading[p], &l->batch, &l->acts);
    }
    for (uint32_t i = 0; i < w->n_going; i++)
        composite_ray(m, w, w->going[i]);
    colour(m, w, false);
    uint32_t kept = 0;
    for (uint32_t i = 0; i < w->n_going; i++) {
        const ray_state *r = &w->ray[w->going[i]];
        if (r->at < r->end && r->transmittance > (float)m->options->min_transmittance) w->going[kept++] = w->going[i];
    }
    w->n_going = kept;
}

/* Where a ray leaves a tile's box. */
static float box_exit(const cn_box_ray *ray)
{
    float out = INFINITY;
    for (int a = 0; a < 3; a++)
        if (ray->dir[a] != 0)
            out = fminf(out, fmaxf((1 - ray->origin[a]) / ray->dir[a], (-1 - ray->origin[a]) / ray->dir[a]));
    return out;
}

/* Shortens a ray to its part in the crop box; a ray that misses the box has none. */
static void crop(const cn_raymarch *m, ray_state *r, const double eye[3])
{
    const double *low = m->options->crop_m, *high = low + 3;
    double from = 0, to = INFINITY;
    for (int a = 0; a < 3; a++) {
        const double dir = (double)r->dir[a];
        if (dir == 0) {
            if (eye[a] < low[a] || eye[a] > high[a]) to = -1;
            continue;
        }
        const double t0 = (low[a] - eye[a]) / dir, t1 = (high[a] - eye[a]) / dir;
        from = fmax(from, fmin(t0, t1));
        to = fmin(to, fmax(t0, t1));
    }
    r->at = fmaxf(r->at, (float)from);
    r->end = fminf(r->end, (float)to);
}

/* Starts w->ray[w->n_rays]. eye: where it begins, on the map. */
static void begin_ray(const cn_raymarch *m, worker *w, size_t pixel, const double eye[3])
{
    ray_state *r = &w->ray[w->n_rays];
    r->pixel = pixel;
    r->transmittance = 1;
    r->at = m->near * m->half_ratio;
    r->end = r->depth = r->surface = 0;
    r->map_length = hypotf(r->dir[0], r->dir[1]);
    for (uint32_t p = 0; p < m->n_parts; p++) {
        layer *l = &w->layer[p];
        const float far = m->shading[p].tile->box.far_m;
        l->far[w->n_rays] = m->to_exit ? fmaxf(far, box_exit(&l->ray[w->n_rays])) : far;
        r->end = fmaxf(r->end, l->far[w->n_rays]);
    }
    if (m->options->crop_m) crop(m, r, eye);
    w->going[w->n_going++] = w->n_rays++;
}

/* A pixel without a ray of the lens does not change. */
static void add_pixel(const cn_raymarch *m, worker *w, uint32_t x, uint32_t y)
{
    const size_t pixel = (size_t)y * m->width + x;
    if (m->owner) m->owner[pixel] = UINT32_MAX;
    for (uint32_t p = 0; p < m->n_parts; p++) {
        cn_ray ray;
        if (!cn_ray_generator_ray(&m->generator[p], x + 0.5, y + 0.5, &ray)) return;
        w->layer[p].ray[w->n_rays] = ray.box_ray;
        memcpy(w->ray[w->n_rays].dir, ray.dir, sizeof ray.dir);
    }
    begin_ray(m, w, pixel, m->eye_m);
}

static void add_block(const cn_raymarch *m, worker *w, size_t block)
{
    const uint32_t x0 = (uint32_t)(block % m->blocks_x) * BLOCK, y0 = (uint32_t)(block / m->blocks_x) * BLOCK;
    for (uint32_t y = y0; y < y0 + BLOCK && y < m->height; y++)
        for (uint32_t x = x0; x < x0 + BLOCK && x < m->width; x++)
            add_pixel(m, w, x, y);
}

/* The grid of t stays, so a part of a ray has the samples that the whole ray has there. */
static void shorten(const cn_raymarch *m, ray_state *r, const double range[2])
{
    const float begin = r->at, from = (float)range[0];
    if (from > begin) r->at = begin * expf(floorf(logf(from / begin) / m->log_ratio) * m->log_ratio);
    r->end = fminf(r->end, (float)range[1]);
}

static void add_listed(const cn_raymarch *m, worker *w, size_t block)
{
    for (size_t i = block * CN_BATCH_RAYS; i < (block + 1) * CN_BATCH_RAYS && i < m->n_rays; i++) {
        cn_ray ray;
        cn_ray_make(&m->shading->tile->box, m->origin[i], m->direction[i], &ray);
        w->layer->ray[w->n_rays] = ray.box_ray;
        memcpy(w->ray[w->n_rays].dir, ray.dir, sizeof ray.dir);
        begin_ray(m, w, i, m->origin[i]);
        if (m->range) shorten(m, &w->ray[w->n_rays - 1], m->range[i]);
    }
}

static void write_owner(const cn_raymarch *m, const worker *w, uint32_t ray)
{
    float first = 0, second = 0, sum = 0;
    uint32_t owner = UINT32_MAX;
    for (uint32_t p = 0; p < m->n_parts; p++) {
        const float weight = w->layer[p].weight[ray];
        if (weight > first) owner = p;
        second = fmaxf(second, fminf(first, weight));
        first = fmaxf(first, weight);
        sum += weight;
    }
    if (m->border) m->border[w->ray[ray].pixel] = sum > 0 ? second / sum : 0;
    if (m->owner) m->owner[w->ray[ray].pixel] = owner;
}

/* A background makes a pixel opaque where it covers the direction; it has no depth. rgba[3]: what it covers of what is
 * left. Where all tiles have one, alpha is 1 but for `open`, the part of the ray that nothing ends; a sum of shares is
 * not 1 exactly. */
static void write_pixel(const cn_raymarch *m, const worker *w, uint32_t ray, float open, float rgba[4])
{
    const ray_state *r = &w->ray[ray];
    const float alpha = 1 - r->transmittance;
    rgba[3] = m->all_opaque ? 1 - open : rgba[3] + alpha;
    memcpy(m->rgba + 4 * r->pixel, rgba, 4 * sizeof *rgba);
    const bool seen = alpha > (m->any_opaque ? 0.5f : 0);
    m->depth[r->pixel] = !seen ? 0 : r->surface > 0 ? r->surface : r->depth / alpha;
    if (m->border || m->owner) write_owner(m, w, ray);
}

/* How sure it is that a ray that ends in the sky has not missed matter that no photo saw, 0 to 1. Of several tiles the
 * surest one tells: its photos look there. */
static float sureness(const cn_raymarch *m, const worker *w, uint32_t ray)
{
    float most = 0;
    for (uint32_t p = 0; p < m->n_parts && most < 1; p++) {
        const cn_seen *seen = &m->shading[p].tile->seen;
        const float open = seen->places ? cn_seen_open(seen, &w->layer[p].ray[ray], w->ray[ray].dir) : 1;
        most = fmaxf(most, open);
    }
    return most;
}

/* What lies behind all samples belongs to the tile in which the ray ends. */
static void write_block(const cn_raymarch *m, worker *w)
{
    float dir[CN_BATCH_RAYS][3], left[CN_BATCH_RAYS], share[CN_BATCH_RAYS][CN_UNION_MAX];
    float rgba[CN_BATCH_RAYS][4] = { { 0 } }, open[CN_BATCH_RAYS] = { 0 };
    const cn_effect_rays rays = cn_march_effect_rays(w, dir);
    for (uint32_t r = 0; r < w->n_rays; r++) {
        const float end = w->ray[r].end;
        cn_partition_shares(&m->partition, end * w->ray[r].dir[0], end * w->ray[r].dir[1], share[r]);
    }
    for (uint32_t p = 0; p < m->n_parts; p++) {
        layer *l = &w->layer[p];
        const cn_shading *shading = &m->shading[p];
        const bool opaque = shading->pack->background.n > 0;
        if (!opaque && !l->begun) continue;
        for (uint32_t r = 0; r < w->n_rays; r++)
            left[r] = m->options->crop_m || m->range ? 0 : w->ray[r].transmittance * share[r][p];
        cn_effects_shade(shading->pack, &rays, &shading->effects, w->has_sky ? NULL : left, &l->rgb[0][0],
                         l->batch.saved);
        for (uint32_t r = 0; r < w->n_rays; r++) {
            for (int c = 0; c < 3; c++)
                rgba[r][c] += l->rgb[r][c] * m->gain;
            const float cover = cn_effects_cover(shading->pack, dir[r]);
            rgba[r][3] += left[r] * cover;
            open[r] += left[r] * (1 - cover);
        }
    }
    for (uint32_t r = 0; r < w->n_rays; r++) {
        const bool in_sky = m->all_opaque && w->ray[r].transmittance > 0.5f;
        const float sure = in_sky ? sureness(m, w, r) : 1;
        for (int c = 0; c < 3; c++)
            rgba[r][c] *= sure;
        write_pixel(m, w, r, 1 - sure * (1 - open[r]), rgba[r]);
    }
}

static void begin_block(const cn_raymarch *m, worker *w, size_t block)
{
    w->n_rays = w->n_going = 0;
    w->n_evaluated = 0;
    w->has_sky = false;
    for (uint32_t p = 0; p < m->n_parts; p++) {
        layer *l = &w->layer[p];
        l->begun = false;
        memset(l->rgb, 0, sizeof l->rgb);
        memset(l->weight, 0, sizeof l->weight);
        memset(l->carried, 0, sizeof l->carried);
    }
    if (m->n_rays)
        add_listed(m, w, block);
    else
        add_block(m, w, block);
}

/* ---- the operations: who asks to stop finds blocks without rays, and what was done thrown away ---- */

static void rays_op(void *user, size_t block, unsigned thread)
{
    const cn_raymarch *m = user;
    worker *w = &m->workers[thread];
    if (cn_stopping(m->ctx))
        w->n_rays = w->n_going = 0;
    else
        begin_block(m, w, block);
}

static void trace_op(void *user, size_t block, unsigned thread)
{
    (void)block;
    const cn_raymarch *m = user;
    worker *w = &m->workers[thread];
    if (!w->n_rays) return;
    while (w->n_going) {
        march_round(m, w);
        if (w->n_going) evaluate(m, w);
    }
    colour(m, w, true);
    if (m->options->samples) __atomic_fetch_add(m->options->samples, w->n_evaluated, __ATOMIC_RELAXED);
}

static void pixels_op(void *user, size_t block, unsigned thread)
{
    (void)block;
    const cn_raymarch *m = user;
    worker *w = &m->workers[thread];
    if (w->n_rays) write_block(m, w);
}

/* ---- all blocks ---- */

static worker *carve(const cn_raymarch *m, cn_arena *arena)
{
    const unsigned threads = cn_pool_threads(m->ctx->pool);
    worker counted, *workers = CN_ARENA_NEW(arena, worker, threads);
    layer counted_layer;
    for (unsigned i = 0; i < threads; i++) {
        worker *w = workers ? &workers[i] : &counted;
        w->layer = CN_ARENA_NEW(arena, layer, m->n_parts);
        for (uint32_t p = 0; p < m->n_parts; p++) {
            layer *l = w->layer ? &w->layer[p] : &counted_layer;
            const cn_field *field = &m->shading[p].tile->field;
            field->type->acts_take(field, arena, CN_BATCH_PANELS, &l->acts);
            cn_batch_take(m->shading[p].tile, arena, &l->batch);
            l->share = CN_ARENA_NEW(arena, float, CN_BATCH_CAP);
            l->near = m->shading[p].tile->box.near_m;
            for (uint32_t k = 0; l->share && k < CN_BATCH_CAP; k++)
                l->share[k] = 1;
        }
    }
    return workers;
}

cn_status cn_raymarch_init(cn_raymarch *m, const cn_context *ctx, const cn_render_options *options, uint32_t n,
                           const cn_union_part *parts, const double origin_m[2])
{
    *m = (cn_raymarch){ .ctx = ctx, .options = options, .n_parts = n, .all_opaque = true, .step = INFINITY };
    m->near = INFINITY;
    m->shading = calloc(n, sizeof *m->shading);
    m->generator = calloc(n, sizeof *m->generator);
    if (!m->shading || !m->generator) return cn_fail(CN_ERR_NOMEM, "out of memory for a render of %u tiles", n);
    cn_partition_init(&m->partition, n, parts, origin_m);
    for (uint32_t i = 0; i < n; i++) {
        const cn_box *box = &parts[i].tile->box;
        CN_TRY(cn_shading_init(&m->shading[i], ctx, parts[i].tile, parts[i].appearance));
        const bool opaque = m->shading[i].pack->background.n > 0 && !options->crop_m;
        m->all_opaque = m->all_opaque && opaque;
        m->any_opaque = m->any_opaque || opaque;
        m->step = fminf(m->step, box->step);
        m->near = fminf(m->near, box->near_m);
    }
    m->ratio = 1 + m->step;
    m->half_ratio = sqrtf(m->ratio);
    m->log_ratio = logf(m->ratio);
    m->gain = (float)exp2(options->exposure_ev);
    return CN_OK;
}

void cn_raymarch_deinit(cn_raymarch *m)
{
    free(m->shading);
    free(m->generator);
    *m = (cn_raymarch){ 0 };
}

cn_status cn_raymarch_check(const cn_camera *camera, const cn_picture *picture)
{
    if (camera->width == picture->width && camera->height == picture->height) return CN_OK;
    return cn_fail(CN_ERR_USAGE, "the camera is %u x %u pixels but the picture %u x %u", camera->width, camera->height,
                   picture->width, picture->height);
}

void cn_raymarch_take_picture(cn_raymarch *m, const cn_camera *camera, const cn_view *view, cn_picture *picture)
{
    m->rgba = picture->rgba;
    m->depth = picture->depth;
    m->width = picture->width;
    m->height = picture->height;
    cn_view_centre(view, m->eye_m);
    for (uint32_t p = 0; p < m->n_parts; p++)
        cn_ray_generator_init(&m->generator[p], camera, view, &m->shading[p].tile->box);
}

cn_status cn_raymarch_run(cn_raymarch *m)
{
    cn_arena counter, arena = { 0 };
    m->blocks_x = (m->width + BLOCK - 1) / BLOCK;
    const size_t blocks = m->n_rays ? (m->n_rays + CN_BATCH_RAYS - 1) / CN_BATCH_RAYS
                                    : (size_t)m->blocks_x * ((m->height + BLOCK - 1) / BLOCK);
    cn_arena_count(&counter);
    (void)carve(m, &counter);
    CN_TRY(cn_device_arena_init(m->ctx, &arena, counter.used));
    m->workers = carve(m, &arena);
    cn_trace trace;
    const bool described = cn_march_describe(m, &trace);
    m->describes_sky = described && trace.march.sky;
    const cn_op ops[] = { { .kind = CN_OP_RAYS, .item = rays_op },
                          { .kind = CN_OP_TRACE,
                            .item = trace_op,
                            .batch = described ? &trace : NULL,
                            .pack = cn_march_pack,
                            .unpack = cn_march_unpack,
                            .keep = sizeof(cn_march_kept) },
                          { .kind = CN_OP_PIXELS, .item = pixels_op } };
    const cn_chain chain = { ops, 3, blocks, m };
    const cn_status status = cn_device_run(m->ctx, &chain, 1);
    cn_device_arena_deinit(m->ctx, &arena);
    return status != CN_OK || cn_stopping(m->ctx)
               ? cn_fail(CN_ERR_INTERRUPTED, "stopped while rendering; run the same command to resume")
               : CN_OK;
}
