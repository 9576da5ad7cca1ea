#include "city/keys.h"

#include "base/file.h"
#include "base/number.h"
#include "effect/effect.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const cn_key_choice matchers[] = { { "auto", CN_MATCH_AUTO },
                                          { "gps", CN_MATCH_GPS },
                                          { "exhaustive", CN_MATCH_EXHAUSTIVE },
                                          { "sequential", CN_MATCH_SEQUENTIAL },
                                          { "retrieval", CN_MATCH_RETRIEVAL },
                                          { NULL, 0 } };
static const cn_key_choice mappers[] = { { "auto", CN_MAP_AUTO }, { "incremental", CN_MAP_INCREMENTAL }, { NULL, 0 } };
static const cn_key_choice match_with[] = { { "conurb", CN_MATCH_WITH_CONURB },
                                            { "colmap", CN_MATCH_WITH_COLMAP },
                                            { NULL, 0 } };
static const cn_key_choice control_heights[] = { { "ellipsoid", CN_CONTROL_ELLIPSOID },
                                                 { "sea_level", CN_CONTROL_SEA_LEVEL },
                                                 { NULL, 0 } };
static const cn_key_choice tristates[] = { { "auto", CN_AUTO }, { "on", CN_ON }, { "off", CN_OFF }, { NULL, 0 } };
static const cn_key_choice depth_kinds[] = { { "measured", CN_DEPTH_MEASURED }, { "cue", CN_DEPTH_CUE }, { NULL, 0 } };
static const cn_key_choice depth_ways[] = { { "axis", CN_DEPTH_ALONG_AXIS },
                                            { "ray", CN_DEPTH_ALONG_RAY },
                                            { NULL, 0 } };
static const cn_key_choice normal_axes[] = { { "opengl", CN_NORMAL_OPENGL },
                                             { "opencv", CN_NORMAL_OPENCV },
                                             { NULL, 0 } };
static const cn_key_choice layouts[] = {
    { "auto", CN_LAYOUT_AUTO }, { "grid", CN_LAYOUT_GRID }, { "centres", CN_LAYOUT_CENTRES }, { NULL, 0 }
};
static const cn_key_choice qualities[] = { { "preview", CN_QUALITY_PREVIEW }, { "standard", CN_QUALITY_STANDARD },
                                           { "high", CN_QUALITY_HIGH },       { "reference", CN_QUALITY_REFERENCE },
                                           { "compact", CN_QUALITY_COMPACT }, { NULL, 0 } };
static const cn_key_choice schemes[] = {
    { "nearest", CN_BLEND_NEAREST },         { "distance_2d", CN_BLEND_DISTANCE_2D },
    { "distance_3d", CN_BLEND_DISTANCE_3D }, { "visibility", CN_BLEND_VISIBILITY },
    { "ownership", CN_BLEND_OWNERSHIP },     { NULL, 0 }
};
static const cn_key_choice unseens[] = {
    { "fill", CN_UNSEEN_FILL }, { "neutral", CN_UNSEEN_NEUTRAL }, { "black", CN_UNSEEN_BLACK }, { NULL, 0 }
};
static const cn_key_choice precisions[] = { { "fastest", CN_PRECISION_FASTEST },
                                            { "float", CN_PRECISION_FLOAT },
                                            { NULL, 0 } };

const cn_key_section cn_key_sections[] = {
    { "photos", NULL },
    { "poses", NULL },
    { "plan", NULL },
    { "effects", "auto: on when the photos show the need; or on, off" },
    { "field", "what a tile is made of; each type has its settings, see tiles/README.md" },
    { "train", NULL },
    { "compose", NULL },
    { "render", NULL },
};
const uint32_t cn_key_n_sections = sizeof cn_key_sections / sizeof *cn_key_sections;

#define AT(member) .offset = offsetof(cn_config, member)
#define RANGE(from, to) .least = (from), .most = (to)
static const cn_key keys[] = {
    { "photos", "folder", CN_KEY_PATH, AT(photos), .comment = NULL },
    { "photos", "width_px", CN_KEY_WHOLE, AT(width_px), RANGE(16, 65535),
      .comment = "working width: photos are resampled to it once; smaller is faster" },
    { "photos", "depth", CN_KEY_PATH, AT(maps.depth), .sample = "DIR",
      .comment = "folder of depth maps, NAME.png (16 bits, millimetres) or NAME.exr (metres) for photo NAME" },
    { "photos", "depth_kind", CN_KEY_CHOICE, AT(maps.kind), .choices = depth_kinds,
      .comment = "measured | cue: a network's estimate, up to a scale and a shift per photo" },
    { "photos", "depth_along", CN_KEY_CHOICE, AT(maps.along), .choices = depth_ways,
      .comment = "axis | ray: what depth is measured along; depth cameras: the axis" },
    { "photos", "normal", CN_KEY_PATH, AT(maps.normal), .sample = "DIR",
      .comment = "folder of normal maps, NAME.png (8 or 16 bits, n = 2v - 1) or NAME.exr (n itself) for photo NAME" },
    { "photos", "normal_axes", CN_KEY_CHOICE, AT(maps.normal_axes), .choices = normal_axes,
      .comment = "opengl: x right, y up, z back | opencv: x right, y down, z forward; both of the camera" },

    { "poses", "import", CN_KEY_PATH, AT(import), .sample = "MODEL",
      .comment = "poses of another tool: a file or a folder; README.md lists the kinds" },
    { "poses", "colmap", CN_KEY_PROGRAM, AT(colmap), .sample = "colmap", .comment = "program to run" },
    { "poses", "matcher", CN_KEY_CHOICE, AT(poses.matcher), .choices = matchers,
      .comment = "auto | gps (neighbours by position) | exhaustive | sequential | retrieval (photos that look alike)" },
    { "poses", "match_with", CN_KEY_CHOICE, AT(poses.match_with), .choices = match_with,
      .comment = "conurb: exact and fast | colmap: its own matcher, approximate and slow" },
    { "poses", "mapper", CN_KEY_CHOICE, AT(poses.mapper), .choices = mappers,
      .comment =
          "auto: all photos at once; where that fails, as incremental | incremental: COLMAP's, photo after photo" },
    { "poses", "neighbours", CN_KEY_WHOLE, AT(poses.neighbours), RANGE(1, 100000),
      .comment = "photos to match each photo with, by GPS" },
    { "poses", "max_image_px", CN_KEY_WHOLE, AT(poses.max_image_px), RANGE(64, 65535),
      .comment = "features are found on photos of at most this size" },
    { "poses", "refine_focal", CN_KEY_CHOICE, AT(poses.refine_focal), .choices = tristates,
      .comment = "auto | on | off; auto is off for near-nadir sets with an EXIF focal length" },
    { "poses", "check_import", CN_KEY_CHOICE, AT(poses.check_import), .choices = tristates,
      .comment =
          "auto | on | off: imported poses that most photos' GPS contradicts are found anew; auto: up to 200 photos" },
    { "poses", "attempts", CN_KEY_WHOLE, AT(poses.attempts), RANGE(1, 5),
      .comment = "ways to map that are tried at most while too few photos have a pose" },
    { "poses", "group_photos", CN_KEY_WHOLE, AT(poses.group_photos), RANGE(0, 1e6),
      .comment = "photos of a group at most: more than twice as many are posed in groups and merged; 0: never" },
    { "poses", "single_camera", CN_KEY_SWITCH, AT(poses.single_camera),
      .comment = "on | off: photos of the same camera model and size share one lens" },
    { "poses", "control", CN_KEY_PATH, AT(control), .sample = "gcp_list.txt",
      .comment = "control points: gcp_list.txt, ground_control_points.json, or a table (CSV) with its EPSG code" },
    { "poses", "check", CN_KEY_TEXT, AT(check), .sample = "\"P4, P7\"",
      .comment = "control points that are only measured, not used" },
    { "poses", "control_heights", CN_KEY_CHOICE, AT(poses.control_heights), .choices = control_heights,
      .comment = "ellipsoid | sea_level: what heights of control points are measured from" },
    { "poses", "max_error_m", CN_KEY_REAL, AT(poses.max_error_m), RANGE(1e-6, 1e9),
      .comment = "a photo farther than this from its GPS is not used for the alignment" },

    { "plan", "layout", CN_KEY_CHOICE, AT(plan.layout), .choices = layouts, .comment = "auto | grid | centres" },
    { "plan", "centres", CN_KEY_PATH, AT(centres), .sample = "crossings.geojson",
      .comment = "GeoJSON points, for layout: centres" },
    { "plan", "spacing_m", CN_KEY_REAL, AT(plan.spacing_m), RANGE(0, 1e7),
      .comment = "metres between neighbouring tiles; 0 chooses" },
    { "plan", "overlap", CN_KEY_REAL, AT(plan.overlap), RANGE(0, 0.95),
      .comment = "fraction of a tile's diameter that it shares with the next: 1 - spacing / (2 radius)" },
    { "plan", "min_photos", CN_KEY_WHOLE, AT(plan.min_photos), RANGE(1, 1e6),
      .comment = "a tile with fewer is merged into a neighbour or dropped" },
    { "plan", "max_tile_photos", CN_KEY_WHOLE, AT(plan.max_tile_photos), RANGE(0, 1e9),
      .comment = "training photos per tile at most, evenly chosen; 0: all" },
    { "plan", "max_tile_gb", CN_KEY_GB, AT(plan.max_tile_bytes), RANGE(0, 1e6),
      .comment = "memory for training one tile at most; photos are dropped to fit; 0: no limit" },
    { "plan", "hold_out_every", CN_KEY_WHOLE, AT(plan.hold_out_every), RANGE(0, 1e6),
      .comment = "every 8th photo by name is held out for eval; 0: none" },
    { "plan", "probe_share", CN_KEY_REAL, AT(probe_share), RANGE(0, 10),
      .comment = "fraction of the training time for short trainings that test effects in doubt; 0: none" },

    { "field", "type", CN_KEY_FIELD_TYPE, AT(train.field.type), .names_settings = true },
    { "field", "teacher", CN_KEY_PATH, AT(teacher), .sample = "TILES",
      .comment =
          "kilo: the tile that it learns from, a tile.safetensors or a folder of tiles; without it one is trained" },

    { "train", "quality", CN_KEY_CHOICE, AT(quality), .choices = qualities,
      .comment = "preview | standard | high | reference, or compact: a tile of 1 MB", .names_settings = true },
    { "train", "seed", CN_KEY_WHOLE64, AT(train.seed), RANGE(0, 1.8446744073709552e19),
      .comment = "same seed, same tile" },
    { "train", "time_budget_s", CN_KEY_REAL, AT(train.time_budget_s), RANGE(0, 1e9),
      .comment = "seconds per tile; also chooses the settings, unless you set some; 0: no limit" },
    { "train", "stop_gain_db", CN_KEY_REAL, AT(train.stop_gain_db), RANGE(0, 100),
      .comment = "stop early when one more minute is expected to gain fewer dB on validation photos; 0: never" },
    { "train", "steps", CN_KEY_WHOLE, AT(train.steps), RANGE(1, 1e8),
      .comment = "by default from the quality; at high and reference from the number of photos too" },
    { "train", "samples_per_step", CN_KEY_WHOLE, AT(train.samples_per_step), RANGE(4096, 4194304),
      .comment = "memory and time of a step grow with it", .names_settings = true },
    { "train", "march_step", CN_KEY_REAL, AT(train.march_step), RANGE(1e-4, 0.1),
      .comment = "length of a sample divided by its distance, at the end; also the precision of depth",
      .names_settings = true },
    { "train", "precision", CN_KEY_CHOICE, AT(train.precision), .choices = precisions,
      .comment = "fastest | float: precision of products in the networks; fastest may be bfloat16" },
    { "train", "leave_out_occluders", CN_KEY_SWITCH, AT(train.leave_out_occluders),
      .comment = "on | off: what only one photo shows, in front of what others see, is left out, like a mask" },
    { "train", "learning_rate", CN_KEY_REAL, AT(train.learning_rate), RANGE(1e-9, 10),
      .comment = "at the start; it decays" },
    { "train", "checkpoint_every_s", CN_KEY_REAL, AT(train.checkpoint_every_s), RANGE(0.01, 1e9),
      .comment = "seconds of work that a crash can lose" },
    { "train", "device", CN_KEY_TEXT, AT(device), .sample = "auto",
      .comment =
          "auto | cpu | gpu | gpu:0 | gpu:0,gpu:1 | gpu:all, as listed by conurb doctor; --device and $CONURB_DEVICE "
          "come first" },

    { "compose", "scheme", CN_KEY_CHOICE, AT(compose.scheme), .choices = schemes,
      .comment = "nearest | distance_2d | distance_3d | visibility | ownership" },
    { "compose", "exponent", CN_KEY_REAL, AT(compose.exponent), RANGE(0, 64),
      .comment = "tiles blend by distance^-exponent" },
    { "compose", "reach", CN_KEY_REAL, AT(compose.reach), RANGE(1e-3, 1e6),
      .comment = "distance from its centre up to which a tile is shown, in radii; at least to its farthest photo" },
    { "compose", "max_tiles", CN_KEY_WHOLE, AT(compose.max_tiles), RANGE(1, CN_COMPOSE_MAX),
      .comment = "nearest first; one more is held in memory" },
    { "compose", "min_visibility", CN_KEY_REAL, AT(compose.min_visibility), RANGE(0, 0.5),
      .comment = "a tile that sees less than this fraction of what the best one sees is left out" },
    { "compose", "match", CN_KEY_SWITCH, AT(match),
      .comment = "on | off; the appearance of all tiles is aligned to a root tile's" },

    { "render", "width_px", CN_KEY_WHOLE, AT(render_width_px), RANGE(16, 16384),
      .comment = "width of a picture; its height follows the photos" },
    { "render", "frames", CN_KEY_WHOLE, AT(render_frames), RANGE(1, 1000000),
      .comment = "frames of the default flight, of an orbit, and of --path photos" },
    { "render", "fps", CN_KEY_REAL, AT(render_fps), RANGE(0.001, 1000),
      .comment = "frames per second of a path without its own" },
    { "render", "view", CN_KEY_TEXT, AT(view), .sample = "sRGB",
      .comment = "a view of the OpenColorIO config: sRGB | ACES" },
    { "render", "look", CN_KEY_TEXT, AT(look), .sample = "\"\"", .comment = "a look of the OpenColorIO config" },
    { "render", "exposure_ev", CN_KEY_REAL, AT(exposure_ev), RANGE(-64, 64),
      .comment = "stops, added to every picture" },
    { "render", "unseen", CN_KEY_CHOICE, AT(unseen), .choices = unseens,
      .comment = "fill | neutral | black: what a picture shows where no tile has anything; an EXR keeps its alpha" },
};
enum { N_KEYS = sizeof keys / sizeof *keys };

/* Option i of all types of field; one that several types have is listed with the first. */
static bool field_option_at(uint32_t i, cn_key *key)
{
    const char *type, *summary;
    for (uint32_t t = 0; cn_field_type_at(t, &type, &summary); t++) {
        uint32_t n;
        const cn_field_option *options = cn_field_type_options(type, &n);
        for (uint32_t o = 0; o < n; o++) {
            cn_field_options earlier;
            bool listed = false;
            for (uint32_t e = 0; e < t && !listed; e++) {
                const char *other;
                listed = cn_field_type_at(e, &other, &summary) &&
                         cn_field_options_preset(other, CN_QUALITY_STANDARD, &earlier) == CN_OK &&
                         !isnan(cn_field_options_get(&earlier, options[o].name));
            }
            if (listed || i--) continue;
            *key = (cn_key){ .section = "field",
                             .name = options[o].name,
                             .kind = CN_KEY_FIELD,
                             .comment = options[o].comment,
                             .names_settings = true };
            return true;
        }
    }
    return false;
}

bool cn_key_at(uint32_t i, cn_key *key)
{
    if (i < N_KEYS) {
        *key = keys[i];
        return true;
    }
    const uint32_t e = i - N_KEYS;
    if (e >= cn_effect_count) return field_option_at(e - cn_effect_count, key);
    *key = (cn_key){ .section = "effects",
                     .name = cn_effect_list[e]->name,
                     .kind = CN_KEY_CHOICE,
                     .offset = offsetof(cn_config, effects) + e * sizeof(cn_tristate),
                     .choices = tristates,
                     .comment = cn_effect_list[e]->summary };
    return true;
}

bool cn_key_find(const char *section, const char *name, cn_key *key)
{
    for (uint32_t i = 0; cn_key_at(i, key); i++)
        if (strcmp(key->section, section) == 0 && strcmp(key->name, name) == 0) return true;
    return false;
}

void cn_key_comment(const cn_key *key, char *out, size_t size)
{
    const char *name, *summary;
    size_t n = (size_t)snprintf(out, size, "%s", key->comment ? key->comment : "");
    if (key->kind != CN_KEY_FIELD_TYPE) return;
    for (uint32_t i = 0; cn_field_type_at(i, &name, &summary) && n < size; i++)
        n += (size_t)snprintf(out + n, size - n, "%s%s", i ? " | " : "", name);
}

static const void *value_of(const cn_key *key, const cn_config *config)
{
    return (const char *)config + key->offset;
}

static bool number_of(const cn_key *key, const cn_config *config, double *value)
{
    const void *at = value_of(key, config);
    switch (key->kind) {
    case CN_KEY_WHOLE: *value = *(const uint32_t *)at; return true;
    case CN_KEY_WHOLE64: *value = (double)*(const uint64_t *)at; return true;
    case CN_KEY_REAL: *value = *(const double *)at; return true;
    case CN_KEY_GB: *value = (double)*(const uint64_t *)at / 1e9; return true;
    default: return false;
    }
}

bool cn_key_in_range(const cn_key *key, const cn_config *config, double *value)
{
    if (!number_of(key, config, value)) return true;
    return *value >= key->least && *value <= key->most;
}

void cn_key_print(const cn_key *key, const cn_config *config, char *out, size_t size)
{
    double number;
    *out = 0;
    if (number_of(key, config, &number)) {
        cn_print(out, size, "%.10g", number);
    } else if (key->kind == CN_KEY_FIELD) {
        const double value = cn_field_options_get(&config->train.field, key->name);
        if (!isnan(value)) cn_print(out, size, "%.10g", value);
    } else if (key->kind == CN_KEY_FIELD_TYPE) {
        snprintf(out, size, "%s", config->train.field.type);
    } else if (key->kind == CN_KEY_CHOICE) {
        int value;
        memcpy(&value, value_of(key, config), sizeof value);
        for (const cn_key_choice *c = key->choices; c->name; c++)
            if (c->value == value) snprintf(out, size, "%s", c->name);
    } else if (key->kind == CN_KEY_SWITCH) {
        snprintf(out, size, "%s", *(const bool *)value_of(key, config) ? "on" : "off");
    } else {
        const char *text = *(char *const *)value_of(key, config);
        snprintf(out, size, "%s", text ? text : "");
    }
}

void cn_key_hint(const cn_key *key, char *hint, size_t size)
{
    switch (key->kind) {
    case CN_KEY_WHOLE:
    case CN_KEY_WHOLE64: snprintf(hint, size, "give a whole number"); return;
    case CN_KEY_REAL:
    case CN_KEY_FIELD:
    case CN_KEY_GB: snprintf(hint, size, "give a number"); return;
    case CN_KEY_SWITCH: snprintf(hint, size, "give on or off"); return;
    case CN_KEY_CHOICE: break;
    default: snprintf(hint, size, "give a text"); return;
    }
    size_t n = (size_t)snprintf(hint, size, "give ");
    for (const cn_key_choice *c = key->choices; c->name && n < size; c++)
        n += (size_t)snprintf(hint + n, size - n, "%s%s", c == key->choices ? "" : c[1].name ? ", " : " or ", c->name);
}

/* A text, or NULL where it is empty. A relative path starts at the city's folder. */
static bool store_text(const cn_key *key, const char *text, const char *folder, char **out)
{
    const bool path = key->kind == CN_KEY_PATH || (key->kind == CN_KEY_PROGRAM && strchr(text, '/'));
    if (!*text) return true;
    free(*out);
    *out = path && *text != '/' ? cn_path_join(folder, text) : cn_format("%s", text);
    return *out != NULL;
}

static bool store_whole(const char *text, uint64_t most, uint64_t *out)
{
    char *end;
    if (*text < '0' || *text > '9') return false;
    errno = 0;
    *out = strtoull(text, &end, 10);
    return !*end && !errno && *out <= most;
}

static bool store_choice(const cn_key *key, const char *text, void *at)
{
    for (const cn_key_choice *c = key->choices; c->name; c++)
        if (strcmp(c->name, text) == 0) {
            memcpy(at, &c->value, sizeof c->value);
            return true;
        }
    return false;
}

static bool store_switch(const char *text, bool *out)
{
    *out = strcmp(text, "on") == 0;
    return *out || strcmp(text, "off") == 0;
}

bool cn_key_store(const cn_key *key, const char *text, const char *folder, cn_config *config, char *hint, size_t size)
{
    void *at = (char *)config + key->offset;
    uint64_t whole;
    char *end = NULL;
    double real;
    cn_key_hint(key, hint, size);
    switch (key->kind) {
    case CN_KEY_WHOLE:
        if (!store_whole(text, UINT32_MAX, &whole)) return false;
        *(uint32_t *)at = (uint32_t)whole;
        return true;
    case CN_KEY_WHOLE64: return store_whole(text, UINT64_MAX, at);
    case CN_KEY_REAL:
    case CN_KEY_GB:
        real = cn_parse_double(text, &end);
        if (end == text || *end) return false;
        if (key->kind == CN_KEY_REAL) {
            *(double *)at = real;
            return true;
        }
        if (!(real >= 0)) { /* as bytes it would be 0, which means no limit */
            cn_print(hint, size, "give %.10g to %.10g", key->least, key->most);
            return false;
        }
        *(uint64_t *)at = (uint64_t)(fmin(real, 1e9) * 1e9);
        return true;
    case CN_KEY_CHOICE: return store_choice(key, text, at);
    case CN_KEY_SWITCH: return store_switch(text, at);
    default: return store_text(key, text, folder, at);
    }
}
