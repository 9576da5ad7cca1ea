/* The pixels are kept without compression: one stored block of deflate (RFC 1951) a row. */
#include "png16.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void put(uint8_t *at, uint32_t value)
{
    for (int i = 0; i < 4; i++)
        at[i] = (uint8_t)(value >> (24 - 8 * i));
}

static uint32_t crc(const uint8_t *data, size_t n)
{
    uint32_t c = 0xffffffffu;
    for (size_t i = 0; i < n; i++) {
        c ^= data[i];
        for (int k = 0; k < 8; k++)
            c = c & 1 ? 0xedb88320u ^ c >> 1 : c >> 1;
    }
    return ~c;
}

static void chunk(FILE *file, const char *type, const uint8_t *data, size_t n)
{
    uint8_t number[4], *all = malloc(n + 4);
    if (!all) abort();
    memcpy(all, type, 4);
    if (n) memcpy(all + 4, data, n);
    put(number, (uint32_t)n);
    fwrite(number, 1, 4, file);
    fwrite(all, 1, n + 4, file);
    put(number, crc(all, n + 4));
    fwrite(number, 1, 4, file);
    free(all);
}

bool png16_write(const char *path, const uint16_t *rgba, uint32_t width, uint32_t height)
{
    const size_t row = 8 * (size_t)width + 1;
    uint8_t *data = malloc(height * (row + 5) + 6), *to = data;
    FILE *file = fopen(path, "wb");
    if (!data || !file) abort();
    uint32_t a = 1, b = 0; /* Adler-32 */
    *to++ = 0x78;
    *to++ = 0x01;
    for (uint32_t y = 0; y < height; y++) {
        const uint8_t head[5] = { y + 1 == height, (uint8_t)row, (uint8_t)(row >> 8), (uint8_t)~row,
                                  (uint8_t)(~row >> 8) };
        memcpy(to, head, sizeof head);
        uint8_t *line = to + sizeof head;
        *line = 0;
        for (size_t i = 0; i < 4 * (size_t)width; i++) {
            const uint16_t value = rgba[4 * (size_t)width * y + i];
            line[1 + 2 * i] = (uint8_t)(value >> 8);
            line[2 + 2 * i] = (uint8_t)value;
        }
        for (size_t i = 0; i < row; i++) {
            a = (a + line[i]) % 65521;
            b = (b + a) % 65521;
        }
        to = line + row;
    }
    put(to, b << 16 | a);
    uint8_t head[13] = { 0 };
    put(head, width);
    put(head + 4, height);
    head[8] = 16;
    head[9] = 6;
    fwrite("\x89PNG\r\n\x1a\n", 1, 8, file);
    chunk(file, "IHDR", head, sizeof head);
    chunk(file, "IDAT", data, (size_t)(to - data) + 4);
    chunk(file, "IEND", NULL, 0);
    free(data);
    return fclose(file) == 0;
}
