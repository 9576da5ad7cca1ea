#include "pose/import_files.h"

#include "base/file.h"

#include <dirent.h>
#include <stdlib.h>
#include <string.h>

cn_status cn_import_files_add(cn_import_files *files, char *path)
{
    char **paths = path ? realloc(files->paths, (files->n + (size_t)1) * sizeof *paths) : NULL;
    if (!paths) {
        free(path);
        return cn_fail(CN_ERR_NOMEM, "out of memory listing the files of an import");
    }
    files->paths = paths;
    files->paths[files->n++] = path;
    return CN_OK;
}

static int is_json(const struct dirent *entry)
{
    const char *dot = strrchr(entry->d_name, '.');
    return dot && dot != entry->d_name && strcmp(dot, ".json") == 0;
}

cn_status cn_import_files_add_json(cn_import_files *files, const char *folder)
{
    struct dirent **entries = NULL;
    const int n = scandir(folder, &entries, is_json, alphasort);
    cn_status status = CN_OK;
    for (int i = 0; i < n; i++) {
        if (status == CN_OK) status = cn_import_files_add(files, cn_path_join(folder, entries[i]->d_name));
        free(entries[i]);
    }
    free(entries);
    return status;
}

void cn_import_files_deinit(cn_import_files *files)
{
    for (uint32_t i = 0; i < files->n; i++)
        free(files->paths[i]);
    free(files->paths);
    *files = (cn_import_files){ 0 };
}
