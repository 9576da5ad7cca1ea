/* Compares every pass of a Vulkan trace with the scalar reference, on the output of the operation before it. Prints
 * the largest error of each. */
#include "base/rng.h"
#include "device/store.h"
#include "device/tracer.h"
#include "effect/effect.h"
#include "render/partition.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <setjmp.h>
#include <cmocka.h>

enum { RAYS = 150, MAX_ROUND = CN_TRACE_PARTS, SLOTS = RAYS * MAX_ROUND, MAX_ROWS = 256, MAX_COLUMNS = 64 };

typedef struct shape {
    uint32_t levels, density_width, colour_width, columns;
    bool softplus;
} shape;
static const shape shapes[] = { { 3, 16, 16, 0, false }, { 5, 64, 20, 24, true }, { 16, 36, 128, 4, false } };

/* What is marched together: `n` shapes from `first` on; after the last comes the first. Nine need a round of their own
 * size. */
typedef struct union_of {
    uint32_t first, n;
} union_of;
static const union_of unions[] = { { 0, 1 }, { 1, 1 }, { 2, 1 }, { 0, 3 }, { 0, 9 } };

typedef struct setting {
    cn_level level[CN_TRACE_PARTS][CN_MAX_LEVELS];
    cn_trace trace;
    uint32_t round, slots, columns_all, column_at[CN_TRACE_PARTS];
    cn_partition partition;
    cn_device_ray ray[RAYS * CN_TRACE_PARTS];
    cn_device_state state[RAYS], start[RAYS];
    cn_device_sum sum[RAYS * CN_TRACE_PARTS];
    float columns[RAYS * MAX_COLUMNS * CN_TRACE_PARTS];
    cn_device_batch batch;
    struct {
        float t;
        uint32_t part;
    } sample[SLOTS];
    float place[SLOTS][4], colour[SLOTS][4], feature[CN_TRACER_GEO * SLOTS];
    float *encoding, sky[CN_TRACE_PARTS][CN_DEVICE_SKY_WEIGHTS], sky_code[CN_TRACE_PARTS][CN_DEVICE_SKY_CODE];
    uint64_t seed, drawn;
} setting;

extern const cn_effect cn_effect_sky;
static double worst[CN_TRACER_PASSES];
static cn_device_info devices[CN_DEVICE_MAX];
static uint32_t n_devices;

static void differ(cn_tracer_pass op, double got, double wanted)
{
    const double error = fabs(got - wanted) / (1 + fabs(wanted));
    if (!(error <= worst[op])) worst[op] = error;
}

static float draw(setting *s, float low, float high)
{
    return low + (high - low) * cn_rng_float(s->seed, 7, s->drawn++);
}

static void make_field(setting *s, uint32_t p)
{
    const shape *of = &shapes[(s->seed + p) % (sizeof shapes / sizeof *shapes)];
    cn_device_field *f = &s->trace.part[p].field;
    *f = (cn_device_field){ .level = s->level[p],
                            .levels = of->levels,
                            .enc_rows = (2 * of->levels + 3) / 4 * 4,
                            .density_width = of->density_width,
                            .colour_width = of->colour_width,
                            .columns = of->columns,
                            .softplus = of->softplus };
    for (uint32_t l = 0; l < f->levels; l++) {
        cn_level *level = &s->level[p][l];
        *level = (cn_level){ .resolution = 4 << (l < 8 ? l : 8), .offset = (uint32_t)f->entries, .hashed = l > 1 };
        const uint32_t side = level->resolution + 2;
        level->entries = level->hashed ? 1u << 12 : side * side * side;
        f->entries += level->entries;
    }
    const uint32_t d = f->density_width, c = f->colour_width;
    f->n_weights = (size_t)d * (f->enc_rows + CN_TRACER_GEO) + (size_t)c * (CN_TRACER_GEO + f->columns + c + 4);
    uint32_t *table = malloc(f->entries * sizeof *table), *occupancy = malloc(CN_OCC_CELLS / 8);
    float *weights = malloc(f->n_weights * sizeof *weights);
    for (size_t i = 0; i < f->entries; i++)
        table[i] = (uint32_t)cn_bf16_from_float(draw(s, -1, 1)) << 16 | cn_bf16_from_float(draw(s, -1, 1));
    for (size_t i = 0; i < f->n_weights; i++)
        weights[i] = draw(s, -0.3f, 0.3f);
    const uint32_t dense = s->trace.n_parts > 1 ? UINT32_MAX : 0; /* so that parts meet */
    for (size_t i = 0; i < CN_OCC_CELLS / 32; i++)
        occupancy[i] =
            (uint32_t)cn_rng_u64(s->seed, 8 + 2 * p, i) & (dense | (uint32_t)cn_rng_u64(s->seed, 9 + 2 * p, i));
    f->table = table;
    f->weights = weights;
    f->occupancy = occupancy;
}

/* Centres stand about the rays' origin, near enough for shares of several parts. */
static void make_part(setting *s, uint32_t p)
{
    cn_device_part *part = &s->trace.part[p];
    make_field(s, p);
    part->inv_extent = draw(s, 0.03f, 0.07f);
    part->x = draw(s, -3, 3);
    part->y = draw(s, -3, 3);
    part->blend_width = draw(s, 2, 4);
    part->offset = draw(s, 0, 1);
    s->partition.tile[p] = (cn_partition_tile){ part->x, part->y, part->blend_width, part->offset };
    for (uint32_t i = 0; i < CN_DEVICE_SKY_WEIGHTS; i++)
        s->sky[p][i] = draw(s, -0.3f, 0.3f);
    for (uint32_t i = 0; i < CN_DEVICE_SKY_CODE; i++)
        s->sky_code[p][i] = draw(s, -1, 1);
    if (p != 1) part->sky = (cn_device_sky){ s->sky[p], s->sky_code[p] };
    s->column_at[p] = s->columns_all;
    s->columns_all += part->field.columns;
}

static void make_rays(setting *s)
{
    const uint32_t parts = s->trace.n_parts;
    for (uint32_t i = 0; i < RAYS; i++) {
        for (uint32_t p = 0; p < parts; p++) {
            cn_device_ray *ray = &s->ray[i * parts + p];
            for (int a = 0; a < 3; a++) {
                ray->origin[a] = draw(s, -1, 1);
                ray->dir[a] = draw(s, -0.05f, 0.05f);
            }
            ray->begin = draw(s, 0.2f, 0.5f);
            ray->end = i % 50 ? draw(s, 100, 200) : 0;
        }
        s->start[i] = (cn_device_state){ .transmittance = 1, .at = 0.3f, .end = i % 50 ? 200 : 0 };
        float *dir = s->start[i].dir;
        for (int a = 0; a < 3; a++)
            dir[a] = draw(s, -0.5f, 0.5f) + (a == 2 ? 0.3f : 0);
        const float length = sqrtf(dir[0] * dir[0] + dir[1] * dir[1] + dir[2] * dir[2]);
        for (int a = 0; a < 3; a++)
            dir[a] /= length;
    }
    for (uint32_t i = 0; i < RAYS * s->columns_all; i++)
        s->columns[i] = draw(s, -1, 1);
    memcpy(s->state, s->start, sizeof s->state);
    s->batch = (cn_device_batch){ RAYS, s->ray, s->columns, s->state, s->sum };
}

static setting *make(uint32_t which)
{
    setting *s = calloc(1, sizeof *s);
    assert_non_null(s);
    s->seed = unions[which].first;
    s->trace = (cn_trace){ .n_parts = unions[which].n, .march = { 1.02f, 0.02f, 1e-3f, 0.5f, 5e-4f, which % 2, true } };
    if (s->trace.n_parts > 1) s->trace.march.min_weight = 1e-4f; /* each part has less of it */
    s->partition.n = unions[which].n;
    for (uint32_t p = 0; p < unions[which].n; p++)
        make_part(s, p);
    s->round = cn_tracer_round(&s->trace);
    s->slots = RAYS * s->round;
    s->encoding = calloc((size_t)SLOTS * 2 * 16, sizeof *s->encoding);
    make_rays(s);
    return s;
}

static void destroy(setting *s)
{
    for (uint32_t p = 0; p < s->trace.n_parts; p++) {
        free((void *)s->trace.part[p].field.table);
        free((void *)s->trace.part[p].field.weights);
        free((void *)s->trace.part[p].field.occupancy);
    }
    free(s->encoding);
    free(s);
}

/* Whether slot has a sample; its ray and its part. */
static bool has_sample(const setting *s, uint32_t slot, uint32_t *ray, const cn_device_part **part)
{
    *ray = slot / s->round;
    if (slot % s->round >= s->state[*ray].count) return false;
    assert_true(s->sample[slot].part < s->trace.n_parts);
    *part = &s->trace.part[s->sample[slot].part];
    return true;
}

/* y = W x by the scalar reference. */
static void layer(const float *weights, uint32_t out, uint32_t in, const float *x, float *y, bool relu)
{
    static float panel_x[MAX_ROWS * CN_PANEL], panel_y[MAX_ROWS * CN_PANEL];
    for (uint32_t i = 0; i < in; i++)
        panel_x[i * CN_PANEL] = x[i];
    cn_kernel_ref.gemm((cn_matrix){ weights, out, in }, panel_x, panel_y, NULL, relu);
    for (uint32_t i = 0; i < out; i++)
        y[i] = panel_y[i * CN_PANEL];
}

#define READ(buffer, to, size) assert_int_equal(cn_tracer_read(tracer, buffer, to, size), CN_OK)
#define RUN(op, phase) assert_int_equal(cn_tracer_run_pass(tracer, op, phase), CN_OK)

/* The samples of a round as the reference's kernels and the partition have them. */
typedef struct round {
    float t[MAX_ROUND], place[MAX_ROUND][3], length[MAX_ROUND];
    uint32_t part[MAX_ROUND], n;
} round_samples;

/* What stands at t, after the samples that there are; false where it has no room. */
static bool add_group(const setting *s, uint32_t i, float t, round_samples *to)
{
    const cn_device_state *start = &s->start[i];
    const uint32_t before = to->n;
    float share[CN_UNION_MAX];
    cn_partition_shares(&s->partition, t * start->dir[0], t * start->dir[1], share);
    for (uint32_t p = 0; p < s->trace.n_parts; p++) {
        const cn_device_ray *r = &s->ray[i * s->trace.n_parts + p];
        const cn_march here = { t, t * 1.001f, s->trace.march.ratio, 0 };
        float found, pos[3 * CN_PANEL], length;
        cn_box_ray ray;
        memcpy(ray.origin, r->origin, sizeof ray.origin);
        memcpy(ray.dir, r->dir, sizeof ray.dir);
        if (t < r->begin || t >= r->end || !(share[p] > 0)) continue;
        if (!cn_kernel_ref.march(&ray, &here, s->trace.part[p].field.occupancy, &found, 1)) continue;
        if (to->n == s->round) {
            to->n = before;
            return false;
        }
        cn_kernel_ref.place(&ray, &t, 1, (cn_spacing){ s->trace.march.step, s->trace.part[p].inv_extent },
                            (cn_lanes){ pos, 0 }, &length);
        to->t[to->n] = t;
        to->part[to->n] = p;
        to->length[to->n] = share[p] * length;
        for (int a = 0; a < 3; a++)
            to->place[to->n][a] = pos[a * CN_PANEL];
        to->n++;
    }
    return true;
}

/* Rounding may move a sample across a cell's border or a share to 0; such rays are counted and not compared. */
static void check_march(setting *s, cn_tracer *tracer)
{
    uint32_t other = 0, samples = 0, shared = 0;
    RUN(CN_PASS_BEGIN, 0);
    RUN(CN_PASS_MARCH, 0);
    if (s->trace.n_parts > 1) RUN(CN_PASS_BEGIN, 1);
    READ(CN_TRACER_STATES, s->state, sizeof s->state);
    READ(CN_TRACER_SAMPLES, s->sample, s->slots * sizeof *s->sample);
    READ(CN_TRACER_PLACES, s->place, s->slots * sizeof *s->place);
    for (uint32_t i = 0; i < RAYS; i++) {
        round_samples wanted = { .n = 0 };
        float t = s->start[i].at;
        for (; t < s->start[i].end && wanted.n < s->round && add_group(s, i, t, &wanted);)
            t *= s->trace.march.ratio;
        const uint32_t first = i * s->round;
        bool same = wanted.n == s->state[i].count && fabsf(s->state[i].at / t - 1) < 1e-4f;
        for (uint32_t j = 0; j < wanted.n && same; j++)
            same =
                fabsf(s->sample[first + j].t / wanted.t[j] - 1) < 1e-4f && s->sample[first + j].part == wanted.part[j];
        other += !same;
        samples += s->state[i].count;
        for (uint32_t j = 0; j < wanted.n && same; j++) {
            for (int a = 0; a < 3; a++)
                differ(CN_PASS_MARCH, s->place[first + j][a], wanted.place[j][a]);
            differ(CN_PASS_MARCH, s->place[first + j][3] / s->trace.march.step, wanted.length[j] / s->trace.march.step);
            shared += j > 0 && wanted.t[j] == wanted.t[j - 1];
        }
    }
    assert_true(samples > RAYS * 4);
    assert_true(other <= RAYS / 100);
    if (s->trace.n_parts > 1) printf("%u of %u samples stand at the t of another part's\n", shared, samples);
    assert_true(s->trace.n_parts == 1 || shared > RAYS / 2);
}

static void check_encode(setting *s, cn_tracer *tracer)
{
    const cn_device_part *part;
    uint32_t ray, levels = 0;
    for (uint32_t p = 0; p < s->trace.n_parts; p++)
        if (s->trace.part[p].field.levels > levels) levels = s->trace.part[p].field.levels;
    RUN(CN_PASS_ENCODE, 0);
    READ(CN_TRACER_ENCODINGS, s->encoding, (size_t)s->slots * 2 * levels * sizeof(float));
    for (uint32_t slot = 0; slot < s->slots; slot++) {
        float pos[3 * CN_PANEL] = { 0 }, out[2 * CN_PANEL];
        if (!has_sample(s, slot, &ray, &part)) continue;
        for (int a = 0; a < 3; a++)
            pos[a * CN_PANEL] = s->place[slot][a];
        for (uint32_t l = 0; l < part->field.levels; l++) {
            const cn_level *level = &part->field.level[l];
            cn_kernel_ref.encode(level, part->field.table + level->offset, pos, 1, out, 2 * CN_PANEL);
            for (uint32_t f = 0; f < 2; f++)
                differ(CN_PASS_ENCODE, s->encoding[(2 * l + f) * s->slots + slot], out[f * CN_PANEL]);
        }
    }
}

static void check_density(setting *s, cn_tracer *tracer)
{
    const cn_device_part *part;
    uint32_t ray;
    RUN(CN_PASS_DENSITY, 0);
    READ(CN_TRACER_FEATURES, s->feature, (size_t)s->slots * CN_TRACER_GEO * sizeof(float));
    for (uint32_t slot = 0; slot < s->slots; slot++) {
        float in[MAX_ROWS] = { 0 }, hidden[MAX_ROWS], geo[CN_TRACER_GEO];
        if (!has_sample(s, slot, &ray, &part)) continue;
        const cn_device_field *f = &part->field;
        for (uint32_t r = 0; r < 2 * f->levels; r++)
            in[r] = s->encoding[r * s->slots + slot];
        layer(f->weights, f->density_width, f->enc_rows, in, hidden, true);
        layer(f->weights + (size_t)f->density_width * f->enc_rows, CN_TRACER_GEO, f->density_width, hidden, geo, false);
        for (uint32_t r = 0; r < CN_TRACER_GEO; r++)
            differ(CN_PASS_DENSITY, s->feature[r * s->slots + slot], geo[r]);
    }
}

static float optical_depth(const setting *s, uint32_t slot)
{
    const float x = fminf(s->feature[slot], 15), length = s->place[slot][3];
    if (!s->trace.part[s->sample[slot].part].field.softplus) return expf(x) * length;
    return (x > 0 ? x + log1pf(expf(-x)) : log1pf(expf(x))) * length;
}

static float mean_in_step(double tau)
{
    return (float)(tau > 1e-3 ? 1 / tau - 1 / expm1(fmin(tau, 60)) - 0.5 : -tau / 12);
}

/* to: the ray's state; sum: what it shows of each part; weight: of each sample that gets a colour. False where rounding
 * decides which sample gets one. */
static bool composite(const setting *s, uint32_t i, cn_device_state *to, cn_device_sum *sum, float *weight)
{
    const cn_device_march *m = &s->trace.march;
    bool sure = true;
    for (uint32_t k = 0, n; k < to->count && to->transmittance > m->min_transmittance; k += n) {
        const uint32_t slot = i * s->round + k;
        float tau = optical_depth(s, slot), t = s->sample[slot].t;
        for (n = 1; k + n < to->count && s->sample[slot + n].t == t; n++)
            tau += optical_depth(s, slot + n);
        const float before = to->transmittance, after = before * expf(-tau);
        if (m->fine_depth) t *= 1 + m->step * mean_in_step((double)tau);
        if (after <= m->depth_left && before > m->depth_left) to->surface = t;
        to->transmittance = after;
        to->depth += (before - after) * t;
        for (uint32_t j = 0; j < n; j++) {
            cn_device_sum *of_part = &sum[s->sample[slot + j].part];
            const float mine = (before - after) * optical_depth(s, slot + j) / tau;
            of_part->weight += mine;
            of_part->carried += mine;
            sure = sure && fabsf(of_part->carried / m->min_weight - 1) > 2e-3f;
            if (!(of_part->carried > m->min_weight)) continue;
            weight[k + j] = of_part->carried;
            of_part->carried = 0;
        }
    }
    return sure;
}

static void check_composite(setting *s, cn_tracer *tracer)
{
    static cn_device_state after[RAYS];
    static cn_device_sum sums[RAYS * CN_TRACE_PARTS];
    const uint32_t parts = s->trace.n_parts;
    uint32_t unsure = 0;
    RUN(CN_PASS_COMPOSITE, 0);
    READ(CN_TRACER_STATES, after, sizeof after);
    READ(CN_TRACER_SUMS, sums, (size_t)RAYS * parts * sizeof *sums);
    READ(CN_TRACER_COLOURS, s->colour, s->slots * sizeof *s->colour);
    for (uint32_t i = 0; i < RAYS; i++) {
        float weight[MAX_ROUND] = { 0 };
        cn_device_state *wanted = &s->state[i];
        cn_device_sum sum[CN_TRACE_PARTS] = { 0 };
        const bool sure = composite(s, i, wanted, sum, weight);
        unsure += !sure;
        differ(CN_PASS_COMPOSITE, after[i].transmittance, wanted->transmittance);
        differ(CN_PASS_COMPOSITE, after[i].depth, wanted->depth);
        differ(CN_PASS_COMPOSITE, after[i].surface, wanted->surface);
        for (uint32_t p = 0; p < parts; p++)
            differ(CN_PASS_COMPOSITE, sums[i * parts + p].weight, sum[p].weight);
        for (uint32_t k = 0; k < wanted->count && sure; k++)
            differ(CN_PASS_COMPOSITE, s->colour[i * s->round + k][3], weight[k]);
    }
    assert_true(unsure < RAYS / 10);
}

static void check_colour(setting *s, cn_tracer *tracer)
{
    const cn_device_part *part;
    uint32_t shown = 0, ray;
    RUN(CN_PASS_BEGIN, 2);
    RUN(CN_PASS_COLOUR, 0);
    READ(CN_TRACER_COLOURS, s->colour, s->slots * sizeof *s->colour);
    for (uint32_t slot = 0; slot < s->slots; slot++) {
        float in[MAX_ROWS], c0[MAX_ROWS], c1[MAX_ROWS], out[4];
        if (!has_sample(s, slot, &ray, &part) || s->colour[slot][3] == 0) continue;
        const cn_device_field *f = &part->field;
        const uint32_t width = f->colour_width, rows = CN_TRACER_GEO + f->columns;
        const float *weights = f->weights + (size_t)f->density_width * (f->enc_rows + CN_TRACER_GEO);
        shown++;
        for (uint32_t r = 0; r < CN_TRACER_GEO; r++)
            in[r] = s->feature[r * s->slots + slot];
        for (uint32_t c = 0; c < f->columns; c++)
            in[CN_TRACER_GEO + c] = s->columns[ray * s->columns_all + s->column_at[s->sample[slot].part] + c];
        layer(weights, width, rows, in, c0, true);
        layer(weights + (size_t)width * rows, width, width, c0, c1, true);
        layer(weights + (size_t)width * (rows + width), 4, width, c1, out, false);
        for (int c = 0; c < 3; c++)
            differ(CN_PASS_COLOUR, s->colour[slot][c] / s->colour[slot][3], out[c] < 0 ? expf(out[c]) : 1 + out[c]);
    }
    assert_true(shown > 100);
}

static void check_gather(setting *s, cn_tracer *tracer)
{
    static cn_device_state after[RAYS];
    static cn_device_sum sums[RAYS * CN_TRACE_PARTS];
    const uint32_t parts = s->trace.n_parts;
    uint32_t header[CN_TRACER_HEADER], on_their_way = 0;
    RUN(CN_PASS_GATHER, 0);
    READ(CN_TRACER_STATES, after, sizeof after);
    READ(CN_TRACER_SUMS, sums, (size_t)RAYS * parts * sizeof *sums);
    READ(CN_TRACER_GOING, header, sizeof header);
    for (uint32_t i = 0; i < RAYS; i++) {
        float rgb[CN_TRACE_PARTS][3] = { { 0 } };
        for (uint32_t k = 0; k < after[i].count; k++)
            for (int c = 0; c < 3; c++)
                rgb[s->sample[i * s->round + k].part][c] += s->colour[i * s->round + k][c];
        for (uint32_t p = 0; p < parts; p++)
            for (int c = 0; c < 3; c++)
                differ(CN_PASS_GATHER, sums[i * parts + p].rgb[c], rgb[p][c]);
        on_their_way += after[i].at < after[i].end && after[i].transmittance > s->trace.march.min_transmittance;
    }
    assert_int_equal(header[1], on_their_way);
    worst[CN_PASS_BEGIN] = fmax(worst[CN_PASS_BEGIN], header[0] != RAYS);
}

/* What the effect itself adds behind each ray, in the proportion of the shares where the ray ends. */
static void check_sky(setting *s, cn_tracer *tracer)
{
    static cn_device_sum before[RAYS * CN_TRACE_PARTS], sums[RAYS * CN_TRACE_PARTS];
    static float saved[CN_EFFECT_RAYS * 1024];
    const uint32_t parts = s->trace.n_parts, first_row = 0;
    uint32_t seen = 0;
    assert_true(cn_effect_sky.saved <= 1024);
    READ(CN_TRACER_SUMS, before, (size_t)RAYS * parts * sizeof *before);
    READ(CN_TRACER_STATES, s->state, sizeof s->state);
    RUN(CN_PASS_SKY, 0);
    READ(CN_TRACER_SUMS, sums, (size_t)RAYS * parts * sizeof *sums);
    for (uint32_t i = 0; i < RAYS; i++) {
        const cn_device_state *ray = &s->state[i];
        float share[CN_UNION_MAX];
        cn_partition_shares(&s->partition, ray->end * ray->dir[0], ray->end * ray->dir[1], share);
        for (uint32_t p = 0; p < parts; p++) {
            const cn_effect_rays rays = { 1, ray->dir, NULL, &first_row, NULL };
            const cn_effect_data data = { &cn_kernel_ref, NULL, s->sky_code[p], NULL, s->sky[p] };
            const float left = s->trace.part[p].sky.weights ? ray->transmittance * share[p] : 0;
            float rgb[3];
            memcpy(rgb, before[i * parts + p].rgb, sizeof rgb);
            cn_effect_sky.background(&rays, &data, &left, rgb, saved);
            seen += left > 0.1f && rgb[1] > before[i * parts + p].rgb[1] + 0.1f;
            for (int c = 0; c < 3; c++)
                differ(CN_PASS_SKY, (double)sums[i * parts + p].rgb[c], (double)rgb[c]);
        }
    }
    assert_true(seen > RAYS / 3);
}

/* The same batch twice gives the same bytes. */
static void check_twice(setting *s, cn_tracer *tracer)
{
    static cn_device_state once[RAYS];
    static cn_device_sum sums[RAYS * CN_TRACE_PARTS];
    uint64_t samples[2] = { 0, 0 };
    for (int i = 0; i < 2; i++) {
        memcpy(s->state, s->start, sizeof s->state);
        memset(s->sum, 0, sizeof s->sum);
        assert_int_equal(cn_tracer_run(tracer, NULL, &s->trace.march, &s->batch, &samples[i]), CN_OK);
        if (i == 0) memcpy(once, s->state, sizeof once);
        if (i == 0) memcpy(sums, s->sum, sizeof sums);
    }
    assert_memory_equal(once, s->state, sizeof once);
    assert_memory_equal(sums, s->sum, sizeof sums);
    assert_int_equal(samples[0], samples[1]);
    for (uint32_t i = 0; i < RAYS; i++)
        assert_true(s->state[i].transmittance <= s->trace.march.min_transmittance || s->state[i].at >= s->state[i].end);
}

static void test_operations(void **unused)
{
    (void)unused;
    for (uint32_t d = 0; d < n_devices; d++) {
        char choice[16];
        cn_device *device;
        if (!devices[d].fit) continue;
        snprintf(choice, sizeof choice, "gpu:%u", d);
        assert_int_equal(cn_device_create(choice, &device), CN_OK);
        memset(worst, 0, sizeof worst);
        for (uint32_t i = 0; i < sizeof unions / sizeof *unions; i++) {
            setting *s = make(i);
            cn_tracer *tracer;
            assert_int_equal(cn_tracer_create((cn_vulkan *)device, &s->trace, RAYS, &tracer), CN_OK);
            assert_int_equal(cn_tracer_send(tracer, &s->trace.march, &s->batch), CN_OK);
            check_march(s, tracer);
            check_encode(s, tracer);
            check_density(s, tracer);
            check_composite(s, tracer);
            check_colour(s, tracer);
            check_gather(s, tracer);
            check_sky(s, tracer);
            check_twice(s, tracer);
            cn_tracer_destroy(&tracer);
            destroy(s);
        }
        for (int op = 0; op < CN_TRACER_PASSES; op++) {
            printf("%s: %-10s worst error %.2e\n", devices[d].name, cn_tracer_pass_name[op], worst[op]);
            assert_true(worst[op] < 2e-5);
        }
        cn_device_destroy(&device);
    }
}

/* A field with a serial is sent once, and leaves when its memory is needed and nobody uses it. One without is nobody
 * else's. */
static void test_store(void **unused)
{
    (void)unused;
    for (uint32_t d = 0; d < n_devices; d++) {
        char choice[16];
        cn_device *device;
        cn_device_stream stream;
        cn_stored_field *once, *again, *other;
        if (!devices[d].fit) continue;
        snprintf(choice, sizeof choice, "gpu:%u", d);
        assert_int_equal(cn_device_create(choice, &device), CN_OK);
        cn_vulkan *vulkan = (cn_vulkan *)device;
        setting *s = make(0);
        cn_device_field *field = &s->trace.part[0].field;
        assert_false(cn_tracer_store_trim(vulkan));
        assert_int_equal(cn_device_stream_create(vulkan, true, &stream), CN_OK);
        assert_int_equal(cn_tracer_store_field(&stream, field, &once), CN_OK);
        assert_int_equal(cn_tracer_store_field(&stream, field, &again), CN_OK);
        assert_ptr_not_equal(once, again);
        cn_tracer_store_give_back(vulkan, &once);
        cn_tracer_store_give_back(vulkan, &again);
        assert_false(cn_tracer_store_trim(vulkan));
        for (field->serial = 1; field->serial < 3; field->serial++) {
            assert_int_equal(cn_tracer_store_field(&stream, field, &once), CN_OK);
            assert_int_equal(cn_tracer_store_field(&stream, field, &again), CN_OK);
            assert_ptr_equal(once, again);
            other = again;
            cn_tracer_store_give_back(vulkan, &again);
            assert_int_equal(cn_tracer_store_trim(vulkan), field->serial > 1); /* 1 is idle when 2 is in use */
            cn_tracer_store_give_back(vulkan, &once);
            assert_int_equal(cn_tracer_store_field(&stream, field, &once), CN_OK);
            assert_ptr_equal(once, other);
            cn_tracer_store_give_back(vulkan, &once);
        }
        assert_true(cn_tracer_store_trim(vulkan) && !cn_tracer_store_trim(vulkan));
        cn_device_stream_destroy(&stream);
        destroy(s);
        cn_device_destroy(&device);
    }
}

/* Invalid choices of a device, and their messages. */
static void test_choices(void **unused)
{
    (void)unused;
    static const char *const wrong[] = { "gpu:", "gpu:x", "gpu:1x", "gpu:-1", "tpu", "cpu:0", "gpus" };
    cn_device *device;
    for (int i = 0; i < 3; i++) {
        static const char *const processor[] = { "cpu", "", NULL };
        assert_int_equal(cn_device_create(processor[i], &device), CN_OK);
        assert_string_equal(device->type->name, "cpu");
        cn_device_destroy(&device);
        assert_null(device);
    }
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++)
        assert_int_equal(cn_device_create(wrong[i], &device), CN_ERR_USAGE);
    assert_int_equal(cn_device_create("gpu:99", &device), CN_ERR_TOOL);
    bool real = false;
    for (uint32_t d = 0; d < n_devices; d++)
        real = real || (devices[d].fit && !devices[d].software);
    assert_int_equal(cn_device_create("gpu", &device), real ? CN_OK : CN_ERR_TOOL);
    cn_device_destroy(&device);
}

int main(void)
{
    if (cn_device_list(devices, &n_devices) != CN_OK) {
        printf("skipped: %s\n", cn_error_message());
        return 77;
    }
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_operations), cmocka_unit_test(test_store),
                                        cmocka_unit_test(test_choices) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
