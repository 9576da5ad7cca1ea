/* Damaged and malicious bundles: each is refused with a message that names the file. */
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

static char folder[] = "/tmp/conurb-hostile-XXXXXX";
static char path[128];

static int make_folder(void **state)
{
    (void)state;
    if (!mkdtemp(folder)) return -1;
    snprintf(path, sizeof path, "%s/t.safetensors", folder);
    return 0;
}

static int remove_folder(void **state)
{
    (void)state;
    unlink(path);
    return rmdir(folder);
}

/* Writes length, header and n_data zero bytes; length 0: the header's own. */
static void put(uint64_t length, const char *header, size_t n_data)
{
    FILE *f = fopen(path, "wb");
    assert_non_null(f);
    if (!length) length = strlen(header);
    assert_int_equal(fwrite(&length, sizeof length, 1, f), 1);
    assert_int_equal(fwrite(header, 1, strlen(header), f), strlen(header));
    for (size_t i = 0; i < n_data; i++)
        assert_int_equal(fputc(0, f), 0);
    assert_int_equal(fclose(f), 0);
}

static cn_status open_status(bool verify)
{
    cn_bundle *b = NULL;
    const cn_status status = cn_bundle_open(&b, path, verify);
    if (status != CN_OK) {
        assert_null(b);
        assert_non_null(strstr(cn_error_message(), path));
    }
    cn_bundle_destroy(&b);
    return status;
}

static void refused(const char *header, size_t n_data, const char *why)
{
    put(0, header, n_data);
    const cn_status status = open_status(true);
    if (status != CN_ERR_FORMAT) print_error("taken though it should not be: %s\n", header);
    assert_int_equal(status, CN_ERR_FORMAT);
    if (!strstr(cn_error_message(), why)) print_error("'%s' does not say '%s'\n", cn_error_message(), why);
    assert_non_null(strstr(cn_error_message(), why));
}

#define T(dtype, shape, begin, end)                                                                                    \
    "{\"dtype\":\"" dtype "\",\"shape\":" shape ",\"data_offsets\":[" #begin "," #end "]}"

static void headers(void **state)
{
    (void)state;
    refused("[1,2,3]", 0, "begin with '{'");
    refused(" {\"a\":1}", 0, "begin with '{'");
    refused("{\"a\":", 0, "not valid JSON");
    refused("{} x", 0, "not valid JSON");
    refused("{\"a\":1}", 0, "must have exactly dtype");
    refused("{\"a\":" T("F32", "[1]", 0, 4) ",\"a\":" T("F32", "[1]", 0, 4) "}", 4, "not valid JSON");
    refused("{\"\xff\":" T("F32", "[1]", 0, 4) "}", 4, "not valid JSON");
    refused("{\"\":" T("F32", "[1]", 0, 4) "}", 4, "1 to 63");
    refused("{\"0123456789012345678901234567890123456789012345678901234567890123\":" T("F32", "[1]", 0, 4) "}", 4,
            "1 to 63");
    refused("{\"__metadata__\":[]}", 0, "not an object");
    refused("{\"__metadata__\":{\"k\":1}}", 0, "not a string");
    refused("{\"__metadata__\":{\"k\":{\"k\":\"v\"}}}", 0, "not a string");
    refused("{\"__metadata__\":{\"checksum\":\"0123456789abcdef\"},\"a\":" T("F32", "[1]", 0, 4) "}", 4, "checksum");
}

static void tensors(void **state)
{
    (void)state;
    refused("{\"a\":" T("C64", "[1]", 0, 8) "}", 8, "C64");
    refused("{\"a\":{\"dtype\":\"F32\",\"shape\":[1]}}", 4, "must have exactly dtype");
    refused("{\"a\":{\"dtype\":\"F32\",\"shape\":[1],\"data_offsets\":[0,4],\"x\":1}}", 4, "must have exactly dtype");
    refused("{\"a\":{\"dtype\":4,\"shape\":[1],\"data_offsets\":[0,4]}}", 4, "must have exactly dtype");
    refused("{\"a\":{\"dtype\":\"F32\",\"shape\":[1],\"data_offsets\":[0,4,8]}}", 4, "must have exactly dtype");
    refused("{\"a\":" T("F32", "[1,1,1,1,1]", 0, 4) "}", 4, "5 dimensions");
    refused("{\"a\":" T("F32", "[-1]", 0, 4) "}", 4, "whole numbers");
    refused("{\"a\":" T("F32", "[1.0]", 0, 4) "}", 4, "whole numbers");
    refused("{\"a\":" T("F32", "[\"1\"]", 0, 4) "}", 4, "whole numbers");
    refused("{\"a\":" T("F32", "[4294967296,4294967296]", 0, 4) "}", 4, "overflows");
    refused("{\"a\":" T("F32", "[9223372036854775807]", 0, 4) "}", 4, "overflows");
    /* A product that wraps round to 4 in 64 bits. */
    refused("{\"a\":" T("U8", "[4611686018427387905,4]", 0, 4) "}", 4, "overflows");
    refused("{\"a\":" T("F32", "[99999999999999999999]", 0, 4) "}", 4, "not valid JSON");
    refused("{\"a\":" T("F32", "[2]", 0, 4) "}", 4, "its shape needs 8");
}

static void places(void **state)
{
    (void)state;
    refused("{\"a\":" T("F32", "[1]", 0, 4) "}", 3, "outside the file");
    refused("{\"a\":" T("F32", "[1]", 4, 0) "}", 4, "outside the file");
    refused("{\"a\":" T("F32", "[1]", -4, 0) "}", 4, "outside the file");
    refused("{\"a\":" T("F32", "[1]", 9223372036854775804, 9223372036854775807) "}", 4, "outside the file");
    refused("{\"a\":" T("F32", "[1]", 4, 8) "}", 8, "gap");
    refused("{\"a\":" T("F32", "[1]", 0, 4) "}", 8, "8 bytes of data");
    refused("{\"a\":" T("F32", "[2]", 0, 8) ",\"b\":" T("F32", "[2]", 4, 12) "}", 12, "overlaps");
    refused("{\"a\":" T("F32", "[2]", 0, 8) ",\"b\":" T("F32", "[2]", 0, 8) "}", 8, "overlaps");
    refused("{\"a\":" T("F32", "[1]", 0, 4) ",\"b\":" T("F32", "[1]", 8, 12) "}", 12, "gap");
}

static void lengths(void **state)
{
    (void)state;
    put(UINT64_MAX, "{}", 0);
    assert_int_equal(open_status(true), CN_ERR_FORMAT);
    put((UINT64_C(100) << 20) + 1, "{}", 0);
    assert_int_equal(open_status(true), CN_ERR_FORMAT);
    assert_non_null(strstr(cn_error_message(), "100 MiB"));
    put(100, "{}", 0);
    assert_int_equal(open_status(true), CN_ERR_FORMAT);
    put(1, "{}", 0);
    assert_int_equal(open_status(true), CN_ERR_FORMAT);
    assert_int_equal(cn_file_write(path, "", 0), CN_OK);
    assert_int_equal(open_status(true), CN_ERR_FORMAT);
    cn_bundle *b;
    assert_int_equal(cn_bundle_open(&b, folder, true), CN_ERR_IO);
    assert_int_equal(cn_bundle_open(&b, "/nonexistent/t.safetensors", true), CN_ERR_IO);
}

/* Deep nesting must be refused, and must not exhaust the stack. */
static void deep_nesting(void **state)
{
    (void)state;
    enum { DEPTH = 200000 };
    char *header = malloc(DEPTH + 16);
    assert_non_null(header);
    memcpy(header, "{\"a\":", 5);
    memset(header + 5, '[', DEPTH);
    header[5 + DEPTH] = 0;
    put(0, header, 0);
    free(header);
    assert_int_equal(open_status(true), CN_ERR_FORMAT);
}

/* Files that other writers make: order in the header is free, the data section may start anywhere. */
static void foreign_files_are_read(void **state)
{
    (void)state;
    cn_bundle *b = NULL;
    put(0, "{\"b\":" T("F64", "[1]", 4, 12) ",\"a\":" T("F32", "[]", 0, 4) ",\"e\":" T("U8", "[0]", 12, 12) "} ", 12);
    assert_int_equal(cn_bundle_open(&b, path, true), CN_OK);
    assert_string_equal(cn_bundle_at(b, 0)->name, "a");
    const cn_tensor *t = cn_bundle_find(b, "b");
    assert_int_equal((uintptr_t)t->data % 8, 0);
    assert_true(*(const double *)t->data == 0);
    cn_bundle_destroy(&b);
}

static void write_tiny(char **data, size_t *size)
{
    static const float value[3] = { 1, 2, 3 };
    cn_bundle *b = NULL;
    assert_int_equal(cn_bundle_create(&b), CN_OK);
    assert_int_equal(cn_bundle_add(b, "v", CN_F32, 1, (uint64_t[]){ 3 }, value), CN_OK);
    assert_int_equal(cn_bundle_set(b, "k", "v"), CN_OK);
    assert_int_equal(cn_bundle_write(b, path), CN_OK);
    cn_bundle_destroy(&b);
    assert_int_equal(cn_file_read(path, 0, data, size), CN_OK);
}

static void put_bytes(const char *data, size_t size)
{
    FILE *f = fopen(path, "wb");
    assert_non_null(f);
    assert_int_equal(fwrite(data, 1, size, f), size);
    assert_int_equal(fclose(f), 0);
}

static void truncation_at_every_byte(void **state)
{
    (void)state;
    char *data;
    size_t size;
    write_tiny(&data, &size);
    for (size_t n = 0; n < size; n++) {
        put_bytes(data, n);
        assert_int_equal(open_status(true), CN_ERR_FORMAT);
        assert_int_equal(open_status(false), CN_ERR_FORMAT);
    }
    free(data);
}

/* A flipped bit in the data is found by the checksum. One in the header may change a name and nothing else, but never
 * crashes. */
static void every_flipped_bit(void **state)
{
    (void)state;
    char *data;
    size_t size;
    write_tiny(&data, &size);
    uint64_t length;
    memcpy(&length, data, sizeof length);
    for (size_t bit = 0; bit < 8 * size; bit++) {
        data[bit / 8] ^= (char)(1 << bit % 8);
        put_bytes(data, size);
        const cn_status status = open_status(true);
        if (bit / 8 >= 8 + length)
            assert_int_equal(status, CN_ERR_FORMAT);
        else
            assert_true(status == CN_OK || status == CN_ERR_FORMAT);
        data[bit / 8] ^= (char)(1 << bit % 8);
    }
    free(data);
}

static void tile_wants_its_metadata(void **state)
{
    (void)state;
    char *data;
    size_t size;
    cn_tile *tile = NULL;
    write_tiny(&data, &size);
    free(data);
    assert_int_equal(cn_tile_open(&tile, path), CN_ERR_FORMAT);
    assert_null(tile);
    assert_non_null(strstr(cn_error_message(), "not a tile"));
    put(0, "{\"__metadata__\":{\"conurb.tile\":\"{\\\"format\\\":99}\"}}", 0);
    assert_int_equal(cn_tile_open(&tile, path), CN_ERR_VERSION);
    assert_null(tile);
}

/* Skies of format 2 are no longer drawn. */
static void a_sky_of_format_2_is_refused(void **state)
{
    (void)state;
    cn_tile *tile = NULL;
    put(0, "{\"__metadata__\":{\"conurb.tile\":\"{\\\"format\\\":2,\\\"effects\\\":[\\\"sky\\\"]}\"}}", 0);
    assert_int_equal(cn_tile_open(&tile, path), CN_ERR_VERSION);
    assert_non_null(strstr(cn_error_message(), "train it again"));
    assert_null(tile);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(headers),
        cmocka_unit_test(tensors),
        cmocka_unit_test(places),
        cmocka_unit_test(lengths),
        cmocka_unit_test(deep_nesting),
        cmocka_unit_test(foreign_files_are_read),
        cmocka_unit_test(truncation_at_every_byte),
        cmocka_unit_test(every_flipped_bit),
        cmocka_unit_test(tile_wants_its_metadata),
        cmocka_unit_test(a_sky_of_format_2_is_refused),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
