#include "pose/retrieval.h"

#include "bridge/sqlite.h"
#include "pose/colmap.h"
#include "pose/feature_match.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* On castle, brighton and lund, 512 features and 2 matches find 96 to 99 % of the pairs that COLMAP verifies, and 98 to
 * 100 % of those with 60 matches or more; 256 features 87 to 93 %, 128 features 79 to 81 %. */
enum { MOST_FEATURES = 512, LEAST_FEATURES = 128, FEW_PHOTOS = 2000, LEAST_MATCHES = 2 };
enum { PARTNERS = 50 };     /* of a photo, at most */
enum { ROWS_AT_ONCE = 16 }; /* photos that are compared with all others between two reports */

typedef struct retrieval {
    const cn_colmap_job *j;
    const cn_kernel *kernel;
    uint32_t n, most; /* photos; features of a photo */
    uint8_t *data;    /* [n][most][CN_DESCRIPTOR] */
    uint32_t *n_features;
    uint8_t *matches;       /* [n][n] matches of two photos, 255 at most, where the column is greater than the row */
    cn_match_space *spaces; /* one a thread */
    uint32_t row;           /* first row of the run */
    int no_memory;          /* set by threads */
} retrieval;

typedef struct ranked {
    float scale;
    uint32_t index;
} ranked;

static int by_scale(const void *a, const void *b)
{
    const ranked *x = a, *y = b;
    if (x->scale != y->scale) return x->scale > y->scale ? -1 : 1;
    return (x->index > y->index) - (x->index < y->index);
}

/* Keeps the largest features of a photo. */
static cn_status take_largest(retrieval *r, uint32_t photo, const uint8_t *data, const float *scale, uint32_t n)
{
    ranked *order = malloc(sizeof *order * (n + 1u));
    if (!order) return cn_fail(CN_ERR_NOMEM, "out of memory comparing photos");
    for (uint32_t i = 0; i < n; i++)
        order[i] = (ranked){ scale[i], i };
    qsort(order, n, sizeof *order, by_scale);
    r->n_features[photo] = n < r->most ? n : r->most;
    for (uint32_t i = 0; i < r->n_features[photo]; i++)
        memcpy(r->data + ((size_t)photo * r->most + i) * CN_DESCRIPTOR, data + (size_t)order[i].index * CN_DESCRIPTOR,
               CN_DESCRIPTOR);
    free(order);
    return CN_OK;
}

static cn_status read_photo(retrieval *r, cn_colmap_database *database, uint32_t photo)
{
    uint32_t number, n = 0;
    uint8_t *data = NULL;
    float *scale = NULL;
    cn_status status = cn_colmap_number(database, r->j->index, r->j->linked, photo, &number);
    if (status == CN_OK && number) status = cn_colmap_database_descriptors(database, number, &data, &n);
    if (status == CN_OK && n) status = cn_colmap_database_scales(database, number, n, &scale);
    if (status == CN_OK && n) status = take_largest(r, photo, data, scale, n);
    free(data);
    free(scale);
    return status;
}

static cn_status read_features(retrieval *r, cn_colmap_job *j)
{
    cn_colmap_database *database;
    CN_TRY(cn_colmap_database_open(&database, j->database));
    cn_status status = CN_OK;
    for (uint32_t i = 0; i < r->n && status == CN_OK; i++) {
        status = cn_stopping(j->ctx) ? cn_fail(CN_ERR_INTERRUPTED, "stopped while comparing photos")
                                     : read_photo(r, database, i);
        cn_job_tell(j, 0);
    }
    cn_colmap_database_close(&database);
    return status;
}

static void compare_row(void *user, size_t i, unsigned worker)
{
    retrieval *r = user;
    const uint32_t a = r->row + (uint32_t)i;
    const cn_descriptors rows = { r->data + (size_t)a * r->most * CN_DESCRIPTOR, r->n_features[a] };
    for (uint32_t b = a + 1; b < r->n && !cn_stopping(r->j->ctx); b++) {
        const cn_descriptors columns = { r->data + (size_t)b * r->most * CN_DESCRIPTOR, r->n_features[b] };
        cn_match_space *space = &r->spaces[worker];
        if (cn_match_features(r->kernel, rows, columns, space) != CN_OK) {
            __atomic_store_n(&r->no_memory, 1, __ATOMIC_RELAXED);
            return;
        }
        r->matches[(size_t)a * r->n + b] = (uint8_t)(space->n_pairs < 255 ? space->n_pairs : 255);
    }
}

static cn_status compare_all(retrieval *r, cn_colmap_job *j)
{
    double done = 0;
    for (r->row = 0; r->row < r->n; r->row += ROWS_AT_ONCE) {
        const uint32_t left = r->n - r->row, rows = left < ROWS_AT_ONCE ? left : ROWS_AT_ONCE;
        cn_pool_run(j->ctx ? j->ctx->pool : NULL, rows, compare_row, r);
        if (r->no_memory) return cn_fail(CN_ERR_NOMEM, "out of memory comparing photos");
        if (cn_stopping(j->ctx)) return cn_fail(CN_ERR_INTERRUPTED, "stopped while comparing photos");
        for (uint32_t a = r->row; a < r->row + rows; a++)
            done += r->n - 1 - a;
        cn_job_tell(j, done);
    }
    return CN_OK;
}

static uint8_t matches_of(const retrieval *r, uint32_t a, uint32_t b)
{
    return a < b ? r->matches[(size_t)a * r->n + b] : r->matches[(size_t)b * r->n + a];
}

/* Adds the partners of a photo: those with the most matches; of equal ones, those that are nearest by name. */
static bool add_partners(const retrieval *r, uint32_t photo, cn_photo_pairs *pairs)
{
    uint32_t with[256] = { 0 }, n = 0, least = 255;
    for (uint32_t i = 0; i < r->n; i++)
        if (i != photo) with[matches_of(r, photo, i)]++;
    while (least > LEAST_MATCHES && n + with[least] <= PARTNERS)
        n += with[least--];
    bool fine = true;
    for (uint32_t step = 1; step < r->n && fine; step++)
        for (int side = 0; side < 2 && fine; side++) {
            if (side ? step > photo : step >= r->n - photo) continue;
            const uint32_t other = side ? photo - step : photo + step, matches = matches_of(r, photo, other);
            const bool equal = matches == least && n < PARTNERS;
            if (matches > least || equal || other + 1 == photo) fine = cn_photo_pairs_add(pairs, photo, other);
            n += equal;
        }
    return fine;
}

static cn_status choose(const retrieval *r, cn_photo_pairs *pairs)
{
    for (uint32_t i = 0; i < r->n; i++)
        if (!add_partners(r, i, pairs)) {
            cn_photo_pairs_deinit(pairs);
            return cn_fail(CN_ERR_NOMEM, "out of memory listing photo pairs");
        }
    cn_photo_pairs_sort(pairs);
    return CN_OK;
}

static void retrieval_deinit(retrieval *r, unsigned threads)
{
    for (unsigned i = 0; r->spaces && i < threads; i++)
        cn_match_space_deinit(&r->spaces[i]);
    free(r->data);
    free(r->n_features);
    free(r->matches);
    free(r->spaces);
}

cn_status cn_photo_pairs_retrieve(cn_colmap_job *j, cn_photo_pairs *pairs)
{
    const unsigned threads = cn_pool_threads(j->ctx ? j->ctx->pool : NULL);
    const uint32_t n = j->index->n_photos;
    retrieval r = { .j = j, .kernel = cn_kernel_best(), .n = n };
    const double share = n > FEW_PHOTOS ? (double)FEW_PHOTOS / n : 1;
    r.most = (uint32_t)fmax(MOST_FEATURES * share, LEAST_FEATURES);
    r.data = malloc((size_t)n * r.most * CN_DESCRIPTOR + 1);
    r.n_features = calloc(n + (size_t)1, sizeof *r.n_features);
    r.matches = calloc(n + (size_t)1, n + (size_t)1);
    r.spaces = calloc(threads, sizeof *r.spaces);
    cn_job_begin(j, "comparison", 0.5 * n * (n - 1.0));
    cn_status status = r.data && r.n_features && r.matches && r.spaces
                           ? read_features(&r, j)
                           : cn_fail(CN_ERR_NOMEM, "out of memory comparing %u photos", n);
    if (status == CN_OK) status = compare_all(&r, j);
    if (status == CN_OK) status = choose(&r, pairs);
    if (status == CN_OK)
        cn_log(j->ctx, CN_LOG_INFO, "the largest features of %zu of %.0f pairs of photos match", pairs->n,
               0.5 * n * (n - 1.0));
    retrieval_deinit(&r, threads);
    return status;
}
