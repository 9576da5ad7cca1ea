#include "limits.h"

#include "base/arena.h"

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { REPEATS = 15 };
int bench_repeats = REPEATS;
#define MIN_SECONDS 2e-3 /* length of a timed run of calls */

double bench_now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static int by_value(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

double bench_median(void (*run)(void *user), void *user)
{
    double seconds[REPEATS];
    unsigned calls = 1;
    for (int i = -1; i < bench_repeats; i++) {
        const double start = bench_now();
        for (unsigned c = 0; c < calls; c++)
            run(user);
        const double took = bench_now() - start;
        if (i < 0) {
            if (took >= MIN_SECONDS) continue;
            calls *= 2; /* warm up until a run is long enough to time */
            i--;
            continue;
        }
        seconds[i] = took / calls;
    }
    qsort(seconds, (size_t)bench_repeats, sizeof *seconds, by_value);
    return seconds[bench_repeats / 2];
}

static volatile float float_sink;
static volatile uint32_t word_sink;

enum { CHAINS = 12, FMA_ROUNDS = 20000 };

/* CHAINS independent chains of multiply-adds on vectors of WIDTH floats; the empty asm keeps each link. */
#define FMA_CHAINS(NAME, WIDTH, TARGET)                                                                                \
    typedef float NAME##_vector __attribute__((vector_size(4 * (WIDTH))));                                             \
    __attribute__((target(TARGET), optimize("fp-contract=fast"))) static void NAME(void *user)                         \
    {                                                                                                                  \
        (void)user;                                                                                                    \
        NAME##_vector c[CHAINS], a = { 0 }, b = { 0 };                                                                 \
        a += 0.999f;                                                                                                   \
        b += 1e-5f;                                                                                                    \
        _Pragma("GCC unroll 12") for (int i = 0; i < CHAINS; i++) c[i] = b * (float)i;                                 \
        for (int r = 0; r < FMA_ROUNDS; r++)                                                                           \
            _Pragma("GCC unroll 12") for (int i = 0; i < CHAINS; i++)                                                  \
            {                                                                                                          \
                c[i] = c[i] * a + b;                                                                                   \
                __asm__ volatile("" : "+x"(c[i]));                                                                     \
            }                                                                                                          \
        _Pragma("GCC unroll 12") for (int i = 1; i < CHAINS; i++) c[0] += c[i];                                        \
        float_sink = c[0][0];                                                                                          \
    }
#if defined(__x86_64__)
FMA_CHAINS(fma_8, 8, "avx2,fma")
FMA_CHAINS(fma_16, 16, "avx512f,fma")
#endif

static void fma_1(void *user)
{
    (void)user;
    float c[CHAINS];
    for (int i = 0; i < CHAINS; i++)
        c[i] = (float)i;
    for (int r = 0; r < FMA_ROUNDS; r++)
        _Pragma("GCC unroll 12") for (int i = 0; i < CHAINS; i++)
        {
            c[i] = c[i] * 0.999f + 1e-5f;
            __asm__ volatile("" : "+x"(c[i]));
        }
    for (int i = 0; i < CHAINS; i++)
        float_sink = c[i];
}

double bench_fma_peak(const char *set)
{
    int width = 1;
    void (*run)(void *) = fma_1;
#if defined(__x86_64__)
    if (strcmp(set, "avx2") == 0) width = 8, run = fma_8;
    if (strncmp(set, "avx512", 6) == 0) width = 16, run = fma_16;
#endif
    const double flops = 2.0 * width * CHAINS * FMA_ROUNDS, bf16 = strcmp(set, "avx512bf16") == 0 ? 2 : 1;
    return bf16 * flops / bench_median(run, NULL) * 1e-9;
}

static cn_arena block_of(size_t bytes)
{
    cn_arena arena;
    if (cn_arena_init(&arena, bytes) != CN_OK) {
        fprintf(stderr, "%s\n", cn_error_message());
        exit(1);
    }
    memset(arena.base, 1, bytes);
    return arena;
}

enum { STREAM_BYTES = 256 << 20 };
typedef float eight __attribute__((vector_size(32)));

static void add_everywhere(void *user)
{
    eight *x = user;
    const size_t quarter = STREAM_BYTES / 4 / sizeof *x;
    for (size_t i = 0; i < quarter; i++)
        for (size_t k = 0; k < 4; k++)
            x[k * quarter + i] += 1; /* table, state and moments are side by side there too */
}

double bench_stream(void)
{
    cn_arena arena = block_of(STREAM_BYTES);
    const double seconds = bench_median(add_everywhere, arena.base);
    cn_arena_deinit(&arena);
    return 2.0 * STREAM_BYTES / seconds * 1e-9;
}

enum { READS = 1 << 16 };
typedef struct table {
    void *base;
    uint32_t mask;
} table;

/* Reads do not depend on each other, so that the processor can do as many at once as it is able to. */
static uint32_t scatter(uint32_t i)
{
    i *= 2654435769u;
    i ^= i >> 15;
    return i * 2246822519u >> 8;
}

static void read_at_random(void *user)
{
    const table *t = user;
    const uint32_t *words = t->base;
    uint32_t sum = 0;
    for (uint32_t i = 0; i < READS; i++)
        sum += words[scatter(i) & t->mask];
    word_sink = sum;
}

static void update_at_random(void *user)
{
    const table *t = user;
    typedef float pair __attribute__((vector_size(8)));
    pair *pairs = t->base;
    for (uint32_t i = 0; i < READS; i++)
        pairs[scatter(i) & t->mask] += (pair){ 1, 1 };
}

static double at_random(void (*run)(void *), size_t bytes, size_t item)
{
    size_t items = 1;
    while (2 * items * item <= bytes)
        items *= 2;
    cn_arena arena = block_of(bytes < 4096 ? 4096 : bytes);
    table t = { arena.base, (uint32_t)(items - 1) };
    const double seconds = bench_median(run, &t);
    cn_arena_deinit(&arena);
    return seconds / READS * 1e9;
}

double bench_random_read(size_t bytes)
{
    return at_random(read_at_random, bytes, 4);
}
double bench_random_update(size_t bytes)
{
    return at_random(update_at_random, bytes, 8);
}
