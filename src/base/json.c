#include "base/json.h"

#include "base/file.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

cn_status cn_json_load(const char *path, json_t **root)
{
    char *text;
    size_t size;
    *root = NULL;
    CN_TRY(cn_file_read(path, 0, &text, &size));
    /* Some editors put a byte-order mark first; JSON has none. */
    size_t skip = size >= 3 && memcmp(text, "\xef\xbb\xbf", 3) == 0 ? 3 : 0;
    json_error_t error;
    *root = json_loadb(text + skip, size - skip, 0, &error);
    free(text);
    if (!*root) return cn_fail(CN_ERR_FORMAT, "%s, line %d: not valid JSON: %s", path, error.line, error.text);
    return CN_OK;
}

cn_status cn_json_save(const json_t *root, const char *path)
{
    char *text = json_dumps(root, JSON_INDENT(2) | JSON_SORT_KEYS | JSON_REAL_PRECISION(17) | JSON_ENCODE_ANY);
    if (!text) return cn_fail(CN_ERR_NOMEM, "out of memory writing %s", path);
    size_t length = strlen(text);
    text[length] = '\n'; /* the terminator's byte becomes the final newline */
    cn_status status = cn_file_write(path, text, length + 1);
    free(text);
    return status;
}

static const char *type_name(const json_t *value)
{
    switch (json_typeof(value)) {
    case JSON_OBJECT: return "an object";
    case JSON_ARRAY: return "an array";
    case JSON_STRING: return "a string";
    case JSON_INTEGER:
    case JSON_REAL: return "a number";
    case JSON_TRUE:
    case JSON_FALSE: return "a boolean";
    case JSON_NULL: return "null";
    }
    return "unknown";
}

static cn_status member(const json_t *object, const char *where, const char *key, const json_t **value)
{
    *value = json_object_get(object, key);
    if (!json_is_object(object)) return cn_fail(CN_ERR_FORMAT, "%s: expected an object with \"%s\"", where, key);
    if (!*value) return cn_fail(CN_ERR_FORMAT, "%s: \"%s\" is missing", where, key);
    return CN_OK;
}

static cn_status wrong_type(const char *where, const char *key, const char *wanted, const json_t *value)
{
    return cn_fail(CN_ERR_FORMAT, "%s: \"%s\" must be %s, but is %s", where, key, wanted, type_name(value));
}

cn_status cn_json_number(const json_t *object, const char *where, const char *key, double *value)
{
    const json_t *found;
    CN_TRY(member(object, where, key, &found));
    if (!json_is_number(found)) return wrong_type(where, key, "a number", found);
    *value = json_number_value(found);
    return CN_OK;
}

cn_status cn_json_number_or(const json_t *object, const char *where, const char *key, double fallback, double *value)
{
    const json_t *found = json_object_get(object, key);
    if (json_is_object(object) && (!found || json_is_null(found))) {
        *value = fallback;
        return CN_OK;
    }
    return cn_json_number(object, where, key, value);
}

cn_status cn_json_integer(const json_t *object, const char *where, const char *key, int64_t *value)
{
    const json_t *found;
    CN_TRY(member(object, where, key, &found));
    if (json_is_integer(found)) {
        *value = json_integer_value(found);
        return CN_OK;
    }
    /* Many writers have no integers: accept 1080.0. Above 2^53 a double is not exact. */
    double real = json_is_real(found) ? json_real_value(found) : NAN;
    if (!(fabs(real) <= 0x1p53) || real != floor(real))
        return json_is_real(found)
                   ? cn_fail(CN_ERR_FORMAT, "%s: \"%s\" must be a whole number, but is %g", where, key, real)
                   : wrong_type(where, key, "a whole number", found);
    *value = (int64_t)real;
    return CN_OK;
}

cn_status cn_json_bool(const json_t *object, const char *where, const char *key, bool *value)
{
    const json_t *found;
    CN_TRY(member(object, where, key, &found));
    if (!json_is_boolean(found)) return wrong_type(where, key, "true or false", found);
    *value = json_is_true(found);
    return CN_OK;
}

cn_status cn_json_string(const json_t *object, const char *where, const char *key, const char **value)
{
    const json_t *found;
    *value = NULL;
    CN_TRY(member(object, where, key, &found));
    if (!json_is_string(found)) return wrong_type(where, key, "a string", found);
    *value = json_string_value(found);
    return CN_OK;
}

cn_status cn_json_array(const json_t *object, const char *where, const char *key, const json_t **array)
{
    const json_t *found;
    *array = NULL;
    CN_TRY(member(object, where, key, &found));
    if (!json_is_array(found)) return wrong_type(where, key, "an array", found);
    *array = found;
    return CN_OK;
}

cn_status cn_json_numbers(const json_t *object, const char *where, const char *key, double *values, size_t n)
{
    const json_t *array;
    CN_TRY(cn_json_array(object, where, key, &array));
    if (json_array_size(array) != n)
        return cn_fail(CN_ERR_FORMAT, "%s: \"%s\" must hold %zu numbers, but holds %zu", where, key, n,
                       json_array_size(array));
    for (size_t i = 0; i < n; i++) {
        const json_t *item = json_array_get(array, i);
        if (!json_is_number(item))
            return cn_fail(CN_ERR_FORMAT, "%s: \"%s\" must hold numbers, but item %zu is %s", where, key, i,
                           type_name(item));
        values[i] = json_number_value(item);
    }
    return CN_OK;
}

json_t *cn_json_real(double value)
{
    return isfinite(value) ? json_real(value) : json_null();
}

json_t *cn_json_reals(const double *values, size_t n)
{
    json_t *array = json_array();
    for (size_t i = 0; array && i < n; i++) {
        if (json_array_append_new(array, cn_json_real(values[i])) != 0) {
            json_decref(array);
            return NULL;
        }
    }
    return array;
}

bool cn_json_make_utf8(char *text)
{
    bool good = true;
    for (unsigned char *p = (unsigned char *)text; *p;) {
        const int more = *p < 0x80 ? 0 : *p < 0xc2 ? -1 : *p < 0xe0 ? 1 : *p < 0xf0 ? 2 : *p < 0xf5 ? 3 : -1;
        int n = 0;
        while (n < more && (p[n + 1] & 0xc0) == 0x80)
            n++;
        const bool overlong = (*p == 0xe0 && p[1] < 0xa0) || (*p == 0xf0 && p[1] < 0x90);
        const bool outside = (*p == 0xed && p[1] >= 0xa0) || (*p == 0xf4 && p[1] >= 0x90);
        const bool whole = n == more && !overlong && !outside;
        if (!whole) *p = '?';
        good = good && whole;
        p += whole ? n + 1 : 1;
    }
    return good;
}
