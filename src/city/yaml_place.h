/* Where things stand in city.yaml. libcyaml names the last value that it read; a person wants the line of the key at
 * fault. */
#ifndef CONURB_CITY_YAML_PLACE_H
#define CONURB_CITY_YAML_PLACE_H
#include "conurb/base.h"

typedef struct cn_yaml_place {
    unsigned line;  /* from 1 */
    bool scalar;    /* the value is a plain value, not a mapping or a list */
    char value[64]; /* its text, cut */
} cn_yaml_place;

/* The last `key` of the top-level mapping `section` (NULL: a top-level key itself). False when it is not there. */
bool cn_yaml_find(const char *text, size_t size, const char *section, const char *key, cn_yaml_place *place);
/* False for what is not YAML; then line and problem (size bytes) say where and why. */
bool cn_yaml_check(const char *text, size_t size, unsigned *line, char *problem, size_t problem_size);
#endif
