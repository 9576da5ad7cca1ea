#include "city/yaml_place.h"

#include <stdio.h>
#include <string.h>
#include <yaml.h>

/* Follows the events down to the second level of mappings. */
typedef struct walk {
    const char *section, *key;
    int depth;           /* of mappings and lists */
    bool expects_key[3]; /* at depth 1 and 2: the next scalar is a key */
    bool in_section;     /* the mapping at depth 2 belongs to `section` */
    bool wanted;         /* the next value is the one looked for */
    bool found;
    cn_yaml_place place;
} walk;

static void take_key(walk *w, const yaml_event_t *e)
{
    const char *name = (const char *)e->data.scalar.value;
    if (w->depth == 1) w->in_section = w->section && strcmp(name, w->section) == 0;
    const bool level = w->section ? w->depth == 2 && w->in_section : w->depth == 1;
    w->wanted = level && strcmp(name, w->key) == 0;
    if (w->wanted) {
        w->found = true;
        w->place = (cn_yaml_place){ .line = (unsigned)e->start_mark.line + 1 };
    }
}

static void take_value(walk *w, const yaml_event_t *e)
{
    if (!w->wanted) return;
    w->wanted = false;
    w->place.scalar = e->type == YAML_SCALAR_EVENT;
    if (w->place.scalar) snprintf(w->place.value, sizeof w->place.value, "%s", (const char *)e->data.scalar.value);
}

static void take_event(walk *w, const yaml_event_t *e)
{
    const bool opens = e->type == YAML_MAPPING_START_EVENT || e->type == YAML_SEQUENCE_START_EVENT;
    const bool closes = e->type == YAML_MAPPING_END_EVENT || e->type == YAML_SEQUENCE_END_EVENT;
    const bool value = opens || e->type == YAML_SCALAR_EVENT || e->type == YAML_ALIAS_EVENT;
    if (closes) w->depth--;
    if (value && w->depth >= 1 && w->depth <= 2) {
        const bool key = w->expects_key[w->depth] && e->type == YAML_SCALAR_EVENT;
        if (key)
            take_key(w, e);
        else
            take_value(w, e);
        w->expects_key[w->depth] = !key;
    }
    if (opens) w->depth++;
    if (opens && w->depth <= 2) w->expects_key[w->depth] = e->type == YAML_MAPPING_START_EVENT;
}

bool cn_yaml_find(const char *text, size_t size, const char *section, const char *key, cn_yaml_place *place)
{
    walk w = { .section = section, .key = key };
    yaml_parser_t parser;
    if (!yaml_parser_initialize(&parser)) return false;
    yaml_parser_set_input_string(&parser, (const unsigned char *)text, size);
    yaml_event_t event;
    for (bool more = true; more && yaml_parser_parse(&parser, &event);) {
        more = event.type != YAML_STREAM_END_EVENT;
        take_event(&w, &event);
        yaml_event_delete(&event);
    }
    yaml_parser_delete(&parser);
    if (w.found) *place = w.place;
    return w.found;
}

bool cn_yaml_check(const char *text, size_t size, unsigned *line, char *problem, size_t problem_size)
{
    yaml_parser_t parser;
    if (!yaml_parser_initialize(&parser)) return true;
    yaml_parser_set_input_string(&parser, (const unsigned char *)text, size);
    yaml_event_t event;
    bool good = true;
    for (bool more = true; more && good;) {
        good = yaml_parser_parse(&parser, &event);
        more = good && event.type != YAML_STREAM_END_EVENT;
        if (good) yaml_event_delete(&event);
    }
    if (!good) {
        *line = (unsigned)parser.problem_mark.line + 1;
        snprintf(problem, problem_size, "%s", parser.problem ? parser.problem : "it cannot be read");
    }
    yaml_parser_delete(&parser);
    return good;
}
