#include "splat/raster.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { CHUNKS = CN_RASTER_CHUNKS, PIXELS = CN_SPLAT_TILE_PIXELS, DIGIT = 11, DIGITS = 1 << DIGIT };

cn_status cn_raster_init(cn_raster *r, cn_pool *pool, const cn_splat_kernel *kernel, size_t most)
{
    const size_t room = most ? most : 1;
    *r = (cn_raster){ .pool = pool, .kernel = kernel, .most = most };
    r->flats = aligned_alloc(64, room * sizeof *r->flats);
    uint32_t **const arrays[] = { &r->visible, &r->sorted, &r->spare, &r->keys, &r->spare_keys };
    bool fine = r->flats != NULL;
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays; i++)
        fine &= (*arrays[i] = malloc(room * sizeof **arrays[i])) != NULL;
    r->buffers = aligned_alloc(64, (size_t)cn_pool_threads(pool) * 8 * PIXELS * sizeof *r->buffers);
    if (fine && r->buffers) return CN_OK;
    cn_raster_deinit(r);
    return cn_fail(CN_ERR_NOMEM, "out of memory for %zu splats; give a smaller --budget", most);
}

void cn_raster_deinit(cn_raster *r)
{
    free(r->flats);
    free(r->visible);
    free(r->sorted);
    free(r->spare);
    free(r->keys);
    free(r->spare_keys);
    free(r->begin);
    free(r->list);
    free(r->slots);
    free(r->counts);
    free(r->errors);
    free(r->buffers);
    *r = (cn_raster){ 0 };
}

/* The part of n items that chunk i has. */
static void chunk_of(size_t n, size_t i, size_t *first, size_t *end)
{
    *first = n * i / CHUNKS;
    *end = n * (i + 1) / CHUNKS;
}

/* ---- projecting ---- */

typedef struct binning {
    cn_raster *r;
    const cn_splat_camera *camera;
    const cn_splat_rows *rows;
    uint32_t seen[CHUNKS], entries[CHUNKS];
    unsigned shift; /* of a sorting pass */
    uint32_t bins;
} binning;

static void project_chunk(void *user, size_t i, unsigned worker)
{
    (void)worker;
    binning *b = user;
    const uint32_t length = cn_row_length(b->rows->degree);
    size_t first, end;
    uint32_t n = 0, entries = 0;
    chunk_of(b->rows->n, i, &first, &end);
    for (size_t s = first; s < end; s++) {
        cn_flat_splat *f = &b->r->flats[s];
        if (!cn_splat_project(b->camera, b->rows->rows + s * length, b->rows->degree, f)) continue;
        const cn_tile_range tiles = cn_tile_range_of(f->box);
        b->r->spare[first + n++] = (uint32_t)s;
        f->first = entries;
        entries += tiles.width * tiles.height;
    }
    b->seen[i] = n;
    b->entries[i] = entries;
}

/* Closes the gaps between the chunks; seen and entries are then where each begins. */
static void pack_chunk(void *user, size_t i, unsigned worker)
{
    (void)worker;
    binning *b = user;
    cn_raster *r = b->r;
    size_t first, end;
    chunk_of(b->rows->n, i, &first, &end);
    const uint32_t to = b->seen[i], n = (i + 1 < CHUNKS ? b->seen[i + 1] : r->n_visible) - to;
    for (uint32_t k = 0; k < n; k++) {
        const uint32_t s = r->spare[first + k];
        r->flats[s].first += b->entries[i];
        r->visible[to + k] = r->sorted[to + k] = s;
        memcpy(&r->keys[to + k], &r->flats[s].depth, sizeof r->keys[0]); /* positive: sorts as a whole number */
    }
}

static void project_all(binning *b)
{
    cn_raster *r = b->r;
    cn_pool_run(r->pool, CHUNKS, project_chunk, b);
    r->n_visible = r->n_entries = 0;
    for (int i = 0; i < CHUNKS; i++) {
        const uint32_t seen = b->seen[i], entries = b->entries[i];
        b->seen[i] = r->n_visible;
        b->entries[i] = r->n_entries;
        r->n_visible += seen;
        r->n_entries += entries;
    }
    cn_pool_run(r->pool, CHUNKS, pack_chunk, b);
}

/* ---- sorting: by digits, from the lowest, each pass keeps the order of equals ---- */

/* Turns counts[chunk][bin] into where each chunk writes its first item of a bin. */
static void counts_to_places(uint32_t *counts, uint32_t bins, uint32_t *begin)
{
    uint32_t at = 0;
    for (uint32_t bin = 0; bin < bins; bin++) {
        if (begin) begin[bin] = at;
        for (size_t i = 0; i < CHUNKS; i++) {
            const uint32_t n = counts[i * bins + bin];
            counts[i * bins + bin] = at;
            at += n;
        }
    }
    if (begin) begin[bins] = at;
}

static void count_digits(void *user, size_t i, unsigned worker)
{
    (void)worker;
    const binning *b = user;
    uint32_t *counts = b->r->counts + i * DIGITS;
    size_t first, end;
    chunk_of(b->r->n_visible, i, &first, &end);
    memset(counts, 0, DIGITS * sizeof *counts);
    for (size_t k = first; k < end; k++)
        counts[b->r->keys[k] >> b->shift & (DIGITS - 1)]++;
}

static void move_by_digit(void *user, size_t i, unsigned worker)
{
    (void)worker;
    const binning *b = user;
    const cn_raster *r = b->r;
    uint32_t *places = r->counts + i * DIGITS;
    size_t first, end;
    chunk_of(r->n_visible, i, &first, &end);
    for (size_t k = first; k < end; k++) {
        const uint32_t to = places[r->keys[k] >> b->shift & (DIGITS - 1)]++;
        r->spare_keys[to] = r->keys[k];
        r->spare[to] = r->sorted[k];
    }
}

static void sort(binning *b)
{
    cn_raster *r = b->r;
    for (b->shift = 0; b->shift < 32; b->shift += DIGIT) {
        cn_pool_run(r->pool, CHUNKS, count_digits, b);
        counts_to_places(r->counts, DIGITS, NULL);
        cn_pool_run(r->pool, CHUNKS, move_by_digit, b);
        uint32_t *sorted = r->sorted, *keys = r->keys;
        r->sorted = r->spare;
        r->keys = r->spare_keys;
        r->spare = sorted;
        r->spare_keys = keys;
    }
}

/* ---- binning ---- */

static void bin_chunk(const binning *b, size_t i, bool fill)
{
    const cn_raster *r = b->r;
    uint32_t *counts = r->counts + i * b->bins;
    size_t first, end;
    chunk_of(r->n_visible, i, &first, &end);
    if (!fill) memset(counts, 0, b->bins * sizeof *counts);
    for (size_t k = first; k < end; k++) {
        if (k + 8 < end) __builtin_prefetch(&r->flats[r->sorted[k + 8]].box);
        const cn_tile_range t = cn_tile_range_of(r->flats[r->sorted[k]].box);
        for (uint32_t y = t.y; y < t.y + t.height; y++)
            for (uint32_t x = t.x; x < t.x + t.width; x++) {
                uint32_t *count = &counts[y * r->tiles_x + x];
                if (fill) r->list[*count] = r->sorted[k];
                ++*count;
            }
    }
}

static void count_tiles(void *user, size_t i, unsigned worker)
{
    (void)worker;
    bin_chunk(user, i, false);
}

static void fill_tiles(void *user, size_t i, unsigned worker)
{
    (void)worker;
    bin_chunk(user, i, true);
}

/* Replaces an array by a larger one, without its content. */
static bool make_room(void *array, size_t *most, size_t wanted, size_t size)
{
    void **at = array;
    if (*at && *most >= wanted) return true;
    free(*at);
    *at = malloc(wanted * size);
    return *at != NULL;
}

static cn_status reserve(cn_raster *r, const cn_splat_camera *camera)
{
    r->tiles_x = (camera->width + CN_SPLAT_TILE - 1) / CN_SPLAT_TILE;
    r->tiles_y = (camera->height + CN_SPLAT_TILE - 1) / CN_SPLAT_TILE;
    const size_t tiles = (size_t)r->tiles_x * r->tiles_y, bins = tiles > DIGITS ? tiles : DIGITS;
    bool fine = make_room(&r->begin, &r->most_tiles, tiles + 1, sizeof *r->begin);
    fine &= make_room(&r->errors, &r->most_tiles, tiles + 1, sizeof *r->errors);
    fine &= make_room(&r->counts, &r->most_counts, bins * CHUNKS, sizeof *r->counts);
    if (tiles + 1 > r->most_tiles) r->most_tiles = tiles + 1;
    if (bins * CHUNKS > r->most_counts) r->most_counts = bins * CHUNKS;
    return fine ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for %zu tiles of a picture", tiles);
}

static cn_status reserve_entries(cn_raster *r)
{
    if (r->list && r->slots && r->n_entries <= r->most_entries) return CN_OK;
    const size_t wanted = (size_t)r->n_entries + r->n_entries / 4 + 1024;
    free(r->list);
    free(r->slots);
    r->list = malloc(wanted * sizeof *r->list);
    r->slots = malloc(wanted * sizeof *r->slots);
    r->most_entries = wanted;
    return r->list && r->slots ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for a picture of splats");
}

cn_status cn_raster_bin(cn_raster *r, const cn_splat_camera *camera, const cn_splat_rows *rows)
{
    binning b = { .r = r, .camera = camera, .rows = rows };
    CN_TRY(reserve(r, camera));
    project_all(&b);
    CN_TRY(reserve_entries(r));
    sort(&b);
    b.bins = r->tiles_x * r->tiles_y;
    cn_pool_run(r->pool, CHUNKS, count_tiles, &b);
    counts_to_places(r->counts, b.bins, r->begin);
    cn_pool_run(r->pool, CHUNKS, fill_tiles, &b);
    return CN_OK;
}

/* ---- compositing ---- */

typedef struct drawing {
    cn_raster *r;
    const cn_splat_camera *camera;
    const uint8_t *target;
    float *rgb, *light;
} drawing;

static cn_splat_tile tile_of(const drawing *d, size_t i, unsigned worker)
{
    const cn_raster *r = d->r;
    float *buffer = r->buffers + (size_t)worker * 8 * PIXELS;
    return (cn_splat_tile){ .flats = r->flats,
                            .list = r->list + r->begin[i],
                            .n = r->begin[i + 1] - r->begin[i],
                            .x = (int32_t)(i % r->tiles_x * CN_SPLAT_TILE),
                            .y = (int32_t)(i / r->tiles_x * CN_SPLAT_TILE),
                            .least_alpha = d->camera->least_alpha,
                            .pixels = buffer,
                            .gradient = buffer + 4 * PIXELS,
                            .slots = r->slots };
}

static void draw_tile(void *user, size_t i, unsigned worker)
{
    const drawing *d = user;
    const cn_splat_tile t = tile_of(d, i, worker);
    d->r->kernel->forward(&t);
    for (uint32_t p = 0; p < PIXELS; p++) {
        const uint32_t x = (uint32_t)t.x + p % CN_SPLAT_TILE, y = (uint32_t)t.y + p / CN_SPLAT_TILE;
        if (x >= d->camera->width || y >= d->camera->height) continue;
        const size_t at = (size_t)y * d->camera->width + x;
        for (size_t k = 0; k < 3; k++)
            d->rgb[3 * at + k] = t.pixels[k * PIXELS + p];
        if (d->light) d->light[at] = t.pixels[3 * PIXELS + p];
    }
}

void cn_raster_draw(cn_raster *r, const cn_splat_camera *camera, float *rgb, float *light)
{
    drawing d = { r, camera, NULL, rgb, light };
    cn_pool_run(r->pool, (size_t)r->tiles_x * r->tiles_y, draw_tile, &d);
}

/* The gradient of half the squared differences. Returns the squared differences of the colours. */
static double compare(const drawing *d, const cn_splat_tile *t, const uint8_t *target, float *gradient)
{
    double sum = 0;
    for (uint32_t p = 0; p < PIXELS; p++) {
        const uint32_t x = (uint32_t)t->x + p % CN_SPLAT_TILE, y = (uint32_t)t->y + p / CN_SPLAT_TILE;
        const bool inside = x < d->camera->width && y < d->camera->height;
        float squares = 0;
        for (uint32_t k = 0; k < 4; k++) {
            const float wanted = (float)target[k * PIXELS + p] * (1 / 255.0f);
            const float off = t->pixels[k * PIXELS + p] - (k < 3 ? wanted : 1 - wanted);
            gradient[k * PIXELS + p] = inside ? off : 0;
            squares += k < 3 ? off * off : 0;
        }
        sum += inside ? (double)squares : 0;
    }
    return sum;
}

static void step_tile(void *user, size_t i, unsigned worker)
{
    const drawing *d = user;
    const cn_splat_tile t = tile_of(d, i, worker);
    d->r->kernel->forward(&t);
    float *gradient = t.pixels + 4 * PIXELS;
    d->r->errors[i] = compare(d, &t, d->target + i * 4 * PIXELS, gradient);
    d->r->kernel->backward(&t);
}

double cn_raster_step(cn_raster *r, const cn_splat_camera *camera, const uint8_t *target)
{
    const size_t tiles = (size_t)r->tiles_x * r->tiles_y;
    drawing d = { r, camera, target, NULL, NULL };
    double sum = 0;
    cn_pool_run(r->pool, tiles, step_tile, &d);
    for (size_t i = 0; i < tiles; i++)
        sum += r->errors[i];
    return sum;
}

void cn_raster_sums(const cn_raster *r, uint32_t splat, float sums[CN_SPLAT_SUMS])
{
    const cn_flat_splat *f = &r->flats[splat];
    const cn_tile_range t = cn_tile_range_of(f->box);
    memset(sums, 0, CN_SPLAT_SUMS * sizeof *sums);
    for (uint32_t i = 0; i < t.width * t.height; i++)
        for (int k = 0; k < CN_SPLAT_SUMS; k++)
            sums[k] += r->slots[f->first + i][k];
}
