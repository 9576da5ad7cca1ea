/* Training on a device of Vulkan as a whole: it learns as the processor does, gives the same bytes twice, checkpoints
 * go from one to the other, and a device that is lost, or lacks memory for a command, leaves the rest to the processor.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "../unit/field/options.h"
#include "../unit/train/synthetic.h"
#include "base/file.h"
#include "conurb/render.h"
#include "device/vulkan.h"
#include "effect/effect.h"
#include "list.h"
#include "train/reactivation.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define WITHIN_DB 0.2
enum { STEPS = 24, NIGHT_STEPS = 100 };

static synthetic_scene synthetic;
static int stop_flag;
static double stop_at, checkpoint_every_s = 1e9;
static uint32_t steps = STEPS, log2_table = 12;
/* Times that the processor took over a training, an operation, or the rays for want of memory. */
static uint32_t fell_back, left_over, rays_left;

static void report(void *user, const cn_progress_report *r)
{
    (void)user;
    if (stop_at > 0 && r->done >= stop_at) stop_flag = 1;
}

static void note(void *user, cn_log_level level, const char *message)
{
    (void)user;
    if (level <= CN_LOG_WARN) printf("%s\n", message);
    left_over += strstr(message, "the processor does it instead") != NULL;
    rays_left += strstr(message, "the processor draws the rays") != NULL;
    fell_back += strstr(message, "the processor trains tile made from its last checkpoint on") != NULL;
}

static cn_train_options options(void)
{
    cn_train_options o = synthetic_options();
    o.steps = steps;
    field_set(&o.field, "log2_table", log2_table);
    o.samples_per_step = 4096;
    o.precision = CN_PRECISION_FLOAT;
    o.checkpoint_every_s = checkpoint_every_s;
    return o;
}

/* Trains in a folder of this name; a checkpoint there is continued. at: the step to stop at; 0: none. */
static cn_status train(cn_device *device, const char *name, double at, double *psnr)
{
    cn_context ctx = { .device = device, .progress = report, .stop = &stop_flag, .log = note };
    const cn_train_input input = { &synthetic.scene, &synthetic.index, synthetic.pixels, &synthetic.tile };
    const cn_train_options o = options();
    cn_train_result result = { 0 };
    char dir[128];
    snprintf(dir, sizeof dir, "%s/%s", synthetic.folder, name);
    stop_flag = 0;
    stop_at = at;
    assert_int_equal(cn_pool_create(&ctx.pool, 2), CN_OK);
    const cn_status status = cn_train_tile(&ctx, &input, &o, "parent", dir, &result);
    cn_pool_destroy(&ctx.pool);
    *psnr = result.train_psnr;
    return status;
}

static void tile_of(const char *name, char path[160])
{
    snprintf(path, 160, "%s/%s/tile.safetensors", synthetic.folder, name);
}

/* One effect of each kind that a device and the processor share. */
static void set_effects(const char *const *names, uint32_t n)
{
    synthetic.tile.n_effects = 0;
    for (uint32_t i = 0; i < n; i++) {
        cn_plan_effect *e = &synthetic.tile.effects[synthetic.tile.n_effects++];
        memset(e, 0, sizeof *e);
        snprintf(e->name, sizeof e->name, "%s", names[i]);
        e->on = true;
    }
}

static PFN_vkQueueSubmit submit;
static uint32_t submissions;

static VKAPI_ATTR VkResult VKAPI_CALL count(VkQueue queue, uint32_t n, const VkSubmitInfo *info, VkFence fence)
{
    submissions++;
    return submit(queue, n, info, fence);
}

static void test_same_bytes_and_psnr(void **unused)
{
    (void)unused;
    static const char *const effects[] = { "view_dependence", "appearance",     "exposure", "sky",
                                           "transient",       "pose_refinement" };
    cn_device *device;
    char one[160], other[160];
    double processor, psnr;
    set_effects(effects, 6);
    left_over = 0;
    assert_int_equal(train(NULL, "processor", 0, &processor), CN_OK);
    assert_int_equal(cn_device_create(choice[0], &device), CN_OK);
    cn_vulkan *vulkan = (cn_vulkan *)device;
    submit = vulkan->QueueSubmit;
    vulkan->QueueSubmit = count;
    submissions = 0;
    assert_int_equal(train(device, "one", 0, &psnr), CN_OK);
    /* In a step the processor waits for the loss only: a submission up to there, and one for the rest of the step.
     * Those of the photos at the start (their places, each photo's pixels, one camera's directions) and of the tile at
     * the end come on top. */
    const uint32_t photos = synthetic.tile.n_photos + 2;
    printf("%u submissions in %d steps, and %u for the photos\n", submissions - photos, STEPS, photos);
    assert_true(submissions <= photos + 2 * STEPS + 4);
    printf("%s: %.2f dB; the processor: %.2f dB\n", cn_device_about(device)->name, psnr, processor);
    assert_true(fabs(psnr - processor) < WITHIN_DB);
    assert_int_equal(train(device, "other", 0, &psnr), CN_OK);
    tile_of("one", one);
    tile_of("other", other);
    assert_true(same_bytes(one, other));
    assert_int_equal(left_over, 0);
    tile_of("processor", other);
    assert_false(same_bytes(one, other)); /* so the comparison can fail */
    cn_device_destroy(&device);
}

/* Mean opacity of the upper rows, which show the horizon, and of the lower ones, in a held-out view of the tile. */
static void opacities(const char *name, double half[2])
{
    enum { W = 48, H = 36 };
    char path[160];
    cn_tile *tile = NULL;
    cn_picture p;
    cn_appearance row;
    cn_render_options o = cn_render_options_default();
    tile_of(name, path);
    assert_int_equal(cn_tile_open(&tile, path), CN_OK);
    assert_int_equal(cn_tile_appearance(tile, NULL, &row), CN_OK);
    o.appearance = &row;
    assert_int_equal(cn_picture_init(&p, W, H), CN_OK);
    const cn_view *view = &synthetic.scene.views[synthetic.tile.held_out[0]];
    assert_int_equal(cn_render_tile(&(cn_context){ 0 }, tile, &synthetic.scene.cameras[0], view, &o, &p), CN_OK);
    half[0] = half[1] = 0;
    for (size_t i = 0; i < W * H; i++)
        half[i >= W * H / 2] += (double)p.rgba[4 * i + 3] / (W * H / 2);
    cn_picture_deinit(&p);
    cn_tile_close(&tile);
}

/* Black ground becomes matter, and the sky above it does not, as on the processor. */
static void test_black_ground(void **unused)
{
    (void)unused;
    static const char *const effects[] = { "sky", "exposure" };
    const synthetic_scene day = synthetic;
    cn_device *device;
    double psnr, by_processor[2], by_device[2];
    synthetic_night_init(&synthetic, 9);
    set_effects(effects, 2);
    steps = NIGHT_STEPS;
    assert_int_equal(cn_device_create(choice[0], &device), CN_OK);
    assert_int_equal(train(NULL, "processor", 0, &psnr), CN_OK);
    assert_int_equal(train(device, "device", 0, &psnr), CN_OK);
    opacities("processor", by_processor);
    opacities("device", by_device);
    printf("opacity above and below: %.3f, %.3f; the processor: %.3f, %.3f\n", by_device[0], by_device[1],
           by_processor[0], by_processor[1]);
    for (int k = 0; k < 2; k++)
        assert_true(fabs(by_device[k] - by_processor[k]) < 0.005); /* 0.01 where the sky counts as nothing */
    cn_device_destroy(&device);
    synthetic_scene_deinit(&synthetic);
    synthetic = day;
    steps = STEPS;
}

/* Stops on one, and ends on the other. PSNR counts from the resume on, so the processor's own run is stopped too. */
static void test_checkpoints_go_both_ways(void **unused)
{
    (void)unused;
    cn_device *device;
    double whole, psnr;
    set_effects(NULL, 0);
    assert_int_equal(cn_device_create(choice[0], &device), CN_OK);
    assert_int_equal(train(NULL, "stopped", 8, &whole), CN_ERR_INTERRUPTED);
    assert_int_equal(train(NULL, "stopped", 0, &whole), CN_OK);
    assert_int_equal(train(device, "there", 8, &psnr), CN_ERR_INTERRUPTED);
    assert_int_equal(train(NULL, "there", 0, &psnr), CN_OK);
    printf("from the device to the processor: %.2f dB; the processor alone: %.2f dB\n", psnr, whole);
    assert_true(fabs(psnr - whole) < WITHIN_DB);
    assert_int_equal(train(NULL, "back", 8, &psnr), CN_ERR_INTERRUPTED);
    assert_int_equal(train(device, "back", 0, &psnr), CN_OK);
    printf("from the processor to the device: %.2f dB; the processor alone: %.2f dB\n", psnr, whole);
    assert_true(fabs(psnr - whole) < WITHIN_DB);
    cn_device_destroy(&device);
}

typedef enum filling { EMPTY_CELLS, CORNERS, FILLINGS } filling;

static bool fills(filling what, cn_step_at at)
{
    uint32_t part;
    return what == CORNERS ? cn_reactivation_closes(at) : cn_reactivation_refills(at, &part);
}

/* A tile whose cells are all empty but those in the middle, and for corners every second one of these, up to the end of
 * the step after which a part of the empty cells, or all corners, are filled again, and of one more. Samples of both
 * steps; a copy of the bits after the first. */
static void refill_once(cn_device *device, filling what, uint64_t samples[2], uint32_t *bits)
{
    cn_context ctx = { .device = device, .log = note };
    const cn_train_input input = { &synthetic.scene, &synthetic.index, synthetic.pixels, &synthetic.tile };
    cn_train_options o = options();
    cn_trainer *t = calloc(1, sizeof *t);
    assert_non_null(t);
    o.steps = 3000;
    assert_int_equal(cn_pool_create(&ctx.pool, 1), CN_OK);
    synthetic_begin(t, &ctx, &input, &o);
    for (uint32_t c = 0; c < CN_OCC_CELLS; c++) {
        float x[3];
        cn_occupancy_centre(c, x);
        const bool inside = fabsf(x[0]) < 0.1f && fabsf(x[1]) < 0.1f && fabsf(x[2]) < 0.1f;
        const bool full = inside && (what == EMPTY_CELLS || (c + c / CN_OCC_RES) % 2);
        if (t->occ.seen[c] >= 0 && !full) t->occ.seen[c] = 0;
    }
    cn_occupancy_restore(&t->occ);
    while (!fills(what, cn_trainer_at(t)))
        t->step++;
    t->sampler.pace.march_step = (double)t->box.step;
    assert_int_equal(cn_trainer_step(t), CN_OK);
    samples[0] = t->stats.samples;
    assert_int_equal(cn_device_fetch(&ctx, &t->device.step), CN_OK);
    memcpy(bits, t->occ.bits, sizeof *bits * (CN_OCC_CELLS / 32));
    assert_int_equal(cn_trainer_step(t), CN_OK);
    samples[1] = t->stats.samples;
    cn_trainer_deinit(t);
    cn_pool_destroy(&ctx.pool);
    free(t);
}

/* The processor fills cells again; the device goes on with them. */
static void check_filling(filling what)
{
    cn_device *device;
    uint64_t samples[2][2];
    uint32_t *bits = malloc(2 * sizeof *bits * (CN_OCC_CELLS / 32)), different = 0, full = 0;
    assert_non_null(bits);
    set_effects(NULL, 0);
    refill_once(NULL, what, samples[0], bits);
    assert_int_equal(cn_device_create(choice[0], &device), CN_OK);
    refill_once(device, what, samples[1], bits + CN_OCC_CELLS / 32);
    cn_device_destroy(&device);
    for (uint32_t i = 0; i < CN_OCC_CELLS / 32; i++) {
        full += (uint32_t)__builtin_popcount(bits[i]);
        different += (uint32_t)__builtin_popcount(bits[i] ^ bits[CN_OCC_CELLS / 32 + i]);
    }
    printf("%u cells are full, %u are not on both\n", full, different);
    for (int step = 0; step < 2; step++)
        printf("step %d: %llu and %llu samples\n", step, (unsigned long long)samples[0][step],
               (unsigned long long)samples[1][step]);
    assert_true((double)samples[0][1] > (what == CORNERS ? 1.5 : 2) * (double)samples[0][0]); /* so cells were filled */
    assert_true(different <= full / 1000);
    assert_true(fabs((double)samples[1][1] - (double)samples[0][1]) < 0.01 * (double)samples[0][1]);
    free(bits);
}

static void test_cells_are_filled_again(void **unused)
{
    (void)unused;
    for (int what = 0; what < FILLINGS; what++)
        check_filling((filling)what);
}

static int submissions_left;

static VKAPI_ATTR VkResult VKAPI_CALL lose(VkQueue queue, uint32_t n, const VkSubmitInfo *info, VkFence fence)
{
    return submissions_left-- > 0 ? submit(queue, n, info, fence) : VK_ERROR_DEVICE_LOST;
}

static void test_a_lost_device(void **unused)
{
    (void)unused;
    cn_device *device;
    double whole, psnr;
    set_effects(NULL, 0);
    fell_back = 0;
    assert_int_equal(train(NULL, "whole2", 0, &whole), CN_OK);
    assert_int_equal(cn_device_create(choice[0], &device), CN_OK);
    cn_vulkan *vulkan = (cn_vulkan *)device;
    submit = vulkan->QueueSubmit;
    submissions_left = 4; /* while the photos go to the device */
    vulkan->QueueSubmit = lose;
    assert_int_equal(train(device, "early", 0, &psnr), CN_OK);
    assert_int_equal(fell_back, 1);
    assert_true(fabs(psnr - whole) < 1e-6); /* all by the processor */
    fell_back = 0;
    cn_device_destroy(&device);
    assert_int_equal(cn_device_create(choice[0], &device), CN_OK);
    vulkan = (cn_vulkan *)device;
    submissions_left = 24;
    vulkan->QueueSubmit = lose;
    checkpoint_every_s = 0.01;
    assert_int_equal(train(device, "lost", 0, &psnr), CN_OK);
    checkpoint_every_s = 1e9;
    assert_int_equal(fell_back, 1);
    assert_true(psnr > whole - WITHIN_DB); /* it counts from the resume on, when errors are smaller */
    /* The next tile is trained by the processor at once. */
    assert_int_equal(train(device, "after", 0, &psnr), CN_OK);
    cn_device_destroy(&device);
}

static VKAPI_ATTR VkResult VKAPI_CALL refuse(VkQueue queue, uint32_t n, const VkSubmitInfo *info, VkFence fence)
{
    return submissions_left-- > 0 ? submit(queue, n, info, fence) : VK_ERROR_OUT_OF_DEVICE_MEMORY;
}

/* A device without memory for a command is not lost. The processor trains all the same, and measures its own speed. */
static void test_a_device_that_refuses(void **unused)
{
    (void)unused;
    const cn_train_options o = options();
    cn_device *device;
    cn_train_speed *speed;
    double psnr, seconds;
    uint64_t bytes;
    assert_int_equal(cn_device_create(choice[0], &device), CN_OK);
    cn_vulkan *vulkan = (cn_vulkan *)device;
    submit = vulkan->QueueSubmit;
    vulkan->QueueSubmit = refuse;
    for (int after = 0; after <= 24; after += 12) {
        char name[16];
        snprintf(name, sizeof name, "refused%d", after);
        submissions_left = after;
        fell_back = 0;
        assert_int_equal(train(device, name, 0, &psnr), CN_OK);
        assert_int_equal(fell_back, 1);
    }
    const cn_context ctx = { .device = device };
    assert_int_equal(cn_train_speed_create(&speed, NULL), CN_OK);
    assert_int_equal(cn_train_speed_predict(&ctx, speed, &o, &synthetic.tile, &seconds, &bytes), CN_OK);
    assert_true(seconds > 0);
    cn_train_speed_destroy(&speed);
    cn_device_destroy(&device);
}

static PFN_vkCmdDispatch dispatch;
static uint32_t most_groups;

static VKAPI_ATTR void VKAPI_CALL watch(VkCommandBuffer commands, uint32_t x, uint32_t y, uint32_t z)
{
    if (x > most_groups) most_groups = x;
    dispatch(commands, x, y, z);
}

/* No pass has more groups of threads than the device runs. A level of the table may have more entries than their
 * threads, and is trained to the same bytes; where another pass has more, the processor trains. */
static void test_few_groups(void **unused)
{
    (void)unused;
    enum { FEW = 300 };
    char one[160], other[160];
    double psnr;
    cn_device *device;
    log2_table = 17;
    assert_int_equal(cn_device_create(choice[0], &device), CN_OK);
    cn_vulkan *vulkan = (cn_vulkan *)device;
    dispatch = vulkan->CmdDispatch;
    vulkan->CmdDispatch = watch;
    most_groups = 0;
    assert_int_equal(train(device, "many groups", 0, &psnr), CN_OK);
    assert_int_equal(most_groups, (1 << 17) / 256);
    vulkan->properties.limits.maxComputeWorkGroupCount[0] = FEW;
    most_groups = 0;
    assert_int_equal(train(device, "few groups", 0, &psnr), CN_OK);
    assert_in_range(most_groups, 1, FEW);
    tile_of("many groups", one);
    tile_of("few groups", other);
    assert_true(same_bytes(one, other));
    vulkan->properties.limits.maxComputeWorkGroupCount[0] = 4;
    most_groups = fell_back = 0;
    assert_int_equal(train(device, "too few groups", 0, &psnr), CN_OK);
    assert_in_range(most_groups, 0, 4);
    assert_int_equal(fell_back, 1);
    log2_table = 12;
    cn_device_destroy(&device);
}

/* What training takes is known before, to the byte. With one byte less the processor does it, and a line says so. The
 * same of the photos on top: with one byte less the processor draws the rays. */
static void test_too_little_memory(void **unused)
{
    (void)unused;
    const cn_train_options o = options();
    cn_device *device;
    double whole, psnr;
    char one[160], other[160];
    assert_int_equal(cn_device_create(choice[0], &device), CN_OK);
    const cn_train_input input = { &synthetic.scene, &synthetic.index, synthetic.pixels, &synthetic.tile };
    const uint64_t wanted = cn_train_device_bytes(&o, &synthetic.tile), all = device->info.bytes,
                   photos = cn_train_device_photo_bytes(&o, &input);
    assert_in_range(wanted, 1, all);
    assert_in_range(photos, 1, all);
    assert_int_equal(train(NULL, "whole3", 0, &whole), CN_OK);
    tile_of("whole3", one);
    device->info.bytes = wanted - 1;
    assert_int_equal(train(device, "small", 0, &psnr), CN_OK);
    tile_of("small", other);
    assert_true(same_bytes(one, other));
    rays_left = 0;
    device->info.bytes = wanted;
    assert_int_equal(train(device, "enough", 0, &psnr), CN_OK);
    tile_of("enough", other);
    assert_false(same_bytes(one, other));
    device->info.bytes = wanted + photos - 1;
    assert_int_equal(train(device, "no photos", 0, &psnr), CN_OK);
    tile_of("no photos", one);
    assert_true(same_bytes(one, other));
    assert_int_equal(rays_left, 2);
    device->info.bytes = wanted + photos;
    assert_int_equal(train(device, "photos", 0, &psnr), CN_OK);
    assert_int_equal(rays_left, 2);
    assert_true(fabs(psnr - whole) < WITHIN_DB);
    cn_device_destroy(&device);
}

int main(int argc, char **argv)
{
    if (!list_devices(argc, argv)) return 77;
    synthetic_scene_init(&synthetic, 9);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_same_bytes_and_psnr),      cmocka_unit_test(test_black_ground),
        cmocka_unit_test(test_checkpoints_go_both_ways), cmocka_unit_test(test_a_lost_device),
        cmocka_unit_test(test_a_device_that_refuses),    cmocka_unit_test(test_few_groups),
        cmocka_unit_test(test_cells_are_filled_again),   cmocka_unit_test(test_too_little_memory)
    };
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    synthetic_scene_deinit(&synthetic);
    return failed;
}
