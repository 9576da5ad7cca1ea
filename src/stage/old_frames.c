#include "stage/old_frames.h"

#include "base/file.h"
#include "stage/aov_files.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

bool cn_is_render_mark(const char *path)
{
    enum { DIGITS = 16 };
    char *text = NULL;
    size_t size;
    const bool mark = cn_file_exists(path) && cn_file_read(path, 64, &text, &size) == CN_OK && size == DIGITS + 1 &&
                      strspn(text, "0123456789abcdef") == DIGITS && text[DIGITS] == '\n';
    free(text);
    return mark;
}

/* The next old frame: its folder and number, "renders/flight/00007"; the caller frees it. NULL at the end. */
static cn_status next_frame(DIR *dir, const char *folder, uint32_t n, char **stem)
{
    const char *name;
    cn_status status;
    *stem = NULL;
    while ((status = cn_folder_next(dir, folder, &name)) == CN_OK && name) {
        const size_t digits = strspn(name, "0123456789");
        if (digits < 5 || digits > 9 || strcmp(name + digits, ".json") != 0) continue;
        const unsigned long number = strtoul(name, NULL, 10);
        if (number < n) continue;
        char *mark = cn_format("%s/%05lu.json", folder, number);
        const bool old = mark && cn_is_render_mark(mark) && strcmp(cn_path_base(mark), name) == 0;
        free(mark);
        if (!old) continue;
        *stem = cn_format("%s/%05lu", folder, number);
        return *stem ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    }
    return status;
}

bool cn_old_frames_exist(const char *folder, uint32_t n)
{
    DIR *dir = opendir(folder);
    char *stem = NULL;
    const bool there = dir && next_frame(dir, folder, n, &stem) == CN_OK && stem;
    if (dir) closedir(dir);
    free(stem);
    return there;
}

static cn_status remove_file(char *path)
{
    const cn_status status = path ? cn_file_remove(path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(path);
    return status;
}

static cn_status remove_frame(const char *stem)
{
    char *png = cn_format("%s.png", stem);
    cn_status status = png ? remove_file(cn_format("%s.exr", stem)) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_aov_pngs_remove(png);
    if (status == CN_OK) status = cn_file_remove(png);
    if (status == CN_OK) status = remove_file(cn_format("%s.json", stem));
    free(png);
    return status;
}

cn_status cn_old_frames_remove(const char *folder, uint32_t n)
{
    DIR *dir = opendir(folder);
    if (!dir) return cn_fail(CN_ERR_IO, "cannot read the folder %s: %s", folder, strerror(errno));
    char *stem;
    cn_status status;
    while ((status = next_frame(dir, folder, n, &stem)) == CN_OK && stem) {
        status = remove_frame(stem);
        free(stem);
        if (status != CN_OK) break;
    }
    closedir(dir);
    return status;
}
