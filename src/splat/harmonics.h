/* Real spherical harmonics to degree 2, with the signs of Kerbl et al. 2023. */
#ifndef CONURB_SPLAT_HARMONICS_H
#define CONURB_SPLAT_HARMONICS_H
#include <stdint.h>

enum { CN_HARMONICS_MOST = 9 };
#define CN_HARMONICS_0 0.28209479177387814f

static inline void cn_harmonics(const float d[3], uint32_t degree, float basis[CN_HARMONICS_MOST])
{
    const float x = d[0], y = d[1], z = d[2];
    basis[0] = CN_HARMONICS_0;
    if (degree < 1) return;
    basis[1] = -0.4886025119029199f * y;
    basis[2] = 0.4886025119029199f * z;
    basis[3] = -0.4886025119029199f * x;
    if (degree < 2) return;
    basis[4] = 1.0925484305920792f * x * y;
    basis[5] = -1.0925484305920792f * y * z;
    basis[6] = 0.31539156525252005f * (2 * z * z - x * x - y * y);
    basis[7] = -1.0925484305920792f * x * z;
    basis[8] = 0.5462742152960396f * (x * x - y * y);
}

/* Derivatives of the basis by the direction. */
static inline void cn_harmonics_slope(const float d[3], uint32_t degree, float slope[CN_HARMONICS_MOST][3])
{
    const float x = d[0], y = d[1], z = d[2], a = 1.0925484305920792f, b = 0.31539156525252005f;
    const float table[CN_HARMONICS_MOST][3] = {
        { 0, 0, 0 },
        { 0, -0.4886025119029199f, 0 },
        { 0, 0, 0.4886025119029199f },
        { -0.4886025119029199f, 0, 0 },
        { a * y, a * x, 0 },
        { 0, -a * z, -a * y },
        { -2 * b * x, -2 * b * y, 4 * b * z },
        { -a * z, 0, -a * x },
        { a * x, -a * y, 0 },
    };
    for (uint32_t c = 0; c < (degree + 1) * (degree + 1); c++)
        for (int k = 0; k < 3; k++)
            slope[c][k] = table[c][k];
}
#endif
