/* Shared by the fuzz targets: writes the input to files, because the readers take paths. */
#ifndef CONURB_TESTS_FUZZ_H
#define CONURB_TESTS_FUZZ_H
#include "conurb/base.h"

#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static char fuzz_folder[64];

static inline void fuzz_remove_folder(void)
{
    char command[96];
    snprintf(command, sizeof command, "rm -rf %s", fuzz_folder);
    (void)!system(command);
}

/* A folder in memory, only for this process. */
static inline const char *fuzz_home(void)
{
    if (fuzz_folder[0]) return fuzz_folder;
    snprintf(fuzz_folder, sizeof fuzz_folder, "/dev/shm/conurb-fuzz-XXXXXX");
    if (!mkdtemp(fuzz_folder)) abort();
    atexit(fuzz_remove_folder);
    return fuzz_folder;
}

/* Writes NAME in it. The path is valid until the next call. */
static inline const char *fuzz_file(const char *name, const void *data, size_t size)
{
    static char path[192];
    snprintf(path, sizeof path, "%s/%s", fuzz_home(), name);
    const int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    if (fd < 0 || write(fd, data, size) != (ssize_t)size) abort();
    close(fd);
    return path;
}

/* Part i of the input. Eight bytes "--------" are between parts. */
static inline const uint8_t *fuzz_part(const uint8_t *data, size_t size, int i, size_t *n)
{
    static const char rule[8] = "--------";
    const uint8_t *end = data + size;
    for (;;) {
        const uint8_t *at = size ? memmem(data, (size_t)(end - data), rule, sizeof rule) : NULL;
        *n = (size_t)((at ? at : end) - data);
        if (i-- == 0) return data;
        data = at ? at + sizeof rule : end;
    }
}
#endif
