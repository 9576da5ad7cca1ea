#include "guard.h"

#include "base/rng.h"

#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

guarded guarded_floats(size_t n)
{
    const size_t page = (size_t)sysconf(_SC_PAGESIZE), bytes = n * sizeof(float);
    const size_t body = (bytes + page - 1) / page * page;
    guarded g = { .map_size = body + page };
    g.map = mmap(NULL, g.map_size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (g.map == MAP_FAILED || mprotect((char *)g.map + body, page, PROT_NONE) != 0) abort();
    g.data = (float *)(void *)((char *)g.map + body - bytes);
    return g;
}

void guarded_free(guarded *g)
{
    munmap(g->map, g->map_size);
}

void fill_random(float *x, size_t n, float low, float high, unsigned seed)
{
    for (size_t i = 0; i < n; i++)
        x[i] = low + (high - low) * cn_rng_float(seed, 99, i);
}
