/* The sky where no photo looked. Training says nothing about the head there, so beside the edge of a photo it may be
 * dark blue or yellow, the more so the longer it was trained. Before a tile is written, the head is therefore trained
 * once more on its own colours: as they are where a photo looked, and elsewhere as they are where photos show sky. */
#include "effect/sky.h"
#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { WEIGHTS = CN_HEAD_WEIGHTS(CN_SKY_IN, CN_SKY_WIDTH, CN_SKY_OUT), STEPS = 2000, COLOURS = 3, TREND = 4 };
/* Of a slope, as a mean square of directions that is added: the sky above one street, 20 degrees high, has 0.03. */
#define SLOPE_COST 0.02
#define FAR_CHORD 0.3 /* of a direction from the nearest sky: beyond it the trend counts more. Not measured apart */
/* Of directions where a photo looked, over the others: there the sky shall stay as it is. With 2000 steps
 * it moves there by 0.02 rms before its activation (sceaux at preview). */
#define KEEP 8
#define RATE 0.003 /* of Adam at the start; a tenth at the end */

typedef struct settle {
    const cn_kernel *kernel;
    const cn_effect_looks *looks;
    double m[WEIGHTS], v[WEIGHTS];
    _Alignas(64) float transposed[WEIGHTS];
    _Alignas(64) float grad[WEIGHTS];
    _Alignas(64) float saved[CN_HEAD_SAVED(CN_SKY_IN, CN_SKY_WIDTH, CN_SKY_OUT) * CN_EFFECT_RAYS];
    float (*colour)[COLOURS]; /* [looks->n] that the head shall draw */
} settle;

/* All directions go in batches; a batch has every n-th of them, and so is spread over the whole sky. */
static uint32_t batches_of(const settle *s)
{
    return (s->looks->n + CN_EFFECT_RAYS - 1) / CN_EFFECT_RAYS;
}

/* Draws a batch; returns how many directions it has. */
static uint32_t draw(settle *s, uint32_t batch, cn_head_acts *acts)
{
    uint32_t n = 0;
    *acts = cn_head_split(&cn_sky_head, s->saved);
    for (uint32_t i = batch; i < s->looks->n; i += batches_of(s))
        cn_sky_see(s->looks->dir[i], acts, n++);
    cn_head_forward(&cn_sky_head, s->kernel, s->transposed, n, acts);
    return n;
}

/* The colours that the head draws now. */
static void read_colours(settle *s)
{
    cn_head_acts acts;
    for (uint32_t batch = 0; batch < batches_of(s); batch++) {
        const uint32_t n = draw(s, batch, &acts);
        for (uint32_t i = 0; i < n; i++)
            for (uint32_t c = 0; c < COLOURS; c++)
                s->colour[batch + i * batches_of(s)][c] = *cn_head_at(acts.out, CN_SKY_OUT, c, i);
    }
}

/* What the sky that photos show is like as a whole: a colour and its slopes, by least squares. Slopes have a cost,
 * because a narrow strip of sky says little about them. False: no photo shows sky. */
static bool find_trend(const settle *s, double trend[TREND][COLOURS])
{
    const cn_effect_looks *looks = s->looks;
    double a[TREND][TREND] = { { 0 } };
    memset(trend, 0, sizeof *trend * TREND);
    for (uint32_t i = 0; i < looks->n; i++) {
        if (looks->look[i] != CN_LOOK_SKY) continue;
        const double x[TREND] = { 1, (double)looks->dir[i][0], (double)looks->dir[i][1], (double)looks->dir[i][2] };
        for (int k = 0; k < TREND; k++) {
            for (int j = 0; j < TREND; j++)
                a[k][j] += x[k] * x[j];
            for (int c = 0; c < COLOURS; c++)
                trend[k][c] += x[k] * (double)s->colour[i][c];
        }
    }
    if (!(a[0][0] > 0)) return false;
    for (int k = 1; k < TREND; k++)
        a[k][k] += SLOPE_COST * a[0][0];
    return cn_solve4(a, trend);
}

static double trend_at(const double trend[TREND][COLOURS], const float dir[3], uint32_t c)
{
    return trend[0][c] + trend[1][c] * (double)dir[0] + trend[2][c] * (double)dir[1] + trend[3][c] * (double)dir[2];
}

/* Where no photo looked: the trend, and what the sky that photos show is beside the trend, with weights that fall with
 * the fourth power of the angle. So it goes on from the edge as it is there, and becomes the trend. False: photos look
 * everywhere. */
static bool go_on(settle *s, const double trend[TREND][COLOURS])
{
    const cn_effect_looks *looks = s->looks;
    bool any = false;
    for (uint32_t i = 0; i < looks->n; i++) {
        if (looks->look[i] != CN_LOOK_NONE) continue;
        any = true;
        double sum[COLOURS] = { 0 }, weights = 1 / pow(FAR_CHORD, 4);
        for (uint32_t k = 0; k < looks->n; k++) {
            if (looks->look[k] != CN_LOOK_SKY) continue;
            double square = 0; /* of the chord: nearly that of the angle where it matters */
            for (int a = 0; a < 3; a++)
                square += (double)(looks->dir[i][a] - looks->dir[k][a]) * (double)(looks->dir[i][a] - looks->dir[k][a]);
            const double weight = 1 / fmax(square * square, 1e-12);
            weights += weight;
            for (uint32_t c = 0; c < COLOURS; c++)
                sum[c] += weight * ((double)s->colour[k][c] - trend_at(trend, looks->dir[k], c));
        }
        for (uint32_t c = 0; c < COLOURS; c++)
            s->colour[i][c] = (float)(trend_at(trend, looks->dir[i], c) + sum[c] / weights);
    }
    return any;
}

static void step(settle *s, uint32_t at, float *shared)
{
    const uint32_t batch = at % batches_of(s);
    cn_head_acts acts;
    const uint32_t n = draw(s, batch, &acts);
    for (uint32_t i = 0; i < n; i++) {
        const uint32_t dir = batch + i * batches_of(s);
        const float weight = s->looks->look[dir] == CN_LOOK_NONE ? 1 : KEEP;
        for (uint32_t c = 0; c < COLOURS; c++)
            *cn_head_at(acts.d_out, CN_SKY_OUT, c, i) =
                weight * (*cn_head_at(acts.out, CN_SKY_OUT, c, i) - s->colour[dir][c]);
        *cn_head_at(acts.d_out, CN_SKY_OUT, CN_SKY_OUT - 1, i) = 0;
    }
    memset(s->grad, 0, sizeof s->grad);
    cn_head_backward(&cn_sky_head, s->kernel, shared, n, &acts, s->grad);
    const double rate = RATE * pow(0.1, (double)at / STEPS) * sqrt(1 - pow(0.99, at)) / (1 - pow(0.9, at));
    for (uint32_t i = 0; i < WEIGHTS; i++) {
        const double g = (double)s->grad[i];
        s->m[i] = 0.9 * s->m[i] + 0.1 * g;
        s->v[i] = 0.99 * s->v[i] + 0.01 * g * g;
        shared[i] -= (float)(rate * s->m[i] / (sqrt(s->v[i]) + 1e-12));
    }
    cn_head_transpose(&cn_sky_head, shared, s->transposed);
}

bool cn_sky_settle(const cn_kernel *kernel, const cn_effect_looks *looks, float *shared)
{
    settle *s = aligned_alloc(64, sizeof *s);
    if (s) memset(s, 0, sizeof *s);
    if (s) s->colour = malloc(sizeof *s->colour * (looks->n + 1u));
    const bool room = s && s->colour;
    double trend[TREND][COLOURS];
    if (room) {
        s->kernel = kernel;
        s->looks = looks;
        cn_head_transpose(&cn_sky_head, shared, s->transposed);
        read_colours(s);
        const bool changes = find_trend(s, trend) && go_on(s, (const double(*)[COLOURS])trend);
        for (uint32_t at = 1; changes && at <= STEPS; at++)
            step(s, at, shared);
    }
    if (s) free(s->colour);
    free(s);
    return room;
}
