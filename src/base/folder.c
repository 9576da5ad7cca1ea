/* Makes and removes folders and files durably. */
#include "base/file.h"

#include <errno.h>
#include <ftw.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static cn_status make_one(const char *path)
{
    struct stat status;
    if (stat(path, &status) == 0)
        return S_ISDIR(status.st_mode) ? CN_OK
                                       : cn_fail(CN_ERR_IO,
                                                 "cannot make the folder %s: a file of that name is there; "
                                                 "move it or choose another folder",
                                                 path);
    /* Sync the parent too: a folder whose name is lost in a power failure loses its files. */
    if (mkdir(path, 0777) == 0) return cn_file_sync_folder(path);
    /* Another process may have made it in between. */
    int error = errno;
    if (error == EEXIST && stat(path, &status) == 0 && S_ISDIR(status.st_mode)) return CN_OK;
    return cn_fail(CN_ERR_IO, "cannot make the folder %s: %s", path, strerror(error));
}

cn_status cn_folder_make(const char *path)
{
    char *prefix = strdup(path);
    if (!prefix) return cn_fail(CN_ERR_NOMEM, "out of memory");
    cn_status status = CN_OK;
    for (char *p = prefix; *p && status == CN_OK; p++) {
        if (*p != '/' || p == prefix) continue;
        *p = '\0';
        status = make_one(prefix);
        *p = '/';
    }
    if (status == CN_OK) status = make_one(prefix);
    free(prefix);
    return status;
}

cn_status cn_folder_of_make(const char *path)
{
    const char *base = cn_path_base(path);
    if (base == path) return CN_OK;
    char *folder = strndup(path, (size_t)(base - path));
    if (!folder) return cn_fail(CN_ERR_NOMEM, "out of memory");
    const cn_status status = cn_folder_make(folder);
    free(folder);
    return status;
}

cn_status cn_folder_next(DIR *dir, const char *path, const char **name)
{
    const struct dirent *entry;
    do {
        errno = 0; /* only errno tells readdir's NULL at the end from an error */
        entry = readdir(dir);
    } while (entry && (strcmp(entry->d_name, ".") == 0 || strcmp(entry->d_name, "..") == 0));
    *name = entry ? entry->d_name : NULL;
    if (entry || errno == 0) return CN_OK;
    return cn_fail(CN_ERR_IO, "cannot read the whole folder %s: %s; check the disk or the network", path,
                   strerror(errno));
}

cn_status cn_file_remove(const char *path)
{
    if (unlink(path) == 0) return cn_file_sync_folder(path);
    if (errno == ENOENT) return CN_OK;
    return cn_fail(CN_ERR_IO, "cannot remove %s: %s", path, strerror(errno));
}

static int remove_entry(const char *path, const struct stat *info, int kind, struct FTW *walk)
{
    (void)info;
    (void)kind;
    (void)walk;
    return remove(path);
}

cn_status cn_folder_remove(const char *path)
{
    if (nftw(path, remove_entry, 16, FTW_DEPTH | FTW_PHYS) == 0 || errno == ENOENT) return CN_OK;
    return cn_fail(CN_ERR_IO, "cannot remove the folder %s: %s; remove it yourself and run the same command again",
                   path, strerror(errno));
}
