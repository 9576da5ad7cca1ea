/* Which photos are matched, and which share a lens. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "pose/colmap.h"
#include "pose/pairs.h"

#include <math.h>
#include <stdlib.h>
#include <stdio.h>
#include <string.h>

enum { N = 4 };
static cn_photo photos[N];
static cn_photo_index photo_index;

static int set_up(void **state)
{
    (void)state;
    static char names[N][16] = { "a.jpg", "b.jpg", "c.jpg", "d.jpg" };
    for (int i = 0; i < N; i++)
        photos[i] = (cn_photo){ .name = names[i],
                                .width = 640,
                                .height = 480,
                                .orientation = 1,
                                .camera = "",
                                .focal_mm = NAN,
                                .focal_35mm = NAN,
                                .hash = (uint64_t)i };
    photo_index = (cn_photo_index){ .photos = photos, .n_photos = N };
    return 0;
}

static cn_status near_text(const cn_photo_index *index, bool linked, uint32_t neighbours, char **text, size_t *size,
                           uint64_t *n_pairs)
{
    cn_photo_pairs pairs = { 0 };
    CN_TRY(cn_photo_pairs_near(index, neighbours, &pairs));
    const cn_status status = cn_photo_pairs_text(index, linked, &pairs, text, size);
    *n_pairs = pairs.n;
    cn_photo_pairs_deinit(&pairs);
    return status;
}

static void test_gps_pairs(void **state)
{
    (void)state;
    char *text;
    size_t size;
    uint64_t n_pairs = 0;
    for (int i = 0; i < N; i++) {
        photos[i].has_gps = true;
        photos[i].latitude_deg = 89.9;
        photos[i].longitude_deg = 179.99 + 0.01 * i; /* across the antimeridian */
        if (photos[i].longitude_deg > 180.0) photos[i].longitude_deg -= 360.0;
    }
    assert_int_equal(near_text(&photo_index, false, 1, &text, &size, &n_pairs), CN_OK);
    assert_true(n_pairs >= 2 && n_pairs <= 3);
    assert_non_null(strstr(text, "a.jpg b.jpg\n"));
    assert_non_null(strstr(text, "c.jpg d.jpg\n"));
    assert_null(strstr(text, "a.jpg d.jpg"));
    free(text);
    assert_int_equal(near_text(&photo_index, false, 20, &text, &size, &n_pairs), CN_OK);
    assert_int_equal(n_pairs, 6);
    free(text);
    photos[2].has_gps = false;
    assert_int_equal(near_text(&photo_index, true, 1, &text, &size, &n_pairs), CN_OK);
    assert_non_null(strstr(text, "00000001.jpg 00000002.jpg\n"));
    assert_non_null(strstr(text, "00000002.jpg 00000003.jpg\n"));
    free(text);
    for (int i = 0; i < N; i++)
        photos[i].longitude_deg = 5.0;
    assert_int_equal(near_text(&photo_index, false, 2, &text, &size, &n_pairs), CN_OK);
    assert_int_equal(n_pairs, 0);
    free(text);
}

static bool has_pair(const cn_photo_pairs *pairs, uint32_t a, uint32_t b)
{
    uint32_t n = 0;
    for (size_t i = 0; i < pairs->n; i++)
        n += pairs->items[i] == ((uint64_t)a << 32 | b);
    assert_true(n <= 1);
    return n == 1;
}

/* Three photos from the air, 20 m apart, and ten on the street below each: those of the air are pairs, too. */
static void test_altitudes(void **state)
{
    (void)state;
    enum { EACH = 11, ALL = 33 };
    cn_photo many[ALL];
    cn_photo_index index = { .photos = many, .n_photos = ALL };
    cn_photo_pairs pairs = { 0 };
    for (int i = 0; i < ALL; i++) {
        many[i] = photos[0];
        many[i].has_gps = many[i].has_altitude = true;
        many[i].latitude_deg = 46 + 1.8e-4 * (i / EACH) + 1e-6 * (i % EACH);
        many[i].longitude_deg = 8;
        many[i].altitude_m = 500 + (i % EACH ? 1 : 50);
    }
    assert_int_equal(cn_photo_pairs_near(&index, 6, &pairs), CN_OK);
    assert_true(has_pair(&pairs, 0, EACH) && has_pair(&pairs, EACH, 2 * EACH) && has_pair(&pairs, 0, 1));
    cn_photo_pairs_deinit(&pairs);
    for (int i = 0; i < ALL; i++)
        many[i].altitude_m = 500 + (i % EACH ? 1 : 15);
    assert_int_equal(cn_photo_pairs_near(&index, 6, &pairs), CN_OK);
    assert_false(has_pair(&pairs, 0, EACH));
    cn_photo_pairs_deinit(&pairs);
}

static void test_other_pairs(void **state)
{
    (void)state;
    enum { MANY = 300 };
    cn_photo_pairs pairs = { 0 };
    assert_int_equal(cn_photo_pairs_all(MANY, &pairs), CN_OK);
    assert_int_equal(pairs.n, MANY * (MANY - 1) / 2);
    for (uint32_t a = 0; a < MANY; a += 37)
        for (uint32_t b = a + 1; b < MANY; b += 11)
            assert_true(has_pair(&pairs, a, b));
    cn_photo_pairs_deinit(&pairs);
    static char names[MANY][16];
    static cn_photo walk[MANY];
    for (uint32_t i = 0; i < MANY; i++) {
        snprintf(names[i], sizeof names[i], "walk%u.jpg", i); /* walk10 comes after walk9 */
        walk[i].name = names[i];
    }
    cn_photo_index index = { .photos = walk, .n_photos = MANY };
    cn_photo swapped = walk[7];
    walk[7] = walk[200];
    walk[200] = swapped;
    assert_int_equal(cn_photo_pairs_in_sequence(&index, &pairs), CN_OK);
    for (uint32_t far = 1; far < MANY - 5; far++)
        assert_int_equal(has_pair(&pairs, 5,
                                  5 + far == 7     ? 200
                                  : 5 + far == 200 ? 7
                                                   : 5 + far),
                         far < 10 || far == 16 || far == 32 || far == 64 || far == 128 || far == 256);
    assert_true(has_pair(&pairs, MANY - 2, MANY - 1));
    cn_photo_pairs_deinit(&pairs);
    assert_int_equal(cn_photo_pairs_all(1, &pairs), CN_OK);
    index.n_photos = 1;
    assert_int_equal(cn_photo_pairs_in_sequence(&index, &pairs), CN_OK);
    assert_int_equal(pairs.n, 0);
}

static void test_lens_groups(void **state)
{
    (void)state;
    cn_lens_groups groups;
    photos[0].camera = photos[1].camera = photos[3].camera = "X 1";
    photos[3].orientation = 6; /* the same pixels, shown upright */
    photos[3].width = 480;
    photos[3].height = 640;
    assert_int_equal(cn_colmap_group(&photo_index, true, &groups), CN_OK);
    assert_int_equal(groups.n_groups, 2);
    assert_true(groups.groups[0].shared && groups.groups[0].n == 3);
    assert_true(!groups.groups[1].shared && groups.groups[1].n == 1);
    assert_int_equal(groups.order[groups.groups[1].first], 2);
    cn_lens_groups_deinit(&groups);
    photos[1].focal_mm = 50.0; /* zoomed */
    assert_int_equal(cn_colmap_group(&photo_index, true, &groups), CN_OK);
    assert_int_equal(groups.groups[0].n, 2);
    cn_lens_groups_deinit(&groups);
    assert_int_equal(cn_colmap_group(&photo_index, false, &groups), CN_OK);
    assert_true(groups.n_groups == 1 && !groups.groups[0].shared && groups.groups[0].n == N);
    cn_lens_groups_deinit(&groups);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(test_gps_pairs, set_up),
        cmocka_unit_test(test_altitudes),
        cmocka_unit_test(test_other_pairs),
        cmocka_unit_test_setup(test_lens_groups, set_up),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
