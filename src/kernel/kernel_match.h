/* Products of SIFT descriptors on vectors, and the two largest of each row and column. This source is compiled once
 * for each instruction set, after a header that defines the vector type. MATCH_BYTES: products of bytes (AVX-512 VNNI),
 * else of 16-bit numbers. All sums are whole numbers, so every set gives the same result. */
#include "kernel/kernel.h"

/* A word is the part of a descriptor that one instruction multiplies. A tile is MATCH_ROWS rows by MATCH_WIDTH columns,
 * whose sums stay in registers. A block of columns is packed once, for all rows, and fits the L2 cache. */
enum {
#ifdef MATCH_BYTES
    MATCH_WORDS = CN_DESCRIPTOR / 4,
    MATCH_BLOCK = 1024,
#else
    MATCH_WORDS = CN_DESCRIPTOR / 2,
    MATCH_BLOCK = 512,
#endif
    MATCH_WIDTH = V_MATCH_VECTORS * V_LANES,
    MATCH_PANELS = MATCH_BLOCK / MATCH_WIDTH,
    MATCH_COLUMNS = MATCH_PANELS * MATCH_WIDTH
};

/* The two largest products of each lane, and which one was the largest. */
typedef struct match_two {
    vi best, second, index;
} match_two;
typedef struct match_rows {
    _Alignas(64) uint32_t words[V_MATCH_ROWS][MATCH_WORDS];
    match_two two[V_MATCH_ROWS]; /* the index is that of the vector's first column */
} match_rows;
typedef struct match_panel {
    _Alignas(64) uint32_t words[MATCH_WORDS][MATCH_WIDTH];
    _Alignas(64) uint32_t start[MATCH_WIDTH]; /* what the sums begin with */
    match_two two[V_MATCH_VECTORS];
} match_panel;

#ifdef MATCH_BYTES
/* The instruction multiplies unsigned bytes by signed ones. So 128 is subtracted from the bytes of the rows, and the
 * sums begin with 128 times the sum of the column's bytes. */
V_INLINE vi match_add(vi sum, vi row, vi column)
{
    return _mm512_dpbusd_epi32(sum, column, row);
}
V_INLINE uint32_t match_row_word(const uint8_t *descriptor, uint32_t w)
{
    uint32_t word;
    memcpy(&word, descriptor + 4 * (size_t)w, 4);
    return word ^ 0x80808080u;
}
V_INLINE uint32_t match_column_word(const uint8_t *descriptor, uint32_t w)
{
    uint32_t word;
    memcpy(&word, descriptor + 4 * (size_t)w, 4);
    return word;
}
V_INLINE uint32_t match_start(const uint8_t *descriptor)
{
    uint32_t sum = 0;
    for (int i = 0; i < CN_DESCRIPTOR; i++)
        sum += descriptor[i];
    return 128 * sum;
}
#else
V_INLINE vi match_add(vi sum, vi row, vi column)
{
    return vi_add(sum, vi_multiply_pairs(row, column));
}
V_INLINE uint32_t match_row_word(const uint8_t *descriptor, uint32_t w)
{
    return descriptor[2 * w] | (uint32_t)descriptor[2 * w + 1] << 16;
}
V_INLINE uint32_t match_column_word(const uint8_t *descriptor, uint32_t w)
{
    return match_row_word(descriptor, w);
}
V_INLINE uint32_t match_start(const uint8_t *descriptor)
{
    (void)descriptor;
    return 0;
}
#endif

V_INLINE match_two match_none(void)
{
    return (match_two){ vi_set(0), vi_set(0), vi_set(UINT32_MAX) };
}

V_INLINE void match_see(match_two *two, vi product, vi index)
{
    two->index = vi_pick(vi_greater(product, two->best), index, two->index);
    two->second = vi_max(two->second, vi_min(product, two->best));
    two->best = vi_max(two->best, product);
}

static void match_tile(match_rows *rows, match_panel *panel, uint32_t first_row, uint32_t first_column)
{
    vi c[V_MATCH_ROWS][V_MATCH_VECTORS];
    V_UNROLL for (int j = 0; j < V_MATCH_VECTORS; j++) V_UNROLL for (int i = 0; i < V_MATCH_ROWS; i++) c[i][j] =
        vi_load(panel->start + j * V_LANES);
    for (uint32_t w = 0; w < MATCH_WORDS; w++) {
        vi x[V_MATCH_VECTORS];
        V_UNROLL for (int j = 0; j < V_MATCH_VECTORS; j++) x[j] = vi_load(panel->words[w] + j * V_LANES);
        V_UNROLL for (int i = 0; i < V_MATCH_ROWS; i++)
        {
            const vi row = vi_set(rows->words[i][w]);
            V_UNROLL for (int j = 0; j < V_MATCH_VECTORS; j++) c[i][j] = match_add(c[i][j], row, x[j]);
        }
    }
    V_UNROLL for (int i = 0; i < V_MATCH_ROWS; i++)
    {
        match_two two = rows->two[i];
        V_UNROLL for (int j = 0; j < V_MATCH_VECTORS; j++)
            match_see(&two, c[i][j], vi_set(first_column + (uint32_t)(j * V_LANES)));
        rows->two[i] = two;
    }
    V_UNROLL for (int j = 0; j < V_MATCH_VECTORS; j++)
    {
        match_two two = panel->two[j];
        V_UNROLL for (int i = 0; i < V_MATCH_ROWS; i++) match_see(&two, c[i][j], vi_set(first_row + (uint32_t)i));
        panel->two[j] = two;
    }
}

/* Descriptors past the last one are 0: their products are 0, which is never the best. */
static void match_pack_panel(match_panel *panel, cn_descriptors columns, uint32_t first)
{
    memset(panel->words, 0, sizeof panel->words);
    memset(panel->start, 0, sizeof panel->start);
    for (uint32_t c = 0; c < MATCH_WIDTH && first + c < columns.n; c++) {
        const uint8_t *descriptor = columns.data + (size_t)(first + c) * CN_DESCRIPTOR;
        for (uint32_t w = 0; w < MATCH_WORDS; w++)
            panel->words[w][c] = match_column_word(descriptor, w);
        panel->start[c] = match_start(descriptor);
    }
    for (int j = 0; j < V_MATCH_VECTORS; j++)
        panel->two[j] = match_none();
}

static void match_pack_rows(match_rows *rows, cn_descriptors from, uint32_t first)
{
    static const uint8_t nothing[CN_DESCRIPTOR];
    for (uint32_t i = 0; i < V_MATCH_ROWS; i++) {
        const bool inside = first + i < from.n;
        const uint8_t *descriptor = inside ? from.data + (size_t)(first + i) * CN_DESCRIPTOR : nothing;
        for (uint32_t w = 0; w < MATCH_WORDS; w++)
            rows->words[i][w] = match_row_word(descriptor, w);
        rows->two[i] = match_none();
    }
}

/* Adds the lanes of one row. Of equal products the one of the first column counts as the best, the other as second. */
static void match_merge_row(const match_two *two, const cn_nearest *to, uint32_t row)
{
    int32_t best[V_LANES], second[V_LANES], index[V_LANES];
    vi_store((uint32_t *)best, two->best);
    vi_store((uint32_t *)second, two->second);
    vi_store((uint32_t *)index, two->index);
    int32_t first = to->best[row], next = to->second[row], at = to->index[row];
    for (int32_t lane = 0; lane < V_LANES; lane++) {
        const int32_t here = index[lane] + lane;
        const bool more = best[lane] > first || (best[lane] == first && best[lane] > 0 && here < at);
        const int32_t loser = more ? first : best[lane], other = second[lane] > next ? second[lane] : next;
        next = loser > other ? loser : other;
        at = more ? here : at;
        first = more ? best[lane] : first;
    }
    to->best[row] = first;
    to->second[row] = next;
    to->index[row] = at;
}

static void match_store_columns(const match_panel *panel, const cn_nearest *to, uint32_t first, uint32_t n)
{
    uint32_t best[MATCH_WIDTH], second[MATCH_WIDTH], index[MATCH_WIDTH];
    for (int j = 0; j < V_MATCH_VECTORS; j++) {
        vi_store(best + j * V_LANES, panel->two[j].best);
        vi_store(second + j * V_LANES, panel->two[j].second);
        vi_store(index + j * V_LANES, panel->two[j].index);
    }
    const uint32_t count = n - first < MATCH_WIDTH ? n - first : MATCH_WIDTH;
    memcpy(to->best + first, best, count * sizeof *best);
    memcpy(to->second + first, second, count * sizeof *second);
    memcpy(to->index + first, index, count * sizeof *index);
}

static void simd_match(cn_descriptors rows, cn_descriptors columns, const cn_nearest *of_rows,
                       const cn_nearest *of_columns)
{
    match_panel panels[MATCH_PANELS];
    match_rows tile;
    memset(of_rows->best, 0, rows.n * sizeof *of_rows->best);
    memset(of_rows->second, 0, rows.n * sizeof *of_rows->second);
    memset(of_rows->index, 0xff, rows.n * sizeof *of_rows->index);
    for (uint32_t first = 0; first < columns.n; first += MATCH_COLUMNS) {
        const uint32_t left = columns.n - first, n = left < MATCH_COLUMNS ? left : MATCH_COLUMNS;
        const uint32_t n_panels = (n + MATCH_WIDTH - 1) / MATCH_WIDTH;
        for (uint32_t p = 0; p < n_panels; p++)
            match_pack_panel(&panels[p], columns, first + p * MATCH_WIDTH);
        for (uint32_t i = 0; i < rows.n; i += V_MATCH_ROWS) {
            match_pack_rows(&tile, rows, i);
            for (uint32_t p = 0; p < n_panels; p++)
                match_tile(&tile, &panels[p], i, first + p * MATCH_WIDTH);
            for (uint32_t k = 0; k < V_MATCH_ROWS && i + k < rows.n; k++)
                match_merge_row(&tile.two[k], of_rows, i + k);
        }
        for (uint32_t p = 0; p < n_panels; p++)
            match_store_columns(&panels[p], of_columns, first + p * MATCH_WIDTH, columns.n);
    }
}
