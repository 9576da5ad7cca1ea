#include "pose/pair_matcher.h"

#include "base/clock.h"
#include "bridge/sqlite.h"
#include "pose/colmap.h"
#include "pose/feature_match.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { LEAST_MATCHES = 15 }; /* COLMAP's SiftMatching.min_num_inliers: it does not verify pairs with fewer */
enum { FIRST_BATCH = 4, MOST_IN_BATCH = 4096 }; /* pairs: a thread, at first; in all */
#define BATCH_S 1.0
#define MOST_BYTES ((size_t)512 << 20) /* of descriptors in memory, unless the job says otherwise */

_Static_assert((int)CN_COLMAP_DESCRIPTOR == (int)CN_DESCRIPTOR, "the kernel's descriptors are COLMAP's");

typedef struct features {
    uint32_t number; /* of the photo in the database; 0: not there */
    uint32_t n;
    uint8_t *data;
    bool loaded;
    uint64_t batch; /* the last one that needed it */
} features;

typedef struct result {
    bool done;
    uint32_t n;
    cn_feature_pair *pairs;
} result;

typedef struct matcher {
    cn_colmap_job *j;
    cn_pool *pool;
    cn_colmap_database *database;
    const cn_kernel *kernel;
    features *photos;
    cn_match_space *spaces; /* one a thread */
    result *results;
    const uint64_t *batch; /* pairs being matched */
    uint64_t n_batches;
    size_t bytes, most_bytes; /* of descriptors in memory; from when they are dropped */
    int no_memory;            /* set by threads */
} matcher;

static void matcher_deinit(matcher *m)
{
    for (uint32_t i = 0; m->photos && i < m->j->index->n_photos; i++)
        free(m->photos[i].data);
    for (uint32_t i = 0; m->spaces && i < cn_pool_threads(m->pool); i++)
        cn_match_space_deinit(&m->spaces[i]);
    for (uint32_t i = 0; m->results && i < MOST_IN_BATCH; i++)
        free(m->results[i].pairs);
    free(m->photos);
    free(m->spaces);
    free(m->results);
    cn_colmap_database_close(&m->database);
}

static cn_status find_photos(matcher *m)
{
    for (uint32_t i = 0; i < m->j->index->n_photos; i++)
        CN_TRY(cn_colmap_number(m->database, m->j->index, m->j->linked, i, &m->photos[i].number));
    return CN_OK;
}

static cn_status open_database(matcher *m, const char *path)
{
    char said[512];
    const cn_status status = cn_colmap_database_open(&m->database, path);
    if (status != CN_ERR_FORMAT) return status;
    snprintf(said, sizeof said, "%s", cn_error_message());
    return cn_fail(status, "%s; remove the file to find the features again", said);
}

static cn_status matcher_init(matcher *m, cn_colmap_job *j)
{
    *m = (matcher){ .j = j,
                    .pool = j->ctx ? j->ctx->pool : NULL,
                    .kernel = cn_kernel_best(),
                    .most_bytes = j->most_bytes ? j->most_bytes : MOST_BYTES };
    CN_TRY(open_database(m, j->database));
    m->photos = calloc(j->index->n_photos + (size_t)1, sizeof *m->photos);
    m->spaces = calloc(cn_pool_threads(m->pool), sizeof *m->spaces);
    m->results = calloc(MOST_IN_BATCH, sizeof *m->results);
    cn_status status = m->photos && m->spaces && m->results ? find_photos(m) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status != CN_OK) matcher_deinit(m);
    return status;
}

static features *photo_of(const matcher *m, uint64_t pair, bool second)
{
    return &m->photos[second ? (uint32_t)pair : (uint32_t)(pair >> 32)];
}

static cn_status load(matcher *m, features *photo)
{
    photo->batch = m->n_batches;
    if (photo->loaded) return CN_OK;
    CN_TRY(cn_colmap_database_descriptors(m->database, photo->number, &photo->data, &photo->n));
    photo->loaded = true;
    m->bytes += (size_t)photo->n * CN_DESCRIPTOR;
    return CN_OK;
}

static void drop_unneeded(matcher *m)
{
    for (uint32_t i = 0; i < m->j->index->n_photos; i++) {
        features *photo = &m->photos[i];
        if (!photo->loaded || photo->batch == m->n_batches) continue;
        m->bytes -= (size_t)photo->n * CN_DESCRIPTOR;
        free(photo->data);
        photo->data = NULL;
        photo->loaded = false;
    }
}

/* Loads what the next pairs need: `wanted` pairs, or fewer, but at least one, when their descriptors take too much
 * memory. */
static cn_status load_batch(matcher *m, size_t wanted, size_t *n)
{
    m->n_batches++;
    for (*n = 0; *n < wanted && (*n == 0 || m->bytes <= m->most_bytes);) {
        CN_TRY(load(m, photo_of(m, m->batch[*n], false)));
        CN_TRY(load(m, photo_of(m, m->batch[*n], true)));
        ++*n;
        if (m->bytes > m->most_bytes) drop_unneeded(m);
    }
    return CN_OK;
}

static void match_one(void *user, size_t i, unsigned worker)
{
    matcher *m = user;
    result *to = &m->results[i];
    if (cn_stopping(m->j->ctx)) return;
    cn_match_space *space = &m->spaces[worker];
    const features *a = photo_of(m, m->batch[i], false), *b = photo_of(m, m->batch[i], true);
    const cn_descriptors rows = { a->data, a->n }, columns = { b->data, b->n };
    bool fine = cn_match_features(m->kernel, rows, columns, space) == CN_OK;
    to->n = space->n_pairs < LEAST_MATCHES ? 0 : space->n_pairs;
    if (fine && to->n) {
        to->pairs = malloc(to->n * sizeof *to->pairs);
        fine = to->pairs != NULL;
        if (fine) memcpy(to->pairs, space->pairs, to->n * sizeof *to->pairs);
    }
    to->done = fine;
    if (!fine) __atomic_store_n(&m->no_memory, 1, __ATOMIC_RELAXED);
}

static cn_status write_one(matcher *m, size_t i)
{
    const result *r = &m->results[i];
    const uint32_t a = photo_of(m, m->batch[i], false)->number, b = photo_of(m, m->batch[i], true)->number;
    if (!r->done) return CN_OK;
    if (!r->n) return cn_colmap_database_write_unrelated(m->database, a, b);
    const cn_colmap_pair_matches matches = { a, b, r->n, (const uint32_t(*)[2])(const void *)r->pairs };
    return cn_colmap_database_write_matches(m->database, &matches);
}

static cn_status write_batch(matcher *m, size_t n)
{
    cn_status status = cn_colmap_database_begin(m->database);
    for (size_t i = 0; i < n && status == CN_OK; i++)
        status = write_one(m, i);
    if (status == CN_OK)
        status = cn_colmap_database_commit(m->database);
    else
        cn_colmap_database_rollback(m->database);
    for (size_t i = 0; i < n; i++) {
        free(m->results[i].pairs);
        m->results[i] = (result){ 0 };
    }
    return status;
}

static cn_status match_list(matcher *m, const cn_photo_pairs *todo)
{
    cn_colmap_job *j = m->j;
    size_t wanted = FIRST_BATCH * (size_t)cn_pool_threads(m->pool), n;
    for (size_t at = 0; at < todo->n; at += n) {
        const double from_s = cn_now_s();
        if (wanted > MOST_IN_BATCH) wanted = MOST_IN_BATCH;
        m->batch = todo->items + at;
        CN_TRY(load_batch(m, wanted < todo->n - at ? wanted : todo->n - at, &n));
        cn_pool_run(m->pool, n, match_one, m);
        CN_TRY(write_batch(m, n));
        if (m->no_memory) return cn_fail(CN_ERR_NOMEM, "out of memory matching photos");
        if (cn_stopping(j->ctx)) return cn_fail(CN_ERR_INTERRUPTED, "stopped while matching; a second run resumes");
        cn_job_tell(j, j->base + (double)(at + n));
        const double factor = BATCH_S / fmax(cn_now_s() - from_s, 1e-3);
        wanted = (size_t)ceil((double)wanted * fmin(fmax(factor, 0.5), 2.0));
    }
    return CN_OK;
}

/* The pairs of the list whose photos are in the database and of which it says what is asked for. */
static cn_status choose(const matcher *m, const cn_photo_pairs *pairs, bool (*is_wanted)(const cn_colmap_pair *),
                        cn_photo_pairs *out)
{
    for (size_t i = 0; i < pairs->n; i++) {
        const uint32_t a = photo_of(m, pairs->items[i], false)->number, b = photo_of(m, pairs->items[i], true)->number;
        cn_colmap_pair state;
        if (!a || !b) continue;
        CN_TRY(cn_colmap_database_pair(m->database, a, b, &state));
        if (!is_wanted(&state)) continue;
        if (!cn_photo_pairs_add(out, (uint32_t)(pairs->items[i] >> 32), (uint32_t)pairs->items[i]))
            return cn_fail(CN_ERR_NOMEM, "out of memory listing photo pairs");
    }
    return CN_OK;
}

static bool is_unmatched(const cn_colmap_pair *pair)
{
    return !pair->matched;
}

static bool is_unverified(const cn_colmap_pair *pair)
{
    return pair->matched && !pair->verified;
}

cn_status cn_pairs_match(cn_colmap_job *j, const cn_photo_pairs *pairs)
{
    matcher m;
    cn_photo_pairs todo = { 0 };
    CN_TRY(matcher_init(&m, j));
    cn_status status = choose(&m, pairs, is_unmatched, &todo);
    j->base = j->done = (double)(pairs->n - todo.n);
    if (status == CN_OK) status = match_list(&m, &todo);
    cn_photo_pairs_deinit(&todo);
    matcher_deinit(&m);
    return status;
}

cn_status cn_pairs_unverified(const cn_colmap_job *j, const cn_photo_pairs *pairs, cn_photo_pairs *left)
{
    matcher m;
    cn_colmap_job copy = *j;
    CN_TRY(matcher_init(&m, &copy));
    const cn_status status = choose(&m, pairs, is_unverified, left);
    if (status != CN_OK) cn_photo_pairs_deinit(left);
    matcher_deinit(&m);
    return status;
}
