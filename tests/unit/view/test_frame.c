/* Channels as pictures, and a picture as a message. */
#include "image/image.h"
#include "view/frame.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

enum { W = 16, H = 12 };

/* A wall to the north, 5 m away, of which the camera looks north; the left column is empty. */
static void set_up(cn_picture *p, cn_ask *ask)
{
    assert_int_equal(cn_picture_init(p, W, H), CN_OK);
    *ask = (cn_ask){
        .camera = { .lens = CN_LENS_PINHOLE, .width = W, .height = H, .params = { 10, 10, W / 2.0, H / 2.0 } },
        .view = { .rotation = { 1, 0, 0, 0, 0, -1, 0, 1, 0 } }
    };
    for (int y = 0; y < H; y++)
        for (int x = 1; x < W; x++) {
            const double u = (x + 0.5 - W / 2.0) / 10, v = (y + 0.5 - H / 2.0) / 10;
            p->depth[y * W + x] = (float)(5 * sqrt(u * u + v * v + 1));
            p->rgba[4 * (y * W + x) + 3] = 1;
        }
}

static void normals_occlusion_and_coverage(void **state)
{
    (void)state;
    cn_picture p;
    cn_ask ask;
    cn_aovs aovs;
    float rgb[3 * W * H];
    double range[2] = { 0, 0 };
    set_up(&p, &ask);
    assert_int_equal(cn_aovs_init(&aovs, W, H, CN_AOV_NORMAL | CN_AOV_AMBIENT_OCCLUSION | CN_AOV_COVERAGE), CN_OK);
    float *normal = aovs.values[1], *open = aovs.values[3], *photos = aovs.values[4];
    for (int i = 0; i < W * H; i++) {
        normal[3 * i + 1] = i % W ? -1 : 0;
        open[i] = i % W ? 0.25f : 1;
        photos[i] = (float)(i % W);
    }
    const cn_render_result result = { .pass = CN_PASS_FULL, .picture = &p, .aovs = &aovs };
    cn_frame_channel(CN_CHANNEL_NORMAL, &result, rgb, range);
    assert_true(rgb[0] == 0 && rgb[1] == 0 && rgb[2] == 0);
    assert_true(rgb[3] == 0.5f && rgb[4] == 0 && rgb[5] == 0.5f);
    cn_frame_channel(CN_CHANNEL_OCCLUSION, &result, rgb, range);
    assert_true(rgb[0] == 0 && rgb[3] == 0.25f && range[1] == 0);
    cn_frame_channel(CN_CHANNEL_COVERAGE, &result, rgb, range);
    assert_true(range[0] == 0 && range[1] == 16);
    assert_true(rgb[0] == 0 && rgb[3 * (W - 1)] > rgb[3]);
    cn_aovs_deinit(&aovs);
    cn_picture_deinit(&p);
}

static void depth_opacity_and_tiles(void **state)
{
    (void)state;
    cn_picture p;
    cn_ask ask;
    float rgb[3 * W * H], one[3], two[3];
    double range[2];
    uint32_t owners[W * H];
    set_up(&p, &ask);
    for (int i = 0; i < W * H; i++)
        owners[i] = i % W == 0 ? UINT32_MAX : i % W < W / 2 ? 0 : 1;
    const cn_render_result result = { .pass = CN_PASS_FULL, .picture = &p, .owners = owners };
    cn_frame_channel(CN_CHANNEL_DEPTH, &result, rgb, range);
    assert_true(range[0] == 4 && range[1] == 8);
    assert_true(rgb[0] == 0 && rgb[3] > 0);
    cn_frame_channel(CN_CHANNEL_OPACITY, &result, rgb, range);
    assert_true(rgb[0] == 0 && rgb[3] == 1);
    cn_frame_channel(CN_CHANNEL_TILES, &result, rgb, range);
    cn_frame_tile_colour(0, one);
    cn_frame_tile_colour(1, two);
    assert_true(rgb[0] == 0);
    for (int c = 0; c < 3; c++) {
        assert_true(fabsf(rgb[3 + c] - 0.35f * one[c]) < 1e-5f);
        assert_true(fabsf(rgb[3 * (W - 1) + c] - 0.35f * two[c]) < 1e-5f);
    }
    cn_picture_deinit(&p);
}

static void a_message_can_be_taken_apart(void **state)
{
    (void)state;
    cn_picture p;
    cn_ask ask;
    cn_out *out;
    set_up(&p, &ask);
    ask.id = 9;
    ask.channel = CN_CHANNEL_DEPTH;
    const cn_render_result result = { .pass = CN_PASS_HALF, .picture = &p, .tile = "T" };
    assert_int_equal(cn_frame_make(&ask, &result, 0.5, &out), CN_OK);
    const uint8_t *at = out->bytes + CN_OUT_ROOM;
    const size_t n = at[0] | (size_t)at[1] << 8 | (size_t)at[2] << 16 | (size_t)at[3] << 24;
    json_t *head = json_loadb((const char *)at + 4, n, 0, NULL);
    assert_non_null(head);
    const size_t jpeg = (size_t)json_integer_value(json_object_get(head, "jpeg"));
    assert_int_equal(json_integer_value(json_object_get(head, "id")), 9);
    assert_false(json_is_true(json_object_get(head, "last")));
    assert_int_equal(out->size, 4 + n + jpeg + 2 * W * H);
    assert_true(at[4 + n] == 0xff && at[4 + n + 1] == 0xd8);
    const uint8_t *depth = at + 4 + n + jpeg;
    assert_true(cn_half_to_float((uint16_t)(depth[0] | depth[1] << 8)) == 0);
    assert_true(fabsf(cn_half_to_float((uint16_t)(depth[2] | depth[3] << 8)) - p.depth[1]) < 0.01f);
    json_decref(head);
    cn_out_destroy(out);
    cn_picture_deinit(&p);
}

/* Halves are too coarse to measure with: they are 3 cm apart at 50 m. */
static void a_probe_is_exact(void **state)
{
    (void)state;
    cn_picture p;
    cn_ask ask;
    cn_out *out;
    set_up(&p, &ask);
    ask.slot = CN_ASK_SLOT_PROBE;
    float *middle = &p.depth[H / 2 * W + W / 2];
    *middle = 50.0123f;
    for (int there = 1; there >= 0; there--) {
        p.rgba[4 * (H / 2 * W + W / 2) + 3] = (float)there;
        const cn_render_result result = { .pass = CN_PASS_FULL, .picture = &p };
        assert_int_equal(cn_frame_make(&ask, &result, 0.5, &out), CN_OK);
        const uint8_t *at = out->bytes + CN_OUT_ROOM;
        json_t *head = json_loadb((const char *)at + 4, at[0] | (size_t)at[1] << 8, 0, NULL);
        assert_true(fabs(json_real_value(json_object_get(head, "metres")) - (there ? *middle : 0)) < 1e-6);
        json_decref(head);
        cn_out_destroy(out);
    }
    cn_picture_deinit(&p);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(normals_occlusion_and_coverage),
                                        cmocka_unit_test(depth_opacity_and_tiles),
                                        cmocka_unit_test(a_message_can_be_taken_apart),
                                        cmocka_unit_test(a_probe_is_exact) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
