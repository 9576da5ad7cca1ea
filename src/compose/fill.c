/* Fills the pixels of a picture where no tile has anything, by push and pull (Gortler et al. 1996, "The Lumigraph").
 * A pixel of a coarser level is the mean of four finer pixels, weighted by their opacity. Where a pixel lacks opacity,
 * the colour of the coarser level is added. A small hole gets the colours at its edge, a large hole a smooth mean of
 * them. */
#include "conurb/compose.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A level of the pyramid. A pixel has four floats: premultiplied colour and weight. */
typedef struct level {
    uint32_t width, height;
    float *rgba;
    bool wraps; /* as the picture does */
} level;
enum { MAX_LEVELS = 17, /* enough for a side of 65,535 pixels */ SMALL = 30 };
#define GREY 0.18f

/* Lays out the levels, down to `least` pixels a side. Returns how many floats all but the picture's own need. */
static size_t place_levels(const cn_picture *picture, uint32_t least, level levels[MAX_LEVELS], uint32_t *n)
{
    size_t floats = 0;
    levels[0] = (level){ picture->width, picture->height, picture->rgba, picture->wraps };
    for (*n = 1; levels[*n - 1].width > least || levels[*n - 1].height > least; ++*n) {
        const level *finer = &levels[*n - 1];
        levels[*n] = (level){ (finer->width + 1) / 2, (finer->height + 1) / 2, NULL, picture->wraps };
        floats += (size_t)levels[*n].width * levels[*n].height * 4;
    }
    return floats;
}

/* The weight of a pixel of the picture. The colour of a pixel of little opacity may be anything. Around a large hole
 * many such pixels would add up, so a pixel of less than one half has weight 0. */
static float clear_part(float alpha)
{
    return fmaxf(2 * alpha - 1, 0);
}

#define OPAQUE 0.97f

static bool is_open(const cn_picture *p, size_t i)
{
    return p->depth && p->depth[i] == 0;
}

static bool is_sky(const cn_picture *p, size_t i)
{
    return is_open(p, i) && p->rgba[4 * i + 3] >= OPAQUE;
}

/* Beside a sky, what is transparent is matter that no photo saw: it lies below the horizon, or where photos show
 * houses. So the sky does not fill it, unless there is nothing else. */
static bool has_matter(const cn_picture *p)
{
    bool any = false;
    for (size_t i = 0, n = (size_t)p->width * p->height; i < n && !any; i++)
        any = !is_open(p, i) && clear_part(p->rgba[4 * i + 3]) > 0;
    return any;
}

/* Weights add up, to 1 at most. A coarser pixel over one known pixel is therefore as well known as that one. */
static void pull(const level *from, bool is_picture, const cn_picture *without_sky, level *to)
{
    for (uint32_t y = 0; y < to->height; y++)
        for (uint32_t x = 0; x < to->width; x++) {
            float sum[4] = { 0 };
            for (uint32_t k = 0; k < 4; k++) {
                /* Of an odd width, the last coarse pixel lies over the seam. */
                const uint32_t over = 2 * x + k % 2, fx = from->wraps ? over % from->width : over, fy = 2 * y + k / 2;
                if (fx >= from->width || fy >= from->height) continue;
                const size_t at = (size_t)fy * from->width + fx;
                const float *in = from->rgba + 4 * at;
                /* A pixel that is not finite gets weight 0. */
                if (!isfinite(in[0] + in[1] + in[2] + in[3])) continue;
                if (without_sky && is_open(without_sky, at)) continue;
                const float part = is_picture ? clear_part(in[3]) : 1;
                for (int c = 0; c < 4; c++)
                    sum[c] += part * in[c];
            }
            const float scale = sum[3] > 1 ? 1 / sum[3] : 1;
            for (int c = 0; c < 4; c++)
                to->rgba[4 * ((size_t)y * to->width + x) + (size_t)c] = sum[c] * scale;
        }
}

/* The value of the coarser level at the centre of a finer pixel. Bilinear weights: 9, 3, 3 and 1 of 16. Behind the
 * seam of an odd width, the centres of two coarse pixels are equally near. */
static void sample(const level *coarse, const level *fine, uint32_t x, uint32_t y, float out[4])
{
    const float side = fine->wraps && x == 0 && fine->width % 2 ? 0.5f : 0.25f;
    const int64_t at[2] = { x / 2, y / 2 },
                  beside[2] = { x % 2 ? at[0] + 1 : at[0] - 1, y % 2 ? at[1] + 1 : at[1] - 1 };
    for (int c = 0; c < 4; c++)
        out[c] = 0;
    for (int k = 0; k < 4; k++) {
        const int64_t last[2] = { (int64_t)coarse->width - 1, (int64_t)coarse->height - 1 };
        int64_t p[2] = { k % 2 ? beside[0] : at[0], k / 2 ? beside[1] : at[1] };
        if (coarse->wraps) p[0] = (p[0] + coarse->width) % coarse->width;
        for (int a = 0; a < 2; a++)
            p[a] = p[a] < 0 ? 0 : p[a] > last[a] ? last[a] : p[a];
        const float weight = (k % 2 ? side : 1 - side) * (k / 2 ? 0.25f : 0.75f);
        const float *in = coarse->rgba + 4 * ((size_t)p[1] * coarse->width + (size_t)p[0]);
        for (int c = 0; c < 4; c++)
            out[c] += weight * in[c];
    }
}

static void push(const level *coarse, level *fine)
{
    for (uint32_t y = 0; y < fine->height; y++)
        for (uint32_t x = 0; x < fine->width; x++) {
            float *at = fine->rgba + 4 * ((size_t)y * fine->width + x), from[4];
            if (!(at[3] < 1)) continue;
            sample(coarse, fine, x, y, from);
            if (!(from[3] > 0)) continue;
            for (int c = 0; c < 3; c++)
                at[c] += (1 - at[3]) * from[c] / from[3];
            at[3] = 1;
        }
}

/* Pixels around i, at most 8. */
static uint32_t neighbours(const cn_picture *p, size_t i, size_t out[8])
{
    const int64_t x = (int64_t)(i % p->width), y = (int64_t)(i / p->width);
    uint32_t n = 0;
    for (int64_t v = y - 1; v <= y + 1; v++)
        for (int64_t beside = x - 1; beside <= x + 1; beside++) {
            const int64_t u = p->wraps ? (beside + p->width) % p->width : beside;
            if ((u != x || v != y) && u >= 0 && v >= 0 && u < p->width && v < p->height)
                out[n++] = (size_t)v * p->width + (size_t)u;
        }
    return n;
}

/* Below the horizon the sky fades out, because no horizon is exact. A hole in the ground just below it would therefore
 * show a tinge of sky. Such a hole is told by its edge: it does not touch the sky, where depth is 0 and alpha is 1.
 * Marks the open pixels that are connected to the sky. queue: room for all pixels. */
static void mark_sky(const cn_picture *p, uint8_t *sky, uint32_t *queue)
{
    const size_t n = (size_t)p->width * p->height;
    size_t first = 0, last = 0, around[8];
    for (size_t i = 0; i < n; i++) {
        sky[i] = is_sky(p, i);
        if (sky[i]) queue[last++] = (uint32_t)i;
    }
    while (first < last) {
        const size_t i = queue[first++];
        for (uint32_t k = 0, m = neighbours(p, i, around); k < m; k++) {
            if (sky[around[k]] || !is_open(p, around[k])) continue;
            sky[around[k]] = 1;
            queue[last++] = (uint32_t)around[k];
        }
    }
}

/* A few open pixels within matter of about one distance are a hole in a wall that the field lacks, not sky. The share
 * is of the picture's width. Looked at on made cities at preview: white flecks on walls go, but for pixels that show
 * sky in part. Standard, right halves: sceaux 21.26 -> 21.30 dB; lund, castle and sacre-coeur as before, SSIM 0.0004
 * higher or as before. */
#define PINHOLE 0.01
#define ONE_WALL 1.15f /* farthest over nearest pixel around a pinhole */

/* Makes such holes transparent. done: [pixels]; queue: room for all pixels. */
static void clear_pinholes(cn_picture *p, uint8_t *done, uint32_t *queue)
{
    const size_t n = (size_t)p->width * p->height;
    const double side = PINHOLE * p->width;
    memset(done, 0, n);
    for (size_t i = 0; i < n; i++) {
        if (done[i] || !is_open(p, i)) continue;
        size_t first = 0, last = 0, around[8];
        bool inside = true;
        float nearest = INFINITY, farthest = 0;
        done[i] = 1;
        for (queue[last++] = (uint32_t)i; first < last; first++) {
            const uint32_t m = neighbours(p, queue[first], around);
            inside = inside && m == 8;
            for (uint32_t k = 0; k < m; k++) {
                const float depth = p->depth[around[k]];
                if (!is_open(p, around[k])) {
                    nearest = fminf(nearest, depth);
                    farthest = fmaxf(farthest, depth);
                } else if (!done[around[k]]) {
                    done[around[k]] = 1;
                    queue[last++] = (uint32_t)around[k];
                }
            }
        }
        if (!inside || !((double)last <= side * side) || !(farthest <= ONE_WALL * nearest)) continue;
        for (size_t k = 0; k < last; k++)
            memset(p->rgba + 4 * (size_t)queue[k], 0, 4 * sizeof *p->rgba);
    }
}

/* Makes the holes below the horizon transparent, and the pixels at their edges, which have a part of the tinge. sky and
 * queue: room for all pixels. */
static void clear_holes(cn_picture *p, uint8_t *sky, uint32_t *queue)
{
    const size_t n = (size_t)p->width * p->height;
    mark_sky(p, sky, queue);
    for (size_t i = 0; i < n; i++) {
        size_t around[8];
        bool hole = !sky[i] && is_open(p, i);
        if (sky[i] || p->rgba[4 * i + 3] >= OPAQUE) continue;
        for (uint32_t k = 0, m = neighbours(p, i, around); k < m && !hole; k++)
            hole = !sky[around[k]] && is_open(p, around[k]);
        if (hole) memset(p->rgba + 4 * i, 0, 4 * sizeof *p->rgba);
    }
    clear_pinholes(p, sky, queue);
}

static void add_grey(const level *l)
{
    for (size_t i = 0; i < (size_t)l->width * l->height; i++) {
        float *at = l->rgba + 4 * i;
        if (!(at[3] < 1)) continue;
        for (int c = 0; c < 3; c++)
            at[c] += (1 - at[3]) * GREY;
        at[3] = 1;
    }
}

static void scale(cn_picture *p, float factor)
{
    for (size_t i = 0; i < 4 * (size_t)p->width * p->height; i++)
        p->rgba[i] *= factor;
}

/* room: of all levels but the picture's own. */
static void fill(cn_picture *p, cn_unseen unseen, level *levels, uint32_t n, float *room)
{
    for (uint32_t i = 1; i < n; i++) {
        levels[i].rgba = room;
        room += (size_t)levels[i].width * levels[i].height * 4;
        pull(&levels[i - 1], i == 1, i == 1 && has_matter(p) ? p : NULL, &levels[i]);
    }
    if (unseen == CN_UNSEEN_NEUTRAL) add_grey(&levels[n - 1]);
    for (uint32_t i = n - 1; i-- > 0;)
        push(&levels[i + 1], &levels[i]);
}

cn_status cn_compose_unseen(cn_picture *picture, cn_unseen unseen)
{
    const float coverage = 1 - picture->fade;
    if (unseen == CN_UNSEEN_BLACK || !(coverage > 0)) return CN_OK;
    level levels[MAX_LEVELS];
    uint32_t n;
    const size_t pixels = (size_t)picture->width * picture->height,
                 floats = place_levels(picture, unseen == CN_UNSEEN_NEUTRAL ? SMALL : 1, levels, &n);
    float *room = malloc((floats + 1) * sizeof *room);
    uint8_t *sky = malloc(pixels + 1);
    uint32_t *queue = malloc((pixels + 1) * sizeof *queue);
    const bool ready = room && sky && queue;
    if (ready) {
        if (coverage < 1) scale(picture, 1 / coverage);
        if (picture->depth) clear_holes(picture, sky, queue);
        fill(picture, unseen, levels, n, room);
        if (coverage < 1) scale(picture, coverage);
    }
    free(room);
    free(sky);
    free(queue);
    return ready ? CN_OK
                 : cn_fail(CN_ERR_NOMEM, "out of memory to fill a picture of %u x %u pixels", picture->width,
                           picture->height);
}
