/* The contraction of mip-NeRF 360 (Barron et al. 2022) in the maximum norm: the box [-1,1]^3 does not change, and the
 * rest of space is mapped into [-2,2]^3. Returns the factor by which a position is multiplied; largest: the largest of
 * its |coordinates|. The vector kernels have the same formula for panels (kernel_simd.h). */
#ifndef CONURB_BASE_CONTRACTION_H
#define CONURB_BASE_CONTRACTION_H

static inline float cn_contraction_float(float largest)
{
    return largest > 1 ? (2 - 1 / largest) / largest : 1;
}

static inline double cn_contraction(double largest)
{
    return largest > 1 ? (2 - 1 / largest) / largest : 1;
}
#endif
