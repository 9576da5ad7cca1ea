#include "base/file.h"
#include "base/number.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

char *cn_format(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    char *text = NULL;
    const locale_t before = cn_number_begin();
    int length = vasprintf(&text, format, arguments);
    cn_number_end(before);
    va_end(arguments);
    return length < 0 ? NULL : text;
}

char *cn_path_join(const char *folder, const char *name)
{
    size_t length = strlen(folder);
    if (length == 0 || name[0] == '/') return strdup(name);
    return cn_format(folder[length - 1] == '/' ? "%s%s" : "%s/%s", folder, name);
}

const char *cn_path_base(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

cn_status cn_path_absolute(const char *path, char **absolute)
{
    *absolute = realpath(path, NULL);
    if (*absolute) return CN_OK;
    if (errno == ENOMEM) return cn_fail(CN_ERR_NOMEM, "out of memory");
    return cn_fail(CN_ERR_IO, "cannot find %s: %s", path, strerror(errno));
}

char *cn_file_temporary(const char *path)
{
    const char *base = cn_path_base(path);
    const char *dot = strrchr(base, '.');
    if (!dot || dot == base) dot = base + strlen(base);
    return cn_format("%.*s.%.*s.tmp-%ld%s", (int)(base - path), path, (int)(dot - base), base, (long)getpid(), dot);
}

bool cn_file_exists(const char *path)
{
    struct stat status;
    return stat(path, &status) == 0;
}
