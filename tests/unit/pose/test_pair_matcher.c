/* Pairs of photos matched in a database: all of them, after a stop, after kill -9, and in a damaged one. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../bridge/colmap_database.h"
#include "../common.h"
#include "base/rng.h"
#include "fake_colmap.h"
#include "pose/colmap.h"
#include "pose/feature_match.h"
#include "pose/pair_matcher.h"

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

enum { PHOTOS = 9, POINTS = 150, DIMS = CN_DESCRIPTOR, PAIRS = PHOTOS * (PHOTOS - 1) / 2, ALONE = 5, LOST = 7 };
static char folder[64], path[96];
static uint8_t descriptors[PHOTOS][POINTS][DIMS];
static cn_photo photos[PHOTOS];
static const cn_photo_index photo_index = { .photos = photos, .n_photos = PHOTOS };
static int stop, reports, stop_after, kill_after;
static double last_done;
static size_t most_bytes;
static cn_pool *pool;

/* The photos see the same points, each in an order of its own and with noise, but for photo ALONE, which sees others.
 * Photo LOST is not in the database. COLMAP's numbers run against the order of names. */
static void fill_database(void)
{
    colmap_database_make(path);
    for (uint32_t p = 0; p < PHOTOS; p++) {
        for (uint32_t i = 0; i < POINTS; i++) {
            float x[DIMS], length = 0;
            for (uint32_t k = 0; k < DIMS; k++) {
                const float point = cn_rng_float(p == ALONE, 5, (i + 11 * p) % POINTS * DIMS + k);
                x[k] = point * point + 0.3f * cn_rng_float(p, 6, i * DIMS + k);
                length += x[k] * x[k];
            }
            for (uint32_t k = 0; k < DIMS; k++)
                descriptors[p][i][k] = (uint8_t)(512 * x[k] / sqrtf(length));
        }
        const uint32_t n = POINTS - 3 * p;
        if (p != LOST) colmap_database_add(path, 50 - p, photos[p].name, descriptors[p][0], n);
    }
}

static int set_up(void **state)
{
    (void)state;
    static char names[PHOTOS][16];
    strcpy(folder, "/tmp/conurb-pairs-XXXXXX");
    if (!mkdtemp(folder)) return -1;
    snprintf(path, sizeof path, "%s/database.db", folder);
    for (int p = 0; p < PHOTOS; p++) {
        snprintf(names[p], sizeof names[p], "%c.jpg", 'a' + p);
        photos[p] = (cn_photo){ .name = names[p] };
    }
    fill_database();
    stop = reports = stop_after = kill_after = 0;
    last_done = 0;
    most_bytes = 0;
    return 0;
}

static void remove_database(void)
{
    static const char *const suffixes[] = { "", "-wal", "-shm" };
    for (int i = 0; i < 3; i++) {
        char name[128];
        snprintf(name, sizeof name, "%s%s", path, suffixes[i]);
        unlink(name);
    }
}

static int tear_down(void **state)
{
    (void)state;
    remove_database();
    cn_pool_destroy(&pool);
    return rmdir(folder);
}

static void on_progress(void *user, const cn_progress_report *report)
{
    (void)user;
    assert_string_equal(report->item, "matches");
    assert_true(report->done >= last_done && report->total == PAIRS);
    last_done = report->done;
    reports++;
    if (reports == stop_after) stop = 1;
    if (reports == kill_after) raise(SIGKILL);
}

static cn_status run(void)
{
    const cn_context ctx = { .pool = pool, .progress = on_progress, .stop = &stop };
    cn_colmap_job job = { .ctx = &ctx, .index = &photo_index, .database = path, .most_bytes = most_bytes };
    cn_photo_pairs pairs = { 0 };
    assert_int_equal(cn_photo_pairs_all(PHOTOS, &pairs), CN_OK);
    cn_job_begin(&job, "matches", (double)pairs.n);
    last_done = 0;
    const cn_status status = cn_pairs_match(&job, &pairs);
    cn_photo_pairs_deinit(&pairs);
    return status;
}

/* Dump of a database that was matched at one go. */
static char *whole_dump(void)
{
    assert_int_equal(run(), CN_OK);
    char *dump = colmap_database_dump(path);
    remove_database();
    fill_database();
    reports = 0;
    return dump;
}

static void append(FILE *stream, uint32_t number)
{
    for (int k = 0; k < 4; k++)
        fprintf(stream, "%02X", number >> 8 * k & 255);
}

/* Each pair has what its descriptors give, the photo of the smaller number first. */
static void test_every_pair(void **state)
{
    (void)state;
    cn_match_space space = { 0 };
    uint32_t n_related = 0;
    assert_int_equal(run(), CN_OK);
    assert_true(reports >= 2 && last_done == PAIRS);
    char *dump = colmap_database_dump(path);
    for (uint32_t a = 0; a < PHOTOS; a++)
        for (uint32_t b = a + 1; b < PHOTOS; b++) {
            char *text, start[64];
            size_t size;
            FILE *stream = open_memstream(&text, &size);
            assert_non_null(stream);
            const cn_descriptors rows = { descriptors[a][0], POINTS - 3 * a },
                                 columns = { descriptors[b][0], POINTS - 3 * b };
            assert_int_equal(cn_match_features(&cn_kernel_ref, rows, columns, &space), CN_OK);
            const bool related = a != ALONE && b != ALONE;
            const int64_t pair = INT64_C(2147483647) * (50 - b) + (50 - a);
            assert_int_equal(space.n_pairs >= 15, related);
            fprintf(stream, "match %lld %u 2 ", (long long)pair, related ? space.n_pairs : 0);
            for (uint32_t i = 0; related && i < space.n_pairs; i++) {
                append(stream, space.pairs[i].b);
                append(stream, space.pairs[i].a);
            }
            fputc('\n', stream);
            fclose(stream);
            const bool there = a != LOST && b != LOST;
            assert_int_equal(strstr(dump, text) != NULL, there);
            snprintf(start, sizeof start, "geometry %lld 0 2 0\n", (long long)pair);
            assert_int_equal(strstr(dump, start) != NULL, there && !related);
            n_related += there && related;
            free(text);
        }
    assert_int_equal(n_related, (PHOTOS - 2) * (PHOTOS - 3) / 2);
    free(dump);
    cn_match_space_deinit(&space);
}

/* Pairs that COLMAP has to verify: those with matches and without a geometry. */
static void test_unverified(void **state)
{
    (void)state;
    cn_colmap_job job = { .index = &photo_index, .database = path };
    cn_photo_pairs pairs = { 0 }, left = { 0 };
    char sql[128];
    assert_int_equal(run(), CN_OK);
    snprintf(sql, sizeof sql, "INSERT INTO two_view_geometries(pair_id, rows, cols, config) VALUES(%lld, 0, 2, 0)",
             2147483647LL * 49 + 50); /* photos 0 and 1 */
    colmap_database_run(path, sql);
    assert_int_equal(cn_photo_pairs_all(PHOTOS, &pairs), CN_OK);
    assert_int_equal(cn_pairs_unverified(&job, &pairs, &left), CN_OK);
    assert_int_equal(left.n, (PHOTOS - 2) * (PHOTOS - 3) / 2 - 1);
    assert_true(left.items[0] == 2);
    cn_photo_pairs_deinit(&pairs);
    cn_photo_pairs_deinit(&left);
}

static void test_threads(void **state)
{
    (void)state;
    char *whole = whole_dump();
    assert_int_equal(cn_pool_create(&pool, 3), CN_OK);
    assert_int_equal(run(), CN_OK);
    char *dump = colmap_database_dump(path);
    assert_string_equal(dump, whole);
    free(dump);
    free(whole);
}

/* A pair alone needs more memory than there should be in use: it is matched all the same, one pair after the other. */
static void test_little_memory(void **state)
{
    (void)state;
    char *whole = whole_dump();
    stop_after = 10 * PAIRS; /* ends a run that does not get on */
    most_bytes = 1;
    assert_int_equal(run(), CN_OK);
    char *dump = colmap_database_dump(path);
    assert_string_equal(dump, whole);
    free(dump);
    free(whole);
}

/* A second run makes the rest, and leaves alone what is there. */
static void resume_after(int64_t n_before, const char *whole)
{
    char *dump, sql[128];
    assert_true(n_before > 0 && n_before < (PHOTOS - 1) * (PHOTOS - 2) / 2);
    assert_int_equal(colmap_database_ask(path, "SELECT COUNT(*) FROM matches"), n_before);
    const int64_t marked = colmap_database_ask(path, "SELECT MIN(pair_id) FROM matches WHERE rows > 0");
    snprintf(sql, sizeof sql, "UPDATE matches SET cols = 22 WHERE pair_id = %lld", (long long)marked);
    colmap_database_run(path, sql);
    stop = stop_after = 0;
    assert_int_equal(run(), CN_OK);
    assert_true(last_done == PAIRS);
    assert_int_equal(colmap_database_ask(path, "SELECT COUNT(*) FROM matches WHERE cols = 22"), 1);
    colmap_database_run(path, "UPDATE matches SET cols = 2");
    dump = colmap_database_dump(path);
    assert_string_equal(dump, whole);
    free(dump);
}

static void test_stopped(void **state)
{
    (void)state;
    char *whole = whole_dump();
    stop_after = 1;
    assert_int_equal(run(), CN_ERR_INTERRUPTED);
    resume_after(colmap_database_ask(path, "SELECT COUNT(*) FROM matches"), whole);
    free(whole);
}

static void test_killed(void **state)
{
    (void)state;
    int ended;
    char *whole = whole_dump();
    const pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        kill_after = 1;
        _exit((int)run());
    }
    assert_int_equal(waitpid(child, &ended, 0), child);
    assert_true(WIFSIGNALED(ended) && WTERMSIG(ended) == SIGKILL);
    resume_after(colmap_database_ask(path, "SELECT COUNT(*) FROM matches"), whole);
    free(whole);
}

static void test_damaged(void **state)
{
    (void)state;
    colmap_database_run(path, "UPDATE descriptors SET data = zeroblob(100) WHERE image_id = 48");
    assert_int_equal(run(), CN_ERR_FORMAT);
    assert_non_null(strstr(cn_error_message(), path));
    assert_non_null(strstr(cn_error_message(), "photo 48"));
    remove_database();
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    fputs("no database at all", file);
    assert_int_equal(fclose(file), 0);
    assert_int_equal(run(), CN_ERR_FORMAT);
    assert_non_null(strstr(cn_error_message(), path));
    assert_non_null(strstr(cn_error_message(), "remove the file to find the features again"));
    assert_null(strchr(cn_error_message(), '\n'));
}

/* ---- the stage, with a script for COLMAP ---- */

static size_t count_in(const char *name, const char *word)
{
    return file_count(folder, name, word);
}

/* Runs the stage of matches. The script keeps its command lines in `calls` and the lists of pairs in `lists`. */
static cn_status run_stage(cn_match_with with, const char *const *words)
{
    char program[96], log[96], note[96];
    cn_pose_options options = cn_pose_options_default();
    const cn_colmap_way way = { .matches = words };
    const cn_context ctx = { 0 };
    snprintf(program, sizeof program, "%s/colmap", folder);
    snprintf(log, sizeof log, "%s/log", folder);
    snprintf(note, sizeof note, "%s/note", folder);
    fake_colmap_write(program,
                      "#!/bin/sh\necho \"$@\" >>%s/calls\n[ $1 != matches_importer ] || cat %s/pairs.txt >>%s/lists\n",
                      folder, folder, folder);
    options.colmap = program;
    options.match_with = with;
    cn_colmap_job job = { .ctx = &ctx, .index = &photo_index, .options = &options, .way = &way, .dir = folder };
    job.log = log;
    job.note = note;
    job.database = path;
    strcpy(job.threads, "1");
    return cn_colmap_matches(&job);
}

static void remove_stage(void)
{
    static const char *const names[] = { "colmap",           "log", "calls", "lists", "pairs.txt", "matches.begun.json",
                                         "matches.done.json" };
    for (int i = 0; i < 7; i++) {
        char file[128];
        snprintf(file, sizeof file, "%s/%s", folder, names[i]);
        unlink(file);
    }
}

/* Matched here, COLMAP is only asked to verify, and only pairs with matches. With COLMAP's own matcher, or options of
 * its own, it does all. */
static void test_stage(void **state)
{
    (void)state;
    static const char *const guided[] = { "--SiftMatching.guided_matching", "1", NULL };
    for (int times = 0; times < 2; times++) { /* the second time there is nothing to do */
        assert_int_equal(run_stage(CN_MATCH_WITH_CONURB, NULL), CN_OK);
        assert_int_equal(count_in("calls", "matches_importer"), 1);
        assert_int_equal(count_in("calls", "\n"), 1);
    }
    assert_int_equal(count_in("lists", "\n"), (PHOTOS - 2) * (PHOTOS - 3) / 2);
    assert_int_equal(count_in("lists", "a.jpg b.jpg\n"), 1);
    assert_int_equal(count_in("lists", photos[ALONE].name), 0);
    assert_int_equal(run_stage(CN_MATCH_WITH_CONURB, guided), CN_OK);
    assert_int_equal(count_in("calls", "exhaustive_matcher"), 1);
    assert_int_equal(count_in("calls", "guided_matching 1"), 1);
    assert_int_equal(count_in("calls", "database_cleaner --type matches"), 1);
    assert_int_equal(run_stage(CN_MATCH_WITH_COLMAP, NULL), CN_OK);
    assert_int_equal(count_in("calls", "exhaustive_matcher"), 2);
    assert_int_equal(count_in("calls", "matches_importer"), 1);
    remove_stage();
}

#define WITH_BASE(test) cmocka_unit_test_setup_teardown(test, set_up, tear_down)
int main(void)
{
    const struct CMUnitTest tests[] = { WITH_BASE(test_every_pair), WITH_BASE(test_unverified),
                                        WITH_BASE(test_threads),    WITH_BASE(test_little_memory),
                                        WITH_BASE(test_stopped),    WITH_BASE(test_killed),
                                        WITH_BASE(test_damaged),    WITH_BASE(test_stage) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
