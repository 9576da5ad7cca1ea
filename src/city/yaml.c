#include "city/yaml.h"

#include <stdlib.h>
#include <string.h>
#include <yaml.h>

struct cn_yaml {
    yaml_document_t document;
};

/* libyaml's pointer is not const, but reading changes nothing. */
static yaml_node_t *node_at(const cn_yaml *yaml, int node)
{
    return yaml_document_get_node((yaml_document_t *)&yaml->document, node);
}

static const yaml_node_pair_t *pair_at(const cn_yaml *yaml, int node, int i)
{
    return node_at(yaml, node)->data.mapping.pairs.start + i;
}

int cn_yaml_count(const cn_yaml *yaml, int node)
{
    const yaml_node_t *n = node_at(yaml, node);
    if (!n) return node == CN_YAML_ROOT ? 0 : -1;
    if (n->type != YAML_MAPPING_NODE) return -1;
    return (int)(n->data.mapping.pairs.top - n->data.mapping.pairs.start);
}

static const char *scalar(const yaml_node_t *n)
{
    return n && n->type == YAML_SCALAR_NODE ? (const char *)n->data.scalar.value : NULL;
}

cn_yaml_entry cn_yaml_at(const cn_yaml *yaml, int node, int i)
{
    const yaml_node_pair_t *pair = pair_at(yaml, node, i);
    const yaml_node_t *key = node_at(yaml, pair->key);
    const char *name = scalar(key);
    return (cn_yaml_entry){ .key = name ? name : "",
                            .text = scalar(node_at(yaml, pair->value)),
                            .line = key ? (unsigned)key->start_mark.line + 1 : 1,
                            .node = pair->value };
}

bool cn_yaml_find(const cn_yaml *yaml, int node, const char *key, cn_yaml_entry *entry)
{
    for (int i = 0, n = cn_yaml_count(yaml, node); i < n; i++) {
        *entry = cn_yaml_at(yaml, node, i);
        if (strcmp(entry->key, key) == 0) return true;
    }
    return false;
}

static cn_status refuse_twice(const cn_yaml *yaml, const char *path, int node, const char *section)
{
    for (int i = 1, n = cn_yaml_count(yaml, node); i < n; i++) {
        const cn_yaml_entry entry = cn_yaml_at(yaml, node, i);
        for (int j = 0; j < i; j++)
            if (strcmp(cn_yaml_at(yaml, node, j).key, entry.key) == 0)
                return cn_fail(CN_ERR_CONFIG, "%s:%u: %s%s%s is given twice; remove one", path, entry.line, section,
                               *section ? "." : "", entry.key);
    }
    return CN_OK;
}

/* More keys than any real file has; limits the search for duplicate keys. */
enum { MOST_KEYS = 1000 };

static cn_status check(const cn_yaml *yaml, const char *path)
{
    const int n = cn_yaml_count(yaml, CN_YAML_ROOT);
    if (n > MOST_KEYS) return cn_fail(CN_ERR_CONFIG, "%s:1: %d keys; a city.yaml has a few dozen", path, n);
    CN_TRY(refuse_twice(yaml, path, CN_YAML_ROOT, ""));
    for (int i = 0; i < n; i++) {
        const cn_yaml_entry section = cn_yaml_at(yaml, CN_YAML_ROOT, i);
        const int below = cn_yaml_count(yaml, section.node);
        if (below > MOST_KEYS)
            return cn_fail(CN_ERR_CONFIG, "%s:%u: %d keys in %s; a section has a few dozen at most", path, section.line,
                           below, section.key);
        CN_TRY(refuse_twice(yaml, path, section.node, section.key));
    }
    return CN_OK;
}

cn_status cn_yaml_read(cn_yaml **out, const char *path, const char *text, size_t size)
{
    *out = NULL;
    cn_yaml *yaml = calloc(1, sizeof *yaml);
    yaml_parser_t parser;
    if (!yaml || !yaml_parser_initialize(&parser)) {
        free(yaml);
        return cn_fail(CN_ERR_NOMEM, "out of memory while reading %s", path);
    }
    yaml_parser_set_input_string(&parser, (const unsigned char *)text, size);
    cn_status status = CN_OK;
    if (!yaml_parser_load(&parser, &yaml->document)) {
        status = parser.error == YAML_MEMORY_ERROR
                     ? cn_fail(CN_ERR_NOMEM, "out of memory while reading %s", path)
                     : cn_fail(CN_ERR_CONFIG, "%s:%u: not YAML: %s", path, (unsigned)parser.problem_mark.line + 1,
                               parser.problem ? parser.problem : "it cannot be read");
        free(yaml);
        yaml = NULL;
    }
    yaml_parser_delete(&parser);
    if (status == CN_OK) status = check(yaml, path);
    if (status != CN_OK) cn_yaml_free(&yaml);
    *out = yaml;
    return status;
}

void cn_yaml_free(cn_yaml **yaml)
{
    if (!*yaml) return;
    yaml_document_delete(&(*yaml)->document);
    free(*yaml);
    *yaml = NULL;
}
