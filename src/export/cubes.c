#include "export/cubes.h"

#include <math.h>

void cn_cubes_init(cn_cubes *cubes, double side_m)
{
    *cubes = (cn_cubes){ .side_m = side_m };
}

void cn_cubes_deinit(cn_cubes *cubes)
{
    cn_keys_deinit(&cubes->taken);
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

cn_status cn_cubes_add(cn_cubes *cubes, const double xyz[3], bool *fresh)
{
    return cn_keys_add(&cubes->taken, key_of(cubes, xyz), 0, fresh);
}
