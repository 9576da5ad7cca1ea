#include "export/cubes.h"

#include "base/rng.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

void cn_cubes_init(cn_cubes *cubes, double side_m)
{
    *cubes = (cn_cubes){ .side_m = side_m };
}

void cn_cubes_deinit(cn_cubes *cubes)
{
    free(cubes->keys);
    *cubes = (cn_cubes){ 0 };
}

/* A key: 21 bits per coordinate about the origin, and one bit that is set in every key. */
static uint64_t key_of(const cn_cubes *cubes, const double xyz[3])
{
    uint64_t key = 1;
    for (int k = 0; k < 3; k++) {
        const double cell = fmin(fmax(floor(xyz[k] / cubes->side_m), -1048576), 1048575);
        key = key << 21 | (uint64_t)(cell + 1048576);
    }
    return key;
}

/* The key's slot, or the empty slot for it. */
static size_t slot_of(const cn_cubes *cubes, uint64_t key)
{
    size_t at = (size_t)cn_rng_mix(key) & (cubes->room - 1);
    while (cubes->keys[at] && cubes->keys[at] != key)
        at = (at + 1) & (cubes->room - 1);
    return at;
}

static cn_status grow(cn_cubes *cubes)
{
    cn_cubes larger = { .n = cubes->n, .room = cubes->room ? 2 * cubes->room : 4096, .side_m = cubes->side_m };
    larger.keys = calloc(larger.room, sizeof *larger.keys);
    if (!larger.keys) return cn_fail(CN_ERR_NOMEM, "out of memory for %zu points; give a larger --gsd", cubes->n);
    for (size_t i = 0; i < cubes->room; i++)
        if (cubes->keys[i]) larger.keys[slot_of(&larger, cubes->keys[i])] = cubes->keys[i];
    free(cubes->keys);
    *cubes = larger;
    return CN_OK;
}

cn_status cn_cubes_add(cn_cubes *cubes, const double xyz[3], bool *fresh)
{
    *fresh = false;
    if (2 * (cubes->n + 1) > cubes->room) CN_TRY(grow(cubes));
    const uint64_t key = key_of(cubes, xyz);
    const size_t at = slot_of(cubes, key);
    *fresh = cubes->keys[at] == 0;
    cubes->keys[at] = key;
    cubes->n += *fresh;
    return CN_OK;
}
