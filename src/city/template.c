#include "city/config.h"
#include "city/keys.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { COMMENT_COLUMN = 29 };

/* A YAML string in double quotes, because a folder's name may have quotes and backslashes. */
static char *quote(const char *text)
{
    char *out = malloc(4 * strlen(text) + 3), *p = out;
    if (!out) return NULL;
    *p++ = '"';
    for (; *text; text++) {
        if (*text == '"' || *text == '\\') *p++ = '\\';
        if ((unsigned char)*text >= ' ' && *text != 0x7f)
            *p++ = *text;
        else
            p += sprintf(p, "\\x%02x", (unsigned char)*text);
    }
    memcpy(p, "\"", 2);
    return out;
}

/* One line of the file: "  # key: value   # comment"; not commented out where the city needs its own value. */
static void write_key(FILE *out, const cn_key *key, const char *value, bool own)
{
    const int n = fprintf(out, "  %s%s: %s", own ? "" : "# ", key->name, value);
    char comment[160];
    cn_key_comment(key, comment, sizeof comment);
    if (*comment) fprintf(out, "%*s# %s", n < COMMENT_COLUMN ? COMMENT_COLUMN - n : 1, "", comment);
    fputc('\n', out);
}

static bool is(const cn_key *key, const char *section, const char *name)
{
    return strcmp(key->section, section) == 0 && strcmp(key->name, name) == 0;
}

static void write_section(FILE *out, const cn_key_section *section, const char *folder, const char *import,
                          uint32_t width_px)
{
    const cn_config defaults = cn_config_default();
    char value[64];
    cn_key key;
    fprintf(out, "\n%s:", section->name);
    if (section->comment)
        fprintf(out, "%*s# %s", COMMENT_COLUMN - 1 - (int)strlen(section->name), "", section->comment);
    fputc('\n', out);
    for (uint32_t i = 0; cn_key_at(i, &key); i++) {
        if (strcmp(key.section, section->name) != 0) continue;
        cn_key_print(&key, &defaults, value, sizeof value);
        /* A setting that the default type of field does not have. */
        if (key.kind == CN_KEY_FIELD && !*value) continue;
        if (is(&key, "photos", "folder")) {
            write_key(out, &key, folder, true);
        } else if (is(&key, "photos", "width_px")) {
            snprintf(value, sizeof value, "%u", width_px);
            write_key(out, &key, value, true);
        } else if (is(&key, "poses", "import") && import) {
            key.comment = NULL;
            write_key(out, &key, import, true);
        } else {
            write_key(out, &key, *value ? value : key.sample ? key.sample : "", false);
        }
    }
}

static char *fill(const char *folder, const char *import, uint32_t width_px)
{
    char *text = NULL;
    size_t size;
    FILE *out = open_memstream(&text, &size);
    if (!out) return NULL;
    fputs("# A city of Conurb. Commented keys show their defaults. Where they show DIR, MODEL, TILES or another file\n"
          "# or point, nothing is set. Relative paths start at this folder.\n"
          "version: 1\n",
          out);
    for (uint32_t i = 0; i < cn_key_n_sections; i++)
        write_section(out, &cn_key_sections[i], folder, import, width_px);
    if (fclose(out) == 0) return text;
    free(text);
    return NULL;
}

char *cn_config_template(const char *photos, const char *import, uint32_t width_px)
{
    char *folder = quote(photos), *model = import ? quote(import) : NULL;
    char *text = folder && (model || !import) ? fill(folder, model, width_px) : NULL;
    free(folder);
    free(model);
    return text;
}
