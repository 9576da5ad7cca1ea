/* Sums of pictures with weights that may differ from pixel to pixel. Sums are kept relative to the largest weight so
 * far, as in an online softmax, because distances to a high power do not fit into a float. */
#include "conurb/compose.h"

#include "math/linalg.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define FAR_OFF 100.0 /* a pixel without depth counts as this many times farther than the tile's centre */
#define HEARD 0.2f    /* share of the weight above which the surest pictures alone say how opaque a pixel is */

cn_status cn_compose_sum_init(cn_compose_sum *s, cn_picture *out)
{
    const size_t n = (size_t)out->width * out->height;
    *s = (cn_compose_sum){ .out = out, .log_scale = calloc(8 * n, sizeof(float)) };
    if (!s->log_scale)
        return cn_fail(CN_ERR_NOMEM, "out of memory for a composite of %u x %u pixels", out->width, out->height);
    s->weight = s->log_scale + n;
    s->depth_weight = s->weight + n;
    s->first = s->depth_weight + n;
    s->second = s->first + n;
    s->surest = s->second + n;
    s->sure_weight = s->surest + n;
    s->sure_square = s->sure_weight + n;
    for (size_t i = 0; i < n; i++)
        s->log_scale[i] = -INFINITY;
    memset(out->rgba, 0, n * 4 * sizeof *out->rgba);
    memset(out->depth, 0, n * sizeof *out->depth);
    return CN_OK;
}

void cn_compose_sum_deinit(cn_compose_sum *s)
{
    free(s->log_scale);
    *s = (cn_compose_sum){ 0 };
}

/* A new largest weight: scale the sums down. */
static void rescale(cn_compose_sum *s, size_t i, float log_weight)
{
    const float k = expf(s->log_scale[i] - log_weight);
    for (int c = 0; c < 4; c++)
        s->out->rgba[4 * i + (size_t)c] *= k;
    s->out->depth[i] *= k;
    s->weight[i] *= k;
    s->depth_weight[i] *= k;
    s->first[i] *= k;
    s->second[i] *= k;
    s->sure_weight[i] *= k;
    s->sure_square[i] *= k;
    s->log_scale[i] = log_weight;
}

/* The mean of alpha, each picture weighted by the fourth power of its alpha too: haze in one tile then takes nothing
 * from a sky in another. As a running mean, so that equal alphas give exactly that alpha. */
static void add_alpha(cn_compose_sum *s, size_t i, float w, float alpha)
{
    const float sure = alpha * alpha * alpha * alpha;
    s->sure_weight[i] += w * sure;
    s->sure_square[i] += w * sure * sure;
    if (s->sure_weight[i] > 0) s->surest[i] += w * sure / s->sure_weight[i] * (alpha - s->surest[i]);
}

static void add_pixel(cn_compose_sum *s, const cn_picture *p, size_t i, float log_weight)
{
    if (!(log_weight > -INFINITY)) return;
    if (log_weight > s->log_scale[i]) rescale(s, i, log_weight);
    const float w = log_weight == s->log_scale[i] ? 1 : expf(log_weight - s->log_scale[i]), *from = p->rgba + 4 * i,
                share = w * from[3];
    for (int c = 0; c < 4; c++)
        s->out->rgba[4 * i + (size_t)c] += w * from[c];
    s->weight[i] += w;
    add_alpha(s, i, w, from[3]);
    if (p->depth[i] > 0) {
        s->out->depth[i] += share * p->depth[i];
        s->depth_weight[i] += share;
    }
    if (s->heaviest && share > s->first[i]) s->heaviest[i] = s->n;
    s->second[i] = fmaxf(s->second[i], fminf(s->first[i], share));
    s->first[i] = fmaxf(s->first[i], share);
}

void cn_compose_add(cn_compose_sum *s, const cn_picture *p, double weight)
{
    assert(s->out->width == p->width && s->out->height == p->height);
    const size_t n = (size_t)p->width * p->height;
    const float log_weight = (float)log(weight);
    for (size_t i = 0; i < n; i++)
        add_pixel(s, p, i, log_weight);
    s->n++;
}

typedef struct spread {
    cn_compose_sum *sum;
    const cn_picture *picture;
    const cn_camera *camera;
    double world_from_cam[9], offset[3]; /* camera - centre */
    double log_weight, exponent;
} spread;

static void add_row(void *user, size_t y, unsigned worker)
{
    const spread *a = user;
    (void)worker;
    for (uint32_t x = 0; x < a->picture->width; x++) {
        const size_t i = y * a->picture->width + x;
        const double depth = (double)a->picture->depth[i];
        double in_camera[3], at[3], d = FAR_OFF * (1 + cn_norm3(a->offset));
        if (depth > 0 && cn_camera_unproject(a->camera, x + 0.5, (double)y + 0.5, in_camera) == CN_OK) {
            cn_mat3_vec(a->world_from_cam, in_camera, at);
            for (int k = 0; k < 3; k++)
                at[k] = at[k] * depth + a->offset[k];
            d = cn_norm3(at);
        }
        /* A millimetre from the centre is at the centre. */
        add_pixel(a->sum, a->picture, i, (float)(a->log_weight - a->exponent * log(fmax(d, 1e-3))));
    }
}

void cn_compose_add_3d(const cn_context *ctx, cn_compose_sum *s, const cn_picture *p, const cn_compose_distance *to)
{
    const cn_camera *camera = to->camera;
    assert(s->out->width == p->width && s->out->height == p->height && camera->width == p->width &&
           camera->height == p->height);
    spread a = { .sum = s, .picture = p, .camera = camera, .log_weight = log(to->weight), .exponent = to->exponent };
    cn_mat3_transpose(to->view->rotation, a.world_from_cam);
    cn_view_centre(to->view, a.offset);
    for (int k = 0; k < 3; k++)
        a.offset[k] -= to->centre[k];
    cn_pool_run(ctx ? ctx->pool : NULL, p->height, add_row, &a);
    s->n++;
}

/* The part of the weight that the surest pictures have is the square of a sum over a sum of squares. */
static float alpha_of(const cn_compose_sum *s, size_t i)
{
    const float mean = s->out->rgba[4 * i + 3] / s->weight[i];
    if (!(s->sure_square[i] > 0)) return mean;
    const float part = s->sure_weight[i] / s->sure_square[i] * (s->sure_weight[i] / s->weight[i]);
    return mean + fminf(part / HEARD, 1) * (s->surest[i] - mean);
}

void cn_compose_finish(cn_compose_sum *s, float *border)
{
    const size_t n = (size_t)s->out->width * s->out->height;
    for (size_t i = 0; i < n; i++) {
        float *rgba = s->out->rgba + 4 * i;
        const float shares = rgba[3], alpha = shares > 0 ? alpha_of(s, i) : 0, k = shares > 0 ? alpha / shares : 0;
        if (border) border[i] = shares > 0 ? s->second[i] / shares : 0;
        /* When most of a pixel has no depth (a sky), the result has none. */
        s->out->depth[i] = s->depth_weight[i] > 0.5f * shares ? s->out->depth[i] / s->depth_weight[i] : 0;
        for (int c = 0; c < 3; c++)
            rgba[c] *= k;
        rgba[3] = alpha;
    }
}

void cn_compose_fade(cn_picture *p, double coverage)
{
    p->fade = (float)(1 - coverage);
    for (size_t i = 0; i < 4 * (size_t)p->width * p->height && p->fade > 0; i++)
        p->rgba[i] *= 1 - p->fade;
}
