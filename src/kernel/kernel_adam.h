/* Adam on vectors: the part of kernel_simd.h that updates parameters. */
typedef struct adam_vectors {
    vf b1, b2, c1, c2, rate, eps, decay;
} adam_vectors;

V_INLINE adam_vectors adam_spread(const cn_adam *a)
{
    return (adam_vectors){ v_set(a->beta1), v_set(a->beta2),   v_set(1 - a->beta1), v_set(1 - a->beta2),
                           v_set(a->rate),  v_set(a->epsilon), v_set(a->decay) };
}

V_INLINE void adam_one(const adam_vectors *a, vf grad, vf *p, vf *m, vf *v)
{
    *m = v_fma(a->b1, *m, v_mul(a->c1, grad));
    *v = v_fma(a->b2, *v, v_mul(a->c2, v_mul(grad, grad)));
    *p = v_sub(*p, v_div(v_mul(a->rate, *m), v_add(v_sqrt(*v), a->eps)));
}

static void simd_adam(const cn_adam *adam, float *p, float *m, float *v, float *g, size_t n)
{
    const adam_vectors a = adam_spread(adam);
    for (size_t i = 0; i < n; i += V_LANES) {
        vf p1 = v_load(p + i), m1 = v_load(m + i), v1 = v_load(v + i);
        adam_one(&a, v_fma(a.decay, p1, v_load(g + i)), &p1, &m1, &v1);
        v_store(p + i, p1);
        v_store(m + i, m1);
        v_store(v + i, v1);
        v_store(g + i, v_set(0));
    }
}

/* Updates V_LANES parameters. */
V_INLINE void adam_table_lanes(const adam_vectors *a, vi dither, uint16_t *table, uint16_t *state, float *grad)
{
    const vf g = v_load(grad);
    const vm some = v_nonzero(g);
    const vi high = vi_load16(table), rest = vi_load16(state), m0 = vi_load16(state + CN_STATE_M),
             v0 = vi_load16(state + CN_STATE_V);
    /* The low half is signed: where its top bit is set, the high half is reduced by one. */
    vf p = v_from_bits(vi_add(vi_left(vi_sub(high, vi_right(rest, 15)), 16), rest));
    vf m = v_from_bits(vi_left(m0, 16)), v = v_from_bits(vi_left(v0, 16));
    adam_one(a, g, &p, &m, &v);
    const vi bits = v_bits(p);
    vi_store16(table, vi_pick(some, vi_right(vi_add(bits, vi_set(0x8000)), 16), high));
    vi_store16(state, vi_pick(some, bits, rest));
    vi_store16(state + CN_STATE_M, vi_pick(some, vi_right(vi_add(v_bits(m), dither), 16), m0));
    vi_store16(state + CN_STATE_V, vi_pick(some, vi_right(vi_add(v_bits(v), dither), 16), v0));
    v_store(grad, v_set(0));
}

/* Blocks of state per chunk. */
enum { ADAM_CHUNK = 64, BLOCK = 2 * CN_TOUCH };

V_INLINE bool block_lives(const float *grad)
{
    vm any = v_nonzero(v_load(grad));
    for (int q = V_LANES; q < BLOCK; q += V_LANES)
        any = v_or(any, v_nonzero(v_load(grad + q)));
    return v_lanes(any) != 0;
}

/* The whole blocks of a part of the table. */
typedef struct adam_blocks {
    const uint16_t *table, *state;
    const float *grad;
    const uint8_t *touched; /* NULL: look at the gradients */
    size_t n;
} adam_blocks;

/* Lists the blocks of a chunk that have a gradient, and prefetches what they need, because the hardware cannot predict
 * their order. There is no branch: it would be mispredicted half of the time. */
V_INLINE uint32_t adam_list(const adam_blocks *of, size_t first, uint32_t *list)
{
    uint32_t n = 0;
    const size_t last = first + ADAM_CHUNK < of->n ? first + ADAM_CHUNK : of->n;
    for (size_t i = first; i < last; i++) {
        list[n] = (uint32_t)i;
        n += of->touched ? of->touched[i] : block_lives(of->grad + i * BLOCK);
    }
    for (uint32_t q = 0; q < n; q++) {
        const size_t i = list[q];
        __builtin_prefetch(of->grad + i * BLOCK, 1);
        __builtin_prefetch(of->table + i * BLOCK, 1);
        __builtin_prefetch(of->state + i * CN_STATE_BLOCK, 1);
        __builtin_prefetch(of->state + i * CN_STATE_BLOCK + CN_STATE_BLOCK - 1, 1);
    }
    return n;
}

V_INLINE void adam_block(const adam_vectors *a, vi dither, uint16_t *table, uint16_t *state, float *grad)
{
    for (int q = 0; q < BLOCK; q += V_LANES)
        adam_table_lanes(a, dither, table + q, state + q, grad + q);
}

/* Half a block at the end: the words after it belong to the next level. */
V_INLINE void adam_half_block(const adam_vectors *a, vi dither, uint16_t *table, uint16_t *state, float *grad)
{
    uint16_t words[BLOCK] = { 0 };
    float grads[BLOCK] = { 0 };
    memcpy(words, table, BLOCK / 2 * sizeof *words);
    memcpy(grads, grad, BLOCK / 2 * sizeof *grads);
    adam_block(a, dither, words, state, grads);
    memcpy(table, words, BLOCK / 2 * sizeof *words);
    memset(grad, 0, BLOCK / 2 * sizeof *grads);
}

static void simd_adam_table(const cn_adam *adam, uint16_t *table, uint16_t *state, float *grad, uint8_t *touched,
                            size_t n)
{
    const adam_vectors a = adam_spread(adam);
    const vi dither = vi_set(adam->dither);
    const size_t blocks = n / BLOCK;
    const adam_blocks of = { table, state, grad, touched, blocks };
    uint32_t list[2][ADAM_CHUNK], used = adam_list(&of, 0, list[0]);
    int now = 0;
    for (size_t i = 0; i < blocks; i += ADAM_CHUNK, now ^= 1) {
        const size_t next = i + ADAM_CHUNK;
        const uint32_t coming = next < blocks ? adam_list(&of, next, list[now ^ 1]) : 0;
        for (uint32_t q = 0; q < used; q++) {
            const size_t at = list[now][q];
            adam_block(&a, dither, table + at * BLOCK, state + at * CN_STATE_BLOCK, grad + at * BLOCK);
        }
        used = coming;
    }
    const size_t end = blocks * BLOCK;
    if (end < n && (!touched || touched[blocks]))
        adam_half_block(&a, dither, table + end, state + blocks * CN_STATE_BLOCK, grad + end);
    if (touched) memset(touched, 0, (n + BLOCK - 1) / BLOCK);
}
