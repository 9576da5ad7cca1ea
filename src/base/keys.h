/* A hash map from 64-bit keys to 32-bit values. One thread at a time may add; many may look up meanwhile when none
 * adds. */
#ifndef CONURB_BASE_KEYS_H
#define CONURB_BASE_KEYS_H
#include "conurb/base.h"

typedef struct cn_keys {
    uint64_t *keys; /* 0: an empty slot */
    uint32_t *values;
    size_t n, room;
} cn_keys;
/* A zeroed map is empty. */
void cn_keys_deinit(cn_keys *map);
/* Adds a key that is not 0. *fresh: it was not in the map; else its old value stays. 24 bytes per key at most.
 * CN_ERR_NOMEM: the message says how many keys there are. */
CN_NODISCARD cn_status cn_keys_add(cn_keys *map, uint64_t key, uint32_t value, bool *fresh);
/* The key's value; UINT32_MAX when it is not in the map. */
uint32_t cn_keys_find(const cn_keys *map, uint64_t key);
/* A key for a cube of a lattice; those of another kind have another seed. Never 0. */
uint64_t cn_keys_of_cube(uint64_t seed, const int64_t cube[3]);
#endif
