/* The schema of city.yaml, and what is wrong with a file that does not follow it, in one line. */
#include "city/config_yaml.h"
#include "city/config.h"
#include "city/yaml_place.h"

#include <cyaml/cyaml.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const cyaml_strval_t matchers[] = { { "auto", CN_MATCH_AUTO },
                                           { "gps", CN_MATCH_GPS },
                                           { "exhaustive", CN_MATCH_EXHAUSTIVE },
                                           { "sequential", CN_MATCH_SEQUENTIAL } };
static const cyaml_strval_t tristates[] = { { "auto", CN_AUTO }, { "on", CN_ON }, { "off", CN_OFF } };
static const cyaml_strval_t layouts[] = { { "auto", CN_LAYOUT_AUTO },
                                          { "grid", CN_LAYOUT_GRID },
                                          { "centres", CN_LAYOUT_CENTRES } };
static const cyaml_strval_t qualities[] = { { "preview", CN_QUALITY_PREVIEW },
                                            { "standard", CN_QUALITY_STANDARD },
                                            { "high", CN_QUALITY_HIGH },
                                            { "reference", CN_QUALITY_REFERENCE } };

static const cyaml_strval_t schemes[] = { { "nearest", CN_BLEND_NEAREST },
                                          { "distance_2d", CN_BLEND_DISTANCE_2D },
                                          { "distance_3d", CN_BLEND_DISTANCE_3D },
                                          { "visibility", CN_BLEND_VISIBILITY },
                                          { "ownership", CN_BLEND_OWNERSHIP } };
static const cyaml_strval_t precisions[] = { { "fastest", CN_PRECISION_FASTEST }, { "float", CN_PRECISION_FLOAT } };

#define OPTIONAL (CYAML_FLAG_OPTIONAL | CYAML_FLAG_POINTER)
#define UINT(type, name) CYAML_FIELD_UINT_PTR(#name, OPTIONAL, type, name)
#define REAL(type, name) CYAML_FIELD_FLOAT_PTR(#name, OPTIONAL, type, name)
#define TEXT(type, name) CYAML_FIELD_STRING_PTR(#name, OPTIONAL, type, name, 0, 4096)
/* Strict: a number is no name, even where it is one's value. */
#define ENUM(type, name, values)                                                                                       \
    CYAML_FIELD_ENUM_PTR(#name, OPTIONAL | CYAML_FLAG_STRICT, type, name, values, CYAML_ARRAY_LEN(values))
#define EFFECT(name, i)                                                                                                \
    CYAML_FIELD_ENUM_PTR(name, OPTIONAL | CYAML_FLAG_STRICT, cn_yaml_effects, want[i], tristates,                      \
                         CYAML_ARRAY_LEN(tristates))

static const cyaml_schema_field_t photos_fields[] = { TEXT(cn_yaml_photos, folder), UINT(cn_yaml_photos, width_px),
                                                      CYAML_FIELD_END };
static const cyaml_schema_field_t poses_fields[] = { TEXT(cn_yaml_poses, import),
                                                     TEXT(cn_yaml_poses, colmap),
                                                     ENUM(cn_yaml_poses, matcher, matchers),
                                                     UINT(cn_yaml_poses, neighbours),
                                                     UINT(cn_yaml_poses, max_image_px),
                                                     ENUM(cn_yaml_poses, refine_focal, tristates),
                                                     REAL(cn_yaml_poses, max_error_m),
                                                     CYAML_FIELD_END };
static const cyaml_schema_field_t plan_fields[] = {
    ENUM(cn_yaml_plan, layout, layouts), TEXT(cn_yaml_plan, centres),     REAL(cn_yaml_plan, spacing_m),
    REAL(cn_yaml_plan, overlap),         UINT(cn_yaml_plan, min_photos),  UINT(cn_yaml_plan, hold_out_every),
    UINT(cn_yaml_plan, max_tile_photos), REAL(cn_yaml_plan, max_tile_gb), CYAML_FIELD_END
};
static const cyaml_schema_field_t effects_fields[] = {
    EFFECT("view_dependence", 0), EFFECT("appearance", 1), EFFECT("exposure", 2), EFFECT("transient", 3),
    EFFECT("pose_refinement", 4), EFFECT("sky", 5),        CYAML_FIELD_END
};
static const cyaml_schema_field_t train_fields[] = { ENUM(cn_yaml_train, quality, qualities),
                                                     UINT(cn_yaml_train, seed),
                                                     UINT(cn_yaml_train, steps),
                                                     REAL(cn_yaml_train, time_budget_s),
                                                     REAL(cn_yaml_train, stop_gain_db),
                                                     REAL(cn_yaml_train, checkpoint_every_s),
                                                     UINT(cn_yaml_train, log2_table),
                                                     UINT(cn_yaml_train, levels),
                                                     UINT(cn_yaml_train, finest_resolution),
                                                     UINT(cn_yaml_train, samples_per_step),
                                                     REAL(cn_yaml_train, march_step),
                                                     ENUM(cn_yaml_train, precision, precisions),
                                                     REAL(cn_yaml_train, learning_rate),
                                                     CYAML_FIELD_END };
static const cyaml_schema_field_t compose_fields[] = { ENUM(cn_yaml_compose, scheme, schemes),
                                                       REAL(cn_yaml_compose, exponent),
                                                       REAL(cn_yaml_compose, reach),
                                                       UINT(cn_yaml_compose, max_tiles),
                                                       REAL(cn_yaml_compose, min_visibility),
                                                       ENUM(cn_yaml_compose, match, tristates),
                                                       CYAML_FIELD_END };
static const cyaml_schema_field_t render_fields[] = { UINT(cn_yaml_render, width_px),
                                                      UINT(cn_yaml_render, frames),
                                                      REAL(cn_yaml_render, fps),
                                                      TEXT(cn_yaml_render, view),
                                                      TEXT(cn_yaml_render, look),
                                                      REAL(cn_yaml_render, exposure_ev),
                                                      CYAML_FIELD_END };
/* A section whose keys are all commented out is empty, and that is fine. */
#define SECTION(name)                                                                                                  \
    CYAML_FIELD_MAPPING_PTR(#name, OPTIONAL | CYAML_FLAG_POINTER_NULL_STR, cn_yaml_city, name, name##_fields)
static const cyaml_schema_field_t city_fields[] = { CYAML_FIELD_UINT("version", CYAML_FLAG_DEFAULT, cn_yaml_city,
                                                                     version),
                                                    SECTION(photos),
                                                    SECTION(poses),
                                                    SECTION(plan),
                                                    SECTION(effects),
                                                    SECTION(train),
                                                    SECTION(compose),
                                                    SECTION(render),
                                                    CYAML_FIELD_END };
static const cyaml_schema_value_t city_schema = { CYAML_VALUE_MAPPING(CYAML_FLAG_POINTER, cn_yaml_city, city_fields) };

/* What libcyaml logs of a failure: the first message, and from its backtrace the fields around it, innermost first. */
typedef struct complaint {
    char text[256];
    char fields[2][64];
    unsigned n_fields;
} complaint;

static void listen(cyaml_log_t level, void *user, const char *format, va_list args)
{
    complaint *c = user;
    char line[256];
    vsnprintf(line, sizeof line, format, args);
    line[strcspn(line, "\n")] = 0;
    if (level < CYAML_LOG_ERROR) return;
    if (sscanf(line, " in mapping field '%63[^']'", c->fields[c->n_fields < 2 ? c->n_fields : 1]) == 1) {
        c->n_fields += c->n_fields < 2;
        return;
    }
    if (c->text[0]) return;
    snprintf(c->text, sizeof c->text, "%s", strncmp(line, "Load: ", 6) == 0 ? line + 6 : line);
}

static const cyaml_config_t *config_of(complaint *said, cyaml_config_t *config)
{
    *config = (cyaml_config_t){ .log_fn = listen, .log_ctx = said, .log_level = CYAML_LOG_INFO, .mem_fn = cyaml_mem };
    return config;
}

static const cyaml_schema_field_t *find_field(const cyaml_schema_field_t *fields, const char *name)
{
    for (; fields->key; fields++)
        if (strcmp(fields->key, name) == 0) return fields;
    return NULL;
}

/* Levenshtein's distance of two short words. */
static unsigned distance(const char *a, const char *b)
{
    unsigned row[65];
    const size_t n = strnlen(b, 64);
    for (unsigned j = 0; j <= n; j++)
        row[j] = j;
    for (unsigned i = 1; *a; a++, i++) {
        unsigned diagonal = row[0];
        row[0] = i;
        for (unsigned j = 1; j <= n; j++) {
            const unsigned above = row[j], change = diagonal + (*a != b[j - 1]);
            row[j] = above < row[j - 1] ? above + 1 : row[j - 1] + 1;
            if (change < row[j]) row[j] = change;
            diagonal = above;
        }
    }
    return row[n];
}

/* "did you mean 'overlap'?" or, when no key is near, the keys that there are. */
static void suggest(const cyaml_schema_field_t *fields, const char *key, char *out, size_t size)
{
    const char *best = NULL;
    unsigned least = (unsigned)strlen(key) / 3 + 2;
    size_t n = (size_t)snprintf(out, size, "known are ");
    for (const cyaml_schema_field_t *f = fields; f->key; f++) {
        const unsigned d = distance(key, f->key);
        if (d < least) least = d, best = f->key;
        if (n < size) n += (size_t)snprintf(out + n, size - n, "%s%s", f == fields ? "" : ", ", f->key);
    }
    if (best) snprintf(out, size, "did you mean '%s'?", best);
}

/* What the schema wants there: "give auto, grid or centres". */
static void wanted(const cyaml_schema_value_t *value, char *out, size_t size)
{
    size_t n = 0;
    switch (value->type) {
    case CYAML_UINT: snprintf(out, size, "give a whole number, 0 or more"); return;
    case CYAML_FLOAT: snprintf(out, size, "give a number"); return;
    case CYAML_STRING: snprintf(out, size, "give a text"); return;
    case CYAML_MAPPING: snprintf(out, size, "put its keys below it, indented"); return;
    default: break;
    }
    n = (size_t)snprintf(out, size, "give ");
    for (uint32_t i = 0; i < value->enumeration.count && n < size; i++)
        n += (size_t)snprintf(out + n, size - n, "%s%s",
                              i == 0                              ? ""
                              : i + 1 == value->enumeration.count ? " or "
                                                                  : ", ",
                              value->enumeration.strings[i].str);
}

static cn_status explain_unknown(const char *path, const char *text, size_t size, const complaint *c)
{
    const char *key = c->text + strlen("Unexpected key: ");
    const char *section = c->n_fields ? c->fields[c->n_fields - 1] : NULL;
    const cyaml_schema_field_t *around = section ? find_field(city_fields, section) : NULL;
    cn_yaml_place place = { 0 };
    char hint[256];
    suggest(around ? around->value.mapping.fields : city_fields, key, hint, sizeof hint);
    (void)cn_yaml_find(text, size, section, key, &place);
    return cn_fail(CN_ERR_CONFIG, "%s:%u: unknown key '%s'%s%s; %s", path, place.line, key, section ? " in " : "",
                   section ? section : "", hint);
}

static cn_status wrong_value(const char *path, const cyaml_schema_field_t *field, const char *section,
                             const cn_yaml_place *place)
{
    char hint[128];
    const char *dot = section ? "." : "", *before = section ? section : "";
    wanted(&field->value, hint, sizeof hint);
    if (place->scalar)
        return cn_fail(CN_ERR_CONFIG, "%s:%u: %s%s%s is '%s'; %s", path, place->line, before, dot, field->key,
                       place->value, hint);
    return cn_fail(CN_ERR_CONFIG, "%s:%u: %s%s%s is a list or holds keys; %s", path, place->line, before, dot,
                   field->key, hint);
}

/* A value of the wrong type, or a key that is there twice. */
static cn_status explain_value(const char *path, const char *text, size_t size, const complaint *c)
{
    const char *key = c->fields[0], *section = c->n_fields > 1 ? c->fields[1] : NULL;
    const cyaml_schema_field_t *around = section ? find_field(city_fields, section) : NULL;
    const cyaml_schema_field_t *field = find_field(around ? around->value.mapping.fields : city_fields, key);
    cn_yaml_place place = { 0 };
    if (!field || !cn_yaml_find(text, size, section, key, &place))
        return cn_fail(CN_ERR_CONFIG, "%s: %s; `conurb init` writes a city.yaml with every key explained", path,
                       c->text);
    if (strncmp(c->text, "Mapping field already seen", 26) == 0)
        return cn_fail(CN_ERR_CONFIG, "%s:%u: %s%s%s is there twice; remove one", path, place.line,
                       section ? section : "", section ? "." : "", key);
    return wrong_value(path, field, section, &place);
}

static cn_status explain(const char *path, const char *text, size_t size, const complaint *c)
{
    if (strncmp(c->text, "Unexpected key: ", 16) == 0) return explain_unknown(path, text, size, c);
    if (c->n_fields) return explain_value(path, text, size, c);
    return cn_fail(CN_ERR_CONFIG,
                   "%s:1: it must be a list of keys and values; `conurb init` writes one with every key explained",
                   path);
}

/* Comes first: a newer file may have keys that this version cannot know. */
static cn_status check_version(const char *path, const char *text, size_t size)
{
    cn_yaml_place place;
    char problem[128], *end;
    unsigned line;
    if (!cn_yaml_check(text, size, &line, problem, sizeof problem))
        return cn_fail(CN_ERR_CONFIG, "%s:%u: not YAML: %s", path, line, problem);
    if (!cn_yaml_find(text, size, NULL, "version", &place))
        return cn_fail(CN_ERR_CONFIG, "%s:1: version is missing; begin with 'version: %d'", path, CN_CONFIG_VERSION);
    const long long version = strtoll(place.value, &end, 10);
    if (place.scalar && end != place.value && !*end && version > CN_CONFIG_VERSION)
        return cn_fail(CN_ERR_VERSION,
                       "%s:%u: version %lld was made by a newer Conurb (this one reads up to %d); update Conurb", path,
                       place.line, version, CN_CONFIG_VERSION);
    if (place.scalar && end != place.value && !*end && version < 1)
        return cn_fail(CN_ERR_CONFIG, "%s:%u: version is %lld; give %d", path, place.line, version, CN_CONFIG_VERSION);
    return CN_OK;
}

static bool is_number(cyaml_type_e type, const char *text)
{
    char *end = NULL;
    if (type == CYAML_FLOAT)
        (void)strtod(text, &end);
    else if (*text != '-')
        (void)strtoull(text, &end, 0);
    return end && end != text && !*end;
}

/* libcyaml takes "4.5" for the whole number 4, "3x" for 3, and -1 for the largest number. */
static cn_status check_numbers(const char *path, const char *text, size_t size)
{
    for (const cyaml_schema_field_t *section = city_fields; section->key; section++) {
        if (section->value.type != CYAML_MAPPING) continue;
        for (const cyaml_schema_field_t *f = section->value.mapping.fields; f->key; f++) {
            cn_yaml_place place;
            if (f->value.type != CYAML_UINT && f->value.type != CYAML_FLOAT) continue;
            if (!cn_yaml_find(text, size, section->key, f->key, &place) || is_number(f->value.type, place.value))
                continue;
            return wrong_value(path, f, section->key, &place);
        }
    }
    return CN_OK;
}

cn_status cn_yaml_parse(const char *path, const char *text, size_t size, cn_yaml_city **city)
{
    *city = NULL;
    CN_TRY(check_version(path, text, size));
    complaint said = { 0 };
    cyaml_config_t config;
    const cyaml_err_t error = cyaml_load_data((const uint8_t *)text, size, config_of(&said, &config), &city_schema,
                                              (cyaml_data_t **)city, NULL);
    if (error == CYAML_OK && *city) {
        const cn_status status = check_numbers(path, text, size);
        if (status != CN_OK) cn_yaml_free(*city), *city = NULL;
        return status;
    }
    *city = NULL;
    if (error == CYAML_ERR_OOM) return cn_fail(CN_ERR_NOMEM, "out of memory while reading %s", path);
    return explain(path, text, size, &said);
}

void cn_yaml_free(cn_yaml_city *city)
{
    complaint said = { 0 };
    cyaml_config_t config;
    /* The library reports bad arguments only, and there is nothing to do about them here. */
    (void)cyaml_free(config_of(&said, &config), &city_schema, city, 0);
}
