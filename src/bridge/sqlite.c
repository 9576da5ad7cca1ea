#include "bridge/sqlite.h"

#include <sqlite3.h>
#include <stdlib.h>
#include <string.h>

struct cn_colmap_database {
    char *path;
    sqlite3 *connection;
    sqlite3_stmt *camera;
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
