/* Places of photos that are left out, in a copy of a store. */
#include "photo/store.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>

cn_status cn_pixel_store_copy(const cn_pixel_store *store, cn_pixel_store **copy)
{
    const size_t size = (store->head.n_photos + (size_t)1) * sizeof *store->records;
    cn_pixel_store *s = *copy = calloc(1, sizeof *s);
    if (!s) return cn_fail(CN_ERR_NOMEM, "out of memory while opening %s", store->path);
    s->head = store->head;
    s->path = strdup(store->path);
    s->records = malloc(size);
    s->hidden = calloc(store->head.n_photos + (size_t)1, sizeof *s->hidden);
    s->fd = fcntl(store->fd, F_DUPFD_CLOEXEC, 0);
    const int why = errno;
    if (s->path && s->records && s->hidden && s->fd >= 0) {
        memcpy(s->records, store->records, size - sizeof *s->records);
        if (store->hidden) memcpy(s->hidden, store->hidden, store->head.n_photos * sizeof *s->hidden);
        return CN_OK;
    }
    cn_pixel_store_close(copy);
    return cn_fail(CN_ERR_IO, "%s cannot be opened once more: %s", store->path, strerror(why));
}

cn_status cn_pixel_store_hide(cn_pixel_store *store, uint32_t photo, const uint32_t cells[CN_HIDDEN_ROWS])
{
    if (photo >= store->head.n_photos) return cn_fail(CN_ERR_INTERNAL, "%s has no photo %u", store->path, photo);
    if (!store->hidden) store->hidden = calloc(store->head.n_photos + (size_t)1, sizeof *store->hidden);
    if (!store->hidden) return cn_fail(CN_ERR_NOMEM, "out of memory while hiding places of %s", store->path);
    for (size_t row = 0; row < CN_HIDDEN_ROWS; row++)
        store->hidden[photo][row] |= cells[row];
    return CN_OK;
}
