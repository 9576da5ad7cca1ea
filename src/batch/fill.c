#include "batch/submit.h"

#include "base/file.h"

#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char *value_of(const cn_blank *blanks, const char *name, size_t n)
{
    for (; blanks->name; blanks++)
        if (strlen(blanks->name) == n && strncmp(blanks->name, name, n) == 0) return blanks->value;
    return NULL;
}

static cn_status fill(const char *where, const char *text, const cn_blank *blanks, FILE *out)
{
    for (const char *p = text; *p;) {
        const char *open = strstr(p, "{{"), *close = open ? strstr(open, "}}") : NULL;
        if (!close) {
            fputs(p, out);
            break;
        }
        const char *value = value_of(blanks, open + 2, (size_t)(close - open - 2));
        if (!value)
            return cn_fail(CN_ERR_CONFIG,
                           "%s: the placeholder {{%.*s}} is unknown; jobs/README.md lists those that can be used",
                           where, (int)(close - open - 2), open + 2);
        fwrite(p, 1, (size_t)(open - p), out);
        fputs(value, out);
        p = close + 2;
    }
    return CN_OK;
}

cn_status cn_template_fill(const char *folder, const char *file, const char *embedded, const cn_blank *blanks,
                           char **out)
{
    char *path = folder ? cn_path_join(folder, file) : NULL, *text = NULL;
    size_t size;
    *out = NULL;
    if (folder && !path) return cn_fail(CN_ERR_NOMEM, "out of memory");
    cn_status status = path ? cn_file_read(path, 1 << 20, &text, &size) : CN_OK;
    FILE *stream = status == CN_OK ? open_memstream(out, &size) : NULL;
    if (status == CN_OK && !stream) status = cn_fail(CN_ERR_NOMEM, "out of memory for %s", file);
    if (status == CN_OK) status = fill(path ? path : file, text ? text : embedded, blanks, stream);
    if (stream && fclose(stream) != 0 && status == CN_OK) status = cn_fail(CN_ERR_NOMEM, "out of memory for %s", file);
    if (status != CN_OK) {
        free(*out);
        *out = NULL;
    }
    free(text);
    free(path);
    return status;
}

char *cn_shell_word(const char *text)
{
    char *word = malloc(4 * strlen(text) + 3), *p = word;
    if (!word) return NULL;
    *p++ = '\'';
    for (; *text; text++) {
        if (*text == '\'')
            p = stpcpy(p, "'\\''");
        else
            *p++ = *text;
    }
    strcpy(p, "'");
    return word;
}

char *cn_sbatch_word(const char *text, bool file)
{
    char *word = malloc(2 * strlen(text) + 1), *p = word;
    if (!word) return NULL;
    for (; *text; text++) {
        const unsigned char c = (unsigned char)*text;
        if (file && c == '%')
            *p++ = '%'; /* a single % begins a file name pattern of Slurm */
        else if (!isalnum(c) && c < 0x80 && !strchr("/._-+=:,@", c))
            *p++ = '\\';
        *p++ = *text;
    }
    *p = '\0';
    return word;
}

char *cn_yaml_string(const char *text)
{
    char *string = malloc(4 * strlen(text) + 3), *p = string;
    if (!string) return NULL;
    *p++ = '"';
    for (; *text; text++) {
        if (*text == '"' || *text == '\\') *p++ = '\\';
        if ((unsigned char)*text >= ' ' && *text != 0x7f)
            *p++ = *text;
        else
            p += sprintf(p, "\\x%02x", (unsigned char)*text);
    }
    strcpy(p, "\"");
    return string;
}

char *cn_submit_device_option(const cn_submit_options *o)
{
    char *word = o->device ? cn_shell_word(o->device) : NULL;
    char *option = o->device && !word ? NULL : cn_format("%s%s", word ? " --device " : "", word ? word : "");
    free(word);
    return option;
}
