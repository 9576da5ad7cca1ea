/* Atomic and durable replacement: the old file stays until the new one is completely on the disk. */
#include "base/file.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static cn_status write_failure(const char *path, int error)
{
    const char *advice = "";
    if (error == ENOSPC || error == EDQUOT)
        advice = "; make room and run the same command again";
    else if (error == EROFS)
        advice = "; choose a folder that can be written to";
    else if (error == EACCES || error == EPERM)
        advice = "; give yourself the right to write there or choose another folder";
    else if (error == EFBIG)
        advice = "; raise the limit on file sizes (ulimit -f)";
    return cn_fail(CN_ERR_IO, "cannot write %s: %s%s", path, strerror(error), advice);
}

/* A rename is durable only after an fsync of the folder. */
static int sync_folder_of(const char *path)
{
    const char *base = cn_path_base(path);
    char *folder = base == path ? strdup(".") : strndup(path, (size_t)(base - path));
    if (!folder) return ENOMEM;
    int fd = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    free(folder);
    if (fd < 0) return errno == EACCES ? 0 : errno; /* a folder may be writable but not readable */
    int error = fsync(fd) == 0 ? 0 : errno;
    close(fd);
    return error == EINVAL || error == ENOTSUP ? 0 : error; /* some file systems have no fsync for folders */
}

cn_status cn_file_sync_folder(const char *path)
{
    const int error = sync_folder_of(path);
    return error ? write_failure(path, error) : CN_OK;
}

static int sync_file(const char *path)
{
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0) return errno;
    int error = fsync(fd) == 0 ? 0 : errno;
    close(fd);
    return error;
}

static int put_in_place(const char *temporary, const char *path)
{
    return rename(temporary, path) == 0 ? sync_folder_of(path) : errno;
}

cn_status cn_file_replace(const char *temporary, const char *path)
{
    int error = sync_file(temporary);
    if (!error) error = put_in_place(temporary, path);
    if (!error) return CN_OK;
    unlink(temporary);
    return write_failure(path, error);
}

cn_status cn_writer_open(cn_writer *writer, const char *path)
{
    *writer = (cn_writer){ .path = strdup(path), .temporary = cn_file_temporary(path) };
    if (!writer->path || !writer->temporary) {
        cn_writer_abort(writer);
        return cn_fail(CN_ERR_NOMEM, "out of memory writing %s", path);
    }
    writer->stream = fopen(writer->temporary, "wbe");
    if (!writer->stream) {
        int error = errno;
        cn_writer_abort(writer);
        return write_failure(path, error);
    }
    return CN_OK;
}

/* Writes everything to the disk; returns 0 or the errno. */
static int flush_and_sync(FILE *stream)
{
    int fd = fileno(stream);
    if (ferror(stream)) {
        /* The stream does not keep the errno of an earlier failure: write one more byte to get it again. */
        return write(fd, "", 1) < 0 ? errno : EIO;
    }
    if (fflush(stream) != 0) return errno;
    return fsync(fd) == 0 ? 0 : errno;
}

cn_status cn_writer_commit(cn_writer *writer)
{
    int error = flush_and_sync(writer->stream);
    if (fclose(writer->stream) != 0 && !error) error = errno;
    writer->stream = NULL;
    if (!error) error = put_in_place(writer->temporary, writer->path);
    cn_status status = error ? write_failure(writer->path, error) : CN_OK;
    cn_writer_abort(writer);
    return status;
}

void cn_writer_abort(cn_writer *writer)
{
    if (writer->stream) fclose(writer->stream);
    if (writer->temporary) unlink(writer->temporary); /* gone already after a commit */
    free(writer->temporary);
    free(writer->path);
    *writer = (cn_writer){ 0 };
}

cn_status cn_file_check(const char *path)
{
    struct stat info;
    cn_writer writer;
    if (stat(path, &info) == 0 && S_ISDIR(info.st_mode)) return write_failure(path, EISDIR);
    CN_TRY(cn_writer_open(&writer, path));
    cn_writer_abort(&writer);
    return CN_OK;
}
