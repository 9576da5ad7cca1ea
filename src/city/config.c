#include "city/config.h"

#include "base/file.h"
#include "base/number.h"
#include "city/keys.h"
#include "city/yaml.h"
#include "field/field.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { VERSION = 1, HINT = 400 };

/* The path of the file, for messages. */
typedef struct source {
    const char *path, *folder;
    const cn_yaml *yaml;
} source;

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

/* "did you mean 'overlap'?" or, when no name is similar, all names. */
typedef struct suggestion {
    const char *wrong, *best;
    unsigned least;
    size_t n;
    char known[HINT];
} suggestion;

static void consider(suggestion *s, const char *name)
{
    const unsigned d = distance(s->wrong, name);
    if (d < s->least) s->least = d, s->best = name;
    if (s->n < sizeof s->known)
        s->n += (size_t)snprintf(s->known + s->n, sizeof s->known - s->n, "%s%s", s->n ? ", " : "known are ", name);
}

static cn_status unknown_key(const source *s, const cn_yaml_entry *entry, const char *section)
{
    suggestion to = { .wrong = entry->key, .least = (unsigned)strlen(entry->key) / 3 + 2 };
    cn_key key;
    for (uint32_t i = 0; !section && i < cn_key_n_sections; i++)
        consider(&to, cn_key_sections[i].name);
    for (uint32_t i = 0; section && cn_key_at(i, &key); i++)
        if (strcmp(key.section, section) == 0) consider(&to, key.name);
    if (to.best) snprintf(to.known, sizeof to.known, "did you mean '%s'?", to.best);
    return cn_fail(CN_ERR_CONFIG, "%s:%u: unknown key '%.64s'%s%s; %s", s->path, entry->line, entry->key,
                   section ? " in " : "", section ? section : "", to.known);
}

/* The message of the field's own check, with file and line. */
static cn_status at_line(const source *s, const cn_yaml_entry *entry, cn_status status)
{
    char message[300];
    if (status == CN_OK) return CN_OK;
    snprintf(message, sizeof message, "%s", cn_error_message());
    return cn_fail(status, "%s:%u: %s", s->path, entry->line, message);
}

/* field.type was read first, because the other defaults depend on it. */
static cn_status take_field_value(cn_config *c, const source *s, const cn_key *key, const cn_yaml_entry *entry)
{
    char *end = NULL;
    const double value = entry->text ? cn_parse_double(entry->text, &end) : 0;
    c->train.choose = false;
    if (key->kind == CN_KEY_FIELD_TYPE) return CN_OK;
    if (!entry->text || end == entry->text || *end)
        return cn_fail(CN_ERR_CONFIG, "%s:%u: field.%s is '%.64s'; give a number", s->path, entry->line, key->name,
                       entry->text ? entry->text : "");
    return at_line(s, entry, cn_field_options_set(&c->train.field, key->name, value));
}

/* Older files, such as tiles/demo, have the settings of the hash grid in `train`. */
static const char *section_of(const char *section, const char *key)
{
    static const char *const moved[] = { "levels", "log2_table", "finest_resolution" };
    for (size_t i = 0; i < sizeof moved / sizeof *moved; i++)
        if (strcmp(section, "train") == 0 && strcmp(key, moved[i]) == 0) return "field";
    return section;
}

static cn_status take_value(cn_config *c, const source *s, const char *section, const cn_yaml_entry *entry)
{
    cn_key key;
    char hint[HINT];
    double value;
    if (!cn_key_find(section_of(section, entry->key), entry->key, &key)) return unknown_key(s, entry, section);
    if (key.kind == CN_KEY_FIELD || key.kind == CN_KEY_FIELD_TYPE) return take_field_value(c, s, &key, entry);
    if (!entry->text) {
        cn_key_hint(&key, hint, sizeof hint);
        return cn_fail(CN_ERR_CONFIG, "%s:%u: %s.%s is a list or holds keys; %s", s->path, entry->line, section,
                       key.name, hint);
    }
    if (!cn_key_store(&key, entry->text, s->folder, c, hint, sizeof hint))
        return cn_fail(CN_ERR_CONFIG, "%s:%u: %s.%s is '%.64s'; %s", s->path, entry->line, section, key.name,
                       entry->text, hint);
    if (!cn_key_in_range(&key, c, &value))
        return cn_fail(CN_ERR_CONFIG, "%s:%u: %s.%s is %g; give %.10g to %.10g", s->path, entry->line, section,
                       key.name, value, key.least, key.most);
    if (key.names_settings) c->train.choose = false;
    if (strcmp(key.section, "train") == 0 && strcmp(key.name, "steps") == 0) c->train.steps_per_photo = 0;
    return CN_OK;
}

static bool is_section(const char *name)
{
    for (uint32_t i = 0; i < cn_key_n_sections; i++)
        if (strcmp(cn_key_sections[i].name, name) == 0) return true;
    return false;
}

static cn_status take_section(cn_config *c, const source *s, const cn_yaml_entry *section)
{
    const int n = cn_yaml_count(s->yaml, section->node);
    if (!is_section(section->key)) return unknown_key(s, section, NULL);
    /* A section whose keys are all commented out is empty; that is allowed. */
    if (n < 0 && section->text && !*section->text) return CN_OK;
    if (n < 0)
        return cn_fail(CN_ERR_CONFIG, "%s:%u: %s has no keys; put its keys below it, each indented by two blanks",
                       s->path, section->line, section->key);
    for (int i = 0; i < n; i++) {
        const cn_yaml_entry entry = cn_yaml_at(s->yaml, section->node, i);
        CN_TRY(take_value(c, s, section->key, &entry));
    }
    return CN_OK;
}

/* Check this first: a newer file may have keys that this version does not know. */
static cn_status check_version(const source *s)
{
    cn_yaml_entry entry;
    char *end = NULL;
    if (!cn_yaml_find(s->yaml, CN_YAML_ROOT, "version", &entry))
        return cn_fail(CN_ERR_CONFIG, "%s:1: version is missing; begin with 'version: %d'", s->path, VERSION);
    const long long version = entry.text ? strtoll(entry.text, &end, 10) : 0;
    if (!entry.text || end == entry.text || *end)
        return cn_fail(CN_ERR_CONFIG, "%s:%u: version is '%.64s'; give a whole number", s->path, entry.line,
                       entry.text ? entry.text : "");
    if (version > VERSION)
        return cn_fail(CN_ERR_VERSION,
                       "%s:%u: version %lld was made by a newer Conurb (this one reads up to %d); update Conurb",
                       s->path, entry.line, version, VERSION);
    if (version < 1)
        return cn_fail(CN_ERR_CONFIG, "%s:%u: version is %lld; give %d", s->path, entry.line, version, VERSION);
    return CN_OK;
}

/* The line of a key, or of its section, or 1. */
static unsigned line_of(const source *s, const char *section, const char *key)
{
    cn_yaml_entry at, below;
    if (!cn_yaml_find(s->yaml, CN_YAML_ROOT, section, &at)) return 1;
    return cn_yaml_find(s->yaml, at.node, key, &below) ? below.line : at.line;
}

static bool is_below(const char *path, const char *folder)
{
    const size_t n = strlen(folder);
    return strncmp(path, folder, n) == 0 && (path[n] == '/' || path[n] == '\0' || (n && folder[n - 1] == '/'));
}

static cn_status check_maps(const cn_config *c, const source *s, const char *key, const char *folder)
{
    if (!folder || !is_below(folder, c->photos)) return CN_OK;
    return cn_fail(CN_ERR_CONFIG,
                   "%s:%u: photos.%s lies inside photos.folder, where every picture counts as a photo; move it out of "
                   "that folder",
                   s->path, line_of(s, "photos", key), key);
}

/* Checks that involve several keys. */
static cn_status check(const cn_config *c, const source *s)
{
    if (!c->photos)
        return cn_fail(CN_ERR_CONFIG, "%s:%u: photos.folder is missing; name the folder that holds the photos", s->path,
                       line_of(s, "photos", "folder"));
    CN_TRY(check_maps(c, s, "depth", c->maps.depth));
    CN_TRY(check_maps(c, s, "normal", c->maps.normal));
    if (c->check && !c->control)
        return cn_fail(CN_ERR_CONFIG, "%s:%u: poses.check names points, but poses.control names no file of points",
                       s->path, line_of(s, "poses", "check"));
    if (c->plan.hold_out_every == 1)
        return cn_fail(CN_ERR_CONFIG,
                       "%s:%u: plan.hold_out_every is 1, which leaves no photo to train on; give 2 or more, or 0",
                       s->path, line_of(s, "plan", "hold_out_every"));
    if (c->plan.layout == CN_LAYOUT_CENTRES && !c->centres)
        return cn_fail(CN_ERR_CONFIG, "%s:%u: plan.layout is centres but plan.centres names no GeoJSON file", s->path,
                       line_of(s, "plan", "layout"));
    if (c->teacher && isnan(cn_field_options_get(&c->train.field, CN_FIELD_DISTILLED)))
        return cn_fail(CN_ERR_CONFIG, "%s:%u: field.teacher is a setting of kilo, not of %s; remove it", s->path,
                       line_of(s, "field", "teacher"), c->train.field.type);
    cn_field field;
    const cn_yaml_entry at = { .line = line_of(s, "field", "type") };
    return at_line(s, &at, cn_field_layout(&field, &c->train.field, (cn_field_inputs){ 0 }));
}

static void take_maps(cn_train_options *o, const cn_photo_maps *maps)
{
    o->normal_maps = maps->normal != NULL;
    o->depth_maps = maps->depth != NULL;
    o->depth_kind = maps->kind;
    o->depth_along = maps->along;
}

/* The preset of a quality, with the type of field that city.yaml names. */
static cn_status preset(cn_train_options *o, const source *s, cn_quality quality)
{
    cn_yaml_entry field, type;
    *o = cn_train_options_preset(quality);
    o->choose = true;
    if (!cn_yaml_find(s->yaml, CN_YAML_ROOT, "field", &field) || !cn_yaml_find(s->yaml, field.node, "type", &type))
        return CN_OK;
    return at_line(s, &type, cn_field_options_preset(type.text ? type.text : "", quality, &o->field));
}

static bool is_of_training(const char *section)
{
    return strcmp(section, "train") == 0 || strcmp(section, "field") == 0;
}

/* The quality decides the other defaults of training, so it is read first. The command line may name another quality:
 * city.yaml's own settings then hold as well. */
static cn_status take_training(cn_config *c, const source *s)
{
    cn_yaml_entry train, quality;
    if (cn_yaml_find(s->yaml, CN_YAML_ROOT, "train", &train) && cn_yaml_find(s->yaml, train.node, "quality", &quality))
        CN_TRY(take_value(c, s, "train", &quality));
    for (int q = 0; q < CN_QUALITIES; q++) {
        CN_TRY(preset(&c->train, s, (cn_quality)q));
        for (int i = 0, n = cn_yaml_count(s->yaml, CN_YAML_ROOT); i < n; i++) {
            const cn_yaml_entry section = cn_yaml_at(s->yaml, CN_YAML_ROOT, i);
            if (is_of_training(section.key)) CN_TRY(take_section(c, s, &section));
        }
        take_maps(&c->train, &c->maps);
        c->by_quality[q] = c->train;
    }
    c->train = c->by_quality[c->quality];
    return CN_OK;
}

static cn_status take(cn_config *c, const source *s)
{
    CN_TRY(check_version(s));
    for (int i = 0, n = cn_yaml_count(s->yaml, CN_YAML_ROOT); i < n; i++) {
        const cn_yaml_entry section = cn_yaml_at(s->yaml, CN_YAML_ROOT, i);
        if (strcmp(section.key, "version") != 0 && !is_of_training(section.key)) CN_TRY(take_section(c, s, &section));
    }
    CN_TRY(take_training(c, s));
    c->poses.import = c->import;
    if (c->colmap) c->poses.colmap = c->colmap;
    c->poses.control = c->control;
    c->poses.check = c->check;
    c->plan.centres = c->centres;
    return check(c, s);
}

cn_config cn_config_default(void)
{
    return (cn_config){ .width_px = 800,
                        .poses = cn_pose_options_default(),
                        .plan = cn_plan_options_default(),
                        .probe_share = 0.1,
                        .quality = CN_QUALITY_STANDARD,
                        .train = cn_train_options_preset(CN_QUALITY_STANDARD),
                        .compose = cn_compose_options_default(),
                        .match = true,
                        .render_width_px = 640,
                        .render_frames = 48,
                        .render_fps = 24 };
}

cn_status cn_config_load(cn_config *config, const char *folder)
{
    *config = cn_config_default();
    char *path = cn_path_join(folder, "city.yaml"), *text = NULL;
    size_t size = 0;
    cn_yaml *yaml = NULL;
    cn_status status = path ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK && !cn_file_exists(path))
        status =
            cn_fail(CN_ERR_USAGE, "%s is not a city: it has no city.yaml; make one with `conurb init %s --photos DIR`",
                    folder, folder);
    if (status == CN_OK) status = cn_file_read(path, 1 << 20, &text, &size);
    if (status == CN_OK) status = cn_yaml_read(&yaml, path, text, size);
    if (status == CN_OK) status = take(config, &(source){ path, folder, yaml });
    cn_yaml_free(&yaml);
    free(text);
    free(path);
    if (status != CN_OK) cn_config_deinit(config);
    return status;
}

void cn_config_deinit(cn_config *config)
{
    char *owned[] = { config->photos,  config->import,  config->view,       config->look,
                      config->colmap,  config->centres, config->maps.depth, config->maps.normal,
                      config->control, config->check,   config->teacher,    config->device };
    for (size_t i = 0; i < sizeof owned / sizeof *owned; i++)
        free(owned[i]);
    *config = (cn_config){ 0 };
}

cn_train_options cn_config_train(const cn_config *config, int quality, double time_budget_s)
{
    cn_train_options o = quality < 0 ? config->train : config->by_quality[quality];
    if (time_budget_s > 0) o.time_budget_s = time_budget_s;
    o.teacher = config->teacher;
    o.choose = o.choose && quality < 0 && o.time_budget_s > 0;
    return o;
}
