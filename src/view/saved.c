#include "view/saved.h"

#include "base/file.h"
#include "base/json.h"
#include "conurb/path.h"
#include "view/request.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static char *folder_of(const cn_city *city, bool is_appearance)
{
    return cn_city_path(city, is_appearance ? "views/lights" : "views/paths");
}

char *cn_saved_path(const cn_city *city, bool is_appearance, const char *name)
{
    char *folder = folder_of(city, is_appearance), *path = folder ? cn_format("%s/%s.json", folder, name) : NULL;
    free(folder);
    return path;
}

/* Checks the path as a render does, from a temporary file. */
static cn_status check_path(const char *path, const cn_frame *frame, const json_t *data)
{
    char *trial = cn_file_temporary(path);
    cn_path_options options = cn_path_options_default();
    cn_path loaded = { 0 };
    if (!trial) return cn_fail(CN_ERR_NOMEM, "out of memory");
    options.frame = frame;
    options.width = 64;
    options.height = 64;
    options.n_frames = 2;
    cn_status status = cn_json_save(data, trial);
    if (status == CN_OK) status = cn_path_load(&loaded, trial, &options);
    cn_path_deinit(&loaded);
    unlink(trial);
    free(trial);
    return status;
}

cn_status cn_saved_check_fresh(const cn_city *city, bool is_appearance, const char *name)
{
    const char *kind = is_appearance ? "light" : "path";
    char *path = cn_saved_path(city, is_appearance, name), *relative = cn_format("renders/%s", name);
    char *film = relative ? cn_city_path(city, relative) : NULL;
    cn_status status = path && film ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK && cn_file_exists(path))
        status = cn_fail(CN_ERR_USAGE, "a %s is named '%s' already: save it again to replace that one", kind, name);
    else if (status == CN_OK && !is_appearance && cn_file_exists(film))
        status = cn_fail(CN_ERR_USAGE,
                         "a film is in renders/%s already: save it again if that film may be replaced, or choose "
                         "another name",
                         name);
    free(film);
    free(relative);
    free(path);
    return status;
}

cn_status cn_saved_write(const cn_city *city, const cn_frame *frame, bool is_appearance, const char *name,
                         const json_t *data)
{
    char *path = cn_saved_path(city, is_appearance, name);
    if (!path) return cn_fail(CN_ERR_NOMEM, "out of memory");
    cn_status status = cn_folder_of_make(path);
    if (status == CN_OK && !is_appearance) status = check_path(path, frame, data);
    if (status == CN_OK) status = cn_json_save(data, path);
    free(path);
    return status;
}

cn_status cn_saved_load(const cn_city *city, bool is_appearance, const char *name, json_t **data)
{
    char *path = cn_saved_path(city, is_appearance, name);
    *data = NULL;
    if (!path) return cn_fail(CN_ERR_NOMEM, "out of memory");
    const cn_status status = cn_json_load(path, data);
    free(path);
    return status;
}

static int by_name(const void *a, const void *b)
{
    return strcmp(*(char *const *)a, *(char *const *)b);
}

static json_t *list_of(char **names, size_t n)
{
    json_t *list = json_array();
    if (n) qsort(names, n, sizeof *names, by_name);
    for (size_t i = 0; i < n; i++) {
        json_array_append_new(list, json_string(names[i]));
        free(names[i]);
    }
    free(names);
    return list;
}

json_t *cn_saved_list(const cn_city *city, bool is_appearance)
{
    enum { MOST = 4096 };
    char *folder = folder_of(city, is_appearance), **names = calloc(MOST, sizeof *names);
    DIR *dir = folder ? opendir(folder) : NULL;
    const char *file = NULL;
    size_t n = 0;
    while (dir && names && n < MOST && cn_folder_next(dir, folder, &file) == CN_OK && file) {
        const size_t length = strlen(file);
        char name[80];
        if (length < 6 || length - 5 >= sizeof name || strcmp(file + length - 5, ".json") != 0) continue;
        memcpy(name, file, length - 5);
        name[length - 5] = '\0';
        if (cn_ask_name_is_safe(name) && (names[n] = strdup(name)) != NULL) n++;
    }
    if (dir) closedir(dir);
    free(folder);
    return list_of(names, n);
}
