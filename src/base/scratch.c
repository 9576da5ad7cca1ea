#include "base/scratch.h"

#include "base/file.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

cn_status cn_scratch_failure(const char *path, const char *what, int error)
{
    const char *base = cn_path_base(path);
    return cn_fail(CN_ERR_IO, "cannot %s scratch space in %.*s: %s; make room there or choose another folder", what,
                   base == path ? 1 : (int)(base - path), base == path ? "." : path, strerror(error));
}

cn_status cn_scratch_open(const char *path, int *fd)
{
    const char *base = cn_path_base(path);
    char *name = cn_format("%.*s.conurb-export-XXXXXX", (int)(base - path), path);
    *fd = -1;
    if (!name) return cn_fail(CN_ERR_NOMEM, "out of memory");
    *fd = mkstemp(name);
    const int error = errno;
    if (*fd >= 0) unlink(name);
    free(name);
    return *fd >= 0 ? CN_OK : cn_scratch_failure(path, "make", error);
}
