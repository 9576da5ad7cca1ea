#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "common.h"

#include "base/file.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

int folder_remove(const char *folder)
{
    return cn_folder_remove(folder) == CN_OK ? 0 : -1;
}

size_t file_count(const char *folder, const char *name, const char *word)
{
    char *path = cn_path_join(folder, name), *text;
    size_t size, n = 0;
    assert_non_null(path);
    if (cn_file_exists(path)) {
        assert_int_equal(cn_file_read(path, 0, &text, &size), CN_OK);
        for (const char *at = text; (at = strstr(at, word)); at++)
            n++;
        free(text);
    }
    free(path);
    return n;
}

void log_append(void *user, cn_log_level level, const char *text)
{
    (void)level;
    char *logged = user;
    const size_t used = strlen(logged);
    snprintf(logged + used, LOGGED - used, "%s\n", text);
}

char text_file[] = "/tmp/conurb_test_XXXXXX";

int text_file_make(void **state)
{
    (void)state;
    const int fd = mkstemp(text_file);
    return fd < 0 ? -1 : close(fd);
}

int text_file_remove(void **state)
{
    (void)state;
    return unlink(text_file);
}

void text_file_write(const char *text)
{
    FILE *stream = fopen(text_file, "w");
    assert_non_null(stream);
    fputs(text, stream);
    assert_int_equal(fclose(stream), 0);
}
