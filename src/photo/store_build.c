/* Builds the pixel store: decode, mask, convert to linear ACEScg, shrink, write. Each thread works on one photo, which
 * sets the memory. */
#include "photo/store.h"

#include "base/clock.h"
#include "base/file.h"
#include "base/hash.h"
#include "bridge/oiio.h"
#include "conurb/colour.h"
#include "image/image.h"
#include "photo/border.h"
#include "photo/linear.h"
#include "photo/maps.h"
#include "photo/mask.h"
#include "photo/reuse.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* Linear light. Noise of an 8-bit photo of a lens cap: 2 codes. */
#define SAME_COLOUR 0.001f

/* The result for one photo. */
typedef struct outcome {
    cn_status status;
    bool ignored, one_colour, no_depth, not_finite; /* not_finite: all of its pixels */
    cn_normal_report normals;
    cn_photo_border border;
    char *message;
    char *unread; /* why its ICC profile could not be used, or NULL */
} outcome;

typedef struct builder {
    const cn_photo_index *index;
    const cn_colour *colour;
    const cn_pixel_store *old[2]; /* older stores whose pixels may be reused, or NULL */
    cn_reuse reuse[2];            /* of those */
    cn_store_record *records;
    outcome *outcomes;
    int fd;
    const char *path, *temporary;
    uint32_t width_px, first; /* first: of the chunk being made */
} builder;

static cn_status cannot_write(const char *path)
{
    return cn_fail(CN_ERR_IO, "%s cannot be written: %s; make room or choose another folder, and run again", path,
                   strerror(errno));
}

static cn_status write_at(const builder *b, const void *data, size_t size, uint64_t offset)
{
    const char *at = data;
    while (size) {
        const ssize_t n = pwrite(b->fd, at, size, (off_t)offset);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) return cannot_write(b->path);
        at += n;
        offset += (uint64_t)n;
        size -= (size_t)n;
    }
    return CN_OK;
}

static void apply_border(const cn_photo_border *border, float *rgba, uint32_t w, uint32_t h)
{
    for (uint32_t y = 0; y < h; y++)
        for (uint32_t x = 0; x < w; x++)
            if (x < border->left || x >= w - border->right || y < border->top || y >= h - border->bottom)
                rgba[4 * ((size_t)y * w + x) + 3] = 0;
}

/* Alpha becomes the weight, so that transparent pixels are not learned. Float files are premultiplied. Pixels that are
 * not finite get weight 0 here, before the conversion replaces their colours. */
static void weigh(float *rgba, size_t n, bool multiplied, outcome *o)
{
    o->not_finite = true;
    for (size_t i = 0; i < n; i++) {
        float *p = rgba + 4 * i;
        const bool finite = isfinite(p[0] + p[1] + p[2] + p[3]);
        if (finite) o->not_finite = false;
        if (!finite) p[3] = 0;
        p[3] = fminf(fmaxf(p[3], 0), 1);
        if (multiplied && p[3] > 0)
            for (int c = 0; c < 3; c++)
                p[c] /= p[3];
    }
}

static cn_status convert_depth(const builder *b, uint32_t at)
{
    const cn_store_record *r = &b->records[at];
    const size_t n = (size_t)r->width * r->height;
    float *depth = malloc(n * sizeof *depth);
    if (!depth) return cn_fail(CN_ERR_NOMEM, "out of memory for the depth map of %s", r->name);
    cn_status status = cn_photo_read_depth(&b->index->photos[at], r->width, r->height, depth);
    bool known = false;
    for (size_t i = 0; i < n && status == CN_OK && !known; i++)
        known = depth[i] > 0;
    b->outcomes[at].no_depth = !known;
    if (status == CN_OK) status = write_at(b, depth, n * sizeof *depth, r->offset + cn_store_pixel_bytes(r));
    free(depth);
    return status;
}

static cn_status convert_normal(const builder *b, uint32_t at)
{
    const cn_store_record *r = &b->records[at];
    const size_t n = (size_t)r->width * r->height;
    int8_t *normal = malloc(n * 4);
    if (!normal) return cn_fail(CN_ERR_NOMEM, "out of memory for the normal map of %s", r->name);
    cn_status status =
        cn_photo_read_normal(&b->index->photos[at], r->width, r->height, normal, &b->outcomes[at].normals);
    if (status == CN_OK) status = write_at(b, normal, n * 4, r->offset + cn_store_normals_at(r));
    free(normal);
    return status;
}

static cn_status convert_maps(const builder *b, uint32_t at)
{
    const cn_photo *photo = &b->index->photos[at];
    if (photo->depth) CN_TRY(convert_depth(b, at));
    return photo->normal ? convert_normal(b, at) : CN_OK;
}

/* Notes whether a photo has a pixel that is learnt, and whether those have more than one colour. noise: of a channel.
 */
static void look_at(const float *rgba, size_t n, float noise, outcome *o)
{
    const float *first = NULL;
    o->one_colour = true;
    for (size_t i = 0; i < n; i++) {
        const float *p = rgba + 4 * i;
        if (!(p[3] > 0)) continue;
        if (!first) first = p;
        for (int c = 0; c < 3; c++)
            if (fabsf(p[c] - first[c]) > noise + SAME_COLOUR * fabsf(first[c])) o->one_colour = false;
    }
    o->ignored = !first;
    if (!first) o->one_colour = false;
}

static cn_status convert(const builder *b, uint32_t at, const char *path, const cn_oiio_info *info, float *rgba)
{
    const cn_photo *photo = &b->index->photos[at];
    const cn_store_record *r = &b->records[at];
    const size_t n = (size_t)photo->width * photo->height, out_n = (size_t)r->width * r->height;
    weigh(rgba, n, info->is_float, &b->outcomes[at]);
    if (!info->is_float) { /* a border is added to files for the web */
        b->outcomes[at].border = cn_photo_find_border(rgba, photo->width, photo->height);
        apply_border(&b->outcomes[at].border, rgba, photo->width, photo->height);
    }
    CN_TRY(cn_photo_apply_mask(b->index->folder, photo, rgba));
    CN_TRY(cn_photo_to_linear(b->colour, path, info, rgba, n, &b->outcomes[at].unread));
    float *small = malloc(out_n * 4 * sizeof *small);
    uint16_t *half = malloc(out_n * 8);
    cn_status status = small && half ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for %s", photo->name);
    if (status == CN_OK) {
        cn_image_shrink(rgba, photo->width, photo->height, small, r->width, r->height);
        look_at(small, out_n, info->is_float ? 0 : SAME_COLOUR, &b->outcomes[at]); /* floats have any unit */
        for (size_t i = 0; i < out_n * 4; i++)
            half[i] = cn_half_from_float(small[i]);
        status = write_at(b, half, out_n * 8, r->offset);
    }
    free(small);
    free(half);
    return status == CN_OK ? convert_maps(b, at) : status;
}

static cn_status copy_old(const builder *b, const cn_store_record *r, bool *copied)
{
    *copied = false;
    for (int i = 0; i < 2 && !*copied; i++) {
        const cn_store_record *o = cn_reuse_find(&b->reuse[i], r);
        if (!o) continue;
        const size_t size = cn_store_photo_bytes(r);
        void *pixels = malloc(size);
        if (!pixels) return cn_fail(CN_ERR_NOMEM, "out of memory for %s", r->name);
        cn_status status = cn_store_read_at(b->old[i], pixels, size, o->offset);
        if (status == CN_OK) status = write_at(b, pixels, size, r->offset);
        free(pixels);
        CN_TRY(status);
        *copied = true;
    }
    return CN_OK;
}

static cn_status build_photo(const builder *b, uint32_t at)
{
    const cn_photo *photo = &b->index->photos[at];
    bool copied;
    CN_TRY(copy_old(b, &b->records[at], &copied));
    if (copied) return CN_OK;
    char *path = cn_path_join(b->index->folder, photo->name);
    cn_oiio_info info;
    float *rgba = NULL;
    uint32_t w = 0, h = 0;
    cn_status status = path ? cn_oiio_read_info(path, &info) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_oiio_read_rgba(path, &rgba, &w, &h);
    if (status == CN_OK && (w != photo->width || h != photo->height))
        status = cn_fail(CN_ERR_DATA, "%s changed since it was indexed; run `conurb poses` again", path);
    if (status == CN_OK) status = convert(b, at, path, &info, rgba);
    free(rgba);
    free(path);
    return status;
}

static void build_one(void *user, size_t i, unsigned worker)
{
    (void)worker;
    builder *b = user;
    const uint32_t at = b->first + (uint32_t)i;
    outcome *o = &b->outcomes[at];
    o->status = build_photo(b, at);
    if (o->status != CN_OK) o->message = cn_format("%s", cn_error_message());
}

static cn_status lay_out(builder *b)
{
    const uint32_t n = b->index->n_photos;
    uint64_t offset = sizeof(cn_store_header) + (uint64_t)n * CN_STORE_RECORD_SIZE;
    for (uint32_t i = 0; i < n; i++) {
        const cn_photo *p = &b->index->photos[i];
        cn_store_record *r = &b->records[i];
        if (strlen(p->name) >= CN_STORE_NAME_SIZE)
            return cn_fail(CN_ERR_DATA, "the name of photo %s is too long; keep it under %d bytes", p->name,
                           CN_STORE_NAME_SIZE);
        strcpy(r->name, p->name);
        r->hash = p->hash;
        if (p->mask) {
            char *path = cn_path_join(b->index->folder, p->mask);
            const cn_status status = path ? cn_hash_file(path, &r->mask_hash) : cn_fail(CN_ERR_NOMEM, "out of memory");
            free(path);
            CN_TRY(status);
            /* An earlier version stretched it. */
            if (p->orientation >= 5) r->mask_hash = cn_hash_text(r->mask_hash, "turned");
        }
        if (p->depth) CN_TRY(cn_hash_file(p->depth, &r->depth_hash));
        if (p->normal) {
            CN_TRY(cn_hash_file(p->normal, &r->normal_hash));
            r->normal_hash = cn_hash_text(r->normal_hash, "normals in axes %d", p->normal_axes);
        }
        r->full_width = p->width;
        r->width = p->width < b->width_px ? p->width : b->width_px;
        r->height = (uint32_t)fmax(1, round((double)p->height * r->width / p->width));
        r->offset = (offset + CN_STORE_PAGE - 1) / CN_STORE_PAGE * CN_STORE_PAGE;
        offset = r->offset + cn_store_photo_bytes(r);
    }
    return CN_OK;
}

/* True when the store at the path already is what would be built. */
static bool is_done(const builder *b)
{
    const cn_pixel_store *old = b->old[0];
    if (!old || old->head.n_photos != b->index->n_photos || old->head.width_px != b->width_px) return false;
    return memcmp(old->records, b->records, b->index->n_photos * sizeof *b->records) == 0;
}

static void say_maps(const cn_context *ctx, const cn_photo *photo, const outcome *o)
{
    if (o->no_depth) cn_log(ctx, CN_LOG_WARN, "%s has no depth above 0: it is not used", photo->depth);
    if (o->normals.none) cn_log(ctx, CN_LOG_WARN, "%s has no normal: it is not used", photo->normal);
    if (o->normals.away)
        cn_log(
            ctx, CN_LOG_WARN,
            "%s: most normals point away from the camera, and such are not used; photos.normal_axes may have to be %s",
            photo->normal, photo->normal_axes == CN_NORMAL_OPENGL ? "opencv" : "opengl");
}

static void say_borders(const cn_context *ctx, const builder *b)
{
    uint32_t n = 0, first = 0;
    for (uint32_t i = 0; i < b->index->n_photos; i++) {
        const cn_photo_border *o = &b->outcomes[i].border;
        if (o->left + o->top && !n++) first = i;
    }
    const cn_photo_border *o = &b->outcomes[first].border;
    if (n)
        cn_log(ctx, CN_LOG_INFO,
               "photos with a border of one colour, which is left out like a mask: %u. The first is %s: left %u, "
               "right %u, top %u, bottom %u px",
               n, b->index->photos[first].name, o->left, o->right, o->top, o->bottom);
}

static void say_one_colour(const cn_context *ctx, const builder *b)
{
    uint32_t n = 0, first = 0;
    for (uint32_t i = 0; i < b->index->n_photos; i++)
        if (b->outcomes[i].one_colour && !n++) first = i;
    if (n)
        cn_log(ctx, CN_LOG_WARN,
               "photos of one colour all over, such as black or white: %u of %u. The first is %s; remove such photos, "
               "for they are learnt like the others",
               n, b->index->n_photos, b->index->photos[first].name);
}

static cn_status report_chunk(const cn_context *ctx, const builder *b, uint32_t count, double elapsed)
{
    const uint32_t n = b->index->n_photos;
    for (uint32_t i = b->first; i < b->first + count; i++) {
        const outcome *o = &b->outcomes[i];
        if (o->status != CN_OK) return cn_fail(o->status, "%s", o->message ? o->message : "out of memory");
        if (o->ignored)
            cn_log(ctx, CN_LOG_WARN, "%s is not used: %s", b->index->photos[i].name,
                   o->not_finite ? "none of its pixels is finite" : "its mask or alpha hides all of it");
    }
    for (uint32_t i = b->first; i < b->first + count; i++)
        say_maps(ctx, &b->index->photos[i], &b->outcomes[i]);
    const double done = b->first + count;
    const cn_progress_report report = { "pixels", NULL, done, n, elapsed, elapsed / done * (n - done), NULL };
    cn_progress(ctx, &report);
    return CN_OK;
}

static int by_camera(const void *a, const void *b, void *user)
{
    const cn_photo *photos = user;
    const uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    const int order = strcmp(photos[x].camera, photos[y].camera);
    return order ? order : (x > y) - (x < y);
}

/* Warn once per camera: it writes the same profile into all its photos. */
static void say_unread_profiles(const cn_context *ctx, const builder *b)
{
    cn_photo *photos = b->index->photos;
    uint32_t *order = malloc((b->index->n_photos + 1u) * sizeof *order), n = 0;
    for (uint32_t i = 0; order && i < b->index->n_photos; i++)
        if (b->outcomes[i].unread) order[n++] = i;
    if (n) qsort_r(order, n, sizeof *order, by_camera, photos);
    for (uint32_t i = 0, end = 0; i < n; i = end) {
        const cn_photo *first = &photos[order[i]];
        while (end < n && strcmp(photos[order[end]].camera, first->camera) == 0)
            end++;
        cn_log(ctx, CN_LOG_WARN, "%s: %s; read without it (photos of %s with the same fault: %u)", first->name,
               b->outcomes[order[i]].unread, *first->camera ? first->camera : "cameras without a name", end - i);
    }
    free(order);
}

/* done: the first `done` photos have all their pixels in the file. */
static cn_status build_all(const cn_context *ctx, builder *b, uint32_t *done)
{
    cn_pool *pool = ctx ? ctx->pool : NULL;
    const uint32_t n = b->index->n_photos, chunk = 2 * cn_pool_threads(pool);
    const double started = cn_now_s();
    for (b->first = 0; b->first < n; b->first += chunk) {
        if (cn_stopping(ctx))
            return cn_fail(CN_ERR_INTERRUPTED, "stopped while reading photos; run the same command to resume");
        const uint32_t count = n - b->first < chunk ? n - b->first : chunk;
        cn_pool_run(pool, count, build_one, b);
        CN_TRY(report_chunk(ctx, b, count, cn_now_s() - started));
        *done = b->first + count;
    }
    return CN_OK;
}

/* Header and records are written last: until then the file is not a valid store. */
static cn_status finish_file(const builder *b, uint32_t n_photos, const char *path)
{
    bool depth = false, normal = false;
    for (uint32_t i = 0; i < n_photos; i++) {
        depth = depth || b->records[i].depth_hash;
        normal = normal || b->records[i].normal_hash;
    }
    cn_store_header head = { .version = normal  ? CN_STORE_VERSION
                                        : depth ? CN_STORE_DEPTH
                                                : CN_STORE_PLAIN,
                             .n_photos = n_photos,
                             .width_px = b->width_px };
    memcpy(head.magic, CN_STORE_MAGIC, sizeof CN_STORE_MAGIC);
    CN_TRY(write_at(b, b->records, n_photos * sizeof *b->records, sizeof head));
    CN_TRY(write_at(b, &head, sizeof head, 0));
    return cn_file_replace(b->temporary, path);
}

/* A build that is stopped saves its photos as a smaller store, which the next run reuses. */
static cn_status build_file(const cn_context *ctx, builder *b, const char *part)
{
    b->fd = open(b->temporary, O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    if (b->fd < 0) return cannot_write(b->path);
    uint32_t done = 0;
    cn_status status = build_all(ctx, b, &done);
    if (status == CN_OK) {
        status = finish_file(b, done, b->path);
    } else if (status == CN_ERR_INTERRUPTED && done) {
        const cn_status kept = finish_file(b, done, part);
        status =
            cn_fail(CN_ERR_INTERRUPTED, "stopped while reading photos, %u of %u %s; run the same command to resume",
                    done, b->index->n_photos, kept == CN_OK ? "kept" : "read but not kept");
    }
    close(b->fd);
    unlink(b->temporary);
    return status;
}

/* Where a stopped build keeps what it has read. NULL when out of memory. */
static char *part_of(const char *path)
{
    return cn_format("%s.part", path);
}

static void open_old(const cn_context *ctx, const char *path, cn_pixel_store **old)
{
    if (cn_file_exists(path) && cn_pixel_store_open(old, path) != CN_OK)
        cn_log(ctx, CN_LOG_WARN, "making %s again: %s", path, cn_error_message());
    if (*old && (*old)->head.version < CN_STORE_PLAIN) {
        cn_log(ctx, CN_LOG_INFO, "making %s again: an older Conurb made it, without ICC profiles", path);
        cn_pixel_store_close(old);
    }
}

static cn_status build_with(const cn_context *ctx, builder *b, const char *part)
{
    const uint32_t n = b->index->n_photos;
    cn_pixel_store *old[2] = { NULL, NULL };
    open_old(ctx, b->path, &old[0]);
    open_old(ctx, part, &old[1]);
    for (int i = 0; i < 2; i++)
        b->old[i] = old[i];
    b->records = calloc(n + 1u, sizeof *b->records);
    b->outcomes = calloc(n + 1u, sizeof *b->outcomes);
    cn_status status = cn_reuse_init(&b->reuse[0], old[0]);
    if (status == CN_OK) status = cn_reuse_init(&b->reuse[1], old[1]);
    if (!b->records || !b->outcomes) status = cn_fail(CN_ERR_NOMEM, "out of memory while making %s", b->path);
    if (status == CN_OK) status = lay_out(b);
    if (status == CN_OK && !is_done(b)) status = build_file(ctx, b, part);
    if (status == CN_OK && cn_file_exists(part)) status = cn_file_remove(part);
    if (b->outcomes) say_borders(ctx, b);
    if (b->outcomes) say_one_colour(ctx, b);
    if (b->outcomes) say_unread_profiles(ctx, b);
    for (uint32_t i = 0; b->outcomes && i < n; i++) {
        free(b->outcomes[i].message);
        free(b->outcomes[i].unread);
    }
    free(b->records);
    free(b->outcomes);
    for (int i = 0; i < 2; i++) {
        cn_reuse_deinit(&b->reuse[i]);
        cn_pixel_store_close(&old[i]);
    }
    return status;
}

cn_status cn_pixel_store_is_done(const cn_photo_index *index, uint32_t width_px, const char *path, bool *done)
{
    builder b = { .index = index, .path = path, .width_px = width_px };
    cn_pixel_store *old = NULL;
    char *part = part_of(path);
    b.records = calloc(index->n_photos + 1u, sizeof *b.records);
    cn_status status = part && b.records ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory while looking at %s", path);
    *done = false;
    if (status == CN_OK) open_old(NULL, path, &old);
    b.old[0] = old;
    if (status == CN_OK) status = lay_out(&b);
    if (status == CN_OK) *done = is_done(&b) && !cn_file_exists(part);
    cn_pixel_store_close(&old);
    free(b.records);
    free(part);
    return status;
}

cn_status cn_pixel_store_build(const cn_context *ctx, const cn_photo_index *index, uint32_t width_px, const char *path)
{
    if (width_px < 16 || width_px > 65535)
        return cn_fail(CN_ERR_CONFIG, "photos.width_px is %u; give 16 to 65535", width_px);
    /* The store is ACEScg by definition; a user's own config may not even have it. */
    cn_colour *colour = NULL;
    CN_TRY(cn_colour_create(&colour, ""));
    char *temporary = cn_file_temporary(path), *part = part_of(path);
    builder b = { .index = index, .colour = colour, .path = path, .temporary = temporary, .width_px = width_px };
    const cn_status status =
        temporary && part ? build_with(ctx, &b, part) : cn_fail(CN_ERR_NOMEM, "out of memory while making %s", path);
    free(temporary);
    free(part);
    cn_colour_destroy(&colour);
    return status;
}
