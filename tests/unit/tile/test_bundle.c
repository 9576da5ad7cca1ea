/* Valid bundles: what is read equals what was written, and the same content gives the same bytes. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/file.h"
#include "conurb/tile.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static char folder[] = "/tmp/conurb-bundle-XXXXXX";
static char path[128], other[128];

static int make_folder(void **state)
{
    (void)state;
    if (!mkdtemp(folder)) return -1;
    snprintf(path, sizeof path, "%s/a.safetensors", folder);
    snprintf(other, sizeof other, "%s/b.safetensors", folder);
    return 0;
}

static int remove_folder(void **state)
{
    (void)state;
    unlink(path);
    unlink(other);
    return rmdir(folder);
}

static const uint8_t bytes3[3] = { 7, 8, 9 };
static const uint16_t halves[6] = { 0x3c00, 0x4000, 0x4200, 0x4400, 0x4500, 0x4600 };
static const float floats[4] = { 1.0F, -2.5F, 3.25F, 0.0F };
static const uint32_t words[2] = { 1, 0xffffffffU };
static const double doubles[1] = { 0.1 };
static const uint64_t longs[1] = { UINT64_MAX };

/* An odd number of bytes first, so that a careless layout would misalign all that follows. */
static cn_bundle *sample(void)
{
    cn_bundle *b = NULL;
    assert_int_equal(cn_bundle_create(&b), CN_OK);
    assert_int_equal(cn_bundle_add(b, "bytes", CN_U8, 1, (uint64_t[]){ 3 }, bytes3), CN_OK);
    assert_int_equal(cn_bundle_add(b, "halves", CN_F16, 2, (uint64_t[]){ 3, 2 }, halves), CN_OK);
    assert_int_equal(cn_bundle_add(b, "brains", CN_BF16, 3, (uint64_t[]){ 1, 3, 2 }, halves), CN_OK);
    assert_int_equal(cn_bundle_add(b, "floats", CN_F32, 4, (uint64_t[]){ 1, 2, 1, 2 }, floats), CN_OK);
    assert_int_equal(cn_bundle_add(b, "words", CN_U32, 1, (uint64_t[]){ 2 }, words), CN_OK);
    assert_int_equal(cn_bundle_add(b, "scalar", CN_F64, 0, NULL, doubles), CN_OK);
    assert_int_equal(cn_bundle_add(b, "longs", CN_U64, 1, (uint64_t[]){ 1 }, longs), CN_OK);
    assert_int_equal(cn_bundle_add(b, "nothing", CN_F32, 2, (uint64_t[]){ 0, 5 }, NULL), CN_OK);
    assert_int_equal(cn_bundle_set(b, "zebra", "line\n\"quoted\" \xc3\xa9"), CN_OK);
    assert_int_equal(cn_bundle_set(b, "apple", "replaced"), CN_OK);
    assert_int_equal(cn_bundle_set(b, "apple", "1"), CN_OK);
    return b;
}

static void check_tensor(const cn_bundle *b, const char *name, cn_dtype dtype, uint32_t n_dims, const void *data,
                         size_t size)
{
    const cn_tensor *t = cn_bundle_find(b, name);
    assert_non_null(t);
    assert_int_equal(t->dtype, dtype);
    assert_int_equal(t->n_dims, n_dims);
    assert_int_equal((uintptr_t)t->data % cn_dtype_size(dtype), 0);
    if (size) assert_memory_equal(t->data, data, size);
}

static void round_trip(void **state)
{
    (void)state;
    cn_bundle *b = sample(), *r = NULL;
    assert_int_equal(cn_bundle_write(b, path), CN_OK);
    cn_bundle_destroy(&b);
    assert_null(b);
    assert_int_equal(cn_bundle_open(&r, path, true), CN_OK);
    assert_int_equal(cn_bundle_count(r), 8);
    assert_null(cn_bundle_at(r, 8));
    assert_null(cn_bundle_find(r, "absent"));
    check_tensor(r, "bytes", CN_U8, 1, bytes3, sizeof bytes3);
    check_tensor(r, "halves", CN_F16, 2, halves, sizeof halves);
    check_tensor(r, "brains", CN_BF16, 3, halves, sizeof halves);
    check_tensor(r, "floats", CN_F32, 4, floats, sizeof floats);
    check_tensor(r, "words", CN_U32, 1, words, sizeof words);
    check_tensor(r, "scalar", CN_F64, 0, doubles, sizeof doubles);
    check_tensor(r, "longs", CN_U64, 1, longs, sizeof longs);
    check_tensor(r, "nothing", CN_F32, 2, NULL, 0);
    assert_int_equal(cn_bundle_find(r, "floats")->dims[3], 2);
    assert_string_equal(cn_bundle_get(r, "apple"), "1");
    assert_string_equal(cn_bundle_get(r, "zebra"), "line\n\"quoted\" \xc3\xa9");
    assert_int_equal(strlen(cn_bundle_get(r, "checksum")), 16);
    assert_null(cn_bundle_get(r, "absent"));
    cn_bundle_destroy(&r);
}

static void same_content_same_bytes(void **state)
{
    (void)state;
    char *a, *c;
    size_t size_a, size_c;
    cn_bundle *b = sample();
    assert_int_equal(cn_bundle_write(b, path), CN_OK);
    cn_bundle_destroy(&b);
    b = sample();
    /* The order of metadata does not matter, nor does an old checksum that was read from elsewhere. */
    assert_int_equal(cn_bundle_set(b, "checksum", "0000000000000000"), CN_OK);
    assert_int_equal(cn_bundle_write(b, other), CN_OK);
    cn_bundle_destroy(&b);
    assert_int_equal(cn_file_read(path, 0, &a, &size_a), CN_OK);
    assert_int_equal(cn_file_read(other, 0, &c, &size_c), CN_OK);
    assert_int_equal(size_a, size_c);
    assert_memory_equal(a, c, size_a);
    free(a);
    free(c);
}

/* Rules that the Python package safetensors and its Rust reader enforce. */
static void follows_the_format(void **state)
{
    (void)state;
    char *data;
    size_t size;
    uint64_t length;
    cn_bundle *b = sample();
    assert_int_equal(cn_bundle_write(b, path), CN_OK);
    cn_bundle_destroy(&b);
    assert_int_equal(cn_file_read(path, 0, &data, &size), CN_OK);
    memcpy(&length, data, sizeof length);
    assert_int_equal((8 + length) % 64, 0);
    assert_int_equal(data[8], '{');
    assert_memory_equal(data + 8, "{\"__metadata__\":{\"apple\":", 25);
    assert_true(data[7 + length] == ' ' || data[7 + length] == '}');
    assert_int_equal(size - 8 - length, 3 + 12 + 12 + 16 + 8 + 8 + 8);
    free(data);
}

static void empty_bundle(void **state)
{
    (void)state;
    cn_bundle *b = NULL;
    assert_int_equal(cn_bundle_create(&b), CN_OK);
    assert_int_equal(cn_bundle_write(b, path), CN_OK);
    cn_bundle_destroy(&b);
    assert_int_equal(cn_bundle_open(&b, path, true), CN_OK);
    assert_int_equal(cn_bundle_count(b), 0);
    cn_bundle_destroy(&b);
    cn_bundle_destroy(&b);
}

static void wrong_use_is_refused(void **state)
{
    (void)state;
    cn_bundle *b = sample();
    char name[80];
    memset(name, 'x', sizeof name);
    name[64] = 0;
    assert_int_equal(cn_bundle_add(b, "bytes", CN_U8, 1, (uint64_t[]){ 3 }, bytes3), CN_ERR_USAGE);
    assert_int_equal(cn_bundle_add(b, "", CN_U8, 1, (uint64_t[]){ 3 }, bytes3), CN_ERR_USAGE);
    assert_int_equal(cn_bundle_add(b, "__metadata__", CN_U8, 1, (uint64_t[]){ 3 }, bytes3), CN_ERR_USAGE);
    assert_int_equal(cn_bundle_add(b, name, CN_U8, 1, (uint64_t[]){ 3 }, bytes3), CN_ERR_USAGE);
    assert_int_equal(cn_bundle_add(b, "deep", CN_U8, 5, (uint64_t[]){ 1, 1, 1, 1, 3 }, bytes3), CN_ERR_USAGE);
    assert_int_equal(cn_bundle_add(b, "huge", CN_F64, 2, (uint64_t[]){ UINT64_MAX, 8 }, bytes3), CN_ERR_USAGE);
    name[63] = 0;
    assert_int_equal(cn_bundle_add(b, name, CN_U8, 1, (uint64_t[]){ 3 }, bytes3), CN_OK);
    assert_int_equal(cn_bundle_set(b, "latin1", "\xe9"), CN_OK);
    assert_int_equal(cn_bundle_write(b, path), CN_ERR_USAGE);
    cn_bundle_destroy(&b);
    assert_int_equal(cn_dtype_size((cn_dtype)99), 0);
}

/* A failed write leaves the old file as it was. */
static void failed_write_keeps_the_old_file(void **state)
{
    (void)state;
    cn_bundle *b = sample();
    char missing[160];
    snprintf(missing, sizeof missing, "%s/absent/a.safetensors", folder);
    assert_int_equal(cn_bundle_write(b, path), CN_OK);
    assert_int_equal(cn_bundle_write(b, missing), CN_ERR_IO);
    assert_non_null(strstr(cn_error_message(), missing));
    assert_int_equal(cn_bundle_set(b, "bad", "\xff"), CN_OK);
    assert_int_equal(cn_bundle_write(b, path), CN_ERR_USAGE);
    cn_bundle_destroy(&b);
    assert_int_equal(cn_bundle_open(&b, path, true), CN_OK);
    cn_bundle_destroy(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(round_trip),           cmocka_unit_test(same_content_same_bytes),
        cmocka_unit_test(follows_the_format),   cmocka_unit_test(empty_bundle),
        cmocka_unit_test(wrong_use_is_refused), cmocka_unit_test(failed_write_keeps_the_old_file),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
