#include "base/file.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define CN_FILE_DEFAULT_MAX ((size_t)1 << 30)

/* Reads fd to its end into a growing buffer, because fstat's size may be wrong (pipes, /proc). */
static cn_status read_all(int fd, const char *path, size_t expected, size_t max_bytes, char **data, size_t *size)
{
    size_t capacity = expected + 1, length = 0;
    char *buffer = malloc(capacity + 1);
    while (buffer) {
        if (length == capacity) {
            capacity *= 2;
            char *larger = realloc(buffer, capacity + 1);
            if (!larger) break;
            buffer = larger;
        }
        ssize_t got = read(fd, buffer + length, capacity - length);
        if (got < 0 && errno == EINTR) continue;
        if (got < 0) {
            int error = errno;
            free(buffer);
            return cn_fail(CN_ERR_IO, "cannot read %s: %s", path, strerror(error));
        }
        if (got == 0) {
            buffer[length] = '\0';
            *data = buffer;
            *size = length;
            return CN_OK;
        }
        length += (size_t)got;
        if (length > max_bytes) {
            free(buffer);
            return cn_fail(CN_ERR_FORMAT, "%s is larger than the %zu bytes that such a file may have", path, max_bytes);
        }
    }
    free(buffer);
    return cn_fail(CN_ERR_NOMEM, "out of memory reading %s", path);
}

cn_status cn_file_read(const char *path, size_t max_bytes, char **data, size_t *size)
{
    *data = NULL;
    *size = 0;
    if (max_bytes == 0) max_bytes = CN_FILE_DEFAULT_MAX;
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0) return cn_fail(CN_ERR_IO, "cannot read %s: %s", path, strerror(errno));
    struct stat info;
    cn_status status;
    if (fstat(fd, &info) != 0)
        status = cn_fail(CN_ERR_IO, "cannot read %s: %s", path, strerror(errno));
    else if (S_ISDIR(info.st_mode))
        status = cn_fail(CN_ERR_IO, "cannot read %s: it is a folder, not a file", path);
    else if (info.st_size > 0 && (uint64_t)info.st_size > max_bytes)
        status = cn_fail(CN_ERR_FORMAT, "%s has %lld bytes, more than the %zu that such a file may have", path,
                         (long long)info.st_size, max_bytes);
    else
        status = read_all(fd, path, info.st_size > 0 ? (size_t)info.st_size : 4096, max_bytes, data, size);
    close(fd);
    return status;
}

cn_status cn_file_write(const char *path, const void *data, size_t size)
{
    cn_writer writer;
    CN_TRY(cn_writer_open(&writer, path));
    /* commit reports a short write. */
    if (size) fwrite(data, 1, size, writer.stream);
    return cn_writer_commit(&writer);
}
