/* Which pixels of an older store are used again, of as many photos as a city may have. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/rng.h"
#include "photo/reuse.h"

#include <stdlib.h>

enum { MANY = 200000 };

static cn_store_record record_of(uint32_t i)
{
    return (cn_store_record){
        .hash = cn_rng_below(1, 1, i, UINT32_MAX), .mask_hash = i % 3, .width = 800, .height = 600 + i % 5
    };
}

static cn_pixel_store *store_of(uint32_t n)
{
    cn_pixel_store *store = calloc(1, sizeof *store);
    assert_non_null(store);
    store->head.n_photos = n;
    store->records = malloc((n + 1u) * sizeof *store->records);
    assert_non_null(store->records);
    for (uint32_t i = 0; i < n; i++)
        store->records[i] = record_of(i);
    return store;
}

static void destroy(cn_pixel_store *store)
{
    free(store->records);
    free(store);
}

/* A linear search for each photo would read 2e10 records of 512 bytes, which takes minutes. */
static void each_of_many_photos_is_found(void **state)
{
    (void)state;
    cn_pixel_store *store = store_of(MANY);
    cn_reuse reuse;
    assert_int_equal(cn_reuse_init(&reuse, store), CN_OK);
    for (uint32_t i = 0; i < MANY; i++) {
        const cn_store_record wanted = record_of(i), *found = cn_reuse_find(&reuse, &wanted);
        assert_true(found && found->hash == wanted.hash && found->mask_hash == wanted.mask_hash);
        assert_true(found->width == wanted.width && found->height == wanted.height);
    }
    cn_reuse_deinit(&reuse);
    destroy(store);
}

static void all_of_photo_mask_and_size_has_to_agree(void **state)
{
    (void)state;
    cn_pixel_store *store = store_of(50);
    store->records[30] = store->records[20]; /* there twice: the first counts */
    cn_reuse reuse;
    assert_int_equal(cn_reuse_init(&reuse, store), CN_OK);
    cn_store_record wanted = record_of(20);
    assert_ptr_equal(cn_reuse_find(&reuse, &wanted), &store->records[20]);
    wanted.hash++;
    assert_null(cn_reuse_find(&reuse, &wanted));
    wanted = record_of(20), wanted.mask_hash = 7;
    assert_null(cn_reuse_find(&reuse, &wanted));
    wanted = record_of(20), wanted.width++;
    assert_null(cn_reuse_find(&reuse, &wanted));
    wanted = record_of(20), wanted.height++;
    assert_null(cn_reuse_find(&reuse, &wanted));
    wanted.hash = UINT64_MAX;
    assert_null(cn_reuse_find(&reuse, &wanted));
    cn_reuse_deinit(&reuse);
    destroy(store);
}

static void without_a_store_nothing_is_found(void **state)
{
    (void)state;
    cn_reuse reuse;
    const cn_store_record wanted = record_of(1);
    assert_int_equal(cn_reuse_init(&reuse, NULL), CN_OK);
    assert_null(cn_reuse_find(&reuse, &wanted));
    cn_reuse_deinit(&reuse);
    cn_pixel_store *empty = store_of(0);
    assert_int_equal(cn_reuse_init(&reuse, empty), CN_OK);
    assert_null(cn_reuse_find(&reuse, &wanted));
    cn_reuse_deinit(&reuse);
    destroy(empty);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(each_of_many_photos_is_found),
        cmocka_unit_test(all_of_photo_mask_and_size_has_to_agree),
        cmocka_unit_test(without_a_store_nothing_is_found),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
