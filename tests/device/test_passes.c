/* Compares every pass of a Vulkan trace with the scalar reference, on the output of the operation before it. Prints
 * the largest error of each. */
#include "base/rng.h"
#include "device/tracer.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <setjmp.h>
#include <cmocka.h>

enum { RAYS = 300, SLOTS = RAYS * CN_TRACER_ROUND, MAX_ROWS = 256 };

typedef struct shape {
    uint32_t levels, density_width, colour_width, columns;
    bool softplus;
} shape;
static const shape shapes[] = { { 3, 16, 16, 0, false }, { 5, 64, 20, 24, true }, { 16, 36, 128, 4, false } };

typedef struct setting {
    cn_level level[CN_MAX_LEVELS];
    cn_device_field field;
    cn_device_ray ray[RAYS];
    cn_device_state state[RAYS], start[RAYS];
    float columns[RAYS * 32];
    cn_device_march march;
    cn_device_batch batch;
    float t[SLOTS], place[SLOTS][4], colour[SLOTS][4], feature[CN_TRACER_GEO * SLOTS];
    float *encoding;
    uint64_t seed, drawn;
} setting;

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

static void make_field(setting *s, const shape *of)
{
    cn_device_field *f = &s->field;
    *f = (cn_device_field){ .level = s->level,
                            .levels = of->levels,
                            .enc_rows = (2 * of->levels + 3) / 4 * 4,
                            .density_width = of->density_width,
                            .colour_width = of->colour_width,
                            .columns = of->columns,
                            .softplus = of->softplus };
    for (uint32_t l = 0; l < f->levels; l++) {
        cn_level *level = &s->level[l];
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
    for (size_t i = 0; i < CN_OCC_CELLS / 32; i++)
        occupancy[i] = (uint32_t)cn_rng_u64(s->seed, 8, i) & (uint32_t)cn_rng_u64(s->seed, 9, i);
    f->table = table;
    f->weights = weights;
    f->occupancy = occupancy;
    s->encoding = calloc((size_t)SLOTS * 2 * f->levels, sizeof *s->encoding);
}

static void make_rays(setting *s)
{
    s->march = (cn_device_march){ 1.02f, 0.02f, 0.05f, 1e-3f, 0.5f, 5e-4f };
    for (uint32_t i = 0; i < RAYS; i++) {
        for (int a = 0; a < 3; a++) {
            s->ray[i].origin[a] = draw(s, -1, 1);
            s->ray[i].dir[a] = draw(s, -0.05f, 0.05f);
        }
        s->ray[i].end = i % 50 ? 200 : 0;
        s->start[i] = (cn_device_state){ .transmittance = 1, .at = 0.3f };
    }
    for (uint32_t i = 0; i < RAYS * s->field.columns; i++)
        s->columns[i] = draw(s, -1, 1);
    memcpy(s->state, s->start, sizeof s->state);
    s->batch = (cn_device_batch){ RAYS, s->ray, s->columns, s->state };
}

static setting *make(uint32_t which)
{
    setting *s = calloc(1, sizeof *s);
    s->seed = which;
    make_field(s, &shapes[which]);
    make_rays(s);
    return s;
}

static void destroy(setting *s)
{
    free((void *)s->field.table);
    free((void *)s->field.weights);
    free((void *)s->field.occupancy);
    free(s->encoding);
    free(s);
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

/* Rounding may move a sample across a cell's border; such rays are counted and not compared. */
static void check_march(setting *s, cn_tracer *tracer)
{
    const cn_kernel *k = &cn_kernel_ref;
    uint32_t other = 0, samples = 0;
    RUN(CN_PASS_BEGIN, 0);
    RUN(CN_PASS_MARCH, 0);
    READ(CN_TRACER_STATES, s->state, sizeof s->state);
    READ(CN_TRACER_T, s->t, sizeof s->t);
    READ(CN_TRACER_PLACES, s->place, sizeof s->place);
    for (uint32_t i = 0; i < RAYS; i++) {
        cn_box_ray ray;
        float t[CN_TRACER_ROUND], pos[3 * CN_PANEL], length[CN_TRACER_ROUND];
        memcpy(ray.origin, s->ray[i].origin, sizeof ray.origin);
        memcpy(ray.dir, s->ray[i].dir, sizeof ray.dir);
        const cn_march march = { s->start[i].at, s->ray[i].end, s->march.ratio, 0 };
        const uint32_t n = k->march(&ray, &march, s->field.occupancy, t, CN_TRACER_ROUND);
        k->place(&ray, t, n, (cn_spacing){ s->march.step, s->march.inv_extent }, (cn_lanes){ pos, 0 }, length);
        bool same = n == s->state[i].count;
        for (uint32_t j = 0; j < n && same; j++)
            same = fabsf(s->t[i * CN_TRACER_ROUND + j] / t[j] - 1) < 1e-4f;
        other += !same;
        samples += n;
        for (uint32_t j = 0; j < n && same; j++) {
            const float *place = s->place[i * CN_TRACER_ROUND + j];
            for (int a = 0; a < 3; a++)
                differ(CN_PASS_MARCH, place[a], pos[a * CN_PANEL + j]);
            differ(CN_PASS_MARCH, place[3] / length[j], 1);
        }
    }
    assert_true(samples > RAYS * 4);
    assert_true(other <= RAYS / 100);
}

static void check_encode(setting *s, cn_tracer *tracer)
{
    RUN(CN_PASS_ENCODE, 0);
    READ(CN_TRACER_ENCODINGS, s->encoding, (size_t)SLOTS * 2 * s->field.levels * sizeof(float));
    for (uint32_t slot = 0; slot < SLOTS; slot++) {
        float pos[3 * CN_PANEL] = { 0 }, out[2 * CN_PANEL];
        if (slot % CN_TRACER_ROUND >= s->state[slot / CN_TRACER_ROUND].count) continue;
        for (int a = 0; a < 3; a++)
            pos[a * CN_PANEL] = s->place[slot][a];
        for (uint32_t l = 0; l < s->field.levels; l++) {
            cn_kernel_ref.encode(&s->level[l], s->field.table + s->level[l].offset, pos, 1, out, 2 * CN_PANEL);
            for (uint32_t f = 0; f < 2; f++)
                differ(CN_PASS_ENCODE, s->encoding[(2 * l + f) * SLOTS + slot], out[f * CN_PANEL]);
        }
    }
}

static void check_density(setting *s, cn_tracer *tracer)
{
    const cn_device_field *f = &s->field;
    RUN(CN_PASS_DENSITY, 0);
    READ(CN_TRACER_FEATURES, s->feature, sizeof s->feature);
    for (uint32_t slot = 0; slot < SLOTS; slot++) {
        float in[MAX_ROWS] = { 0 }, hidden[MAX_ROWS], geo[CN_TRACER_GEO];
        if (slot % CN_TRACER_ROUND >= s->state[slot / CN_TRACER_ROUND].count) continue;
        for (uint32_t r = 0; r < 2 * f->levels; r++)
            in[r] = s->encoding[r * SLOTS + slot];
        layer(f->weights, f->density_width, f->enc_rows, in, hidden, true);
        layer(f->weights + (size_t)f->density_width * f->enc_rows, CN_TRACER_GEO, f->density_width, hidden, geo, false);
        for (uint32_t r = 0; r < CN_TRACER_GEO; r++)
            differ(CN_PASS_DENSITY, s->feature[r * SLOTS + slot], geo[r]);
    }
}

static float density(const setting *s, float logit)
{
    const float x = fminf(logit, 15);
    return !s->field.softplus ? expf(x) : x > 0 ? x + log1pf(expf(-x)) : log1pf(expf(x));
}

static void composite(const setting *s, uint32_t i, cn_device_state *to, float *weight)
{
    for (uint32_t k = 0; k < to->count && to->transmittance > s->march.min_transmittance; k++) {
        const uint32_t slot = i * CN_TRACER_ROUND + k;
        const float before = to->transmittance,
                    after = before * expf(-density(s, s->feature[slot]) * s->place[slot][3]);
        if (after <= s->march.depth_left && before > s->march.depth_left) to->surface = s->t[slot];
        to->transmittance = after;
        to->depth += (before - after) * s->t[slot];
        to->weight += before - after;
        to->carried += before - after;
        if (to->carried > s->march.min_weight) {
            weight[k] = to->carried;
            to->carried = 0;
        }
    }
}

static void check_composite(setting *s, cn_tracer *tracer)
{
    static cn_device_state after[RAYS];
    RUN(CN_PASS_COMPOSITE, 0);
    READ(CN_TRACER_STATES, after, sizeof after);
    READ(CN_TRACER_COLOURS, s->colour, sizeof s->colour);
    for (uint32_t i = 0; i < RAYS; i++) {
        float weight[CN_TRACER_ROUND] = { 0 };
        cn_device_state *wanted = &s->state[i];
        composite(s, i, wanted, weight);
        differ(CN_PASS_COMPOSITE, after[i].transmittance, wanted->transmittance);
        differ(CN_PASS_COMPOSITE, after[i].depth, wanted->depth);
        differ(CN_PASS_COMPOSITE, after[i].surface, wanted->surface);
        differ(CN_PASS_COMPOSITE, after[i].weight, wanted->weight);
        for (uint32_t k = 0; k < wanted->count; k++)
            differ(CN_PASS_COMPOSITE, s->colour[i * CN_TRACER_ROUND + k][3], weight[k]);
    }
}

static void check_colour(setting *s, cn_tracer *tracer)
{
    const cn_device_field *f = &s->field;
    const uint32_t width = f->colour_width, rows = CN_TRACER_GEO + f->columns;
    const float *weights = f->weights + (size_t)f->density_width * (f->enc_rows + CN_TRACER_GEO);
    uint32_t shown = 0;
    RUN(CN_PASS_BEGIN, 1);
    RUN(CN_PASS_COLOUR, 0);
    READ(CN_TRACER_COLOURS, s->colour, sizeof s->colour);
    for (uint32_t slot = 0; slot < SLOTS; slot++) {
        const uint32_t ray = slot / CN_TRACER_ROUND;
        float in[MAX_ROWS], c0[MAX_ROWS], c1[MAX_ROWS], out[4];
        if (slot % CN_TRACER_ROUND >= s->state[ray].count || s->colour[slot][3] == 0) continue;
        shown++;
        for (uint32_t r = 0; r < CN_TRACER_GEO; r++)
            in[r] = s->feature[r * SLOTS + slot];
        for (uint32_t c = 0; c < f->columns; c++)
            in[CN_TRACER_GEO + c] = s->columns[ray * f->columns + c];
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
    uint32_t header[CN_TRACER_HEADER], on_their_way = 0;
    RUN(CN_PASS_GATHER, 0);
    READ(CN_TRACER_STATES, after, sizeof after);
    READ(CN_TRACER_GOING, header, sizeof header);
    for (uint32_t i = 0; i < RAYS; i++) {
        for (int c = 0; c < 3; c++) {
            float sum = 0;
            for (uint32_t k = 0; k < after[i].count; k++)
                sum += s->colour[i * CN_TRACER_ROUND + k][c];
            differ(CN_PASS_GATHER, after[i].rgb[c], sum);
        }
        on_their_way += after[i].at < s->ray[i].end && after[i].transmittance > s->march.min_transmittance;
    }
    assert_int_equal(header[1], on_their_way);
    worst[CN_PASS_BEGIN] = fmax(worst[CN_PASS_BEGIN], header[0] != RAYS);
}

/* The same batch twice gives the same bytes. */
static void check_twice(setting *s, cn_tracer *tracer)
{
    static cn_device_state once[RAYS];
    uint64_t samples[2] = { 0, 0 };
    for (int i = 0; i < 2; i++) {
        memcpy(s->state, s->start, sizeof s->state);
        assert_int_equal(cn_tracer_run(tracer, NULL, &s->march, &s->batch, &samples[i]), CN_OK);
        if (i == 0) memcpy(once, s->state, sizeof once);
    }
    assert_memory_equal(once, s->state, sizeof once);
    assert_int_equal(samples[0], samples[1]);
    for (uint32_t i = 0; i < RAYS; i++)
        assert_true(s->state[i].transmittance <= s->march.min_transmittance || s->state[i].at >= s->ray[i].end);
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
        for (uint32_t i = 0; i < sizeof shapes / sizeof *shapes; i++) {
            setting *s = make(i);
            cn_tracer *tracer;
            assert_int_equal(cn_tracer_create((cn_vulkan *)device, &s->field, RAYS, &tracer), CN_OK);
            assert_int_equal(cn_tracer_send(tracer, &s->march, &s->batch), CN_OK);
            check_march(s, tracer);
            check_encode(s, tracer);
            check_density(s, tracer);
            check_composite(s, tracer);
            check_colour(s, tracer);
            check_gather(s, tracer);
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
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_operations), cmocka_unit_test(test_choices) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
