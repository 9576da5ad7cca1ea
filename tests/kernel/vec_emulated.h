/* Vectors of sixteen floats out of the compiler's own, lane by lane: what vec_avx512.h says, on a processor that has no
 * AVX-512. So the vector source is run at its other width wherever AVX2 is (kernel_simd.h has a few 256-bit parts). */
#ifndef CONURB_TESTS_VEC_EMULATED_H
#define CONURB_TESTS_VEC_EMULATED_H
#include <immintrin.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

#define V_LANES 16
#define V_GEMM_ROWS 8
#define V_GRAD_VECTORS 4
#define GRAD_PANELS 2
#define V_MATCH_ROWS 8
#define V_MATCH_VECTORS 3

typedef float vf __attribute__((vector_size(64)));
typedef uint32_t vi __attribute__((vector_size(64)));
typedef uint16_t vm;
#define V_EACH(i) for (int i = 0; i < V_LANES; i++)

static inline vf v_load(const float *p)
{
    vf x;
    memcpy(&x, p, sizeof x);
    return x;
}
static inline void v_store(float *p, vf x)
{
    memcpy(p, &x, sizeof x);
}
static inline vf v_set(float x)
{
    return x - (vf){ 0 };
}
static inline vf v_add(vf a, vf b)
{
    return a + b;
}
static inline vf v_sub(vf a, vf b)
{
    return a - b;
}
static inline vf v_mul(vf a, vf b)
{
    return a * b;
}
static inline vf v_div(vf a, vf b)
{
    return a / b;
}
static inline vf v_fma(vf a, vf b, vf c)
{
    V_EACH(i) c[i] = fmaf(a[i], b[i], c[i]);
    return c;
}
static inline vf v_sqrt(vf x)
{
    V_EACH(i) x[i] = sqrtf(x[i]);
    return x;
}
static inline vf v_floor(vf x)
{
    V_EACH(i) x[i] = floorf(x[i]);
    return x;
}
/* For NaN the second operand is returned. */
static inline vf v_max(vf a, vf b)
{
    V_EACH(i) b[i] = a[i] > b[i] ? a[i] : b[i];
    return b;
}
static inline vf v_min(vf a, vf b)
{
    V_EACH(i) b[i] = a[i] < b[i] ? a[i] : b[i];
    return b;
}
static inline vf v_abs(vf x)
{
    V_EACH(i) x[i] = fabsf(x[i]);
    return x;
}
static inline vi v_truncate(vf x)
{
    vi n;
    V_EACH(i) n[i] = (uint32_t)(int32_t)x[i];
    return n;
}
static inline vi v_bits(vf x)
{
    return (vi)x;
}
static inline vf v_from_bits(vi x)
{
    return (vf)x;
}

static inline vi vi_load(const uint32_t *p)
{
    vi x;
    memcpy(&x, p, sizeof x);
    return x;
}
static inline void vi_store(uint32_t *p, vi x)
{
    memcpy(p, &x, sizeof x);
}
static inline vi vi_set(uint32_t x)
{
    return x - (vi){ 0 };
}
static inline vi vi_add(vi a, vi b)
{
    return a + b;
}
static inline vi vi_sub(vi a, vi b)
{
    return a - b;
}
static inline vi vi_mul(vi a, vi b)
{
    return a * b;
}
static inline vi vi_and(vi a, vi b)
{
    return a & b;
}
static inline vi vi_or(vi a, vi b)
{
    return a | b;
}
static inline vi vi_xor(vi a, vi b)
{
    return a ^ b;
}
static inline vi vi_left(vi x, int n)
{
    return x << n;
}
static inline vi vi_right(vi x, int n)
{
    return x >> n;
}
static inline vi vi_right_by(vi x, vi n)
{
    return x >> n;
}
static inline vf v_gather(const float *table, vi index)
{
    vf x;
    V_EACH(i) x[i] = table[index[i]];
    return x;
}
static inline vi vi_gather(const uint32_t *table, vi index)
{
    V_EACH(i) index[i] = table[index[i]];
    return index;
}
static inline vi vi_collect(const uint32_t *table, const uint32_t *index)
{
    vi x;
    V_EACH(i) x[i] = table[index[i]];
    return x;
}
static inline void vi_collect_two(const uint32_t *table, const uint32_t *index, vi out[2])
{
    V_EACH(i) out[0][i] = table[index[i]];
    V_EACH(i) out[1][i] = table[index[i] + 1];
}
static inline vi vi_max(vi a, vi b)
{
    V_EACH(i) a[i] = (int32_t)a[i] > (int32_t)b[i] ? a[i] : b[i];
    return a;
}
static inline vi vi_min(vi a, vi b)
{
    V_EACH(i) a[i] = (int32_t)a[i] < (int32_t)b[i] ? a[i] : b[i];
    return a;
}
static inline vi vi_multiply_pairs(vi a, vi b)
{
    V_EACH(i) a[i] = (uint32_t)((int16_t)a[i] * (int16_t)b[i] + (int16_t)(a[i] >> 16) * (int16_t)(b[i] >> 16));
    return a;
}
static inline uint32_t vi_equal(vi a, vi b)
{
    uint32_t m = 0;
    V_EACH(i) m |= (uint32_t)(a[i] == b[i]) << i;
    return m;
}
static inline vi vi_load16(const uint16_t *p)
{
    vi x;
    V_EACH(i) x[i] = p[i];
    return x;
}
static inline void vi_store16(uint16_t *p, vi x)
{
    V_EACH(i) p[i] = (uint16_t)x[i];
}

static inline vm v_positive(vf x)
{
    unsigned m = 0;
    V_EACH(i) m |= (unsigned)(x[i] > 0) << i;
    return (vm)m;
}
static inline vm v_nonzero(vf x)
{
    unsigned m = 0;
    V_EACH(i) m |= (unsigned)!(x[i] == 0) << i;
    return (vm)m;
}
static inline vm v_less(vf a, vf b)
{
    unsigned m = 0;
    V_EACH(i) m |= (unsigned)(a[i] < b[i]) << i;
    return (vm)m;
}
static inline vm vi_greater(vi a, vi b)
{
    unsigned m = 0;
    V_EACH(i) m |= (unsigned)((int32_t)a[i] > (int32_t)b[i]) << i;
    return (vm)m;
}
static inline vm v_or(vm a, vm b)
{
    return (vm)(a | b);
}
static inline uint32_t v_lanes(vm m)
{
    return m;
}
static inline vf v_pick(vm m, vf yes, vf no)
{
    V_EACH(i) no[i] = m >> i & 1 ? yes[i] : no[i];
    return no;
}
static inline vf v_keep(vm m, vf x)
{
    return v_pick(m, x, (vf){ 0 });
}
static inline vi vi_pick(vm m, vi yes, vi no)
{
    V_EACH(i) no[i] = m >> i & 1 ? yes[i] : no[i];
    return no;
}
#endif
