/* city.yaml as YAML: sections of keys and plain values, each with its line. libyaml reads it. */
#ifndef CONURB_CITY_YAML_H
#define CONURB_CITY_YAML_H
#include "conurb/base.h"

typedef struct cn_yaml cn_yaml;

/* One "key: value". text is NULL for a value that is a list or holds keys. Borrowed from the cn_yaml. */
typedef struct cn_yaml_entry {
    const char *key, *text;
    unsigned line; /* of the key, from 1 */
    int node;      /* of the value, for cn_yaml_count */
} cn_yaml_entry;

/* Parses a file. An empty file is an empty mapping. The caller frees it. CN_ERR_CONFIG "PATH:LINE: ...": it is not
 * YAML, or a mapping has a key twice. */
CN_NODISCARD cn_status cn_yaml_read(cn_yaml **yaml, const char *path, const char *text, size_t size);
void cn_yaml_free(cn_yaml **yaml);
enum { CN_YAML_ROOT = 1 };
/* Number of entries of a mapping node; -1 when the node is not a mapping. */
int cn_yaml_count(const cn_yaml *yaml, int node);
cn_yaml_entry cn_yaml_at(const cn_yaml *yaml, int node, int i);
/* False when there is no such key. */
bool cn_yaml_find(const cn_yaml *yaml, int node, const char *key, cn_yaml_entry *entry);
#endif
