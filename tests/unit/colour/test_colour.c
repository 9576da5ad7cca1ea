#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/file.h"
#include "base/rng.h"
#include "conurb/colour.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static cn_colour *colour;

static int set_up(void **state)
{
    (void)state;
    unsetenv("OCIO");
    return cn_colour_create(&colour, NULL) == CN_OK ? 0 : -1;
}
static int tear_down(void **state)
{
    (void)state;
    cn_colour_destroy(&colour);
    return colour != NULL;
}

static void multiply(const double m[9], const float in[3], double out[3])
{
    for (int r = 0; r < 3; r++) {
        out[r] = 0;
        for (int c = 0; c < 3; c++)
            out[r] += m[3 * r + c] * (double)in[c];
    }
}

static double decode(double x)
{
    return x <= 0.04045 ? x / 12.92 : pow((x + 0.055) / 1.055, 2.4);
}

static void the_matrices_are_inverse(void **state)
{
    (void)state;
    for (int r = 0; r < 3; r++) {
        double row = 0;
        for (int c = 0; c < 3; c++) {
            double x = 0;
            for (int k = 0; k < 3; k++)
                x += cn_srgb_from_acescg[3 * r + k] * cn_acescg_from_srgb[3 * k + c];
            assert_true(fabs(x - (r == c)) < 1e-12);
            row += cn_acescg_from_srgb[3 * r + c];
        }
        assert_true(fabs(row - 1) < 1e-5); /* white stays white */
    }
}

static void the_config_does_what_the_matrices_say(void **state)
{
    (void)state;
    for (uint64_t i = 0; i < 1000; i++) {
        float p[3], encoded[3];
        for (uint64_t c = 0; c < 3; c++)
            p[c] = encoded[c] = cn_rng_float(5, i, c);
        const float linear[3] = { (float)decode((double)p[0]), (float)decode((double)p[1]),
                                  (float)decode((double)p[2]) };
        double want[3];
        multiply(cn_acescg_from_srgb, linear, want);
        assert_int_equal(cn_colour_to_linear(colour, NULL, p, 1, 3), CN_OK);
        for (int c = 0; c < 3; c++)
            assert_true(fabs((double)p[c] - want[c]) < 1e-5);
        memcpy(p, linear, sizeof p);
        assert_int_equal(cn_colour_to_linear(colour, "Linear sRGB", p, 1, 3), CN_OK);
        for (int c = 0; c < 3; c++)
            assert_true(fabs((double)p[c] - want[c]) < 1e-5);
        assert_int_equal(cn_colour_to_display(colour, NULL, p, 1, 3), CN_OK);
        for (int c = 0; c < 3; c++)
            assert_true(fabsf(p[c] - encoded[c]) < 2e-5f);
    }
}

static void acescg_stays_as_it_is(void **state)
{
    (void)state;
    float p[4] = { 0.1f, 12, -0.5f, 0.3f };
    assert_int_equal(cn_colour_to_linear(colour, "ACEScg", p, 1, 4), CN_OK);
    assert_true(fabsf(p[0] - 0.1f) < 1e-6f && fabsf(p[1] - 12) < 1e-5f && fabsf(p[2] + 0.5f) < 1e-6f);
    assert_float_equal(p[3], 0.3f, 0);
}

static void displays_are_finite_and_within_range(void **state)
{
    (void)state;
    static const char *const views[] = { "sRGB", "ACES" };
    for (int v = 0; v < 2; v++) {
        float p[16] = {
            NAN, 0.5f, 0.5f, NAN, INFINITY, -INFINITY, 1, 0.25f, 1e6f, -3, 0.18f, 2, 0.18f, 0.18f, 0.18f, -1
        };
        assert_int_equal(cn_colour_to_display(colour, &(cn_display_transform){ .view = views[v] }, p, 4, 4), CN_OK);
        for (int i = 0; i < 16; i++)
            if (i % 4 < 3) assert_true(p[i] >= 0 && p[i] <= 1);
        assert_true(isnan(p[3])); /* a fourth channel is left alone */
        assert_float_equal(p[7], 0.25f, 0);
        assert_float_equal(p[15], -1, 0);
        assert_true(p[1] > 0.2f); /* one broken channel does not take the others with it */
    }
}

/* Plain sRGB shows mid grey at 18 % of the display's white; ACES 1.0 SDR at 10 %, lifted for a dim surround (to the
 * power of 0.9811). */
static void both_views_show_mid_grey_where_they_should(void **state)
{
    (void)state;
    float plain[3] = { 0.18f, 0.18f, 0.18f }, aces[3] = { 0.18f, 0.18f, 0.18f };
    assert_int_equal(cn_colour_to_display(colour, &(cn_display_transform){ .view = "sRGB" }, plain, 1, 3), CN_OK);
    assert_int_equal(cn_colour_to_display(colour, &(cn_display_transform){ .view = "ACES" }, aces, 1, 3), CN_OK);
    for (int c = 0; c < 3; c++) {
        assert_true(fabs(decode((double)plain[c]) - 0.18) < 1e-4);
        assert_true(fabs(decode((double)aces[c]) - pow(0.1, 0.9811)) < 5e-4);
    }
}

static void exposure_is_in_linear_light(void **state)
{
    (void)state;
    float stops[3] = { 0.05f, 0.1f, 0.2f }, doubled[3] = { 0.1f, 0.2f, 0.4f };
    assert_int_equal(
        cn_colour_to_display(colour, &(cn_display_transform){ .view = "ACES", .exposure_ev = 1 }, stops, 1, 3), CN_OK);
    assert_int_equal(cn_colour_to_display(colour, &(cn_display_transform){ .view = "ACES" }, doubled, 1, 3), CN_OK);
    for (int c = 0; c < 3; c++)
        assert_true(fabsf(stops[c] - doubled[c]) < 1e-5f);
}

static void unknown_names_are_said(void **state)
{
    (void)state;
    float p[3] = { 0 };
    assert_int_equal(cn_colour_to_display(colour, &(cn_display_transform){ .view = "Film" }, p, 1, 3), CN_ERR_CONFIG);
    assert_non_null(strstr(cn_error_message(), "Film"));
    assert_non_null(strstr(cn_error_message(), "ACES"));
    assert_int_equal(cn_colour_to_display(colour, &(cn_display_transform){ .look = "Warm" }, p, 1, 3), CN_ERR_CONFIG);
    assert_non_null(strstr(cn_error_message(), "Warm"));
    assert_int_equal(cn_colour_to_linear(colour, "Nikon", p, 1, 3), CN_ERR_CONFIG);
    assert_non_null(strstr(cn_error_message(), "Nikon"));
    assert_string_equal(cn_colour_views(colour)[0], "sRGB");
    assert_string_equal(cn_colour_views(colour)[1], "ACES");
    assert_null(cn_colour_looks(colour)[0]);
}

/* A user's config counts when $OCIO names it, under its own names; "" asks for Conurb's. */
static void the_users_config_is_taken(void **state)
{
    (void)state;
    static const char text[] = "ocio_profile_version: 2\n"
                               "roles: {default: raw, scene_linear: lin_ap1}\n"
                               "file_rules:\n  - !<Rule> {name: Default, colorspace: default}\n"
                               "displays:\n  D:\n    - !<View> {name: Mine, colorspace: srgb_tx}\n"
                               "looks:\n  - !<Look> {name: Warm, process_space: lin_ap1}\n"
                               "colorspaces:\n  - !<ColorSpace> {name: raw, isdata: true}\n"
                               "  - !<ColorSpace> {name: lin_ap1}\n"
                               "  - !<ColorSpace>\n    name: srgb_tx\n    to_scene_reference: "
                               "!<ExponentTransform> {value: [2, 2, 2, 1]}\n";
    char path[] = "/tmp/conurb-ocio-XXXXXX";
    const int fd = mkstemp(path);
    assert_true(fd >= 0);
    close(fd);
    assert_int_equal(cn_file_write(path, text, sizeof text - 1), CN_OK);
    setenv("OCIO", path, 1);
    cn_colour *user = NULL, *own = NULL;
    assert_int_equal(cn_colour_create(&user, NULL), CN_OK);
    assert_int_equal(cn_colour_create(&own, ""), CN_OK);
    unsetenv("OCIO");
    unlink(path);
    float p[3] = { 0.5f, 0.5f, 0.5f }, q[3] = { 0.5f, 0.5f, 0.5f };
    assert_int_equal(cn_colour_to_linear(user, NULL, p, 1, 3), CN_OK);
    assert_true(fabsf(p[0] - 0.25f) < 1e-5f);
    assert_int_equal(cn_colour_to_display(user, NULL, p, 1, 3), CN_OK);
    assert_true(fabsf(p[0] - 0.5f) < 1e-5f);
    assert_string_equal(cn_colour_views(user)[0], "Mine");
    assert_string_equal(cn_colour_looks(user)[0], "Warm");
    assert_null(cn_colour_looks(user)[1]);
    assert_int_equal(cn_colour_to_linear(own, NULL, q, 1, 3), CN_OK);
    assert_true(fabs((double)q[0] - decode(0.5)) < 1e-5);
    cn_colour_destroy(&user);
    cn_colour_destroy(&own);
    assert_int_equal(cn_colour_create(&user, "/no/such/config.ocio"), CN_ERR_CONFIG);
    assert_null(user);
}

enum { TASKS = 32, PIXELS = 500 };
static float shared[TASKS][PIXELS * 3];
static void convert_one(void *user, size_t i, unsigned worker)
{
    (void)worker;
    cn_status *status = user;
    status[i] = cn_colour_to_linear(colour, NULL, shared[i], PIXELS, 3);
    const char *view = i % 2 ? "ACES" : "sRGB";
    if (status[i] == CN_OK)
        status[i] = cn_colour_to_display(colour, &(cn_display_transform){ .view = view, .exposure_ev = 0.5 }, shared[i],
                                         PIXELS, 3);
}

static void threads_do_not_disturb_each_other(void **state)
{
    (void)state;
    for (int i = 0; i < TASKS; i++)
        for (uint64_t k = 0; k < PIXELS * 3; k++)
            shared[i][k] = cn_rng_float(2, 0, k);
    cn_status status[TASKS];
    cn_pool *pool;
    assert_int_equal(cn_pool_create(&pool, 4), CN_OK);
    cn_pool_run(pool, TASKS, convert_one, status);
    cn_pool_destroy(&pool);
    for (int i = 0; i < TASKS; i++) {
        assert_int_equal(status[i], CN_OK);
        assert_memory_equal(shared[i], shared[i % 2], sizeof shared[i]);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_matrices_are_inverse),
        cmocka_unit_test(the_config_does_what_the_matrices_say),
        cmocka_unit_test(acescg_stays_as_it_is),
        cmocka_unit_test(displays_are_finite_and_within_range),
        cmocka_unit_test(both_views_show_mid_grey_where_they_should),
        cmocka_unit_test(exposure_is_in_linear_light),
        cmocka_unit_test(unknown_names_are_said),
        cmocka_unit_test(the_users_config_is_taken),
        cmocka_unit_test(threads_do_not_disturb_each_other),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
