#include "record/record.h"

#include "base/file.h"
#include "base/hash.h"
#include "base/json.h"
#include "base/number.h"
#include "city/keys.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { RECORD_FORMAT = 2, LONGEST_VALUE = 96 };

/* A long value is written as its beginning and its hash: the line stays short, and every change shows. */
static void shorten(char *value)
{
    const size_t n = strlen(value);
    char hex[17];
    cn_hash_hex(cn_hash64(value, n), hex);
    if (n > LONGEST_VALUE) snprintf(value + LONGEST_VALUE - 20, 21, "... %s", hex);
}

void cn_fingerprint_add(cn_fingerprint *fingerprint, const char *name, const char *format, ...)
{
    char *value = NULL;
    va_list args;
    va_start(args, format);
    const locale_t before = cn_number_begin();
    const int n = vasprintf(&value, format, args);
    cn_number_end(before);
    va_end(args);
    /* Without memory, the fingerprint matches no record, so the stage is run again. */
    if (n < 0) {
        fingerprint->hash = ~cn_hash_text(fingerprint->hash, "%s", name);
        return;
    }
    fingerprint->hash = cn_hash_text(fingerprint->hash, "%s=%s", name, value);
    shorten(value);
    for (char *p = value; *p; p++)
        if (*p == '\n') *p = ' ';
    const size_t room = sizeof fingerprint->text - fingerprint->n;
    const int written = snprintf(fingerprint->text + fingerprint->n, room, "%s=%s\n", name, value);
    if (written > 0 && (size_t)written < room)
        fingerprint->n += (size_t)written;
    else
        fingerprint->text[fingerprint->n] = '\0';
    free(value);
}

uint64_t cn_stage_hash(const cn_stage *stage)
{
    return cn_hash_text(stage->config.hash, "%016" PRIx64, stage->parent.hash);
}

static json_t *fingerprint_json(const cn_fingerprint *fingerprint)
{
    json_t *root = json_object();
    for (const char *line = fingerprint->text; *line; line += strcspn(line, "\n") + 1) {
        const size_t name = strcspn(line, "="), end = strcspn(line, "\n");
        char key[64];
        snprintf(key, sizeof key, "%.*s", (int)name, line);
        json_object_set_new(root, key, json_stringn_nocheck(line + name + 1, end - name - 1));
    }
    return root;
}

/* A value that the record has and the fingerprint has not: some are added only where they are not the default. */
static bool lacks(const cn_fingerprint *fingerprint, const json_t *recorded, char *reason)
{
    json_t *now = fingerprint_json(fingerprint);
    const char *key;
    const json_t *value;
    bool found = false;
    json_object_foreach((json_t *)recorded, key, value)
    {
        if (found || json_object_get(now, key)) continue;
        snprintf(reason, CN_REASON_SIZE, "%s changed", key);
        found = true;
    }
    json_decref(now);
    return found;
}

/* A recorded value as city.yaml has it: records keep choices and switches as numbers. */
static void print_value(const char *name, const char *value, size_t length, char out[LONGEST_VALUE + 1])
{
    char section[64], *end;
    cn_key key;
    snprintf(out, LONGEST_VALUE + 1, "%.*s", (int)length, *value ? value : "");
    snprintf(section, sizeof section, "%s", name);
    char *dot = strchr(section, '.');
    if (!dot || !*out) return;
    *dot = 0;
    const long number = strtol(out, &end, 10);
    if (*end || !cn_key_find(section, dot + 1, &key)) return;
    if (key.kind == CN_KEY_SWITCH) snprintf(out, LONGEST_VALUE + 1, "%s", number ? "on" : "off");
    for (const cn_key_choice *c = key.kind == CN_KEY_CHOICE ? key.choices : NULL; c && c->name; c++)
        if (c->value == number) snprintf(out, LONGEST_VALUE + 1, "%s", c->name);
}

/* The first value that differs from the record: "train.steps is 60, was 40". For hashes it says only that they differ.
 */
static bool differs(const cn_fingerprint *fingerprint, const json_t *recorded, bool values, char *reason)
{
    for (const char *line = fingerprint->text; *line; line += strcspn(line, "\n") + 1) {
        const int name = (int)strcspn(line, "="), value = (int)strcspn(line, "\n") - name - 1;
        char key[64];
        snprintf(key, sizeof key, "%.*s", name, line);
        const char *was = json_string_value(json_object_get(recorded, key));
        char is[LONGEST_VALUE + 1], before[LONGEST_VALUE + 1];
        if (was && strlen(was) == (size_t)value && strncmp(was, line + name + 1, (size_t)value) == 0) continue;
        print_value(key, line + name + 1, (size_t)value, is);
        print_value(key, was ? was : "", was ? strlen(was) : 0, before);
        if (values && was)
            snprintf(reason, CN_REASON_SIZE, "%s is %.60s, was %.60s", key, is, *before ? before : "empty");
        else
            snprintf(reason, CN_REASON_SIZE, "%s changed", key);
        return true;
    }
    return lacks(fingerprint, recorded, reason);
}

static bool same_hash(const json_t *record, const char *key, uint64_t hash)
{
    char hex[17];
    cn_hash_hex(hash, hex);
    const char *was = json_string_value(json_object_get(record, key));
    return was && strcmp(was, hex) == 0;
}

static bool fingerprint_holds(const cn_stage *stage, const json_t *record, char *reason)
{
    const bool config = same_hash(record, "config", stage->config.hash),
               parent = same_hash(record, "parent", stage->parent.hash);
    if (config && parent) return true;
    if (!config && differs(&stage->config, json_object_get(record, "settings"), true, reason)) return false;
    if (!parent && differs(&stage->parent, json_object_get(record, "parents"), false, reason)) return false;
    snprintf(reason, CN_REASON_SIZE, "%s changed", config ? "what it is made from" : "its settings");
    return false;
}

static bool made_hold(const cn_city *city, const cn_stage *stage, const json_t *record, char *reason)
{
    for (int i = 0; i < CN_STAGE_MADE && stage->made[i]; i++) {
        char *path = cn_city_path(city, stage->made[i]);
        uint64_t hash = 0;
        const bool there = path && cn_file_exists(path);
        /* A stamped artefact is identified by its stamp, so large files need not be read. */
        const bool same =
            there && (stage->stamp[0] || (cn_hash_file(path, &hash) == CN_OK &&
                                          same_hash(json_object_get(record, "made"), stage->made[i], hash)));
        free(path);
        if (same) continue;
        snprintf(reason, CN_REASON_SIZE, "%s %s", stage->made[i], there ? "is not what was made" : "is missing");
        return false;
    }
    return true;
}

/* -1: there is no readable record. */
static int stamp_holds(const cn_city *city, const cn_stage *stage)
{
    char *path = cn_city_path(city, stage->stamp), *text = NULL, hex[17];
    size_t size;
    cn_hash_hex(cn_stage_hash(stage), hex);
    const bool read = path && cn_file_exists(path) && cn_file_read(path, 1 << 16, &text, &size) == CN_OK;
    const int holds = !read ? -1 : strstr(text, hex) != NULL;
    free(text);
    free(path);
    return holds;
}

bool cn_stage_done(const cn_city *city, const cn_stage *stage, char reason[CN_REASON_SIZE])
{
    char unwanted[CN_REASON_SIZE];
    if (!reason) reason = unwanted;
    char *path = cn_city_path(city, stage->record);
    json_t *record = NULL;
    const bool recorded = path && cn_file_exists(path) && cn_json_load(path, &record) == CN_OK;
    const int stamp = stage->stamp[0] ? stamp_holds(city, stage) : recorded;
    bool done = false;
    if (stamp == 1 && stage->stamp[0])
        done = made_hold(city, stage, record, reason);
    else if (!recorded || stamp < 0)
        snprintf(reason, CN_REASON_SIZE, "not made yet");
    else if (fingerprint_holds(stage, record, reason)) {
        done = made_hold(city, stage, record, reason);
        /* The record matches but the stamp does not: artefacts were replaced after the record was written. */
        if (stage->stamp[0]) done = false, snprintf(reason, CN_REASON_SIZE, "%s is of other settings", stage->stamp);
    }
    json_decref(record);
    free(path);
    return done;
}

bool cn_stage_recorded(const cn_city *city, const cn_stage *stage)
{
    char *path = cn_city_path(city, stage->record);
    json_t *record = NULL;
    const bool there = path && cn_file_exists(path) && cn_json_load(path, &record) == CN_OK &&
                       same_hash(record, "config", stage->config.hash) &&
                       same_hash(record, "parent", stage->parent.hash);
    json_decref(record);
    free(path);
    return there;
}

static json_t *made_json(const cn_city *city, const cn_stage *stage)
{
    json_t *made = json_object();
    for (int i = 0; i < CN_STAGE_MADE && stage->made[i] && !stage->stamp[0]; i++) {
        char *path = cn_city_path(city, stage->made[i]), hex[17];
        uint64_t hash = 0;
        if (path && cn_hash_file(path, &hash) == CN_OK) {
            cn_hash_hex(hash, hex);
            json_object_set_new(made, stage->made[i], json_string(hex));
        }
        free(path);
    }
    return made;
}

cn_status cn_stage_finish(const cn_city *city, const cn_stage *stage)
{
    char config[17], parent[17];
    cn_hash_hex(stage->config.hash, config);
    cn_hash_hex(stage->parent.hash, parent);
    char *path = cn_city_path(city, stage->record);
    json_t *root = json_pack("{s:i,s:s,s:s,s:o,s:o,s:o,s:s}", "version", RECORD_FORMAT, "config", config, "parent",
                             parent, "settings", fingerprint_json(&stage->config), "parents",
                             fingerprint_json(&stage->parent), "made", made_json(city, stage), "conurb", cn_version());
    const cn_status status = path && root ? cn_json_save(root, path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    json_decref(root);
    free(path);
    return status;
}
