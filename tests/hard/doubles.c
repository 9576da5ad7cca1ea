#include "doubles.h"

#include <math.h>

double_corners double_corners_of(const cn_level *level, const float pos[3])
{
    double_corners out;
    uint32_t cell[3];
    double f[3];
    for (int a = 0; a < 3; a++) {
        const double x = fmin(fmax((double)pos[a], 0), 1) * level->resolution + 0.5;
        cell[a] = (uint32_t)floor(x);
        f[a] = x - floor(x);
    }
    for (uint32_t i = 0; i < 8; i++) {
        const uint32_t x = cell[0] + (i & 1), y = cell[1] + (i >> 1 & 1), z = cell[2] + (i >> 2),
                       side = level->resolution + 2;
        const uint32_t brick = (x / 4) ^ (y / 2 * 2654435761u) ^ (z / 2 * 805459861u),
                       within = x % 2 + 2 * (y % 2) + 4 * (z % 2) + 8 * (x / 2 % 2);
        out.index[i] = level->hashed ? (16 * brick + within) % level->entries : x + side * (y + side * z);
        out.weight[i] = ((i & 1) ? f[0] : 1 - f[0]) * ((i & 2) ? f[1] : 1 - f[1]) * ((i & 4) ? f[2] : 1 - f[2]);
    }
    return out;
}

double double_contract(const double x[3], double u[3])
{
    const double m = fmax(fabs(x[0]), fmax(fabs(x[1]), fabs(x[2]))), s = m > 1 ? (2 - 1 / m) / m : 1;
    for (int a = 0; a < 3; a++)
        u[a] = x[a] * s / 4 + 0.5;
    return s;
}
