/* One aligned block of memory that is handed out in order. Its size is counted before use, so the estimate is exact. */
#ifndef CONURB_BASE_ARENA_H
#define CONURB_BASE_ARENA_H
#include "conurb/base.h"

#define CN_ARENA_ALIGN 64
typedef struct cn_arena {
    unsigned char *base;
    size_t size, used; /* bytes */
    bool counting;
} cn_arena;

/* A counting arena returns NULL and only adds up sizes. Run the same code twice: first to count, then to allocate. A
 * sum above SIZE_MAX stays at SIZE_MAX, and a block of that size is refused. */
void cn_arena_count(cn_arena *arena);
CN_NODISCARD cn_status cn_arena_init(cn_arena *arena, size_t size); /* zeroed pages; CN_ERR_NOMEM */
void cn_arena_deinit(cn_arena *arena);                              /* safe on a zeroed arena, and twice */
/* n items of size bytes, 64-byte aligned, zeroed. NULL when the arena is full, which is a bug. */
void *cn_arena_take(cn_arena *arena, size_t n, size_t size);
#define CN_ARENA_NEW(arena, type, n) ((type *)cn_arena_take((arena), (n), sizeof(type)))
#endif
