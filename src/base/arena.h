/* One aligned block, carved in order. Sized before use, so an estimate is the memory used. */
#ifndef CONURB_BASE_ARENA_H
#define CONURB_BASE_ARENA_H
#include "conurb/base.h"

#define CN_ARENA_ALIGN 64
typedef struct cn_arena {
    unsigned char *base;
    size_t size, used; /* bytes */
    bool counting;
} cn_arena;

/* A counting arena hands out no memory (NULL) and only adds up: run the same carving code twice, first to size, then to
 * carve. A sum past SIZE_MAX stays there, and a block of that size is refused. */
void cn_arena_count(cn_arena *arena);
CN_NODISCARD cn_status cn_arena_init(cn_arena *arena, size_t size); /* zeroed pages; CN_ERR_NOMEM */
void cn_arena_deinit(cn_arena *arena);                              /* fine when zeroed or done already */
/* n items of size bytes, 64-byte aligned, zeroed. Overrunning a sized arena is a bug: returns NULL. */
void *cn_arena_take(cn_arena *arena, size_t n, size_t size);
#define CN_ARENA_NEW(arena, type, n) ((type *)cn_arena_take((arena), (n), sizeof(type)))
#endif
