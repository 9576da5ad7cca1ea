/* Messages of a page: what is taken, and that everything else is refused. */
#include "view/request.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#define POSE "\"rotation\":[1,0,0,0,0,-1,0,1,0],\"centre\":[1,2,3]"
#define SIZE "\"width\":64,\"height\":48"

static cn_status parse(cn_ask *ask, const char *text)
{
    return cn_ask_parse(ask, text, strlen(text));
}

static void a_view(void **state)
{
    (void)state;
    cn_ask ask;
    assert_int_equal(parse(&ask, "{\"type\":\"view\",\"id\":7,\"slot\":1,\"moving\":true,\"vfov_deg\":90," POSE "," SIZE
                                 ",\"channel\":\"depth\",\"appearance\":\"a.jpg:b.jpg:0.5\",\"blend\":\"ownership\","
                                 "\"exposure_ev\":-1.5,\"name\":\"T\"}"),
                     CN_OK);
    assert_true(ask.kind == CN_ASK_VIEW && ask.id == 7 && ask.slot == 1 && ask.moving);
    assert_true(ask.channel == CN_CHANNEL_DEPTH && ask.exposure_ev == -1.5);
    assert_string_equal(ask.appearance, "a.jpg:b.jpg:0.5");
    assert_string_equal(ask.blend, "ownership");
    assert_string_equal(ask.name, "T");
    assert_true(ask.camera.width == 64 && ask.camera.height == 48 && fabs(ask.camera.params[0] - 24) < 1e-9);
    double centre[3];
    cn_view_centre(&ask.view, centre);
    for (int i = 0; i < 3; i++)
        assert_true(fabs(centre[i] - (i + 1)) < 1e-12);
    cn_ask_deinit(&ask);
}

static void what_makes_no_sense(void **state)
{
    (void)state;
    static const char *const bad[] = {
        "",
        "[]",
        "7",
        "{",
        "{}",
        "{\"type\":\"fly\"}",
        "{\"type\":7}",
        "{\"type\":\"view\"}",
        "{\"type\":\"view\"," POSE "}",                                /* no size */
        "{\"type\":\"view\"," POSE ",\"width\":4096,\"height\":4096}", /* too many pixels */
        "{\"type\":\"view\"," POSE ",\"width\":5000,\"height\":1}",    /* too wide */
        "{\"type\":\"view\"," POSE ",\"width\":-1,\"height\":1}",
        "{\"type\":\"view\"," SIZE ",\"centre\":[0,0,0],\"rotation\":[1,0,0,0,1,0,0,0,0.5]}",
        "{\"type\":\"view\"," SIZE ",\"centre\":[0,0,0],\"rotation\":[1,0,0,0,1,0,0,0,-1]}", /* a mirror */
        "{\"type\":\"view\"," SIZE ",\"centre\":[0,0],\"rotation\":[1,0,0,0,1,0,0,0,1]}",
        "{\"type\":\"view\"," SIZE ",\"centre\":[0,0,1e300],\"rotation\":[1,0,0,0,1,0,0,0,1]}",
        "{\"type\":\"view\"," POSE "," SIZE ",\"vfov_deg\":0}",
        "{\"type\":\"view\"," POSE "," SIZE ",\"vfov_deg\":180}",
        "{\"type\":\"view\"," POSE "," SIZE ",\"slot\":4}",
        "{\"type\":\"view\"," POSE "," SIZE ",\"channel\":\"smell\"}",
        "{\"type\":\"view\"," POSE "," SIZE ",\"exposure_ev\":1e9}",
        "{\"type\":\"view\"," POSE "," SIZE ",\"blend\":7}",
        "{\"type\":\"view\"," POSE "," SIZE ",\"blend\":\"0123456789012345678901234567890123456789\"}",
        "{\"type\":\"view\"," POSE "," SIZE ",\"id\":-1}",
        "{\"type\":\"view\"," POSE "," SIZE ",\"id\":1,\"id\":2}",
        /* A page names no file of this machine. */
        "{\"type\":\"view\"," POSE "," SIZE ",\"appearance\":\"/etc/secret.json\"}",
        "{\"type\":\"view\"," POSE "," SIZE ",\"appearance\":\"fit:/home/me/photo.jpg\"}",
        "{\"type\":\"save\",\"what\":\"path\",\"name\":\"../up\",\"data\":{}}",
        "{\"type\":\"save\",\"what\":\"path\",\"name\":\"\",\"data\":{}}",
        "{\"type\":\"save\",\"what\":\"path\",\"name\":\"a\",\"data\":[]}",
        "{\"type\":\"save\",\"what\":\"house\",\"name\":\"a\",\"data\":{}}",
        "{\"type\":\"load\",\"what\":\"light\",\"name\":\".hidden\"}",
        "{\"type\":\"film\",\"name\":\"a/b\"}",
        "{\"type\":\"film\",\"name\":\"a\",\"width\":100000}",
        "{\"type\":\"film_show\",\"name\":\"a\",\"frame\":-1}",
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        cn_ask ask;
        if (parse(&ask, bad[i]) == CN_OK) fail_msg("taken: %s", bad[i]);
    }
    cn_ask ask;
    assert_int_equal(cn_ask_parse(&ask, "{\"type\":\"city\"}\0{}", 18), CN_ERR_USAGE);
    /* The answer names the request. */
    assert_int_equal(parse(&ask, "{\"type\":\"fly\",\"id\":7}"), CN_ERR_USAGE);
    assert_int_equal(ask.id, 7);
    static char large[CN_ASK_MAX_BYTES + 1];
    memset(large, ' ', sizeof large);
    assert_int_equal(cn_ask_parse(&ask, large, sizeof large), CN_ERR_USAGE);
}

static void a_crop(void **state)
{
    (void)state;
    cn_ask ask;
    assert_int_equal(parse(&ask, "{\"type\":\"view\"," POSE "," SIZE ",\"crop\":[-1,-2,-3,4,5,6]}"), CN_OK);
    assert_true(ask.cropped && ask.crop_m[2] == -3 && ask.crop_m[3] == 4);
    assert_int_equal(parse(&ask, "{\"type\":\"view\"," POSE "," SIZE ",\"crop\":null}"), CN_OK);
    assert_false(ask.cropped);
    assert_int_not_equal(parse(&ask, "{\"type\":\"view\"," POSE "," SIZE ",\"crop\":[1,0,0,0,1,1]}"), CN_OK);
    assert_int_not_equal(parse(&ask, "{\"type\":\"view\"," POSE "," SIZE ",\"crop\":[0,0,0]}"), CN_OK);
}

static void films_and_photos(void **state)
{
    (void)state;
    cn_ask ask;
    assert_int_equal(parse(&ask, "{\"type\":\"film\",\"name\":\"round\",\"width\":64,\"appearance\":\"a.jpg\","
                                 "\"exposure_ev\":1.5,\"display_view\":\"Un-tone-mapped\",\"look\":\"warm\"}"),
                     CN_OK);
    assert_true(ask.kind == CN_ASK_FILM && ask.width == 64 && ask.exposure_ev == 1.5);
    assert_string_equal(ask.display_view, "Un-tone-mapped");
    assert_string_equal(ask.look, "warm");
    assert_int_not_equal(parse(&ask, "{\"type\":\"film\",\"name\":\"round\",\"exposure_ev\":1e9}"), CN_OK);
    assert_int_equal(parse(&ask, "{\"type\":\"film\",\"name\":\"round\",\"blend\":\"ownership\","
                                 "\"crop\":[-1,-2,-3,4,5,6]}"),
                     CN_OK);
    assert_true(ask.cropped && ask.crop_m[5] == 6);
    assert_string_equal(ask.blend, "ownership");
    assert_int_not_equal(parse(&ask, "{\"type\":\"film\",\"name\":\"round\",\"crop\":[0,0,0]}"), CN_OK);
    assert_int_equal(parse(&ask, "{\"type\":\"photo\",\"name\":\"a.jpg\",\"width\":64,\"exposure_ev\":1.5}"), CN_OK);
    assert_true(ask.kind == CN_ASK_PHOTO && ask.exposure_ev == 1.5 && !ask.straight);
    assert_int_equal(parse(&ask, "{\"type\":\"photo\",\"name\":\"a.jpg\",\"straight\":true}"), CN_OK);
    assert_true(ask.straight);
    assert_int_equal(parse(&ask, "{\"type\":\"view\"," POSE "," SIZE ",\"photo\":\"a.jpg\"}"), CN_OK);
    assert_string_equal(ask.photo, "a.jpg");
}

static cn_status upload(cn_ask *ask, const char *head, const char *file, size_t size)
{
    uint8_t message[512];
    const size_t n = strlen(head);
    const uint8_t length[4] = { (uint8_t)n };
    memcpy(message, length, 4);
    memcpy(message + 4, head, n);
    memcpy(message + 4 + n, file, size);
    return cn_ask_parse_upload(ask, message, 4 + n + size);
}

static void a_photo_to_fit(void **state)
{
    (void)state;
    static const char jpeg[] = "\xff\xd8\xff\xe0 and more";
    cn_ask ask;
    assert_int_equal(upload(&ask, "{\"type\":\"fit\",\"id\":5,\"name\":\"dusk\"}", jpeg, sizeof jpeg), CN_OK);
    assert_true(ask.kind == CN_ASK_FIT && ask.id == 5 && ask.n_bytes == sizeof jpeg);
    assert_memory_equal(ask.bytes, jpeg, sizeof jpeg);
    cn_ask_deinit(&ask);
    assert_int_not_equal(upload(&ask, "{\"type\":\"fit\",\"id\":6,\"name\":\"../up\"}", jpeg, sizeof jpeg), CN_OK);
    assert_int_equal(ask.id, 6); /* the answer names the request */
    assert_int_not_equal(upload(&ask, "{\"type\":\"fit\",\"name\":\"dusk\"}", "<html>", 6), CN_OK);
    assert_int_not_equal(upload(&ask, "{\"type\":\"city\"}", jpeg, sizeof jpeg), CN_OK);
    assert_int_not_equal(upload(&ask, "[]", jpeg, sizeof jpeg), CN_OK);
    assert_int_not_equal(parse(&ask, "{\"type\":\"fit\",\"name\":\"dusk\"}"), CN_OK);
    static const uint8_t broken[] = { 0xff, 0xff, 0xff, 0xff, '{' };
    for (size_t n = 0; n <= sizeof broken; n++)
        assert_int_not_equal(cn_ask_parse_upload(&ask, broken, n), CN_OK);
}

static void names(void **state)
{
    (void)state;
    assert_true(cn_ask_name_is_safe("a") && cn_ask_name_is_safe("Evening light_2-b"));
    static const char *const bad[] = {
        "",    " a",  "a ",       ".",   "..",
        "a/b", "a.b", "\xc3\xa4", "a\n", "0123456789012345678901234567890123456789012345678901234567890123456789"
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        assert_false(cn_ask_name_is_safe(bad[i]));
}

static void saving(void **state)
{
    (void)state;
    cn_ask ask;
    assert_int_equal(parse(&ask, "{\"type\":\"save\",\"what\":\"light\",\"name\":\"dusk\",\"data\":{\"a\":1}}"), CN_OK);
    assert_true(ask.kind == CN_ASK_SAVE && ask.is_appearance && json_object_size(ask.data) == 1);
    cn_ask_deinit(&ask);
    assert_int_equal(parse(&ask, "{\"type\":\"list\",\"what\":\"path\"}"), CN_OK);
    assert_true(ask.kind == CN_ASK_LIST && !ask.is_appearance && !ask.data);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(a_view),         cmocka_unit_test(what_makes_no_sense),
                                        cmocka_unit_test(a_crop),         cmocka_unit_test(films_and_photos),
                                        cmocka_unit_test(a_photo_to_fit), cmocka_unit_test(names),
                                        cmocka_unit_test(saving) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
