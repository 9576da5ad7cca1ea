#include "colmap_database.h"

#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include <sqlite3.h>
#include <stdio.h>
#include <stdlib.h>

static sqlite3 *open_base(const char *path)
{
    sqlite3 *base;
    assert_int_equal(sqlite3_open(path, &base), SQLITE_OK);
    return base;
}

void colmap_database_run(const char *path, const char *sql)
{
    sqlite3 *base = open_base(path);
    if (sqlite3_exec(base, sql, NULL, NULL, NULL) != SQLITE_OK) fail_msg("%s: %s", sql, sqlite3_errmsg(base));
    sqlite3_close(base);
}

void colmap_database_make(const char *path)
{
    colmap_database_run(
        path, "PRAGMA journal_mode = WAL;"
              "CREATE TABLE images(image_id INTEGER PRIMARY KEY, name TEXT UNIQUE, camera_id INTEGER);"
              "CREATE TABLE cameras(camera_id INTEGER PRIMARY KEY, model INTEGER, width INTEGER, height INTEGER, "
              "params BLOB, "
              "prior_focal_length INTEGER);"
              "CREATE TABLE descriptors(image_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER, data BLOB);"
              "CREATE TABLE keypoints(image_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER, data BLOB);"
              "CREATE TABLE matches(pair_id INTEGER PRIMARY KEY, rows INTEGER NOT NULL, cols INTEGER NOT NULL, data "
              "BLOB);"
              "CREATE TABLE two_view_geometries(pair_id INTEGER PRIMARY KEY, rows INTEGER NOT NULL, cols INTEGER NOT "
              "NULL, data BLOB, config INTEGER NOT NULL, F BLOB, E BLOB, H BLOB, qvec BLOB, tvec BLOB)");
}

void colmap_database_add(const char *path, uint32_t photo, const char *name, const uint8_t *descriptors, uint32_t n)
{
    sqlite3 *base = open_base(path);
    sqlite3_stmt *image, *rows;
    assert_int_equal(sqlite3_prepare_v2(base, "INSERT INTO images VALUES(?1, ?2, 1)", -1, &image, NULL), SQLITE_OK);
    sqlite3_bind_int64(image, 1, photo);
    sqlite3_bind_text(image, 2, name, -1, SQLITE_TRANSIENT);
    assert_int_equal(sqlite3_step(image), SQLITE_DONE);
    assert_int_equal(sqlite3_prepare_v2(base, "INSERT INTO descriptors VALUES(?1, ?2, 128, ?3)", -1, &rows, NULL),
                     SQLITE_OK);
    sqlite3_bind_int64(rows, 1, photo);
    sqlite3_bind_int64(rows, 2, n);
    sqlite3_bind_blob(rows, 3, n ? descriptors : NULL, (int)(128 * n), SQLITE_TRANSIENT);
    assert_int_equal(sqlite3_step(rows), SQLITE_DONE);
    sqlite3_finalize(image);
    sqlite3_finalize(rows);
    sqlite3_close(base);
}

void colmap_database_add_keypoints(const char *path, uint32_t photo, const float (*keypoints)[6], uint32_t n)
{
    sqlite3 *base = open_base(path);
    sqlite3_stmt *rows;
    assert_int_equal(sqlite3_prepare_v2(base, "INSERT INTO keypoints VALUES(?1, ?2, 6, ?3)", -1, &rows, NULL),
                     SQLITE_OK);
    sqlite3_bind_int64(rows, 1, photo);
    sqlite3_bind_int64(rows, 2, n);
    sqlite3_bind_blob(rows, 3, keypoints, (int)(n * sizeof *keypoints), SQLITE_TRANSIENT);
    assert_int_equal(sqlite3_step(rows), SQLITE_DONE);
    sqlite3_finalize(rows);
    sqlite3_close(base);
}

void colmap_database_relate(const char *path, uint32_t a, uint32_t b, uint32_t n)
{
    char sql[256];
    const uint32_t first = a < b ? a : b, second = a < b ? b : a;
    snprintf(sql, sizeof sql, "INSERT INTO two_view_geometries(pair_id, rows, cols, config) VALUES(%lld, %u, 2, 2)",
             first * 2147483647LL + second, n);
    colmap_database_run(path, sql);
}

int64_t colmap_database_ask(const char *path, const char *sql)
{
    sqlite3 *base = open_base(path);
    sqlite3_stmt *s;
    assert_int_equal(sqlite3_prepare_v2(base, sql, -1, &s, NULL), SQLITE_OK);
    assert_int_equal(sqlite3_step(s), SQLITE_ROW);
    const int64_t answer = sqlite3_column_int64(s, 0);
    sqlite3_finalize(s);
    sqlite3_close(base);
    return answer;
}

char *colmap_database_dump(const char *path)
{
    char *text;
    size_t size;
    sqlite3 *base = open_base(path);
    sqlite3_stmt *s;
    FILE *stream = open_memstream(&text, &size);
    assert_non_null(stream);
    assert_int_equal(
        sqlite3_prepare_v2(base,
                           "SELECT 'match', pair_id, rows, cols, hex(data) FROM matches UNION ALL SELECT "
                           "'geometry', pair_id, rows, cols, config FROM two_view_geometries ORDER BY 1, 2",
                           -1, &s, NULL),
        SQLITE_OK);
    while (sqlite3_step(s) == SQLITE_ROW)
        for (int i = 0; i < 5; i++)
            fprintf(stream, "%s%c", (const char *)sqlite3_column_text(s, i), i < 4 ? ' ' : '\n');
    sqlite3_finalize(s);
    sqlite3_close(base);
    assert_int_equal(fclose(stream), 0);
    return text;
}

void colmap_database_bind(const char *path, const char *sql, int64_t key, const void *a, size_t a_size, const void *b,
                          size_t b_size)
{
    sqlite3 *base = open_base(path);
    sqlite3_stmt *s;
    if (sqlite3_prepare_v2(base, sql, -1, &s, NULL) != SQLITE_OK) fail_msg("%s: %s", sql, sqlite3_errmsg(base));
    sqlite3_bind_int64(s, 1, key);
    sqlite3_bind_blob(s, 2, a, (int)a_size, SQLITE_TRANSIENT);
    if (b) sqlite3_bind_blob(s, 3, b, (int)b_size, SQLITE_TRANSIENT);
    assert_int_equal(sqlite3_step(s), SQLITE_DONE);
    sqlite3_finalize(s);
    sqlite3_close(base);
}
