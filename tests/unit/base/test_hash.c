#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>

#include <cmocka.h>

#include "base/file.h"
#include "base/hash.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static void known_values(void **state)
{
    (void)state;
    char hex[17];
    /* XXH3_64bits of nothing, from the algorithm's own test vectors. */
    assert_true(cn_hash64("", 0) == UINT64_C(0x2d06800538d394c2));
    cn_hash_hex(cn_hash64("", 0), hex);
    assert_string_equal(hex, "2d06800538d394c2");
    cn_hash_hex(0x1f, hex);
    assert_string_equal(hex, "000000000000001f");
}

static void file_and_memory_agree(void **state)
{
    (void)state;
    const char *parent = getenv("TMPDIR");
    char *path = cn_format("%s/conurb-hash-%ld", parent && *parent ? parent : "/tmp", (long)getpid());
    const size_t size = 1000003; /* several blocks and a tail */
    unsigned char *data = malloc(size);
    uint64_t hash;
    assert_non_null(data);
    for (size_t i = 0; i < size; i++)
        data[i] = (unsigned char)(i * 131 >> 3);
    assert_int_equal(cn_file_write(path, data, size), CN_OK);
    assert_int_equal(cn_hash_file(path, &hash), CN_OK);
    assert_true(hash == cn_hash64(data, size));
    data[size / 2] ^= 1;
    assert_true(hash != cn_hash64(data, size));
    free(data);
    assert_int_equal(cn_file_remove(path), CN_OK);
    assert_int_equal(cn_hash_file(path, &hash), CN_ERR_IO);
    assert_non_null(strstr(cn_error_message(), path));
    assert_int_equal(cn_hash_file("/", &hash), CN_ERR_IO);
    free(path);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(known_values),
        cmocka_unit_test(file_and_memory_agree),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
