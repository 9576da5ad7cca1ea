/* Folders: removed with all that is in them; an error while one is read, as on a failing network, is not its end. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../common.h"

#include "base/file.h"
#include "base/schedule.h"
#include "conurb/photo.h"

#include <dirent.h>
#include <dlfcn.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static char folder[64];
static int entries_left = -1; /* then reading fails; -1: never */

/* Replaces the function of the C library. */
struct dirent *readdir(DIR *dir)
{
    struct dirent *(*real)(DIR *);
    *(void **)&real = dlsym(RTLD_NEXT, "readdir");
    if (entries_left < 0) return real(dir);
    if (entries_left-- > 0) return real(dir);
    entries_left = 0;
    errno = EIO;
    return NULL;
}

static int set_up(void **state)
{
    (void)state;
    entries_left = -1;
    strcpy(folder, "/tmp/conurb-folder-XXXXXX");
    return mkdtemp(folder) ? 0 : -1;
}

static int tear_down(void **state)
{
    (void)state;
    entries_left = -1;
    return folder_remove(folder);
}

static void put(const char *name)
{
    char path[128];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    assert_int_equal(cn_file_write(path, "x", 1), CN_OK);
}

static void test_sweep(void **state)
{
    (void)state;
    for (int i = 0; i < 4; i++) {
        char name[32];
        snprintf(name, sizeof name, ".a%d.tmp-4194303", i);
        put(name);
    }
    entries_left = 3;
    assert_int_equal(cn_folder_sweep(folder, NULL, 0), CN_ERR_IO);
    assert_non_null(strstr(cn_error_message(), folder));
    entries_left = -1;
    assert_int_equal(cn_folder_sweep(folder, NULL, 0), CN_OK);
}

static void test_photos(void **state)
{
    (void)state;
    cn_photo_index index;
    put("a.jpg");
    put("b.jpg");
    entries_left = 1;
    assert_int_equal(cn_photo_index_scan(NULL, folder, &index), CN_ERR_IO);
    assert_non_null(strstr(cn_error_message(), folder));
}

/* A link goes, what it leads to stays. */
static void test_remove(void **state)
{
    (void)state;
    char inner[96], link[128];
    snprintf(inner, sizeof inner, "%s/model/sparse", folder);
    snprintf(link, sizeof link, "%s/link", inner);
    assert_int_equal(cn_folder_make(inner), CN_OK);
    put("kept");
    put("model/sparse/points3D.bin");
    assert_int_equal(symlink("../..", link), 0);
    snprintf(inner, sizeof inner, "%s/model", folder);
    assert_int_equal(cn_folder_remove(inner), CN_OK);
    assert_false(cn_file_exists(inner));
    snprintf(link, sizeof link, "%s/kept", folder);
    assert_true(cn_file_exists(link));
    assert_int_equal(cn_folder_remove(inner), CN_OK); /* it is gone already */
    assert_int_equal(cn_folder_remove("/proc/self/fd"), CN_ERR_IO);
    assert_non_null(strstr(cn_error_message(), "cannot remove the folder /proc/self/fd"));
}

/* Some threads are unknown, so the result must be unknown: half of them would look like an idle machine. */
static void test_schedule(void **state)
{
    (void)state;
    volatile double busy = 1;
    for (int i = 0; i < 20000000; i++)
        busy = busy * 1.0000001;
    assert_true(cn_schedule_now().ran_s > 0);
    entries_left = 3;
    assert_true(cn_schedule_now().ran_s == 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test_setup_teardown(test_sweep, set_up, tear_down),
                                        cmocka_unit_test_setup_teardown(test_photos, set_up, tear_down),
                                        cmocka_unit_test_setup_teardown(test_remove, set_up, tear_down),
                                        cmocka_unit_test_setup_teardown(test_schedule, set_up, tear_down) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
