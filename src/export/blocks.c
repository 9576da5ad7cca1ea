#include "export/blocks.h"

#include "base/scratch.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

cn_status cn_blocks_open(cn_blocks *b, const char *path, uint32_t across, uint32_t down)
{
    *b = (cn_blocks){ .fd = -1, .across = across, .down = down, .path = strdup(path) };
    if (!b->path) return cn_fail(CN_ERR_NOMEM, "out of memory");
    CN_TRY(cn_scratch_open(path, &b->fd));
    return ftruncate(b->fd, (off_t)sizeof(cn_block_sums) * across * down) == 0
               ? CN_OK
               : cn_scratch_failure(path, "make", errno);
}

void cn_blocks_close(cn_blocks *b)
{
    if (b->path && b->fd >= 0) close(b->fd);
    free(b->path);
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
            return cn_scratch_failure(b->path, "read", n ? errno : EIO);
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
            return cn_scratch_failure(b->path, "write", n ? errno : EIO);
    }
    return CN_OK;
}
