/* The matching of descriptors against the rules written out in plain float arithmetic. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/rng.h"
#include "pose/feature_match.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MOST = 400, DIMS = 128 };
static uint8_t first[MOST][DIMS], second[MOST][DIMS];

/* A descriptor as COLMAP makes it: length 512, in bytes. */
static void normalise(const float *x, uint8_t *out)
{
    float length = 0;
    for (int k = 0; k < DIMS; k++)
        length += x[k] * x[k];
    for (int k = 0; k < DIMS; k++)
        out[k] = (uint8_t)fminf(512 * x[k] / sqrtf(length) + 0.5f, 255);
}

/* Descriptors of two photos: part of the second's are those of the first, more or less disturbed. */
static void make_photos(uint32_t n, uint32_t m, uint64_t seed)
{
    float x[DIMS], base[MOST][DIMS];
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t k = 0; k < DIMS; k++)
            base[i][k] = powf(cn_rng_float(seed, 1, i * DIMS + k), 3);
        normalise(base[i], first[i]);
    }
    for (uint32_t j = 0; j < m; j++) {
        const uint32_t from = cn_rng_below(seed, 2, j, n ? n : 1);
        const float noise = cn_rng_float(seed, 3, j);
        for (uint32_t k = 0; k < DIMS; k++)
            x[k] = (1 - noise) * (n ? base[from][k] : 0) + noise * powf(cn_rng_float(seed, 4, j * DIMS + k), 3);
        normalise(x, second[j]);
    }
}

/* The angle between two descriptors, whose length is taken as 512. */
static float angle(const uint8_t *a, const uint8_t *b)
{
    float product = 0; /* below 2^24, so exact */
    for (int k = 0; k < DIMS; k++)
        product += (float)a[k] * (float)b[k];
    return acosf(fminf(product / (512.0f * 512.0f), 1.0f));
}

/* The only nearest of `others` to one descriptor, if it passes the tests of distance and ratio; else -1. */
static int nearest(const uint8_t *one, uint8_t (*others)[DIMS], uint32_t n)
{
    float best = INFINITY, next = acosf(0); /* a product of 0 stands in for a second one */
    int at = -1;
    for (uint32_t j = 0; j < n; j++) {
        const float d = angle(one, others[j]);
        if (d < best) {
            if (at >= 0) next = best;
            best = d;
            at = (int)j;
        } else if (d < next) {
            next = d;
        }
    }
    return at >= 0 && best <= 0.7f && best < 0.8f * next ? at : -1;
}

static void compare_with_definition(uint32_t n, uint32_t m, uint32_t least_matches)
{
    cn_match_space space = { 0 };
    const cn_descriptors a = { first[0], n }, b = { second[0], m };
    const cn_kernel *sets[4];
    const int n_sets = cn_kernel_sets(sets);
    for (int s = 0; s < n_sets; s++) {
        assert_int_equal(cn_match_features(sets[s], a, b, &space), CN_OK);
        uint32_t found = 0;
        for (uint32_t i = 0; i < n; i++) {
            const int j = nearest(first[i], second, m);
            if (j < 0 || nearest(second[j], first, n) != (int)i) continue;
            assert_true(found < space.n_pairs);
            assert_int_equal(space.pairs[found].a, i);
            assert_int_equal(space.pairs[found].b, j);
            found++;
        }
        assert_int_equal(space.n_pairs, found);
        assert_true(found >= least_matches);
    }
    cn_match_space_deinit(&space);
}

static void test_definition(void **state)
{
    (void)state;
    static const uint32_t sizes[][2] = { { 400, 371 }, { 33, 400 }, { 129, 7 }, { 1, 1 }, { 0, 9 }, { 9, 0 } };
    for (uint32_t c = 0; c < sizeof sizes / sizeof *sizes; c++) {
        make_photos(sizes[c][0], sizes[c][1], c + 1);
        compare_with_definition(sizes[c][0], sizes[c][1], c == 0 ? 50 : 0);
    }
}

/* Two equally near ones are no match, in either direction; the same photo twice matches throughout. */
static void test_ties(void **state)
{
    (void)state;
    cn_match_space space = { 0 };
    make_photos(50, 50, 9);
    memcpy(second, first, sizeof first);
    const cn_descriptors a = { first[0], 50 }, b = { second[0], 50 };
    assert_int_equal(cn_match_features(cn_kernel_best(), a, b, &space), CN_OK);
    assert_int_equal(space.n_pairs, 50);
    memcpy(second[7], second[8], DIMS);
    memcpy(first[20], first[30], DIMS);
    compare_with_definition(50, 50, 40);
    assert_int_equal(cn_match_features(cn_kernel_best(), a, b, &space), CN_OK);
    for (uint32_t i = 0; i < space.n_pairs; i++)
        assert_true(space.pairs[i].a != 8 && space.pairs[i].b != 30);
    memset(second, 0, sizeof second); /* products of 0 are no match */
    assert_int_equal(cn_match_features(cn_kernel_best(), a, b, &space), CN_OK);
    assert_int_equal(space.n_pairs, 0);
    cn_match_space_deinit(&space);
}

/* A feature whose nearest is nearer to another is no match, in either direction. */
static void test_cross_check(void **state)
{
    (void)state;
    cn_match_space space = { 0 };
    make_photos(3, 3, 11);
    memcpy(second, first, sizeof first);
    for (int k = 0; k < DIMS; k += 4)
        first[1][k] = first[0][k], first[1][k + 1] = first[0][k + 1], first[1][k + 2] = first[0][k + 2];
    memset(second[1], 9, DIMS);
    second[1][5] = 250;
    const cn_descriptors a = { first[0], 3 }, b = { second[0], 3 };
    assert_int_equal(nearest(first[1], second, 3), 0); /* one way it would pass */
    assert_int_equal(nearest(second[0], first, 3), 0);
    for (int turn = 0; turn < 2; turn++) {
        assert_int_equal(cn_match_features(cn_kernel_best(), turn ? b : a, turn ? a : b, &space), CN_OK);
        assert_int_equal(space.n_pairs, 2);
        assert_true(space.pairs[0].a == 0 && space.pairs[0].b == 0);
        assert_true(space.pairs[1].a == 2 && space.pairs[1].b == 2);
    }
    cn_match_space_deinit(&space);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_definition), cmocka_unit_test(test_ties),
                                        cmocka_unit_test(test_cross_check) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
