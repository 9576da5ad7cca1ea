/* Photos of several places, by their features: which pairs are retrieved. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../bridge/colmap_database.h"
#include "base/rng.h"
#include "pose/feature_match.h"
#include "pose/retrieval.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { PHOTOS = 60, LARGE = 512, SMALL = 40, FEATURES = LARGE + SMALL, DIMS = CN_DESCRIPTOR, PLACES = 3, LOST = 7 };
static char folder[64], path[96], names[PHOTOS][16];
static cn_photo photos[PHOTOS];
static uint8_t descriptors[FEATURES][DIMS];
static float keypoints[FEATURES][6];

/* Descriptor of a point, with noise of its own in each photo. */
static void describe(uint32_t point, uint32_t photo, uint8_t *out)
{
    float x[DIMS], length = 0;
    for (uint32_t k = 0; k < DIMS; k++) {
        const float value = cn_rng_float(1, 5, (uint64_t)point * DIMS + k);
        x[k] = value * value + 0.1f * cn_rng_float(photo, 6, (uint64_t)point * DIMS + k);
        length += x[k] * x[k];
    }
    for (uint32_t k = 0; k < DIMS; k++)
        out[k] = (uint8_t)(512 * x[k] / sqrtf(length));
}

/* 20 of a photo's large features are points of its place. The other large ones are in no other photo. All photos share
 * their small features, which come first in the database. */
static void add_photo(uint32_t p, uint32_t place)
{
    for (uint32_t i = 0; i < FEATURES; i++) {
        const uint32_t large = i < SMALL ? 0 : i - SMALL;
        const uint32_t point = i < SMALL ? i : large < 20 ? 1000 * (place + 1) + large : 100000 + 1000 * p + large;
        const float scale = i < SMALL ? 1 : 8 + (float)large;
        describe(point, p, descriptors[i]);
        memcpy(keypoints[i], (float[6]){ 5, 5, 0, scale, -scale, 0 }, sizeof keypoints[i]);
    }
    colmap_database_add(path, p + 1, names[p], descriptors[0], FEATURES);
    colmap_database_add_keypoints(path, p + 1, (const float(*)[6])keypoints, FEATURES);
}

static int set_up(void **state)
{
    (void)state;
    strcpy(folder, "/tmp/conurb-alike-XXXXXX");
    if (!mkdtemp(folder)) return -1;
    snprintf(path, sizeof path, "%s/database.db", folder);
    colmap_database_make(path);
    for (uint32_t p = 0; p < PHOTOS; p++) {
        snprintf(names[p], sizeof names[p], "%02u.jpg", p);
        photos[p] = (cn_photo){ .name = names[p] };
    }
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    static const char *const suffixes[] = { "", "-wal", "-shm" };
    for (int i = 0; i < 3; i++) {
        char name[128];
        snprintf(name, sizeof name, "%s%s", path, suffixes[i]);
        unlink(name);
    }
    return rmdir(folder);
}

static cn_status retrieve(uint32_t n, cn_pool *pool, cn_photo_pairs *pairs)
{
    const cn_photo_index index = { .photos = photos, .n_photos = n };
    const cn_context ctx = { .pool = pool };
    cn_colmap_job job = { .ctx = &ctx, .index = &index, .database = path };
    *pairs = (cn_photo_pairs){ 0 };
    return cn_photo_pairs_retrieve(&job, pairs);
}

/* Photo p is of place p % PLACES, so that neighbours by name are of different places. */
static void test_photos_of_one_place(void **state)
{
    (void)state;
    enum { N = 12 };
    cn_photo_pairs pairs, again;
    cn_pool *pool;
    for (uint32_t p = 0; p < N; p++)
        if (p != LOST) add_photo(p, p % PLACES);
    assert_int_equal(retrieve(N, NULL, &pairs), CN_OK);
    size_t at = 0;
    for (uint32_t a = 0; a < N; a++)
        for (uint32_t b = a + 1; b < N; b++) {
            const bool one_place = a % PLACES == b % PLACES && a != LOST && b != LOST;
            if (!one_place && b != a + 1) continue;
            assert_true(at < pairs.n);
            assert_true(pairs.items[at++] == ((uint64_t)a << 32 | b));
        }
    assert_int_equal(at, pairs.n);
    /* More threads find the same. */
    assert_int_equal(cn_pool_create(&pool, 3), CN_OK);
    assert_int_equal(retrieve(N, pool, &again), CN_OK);
    assert_int_equal(again.n, pairs.n);
    assert_memory_equal(again.items, pairs.items, pairs.n * sizeof *pairs.items);
    cn_pool_destroy(&pool);
    cn_photo_pairs_deinit(&again);
    cn_photo_pairs_deinit(&pairs);
}

/* A photo has 50 partners at most, and no photo is left without any. */
static void test_many_photos_of_one_place(void **state)
{
    (void)state;
    uint32_t partners[PHOTOS] = { 0 };
    cn_photo_pairs pairs;
    for (uint32_t p = 0; p < PHOTOS; p++)
        add_photo(p, 0);
    assert_int_equal(retrieve(PHOTOS, NULL, &pairs), CN_OK);
    assert_true(pairs.n <= 50 * PHOTOS && pairs.n < PHOTOS * (PHOTOS - 1) / 2);
    for (size_t i = 0; i < pairs.n; i++) {
        partners[pairs.items[i] >> 32]++;
        partners[(uint32_t)pairs.items[i]]++;
    }
    for (uint32_t p = 0; p < PHOTOS; p++)
        assert_true(partners[p] >= 50);
    cn_photo_pairs_deinit(&pairs);
}

static void test_damaged_keypoints(void **state)
{
    (void)state;
    cn_photo_pairs pairs;
    for (uint32_t p = 0; p < 3; p++)
        add_photo(p, 0);
    colmap_database_run(path, "UPDATE keypoints SET rows = 5 WHERE image_id = 2");
    assert_int_equal(retrieve(3, NULL, &pairs), CN_ERR_FORMAT);
    assert_non_null(strstr(cn_error_message(), "keypoints of photo 2"));
    assert_int_equal(pairs.n, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_photos_of_one_place, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_many_photos_of_one_place, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_damaged_keypoints, set_up, tear_down),
    };
    return cmocka_run_group_tests_name("retrieval", tests, NULL, NULL);
}
