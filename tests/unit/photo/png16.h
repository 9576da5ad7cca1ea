/* Writes an RGBA PNG of 16 bits, which the library itself never writes. */
#ifndef CONURB_TEST_PHOTO_PNG16_H
#define CONURB_TEST_PHOTO_PNG16_H
#include <stdbool.h>
#include <stdint.h>

/* rgba[height][width][4]; at most 8000 pixels a row. False: it cannot be written. */
bool png16_write(const char *path, const uint16_t *rgba, uint32_t width, uint32_t height);
#endif
