#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "bridge/ocio.h"

#include <math.h>
#include <string.h>

/* A config that is not Conurb's: a look, and two views of which the second is no default. */
static const char TEXT[] =
    "ocio_profile_version: 2\n"
    "roles: {default: raw, scene_linear: lin}\n"
    "file_rules:\n  - !<Rule> {name: Default, colorspace: default}\n"
    "displays:\n  D:\n    - !<View> {name: Plain, colorspace: lin}\n    - !<View> {name: Half, colorspace: half}\n"
    "looks:\n  - !<Look>\n    name: red\n    process_space: lin\n"
    "    transform: !<MatrixTransform> {matrix: [2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}\n"
    "colorspaces:\n"
    "  - !<ColorSpace> {name: raw, isdata: true}\n"
    "  - !<ColorSpace> {name: lin, aliases: [linear light]}\n"
    "  - !<ColorSpace>\n    name: half\n"
    "    from_scene_reference: !<MatrixTransform> {matrix: [0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 1]}\n";

static void converts_and_leaves_the_fourth_alone(void **state)
{
    (void)state;
    cn_ocio *ocio;
    assert_int_equal(cn_ocio_create(&ocio, NULL, TEXT), CN_OK);
    float p[8] = { 0.2f, 0.4f, 0.6f, 7, 1, 2, 3, -9 };
    assert_int_equal(cn_ocio_convert(ocio, "lin", "half", p, 2, 4), CN_OK);
    const float want[8] = { 0.1f, 0.2f, 0.3f, 7, 0.5f, 1, 1.5f, -9 };
    for (int i = 0; i < 8; i++)
        assert_true(fabsf(p[i] - want[i]) < 1e-6f);
    assert_int_equal(cn_ocio_convert(ocio, "lin", "half", p, 0, 4), CN_OK);
    assert_int_equal(cn_ocio_convert(ocio, "lin", "nowhere", p, 2, 4), CN_ERR_CONFIG);
    assert_non_null(strstr(cn_error_message(), "nowhere"));
    cn_ocio_destroy(&ocio);
    assert_null(ocio);
}

static void views_looks_and_exposure(void **state)
{
    (void)state;
    cn_ocio *ocio;
    assert_int_equal(cn_ocio_create(&ocio, NULL, TEXT), CN_OK);
    const char *const *views = cn_ocio_views(ocio);
    assert_string_equal(views[0], "Plain");
    assert_string_equal(views[1], "Half");
    assert_null(views[2]);
    float p[3] = { 0.1f, 0.1f, 0.1f };
    assert_int_equal(cn_ocio_display(ocio, &(cn_ocio_look){ "lin", "Half", "red", 2 }, p, 1, 3), CN_OK);
    assert_true(fabsf(p[0] - 0.4f) < 1e-6f && fabsf(p[1] - 0.2f) < 1e-6f);
    assert_int_equal(cn_ocio_display(ocio, &(cn_ocio_look){ "lin", "Half", "no such look", 0 }, p, 1, 3),
                     CN_ERR_CONFIG);
    assert_non_null(strstr(cn_error_message(), "no such look"));
    cn_ocio_destroy(&ocio);
}

static void the_first_known_space_is_found(void **state)
{
    (void)state;
    cn_ocio *ocio;
    assert_int_equal(cn_ocio_create(&ocio, NULL, TEXT), CN_OK);
    const char *const names[] = { "ACEScg", "linear light", "raw", NULL }, *const roles[] = { "scene_linear", NULL };
    const char *const none[] = { "ACEScg", NULL };
    assert_string_equal(cn_ocio_first_space(ocio, names), "linear light");
    assert_string_equal(cn_ocio_first_space(ocio, roles), "scene_linear");
    assert_null(cn_ocio_first_space(ocio, none));
    cn_ocio_destroy(&ocio);
}

static void bad_configs_are_named(void **state)
{
    (void)state;
    cn_ocio *ocio;
    assert_int_equal(cn_ocio_create(&ocio, "/no/such/config.ocio", NULL), CN_ERR_CONFIG);
    assert_non_null(strstr(cn_error_message(), "/no/such/config.ocio"));
    cn_ocio_destroy(&ocio);
    assert_int_equal(cn_ocio_create(&ocio, NULL, "ocio_profile_version: 2\nroles: ["), CN_ERR_CONFIG);
    cn_ocio_destroy(&ocio);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(converts_and_leaves_the_fourth_alone),
        cmocka_unit_test(views_looks_and_exposure),
        cmocka_unit_test(the_first_known_space_is_found),
        cmocka_unit_test(bad_configs_are_named),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
