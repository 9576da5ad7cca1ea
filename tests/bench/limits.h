/* Measures the best that this processor can do on one thread. The field's kernels are compared with it. */
#ifndef CONURB_BENCH_LIMITS_H
#define CONURB_BENCH_LIMITS_H
#include <stdbool.h>
#include <stddef.h>

/* Seconds of processor time of this thread. Other programs do not count. */
double bench_now(void);

/* Lines of the cache that a cell's eight corners fall into, on average: of the table (16 entries a line) and of its
 * gradients (8 a line). Hashed levels keep bricks of neighbours together, others only neighbours along x. The four
 * corners of a permutohedral lattice lie in four lines, of either. */
static inline double bench_lines(bool hashed)
{
    return hashed ? 1.25 * 1.5 * 1.5 : 4 * (1 + 1 / 16.0);
}
static inline double bench_gradient_lines(bool hashed)
{
    return hashed ? 1.5 * 1.5 * 1.5 : 4 * (1 + 1 / 8.0);
}

/* Number of timed runs of a median: at most 15, which is the default. */
extern int bench_repeats;

/* The median seconds of one call of run(user), over enough calls to measure it. */
double bench_median(void (*run)(void *user), void *user);

/* Multiply-adds in registers, GFLOP/s, at the vector width of the named kernel set (scalar for ref). */
double bench_fma_peak(const char *set);
/* Bytes read plus written a second, GB/s, changing a block far larger than the caches where it lies, as Adam does. */
double bench_stream(void);
/* Nanoseconds for one of many independent random 4-byte reads in a table of so many bytes. */
double bench_random_read(size_t bytes);
/* The same for 8-byte read-modify-writes. */
double bench_random_update(size_t bytes);
#endif
