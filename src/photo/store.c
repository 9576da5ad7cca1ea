/* The pixel store. File: 16 bytes of magic and version, a u64 count, then a record a photo (offset, size, hash, name offset), names, then pixels.
 * All little-endian. The header is written last, into a temporary file, so a store that opens is whole. */
#include "conurb/photo.h"

#include "base/file.h"
#include "base/hash.h"
#include "bridge/oiio.h"
#include "conurb/colour.h"
#include "image/image.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#define MAGIC "CONURB PIXELS 1"
enum { PAGE = 4096, NAME_SIZE = 448, RECORD_SIZE = 512 };

typedef struct record {
    uint64_t offset, hash, mask_hash;
    uint32_t width, height, full_width, reserved;
    uint8_t unused[24];
    char name[NAME_SIZE];
} record;
_Static_assert(sizeof(record) == RECORD_SIZE, "a record is part of the file format");

typedef struct header { char magic[16]; uint64_t n_photos, width_px; uint8_t unused[32]; } header;

struct cn_pixel_store { int fd; char *path; header head; record *records; };

static uint64_t pixel_bytes(const record *r) { return (uint64_t)r->width * r->height * 8; }

/* ---- reading ---- */

static cn_status damaged(const char *path)
{
    return cn_fail(CN_ERR_FORMAT, "%s is damaged; delete it and run `conurb plan` again", path);
}

static cn_status read_at(const cn_pixel_store *s, void *data, size_t size, uint64_t offset)
{
    char *at = data;
    while (size) {
        const ssize_t n = pread(s->fd, at, size, (off_t)offset);
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) return cn_fail(CN_ERR_IO, "%s cannot be read: %s", s->path, strerror(errno));
        if (n == 0) return damaged(s->path);
        at += n;
        offset += (uint64_t)n;
        size -= (size_t)n;
    }
    return CN_OK;
}

static cn_status check_records(const cn_pixel_store *s, uint64_t size)
{
    for (uint64_t i = 0; i < s->head.n_photos; i++) {
        const record *r = &s->records[i];
        const bool good = r->width && r->height && r->width <= 65535 && r->height <= 65535 && r->offset % PAGE == 0 &&
                          r->offset <= size && pixel_bytes(r) <= size - r->offset && memchr(r->name, 0, NAME_SIZE);
        if (!good) return damaged(s->path);
    }
    return CN_OK;
}

static cn_status open_store(cn_pixel_store *s)
{
    s->fd = open(s->path, O_RDONLY | O_CLOEXEC);
    struct stat st;
    if (s->fd < 0 || fstat(s->fd, &st) != 0) return cn_fail(CN_ERR_IO, "%s cannot be opened: %s", s->path, strerror(errno));
    if ((uint64_t)st.st_size < sizeof s->head) return damaged(s->path);
    CN_TRY(read_at(s, &s->head, sizeof s->head, 0));
    if (memcmp(s->head.magic, MAGIC, sizeof MAGIC) != 0) return damaged(s->path);
    if (s->head.n_photos > ((uint64_t)st.st_size - sizeof s->head) / RECORD_SIZE || s->head.n_photos > UINT32_MAX) return damaged(s->path);
    s->records = malloc((s->head.n_photos + 1) * sizeof *s->records);
    if (!s->records) return cn_fail(CN_ERR_NOMEM, "out of memory while opening %s", s->path);
    CN_TRY(read_at(s, s->records, s->head.n_photos * RECORD_SIZE, sizeof s->head));
    return check_records(s, (uint64_t)st.st_size);
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
    free((*store)->path);
    free(*store);
    *store = NULL;
}

uint32_t cn_pixel_store_count(const cn_pixel_store *store) { return (uint32_t)store->head.n_photos; }
const char *cn_pixel_store_name(const cn_pixel_store *store, uint32_t photo) { return store->records[photo].name; }
cn_pixel_extent cn_pixel_store_extent(const cn_pixel_store *store, uint32_t photo)
{
    return (cn_pixel_extent){store->records[photo].width, store->records[photo].height};
}

static void unpack(const uint16_t half[4], float *rgbw)
{
    for (int c = 0; c < 4; c++) rgbw[c] = cn_half_to_float(half[c]);
}

cn_status cn_pixel_store_gather(const cn_pixel_store *store, size_t n, const uint32_t *photo, const uint16_t *x, const uint16_t *y,
                                float *rgbw)
{
    for (size_t i = 0; i < n; i++) {
        if (photo[i] >= store->head.n_photos) return cn_fail(CN_ERR_INTERNAL, "%s has no photo %u", store->path, photo[i]);
        const record *r = &store->records[photo[i]];
        if (x[i] >= r->width || y[i] >= r->height)
            return cn_fail(CN_ERR_INTERNAL, "%s: pixel %u, %u lies outside %s", store->path, x[i], y[i], r->name);
        uint16_t half[4];
        CN_TRY(read_at(store, half, sizeof half, r->offset + 8 * ((uint64_t)y[i] * r->width + x[i])));
        unpack(half, rgbw + 4 * i);
    }
    return CN_OK;
}

cn_status cn_pixel_store_read(const cn_pixel_store *store, uint32_t photo, float *rgbw)
{
    if (photo >= store->head.n_photos) return cn_fail(CN_ERR_INTERNAL, "%s has no photo %u", store->path, photo);
    const record *r = &store->records[photo];
    const size_t n = (size_t)r->width * r->height;
    uint16_t *half = malloc(n * 8);
    if (!half) return cn_fail(CN_ERR_NOMEM, "out of memory while reading %s", r->name);
    const cn_status status = read_at(store, half, n * 8, r->offset);
    for (size_t i = 0; status == CN_OK && i < n; i++) unpack(half + 4 * i, rgbw + 4 * i);
    free(half);
    return status;
}

/* ---- building ---- */

typedef struct builder {
    const cn_photo_index *index;
    const cn_colour *colour;
    const cn_pixel_store *old; /* may be NULL */
    record *records;
    int fd;
    const char *temporary;
    cn_status *status;
    char **message;
    uint32_t first;
} builder;

static cn_status write_at(const builder *b, const void *data, size_t size, uint64_t offset)
{
    const char *at = data;
    while (size) {
        const ssize_t n = pwrite(b->fd, at, size, (off_t)offset);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) return cn_fail(CN_ERR_IO, "%s cannot be written: %s", b->temporary, strerror(errno));
        at += n;
        offset += (uint64_t)n;
        size -= (size_t)n;
    }
    return CN_OK;
}

/* Multiplies the weights with a mask of any size (nearest pixel); black is ignored. */
static cn_status apply_mask(const builder *b, const cn_photo *photo, float *rgba, uint32_t w, uint32_t h)
{
    if (!photo->mask) return CN_OK;
    char *path = cn_path_join(b->index->folder, photo->mask);
    float *mask = NULL;
    uint32_t mw, mh;
    const cn_status status = path ? cn_oiio_read_rgba(path, &mask, &mw, &mh) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(path);
    CN_TRY(status);
    for (uint32_t y = 0; y < h; y++)
        for (uint32_t x = 0; x < w; x++) {
            const float *m = mask + 4 * ((size_t)((uint64_t)y * mh / h) * mw + (uint64_t)x * mw / w);
            if (!(fmaxf(m[0], fmaxf(m[1], m[2])) > 0.5f)) rgba[4 * ((size_t)y * w + x) + 3] = 0;
        }
    free(mask);
    return CN_OK;
}

/* The colour space of the file: integers are sRGB, floats linear sRGB unless the file says ACEScg. */
static const char *space_of(const char *path)
{
    cn_oiio_info info;
    if (cn_oiio_read_info(path, &info) != CN_OK || !info.is_float) return "sRGB";
    return strstr(info.colour_space, "ACEScg") ? "ACEScg" : "Linear sRGB";
}

static cn_status convert(const builder *b, const cn_photo *photo, const char *path, float *rgba, uint32_t w, uint32_t h, const record *r)
{
    const size_t n = (size_t)w * h, out_n = (size_t)r->width * r->height;
    /* What is not finite must be known before the colours are cleaned of it. */
    for (size_t i = 0; i < n; i++) {
        float *p = rgba + 4 * i;
        p[3] = isfinite(p[0] + p[1] + p[2]) ? 1 : 0;
    }
    CN_TRY(apply_mask(b, photo, rgba, w, h));
    CN_TRY(cn_colour_to_linear(b->colour, space_of(path), rgba, n, 4));
    float *small = malloc(out_n * 4 * sizeof *small);
    uint16_t *half = malloc(out_n * 8);
    cn_status status = small && half ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for %s", photo->name);
    if (status == CN_OK) {
        cn_image_shrink(rgba, w, h, small, r->width, r->height);
        for (size_t i = 0; i < out_n * 4; i++) half[i] = cn_half_from_float(small[i]);
        status = write_at(b, half, out_n * 8, r->offset);
    }
    free(small);
    free(half);
    return status;
}

static cn_status copy_old(const builder *b, const record *r, bool *copied)
{
    *copied = false;
    for (uint64_t i = 0; b->old && i < b->old->head.n_photos; i++) {
        const record *o = &b->old->records[i];
        if (o->hash != r->hash || o->mask_hash != r->mask_hash || o->width != r->width || o->height != r->height) continue;
        void *pixels = malloc(pixel_bytes(r));
        if (!pixels) return cn_fail(CN_ERR_NOMEM, "out of memory for %s", r->name);
        cn_status status = read_at(b->old, pixels, pixel_bytes(r), o->offset);
        if (status == CN_OK) status = write_at(b, pixels, pixel_bytes(r), r->offset);
        free(pixels);
        *copied = status == CN_OK;
        return status;
    }
    return CN_OK;
}

static cn_status build_photo(const builder *b, uint32_t i)
{
    const cn_photo *photo = &b->index->photos[i];
    const record *r = &b->records[i];
    bool copied;
    CN_TRY(copy_old(b, r, &copied));
    if (copied) return CN_OK;
    char *path = cn_path_join(b->index->folder, photo->name);
    float *rgba = NULL;
    uint32_t w = 0, h = 0;
    cn_status status = path ? cn_oiio_read_rgba(path, &rgba, &w, &h) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK && (w != photo->width || h != photo->height))
        status = cn_fail(CN_ERR_DATA, "%s changed since it was indexed; run `conurb poses` again", path);
    if (status == CN_OK) status = convert(b, photo, path, rgba, w, h, r);
    free(rgba);
    free(path);
    return status;
}

static void build_one(void *user, size_t i, unsigned worker)
{
    (void)worker;
    builder *b = user;
    const uint32_t at = b->first + (uint32_t)i;
    b->status[at] = build_photo(b, at);
    if (b->status[at] != CN_OK) b->message[at] = strdup(cn_error_message());
}

static cn_status lay_out(builder *b, uint32_t width_px)
{
    const uint32_t n = b->index->n_photos;
    uint64_t offset = sizeof(header) + (uint64_t)n * RECORD_SIZE;
    for (uint32_t i = 0; i < n; i++) {
        const cn_photo *p = &b->index->photos[i];
        record *r = &b->records[i];
        if (strlen(p->name) >= NAME_SIZE) return cn_fail(CN_ERR_DATA, "the name of photo %s is too long; keep it under %d bytes", p->name, NAME_SIZE);
        strcpy(r->name, p->name);
        r->hash = p->hash;
        if (p->mask) {
            char *path = cn_path_join(b->index->folder, p->mask);
            const cn_status status = path ? cn_hash_file(path, &r->mask_hash) : cn_fail(CN_ERR_NOMEM, "out of memory");
            free(path);
            CN_TRY(status);
        }
        r->full_width = p->width;
        r->width = p->width < width_px ? p->width : width_px;
        r->height = (uint32_t)fmax(1, round((double)p->height * r->width / p->width));
        r->offset = (offset + PAGE - 1) / PAGE * PAGE;
        offset = r->offset + pixel_bytes(r);
    }
    return CN_OK;
}

/* True when the old store already is what would be built. */
static bool same_store(const builder *b, uint32_t width_px)
{
    if (!b->old || b->old->head.n_photos != b->index->n_photos || b->old->head.width_px != width_px) return false;
    return memcmp(b->old->records, b->records, b->index->n_photos * sizeof(record)) == 0;
}

static double now_s(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static cn_status build_all(const cn_context *ctx, builder *b)
{
    const uint32_t n = b->index->n_photos, chunk = 2 * cn_pool_threads(ctx->pool);
    const double started = now_s();
    for (b->first = 0; b->first < n; b->first += chunk) {
        if (cn_stopping(ctx)) return cn_fail(CN_ERR_INTERRUPTED, "stopped while reading photos; run the same command to go on");
        const uint32_t count = n - b->first < chunk ? n - b->first : chunk;
        cn_pool_run(ctx->pool, count, build_one, b);
        for (uint32_t i = b->first; i < b->first + count; i++)
            if (b->status[i] != CN_OK) return cn_fail(b->status[i], "%s", b->message[i] ? b->message[i] : "out of memory");
        const double done = b->first + count, elapsed = now_s() - started;
        const cn_progress_report report = {"pixels", NULL, done, n, elapsed, elapsed / done * (n - done), NULL};
        cn_progress(ctx, &report);
    }
    return CN_OK;
}

static cn_status build_file(const cn_context *ctx, builder *b, uint32_t width_px, const char *path)
{
    b->fd = open(b->temporary, O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
    if (b->fd < 0) return cn_fail(CN_ERR_IO, "%s cannot be written: %s", path, strerror(errno));
    header head = {.n_photos = b->index->n_photos, .width_px = width_px};
    memcpy(head.magic, MAGIC, sizeof MAGIC);
    cn_status status = build_all(ctx, b);
    if (status == CN_OK) status = write_at(b, b->records, b->index->n_photos * sizeof(record), sizeof head);
    if (status == CN_OK) status = write_at(b, &head, sizeof head, 0);
    if (close(b->fd) != 0 && status == CN_OK) status = cn_fail(CN_ERR_IO, "%s cannot be written: %s", path, strerror(errno));
    if (status == CN_OK) status = cn_file_replace(b->temporary, path);
    if (status != CN_OK) unlink(b->temporary);
    return status;
}

cn_status cn_pixel_store_build(const cn_context *ctx, const cn_photo_index *index, uint32_t width_px, const char *path)
{
    if (width_px < 16 || width_px > 65535) return cn_fail(CN_ERR_CONFIG, "photos.width_px is %u; give 16 to 65535", width_px);
    cn_colour *colour = NULL;
    cn_pixel_store *old = NULL;
    CN_TRY(cn_colour_create(&colour, NULL));
    if (cn_file_exists(path) && cn_pixel_store_open(&old, path) != CN_OK) cn_log(ctx, CN_LOG_WARN, "%s; making it again", cn_error_message());
    char *temporary = cn_file_temporary(path);
    builder b = {.index = index, .colour = colour, .old = old, .temporary = temporary};
    b.records = calloc(index->n_photos + 1u, sizeof *b.records);
    b.status = calloc(index->n_photos + 1u, sizeof *b.status);
    b.message = calloc(index->n_photos + 1u, sizeof *b.message);
    cn_status status = temporary && b.records && b.status && b.message ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory while making %s", path);
    if (status == CN_OK) status = lay_out(&b, width_px);
    if (status == CN_OK && !same_store(&b, width_px)) status = build_file(ctx, &b, width_px, path);
    for (uint32_t i = 0; b.message && i < index->n_photos; i++) free(b.message[i]);
    free(b.records);
    free(b.status);
    free(b.message);
    free(temporary);
    cn_pixel_store_close(&old);
    cn_colour_destroy(&colour);
    return status;
}
