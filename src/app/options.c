#include "app.h"

#include <stdlib.h>
#include <string.h>

static cn_status take_option(const cn_app_option *o, const char *value)
{
    if (!value) return cn_fail(CN_ERR_USAGE, "%s wants a value", o->name);
    if (o->text) *o->text = value;
    if (!o->number) return CN_OK;
    char *end;
    *o->number = strtod(value, &end);
    /* "60s" is as good as "60"; so are minutes and hours. */
    if (*end == 'm')
        *o->number *= 60, end++;
    else if (*end == 'h')
        *o->number *= 3600, end++;
    else if (*end == 's')
        end++;
    return *end || end == value ? cn_fail(CN_ERR_USAGE, "%s wants a number, not '%s'", o->name, value) : CN_OK;
}

cn_status cn_app_parse(const cn_app_args *args, const char **city, const cn_app_option *options)
{
    *city = NULL;
    for (int i = 0; i < args->n; i++) {
        const char *word = args->words[i];
        const cn_app_option *o = options;
        while (o->name && strcmp(o->name, word) != 0)
            o++;
        if (o->name && o->flag) {
            *o->flag = true;
        } else if (o->name) {
            CN_TRY(take_option(o, i + 1 < args->n ? args->words[i + 1] : NULL));
            i++;
        } else if (word[0] == '-') {
            return cn_fail(CN_ERR_USAGE, "no option '%s'; see --help", word);
        } else if (*city) {
            return cn_fail(CN_ERR_USAGE, "'%s' is one word too many; see --help", word);
        } else {
            *city = word;
        }
    }
    return *city ? CN_OK : cn_fail(CN_ERR_USAGE, "name the city (its folder); see --help");
}

cn_status cn_app_parse_quality(const char *name, int *quality)
{
    static const char *const names[] = { "preview", "standard", "high", "reference" };
    *quality = -1;
    for (int i = 0; name && i < 4; i++)
        if (strcmp(names[i], name) == 0) *quality = i;
    return name && *quality < 0 ? cn_fail(CN_ERR_USAGE, "--quality %s: give preview, standard, high or reference", name)
                                : CN_OK;
}
