/* No shader reads or writes beyond the end of a buffer, in training with every effect and in rendering. Each buffer of
 * the device gets a guard behind its end, which the shaders can reach. Nothing may change a guard, and what it contains
 * may change no result: zeros or ones give the same bytes. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "../unit/train/synthetic.h"
#include "conurb/render.h"
#include "device/vulkan.h"
#include "effect/effect.h"
#include "list.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { GUARD = 4096, MOST = 4096, SHORT = 64 };

typedef struct guarded {
    VkBuffer buffer;
    VkDeviceSize end; /* where its guard begins */
} guarded;

static struct {
    cn_vulkan *device, plain; /* plain: the functions of the driver */
    cn_device_stream stream;
    guarded list[MOST];
    uint32_t n, checked, changed;
    VkDeviceSize shorter; /* how much earlier the guards begin: then they have to change */
    uint32_t fill;
    bool own; /* buffers that the test itself makes have no guard */
} at;

static guarded *find(VkBuffer buffer)
{
    for (uint32_t i = 0; i < at.n; i++)
        if (at.list[i].buffer == buffer) return &at.list[i];
    return NULL;
}

static VKAPI_ATTR VkResult VKAPI_CALL create(VkDevice device, const VkBufferCreateInfo *info,
                                             const VkAllocationCallbacks *memory, VkBuffer *buffer)
{
    VkBufferCreateInfo larger = *info;
    const VkDeviceSize end = (info->size + 3) / 4 * 4;
    if (at.own) return at.plain.CreateBuffer(device, info, memory, buffer);
    larger.size = end + GUARD;
    const VkResult result = at.plain.CreateBuffer(device, &larger, memory, buffer);
    assert_true(at.n < MOST);
    at.list[at.n++] = (guarded){ *buffer, end > 2 * at.shorter ? end - at.shorter : end };
    return result;
}

static VKAPI_ATTR VkResult VKAPI_CALL bind(VkDevice device, VkBuffer buffer, VkDeviceMemory memory, VkDeviceSize offset)
{
    const VkResult result = at.plain.BindBufferMemory(device, buffer, memory, offset);
    const guarded *g = find(buffer);
    if (at.own || !g) return result;
    assert_int_equal(cn_device_stream_begin(&at.stream), CN_OK);
    at.plain.CmdFillBuffer(at.stream.commands, buffer, g->end, GUARD, at.fill);
    assert_int_equal(cn_device_stream_finish(&at.stream), CN_OK);
    return result;
}

/* Of a whole buffer: up to its guard. */
static VKAPI_ATTR void VKAPI_CALL fill(VkCommandBuffer commands, VkBuffer buffer, VkDeviceSize offset,
                                       VkDeviceSize size, uint32_t data)
{
    const guarded *g = find(buffer);
    at.plain.CmdFillBuffer(commands, buffer, offset, g && size == VK_WHOLE_SIZE ? g->end - offset : size, data);
}

static void check(const guarded *g)
{
    cn_device_buffer host;
    const VkBufferCopy part = { g->end, 0, GUARD };
    bool changed = false;
    at.own = true;
    assert_int_equal(cn_device_buffer_create(at.device, GUARD, true, &host), CN_OK);
    assert_int_equal(cn_device_stream_begin(&at.stream), CN_OK);
    at.device->CmdCopyBuffer(at.stream.commands, g->buffer, host.handle, 1, &part);
    assert_int_equal(cn_device_stream_finish(&at.stream), CN_OK);
    for (uint32_t i = 0; i < GUARD / 4; i++)
        changed = changed || ((const uint32_t *)host.mapped)[i] != at.fill;
    cn_device_buffer_destroy(at.device, &host);
    at.own = false;
    at.checked++;
    at.changed += changed;
}

static VKAPI_ATTR void VKAPI_CALL destroy(VkDevice device, VkBuffer buffer, const VkAllocationCallbacks *memory)
{
    guarded *g = at.own ? NULL : find(buffer);
    if (g) {
        check(g);
        *g = at.list[--at.n];
    }
    at.plain.DestroyBuffer(device, buffer, memory);
}

static cn_device *open_guarded(const char *name, uint32_t contents, VkDeviceSize shorter)
{
    cn_device *device;
    assert_int_equal(cn_device_create(name, &device), CN_OK);
    memset(&at, 0, sizeof at);
    at.device = (cn_vulkan *)device;
    at.plain = *at.device;
    at.fill = contents;
    at.shorter = shorter;
    assert_int_equal(cn_device_stream_create(at.device, false, &at.stream), CN_OK);
    at.device->CreateBuffer = create;
    at.device->BindBufferMemory = bind;
    at.device->CmdFillBuffer = fill;
    at.device->DestroyBuffer = destroy;
    return device;
}

static void close_guarded(cn_device **device)
{
    /* What the device keeps until it is closed. */
    for (uint32_t i = 0; i < at.n; i++)
        check(&at.list[i]);
    at.n = 0;
    cn_device_stream_destroy(&at.stream);
    cn_device_destroy(device);
}

/* ---- what runs ---- */

static synthetic_scene synthetic;

static void train(const cn_context *ctx, const char *name, char tile[160])
{
    const cn_train_input input = { &synthetic.scene, &synthetic.index, synthetic.pixels, &synthetic.tile };
    cn_train_options o = synthetic_options();
    cn_train_result result;
    char dir[128];
    o.steps = 6;
    o.samples_per_step = 4096;
    snprintf(dir, sizeof dir, "%s/%s", synthetic.folder, name);
    snprintf(tile, 160, "%s/tile.safetensors", dir);
    assert_int_equal(cn_train_tile(ctx, &input, &o, "parent", dir, &result), CN_OK);
}

static void render(const cn_context *ctx, const char *path, cn_picture *picture)
{
    const cn_render_options o = cn_render_options_default();
    const cn_camera *camera = &synthetic.scene.cameras[0];
    cn_tile *tile;
    assert_int_equal(cn_tile_open(&tile, path), CN_OK);
    assert_int_equal(cn_picture_init(picture, camera->width, camera->height), CN_OK);
    assert_int_equal(cn_render_tile(ctx, tile, camera, &synthetic.scene.views[0], &o, picture), CN_OK);
    cn_tile_close(&tile);
}

static void run(const char *name, uint32_t contents, VkDeviceSize shorter, const char *tile, cn_picture *picture)
{
    cn_context ctx = { 0 };
    char path[160];
    assert_int_equal(cn_pool_create(&ctx.pool, 2), CN_OK);
    ctx.device = open_guarded(name, contents, shorter);
    train(&ctx, tile, path);
    const uint32_t of_training = at.checked;
    assert_true(of_training > 20); /* so the device has trained */
    render(&ctx, path, picture);
    close_guarded(&ctx.device);
    assert_true(at.checked > of_training + 10);
    cn_pool_destroy(&ctx.pool);
}

/* The processor may do a part of the step of a tile with transients. */
static void set_effects(bool transient)
{
    synthetic.tile.n_effects = 0;
    for (uint32_t i = 0; i < cn_effect_count; i++) {
        cn_plan_effect *e = &synthetic.tile.effects[synthetic.tile.n_effects++];
        memset(e, 0, sizeof *e);
        snprintf(e->name, sizeof e->name, "%s", cn_effect_list[i]->name);
        e->on = transient || strcmp(e->name, "transient") != 0;
    }
}

static void check_guards(const char *zeros_name, const char *ones_name)
{
    for (uint32_t d = 0; d < n_choices; d++) {
        cn_picture zeros, ones;
        char one[160], other[160];
        run(choice[d], 0, 0, zeros_name, &zeros);
        assert_int_equal(at.changed, 0);
        run(choice[d], UINT32_MAX, 0, ones_name, &ones);
        printf("%s: %u buffers, %u guards changed\n", choice[d], at.checked, at.changed);
        assert_int_equal(at.changed, 0);
        snprintf(one, sizeof one, "%s/%s/tile.safetensors", synthetic.folder, zeros_name);
        snprintf(other, sizeof other, "%s/%s/tile.safetensors", synthetic.folder, ones_name);
        assert_true(same_bytes(one, other));
        assert_memory_equal(zeros.rgba, ones.rgba, 4 * sizeof(float) * zeros.width * zeros.height);
        cn_picture_deinit(&zeros);
        cn_picture_deinit(&ones);
    }
}

static void test_guards(void **unused)
{
    (void)unused;
    set_effects(false);
    check_guards("zeros", "ones");
}

static void test_guards_with_transients(void **unused)
{
    (void)unused;
    set_effects(true);
    check_guards("zeros2", "ones2");
}

/* Where the guards begin before the ends, the same run changes them: so they are seen. */
static void test_that_guards_see(void **unused)
{
    (void)unused;
    cn_picture picture;
    set_effects(false);
    run(choice[0], UINT32_MAX, SHORT, "short", &picture);
    printf("with guards %d bytes before the ends: %u of %u changed\n", SHORT, at.changed, at.checked);
    assert_true(at.changed > 5);
    cn_picture_deinit(&picture);
}

int main(int argc, char **argv)
{
    if (!list_devices(argc, argv)) return 77;
    synthetic_scene_init(&synthetic, 9);
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_guards), cmocka_unit_test(test_guards_with_transients),
                                        cmocka_unit_test(test_that_guards_see) };
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    synthetic_scene_deinit(&synthetic);
    return failed;
}
