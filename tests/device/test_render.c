/* Compares pictures of the demo's tiles by the processor's reference kernels with those of each device of a type.
 * Usage: test_render TYPE */
#include "conurb/render.h"
#include "device/vulkan.h"
#include "list.h"
#include "tile/model.h"

#include <dirent.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <setjmp.h>
#include <cmocka.h>

enum { WIDTH = 67, HEIGHT = 45, PIXELS = WIDTH * HEIGHT, TILES = 3 };

static cn_tile *tiles[TILES];

static int open_tiles(void **unused)
{
    (void)unused;
    DIR *folder = opendir(CN_DEMO_TILE "/tiles");
    struct dirent *entry;
    uint32_t n = 0;
    while (folder && n < TILES && (entry = readdir(folder))) {
        char path[1024];
        if (entry->d_name[0] == '.') continue;
        snprintf(path, sizeof path, "%s/tiles/%s/tile.safetensors", CN_DEMO_TILE, entry->d_name);
        assert_int_equal(cn_tile_open(&tiles[n++], path), CN_OK);
    }
    if (folder) closedir(folder);
    assert_int_equal(n, TILES);
    return 0;
}

static int close_tiles(void **unused)
{
    (void)unused;
    for (int i = 0; i < TILES; i++)
        cn_tile_close(&tiles[i]);
    return 0;
}

/* A camera above one side of the tile, looking down at its centre, or up above the horizon. */
static void look_at(const cn_tile *tile, bool up, cn_camera *camera, cn_view *view)
{
    const double half = tile->box.half_extent[0], down = up ? -0.6 : 0.6, forward = 0.8;
    *camera = (cn_camera){ .lens = CN_LENS_PINHOLE, .width = WIDTH, .height = HEIGHT };
    camera->params[0] = camera->params[1] = WIDTH * 0.8;
    camera->params[2] = WIDTH / 2.0;
    camera->params[3] = HEIGHT / 2.0;
    /* x east, y down the picture, z into it: north and down, or up. */
    const double rotation[9] = { 1, 0, 0, 0, -down, -forward, 0, forward, -down };
    const double centre[3] = { tile->box.centre[0], tile->box.centre[1] - 0.5 * forward * half,
                               tile->box.centre[2] + (up ? 0.1 : 0.5 * down) * half };
    memcpy(view->rotation, rotation, sizeof rotation);
    for (int r = 0; r < 3; r++)
        view->translation[r] =
            -(rotation[3 * r] * centre[0] + rotation[3 * r + 1] * centre[1] + rotation[3 * r + 2] * centre[2]);
}

/* What is rendered: one tile or all, in the light of the mean or of a photo. A crop box cuts through matter: rounding
 * may add a dense sample there, which a bfloat16 kernel's march does. */
typedef struct shot {
    const char *name;
    uint32_t n;
    bool lit, fine, crop, up, present;
    double depth_left;
} shot;
static const shot shots[] = { { .name = "a tile", .n = 1 },
                              { .name = "a tile's surface", .n = 1, .depth_left = 0.5, .lit = true },
                              { .name = "a tile's fine depth", .n = 1, .depth_left = 0.5, .fine = true },
                              { .name = "a union", .n = TILES },
                              { .name = "a union's surface", .n = TILES, .depth_left = 0.5, .lit = true },
                              { .name = "a union's fine depth", .n = TILES, .fine = true, .lit = true },
                              { .name = "a union's median depth", .n = TILES, .depth_left = 0.5, .fine = true },
                              { .name = "a crop of a union", .n = TILES, .crop = true },
                              { .name = "an earlier sky", .n = 1, .up = true, .lit = true },
                              { .name = "a tile's sky", .n = 1, .up = true, .lit = true, .present = true },
                              { .name = "a union's sky", .n = TILES, .up = true, .lit = true, .present = true } };

typedef struct shown {
    cn_picture picture;
    float border[PIXELS];
    uint32_t owner[PIXELS];
    uint64_t samples;
} shown;

/* A device says so when it leaves work to the processor: then nothing would be compared. */
static void no_warning(void *user, cn_log_level level, const char *message)
{
    (void)user;
    if (level >= CN_LOG_WARN) fail_msg("%s", message);
}

/* The tiles stand in a triangle about the middle of their box; the third recedes a little. */
static void place(const shot *of, cn_appearance *row, cn_union_part *part)
{
    static const double at[TILES][2] = { { -0.25, -0.15 }, { 0.02, 0.3 }, { 0.25, -0.15 } };
    for (uint32_t i = 0; i < of->n; i++) {
        const cn_box *box = &tiles[i]->box;
        assert_true(tiles[i]->n_names > 2 * i);
        assert_int_equal(cn_tile_appearance(tiles[i], of->lit ? tiles[i]->names[2 * i] : NULL, &row[i]), CN_OK);
        part[i] = (cn_union_part){ .tile = tiles[i],
                                   .blend_width_m = 0.2 * box->half_extent[0],
                                   .offset_m = i == 2 ? 1 : 0,
                                   .appearance = &row[i] };
        for (int a = 0; a < 3; a++)
            part[i].centre_m[a] = box->centre[a] + (a < 2 ? at[i][a] * box->half_extent[a] : 0);
    }
}

/* The demo's tiles have a sky of an earlier form, which a device leaves to the processor. In the present form their
 * numbers are another sky. */
static void choose_sky(bool present)
{
    extern const cn_effect cn_effect_sky, cn_effect_sky_by_input;
    uint32_t n = 0;
    for (uint32_t t = 0; t < TILES; t++)
        for (uint32_t i = 0; i < tiles[t]->one.n_on; i++) {
            const cn_effect **effect = &tiles[t]->one.on[i].effect;
            if (*effect != &cn_effect_sky && *effect != &cn_effect_sky_by_input) continue;
            *effect = present ? &cn_effect_sky : &cn_effect_sky_by_input;
            n++;
        }
    assert_int_equal(n, TILES);
}

static void render_in(const cn_context *ctx, const shot *of, shown *to)
{
    const double *c = tiles[0]->box.centre, half = tiles[0]->box.half_extent[0];
    const double box[6] = { c[0] - 0.4 * half, c[1] - 0.4 * half, c[2] - half, c[0] + 0.4 * half, c[1] + half, c[2] };
    cn_render_options options = cn_render_options_default();
    cn_appearance row[TILES];
    cn_union_part part[TILES];
    cn_camera camera;
    cn_view view = { 0 };
    place(of, row, part);
    *to = (shown){ .samples = 0 };
    options.samples = &to->samples;
    options.depth_left = of->depth_left;
    options.fine_depth = of->fine;
    options.crop_m = of->crop ? box : NULL;
    options.appearance = &row[0];
    look_at(tiles[0], of->up, &camera, &view);
    assert_int_equal(cn_picture_init(&to->picture, WIDTH, HEIGHT), CN_OK);
    if (of->n == 1)
        assert_int_equal(cn_render_tile(ctx, tiles[0], &camera, &view, &options, &to->picture), CN_OK);
    else
        assert_int_equal(cn_render_union(ctx, &(cn_union){ of->n, part }, &camera, &view, &options,
                                         &(cn_union_output){ &to->picture, to->border, to->owner }),
                         CN_OK);
}

static void render(cn_device *device, const shot *of, shown *to)
{
    if (of->present) choose_sky(true);
    render_in(&(cn_context){ .device = device, .log = no_warning }, of, to);
    if (of->present) choose_sky(false);
}

/* The mean square and the largest of the colours' differences; the largest of the borders'; how many depths differ by
 * more than 1 %, and how many owners. */
typedef struct difference {
    double square, most, border;
    uint32_t depths, owners;
} difference;

static difference differ(const shown *a, const shown *b)
{
    difference d = { 0 };
    for (size_t i = 0; i < 4 * (size_t)PIXELS; i++) {
        const double x = fabs((double)a->picture.rgba[i] - (double)b->picture.rgba[i]);
        d.square += x * x / (4.0 * PIXELS);
        d.most = fmax(d.most, x);
    }
    for (size_t i = 0; i < PIXELS; i++) {
        d.depths += fabsf(a->picture.depth[i] - b->picture.depth[i]) > 0.01f * b->picture.depth[i];
        d.owners += a->owner[i] != b->owner[i];
        d.border = fmax(d.border, fabs((double)a->border[i] - (double)b->border[i]));
    }
    return d;
}

/* The picture is of something: it has light, and of a union every tile owns a part of it and borders are seen; or much
 * of it is sky. */
static void assert_full(const shot *of, const shown *s)
{
    double light = 0;
    uint32_t owned[TILES] = { 0 }, borders = 0, sky = 0;
    for (size_t i = 0; i < 4 * (size_t)PIXELS; i++)
        light += (double)s->picture.rgba[i];
    for (size_t i = 0; i < PIXELS; i++) {
        if (s->owner[i] < TILES) owned[s->owner[i]]++;
        borders += s->border[i] > 0.1f;
        sky += s->picture.depth[i] == 0 && s->picture.rgba[4 * i + 3] > 0.9f && s->picture.rgba[4 * i + 2] > 0.1f;
    }
    assert_true(light > PIXELS * (of->crop ? 0.1 : 0.5));
    assert_true(!of->up || sky > PIXELS / 10);
    for (uint32_t i = 0; i < TILES && of->n == TILES && !of->crop && !of->up; i++)
        assert_true(owned[i] > PIXELS / 20 && borders > PIXELS / 50);
}

/* Kernels of the processor may multiply in bfloat16, whose error is far above float's: the bound is for both. Towards
 * the sky there is haze of many faint samples, and rounding decides which of them lend their colour to the others. */
static void compare(cn_device *device, cn_device *reference, const shot *of)
{
    static shown by_processor, by_device, again;
    render(reference, of, &by_processor);
    render(device, of, &by_device);
    render(device, of, &again);
    const difference d = differ(&by_device, &by_processor);
    printf("%s: %s: PSNR to the reference's picture %.1f dB, worst %.1e; of %d pixels %u depths and %u owners differ, "
           "borders by %.1e; %llu and %llu samples\n",
           cn_device_about(device)->name, of->name, -10 * log10(d.square), d.most, PIXELS, d.depths, d.owners, d.border,
           (unsigned long long)by_device.samples, (unsigned long long)by_processor.samples);
    assert_full(of, &by_processor);
    assert_true(d.square < (of->crop ? 1e-5 : of->up ? 3e-6 : 1e-6));
    assert_true(d.most < (of->crop ? 0.2 : 0.02));
    assert_true(d.depths <= PIXELS / 100);
    assert_true(d.owners <= PIXELS / 100 && d.border < 0.05);
    assert_true(by_device.samples > 0 && by_device.samples == again.samples);
    assert_memory_equal(by_device.picture.rgba, again.picture.rgba, 4 * sizeof(float) * PIXELS);
    assert_memory_equal(by_device.picture.depth, again.picture.depth, sizeof(float) * PIXELS);
    assert_memory_equal(by_device.owner, again.owner, sizeof again.owner);
    cn_picture_deinit(&by_processor.picture);
    cn_picture_deinit(&by_device.picture);
    cn_picture_deinit(&again.picture);
}

static void test_pictures(void **unused)
{
    (void)unused;
    cn_device *reference;
    assert_int_equal(cn_device_create("cpu", &reference), CN_OK);
    reference->kernel = &cn_kernel_ref;
    for (uint32_t d = 0; d < n_choices; d++) {
        cn_device *device;
        assert_int_equal(cn_device_create(choice[d], &device), CN_OK);
        for (size_t i = 0; i < sizeof shots / sizeof *shots; i++)
            compare(device, reference, &shots[i]);
        cn_device_destroy(&device);
    }
    cn_device_destroy(&reference);
}

/* ---- several threads on one device ---- */

typedef struct painter {
    pthread_t thread;
    cn_device *device;
    shown *shown;
} painter;

static void *paint(void *user)
{
    const painter *p = user;
    render(p->device, &shots[3], p->shown);
    return NULL;
}

/* At first none of them finds anything on the device. */
static void test_threads(void **unused)
{
    (void)unused;
    enum { THREADS = 3 };
    static shown pictures[THREADS];
    for (uint32_t d = 0; d < n_choices; d++) {
        painter p[THREADS];
        cn_device *device;
        assert_int_equal(cn_device_create(choice[d], &device), CN_OK);
        for (int i = 0; i < THREADS; i++) {
            p[i] = (painter){ .device = device, .shown = &pictures[i] };
            assert_int_equal(pthread_create(&p[i].thread, NULL, paint, &p[i]), 0);
        }
        for (int i = 0; i < THREADS; i++)
            assert_int_equal(pthread_join(p[i].thread, NULL), 0);
        for (int i = 0; i < THREADS; i++) {
            assert_memory_equal(pictures[i].picture.rgba, pictures[0].picture.rgba, 4 * sizeof(float) * PIXELS);
            assert_int_equal(pictures[i].samples, pictures[0].samples);
        }
        for (int i = 0; i < THREADS; i++)
            cn_picture_deinit(&pictures[i].picture);
        cn_device_destroy(&device);
    }
}

/* ---- what a device cannot do, the processor does, and one line says so ---- */

static uint32_t lines;
static char line[512];

static void keep_line(void *user, cn_log_level level, const char *message)
{
    (void)user;
    if (level < CN_LOG_WARN) return;
    snprintf(line, sizeof line, "%s", message);
    lines++;
}

static PFN_vkQueueSubmit submit;
static int submissions_left;

static VKAPI_ATTR VkResult VKAPI_CALL lose(VkQueue queue, uint32_t n, const VkSubmitInfo *info, VkFence fence)
{
    return submissions_left-- > 0 ? submit(queue, n, info, fence) : VK_ERROR_DEVICE_LOST;
}

/* Twice: the line comes once, and the second picture is the processor's from its beginning. */
static void assert_by_processor(cn_device *device, const char *wanted_line)
{
    static shown by_processor, got;
    const shot *of = &shots[3];
    lines = 0;
    render_in(&(cn_context){ 0 }, of, &by_processor);
    for (int i = 0; i < 2; i++) {
        render_in(&(cn_context){ .device = device, .log = keep_line }, of, &got);
        assert_memory_equal(got.picture.rgba, by_processor.picture.rgba, 4 * sizeof(float) * PIXELS);
        assert_memory_equal(got.picture.depth, by_processor.picture.depth, sizeof(float) * PIXELS);
        assert_memory_equal(got.owner, by_processor.owner, sizeof got.owner);
        assert_int_equal(got.samples, by_processor.samples);
        cn_picture_deinit(&got.picture);
    }
    printf("%s\n", line);
    assert_int_equal(lines, 1);
    assert_non_null(strstr(line, wanted_line));
    assert_non_null(strstr(line, "; the processor does it instead"));
    cn_picture_deinit(&by_processor.picture);
}

static void test_a_lost_device(void **unused)
{
    (void)unused;
    for (uint32_t d = 0; d < n_choices; d++)
        for (int after = 0; after < 30; after += 12) { /* while fields are sent, and among the rounds */
            cn_device *device;
            assert_int_equal(cn_device_create(choice[d], &device), CN_OK);
            if (device->type == &cn_device_vulkan) {
                cn_vulkan *vulkan = (cn_vulkan *)device;
                submit = vulkan->QueueSubmit;
                submissions_left = after;
                vulkan->QueueSubmit = lose;
                assert_by_processor(device, "was lost");
            }
            cn_device_destroy(&device);
        }
}

static void test_too_little_memory(void **unused)
{
    (void)unused;
    for (uint32_t d = 0; d < n_choices; d++) {
        cn_device *device;
        assert_int_equal(cn_device_create(choice[d], &device), CN_OK);
        device->info.bytes = 1 << 20;
        if (device->type == &cn_device_vulkan) assert_by_processor(device, "the tiles and their rays need");
        cn_device_destroy(&device);
    }
}

int main(int argc, char **argv)
{
    if (!list_devices(argc, argv)) return 77;
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_pictures), cmocka_unit_test(test_threads),
                                        cmocka_unit_test(test_a_lost_device),
                                        cmocka_unit_test(test_too_little_memory) };
    return cmocka_run_group_tests(tests, open_tiles, close_tiles);
}
