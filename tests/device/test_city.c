/* Compares what a renderer of the demo's city makes with the processor's reference kernels and with each device of a
 * type: pictures of the queue, blended in both ways and in several lights, and every channel beside them.
 * Usage: test_city TYPE */
#include "list.h"
#include "renderer/renderer.h"

#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <setjmp.h>
#include <cmocka.h>

enum { WIDTH = 40, HEIGHT = 30, PIXELS = WIDTH * HEIGHT, ALL = (1 << CN_AOV_COUNT) - 1 };

static cn_city *city;

/* What is asked for: a photo's view, by its number. */
typedef struct order {
    const char *name, *blend, *appearance;
    uint32_t view;
    unsigned aovs;
} order;
static const order orders[] = {
    { "tiles blended by distance, with channels", "distance_2d", "mean", 0, CN_AOV_NORMAL | CN_AOV_AMBIENT_OCCLUSION },
    { "tiles that own places, with channels", "ownership", "run0-clear_street_0006.jpg", 5, ALL },
    { "tiles that own places, a mix of lights", "ownership",
      "run0-clear_street_0006.jpg:run3-night_street_0010.jpg:0.5", 20, CN_AOV_DEPTH },
    { "the nearest tile, at night", "nearest", "run3-night_street_0010.jpg", 12, CN_AOV_NORMAL },
};

/* How much two values of a channel may differ in a pixel that counts as the same. */
static const double alike[CN_AOV_COUNT] = { 0.01 /* of the depth */, 0.05, 0.01, 0.02, 0 };

/* A device says so when it leaves work to the processor: then nothing would be compared. */
static void no_fallback(void *user, cn_log_level level, const char *message)
{
    (void)user;
    if (level >= CN_LOG_WARN && strstr(message, "the processor does it instead")) {
        printf("%s\n", message);
        abort(); /* on the renderer's thread */
    }
}

typedef struct shown {
    cn_renderer *renderer;
    cn_render_job *job;
    cn_render_result result;
} shown;

static shown render(const cn_context *ctx, const order *o)
{
    shown s;
    cn_render_request q = { .blend = o->blend,
                            .appearance = o->appearance,
                            .owners = true,
                            .aovs = o->aovs,
                            .draft = true,
                            .passes = CN_PASS_FULL | CN_PASS_QUARTER,
                            .encoding = CN_ENCODING_PNG };
    assert_int_equal(cn_renderer_create(&s.renderer, ctx, city, true), CN_OK);
    const cn_scene *scene = &s.renderer->dataset->scene;
    assert_true(o->view < scene->n_views);
    q.view = scene->views[o->view];
    cn_camera_resize(&scene->cameras[q.view.camera], WIDTH, HEIGHT, &q.camera);
    assert_int_equal(cn_renderer_submit(s.renderer, &q, &s.job), CN_OK);
    if (cn_renderer_wait(s.job, NULL, &s.result) != CN_OK) fail_msg("%s", cn_error_message());
    return s;
}

static void discard(shown *s)
{
    cn_renderer_release(&s->job);
    cn_renderer_destroy(&s->renderer);
}

static double squares(const cn_picture *a, const cn_picture *b)
{
    double sum = 0;
    for (size_t i = 0; i < 4 * (size_t)PIXELS; i++)
        sum += pow((double)a->rgba[i] - (double)b->rgba[i], 2) / (4.0 * PIXELS);
    return sum;
}

static void compare_channel(const char *device, unsigned which, const cn_aovs *got, const cn_aovs *wanted)
{
    const size_t channels = cn_aov_channels(which);
    const float *a = got->values[which], *b = wanted->values[which];
    double sum = 0;
    uint32_t other = 0, filled = 0;
    for (size_t i = 0; i < PIXELS; i++) {
        double error = 0;
        for (size_t c = 0; c < channels; c++)
            error = fmax(error, fabs((double)a[i * channels + c] - (double)b[i * channels + c]));
        if (which == 0 && b[i] > 0) error /= (double)b[i];
        sum += error / PIXELS;
        other += error > alike[which];
        filled += b[i * channels] != 0;
    }
    printf("%s:   %-17s mean error %.1e, %u of %d pixels differ by more than %g\n", device, cn_aov_name(which), sum,
           other, PIXELS, alike[which]);
    assert_true(filled > PIXELS / 4);
    assert_true(other <= PIXELS / 100);
}

/* The same order gives the same bytes, whatever the device keeps. */
static void repeat(const cn_context *ctx, const order *o, const shown *got)
{
    shown again = render(ctx, o);
    assert_int_equal(again.result.encoded_size, got->result.encoded_size);
    assert_memory_equal(again.result.encoded, got->result.encoded, got->result.encoded_size);
    for (unsigned i = 0; i < CN_AOV_COUNT; i++)
        if (o->aovs >> i & 1)
            assert_memory_equal(again.result.aovs->values[i], got->result.aovs->values[i],
                                PIXELS * cn_aov_channels(i) * sizeof(float));
    discard(&again);
}

static void compare(cn_device *device, const order *o, shown *wanted, cn_pool *pool)
{
    const char *name = cn_device_about(device)->name;
    const cn_context ctx = { .device = device, .pool = pool, .log = no_fallback };
    shown got = render(&ctx, o);
    const double square = squares(got.result.picture, wanted->result.picture);
    uint32_t owners = 0, depths = 0;
    double light = 0;
    for (size_t i = 0; i < PIXELS; i++) {
        const float a = got.result.picture->depth[i], b = wanted->result.picture->depth[i];
        owners += got.result.owners[i] != wanted->result.owners[i];
        depths += fabsf(a - b) > 0.01f * b;
        light += (double)wanted->result.picture->rgba[4 * i + 1];
    }
    printf("%s: %s: PSNR to the reference's picture %.1f dB; %u depths and %u owners of %d differ\n", name, o->name,
           -10 * log10(square), depths, owners, PIXELS);
    assert_true(light > PIXELS * 0.005);
    assert_true(square < 1e-6);
    assert_true(depths <= PIXELS / 100 && owners <= PIXELS / 100);
    assert_string_equal(got.result.tile, wanted->result.tile);
    for (unsigned i = 0; i < CN_AOV_COUNT; i++)
        if (o->aovs >> i & 1) compare_channel(name, i, got.result.aovs, wanted->result.aovs);
    if (o == orders) repeat(&ctx, o, &got);
    discard(&got);
}

static void test_orders(void **unused)
{
    (void)unused;
    cn_pool *pool;
    cn_device *reference, *device[CN_DEVICE_MAX];
    assert_int_equal(cn_pool_create(&pool, 2), CN_OK);
    assert_int_equal(cn_device_create("cpu", &reference), CN_OK);
    reference->kernel = &cn_kernel_ref;
    for (uint32_t d = 0; d < n_choices; d++)
        assert_int_equal(cn_device_create(choice[d], &device[d]), CN_OK);
    for (size_t i = 0; i < sizeof orders / sizeof *orders; i++) {
        shown wanted = render(&(cn_context){ .device = reference, .pool = pool }, &orders[i]);
        for (uint32_t d = 0; d < n_choices; d++)
            compare(device[d], &orders[i], &wanted, pool);
        discard(&wanted);
    }
    for (uint32_t d = 0; d < n_choices; d++)
        cn_device_destroy(&device[d]);
    cn_device_destroy(&reference);
    cn_pool_destroy(&pool);
}

static int open_city(void **unused)
{
    (void)unused;
    return cn_city_open(&city, CN_DEMO_TILE) == CN_OK ? 0 : -1;
}

static int close_city(void **unused)
{
    (void)unused;
    cn_city_close(&city);
    return 0;
}

int main(int argc, char **argv)
{
    if (!list_devices(argc, argv)) return 77;
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_orders) };
    return cmocka_run_group_tests(tests, open_city, close_city);
}
