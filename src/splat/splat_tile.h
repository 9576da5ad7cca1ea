/* Compositing Gaussians in one tile of a picture, forwards and backwards (Kerbl et al. 2023, section 6). The plain
 * version is the reference; the others are compiled from splat_tile_simd.h, one for each instruction set. */
#ifndef CONURB_SPLAT_SPLAT_TILE_H
#define CONURB_SPLAT_SPLAT_TILE_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { CN_SPLAT_TILE = 16, CN_SPLAT_TILE_PIXELS = CN_SPLAT_TILE * CN_SPLAT_TILE };
#define CN_SPLAT_MOST_ALPHA 0.99f
#define CN_SPLAT_LEAST_LIGHT 1e-4f /* a pixel ends when less passes through */

/* A Gaussian in the picture: alpha = opacity * exp(-(a dx^2 + c dy^2) / 2 - b dx dy), in pixels from x, y. */
typedef struct cn_flat_splat {
    float x, y, a, b, c, opacity, rgb[3], depth;
    int16_t box[4]; /* the pixels where alpha may reach the least that counts: x, y, and where they end */
    uint32_t first; /* of its slots: one for each tile of the picture that the box touches, row by row */
    uint32_t pad[3];
} cn_flat_splat;

/* Sums over the pixels of one tile, from which a Gaussian's gradients follow. p: the gradient of the exponent. */
enum { CN_SUM_P, CN_SUM_P_X, CN_SUM_P_XX, CN_SUM_P_Y, CN_SUM_P_XY, CN_SUM_P_YY, CN_SUM_RED };
enum { CN_SUM_WEIGHT = CN_SUM_RED + 3, CN_SPLAT_SUMS };

/* What a tile is made of. pixels and gradient are [4][16][16]: red, green, blue, and the light that passes through. */
typedef struct cn_splat_tile {
    const cn_flat_splat *flats;
    const uint32_t *list; /* of flats, front to back */
    uint32_t n;
    int32_t x, y;      /* of its first pixel; multiples of CN_SPLAT_TILE */
    float least_alpha; /* what covers less is left out */
    float *pixels;
    const float *gradient;         /* of the loss by pixels; backward only */
    float (*slots)[CN_SPLAT_SUMS]; /* backward only */
} cn_splat_tile;

typedef struct cn_splat_kernel {
    const char *name;
    void (*forward)(const cn_splat_tile *tile);  /* fills pixels */
    void (*backward)(const cn_splat_tile *tile); /* reads pixels; fills the slot of each Gaussian of the list */
} cn_splat_kernel;

extern const cn_splat_kernel cn_splat_kernel_ref;
bool cn_splat_kernel_fill_avx2(cn_splat_kernel *kernel);
bool cn_splat_kernel_fill_avx512(cn_splat_kernel *kernel);
bool cn_splat_kernel_fill_neon(cn_splat_kernel *kernel);
/* All that this processor can run, the reference first; at most 3. Returns how many. */
int cn_splat_kernels(const cn_splat_kernel *sets[3]);
const cn_splat_kernel *cn_splat_kernel_best(void); /* or the one that $CONURB_CPU names */

/* The tiles that a box touches: the first along x and y, and how many. */
typedef struct cn_tile_range {
    uint32_t x, y, width, height;
} cn_tile_range;
static inline cn_tile_range cn_tile_range_of(const int16_t box[4])
{
    const uint32_t x = (uint32_t)box[0] / CN_SPLAT_TILE, y = (uint32_t)box[1] / CN_SPLAT_TILE;
    return (cn_tile_range){ x, y, ((uint32_t)box[2] + CN_SPLAT_TILE - 1) / CN_SPLAT_TILE - x,
                            ((uint32_t)box[3] + CN_SPLAT_TILE - 1) / CN_SPLAT_TILE - y };
}
static inline float *cn_splat_slot(const cn_splat_tile *t, const cn_flat_splat *f)
{
    const cn_tile_range r = cn_tile_range_of(f->box);
    const uint32_t x = (uint32_t)t->x / CN_SPLAT_TILE - r.x, y = (uint32_t)t->y / CN_SPLAT_TILE - r.y;
    return t->slots[f->first + (size_t)y * r.width + x];
}
/* The part of a box that lies in the tile, in its pixels. */
static inline void cn_splat_part(const cn_splat_tile *t, const int16_t box[4], int32_t part[4])
{
    part[0] = box[0] > t->x ? box[0] - t->x : 0;
    part[1] = box[1] > t->y ? box[1] - t->y : 0;
    part[2] = box[2] < t->x + CN_SPLAT_TILE ? box[2] - t->x : CN_SPLAT_TILE;
    part[3] = box[3] < t->y + CN_SPLAT_TILE ? box[3] - t->y : CN_SPLAT_TILE;
}
#endif
