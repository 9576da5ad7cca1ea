/* Reads the poses of other tools: chooses the reader, and fits what it read to the photos. */
#include "pose/import.h"

#include "base/file.h"
#include "pose/importer.h"
#include "pose/scene.h"

#include <stdlib.h>
#include <string.h>

static cn_status check_names(const cn_importer *to)
{
    const cn_scene *scene = to->scene;
    for (uint32_t i = 1; i < scene->n_views; i++)
        if (strcmp(scene->views[i].name, scene->views[i - 1].name) == 0)
            return cn_fail(CN_ERR_FORMAT, "%s: two frames name photo %s; remove one", to->path, scene->views[i].name);
    return CN_OK;
}

/* Merges equal cameras and resizes them to the photos; the photos' orientation is applied. */
static cn_status finish(cn_importer *to, bool raw_pixels)
{
    cn_scene *scene = to->scene;
    if (to->n_missing)
        cn_log(to->ctx, CN_LOG_WARN,
               "%s: %u of %u frames name photos that are not in the collection; they are left out", to->path,
               to->n_missing, to->n_frames);
    if (scene->n_views == 0)
        return cn_fail(CN_ERR_DATA,
                       "%s: none of its %u frames names a photo in %s; give the folder that it was made "
                       "for",
                       to->path, to->n_frames, to->index->folder);
    if (to->worst_fit_px > 0.1)
        cn_log(to->ctx, CN_LOG_INFO, "%s: its lens has terms that Conurb lacks; it is approximated within %.2f px",
               to->path, to->worst_fit_px);
    CN_TRY(cn_scene_sort_views(scene));
    CN_TRY(check_names(to));
    bool *keep = malloc(scene->n_views + (size_t)1);
    if (!keep) return cn_fail(CN_ERR_NOMEM, "%s: out of memory", to->path);
    memset(keep, true, scene->n_views);
    cn_status status = cn_scene_fit_photos(to->ctx, scene, to->index, raw_pixels, keep);
    if (status == CN_OK) status = cn_scene_keep_views(scene, keep);
    free(keep);
    return status;
}

typedef struct file_kind {
    cn_status (*read)(cn_importer *to);
    bool raw_pixels;     /* its poses are for the stored pixels, without the EXIF orientation */
    bool arbitrary_axes; /* as in cn_import_origin */
} file_kind;

/* Where none of its folders is one of the collection's, as after all photos were put into one folder for another tool,
 * the names of files alone count. */
static cn_status read_names(cn_importer *to, const file_kind *kind)
{
    CN_TRY(kind->read(to));
    if (to->scene->n_views || !to->n_missing || to->finder.ignores_folders) return CN_OK;
    cn_log(to->ctx, CN_LOG_INFO, "%s: no photo lies in a folder that it names; the names of the files alone count",
           to->path);
    cn_scene_deinit(to->scene);
    memset(to->scene, 0, sizeof *to->scene);
    to->n_frames = to->n_missing = 0;
    to->finder.ignores_folders = true;
    return kind->read(to);
}

static cn_status read_with(cn_importer *to, const file_kind *kind)
{
    memset(to->scene, 0, sizeof *to->scene);
    to->n_models = 1;
    CN_TRY(cn_path_absolute(to->path, &to->folder));
    *strrchr(to->folder, '/') = '\0';
    cn_status status = cn_photo_finder_init(&to->finder, to->index);
    if (status == CN_OK) {
        status = read_names(to, kind);
        if (status == CN_OK) status = finish(to, kind->raw_pixels);
        cn_photo_finder_deinit(&to->finder);
    }
    free(to->folder);
    to->folder = NULL;
    if (status != CN_OK) cn_scene_deinit(to->scene);
    return status;
}

cn_status cn_scene_read_transforms(const cn_context *ctx, cn_scene *scene, const char *path,
                                   const cn_photo_index *index)
{
    cn_importer to = { .ctx = ctx, .path = path, .index = index, .scene = scene };
    return read_with(&to, &(file_kind){ .read = cn_import_transforms });
}

cn_status cn_import_folder(const cn_context *ctx, const char *path, const cn_photo_index *index, cn_scene *scene)
{
    cn_importer to = { .ctx = ctx, .path = path, .index = index, .scene = scene };
    return read_with(&to, &(file_kind){ .read = cn_import_polycam });
}

/* Record3D's metadata has poses where a transforms.json has frames. */
static bool is_record3d(const char *text)
{
    return strstr(text, "\"poses\"") && strstr(text, "\"K\"") && !strstr(text, "\"frames\"");
}

/* The reader by the first bytes of the file. */
static cn_status choose(const char *path, file_kind *out)
{
    static const struct {
        const char *begins;
        file_kind kind;
    } KNOWN[] = {
        { "[", { cn_import_opensfm, true, false } },
        { "{", { cn_import_transforms, false, false } },
        { "# Bundle file", { cn_import_bundler, true, true } },
        { "NVM_V3", { cn_import_nvm, true, true } },
        { "<", { cn_import_metashape, true, false } },
        { "#name,", { cn_import_reality_capture, true, false } },
        { "#cameras", { cn_import_reality_capture, true, false } },
    };
    char *text = NULL;
    size_t size;
    CN_TRY(cn_file_read(path, 0, &text, &size));
    const char *at = text + (size >= 3 && memcmp(text, "\xef\xbb\xbf", 3) == 0 ? 3 : 0);
    at += strspn(at, " \t\r\n");
    bool found = false;
    for (size_t i = 0; i < sizeof KNOWN / sizeof *KNOWN && !found; i++) {
        found = strncmp(at, KNOWN[i].begins, strlen(KNOWN[i].begins)) == 0;
        if (found) *out = KNOWN[i].kind;
    }
    if (found && *at == '{' && is_record3d(at)) *out = (file_kind){ cn_import_record3d, false, false };
    free(text);
    if (found) return CN_OK;
    return cn_fail(CN_ERR_FORMAT, "%s: no tool that Conurb knows writes such a file; give " CN_IMPORT_NAMES, path);
}

bool cn_import_has_list(const char *path)
{
    file_kind kind;
    return choose(path, &kind) == CN_OK && kind.read == cn_import_bundler;
}

cn_status cn_import_file(const cn_context *ctx, const char *path, const cn_photo_index *index, cn_scene *scene,
                         uint32_t *n_models, cn_import_origin *origin)
{
    file_kind kind = { 0 };
    cn_importer to = { .ctx = ctx, .path = path, .index = index, .scene = scene };
    memset(scene, 0, sizeof *scene); /* empty also when no reader is found */
    CN_TRY(choose(path, &kind));
    const cn_status status = read_with(&to, &kind);
    *n_models = to.n_models;
    *origin = to.origin;
    origin->arbitrary_axes = origin->arbitrary_axes || kind.arbitrary_axes;
    return status;
}
