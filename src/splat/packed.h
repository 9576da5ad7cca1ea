/* Gaussians in few bytes, for the page that a browser opens: chunks that are shown as they come, the most important
 * Gaussians of the whole scene first, with their colours under one or more lights.
 *
 * A chunk, little-endian. n Gaussians in blocks of 256 (the last one may be shorter) that lie close together:
 *
 *   0   4 bytes   "CNSP"
 *   4   uint16    1: the version
 *   6   uint8     degree of the first light's spherical harmonics: 0 or 1
 *   7   uint8     lights: 1 or more
 *   8   uint32    n
 *   12  float     a: natural logarithm of the smallest standard deviation, metres
 *   16  float     b: a step of it
 *   20  float     h: the largest coefficient of degree 1
 *   24  uint32    256: Gaussians in a block
 *   28  uint32    0
 *   32  float     [blocks][6]: the lowest x, y and z of a block's centres, and a step along each, local metres
 *       uint32    [n]: rotation. Bits 30 and 31: which of w x y z is the largest, and positive. The others follow in
 *                 that order in 10 bits each, from bit 0: q = (v / 1023 - 0.5) * sqrt(2)
 *       uint16    [n][3]: centre = lowest + v * step
 *       uint8     [n][3]: standard deviation = exp(a + b * v)
 *       uint8     [n]: opacity = v / 255
 *       uint8     [lights][n][3]: display-referred sRGB = v / 255; of the first light without degree 1
 *       int8      [n][3][3] with degree 1: coefficients = h * v / 127, by coefficient, then channel
 */
#ifndef CONURB_SPLAT_PACKED_H
#define CONURB_SPLAT_PACKED_H
#include "conurb/splat.h"

enum { CN_PACKED_BLOCK = 256, CN_PACKED_HEADER = 32, CN_PACKED_LIGHTS = 16 };

/* What to pack. Borrowed. */
typedef struct cn_packing {
    const cn_splats *splats;
    uint32_t n_lights;                      /* 1 to CN_PACKED_LIGHTS */
    uint8_t (*lights[CN_PACKED_LIGHTS])[3]; /* [splats->n] each: display-referred sRGB */
    uint32_t degree;                        /* 0, or 1 where the splats have it */
    float harmonics;                        /* the largest coefficient of degree 1 */
} cn_packing;
/* The largest coefficient of degree 1; 0 without. */
float cn_packing_harmonics(const cn_splats *splats);
/* Bytes of a chunk of n. */
size_t cn_packed_size(uint32_t n, uint32_t n_lights, uint32_t degree);
/* One chunk of the n Gaussians that `which` lists; their order in the chunk is another one, which it also gets. *bytes
 * has cn_packed_size bytes, and the caller frees it. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_packed_make(const cn_packing *packing, uint32_t *which, uint32_t n, uint8_t **bytes);

/* An order in which any first part shows the whole scene: a weighted sample without replacement (Efraimidis and
 * Spirakis 2006), with the opacity times the size of the Gaussian, as it looks
 * from the middle of the scene, as weight. The caller frees *order, [splats->n].
 * The same splats give the same order. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_splats_rank(const cn_splats *splats, uint32_t **order);
/* Those n that `which` lists, n from 1, as splats of their own, `grow` times as large. The caller destroys *out. */
CN_NODISCARD cn_status cn_splats_take(const cn_splats *splats, const uint32_t *which, size_t n, float grow,
                                      cn_splats **out);
/* How much n splats have to grow in place of `all`, so that surfaces stay closed: the square root of the part that is
 * missing, up to 2. */
float cn_splats_growth(size_t all, size_t n);
#endif
