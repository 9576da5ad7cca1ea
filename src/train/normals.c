/* Normal maps beside the photos: which rays lie on one plane, and what the plane says of their distances. */
#include "base/rng.h"
#include "train/sampler.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    STREAM_NEIGHBOUR = 20, /* behind those of sampler.c; a second number is drawn from the next stream */
    REACH_PART = 64,       /* a neighbour is at most this part of the photo's width away ... */
    LEAST_REACH = 2        /* ... but 2 pixels in small photos */
};
#define AGREE 0.9  /* cosine between two normals of one plane */
#define FACING 0.1 /* cosine to the ray: a plane that is seen more slanted says too little of depth */

void cn_sampler_find_normals(cn_sampler *s)
{
    s->n_normal = 0;
    for (uint32_t i = 0; i < s->n_photos; i++)
        s->n_normal += cn_pixel_store_has_normal(s->pixels, s->photos[i].store);
}

/* A place at most `reach` pixels away, on the other side where that would be outside. */
static uint16_t beside(uint32_t at, int32_t by, uint32_t size)
{
    const int64_t there = (int64_t)at + by, mirrored = (int64_t)at - by;
    if (there >= 0 && there < size) return (uint16_t)there;
    return (uint16_t)(mirrored >= 0 && mirrored < size ? mirrored : at);
}

bool cn_sampler_draw_neighbour(const cn_sampler *s, uint32_t step, uint32_t r, cn_batch *b, uint16_t at[2])
{
    const cn_train_photo *p = &s->photos[b->ray_photo[r - 1]];
    if (!cn_pixel_store_has_normal(s->pixels, p->store)) return false;
    const uint64_t counter = (uint64_t)step * CN_MAX_RAYS + r;
    const uint32_t part = p->size.width / REACH_PART, reach = part > LEAST_REACH ? part : LEAST_REACH;
    int32_t dx = (int32_t)cn_rng_below(s->seed, STREAM_NEIGHBOUR, counter, 2 * reach + 1) - (int32_t)reach;
    const int32_t dy = (int32_t)cn_rng_below(s->seed, STREAM_NEIGHBOUR + 1, counter, 2 * reach + 1) - (int32_t)reach;
    if (!dx && !dy) dx = (int32_t)reach;
    at[0] = beside(at[0], dx, p->size.width);
    at[1] = beside(at[1], dy, p->size.height);
    b->ray_photo[r] = b->ray_photo[r - 1];
    b->depth_m[r] = 0;
    return true;
}

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* The plane of two rays from one place: its normal is the mean of both. A pose that is refined later turns the rays and
 * the normals alike, so the difference of log-distances stays right. */
static void set_plane(const cn_sampler *s, uint32_t r, const float normal[6], cn_batch *b)
{
    const double *turn = s->photos[b->ray_photo[r]].generator.world_from_cam;
    double n[2][3], mean[3], d[2][3], apart[3], cosine[2];
    for (int k = 0; k < 2; k++)
        for (int a = 0; a < 3; a++) {
            const double in_camera[3] = { normal[3 * k], normal[3 * k + 1], normal[3 * k + 2] };
            n[k][a] = dot(turn + 3 * a, in_camera);
            d[k][a] = (double)b->rays[r + (uint32_t)k].dir[a];
        }
    for (int a = 0; a < 3; a++) {
        mean[a] = n[0][a] + n[1][a];
        apart[a] = d[1][a] - d[0][a];
    }
    const double squared = dot(n[0], n[0]) * dot(n[1], n[1]), length = sqrt(dot(mean, mean));
    if (!(squared > 0) || !(dot(n[0], n[1]) > AGREE * sqrt(squared))) return;
    for (int k = 0; k < 2; k++)
        cosine[k] = -dot(mean, d[k]) / length;
    if (!(cosine[0] > FACING && cosine[1] > FACING)) return;
    const double angle = sqrt(dot(apart, apart)), step = log(cosine[0] / cosine[1]);
    b->plane_log[r] = (float)-step;
    b->plane_log[r + 1] = (float)step;
    b->plane_width[r] = b->plane_width[r + 1] = (float)(angle / (cosine[0] * cosine[1]));
}

cn_status cn_sampler_read_normals(const cn_sampler *s, uint32_t group, const uint16_t *x, const uint16_t *y,
                                  cn_batch *b)
{
    const uint32_t first = group * CN_GROUP;
    memset(b->plane_log + first, 0, CN_GROUP * sizeof *b->plane_log);
    memset(b->plane_width + first, 0, CN_GROUP * sizeof *b->plane_width);
    for (uint32_t i = 1; i < CN_GROUP; i++) {
        const uint32_t r = first + i - 1;
        if (!cn_sampler_is_neighbour(i) || b->ray_photo[r] != b->ray_photo[r + 1]) continue;
        if (!(b->target[4 * (size_t)r + 3] > 0 && b->target[4 * (size_t)r + 7] > 0)) continue;
        const uint32_t store = s->photos[b->ray_photo[r]].store, photo[2] = { store, store };
        float normal[6];
        CN_TRY(cn_pixel_store_gather_normal(s->pixels, 2, photo, x + i - 1, y + i - 1, normal));
        set_plane(s, r, normal, b);
    }
    return CN_OK;
}
