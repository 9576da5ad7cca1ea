/* Compares a picture of the demo's tile by the processor's reference kernels with that of each device of a type.
 * Usage: test_render TYPE */
#include "conurb/render.h"
#include "list.h"
#include "tile/model.h"

#include <dirent.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <setjmp.h>
#include <cmocka.h>

enum { WIDTH = 67, HEIGHT = 45 };

/* The first tile of the demo. */
static cn_tile *open_tile(void)
{
    char path[1024] = "";
    DIR *folder = opendir(CN_DEMO_TILE "/tiles");
    struct dirent *entry;
    while (folder && !*path && (entry = readdir(folder)))
        if (entry->d_name[0] != '.')
            snprintf(path, sizeof path, "%s/tiles/%s/tile.safetensors", CN_DEMO_TILE, entry->d_name);
    if (folder) closedir(folder);
    cn_tile *tile;
    assert_int_equal(cn_tile_open(&tile, path), CN_OK);
    return tile;
}

/* A camera above one side of the tile, looking down at its centre. */
static void look_at(const cn_tile *tile, cn_camera *camera, cn_view *view)
{
    const double half = tile->box.half_extent[0], down = 0.6, forward = 0.8;
    *camera = (cn_camera){ .lens = CN_LENS_PINHOLE, .width = WIDTH, .height = HEIGHT };
    camera->params[0] = camera->params[1] = WIDTH * 0.8;
    camera->params[2] = WIDTH / 2.0;
    camera->params[3] = HEIGHT / 2.0;
    /* x east, y down the picture, z into it: north and down. */
    const double rotation[9] = { 1, 0, 0, 0, -down, -forward, 0, forward, -down };
    const double centre[3] = { tile->box.centre[0], tile->box.centre[1] - 0.5 * forward * half,
                               tile->box.centre[2] + 0.5 * down * half };
    memcpy(view->rotation, rotation, sizeof rotation);
    for (int r = 0; r < 3; r++)
        view->translation[r] =
            -(rotation[3 * r] * centre[0] + rotation[3 * r + 1] * centre[1] + rotation[3 * r + 2] * centre[2]);
}

static void render(cn_device *device, const cn_tile *tile, double depth_left, cn_picture *picture, uint64_t *samples)
{
    const cn_context ctx = { .device = device };
    cn_render_options options = cn_render_options_default();
    cn_camera camera;
    cn_view view = { 0 };
    *samples = 0;
    options.samples = samples;
    options.depth_left = depth_left;
    look_at(tile, &camera, &view);
    assert_int_equal(cn_picture_init(picture, WIDTH, HEIGHT), CN_OK);
    assert_int_equal(cn_render_tile(&ctx, tile, &camera, &view, &options, picture), CN_OK);
}

/* Of pixels: the mean square of the colours' differences, and how many depths differ by more than 1 %. */
static double differ(const cn_picture *a, const cn_picture *b, uint32_t *depths)
{
    double sum = 0;
    *depths = 0;
    for (size_t i = 0; i < 4 * (size_t)WIDTH * HEIGHT; i++)
        sum += pow(a->rgba[i] - b->rgba[i], 2);
    for (size_t i = 0; i < (size_t)WIDTH * HEIGHT; i++)
        *depths += fabsf(a->depth[i] - b->depth[i]) > 0.01f * b->depth[i];
    return sum / (4.0 * WIDTH * HEIGHT);
}

/* Kernels of the processor may multiply in bfloat16, whose error is far above float's: the bound is for both. */
static void test_picture(void **unused)
{
    (void)unused;
    cn_tile *tile = open_tile();
    cn_device *reference;
    assert_int_equal(cn_device_create("cpu", &reference), CN_OK);
    reference->kernel = &cn_kernel_ref;
    for (uint32_t d = 0; d < n_choices; d++)
        for (int surface = 0; surface < 2; surface++) {
            cn_device *device;
            cn_picture by_processor, by_device, again;
            uint64_t samples[3];
            uint32_t depths;
            assert_int_equal(cn_device_create(choice[d], &device), CN_OK);
            render(reference, tile, surface * 0.5, &by_processor, &samples[0]);
            render(device, tile, surface * 0.5, &by_device, &samples[1]);
            render(device, tile, surface * 0.5, &again, &samples[2]);
            const double error = differ(&by_device, &by_processor, &depths);
            printf("%s: PSNR to the reference's picture %.1f dB, %u of %d depths differ; %llu and %llu samples\n",
                   cn_device_about(device)->name, -10 * log10(error), depths, WIDTH * HEIGHT,
                   (unsigned long long)samples[1], (unsigned long long)samples[0]);
            double light = 0;
            for (size_t i = 0; i < 4 * (size_t)WIDTH * HEIGHT; i++)
                light += by_processor.rgba[i];
            assert_true(light > WIDTH * HEIGHT * 0.5);
            assert_true(error < 1e-6);
            assert_true(depths <= WIDTH * HEIGHT / 100);
            assert_true(samples[1] > 0 && samples[1] == samples[2]);
            assert_memory_equal(by_device.rgba, again.rgba, 4 * sizeof(float) * WIDTH * HEIGHT);
            cn_picture_deinit(&by_processor);
            cn_picture_deinit(&by_device);
            cn_picture_deinit(&again);
            cn_device_destroy(&device);
        }
    cn_device_destroy(&reference);
    cn_tile_close(&tile);
}

int main(int argc, char **argv)
{
    if (!list_devices(argc, argv)) return 77;
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_picture) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
