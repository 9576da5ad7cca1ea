/* Finds what an import is read from: a file, or in a folder what the tools name so. */
#include "base/file.h"
#include "pose/colmap.h"
#include "pose/import.h"
#include "pose/scene.h"

#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

/* The file of poses in the folder of another tool's project; NULL: none. Caller frees. */
static char *find_file(const char *folder)
{
    static const char *const NAMES[] = { "reconstruction.json",
                                         "opensfm/reconstruction.json",
                                         "transforms.json",
                                         "bundle.out",
                                         "bundle/bundle.out",
                                         "cameras.xml",
                                         "metadata",
                                         "metadata.json",
                                         "EXR_RGBD/metadata" };
    for (size_t i = 0; i < sizeof NAMES / sizeof *NAMES; i++) {
        char *path = cn_path_join(folder, NAMES[i]);
        if (path && cn_file_exists(path)) return path;
        free(path);
    }
    return NULL;
}

/* The folder with the poses of a Polycam export, those that its own adjustment corrected first; NULL: none. Caller
 * frees. */
static char *find_keyframes(const char *folder)
{
    static const char *const NAMES[] = { "keyframes/corrected_cameras", "corrected_cameras", "keyframes/cameras",
                                         "cameras" };
    for (size_t i = 0; i < sizeof NAMES / sizeof *NAMES; i++) {
        struct stat info;
        char *path = cn_path_join(folder, NAMES[i]);
        if (path && stat(path, &info) == 0 && S_ISDIR(info.st_mode)) return path;
        free(path);
    }
    return NULL;
}

cn_status cn_import_find(const char *path, cn_import_source *source)
{
    struct stat info;
    *source = (cn_import_source){ 0 };
    if (stat(path, &info) != 0) return cn_fail(CN_ERR_IO, "poses.import: %s is not there; give " CN_IMPORT_NAMES, path);
    if (!S_ISDIR(info.st_mode)) {
        source->file = strdup(path);
        return source->file ? CN_OK : cn_fail(CN_ERR_NOMEM, "%s: out of memory", path);
    }
    CN_TRY(cn_colmap_find_model(path, &source->model, &source->n_models));
    if (!source->model) source->file = find_file(path);
    if (!source->model && !source->file) source->keyframes = find_keyframes(path);
    return CN_OK;
}

void cn_import_source_deinit(cn_import_source *source)
{
    free(source->model);
    free(source->file);
    free(source->keyframes);
    *source = (cn_import_source){ 0 };
}

static cn_status list_model(const char *folder, cn_import_files *files)
{
    for (int i = 0; i < 3; i++) {
        static const char *const NAMES[] = { "cameras", "images", "points3D" };
        CN_TRY(cn_import_files_add(
            files, cn_format("%s/%s.%s", folder, NAMES[i], cn_model_is_binary(folder) ? "bin" : "txt")));
    }
    return CN_OK;
}

static cn_status list_file(const char *path, cn_import_files *files)
{
    char *list = NULL;
    CN_TRY(cn_import_files_add(files, strdup(path)));
    /* A list that is missing is reported by the import. */
    return cn_import_has_list(path) && cn_import_bundler_list(path, &list) == CN_OK ? cn_import_files_add(files, list)
                                                                                    : CN_OK;
}

cn_status cn_import_list(const char *path, cn_import_files *files)
{
    cn_import_source source;
    *files = (cn_import_files){ 0 };
    CN_TRY(cn_import_find(path, &source));
    cn_status status = source.model       ? list_model(source.model, files)
                       : source.file      ? list_file(source.file, files)
                       : source.keyframes ? cn_import_files_add_json(files, source.keyframes)
                                          : CN_OK;
    cn_import_source_deinit(&source);
    if (status != CN_OK) cn_import_files_deinit(files);
    return status;
}
