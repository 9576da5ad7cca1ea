/* Buffers that end at an unreadable page: one float too far is a crash, not a silent success. */
#ifndef CONURB_TESTS_GUARD_H
#define CONURB_TESTS_GUARD_H
#include <stddef.h>
typedef struct guarded {
    void *map;
    size_t map_size;
    float *data;
} guarded;
/* n floats whose last one touches the guard page, so the start is only as aligned as n allows. */
guarded guarded_floats(size_t n);
void guarded_free(guarded *g);
/* Uniform in [low, high), from a counter. */
void fill_random(float *x, size_t n, float low, float high, unsigned seed);
#endif
