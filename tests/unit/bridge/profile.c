#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <setjmp.h>
#include <cmocka.h>

#include "profile.h"

#include "base/file.h"

#include <stdlib.h>
#include <string.h>

void profile_into_jpeg(const char *path, const void *profile, size_t size)
{
    enum { START = 2, HEAD = 18 }; /* marker, length, name and part of the segment */
    const size_t length = size + HEAD - 2;
    unsigned char head[HEAD] = { 0xff, 0xe2, (unsigned char)(length >> 8), (unsigned char)length };
    memcpy(head + 4, "ICC_PROFILE\0\1\1", 14);
    assert_true(length <= 65535);
    char *data;
    size_t old;
    assert_int_equal(cn_file_read(path, 0, &data, &old), CN_OK);
    assert_memory_equal(data, "\xff\xd8", START);
    char *all = malloc(old + HEAD + size);
    assert_non_null(all);
    memcpy(all, data, START);
    memcpy(all + START, head, HEAD);
    memcpy(all + START + HEAD, profile, size);
    memcpy(all + START + HEAD + size, data + START, old - START);
    assert_int_equal(cn_file_write(path, all, old + HEAD + size), CN_OK);
    free(data);
    free(all);
}
