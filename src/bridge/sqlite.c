#include "bridge/sqlite.h"

#include <math.h>
#include <sqlite3.h>
#include <stdlib.h>
#include <string.h>

enum {
    PHOTO,
    DESCRIPTORS,
    KEYPOINTS,
    MATCHED,
    VERIFIED,
    WRITE_MATCHES,
    WRITE_GEOMETRY,
    CAMERAS,
    LENS,
    GEOMETRY,
    SIMPLIFY,
    BEGIN,
    COMMIT,
    ROLLBACK,
    COUNT,
    PAIRS,
    N_STATEMENTS
};

struct cn_colmap_database {
    char *path;
    sqlite3 *connection;
    sqlite3_stmt *camera, *statements[N_STATEMENTS];
};

static cn_status damaged(const cn_colmap_database *d)
{
    return cn_fail(CN_ERR_FORMAT, "%s: this COLMAP database cannot be read: %s", d->path,
                   d->connection ? sqlite3_errmsg(d->connection) : "out of memory");
}

/* COLMAP does not wait for the disk, so a power loss can leave a database in part. */
static cn_status check_whole(const cn_colmap_database *d)
{
    sqlite3_stmt *check = NULL;
    bool whole = sqlite3_prepare_v2(d->connection, "PRAGMA quick_check(1)", -1, &check, NULL) == SQLITE_OK &&
                 sqlite3_step(check) == SQLITE_ROW;
    const char *answer = whole ? (const char *)sqlite3_column_text(check, 0) : NULL;
    whole = answer && strcmp(answer, "ok") == 0;
    sqlite3_finalize(check);
    return whole ? CN_OK : damaged(d);
}

cn_status cn_colmap_database_open(cn_colmap_database **database, const char *path)
{
    cn_colmap_database *d = *database = calloc(1, sizeof *d);
    if (d) d->path = strdup(path);
    if (!d || !d->path) {
        cn_colmap_database_close(database);
        return cn_fail(CN_ERR_NOMEM, "%s: out of memory", path);
    }
    static const char query[] = "SELECT camera_id FROM images WHERE name = ?1";
    /* A killed COLMAP leaves a log beside the database. To apply that log, SQLite must be able to write. */
    cn_status status =
        sqlite3_open_v2(path, &d->connection, SQLITE_OPEN_READWRITE, NULL) == SQLITE_OK ? check_whole(d) : damaged(d);
    if (status == CN_OK && sqlite3_prepare_v2(d->connection, query, -1, &d->camera, NULL) != SQLITE_OK)
        status = damaged(d);
    if (status != CN_OK) cn_colmap_database_close(database);
    return status;
}

void cn_colmap_database_close(cn_colmap_database **database)
{
    if (!*database) return;
    sqlite3_finalize((*database)->camera);
    for (int i = 0; i < N_STATEMENTS; i++)
        sqlite3_finalize((*database)->statements[i]);
    sqlite3_close((*database)->connection);
    free((*database)->path);
    free(*database);
    *database = NULL;
}

cn_status cn_colmap_database_camera(cn_colmap_database *d, const char *name, uint32_t *camera)
{
    *camera = 0;
    sqlite3_reset(d->camera);
    if (sqlite3_bind_text(d->camera, 1, name, -1, SQLITE_TRANSIENT) != SQLITE_OK) return damaged(d);
    const int step = sqlite3_step(d->camera);
    if (step == SQLITE_ROW) *camera = (uint32_t)sqlite3_column_int64(d->camera, 0);
    const cn_status status = step == SQLITE_ROW || step == SQLITE_DONE ? CN_OK : damaged(d);
    sqlite3_reset(d->camera);
    return status;
}

/* ---- features and matches ---- */

static const char *const STATEMENTS[N_STATEMENTS] = {
    "SELECT image_id FROM images WHERE name = ?1",
    "SELECT rows, cols, data FROM descriptors WHERE image_id = ?1",
    "SELECT rows, cols, data FROM keypoints WHERE image_id = ?1",
    "SELECT 1 FROM matches WHERE pair_id = ?1",
    "SELECT 1 FROM two_view_geometries WHERE pair_id = ?1",
    "INSERT OR REPLACE INTO matches(pair_id, rows, cols, data) VALUES(?1, ?2, 2, ?3)",
    "INSERT OR REPLACE INTO two_view_geometries(pair_id, rows, cols, config) VALUES(?1, 0, 2, 0)",
    "SELECT camera_id, params FROM cameras WHERE model = 4",
    "SELECT model, width, height, prior_focal_length, params FROM cameras WHERE camera_id = ?1",
    "SELECT config, rows, data, F, E FROM two_view_geometries WHERE pair_id = ?1",
    "UPDATE cameras SET model = 2, params = ?2 WHERE camera_id = ?1",
    "BEGIN IMMEDIATE",
    "COMMIT",
    "ROLLBACK",
    "SELECT rows FROM descriptors WHERE image_id = ?1",
    "SELECT pair_id, rows FROM two_view_geometries WHERE rows > 0",
};

/* Statements are prepared when they are first used. NULL: COLMAP's tables are missing. */
static sqlite3_stmt *use(cn_colmap_database *d, int which)
{
    if (!d->statements[which] &&
        sqlite3_prepare_v2(d->connection, STATEMENTS[which], -1, &d->statements[which], NULL) != SQLITE_OK)
        return NULL;
    sqlite3_reset(d->statements[which]);
    return d->statements[which];
}

static cn_status run(cn_colmap_database *d, int which)
{
    sqlite3_stmt *s = use(d, which);
    const cn_status status = s && sqlite3_step(s) == SQLITE_DONE ? CN_OK : damaged(d);
    if (s) sqlite3_reset(s);
    return status;
}

cn_status cn_colmap_database_photo(cn_colmap_database *d, const char *name, uint32_t *photo)
{
    *photo = 0;
    sqlite3_stmt *s = use(d, PHOTO);
    if (!s || sqlite3_bind_text(s, 1, name, -1, SQLITE_TRANSIENT) != SQLITE_OK) return damaged(d);
    const int step = sqlite3_step(s);
    if (step == SQLITE_ROW) *photo = (uint32_t)sqlite3_column_int64(s, 0);
    const cn_status status = step == SQLITE_ROW || step == SQLITE_DONE ? CN_OK : damaged(d);
    sqlite3_reset(s);
    return status;
}

cn_status cn_colmap_database_lens(cn_colmap_database *d, uint32_t camera, cn_colmap_camera *out)
{
    *out = (cn_colmap_camera){ 0 };
    sqlite3_stmt *s = use(d, LENS);
    if (!s || sqlite3_bind_int64(s, 1, camera) != SQLITE_OK) return damaged(d);
    bool found = sqlite3_step(s) == SQLITE_ROW;
    const int size = found ? sqlite3_column_bytes(s, 4) : 0;
    found = found && size >= (int)sizeof *out->params && size <= (int)sizeof out->params;
    if (found) {
        out->lens = sqlite3_column_int(s, 0);
        out->width = (uint32_t)sqlite3_column_int64(s, 1);
        out->height = (uint32_t)sqlite3_column_int64(s, 2);
        out->has_focal = sqlite3_column_int(s, 3) != 0;
        memcpy(out->params, sqlite3_column_blob(s, 4), (size_t)size);
    }
    sqlite3_reset(s);
    if (found && isfinite(out->params[0]) && out->params[0] > 0.0) return CN_OK;
    return cn_fail(CN_ERR_FORMAT, "%s: camera %u is missing or damaged; remove the file to find the features again",
                   d->path, camera);
}

/* Takes the row that s stands on. */
static cn_status take_descriptors(const cn_colmap_database *d, sqlite3_stmt *s, uint32_t photo, uint8_t **data,
                                  uint32_t *n)
{
    const int64_t rows = sqlite3_column_int64(s, 0), columns = sqlite3_column_int64(s, 1);
    const void *bytes = sqlite3_column_blob(s, 2);
    const int size = sqlite3_column_bytes(s, 2);
    if (rows < 0 || columns != CN_COLMAP_DESCRIPTOR || rows > INT32_MAX / CN_COLMAP_DESCRIPTOR ||
        rows * CN_COLMAP_DESCRIPTOR != size)
        return cn_fail(CN_ERR_FORMAT,
                       "%s: the descriptors of photo %u are damaged: %lld x %lld in %d bytes; remove the file to find "
                       "the features again",
                       d->path, photo, (long long)rows, (long long)columns, size);
    if (rows == 0) return CN_OK;
    *data = malloc((size_t)size);
    if (!*data) return cn_fail(CN_ERR_NOMEM, "%s: out of memory", d->path);
    memcpy(*data, bytes, (size_t)size);
    *n = (uint32_t)rows;
    return CN_OK;
}

cn_status cn_colmap_database_descriptors(cn_colmap_database *d, uint32_t photo, uint8_t **data, uint32_t *n)
{
    *data = NULL;
    *n = 0;
    sqlite3_stmt *s = use(d, DESCRIPTORS);
    if (!s || sqlite3_bind_int64(s, 1, photo) != SQLITE_OK) return damaged(d);
    const int step = sqlite3_step(s);
    cn_status status = CN_OK;
    if (step == SQLITE_ROW) status = take_descriptors(d, s, photo, data, n);
    if (step != SQLITE_ROW && step != SQLITE_DONE) status = damaged(d);
    sqlite3_reset(s);
    return status;
}

/* A keypoint is x, y; or these with scale and orientation; or these with an affine shape, whose determinant is the
 * square of the scale. */
static cn_status take_scales(const cn_colmap_database *d, sqlite3_stmt *s, uint32_t photo, uint32_t n, float *scale)
{
    const int64_t rows = sqlite3_column_int64(s, 0), columns = sqlite3_column_int64(s, 1);
    const char *bytes = sqlite3_column_blob(s, 2);
    if (rows != n || (columns != 2 && columns != 4 && columns != 6) ||
        rows * columns * (int64_t)sizeof(float) != sqlite3_column_bytes(s, 2))
        return cn_fail(CN_ERR_FORMAT,
                       "%s: the keypoints of photo %u are damaged; remove the file to find the features "
                       "again",
                       d->path, photo);
    for (uint32_t i = 0; i < n; i++) {
        float row[6] = { 0, 0, 1, 0, 0, 1 };
        memcpy(row, bytes + sizeof(float) * (size_t)columns * i, sizeof(float) * (size_t)columns);
        scale[i] = columns == 6 ? sqrtf(fabsf(row[2] * row[5] - row[3] * row[4])) : row[2];
    }
    return CN_OK;
}

cn_status cn_colmap_database_scales(cn_colmap_database *d, uint32_t photo, uint32_t n, float **scale)
{
    sqlite3_stmt *s = use(d, KEYPOINTS);
    *scale = malloc(sizeof **scale * (n + (size_t)1));
    if (!*scale) return cn_fail(CN_ERR_NOMEM, "%s: out of memory", d->path);
    if (!s || sqlite3_bind_int64(s, 1, photo) != SQLITE_OK) return damaged(d);
    const int step = sqlite3_step(s);
    const cn_status status = step == SQLITE_ROW ? take_scales(d, s, photo, n, *scale) : damaged(d);
    sqlite3_reset(s);
    return status;
}

static cn_status take_places(const cn_colmap_database *d, sqlite3_stmt *s, uint32_t photo, float (**xy)[2], uint32_t *n)
{
    const int64_t rows = sqlite3_column_int64(s, 0), columns = sqlite3_column_int64(s, 1);
    const char *bytes = sqlite3_column_blob(s, 2);
    if (rows < 0 || rows > INT32_MAX || columns < 2 || columns > 6 ||
        rows * columns * (int64_t)sizeof(float) != sqlite3_column_bytes(s, 2))
        return cn_fail(CN_ERR_FORMAT,
                       "%s: the keypoints of photo %u are damaged; remove the file to find the features again", d->path,
                       photo);
    if (rows == 0) return CN_OK;
    *xy = malloc((size_t)rows * sizeof **xy);
    if (!*xy) return cn_fail(CN_ERR_NOMEM, "%s: out of memory", d->path);
    for (int64_t i = 0; i < rows; i++)
        memcpy((*xy)[i], bytes + (int64_t)sizeof(float) * columns * i, sizeof **xy);
    *n = (uint32_t)rows;
    return CN_OK;
}

cn_status cn_colmap_database_places(cn_colmap_database *d, uint32_t photo, float (**xy)[2], uint32_t *n)
{
    sqlite3_stmt *s = use(d, KEYPOINTS);
    *xy = NULL;
    *n = 0;
    if (!s || sqlite3_bind_int64(s, 1, photo) != SQLITE_OK) return damaged(d);
    const int step = sqlite3_step(s);
    cn_status status = CN_OK;
    if (step == SQLITE_ROW) status = take_places(d, s, photo, xy, n);
    if (step != SQLITE_ROW && step != SQLITE_DONE) status = damaged(d);
    sqlite3_reset(s);
    return status;
}

cn_status cn_colmap_database_count(cn_colmap_database *d, uint32_t photo, uint32_t *n)
{
    *n = 0;
    sqlite3_stmt *s = use(d, COUNT);
    if (!s || sqlite3_bind_int64(s, 1, photo) != SQLITE_OK) return damaged(d);
    const int step = sqlite3_step(s);
    const int64_t rows = step == SQLITE_ROW ? sqlite3_column_int64(s, 0) : 0;
    *n = rows > 0 && rows < UINT32_MAX ? (uint32_t)rows : 0;
    sqlite3_reset(s);
    return step == SQLITE_ROW || step == SQLITE_DONE ? CN_OK : damaged(d);
}

/* COLMAP's number of a pair: that of the photo with the smaller number, times 2^31 - 1, plus the other. */
static sqlite3_int64 pair_number(uint32_t a, uint32_t b)
{
    const uint32_t low = a < b ? a : b, high = a < b ? b : a;
    return (sqlite3_int64)INT32_MAX * low + high;
}

static cn_status is_there(cn_colmap_database *d, int which, sqlite3_int64 pair, bool *there)
{
    sqlite3_stmt *s = use(d, which);
    if (!s || sqlite3_bind_int64(s, 1, pair) != SQLITE_OK) return damaged(d);
    const int step = sqlite3_step(s);
    *there = step == SQLITE_ROW;
    sqlite3_reset(s);
    return step == SQLITE_ROW || step == SQLITE_DONE ? CN_OK : damaged(d);
}

cn_status cn_colmap_database_pair(cn_colmap_database *d, uint32_t a, uint32_t b, cn_colmap_pair *state)
{
    CN_TRY(is_there(d, MATCHED, pair_number(a, b), &state->matched));
    return is_there(d, VERIFIED, pair_number(a, b), &state->verified);
}

static cn_status append(const cn_colmap_database *d, cn_colmap_verified **pairs, size_t n, sqlite3_stmt *s)
{
    const sqlite3_int64 pair = sqlite3_column_int64(s, 0), rows = sqlite3_column_int64(s, 1);
    /* Powers of two: the list grows when it is full. */
    if ((n & (n - 1)) == 0) {
        cn_colmap_verified *more = realloc(*pairs, (n ? 2 * n : 1) * sizeof *more);
        if (!more) return cn_fail(CN_ERR_NOMEM, "%s: out of memory", d->path);
        *pairs = more;
    }
    (*pairs)[n] = (cn_colmap_verified){ (uint32_t)(pair / INT32_MAX), (uint32_t)(pair % INT32_MAX),
                                        rows < UINT32_MAX ? (uint32_t)rows : UINT32_MAX };
    return CN_OK;
}

cn_status cn_colmap_database_verified(cn_colmap_database *d, cn_colmap_verified **pairs, size_t *n)
{
    *pairs = NULL;
    *n = 0;
    sqlite3_stmt *s = use(d, PAIRS);
    if (!s) return damaged(d);
    int step = sqlite3_step(s);
    cn_status status = CN_OK;
    for (; step == SQLITE_ROW && status == CN_OK; step = sqlite3_step(s)) {
        status = append(d, pairs, *n, s);
        *n += status == CN_OK;
    }
    if (status == CN_OK && step != SQLITE_DONE) status = damaged(d);
    sqlite3_reset(s);
    if (status == CN_OK) return CN_OK;
    free(*pairs);
    *pairs = NULL;
    *n = 0;
    return status;
}

cn_status cn_colmap_database_begin(cn_colmap_database *d)
{
    return run(d, BEGIN);
}

cn_status cn_colmap_database_commit(cn_colmap_database *d)
{
    return run(d, COMMIT);
}

void cn_colmap_database_rollback(cn_colmap_database *d)
{
    sqlite3_stmt *s = use(d, ROLLBACK);
    if (!s) return;
    sqlite3_step(s);
    sqlite3_reset(s);
}

static cn_status not_written(const cn_colmap_database *d)
{
    return cn_fail(CN_ERR_IO, "%s: cannot write matches: %s", d->path, sqlite3_errmsg(d->connection));
}

/* A matrix of the row that s stands on; false: there is none. */
static bool take_matrix(sqlite3_stmt *s, int column, double m[9])
{
    if (sqlite3_column_bytes(s, column) != 9 * (int)sizeof *m) return false;
    memcpy(m, sqlite3_column_blob(s, column), 9 * sizeof *m);
    bool any = false;
    for (int i = 0; i < 9; i++) {
        if (!isfinite(m[i])) return false;
        any = any || m[i] != 0.0;
    }
    return any;
}

static cn_status take_geometry(const cn_colmap_database *d, sqlite3_stmt *s, cn_colmap_geometry *out)
{
    const int64_t rows = sqlite3_column_int64(s, 1);
    const int size = sqlite3_column_bytes(s, 2);
    out->config = sqlite3_column_int(s, 0);
    if (rows < 0 || rows > INT32_MAX / (int64_t)sizeof *out->pairs || rows * (int64_t)sizeof *out->pairs != size)
        return cn_fail(CN_ERR_FORMAT, "%s: verified matches are damaged: %lld rows in %d bytes", d->path,
                       (long long)rows, size);
    if (rows == 0) return CN_OK;
    out->pairs = malloc((size_t)size);
    if (!out->pairs) return cn_fail(CN_ERR_NOMEM, "%s: out of memory", d->path);
    memcpy(out->pairs, sqlite3_column_blob(s, 2), (size_t)size);
    out->n = (uint32_t)rows;
    out->has_f = take_matrix(s, 3, out->f);
    out->has_e = take_matrix(s, 4, out->e);
    return CN_OK;
}

cn_status cn_colmap_database_geometry(cn_colmap_database *d, uint32_t a, uint32_t b, cn_colmap_geometry *out)
{
    *out = (cn_colmap_geometry){ 0 };
    sqlite3_stmt *s = use(d, GEOMETRY);
    if (!s || sqlite3_bind_int64(s, 1, pair_number(a, b)) != SQLITE_OK) return damaged(d);
    const int step = sqlite3_step(s);
    cn_status status = CN_OK;
    if (step == SQLITE_ROW) status = take_geometry(d, s, out);
    if (step != SQLITE_ROW && step != SQLITE_DONE) status = damaged(d);
    sqlite3_reset(s);
    return status;
}

cn_status cn_colmap_database_write_matches(cn_colmap_database *d, const cn_colmap_pair_matches *m)
{
    const size_t size = 2 * sizeof(uint32_t) * m->n;
    uint32_t *ordered = malloc(size + 1);
    sqlite3_stmt *s = use(d, WRITE_MATCHES);
    if (!ordered) return cn_fail(CN_ERR_NOMEM, "%s: out of memory", d->path);
    for (size_t i = 0; i < m->n; i++) {
        ordered[2 * i] = m->pairs[i][m->a > m->b];
        ordered[2 * i + 1] = m->pairs[i][m->a < m->b];
    }
    const bool fine = s && size <= INT32_MAX && sqlite3_bind_int64(s, 1, pair_number(m->a, m->b)) == SQLITE_OK &&
                      sqlite3_bind_int64(s, 2, m->n) == SQLITE_OK &&
                      sqlite3_bind_blob(s, 3, m->n ? ordered : NULL, (int)size, SQLITE_STATIC) == SQLITE_OK &&
                      sqlite3_step(s) == SQLITE_DONE;
    const cn_status status = fine ? CN_OK : not_written(d);
    if (s) sqlite3_reset(s);
    if (s) sqlite3_clear_bindings(s);
    free(ordered);
    return status;
}

cn_status cn_colmap_database_write_unrelated(cn_colmap_database *d, uint32_t a, uint32_t b)
{
    CN_TRY(cn_colmap_database_write_matches(d, &(cn_colmap_pair_matches){ .a = a, .b = b }));
    sqlite3_stmt *s = use(d, WRITE_GEOMETRY);
    const bool fine = s && sqlite3_bind_int64(s, 1, pair_number(a, b)) == SQLITE_OK && sqlite3_step(s) == SQLITE_DONE;
    const cn_status status = fine ? CN_OK : not_written(d);
    if (s) sqlite3_reset(s);
    return status;
}

/* The camera of the row that s stands on: fx fy cx cy and more becomes f cx cy k. */
static cn_status simplify(cn_colmap_database *d, sqlite3_stmt *s)
{
    double full[8];
    if (sqlite3_column_bytes(s, 1) != (int)sizeof full)
        return cn_fail(CN_ERR_FORMAT, "%s: camera %lld has %d bytes of parameters, not %zu", d->path,
                       (long long)sqlite3_column_int64(s, 0), sqlite3_column_bytes(s, 1), sizeof full);
    memcpy(full, sqlite3_column_blob(s, 1), sizeof full);
    const double simple[4] = { full[0], full[2], full[3], 0.0 };
    sqlite3_stmt *update = use(d, SIMPLIFY);
    const bool fine = update && sqlite3_bind_int64(update, 1, sqlite3_column_int64(s, 0)) == SQLITE_OK &&
                      sqlite3_bind_blob(update, 2, simple, sizeof simple, SQLITE_STATIC) == SQLITE_OK &&
                      sqlite3_step(update) == SQLITE_DONE;
    const cn_status status = fine ? CN_OK : damaged(d);
    if (update) sqlite3_reset(update);
    if (update) sqlite3_clear_bindings(update);
    return status;
}

static cn_status simplify_all(cn_colmap_database *d)
{
    sqlite3_stmt *s = use(d, CAMERAS);
    if (!s) return damaged(d);
    cn_status status = CN_OK;
    int step;
    while ((step = sqlite3_step(s)) == SQLITE_ROW && status == CN_OK)
        status = simplify(d, s);
    if (status == CN_OK && step != SQLITE_DONE) status = damaged(d);
    sqlite3_reset(s);
    return status;
}

cn_status cn_colmap_database_simplify_cameras(cn_colmap_database *d)
{
    cn_status status = cn_colmap_database_begin(d);
    if (status == CN_OK) status = simplify_all(d);
    if (status == CN_OK) return cn_colmap_database_commit(d);
    cn_colmap_database_rollback(d);
    return status;
}
