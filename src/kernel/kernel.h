/* Kernels of the field: one table of function pointers for each instruction set. kernel_ref.c (the scalar reference)
 * fills every entry; the other sets override entries. An entry takes raw pointers and sizes, does not allocate, cannot
 * fail and keeps no state.
 *
 * Panels: samples are stored in panels of CN_PANEL lanes. A matrix of F rows over n samples is
 * data[panel][row][CN_PANEL]. A panel's activations are contiguous, and every vector width up to 16 floats divides a
 * row. Buffers are 64-byte aligned unless an entry says otherwise. Lanes past the last sample hold finite values
 * (zeros), and are computed too.
 *
 * Grid: level l has R cells along each axis of the unit cube. It is shifted by half a cell, so that levels do not
 * share vertices: vertex coordinates are pos * R + 0.5, with R + 2 vertices per axis. A level whose vertices do not
 * fit the table is hashed (Mueller et al. 2022, "Instant Neural Graphics Primitives", section 3). It is hashed in
 * bricks of 4 x 2 x 2 vertices that are contiguous: a brick is one cache line, and the eight corners of a cell lie in
 * 2.8 lines on average instead of 4.25. A vertex has two features, stored as two bfloat16 in one 32-bit word (the
 * first in the low half), so a corner is one load. */
#ifndef CONURB_KERNEL_KERNEL_H
#define CONURB_KERNEL_KERNEL_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define CN_PANEL 48
#define CN_MAX_LEVELS 24
#define CN_OCC_RES 128 /* cells of the occupancy grid along an axis of contracted space */
#define CN_OCC_CELLS ((size_t)CN_OCC_RES * CN_OCC_RES * CN_OCC_RES)

typedef struct cn_level {
    uint32_t resolution; /* cells along an axis */
    uint32_t entries;    /* vertices in the table; a power of two when hashed */
    uint32_t offset;     /* first entry of the level in the whole table */
    bool hashed;
} cn_level;

/* One axis's part of the index of a hashed vertex. The three parts are xored, and the low bits are the index. Within a
 * brick, the 2 x 2 x 2 vertices whose gradients share a cache line come first. */
static inline uint32_t cn_hash_x(uint32_t x)
{
    return (x >> 2) << 4 | (x & 1) | (x & 2) << 2;
}
static inline uint32_t cn_hash_y(uint32_t y)
{
    return ((y >> 1) * 2654435761u) << 4 | (y & 1) << 1;
}
static inline uint32_t cn_hash_z(uint32_t z)
{
    return ((z >> 1) * 805459861u) << 4 | (z & 1) << 2;
}
/* Entry of a vertex in its level. */
static inline uint32_t cn_level_entry(const cn_level *level, uint32_t x, uint32_t y, uint32_t z)
{
    if (level->hashed) return (cn_hash_x(x) ^ cn_hash_y(y) ^ cn_hash_z(z)) & (level->entries - 1);
    const uint32_t side = level->resolution + 2;
    return x + side * (y + side * z);
}

/* A ray in box units: metres relative to the tile's centre, divided by the box's half extent along each axis. t stays
 * in metres. */
typedef struct cn_box_ray {
    float origin[3], dir[3];
} cn_box_ray;

typedef struct cn_march {
    float near_t, far_t; /* 0 < near_t */
    float ratio;         /* t grows by this factor per step, > 1 */
    float jitter;        /* [0, 1): t_k = near_t * ratio^(k + jitter) */
} cn_march;

typedef struct cn_adam {
    float rate; /* learning rate with the bias correction folded in */
    float beta1, beta2, epsilon;
    float decay;     /* L2 regularisation, added to the gradient; only for `adam` */
    uint32_t dither; /* 0 to 65535, different in each step: see adam_table */
} cn_adam;

/* Entries first to first + count of a level. */
typedef struct cn_range {
    uint32_t first, count;
} cn_range;

/* Optimiser state of the table's parameters, in blocks of 16: the low halves of the float values, then the moments m
 * and v as bfloat16. The table itself holds the high halves, rounded to nearest. Together they give the full float, at
 * 8 bytes per parameter in all. */
enum { CN_STATE_BLOCK = 48, CN_STATE_M = 16, CN_STATE_V = 32 };
enum { CN_TOUCH = 8 }; /* entries: a block of state, a line of gradients, 2 x 2 x 2 vertices of a hashed level */
static inline uint16_t *cn_state_at(uint16_t *state, size_t parameter)
{
    return state + parameter / 16 * CN_STATE_BLOCK + parameter % 16;
}

/* Weights a[k][m]. */
typedef struct cn_matrix {
    const float *a;
    uint32_t m, k;
} cn_matrix;

/* n rows of each panel; panels lie `stride` floats apart. */
typedef struct cn_panel_rows {
    const float *data;
    size_t stride;
    uint32_t n;
} cn_panel_rows;

/* From gradients of features to those of entries. */
typedef struct cn_encode_gradient {
    const float *pos;   /* [panel][3][lane] in [0,1] */
    const float *d_enc; /* from panel 0 on; panels lie `stride` floats apart */
    size_t stride, n_panels;
    const cn_range *range;
    float *grad;      /* of the entries of the range; added to */
    uint8_t *touched; /* see cn_kernel.encode_backward; NULL */
} cn_encode_gradient;

/* How long a sample is: step metres * t, and inv_extent (1 / mean half extent) box units a metre. */
typedef struct cn_spacing {
    float step, inv_extent;
} cn_spacing;

/* Lanes first.. of pos[panel][3][lane]. */
typedef struct cn_lanes {
    float *pos;
    size_t first;
} cn_lanes;

/* A window of one picture, for comparing with others: samples at pixels x, y (centres at .5), their values, and
 * weights. Samples of no weight fill it up to whole vectors. */
enum { CN_WINDOW = 32 };
typedef struct cn_window {
    float x[CN_WINDOW], y[CN_WINDOW], value[CN_WINDOW], weight[CN_WINDOW];
} cn_window;
/* A grey picture of at least 2 x 2 pixels: grey[height][width]. */
typedef struct cn_grey_picture {
    const float *grey;
    uint32_t width, height;
} cn_grey_picture;

/* n SIFT descriptors, one after the other, in any alignment. */
enum { CN_DESCRIPTOR = 128 };
typedef struct cn_descriptors {
    const uint8_t *data;
    uint32_t n;
} cn_descriptors;
/* The two largest products of each descriptor with those of another picture; 0 where none is above 0. index: the first
 * descriptor that has the largest product, or -1 when none is above 0. The second may equal the best. */
typedef struct cn_nearest {
    int32_t *best, *second, *index;
} cn_nearest;

/* A layer of a tiny network: k inputs (at most CN_TINY), CN_TINY outputs. w[k][CN_TINY_PAIRS]: pairs of bfloat16. Pair
 * j of an input holds its weight for output j in the low half, and for output CN_TINY_PAIRS + j in the high half.
 * Samples lie CN_TINY floats apart, on both sides. */
enum { CN_TINY = 32, CN_TINY_PAIRS = CN_TINY / 2 };
typedef struct cn_tiny_layer {
    const uint32_t *w;
    uint32_t k;
} cn_tiny_layer;

typedef struct cn_kernel {
    const char *name;
    /* y[m][lane] = sum_k a[k][m] x[k][lane], one panel. m a multiple of 4. relu clamps y at 0. gate (m rows) may be
     * NULL: y is 0 where gate <= 0. */
    void (*gemm)(cn_matrix a, const float *x, float *y, const float *gate, bool relu);
    /* dw[m][k] += sum over panels and lanes of dy[m][lane] x[k][lane]. m = dy->n and k = x->n, multiples of 4. */
    void (*weight_grad)(const cn_panel_rows *dy, const cn_panel_rows *x, size_t n_panels, float *dw);
    /* Two feature rows of one level at positions pos[panel][3][lane] in [0,1]; out points at the level's first row in
     * panel 0. */
    void (*encode)(const cn_level *level, const uint32_t *table, const float *pos, size_t n_panels, float *out,
                   size_t out_stride);
    /* d_enc: the two rows of the level, from panel 0 on.
     * grad[2 * (entry - range->first) + feature] += weight * d_enc for the entries of the range; lanes whose two
     * gradients are 0 are skipped. The order of summation is the set's own, but the same for any range. touched (NULL,
     * or a byte for each CN_TOUCH entries of the range) is set to 1 where anything was added; the range then begins at
     * a multiple of CN_TOUCH. */
    void (*encode_backward)(const cn_level *level, const cn_encode_gradient *in);
    /* Writes the t of occupied steps along a ray, in order, at most max; returns how many. occ: one bit a cell, x
     * fastest. */
    uint32_t (*march)(const cn_box_ray *ray, const cn_march *march, const uint32_t *occ, float *t, uint32_t max);
    /* Contracted positions of n samples of a ray; length[i] is the sample's in contracted box units. */
    void (*place)(const cn_box_ray *ray, const float *t, uint32_t n, cn_spacing spacing, cn_lanes to, float *length);
    /* Adam on n parameters, a multiple of 16; gradients are read and set to 0. */
    void (*adam)(const cn_adam *adam, float *p, float *m, float *v, float *g, size_t n);
    /* Adam on n parameters of the table, a multiple of 8. Parameters with gradient 0 do not change at all. The moments
     * are truncated to bfloat16 after a dither is added, so that the errors average out over the steps. `state` begins
     * at a block. touched: NULL, or the flags of encode_backward, which are set to 0; where a flag is 0, gradients are
     * neither read nor written. */
    void (*adam_table)(const cn_adam *adam, uint16_t *table, uint16_t *state, float *grad, uint8_t *touched, size_t n);
    /* y[s][o] = sum_i w[i][o] x[s][i] of n samples. relu clamps y at 0. A sample has the same bits among any others. */
    void (*tiny)(cn_tiny_layer of, const float *x, uint32_t n, bool relu, float *y);
    /* dx[s][i] = sum_o w[i][o] dy[s][o]; 0 where gate[s][i] <= 0. gate may be NULL. */
    void (*tiny_backward)(cn_tiny_layer of, const float *dy, uint32_t n, const float *gate, float *dx);
    /* Adds x[s][i] dy[s][o] to the gradients of a layer, grad[k][CN_TINY_PAIRS][2], in the order of the samples. */
    void (*tiny_gradient)(uint32_t k, const float *x, const float *dy, uint32_t n, float *grad);
    /* Sums over a window's samples of weight * p, weight * p * p and weight * p * value. p: the picture, bilinear,
     * where the homography (row-major) takes the sample; places outside move to the picture's border. Any alignment. */
    void (*window_sums)(const cn_window *window, const cn_grey_picture *picture, const float homography[9],
                        float sums[3]);
    /* The largest products of each row with all columns, and of each column with all rows. Exact. The results are
     * arrays of rows.n and of columns.n. */
    void (*match)(cn_descriptors rows, cn_descriptors columns, const cn_nearest *of_rows, const cn_nearest *of_columns);
} cn_kernel;

extern const cn_kernel cn_kernel_ref;
/* Overrides entries of k; false when this build or processor lacks the set. */
bool cn_kernel_fill_avx2(cn_kernel *k);
bool cn_kernel_fill_avx512(cn_kernel *k);
bool cn_kernel_fill_avx512bf16(cn_kernel *k);
void cn_kernel_use_vnni(cn_kernel *k); /* where the processor has it, on top of AVX-512 */
bool cn_kernel_fill_neon(cn_kernel *k);
/* The fastest table for this processor and operating system, limited by CONURB_CPU=ref|avx2|avx512|avx512bf16|neon.
 * Chosen once. Any thread. */
const cn_kernel *cn_kernel_best(void);
/* The fastest table that multiplies in float. Differs from the one above only where bfloat16 products are used. */
const cn_kernel *cn_kernel_float(void);
/* All sets that this machine can run, ref first; returns how many (at most 4). */
int cn_kernel_sets(const cn_kernel *sets[4]);

static inline uint16_t cn_bf16_from_float(float x)
{
    uint32_t bits;
    memcpy(&bits, &x, 4);
    bits += 0x7fffu + ((bits >> 16) & 1u);
    return (uint16_t)(bits >> 16);
}
/* A float as its bfloat16 (ties away from zero) and its own low half, and back. */
static inline void cn_float_split(float x, uint16_t *high, uint16_t *low)
{
    uint32_t bits;
    memcpy(&bits, &x, 4);
    *high = (uint16_t)((bits + 0x8000u) >> 16);
    *low = (uint16_t)bits;
}
static inline float cn_float_join(uint16_t high, uint16_t low)
{
    const uint32_t bits = (((uint32_t)high - (low >> 15)) << 16) + low;
    float x;
    memcpy(&x, &bits, 4);
    return x;
}
static inline float cn_bf16_to_float(uint16_t h)
{
    uint32_t bits = (uint32_t)h << 16;
    float x;
    memcpy(&x, &bits, 4);
    return x;
}
#endif
