#include "export/blocks.h"

#include "base/file.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static cn_status failure(const cn_blocks *b, const char *what, int error)
{
    return cn_fail(CN_ERR_IO, "cannot %s scratch space in %s: %s; make room there or choose another folder", what,
                   b->folder, strerror(error));
}

cn_status cn_blocks_open(cn_blocks *b, const char *path, uint32_t across, uint32_t down)
{
    const char *base = cn_path_base(path);
    *b = (cn_blocks){ .fd = -1, .across = across, .down = down };
    b->folder = base == path ? strdup(".") : strndup(path, (size_t)(base - path));
    char *name = b->folder ? cn_format("%s/.conurb-export-XXXXXX", b->folder) : NULL;
    if (!name) return cn_fail(CN_ERR_NOMEM, "out of memory");
    b->fd = mkstemp(name);
    const int error = errno;
    if (b->fd >= 0) unlink(name);
    free(name);
    if (b->fd < 0) return failure(b, "make", error);
    if (ftruncate(b->fd, (off_t)sizeof(cn_block_sums) * across * down) != 0) return failure(b, "make", errno);
    return CN_OK;
}

void cn_blocks_close(cn_blocks *b)
{
    if (b->folder && b->fd >= 0) close(b->fd);
    free(b->folder);
    *b = (cn_blocks){ .fd = -1 };
}

static off_t place(const cn_blocks *b, uint32_t x, uint32_t y)
{
    return (off_t)sizeof(cn_block_sums) * ((off_t)y * b->across + x);
}

cn_status cn_blocks_read(const cn_blocks *b, uint32_t x, uint32_t y, cn_pixel_sum *sums)
{
    char *to = (char *)sums;
    for (size_t done = 0; done < sizeof(cn_block_sums);) {
        const ssize_t n = pread(b->fd, to + done, sizeof(cn_block_sums) - done, place(b, x, y) + (off_t)done);
        if (n > 0)
            done += (size_t)n;
        else if (n == 0 || errno != EINTR)
            return failure(b, "read", n ? errno : EIO);
    }
    return CN_OK;
}

cn_status cn_blocks_write(const cn_blocks *b, uint32_t x, uint32_t y, const cn_pixel_sum *sums)
{
    const char *from = (const char *)sums;
    for (size_t done = 0; done < sizeof(cn_block_sums);) {
        const ssize_t n = pwrite(b->fd, from + done, sizeof(cn_block_sums) - done, place(b, x, y) + (off_t)done);
        if (n > 0)
            done += (size_t)n;
        else if (n == 0 || errno != EINTR)
            return failure(b, "write", n ? errno : EIO);
    }
    return CN_OK;
}
