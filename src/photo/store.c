/* The pixel store, read by position: pixels stay on disk, so memory does not grow with the number of photos. */
#include "photo/store.h"

#include "image/image.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static cn_status damaged(const char *path)
{
    return cn_fail(CN_ERR_FORMAT, "%s is damaged; delete it and run `conurb plan` again", path);
}

cn_status cn_store_read_at(const cn_pixel_store *store, void *data, size_t size, uint64_t offset)
{
    char *at = data;
    while (size) {
        const ssize_t n = pread(store->fd, at, size, (off_t)offset);
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) return cn_fail(CN_ERR_IO, "%s cannot be read: %s", store->path, strerror(errno));
        if (n == 0) return damaged(store->path);
        at += n;
        offset += (uint64_t)n;
        size -= (size_t)n;
    }
    return CN_OK;
}

static bool is_good(const cn_store_record *r, uint64_t first, uint64_t size)
{
    if (!r->width || !r->height || r->width > 65535 || r->height > 65535) return false;
    if (r->offset % CN_STORE_PAGE || r->offset < first || r->offset > size) return false;
    return cn_store_photo_bytes(r) <= size - r->offset && memchr(r->name, 0, CN_STORE_NAME_SIZE);
}

static cn_status open_store(cn_pixel_store *s)
{
    s->fd = open(s->path, O_RDONLY | O_CLOEXEC);
    struct stat st;
    if (s->fd < 0 || fstat(s->fd, &st) != 0)
        return cn_fail(CN_ERR_IO, "%s cannot be opened: %s", s->path, strerror(errno));
    const uint64_t size = (uint64_t)st.st_size;
    if (size < sizeof s->head) return damaged(s->path);
    CN_TRY(cn_store_read_at(s, &s->head, sizeof s->head, 0));
    if (memcmp(s->head.magic, CN_STORE_MAGIC, sizeof CN_STORE_MAGIC) != 0) return damaged(s->path);
    if (s->head.version > CN_STORE_VERSION)
        return cn_fail(CN_ERR_VERSION, "%s was made by a newer Conurb; update Conurb, or delete the file", s->path);
    const uint64_t most = (size - sizeof s->head) / CN_STORE_RECORD_SIZE;
    if (s->head.n_photos > most || s->head.n_photos > UINT32_MAX) return damaged(s->path);
    s->records = malloc((s->head.n_photos + 1) * sizeof *s->records);
    if (!s->records) return cn_fail(CN_ERR_NOMEM, "out of memory while opening %s", s->path);
    CN_TRY(cn_store_read_at(s, s->records, s->head.n_photos * CN_STORE_RECORD_SIZE, sizeof s->head));
    const uint64_t first = sizeof s->head + s->head.n_photos * CN_STORE_RECORD_SIZE;
    for (uint64_t i = 0; i < s->head.n_photos; i++)
        if (!is_good(&s->records[i], first, size)) return damaged(s->path);
    return CN_OK;
}

cn_status cn_pixel_store_open(cn_pixel_store **store, const char *path)
{
    *store = calloc(1, sizeof **store);
    if (*store) (*store)->fd = -1;
    if (!*store || !((*store)->path = strdup(path))) {
        cn_pixel_store_close(store);
        return cn_fail(CN_ERR_NOMEM, "out of memory while opening %s", path);
    }
    const cn_status status = open_store(*store);
    if (status != CN_OK) cn_pixel_store_close(store);
    return status;
}

void cn_pixel_store_close(cn_pixel_store **store)
{
    if (!*store) return;
    if ((*store)->fd >= 0) close((*store)->fd);
    free((*store)->records);
    free((*store)->hidden);
    free((*store)->path);
    free(*store);
    *store = NULL;
}

uint32_t cn_pixel_store_count(const cn_pixel_store *store)
{
    return (uint32_t)store->head.n_photos;
}
const char *cn_pixel_store_name(const cn_pixel_store *store, uint32_t photo)
{
    return store->records[photo].name;
}
cn_pixel_extent cn_pixel_store_extent(const cn_pixel_store *store, uint32_t photo)
{
    return (cn_pixel_extent){ store->records[photo].width, store->records[photo].height };
}

static void unpack(const uint16_t *half, size_t n, float *rgbw)
{
    for (size_t i = 0; i < 4 * n; i++)
        rgbw[i] = cn_half_to_float(half[i]);
}

/* How many of the next n pixels are adjacent in the file, RUN at most: one read gets them. */
enum { RUN = 64 };
static size_t run_length(size_t n, const uint32_t *photo, const uint16_t *x, const uint16_t *y)
{
    size_t i = 1;
    while (i < n && i < RUN && photo[i] == photo[0] && y[i] == y[0] && x[i] == x[0] + i)
        i++;
    return i;
}

cn_status cn_pixel_store_gather(const cn_pixel_store *store, size_t n, const uint32_t *photo, const uint16_t *x,
                                const uint16_t *y, float *rgbw)
{
    for (size_t i = 0; i < n;) {
        if (photo[i] >= store->head.n_photos)
            return cn_fail(CN_ERR_INTERNAL, "%s has no photo %u", store->path, photo[i]);
        const cn_store_record *r = &store->records[photo[i]];
        const size_t run = run_length(n - i, photo + i, x + i, y + i);
        if (x[i] + run > r->width || y[i] >= r->height)
            return cn_fail(CN_ERR_INTERNAL, "%s: pixel %zu, %u lies outside %s", store->path, x[i] + run - 1, y[i],
                           r->name);
        uint16_t half[4 * RUN];
        CN_TRY(cn_store_read_at(store, half, 8 * run, r->offset + 8 * ((uint64_t)y[i] * r->width + x[i])));
        unpack(half, run, rgbw + 4 * i);
        for (size_t k = i; store->hidden && k < i + run; k++)
            if (cn_store_hides(store, photo[k], x[k], y[k])) rgbw[4 * k + 3] = 0;
        i += run;
    }
    return CN_OK;
}

bool cn_pixel_store_has_depth(const cn_pixel_store *store, uint32_t photo)
{
    return photo < store->head.n_photos && store->records[photo].depth_hash != 0;
}

cn_status cn_pixel_store_gather_depth(const cn_pixel_store *store, size_t n, const uint32_t *photo, const uint16_t *x,
                                      const uint16_t *y, float *depth_m)
{
    for (size_t i = 0; i < n; i++) {
        depth_m[i] = 0;
        if (!cn_pixel_store_has_depth(store, photo[i])) continue;
        const cn_store_record *r = &store->records[photo[i]];
        if (x[i] >= r->width || y[i] >= r->height)
            return cn_fail(CN_ERR_INTERNAL, "%s: pixel %u, %u lies outside %s", store->path, x[i], y[i], r->name);
        CN_TRY(cn_store_read_at(store, &depth_m[i], sizeof *depth_m,
                                r->offset + cn_store_pixel_bytes(r) + 4 * ((uint64_t)y[i] * r->width + x[i])));
    }
    return CN_OK;
}

bool cn_pixel_store_has_normal(const cn_pixel_store *store, uint32_t photo)
{
    return photo < store->head.n_photos && store->records[photo].normal_hash != 0;
}

cn_status cn_pixel_store_gather_normal(const cn_pixel_store *store, size_t n, const uint32_t *photo, const uint16_t *x,
                                       const uint16_t *y, float *normal)
{
    for (size_t i = 0; i < n; i++) {
        int8_t packed[4] = { 0 };
        if (cn_pixel_store_has_normal(store, photo[i])) {
            const cn_store_record *r = &store->records[photo[i]];
            if (x[i] >= r->width || y[i] >= r->height)
                return cn_fail(CN_ERR_INTERNAL, "%s: pixel %u, %u lies outside %s", store->path, x[i], y[i], r->name);
            CN_TRY(cn_store_read_at(store, packed, sizeof packed,
                                    r->offset + cn_store_normals_at(r) + 4 * ((uint64_t)y[i] * r->width + x[i])));
        }
        for (size_t a = 0; a < 3; a++)
            normal[3 * i + a] = (float)packed[a] / 127;
    }
    return CN_OK;
}

cn_status cn_store_read_colours(const cn_pixel_store *store, uint32_t photo, uint16_t *half)
{
    const cn_store_record *r = &store->records[photo];
    CN_TRY(cn_store_read_at(store, half, cn_store_pixel_bytes(r), r->offset));
    for (uint32_t y = 0; store->hidden && y < r->height; y++)
        for (uint32_t x = 0; x < r->width; x++)
            if (cn_store_hides(store, photo, x, y)) half[4 * ((size_t)y * r->width + x) + 3] = 0;
    return CN_OK;
}
cn_status cn_store_read_depths(const cn_pixel_store *store, uint32_t photo, float *depth_m)
{
    const cn_store_record *r = &store->records[photo];
    return cn_store_read_at(store, depth_m, 4 * (uint64_t)r->width * r->height, r->offset + cn_store_pixel_bytes(r));
}
cn_status cn_store_read_normals(const cn_pixel_store *store, uint32_t photo, int8_t *normal)
{
    const cn_store_record *r = &store->records[photo];
    return cn_store_read_at(store, normal, 4 * (uint64_t)r->width * r->height, r->offset + cn_store_normals_at(r));
}

cn_status cn_pixel_store_read(const cn_pixel_store *store, uint32_t photo, float *rgbw)
{
    if (photo >= store->head.n_photos) return cn_fail(CN_ERR_INTERNAL, "%s has no photo %u", store->path, photo);
    const cn_store_record *r = &store->records[photo];
    const size_t n = (size_t)r->width * r->height;
    uint16_t *half = malloc(n * 8);
    if (!half) return cn_fail(CN_ERR_NOMEM, "out of memory while reading %s", r->name);
    const cn_status status = cn_store_read_colours(store, photo, half);
    if (status == CN_OK) unpack(half, n, rgbw);
    free(half);
    return status;
}
