/* COLMAP's database: what is read from it and written into it, and what a damaged one says. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "bridge/sqlite.h"
#include "colmap_database.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static char folder[64], path[96];
static cn_colmap_database *base;

static int set_up(void **state)
{
    (void)state;
    strcpy(folder, "/tmp/conurb-sqlite-XXXXXX");
    if (!mkdtemp(folder)) return -1;
    snprintf(path, sizeof path, "%s/database.db", folder);
    colmap_database_make(path);
    uint8_t bytes[3 * CN_COLMAP_DESCRIPTOR];
    for (size_t i = 0; i < sizeof bytes; i++)
        bytes[i] = (uint8_t)(7 * i);
    colmap_database_add(path, 4, "a.jpg", bytes, 3);
    colmap_database_add(path, 2, "b's.jpg", NULL, 0);
    assert_int_equal(cn_colmap_database_open(&base, path), CN_OK);
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    static const char *const suffixes[] = { "", "-wal", "-shm" };
    cn_colmap_database_close(&base);
    for (int i = 0; i < 3; i++) {
        char name[128];
        snprintf(name, sizeof name, "%s%s", path, suffixes[i]);
        unlink(name);
    }
    return rmdir(folder);
}

static void test_reads_features(void **state)
{
    (void)state;
    uint32_t photo, n;
    uint8_t *data;
    assert_int_equal(cn_colmap_database_photo(base, "a.jpg", &photo), CN_OK);
    assert_int_equal(photo, 4);
    assert_int_equal(cn_colmap_database_photo(base, "b's.jpg", &photo), CN_OK);
    assert_int_equal(photo, 2);
    assert_int_equal(cn_colmap_database_photo(base, "c.jpg", &photo), CN_OK);
    assert_int_equal(photo, 0);
    assert_int_equal(cn_colmap_database_descriptors(base, 4, &data, &n), CN_OK);
    assert_int_equal(n, 3);
    assert_int_equal(data[CN_COLMAP_DESCRIPTOR + 1], (uint8_t)(7 * (CN_COLMAP_DESCRIPTOR + 1)));
    free(data);
    assert_int_equal(cn_colmap_database_descriptors(base, 2, &data, &n), CN_OK);
    assert_true(!data && n == 0);
    assert_int_equal(cn_colmap_database_descriptors(base, 9, &data, &n), CN_OK);
    assert_true(!data && n == 0);
}

/* Whichever photo is named first, COLMAP's row has that of the smaller number first. */
static void test_writes_matches(void **state)
{
    (void)state;
    static const uint32_t pairs[][2] = { { 10, 20 }, { 11, 22 } };
    cn_colmap_pair pair;
    assert_int_equal(cn_colmap_database_pair(base, 4, 2, &pair), CN_OK);
    assert_true(!pair.matched && !pair.verified);
    assert_int_equal(cn_colmap_database_begin(base), CN_OK);
    assert_int_equal(cn_colmap_database_write_matches(base, &(cn_colmap_pair_matches){ 4, 2, 2, pairs }), CN_OK);
    assert_int_equal(cn_colmap_database_write_matches(base, &(cn_colmap_pair_matches){ 4, 7, 2, pairs }), CN_OK);
    assert_int_equal(cn_colmap_database_write_unrelated(base, 2, 3), CN_OK);
    assert_int_equal(cn_colmap_database_commit(base), CN_OK);
    char *dump = colmap_database_dump(path);
    assert_string_equal(dump, "geometry 4294967297 0 2 0\n"
                              "match 4294967297 0 2 \n"
                              "match 4294967298 2 2 140000000A000000160000000B000000\n"
                              "match 8589934595 2 2 0A000000140000000B00000016000000\n");
    free(dump);
    assert_int_equal(cn_colmap_database_pair(base, 2, 4, &pair), CN_OK);
    assert_true(pair.matched && !pair.verified);
    assert_int_equal(cn_colmap_database_pair(base, 3, 2, &pair), CN_OK);
    assert_true(pair.matched && pair.verified);
}

static void test_rollback(void **state)
{
    (void)state;
    assert_int_equal(cn_colmap_database_begin(base), CN_OK);
    assert_int_equal(cn_colmap_database_write_unrelated(base, 2, 4), CN_OK);
    cn_colmap_database_rollback(base);
    assert_int_equal(colmap_database_ask(path, "SELECT COUNT(*) FROM matches"), 0);
    assert_int_equal(cn_colmap_database_begin(base), CN_OK); /* a new one can begin */
    assert_int_equal(cn_colmap_database_commit(base), CN_OK);
}

/* Only OPENCV cameras change, all of them or none. */
static void test_simplifies_cameras(void **state)
{
    (void)state;
    static const char simple[] = "SELECT COUNT(*) FROM cameras WHERE model = 2 AND LENGTH(params) = 32";
    colmap_database_run(path, "INSERT INTO cameras VALUES(1, 4, 9, 9, zeroblob(64), 0), (2, 1, 9, 9, zeroblob(32), 0), "
                              "(3, 4, 9, 9, zeroblob(64), 0)");
    assert_int_equal(cn_colmap_database_simplify_cameras(base), CN_OK);
    assert_int_equal(colmap_database_ask(path, simple), 2);
    assert_int_equal(colmap_database_ask(path, "SELECT model FROM cameras WHERE camera_id = 2"), 1);
    colmap_database_run(path, "UPDATE cameras SET model = 4, params = zeroblob(64); UPDATE cameras SET params = "
                              "zeroblob(40) WHERE camera_id = 2");
    assert_int_equal(cn_colmap_database_simplify_cameras(base), CN_ERR_FORMAT);
    assert_non_null(strstr(cn_error_message(), "camera 2 has 40 bytes"));
    assert_int_equal(colmap_database_ask(path, simple), 0);
}

static void assert_refused(cn_status status)
{
    assert_int_equal(status, CN_ERR_FORMAT);
    assert_non_null(strstr(cn_error_message(), path));
    assert_null(strchr(cn_error_message(), '\n'));
}

static void test_damage(void **state)
{
    (void)state;
    uint32_t n;
    uint8_t *data;
    cn_colmap_pair pair;
    static const char *const damages[] = { "UPDATE descriptors SET rows = 4 WHERE image_id = 4",
                                           "UPDATE descriptors SET rows = -1 WHERE image_id = 4",
                                           "UPDATE descriptors SET rows = 3000000000, data = NULL WHERE image_id = 4",
                                           "UPDATE descriptors SET rows = 6, cols = 64 WHERE image_id = 4",
                                           "DROP TABLE descriptors" };
    for (int i = 0; i < 5; i++) {
        colmap_database_run(path, damages[i]);
        assert_refused(cn_colmap_database_descriptors(base, 4, &data, &n));
        assert_null(data);
    }
    colmap_database_run(path, "DROP TABLE two_view_geometries");
    assert_refused(cn_colmap_database_pair(base, 2, 4, &pair));
    assert_int_equal(cn_colmap_database_write_unrelated(base, 2, 4), CN_ERR_IO);
    cn_colmap_database_close(&base);
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    for (int i = 0; i < 9000; i++)
        fputc(i, file);
    assert_int_equal(fclose(file), 0);
    assert_refused(cn_colmap_database_open(&base, path));
    assert_null(base);
}

#define WITH_BASE(test) cmocka_unit_test_setup_teardown(test, set_up, tear_down)
int main(void)
{
    const struct CMUnitTest tests[] = { WITH_BASE(test_reads_features), WITH_BASE(test_writes_matches),
                                        WITH_BASE(test_rollback), WITH_BASE(test_simplifies_cameras),
                                        WITH_BASE(test_damage) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
