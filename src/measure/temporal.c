/* Temporal consistency: each frame is compared with the one before, warped by the rendered depth. Pixels show jumps,
 * and blocks show slow changes of light. */
#include "conurb/measure.h"
#include "math/linalg.h"

#include <math.h>

#define SAME_DEPTH 0.02                    /* relative difference of depth up to which two frames show the same place */
#define FAINT 0.002f                       /* texture of the lowest level */
enum { ENOUGH = 200, ENOUGH_BLOCKS = 20 }; /* residuals away from borders that a level's mean needs */

/* A pixel's position in the frame before; false when that frame shows another surface there. */
static bool look_back(const cn_temporal_frame *before, const cn_temporal_frame *after, uint32_t x, uint32_t y,
                      double at[2])
{
    const double depth = (double)after->depth[(size_t)y * after->width + x];
    double in_camera[3], place[3], centre[3], from[3];
    if (!(depth > 0) || cn_camera_unproject(after->camera, x + 0.5, y + 0.5, in_camera) != CN_OK) return false;
    cn_mat3_tvec(after->view->rotation, in_camera, place);
    cn_view_centre(after->view, centre);
    for (int a = 0; a < 3; a++)
        place[a] = centre[a] + depth * place[a];
    cn_mat3_vec(before->view->rotation, place, from);
    for (int a = 0; a < 3; a++)
        from[a] += before->view->translation[a];
    if (!cn_camera_project(before->camera, from, at)) return false;
    at[0] -= 0.5, at[1] -= 0.5;
    if (!(at[0] >= 0 && at[1] >= 0 && at[0] < before->width - 1.0 && at[1] < before->height - 1.0)) return false;
    const size_t nearest = (size_t)(at[1] + 0.5) * before->width + (size_t)(at[0] + 0.5);
    const double distance = cn_norm3(from), shown = (double)before->depth[nearest];
    return shown > 0 && fabs(shown - distance) < SAME_DEPTH * distance;
}

/* The colour minus the colour in the frame before. */
static void difference(const cn_temporal_frame *before, const double at[2], const float rgb[3], float out[3])
{
    const size_t x = (size_t)at[0], y = (size_t)at[1], row = 3 * (size_t)before->width;
    const float u = (float)(at[0] - (double)x), v = (float)(at[1] - (double)y), *p = before->rgb + y * row + 3 * x;
    for (size_t c = 0; c < 3; c++) {
        const float top = p[c] + u * (p[c + 3] - p[c]), bottom = p[row + c] + u * (p[row + c + 3] - p[row + c]);
        out[c] = rgb[c] - (top + v * (bottom - top));
    }
}

/* How strong the texture is around a pixel: the mean change of a channel from pixel to pixel. */
static float texture(const cn_temporal_frame *f, uint32_t x, uint32_t y)
{
    const size_t row = 3 * (size_t)f->width;
    const float *p = f->rgb + y * row + 3 * (size_t)x;
    float sum = 0;
    for (int c = 0; c < 3; c++)
        sum += fabsf(p[c + 3] - p[c - 3]) + fabsf(p[c + (ptrdiff_t)row] - p[c - (ptrdiff_t)row]);
    return sum / 12;
}

static uint32_t texture_level(float strength)
{
    const float level = 2 * log2f(strength / FAINT);
    return level > 0 ? (uint32_t)fminf(level, CN_TEMPORAL_LEVELS - 1) : 0;
}

static void add(cn_temporal_part *part, float residual, float strength)
{
    const uint32_t level = texture_level(strength);
    part->n++;
    part->sum += (double)residual;
    part->count[(size_t)(fminf(residual, 1) * CN_TEMPORAL_STEPS)]++;
    part->level_n[level]++;
    part->level_sum[level] += (double)residual;
}

/* Sums over the pixels of a block. */
typedef struct block {
    float difference[3], texture;
    uint32_t n, n_border;
} block;

/* A frame, the one before it, and whether the tiles that they are of have nothing in common. */
typedef struct frame_step {
    const cn_temporal_frame *before, *after;
    bool switched;
} frame_step;

static void add_pixel(cn_temporal *s, block *b, const frame_step *step, uint32_t x, uint32_t y)
{
    const cn_temporal_frame *before = step->before, *after = step->after;
    const size_t i = (size_t)y * after->width + x;
    float d[3];
    double at[2];
    if (!look_back(before, after, x, y, at)) return;
    const size_t there = (size_t)(at[1] + 0.5) * before->width + (size_t)(at[0] + 0.5);
    const bool border = step->switched || fmaxf(after->border[i], before->border[there]) >= CN_TEMPORAL_SHARE;
    const float strength = texture(after, x, y);
    difference(before, at, after->rgb + 3 * i, d);
    add(border ? &s->border : &s->away, (fabsf(d[0]) + fabsf(d[1]) + fabsf(d[2])) / 3, strength);
    for (int c = 0; c < 3; c++)
        b->difference[c] += d[c];
    b->texture += strength;
    b->n++;
    b->n_border += border;
}

static void add_block(cn_temporal *s, const block *b)
{
    const float sum = fabsf(b->difference[0]) + fabsf(b->difference[1]) + fabsf(b->difference[2]), n = (float)b->n;
    if (2 * b->n < CN_TEMPORAL_BLOCK * CN_TEMPORAL_BLOCK) return;
    add(2 * b->n_border >= b->n ? &s->light_border : &s->light_away, sum / (3 * n), b->texture / n);
}

void cn_measure_temporal(cn_temporal *s, const cn_temporal_frame *before, const cn_temporal_frame *after, bool switched)
{
    const frame_step step = { before, after, switched };
    for (uint32_t y0 = 1; y0 + 1 < after->height; y0 += CN_TEMPORAL_BLOCK)
        for (uint32_t x0 = 1; x0 + 1 < after->width; x0 += CN_TEMPORAL_BLOCK) {
            block b = { 0 };
            for (uint32_t y = y0; y < y0 + CN_TEMPORAL_BLOCK && y + 1 < after->height; y++)
                for (uint32_t x = x0; x < x0 + CN_TEMPORAL_BLOCK && x + 1 < after->width; x++)
                    add_pixel(s, &b, &step, x, y);
            add_block(s, &b);
        }
}

static double mean(const cn_temporal_part *p)
{
    return p->n ? p->sum / (double)p->n : NAN;
}

/* Interpolated within its thousandth, as if residuals were evenly spread there. */
static double median(const cn_temporal_part *p)
{
    const double half = (double)p->n / 2;
    double below = 0;
    for (int i = 0; i <= CN_TEMPORAL_STEPS; i++) {
        const double here = (double)p->count[i];
        if (here > 0 && below + here >= half) return (i + (half - below) / here) / CN_TEMPORAL_STEPS;
        below += here;
    }
    return NAN;
}

static cn_temporal_figure compare(const cn_temporal_part *border, const cn_temporal_part *away, uint64_t enough)
{
    cn_temporal_figure f = { .n_border = border->n,
                             .n_away = away->n,
                             .border_mean = mean(border),
                             .away_mean = mean(away),
                             .border_median = median(border),
                             .away_median = median(away) };
    double have = 0, expected = 0;
    for (int l = 0; l < CN_TEMPORAL_LEVELS; l++) {
        if (away->level_n[l] < enough) continue;
        have += border->level_sum[l];
        expected += away->level_sum[l] / (double)away->level_n[l] * (double)border->level_n[l];
    }
    f.ratio = expected > 0 ? have / expected : NAN;
    return f;
}

cn_temporal_figures cn_measure_temporal_figures(const cn_temporal *s)
{
    return (cn_temporal_figures){ compare(&s->border, &s->away, ENOUGH),
                                  compare(&s->light_border, &s->light_away, ENOUGH_BLOCKS) };
}
