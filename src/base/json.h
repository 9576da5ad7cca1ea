/* JSON by jansson, with errors that name the file and the key. */
#ifndef CONURB_BASE_JSON_H
#define CONURB_BASE_JSON_H
#include "conurb/base.h"
#include <jansson.h>

CN_NODISCARD cn_status cn_json_load(const char *path, json_t **root);      /* CN_ERR_FORMAT with line on bad JSON */
CN_NODISCARD cn_status cn_json_save(const json_t *root, const char *path); /* atomic; keys sorted, 17 digits */
/* Typed members. `where` names the file (and place) for the message. Absent or of another type: CN_ERR_FORMAT, and
 * *value is not to be used. An integer may be a whole real (1080.0). Strings and arrays are borrowed from object. */
CN_NODISCARD cn_status cn_json_number(const json_t *object, const char *where, const char *key, double *value);
CN_NODISCARD cn_status cn_json_integer(const json_t *object, const char *where, const char *key, int64_t *value);
CN_NODISCARD cn_status cn_json_bool(const json_t *object, const char *where, const char *key, bool *value);
CN_NODISCARD cn_status cn_json_string(const json_t *object, const char *where, const char *key, const char **value);
CN_NODISCARD cn_status cn_json_numbers(const json_t *object, const char *where, const char *key, double *values,
                                       size_t n);
CN_NODISCARD cn_status cn_json_array(const json_t *object, const char *where, const char *key, const json_t **array);
/* As cn_json_number, but absent or null gives fallback. */
CN_NODISCARD cn_status cn_json_number_or(const json_t *object, const char *where, const char *key, double fallback,
                                         double *value);
/* A real, or null for NaN and infinities (JSON has none). */
json_t *cn_json_real(double value);
json_t *cn_json_reals(const double *values, size_t n);
/* Replaces bytes that are not UTF-8 by '?', in place, because JSON must be UTF-8. True when there were none. */
bool cn_json_make_utf8(char *text);
#endif
