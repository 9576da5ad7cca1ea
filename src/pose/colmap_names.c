/* Names and folders that COLMAP sees. */
#include "base/file.h"
#include "pose/colmap.h"
#include "pose/scene.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

/* COLMAP 3.8 with FreeImage 3.18, as in Debian 12, was tried: "Failed to read image file format" for EXR, HEIC, and PNG
 * and TIFF of 16 bits. */
bool cn_colmap_reads(const cn_photo *photo)
{
    static const char *const unread[] = { ".exr", ".heic", ".heif", ".hif", ".avif" };
    const char *dot = strrchr(photo->name, '.');
    for (size_t i = 0; dot && i < sizeof unread / sizeof *unread; i++)
        if (strcasecmp(dot, unread[i]) == 0) return false;
    return !photo->deep;
}

bool cn_colmap_needs_links(const cn_photo_index *index)
{
    for (uint32_t i = 0; i < index->n_photos; i++) {
        const cn_photo *photo = &index->photos[i];
        if (strpbrk(photo->name, " \t\r\n\v\f") || photo->name[0] == '#' || !cn_colmap_reads(photo)) return true;
    }
    return false;
}

char *cn_colmap_name(const cn_photo_index *index, bool linked, uint32_t i)
{
    const char *name = index->photos[i].name;
    if (!linked) return strdup(name);
    /* The hash tells which copies are of photos as they are now. */
    if (!cn_colmap_reads(&index->photos[i])) return cn_format("%08u-%016" PRIx64 ".jpg", i, index->photos[i].hash);
    const char *extension = strrchr(cn_path_base(name), '.');
    if (!extension || strpbrk(extension, " \t\r\n\v\f")) extension = ".jpg";
    return cn_format("%08u%s", i, extension);
}

cn_status cn_colmap_number(cn_colmap_database *database, const cn_photo_index *index, bool linked, uint32_t i,
                           uint32_t *number)
{
    char *name = cn_colmap_name(index, linked, i);
    if (!name) return cn_fail(CN_ERR_NOMEM, "out of memory");
    const cn_status status = cn_colmap_database_photo(database, name, number);
    free(name);
    return status;
}

cn_status cn_colmap_restore_names(cn_scene *scene, const cn_photo_index *index)
{
    for (uint32_t i = 0; i < scene->n_views; i++) {
        unsigned long photo = strtoul(scene->views[i].name, NULL, 10);
        if (photo >= index->n_photos)
            return cn_fail(CN_ERR_INTERNAL, "COLMAP names photo %s, which is not one of the photos it was given",
                           scene->views[i].name);
        char *name = strdup(index->photos[photo].name);
        if (!name) return cn_fail(CN_ERR_NOMEM, "out of memory for photo names");
        free(scene->views[i].name);
        scene->views[i].name = name;
    }
    return cn_scene_sort_views(scene);
}

typedef struct choice {
    char *best;
    uint32_t photos, n;
} choice;

/* Takes ownership of `path` if it is the largest model so far. False when there is no model. */
static bool consider(choice *c, char *path)
{
    uint32_t photos = path ? cn_model_photos(path) : 0;
    if (photos == 0) {
        free(path);
        return false;
    }
    c->n++;
    if (photos <= c->photos) {
        free(path);
        return true;
    }
    free(c->best);
    c->best = path;
    c->photos = photos;
    return true;
}

cn_status cn_colmap_find_model(const char *dir, char **model, uint32_t *n_models)
{
    static const char *const BELOW[] = { "", "/sparse" };
    choice c = { 0 };
    for (int i = 0; i < 2 && c.n == 0; i++) {
        if (consider(&c, cn_format("%s%s", dir, BELOW[i]))) break;
        for (unsigned k = 0; consider(&c, cn_format("%s%s/%u", dir, BELOW[i], k));)
            k++;
    }
    *model = c.best;
    *n_models = c.n;
    return CN_OK;
}

cn_status cn_colmap_write_list(const cn_photo_index *index, bool linked, const char *path, const uint32_t *photos,
                               uint32_t n)
{
    char *text = NULL;
    size_t size = 0;
    FILE *stream = open_memstream(&text, &size);
    bool fine = stream != NULL;
    for (uint32_t i = 0; i < n && fine; i++) {
        char *name = cn_colmap_name(index, linked, photos[i]);
        fine = name && fprintf(stream, "%s\n", name) > 0;
        free(name);
    }
    if (stream && fclose(stream) != 0) fine = false;
    cn_status status = fine ? cn_file_write(path, text, size) : cn_fail(CN_ERR_NOMEM, "out of memory listing photos");
    free(text);
    return status;
}
