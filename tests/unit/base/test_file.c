#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>

#include <cmocka.h>

#include "base/file.h"

#include <dirent.h>
#include <errno.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

static int make_folder(void **state)
{
    const char *parent = getenv("TMPDIR");
    char *folder = cn_format("%s/conurb-file-XXXXXX", parent && *parent ? parent : "/tmp");
    *state = folder;
    return folder && mkdtemp(folder) ? 0 : -1;
}

static void remove_tree(const char *path)
{
    DIR *folder = opendir(path);
    struct dirent *entry;
    while (folder && (entry = readdir(folder))) {
        if (strcmp(entry->d_name, ".") == 0 || strcmp(entry->d_name, "..") == 0) continue;
        char *inner = cn_path_join(path, entry->d_name);
        if (entry->d_type == DT_DIR)
            remove_tree(inner);
        else
            unlink(inner);
        free(inner);
    }
    if (folder) closedir(folder);
    rmdir(path);
}

static int drop_folder(void **state)
{
    remove_tree(*state);
    free(*state);
    return 0;
}

static size_t entries(const char *path)
{
    DIR *folder = opendir(path);
    size_t n = 0;
    while (folder && readdir(folder))
        n++;
    if (folder) closedir(folder);
    return n - 2;
}

static void expect_content(const char *path, const char *text)
{
    char *data;
    size_t size;
    assert_int_equal(cn_file_read(path, 0, &data, &size), CN_OK);
    assert_int_equal(size, strlen(text));
    assert_string_equal(data, text);
    free(data);
}

static void what_is_written_is_read(void **state)
{
    char *path = cn_path_join(*state, "a.txt");
    assert_false(cn_file_exists(path));
    assert_int_equal(cn_file_write(path, "one", 3), CN_OK);
    assert_true(cn_file_exists(path));
    expect_content(path, "one");
    assert_int_equal(cn_file_write(path, "three", 5), CN_OK);
    expect_content(path, "three");
    assert_int_equal(cn_file_write(path, NULL, 0), CN_OK);
    expect_content(path, "");
    assert_int_equal(entries(*state), 1);
    assert_int_equal(cn_file_remove(path), CN_OK);
    assert_int_equal(cn_file_remove(path), CN_OK);
    assert_false(cn_file_exists(path));
    free(path);
}

static void reading_reports_what_is_wrong(void **state)
{
    char *data, *path = cn_path_join(*state, "big.bin");
    size_t size;
    assert_int_equal(cn_file_read(path, 0, &data, &size), CN_ERR_IO);
    assert_non_null(strstr(cn_error_message(), path));
    assert_int_equal(cn_file_read(*state, 0, &data, &size), CN_ERR_IO);
    assert_non_null(strstr(cn_error_message(), "folder"));
    assert_int_equal(cn_file_write(path, "0123456789", 10), CN_OK);
    assert_int_equal(cn_file_read(path, 9, &data, &size), CN_ERR_FORMAT);
    assert_non_null(strstr(cn_error_message(), path));
    assert_null(data);
    assert_int_equal(cn_file_read(path, 10, &data, &size), CN_OK);
    free(data);
    /* fstat says that the size is 0. */
    assert_int_equal(cn_file_read("/proc/self/status", 0, &data, &size), CN_OK);
    assert_true(size > 0 && data[size] == '\0');
    free(data);
    free(path);
}

static void an_aborted_write_leaves_no_trace(void **state)
{
    char *path = cn_path_join(*state, "a.txt");
    cn_writer writer;
    assert_int_equal(cn_file_write(path, "old", 3), CN_OK);
    assert_int_equal(cn_writer_open(&writer, path), CN_OK);
    assert_true(fputs("new", writer.stream) >= 0);
    assert_int_equal(entries(*state), 2);
    cn_writer_abort(&writer);
    cn_writer_abort(&writer);
    assert_int_equal(entries(*state), 1);
    expect_content(path, "old");
    free(path);
}

/* A limit on file size acts like a full disk, for one process. */
static void old_file_is_whole_after_a_failed_write(void **state)
{
    char *path = cn_path_join(*state, "a.bin"), *large = calloc(1, 1 << 20);
    struct rlimit before;
    assert_non_null(large);
    assert_int_equal(cn_file_write(path, "old", 3), CN_OK);
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &before), 0);
    void (*handler)(int) = signal(SIGXFSZ, SIG_IGN);
    struct rlimit small = { .rlim_cur = 4096, .rlim_max = before.rlim_max };
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &small), 0);
    cn_status status = cn_file_write(path, large, 1 << 20);
    /* Small pieces fail inside the stream, where the reason is easily lost. */
    cn_writer writer;
    cn_status opened = cn_writer_open(&writer, path);
    for (int i = 0; opened == CN_OK && i < 1 << 17; i++)
        fwrite(large, 1, 8, writer.stream);
    cn_status streamed = opened == CN_OK ? cn_writer_commit(&writer) : opened;
    setrlimit(RLIMIT_FSIZE, &before);
    signal(SIGXFSZ, handler);
    assert_int_equal(status, CN_ERR_IO);
    assert_int_equal(streamed, CN_ERR_IO);
    assert_non_null(strstr(cn_error_message(), path));
    assert_non_null(strstr(cn_error_message(), strerror(EFBIG)));
    expect_content(path, "old");
    assert_int_equal(entries(*state), 1);
    free(large);
    free(path);
}

static void unwritable_targets_are_named(void **state)
{
    char *missing = cn_path_join(*state, "none/a.txt");
    assert_int_equal(cn_file_write(missing, "x", 1), CN_ERR_IO);
    assert_non_null(strstr(cn_error_message(), missing));
    free(missing);
    /* A folder in the file's place: the rename fails, and the temporary must not stay. */
    char *taken = cn_path_join(*state, "taken");
    assert_int_equal(cn_folder_make(taken), CN_OK);
    assert_int_equal(cn_file_write(taken, "x", 1), CN_ERR_IO);
    assert_non_null(strstr(cn_error_message(), taken));
    assert_int_equal(entries(*state), 1);
    free(taken);
}

static void read_only_folder_is_named(void **state)
{
    const uid_t nobody = 65534, me = geteuid();
    char *path = cn_path_join(*state, "a.txt");
    assert_int_equal(cn_file_write(path, "old", 3), CN_OK);
    assert_int_equal(chmod(*state, 0555), 0);
    /* Root may write anywhere, so the attempt runs as another user. */
    const bool root = me == 0;
    if (root && seteuid(nobody) != 0) {
        print_message("skipped: root here cannot step down to another user\n");
        chmod(*state, 0700);
        free(path);
        skip();
        return;
    }
    cn_status status = cn_file_write(path, "new", 3);
    if (root) assert_int_equal(seteuid(me), 0);
    chmod(*state, 0700);
    assert_int_equal(status, CN_ERR_IO);
    assert_non_null(strstr(cn_error_message(), path));
    expect_content(path, "old");
    free(path);
}

static void foreign_writers_get_a_temporary_of_the_same_kind(void **state)
{
    char *path = cn_path_join(*state, "x.png");
    char *temporary = cn_file_temporary(path);
    char *expected = cn_format("%s/.x.tmp-%ld.png", (const char *)*state, (long)getpid());
    assert_string_equal(temporary, expected);
    FILE *stream = fopen(temporary, "w");
    assert_non_null(stream);
    fputs("pixels", stream);
    fclose(stream);
    assert_int_equal(cn_file_replace(temporary, path), CN_OK);
    expect_content(path, "pixels");
    assert_int_equal(entries(*state), 1);
    assert_int_equal(cn_file_replace(temporary, path), CN_ERR_IO);
    assert_non_null(strstr(cn_error_message(), path));
    expect_content(path, "pixels");
    free(expected);
    free(temporary);
    free(path);

    const struct {
        const char *path, *format;
    } cases[] = {
        { "plain", ".plain.tmp-%ld" },
        { "d.e/plain", "d.e/.plain.tmp-%ld" },
        { "d/.hidden", "d/..hidden.tmp-%ld" },
        { "/a.tar.gz", "/.a.tar.tmp-%ld.gz" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char wanted[64];
        snprintf(wanted, sizeof wanted, cases[i].format, (long)getpid());
        temporary = cn_file_temporary(cases[i].path);
        assert_string_equal(temporary, wanted);
        free(temporary);
    }
}

static void folders_are_made_with_parents(void **state)
{
    char *deep = cn_path_join(*state, "a/b//c/"), *file = cn_path_join(*state, "file"), *below;
    assert_int_equal(cn_folder_make(deep), CN_OK);
    assert_int_equal(cn_folder_make(deep), CN_OK);
    assert_true(cn_file_exists(deep));
    assert_int_equal(cn_file_write(file, "", 0), CN_OK);
    below = cn_path_join(file, "sub");
    assert_int_equal(cn_folder_make(below), CN_ERR_IO);
    assert_non_null(strstr(cn_error_message(), file));
    char *absolute;
    assert_int_equal(cn_path_absolute(deep, &absolute), CN_OK);
    assert_int_equal(absolute[0], '/');
    assert_string_equal(cn_path_base(absolute), "c");
    free(absolute);
    assert_int_equal(cn_path_absolute(below, &absolute), CN_ERR_IO);
    free(below);
    free(file);
    free(deep);
}

static void temporaries_of_the_dead_are_swept(void **state)
{
    const char *const names[] = { ".x.tmp-17.png", ".plain.tmp-4", ".x.tmp-.png", "x.tmp-3", ".x.tmp-9q", "kept" };
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        char *path = cn_path_join(*state, names[i]);
        FILE *stream = fopen(path, "w");
        assert_non_null(stream);
        fclose(stream);
        free(path);
    }
    assert_int_equal(cn_folder_sweep(*state, NULL, 60), CN_OK);
    assert_int_equal(entries(*state), 6);
    assert_int_equal(cn_folder_sweep(*state, "plai", 0), CN_OK);
    assert_int_equal(entries(*state), 6);
    assert_int_equal(cn_folder_sweep(*state, "plain", 0), CN_OK);
    assert_int_equal(entries(*state), 5);
    assert_int_equal(cn_folder_sweep(*state, NULL, 0), CN_OK);
    assert_int_equal(entries(*state), 4);
    char *gone = cn_path_join(*state, "nowhere");
    assert_int_equal(cn_folder_sweep(gone, NULL, 0), CN_OK);
    free(gone);
}

static void paths_join(void **state)
{
    (void)state;
    const char *const cases[][3] = {
        { "a", "b", "a/b" }, { "a/", "b", "a/b" }, { "", "b", "b" }, { "a", "/b", "/b" }, { "/", "b", "/b" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char *joined = cn_path_join(cases[i][0], cases[i][1]);
        assert_string_equal(joined, cases[i][2]);
        free(joined);
    }
    assert_string_equal(cn_path_base("a/b.c"), "b.c");
    assert_string_equal(cn_path_base("b"), "b");
}

static const char *text_at(const void *of, uint32_t i)
{
    return ((const char *const *)of)[i];
}

static void names_are_sorted_as_people_do(void **state)
{
    (void)state;
    static const char *const sorted[] = { "",
                                          "2/photo1",
                                          "10/photo1",
                                          "IMG_9.jpg",
                                          "a",
                                          "a007",
                                          "a07",
                                          "a7",
                                          "a7b",
                                          "photo2.png",
                                          "photo10.png",
                                          "photo10a",
                                          "x99999999999999999999",
                                          "x100000000000000000000" };
    enum { NAMES = sizeof sorted / sizeof *sorted };
    for (int i = 0; i < NAMES; i++)
        for (int j = 0; j < NAMES; j++)
            assert_int_equal((cn_path_compare(sorted[i], sorted[j]) > 0) - (cn_path_compare(sorted[i], sorted[j]) < 0),
                             (i > j) - (i < j));
    static const char *const names[] = { "p10", "p9", "p1", "p9" };
    uint32_t *order = cn_path_order(4, text_at, names);
    assert_non_null(order);
    assert_memory_equal(order, ((const uint32_t[]){ 2, 1, 3, 0 }), 4 * sizeof *order);
    free(order);
}

#define IN_FOLDER(test) cmocka_unit_test_setup_teardown(test, make_folder, drop_folder)

int main(void)
{
    const struct CMUnitTest tests[] = {
        IN_FOLDER(what_is_written_is_read),
        IN_FOLDER(reading_reports_what_is_wrong),
        IN_FOLDER(an_aborted_write_leaves_no_trace),
        IN_FOLDER(old_file_is_whole_after_a_failed_write),
        IN_FOLDER(unwritable_targets_are_named),
        IN_FOLDER(read_only_folder_is_named),
        IN_FOLDER(foreign_writers_get_a_temporary_of_the_same_kind),
        IN_FOLDER(folders_are_made_with_parents),
        IN_FOLDER(temporaries_of_the_dead_are_swept),
        cmocka_unit_test(paths_join),
        cmocka_unit_test(names_are_sorted_as_people_do),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
