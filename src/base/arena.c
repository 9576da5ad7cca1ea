#include "base/arena.h"

#include <sys/mman.h>

#define HUGE_FROM ((size_t)4 << 20) /* bytes above which huge pages are worth it */

static size_t mapped_size(size_t size)
{
    return size ? size : 1;
}

void cn_arena_count(cn_arena *arena)
{
    *arena = (cn_arena){ .counting = true };
}

cn_status cn_arena_init(cn_arena *arena, size_t size)
{
    *arena = (cn_arena){ 0 };
    /* Mapped, not allocated: pages are zeroed, and only those that are used take memory. */
    void *base = mmap(NULL, mapped_size(size), PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (base == MAP_FAILED)
        return cn_fail(CN_ERR_NOMEM,
                       "out of memory: a block of %.1f MiB was refused; train smaller tiles or a lower "
                       "quality, or use a machine with more memory",
                       (double)size / 1048576.0);
    /* A hash grid is read at random over tens of megabytes: with small pages most of that time goes into page walks.
     * Advice only. */
    if (size >= HUGE_FROM) (void)madvise(base, size, MADV_HUGEPAGE);
    arena->base = base;
    arena->size = size;
    return CN_OK;
}

void cn_arena_deinit(cn_arena *arena)
{
    if (arena->base) munmap(arena->base, mapped_size(arena->size));
    *arena = (cn_arena){ 0 };
}

void *cn_arena_take(cn_arena *arena, size_t n, size_t size)
{
    size_t bytes;
    bool overflow = __builtin_mul_overflow(n, size, &bytes) || bytes > SIZE_MAX - (CN_ARENA_ALIGN - 1);
    if (!overflow) bytes = (bytes + CN_ARENA_ALIGN - 1) / CN_ARENA_ALIGN * CN_ARENA_ALIGN;
    if (arena->counting) {
        /* A sum that does not fit stays at SIZE_MAX; a block of that size is then refused. */
        if (overflow || __builtin_add_overflow(arena->used, bytes, &arena->used)) arena->used = SIZE_MAX;
        return NULL;
    }
    if (overflow || !arena->base || bytes > arena->size - arena->used) return NULL;
    void *taken = arena->base + arena->used;
    arena->used += bytes;
    return taken;
}
