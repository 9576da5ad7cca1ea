#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <setjmp.h>
#include <cmocka.h>

#include "segment.h"

#include "base/file.h"

#include <stdlib.h>
#include <string.h>

static void insert(const char *path, unsigned char marker, const char *name, size_t name_size, const void *payload,
                   size_t size)
{
    enum { START = 2 };
    const size_t length = 2 + name_size + size;
    const unsigned char head[4] = { 0xff, marker, (unsigned char)(length >> 8), (unsigned char)length };
    assert_true(length <= 65535);
    char *data;
    size_t old;
    assert_int_equal(cn_file_read(path, 0, &data, &old), CN_OK);
    assert_memory_equal(data, "\xff\xd8", START);
    char *all = malloc(old + 2 + length), *at = all;
    assert_non_null(all);
    at = (char *)memcpy(at, data, START) + START;
    at = (char *)memcpy(at, head, sizeof head) + sizeof head;
    at = (char *)memcpy(at, name, name_size) + name_size;
    at = (char *)memcpy(at, payload, size) + size;
    memcpy(at, data + START, old - START);
    assert_int_equal(cn_file_write(path, all, old + 2 + length), CN_OK);
    free(data);
    free(all);
}

void segment_profile(const char *path, const void *profile, size_t size)
{
    insert(path, 0xe2, "ICC_PROFILE\0\1\1", 14, profile, size);
}

void segment_xmp(const char *path, const char *text)
{
    static const char name[] = "http://ns.adobe.com/xap/1.0/"; /* with its NUL */
    insert(path, 0xe1, name, sizeof name, text, strlen(text));
}

/* A little-endian TIFF: its folders first, then what does not fit into an entry. */
typedef struct block {
    unsigned char bytes[4096];
    size_t end; /* of what is used */
} block;

static void put16(block *b, size_t at, uint32_t x)
{
    b->bytes[at] = (unsigned char)x, b->bytes[at + 1] = (unsigned char)(x >> 8);
}
static void put32(block *b, size_t at, uint32_t x)
{
    put16(b, at, x & 0xffff);
    put16(b, at + 2, x >> 16);
}

static void put_entry(block *b, size_t at, const segment_tag *t)
{
    const uint32_t count = t->n_rationals ? t->n_rationals : (uint32_t)strlen(t->text) + 1;
    put16(b, at, t->number);
    put16(b, at + 2, t->n_rationals ? 5 : 2);
    put32(b, at + 4, count);
    const size_t value = count <= 4 && !t->n_rationals ? at + 8 : b->end;
    if (value == b->end) {
        put32(b, at + 8, (uint32_t)value);
        b->end += t->n_rationals ? 8 * count : (count + 1) / 2 * 2;
    }
    assert_true(b->end <= sizeof b->bytes);
    for (uint32_t i = 0; i < t->n_rationals; i++) {
        put32(b, value + 8 * i, t->rationals[i][0]);
        put32(b, value + 8 * i + 4, t->rationals[i][1]);
    }
    if (!t->n_rationals) memcpy(b->bytes + value, t->text, count);
}

static void put_pointer(block *b, size_t at, uint32_t tag, size_t folder)
{
    put16(b, at, tag);
    put16(b, at + 2, 4);
    put32(b, at + 4, 1);
    put32(b, at + 8, (uint32_t)folder);
}

void segment_exif(const char *path, const segment_tag *tags, size_t n)
{
    block b = { .bytes = "II*\0\10" };
    size_t start[3], at[3], count[3] = { 2, 0, 0 };
    for (size_t i = 0; i < n; i++)
        count[tags[i].folder]++;
    for (size_t f = 0, next = 8; f < 3; f++) {
        start[f] = next;
        at[f] = next + 2;
        put16(&b, next, (uint32_t)count[f]);
        b.end = next += 2 + 12 * count[f] + 4;
    }
    for (size_t i = 0; i < n; i++) {
        put_entry(&b, at[tags[i].folder], &tags[i]);
        at[tags[i].folder] += 12;
    }
    put_pointer(&b, at[SEGMENT_IMAGE], 0x8769, start[SEGMENT_PHOTO]);
    put_pointer(&b, at[SEGMENT_IMAGE] + 12, 0x8825, start[SEGMENT_GPS]);
    insert(path, 0xe1, "Exif\0\0", 6, b.bytes, b.end);
}
