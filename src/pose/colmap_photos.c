/* The folder of photos that COLMAP reads, where it cannot read the collection's own. */
#include "base/clock.h"
#include "base/file.h"
#include "bridge/oiio.h"
#include "pose/colmap.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* COLMAP takes the focal length from EXIF. */
cn_status cn_colmap_copy(const cn_photo_index *index, uint32_t photo, const char *path)
{
    const cn_photo *p = &index->photos[photo];
    cn_oiio_attribute about[3] = { { NULL, NULL, NULL, 0 } };
    uint32_t n = 0;
    if (p->focal_mm > 0) about[n++] = (cn_oiio_attribute){ "Exif:FocalLength", NULL, &p->focal_mm, 1 };
    if (p->focal_35mm > 0) about[n++] = (cn_oiio_attribute){ "Exif:FocalLengthIn35mmFilm", NULL, &p->focal_35mm, 1 };
    char *from = cn_path_join(index->folder, p->name);
    const cn_status status =
        from ? cn_oiio_copy_as_jpeg(from, path, about) : cn_fail(CN_ERR_NOMEM, "out of memory for %s", p->name);
    free(from);
    return status;
}

static cn_status link_to(const char *target, const char *link)
{
    CN_TRY(cn_file_remove(link));
    if (symlink(target, link) == 0) return CN_OK;
    return cn_fail(CN_ERR_IO, "%s: cannot make a link: %s", link, strerror(errno));
}

typedef struct show {
    const cn_colmap_job *j;
    uint32_t first;
    char **failed; /* [photos] why the photo cannot be shown, or NULL */
} show;

static cn_status show_photo(const cn_colmap_job *j, uint32_t photo)
{
    char *name = cn_colmap_name(j->index, true, photo);
    char *path = name ? cn_path_join(j->images, name) : NULL;
    char *target = cn_path_join(j->index->folder, j->index->photos[photo].name);
    cn_status status = path && target ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK && cn_colmap_reads(&j->index->photos[photo]))
        status = link_to(target, path);
    else if (status == CN_OK && !cn_file_exists(path))
        status = cn_colmap_copy(j->index, photo, path);
    free(name);
    free(path);
    free(target);
    return status;
}

static void show_one(void *user, size_t i, unsigned worker)
{
    (void)worker;
    const show *s = user;
    const uint32_t photo = s->first + (uint32_t)i;
    if (show_photo(s->j, photo) != CN_OK) s->failed[photo] = cn_format("%s", cn_error_message());
}

static void report(const cn_colmap_job *j, uint32_t done, double elapsed_s)
{
    const double n = j->index->n_photos;
    const cn_progress_report of = { "poses",   "photos for COLMAP",           done, n,
                                    elapsed_s, elapsed_s / done * (n - done), NULL };
    cn_progress(j->ctx, &of);
}

cn_status cn_colmap_show_photos(const cn_colmap_job *j)
{
    enum { CHUNK = 16 }; /* photos between two reports */
    const uint32_t n = j->index->n_photos;
    const double started = cn_now_s();
    CN_TRY(cn_folder_make(j->images));
    show s = { j, 0, calloc(n + (size_t)1, sizeof *s.failed) };
    cn_status status = s.failed ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    for (; status == CN_OK && s.first < n; s.first += CHUNK) {
        const uint32_t more = n - s.first < CHUNK ? n - s.first : CHUNK, done = s.first + more;
        if (cn_stopping(j->ctx))
            status = cn_fail(CN_ERR_INTERRUPTED, "stopped while photos were copied; run the same command to resume");
        if (status != CN_OK) break;
        cn_pool_run(j->ctx ? j->ctx->pool : NULL, more, show_one, &s);
        report(j, done, cn_now_s() - started);
        for (uint32_t i = s.first; i < done && status == CN_OK; i++)
            if (s.failed[i]) status = cn_fail(CN_ERR_IO, "%s", s.failed[i]);
    }
    for (uint32_t i = 0; s.failed && i < n; i++)
        free(s.failed[i]);
    free(s.failed);
    return status;
}
