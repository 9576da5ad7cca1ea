#include "base/keys.h"

#include "base/rng.h"

#include <stdlib.h>

void cn_keys_deinit(cn_keys *map)
{
    free(map->keys);
    free(map->values);
    *map = (cn_keys){ 0 };
}

uint64_t cn_keys_of_cube(uint64_t seed, const int64_t cube[3])
{
    uint64_t key = seed;
    for (int k = 0; k < 3; k++)
        key = cn_rng_mix(key * UINT64_C(0x9e3779b97f4a7c15) + (uint64_t)cube[k]);
    return key | 1;
}

/* The key's slot, or the empty slot for it. */
static size_t slot_of(const cn_keys *map, uint64_t key)
{
    size_t at = (size_t)cn_rng_mix(key) & (map->room - 1);
    while (map->keys[at] && map->keys[at] != key)
        at = (at + 1) & (map->room - 1);
    return at;
}

static cn_status grow(cn_keys *map)
{
    cn_keys larger = { .n = map->n, .room = map->room ? 2 * map->room : 1024 };
    larger.keys = calloc(larger.room, sizeof *larger.keys);
    larger.values = malloc(larger.room * sizeof *larger.values);
    if (!larger.keys || !larger.values) {
        cn_keys_deinit(&larger);
        return cn_fail(CN_ERR_NOMEM, "out of memory for a table of more than %zu places; give a larger --gsd", map->n);
    }
    for (size_t i = 0; i < map->room; i++) {
        if (!map->keys[i]) continue;
        const size_t to = slot_of(&larger, map->keys[i]);
        larger.keys[to] = map->keys[i];
        larger.values[to] = map->values[i];
    }
    cn_keys_deinit(map);
    *map = larger;
    return CN_OK;
}

cn_status cn_keys_add(cn_keys *map, uint64_t key, uint32_t value, bool *fresh)
{
    *fresh = false;
    if (2 * (map->n + 1) > map->room) CN_TRY(grow(map));
    const size_t at = slot_of(map, key);
    if (map->keys[at]) return CN_OK;
    *fresh = true;
    map->keys[at] = key;
    map->values[at] = value;
    map->n++;
    return CN_OK;
}

uint32_t cn_keys_find(const cn_keys *map, uint64_t key)
{
    if (!map->n) return UINT32_MAX;
    const size_t at = slot_of(map, key);
    return map->keys[at] ? map->values[at] : UINT32_MAX;
}
