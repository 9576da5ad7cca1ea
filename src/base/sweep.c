#include "base/file.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

/* ".STEM.tmp-DIGITS" with or without an extension: the names that cn_file_temporary makes. */
static bool is_temporary(const char *name, const char *stem)
{
    const char *mark = name[0] == '.' ? strstr(name, ".tmp-") : NULL;
    if (!mark || (stem && (strlen(stem) != (size_t)(mark - name - 1) || strncmp(stem, name + 1, strlen(stem)) != 0)))
        return false;
    const char *after = mark + 5 + strspn(mark + 5, "0123456789");
    return after > mark + 5 && (*after == '\0' || *after == '.');
}

cn_status cn_folder_sweep(const char *folder, const char *stem, double age_s)
{
    DIR *dir = opendir(folder);
    if (!dir)
        return errno == ENOENT ? CN_OK : cn_fail(CN_ERR_IO, "cannot read the folder %s: %s", folder, strerror(errno));
    const double now = (double)time(NULL);
    const char *name;
    cn_status status;
    while ((status = cn_folder_next(dir, folder, &name)) == CN_OK && name) {
        struct stat info;
        if (!is_temporary(name, stem) || fstatat(dirfd(dir), name, &info, AT_SYMLINK_NOFOLLOW) != 0) continue;
        /* A file that cannot be removed only takes space. */
        if (S_ISREG(info.st_mode) && now - (double)info.st_mtime >= age_s) (void)unlinkat(dirfd(dir), name, 0);
    }
    closedir(dir);
    return status;
}
