/* A store in memory, for pictures that are not photos. */
#include "photo/store.h"

#include "image/image.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

static cn_status write_all(int fd, const void *data, size_t size)
{
    const char *at = data;
    while (size) {
        const ssize_t n = write(fd, at, size);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) return cn_fail(CN_ERR_NOMEM, "out of memory for made pictures");
        at += n;
        size -= (size_t)n;
    }
    return CN_OK;
}

static cn_status fill(cn_pixel_store *s, uint32_t n, uint32_t width, uint32_t height, const float *rgbw)
{
    const size_t pixels = (size_t)width * height;
    s->head.n_photos = n;
    s->head.width_px = width;
    s->fd = memfd_create("conurb-pixels", MFD_CLOEXEC);
    s->records = calloc(n + (size_t)1, sizeof *s->records);
    s->path = strdup("made pictures");
    uint16_t *half = malloc(pixels * 8);
    cn_status status =
        s->fd >= 0 && s->records && s->path && half ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for made pictures");
    for (uint32_t i = 0; i < n && status == CN_OK; i++) {
        s->records[i] =
            (cn_store_record){ .offset = i * pixels * 8, .width = width, .height = height, .full_width = width };
        snprintf(s->records[i].name, CN_STORE_NAME_SIZE, "%u", i);
        for (size_t k = 0; k < 4 * pixels; k++)
            half[k] = cn_half_from_float(rgbw[i * 4 * pixels + k]);
        status = write_all(s->fd, half, pixels * 8);
    }
    free(half);
    return status;
}

cn_status cn_pixel_store_in_memory(cn_pixel_store **store, uint32_t n, uint32_t width, uint32_t height,
                                   const float *rgbw)
{
    *store = calloc(1, sizeof **store);
    if (!*store) return cn_fail(CN_ERR_NOMEM, "out of memory for made pictures");
    (*store)->fd = -1;
    const cn_status status = fill(*store, n, width, height, rgbw);
    if (status != CN_OK) cn_pixel_store_close(store);
    return status;
}
