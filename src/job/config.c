#include "job/config.h"

#include "base/file.h"

#include <cyaml/cyaml.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

const char *const cn_config_effects[] = {"view_dependence", "appearance", "exposure", "transient", "pose_refinement", "sky"};
const uint32_t cn_config_n_effects = sizeof cn_config_effects / sizeof *cn_config_effects;

/* As in the file; NULL is absent. */
typedef struct yaml_photos { char *folder; unsigned *width_px; } yaml_photos;
typedef struct yaml_poses {
    char *import, *colmap; unsigned *matcher, *neighbours, *max_image_px, *refine_focal; double *max_error_m;
} yaml_poses;
typedef struct yaml_plan { unsigned *layout, *min_photos, *hold_out_every; char *centres; double *spacing_m, *overlap; } yaml_plan;
typedef struct yaml_effects { unsigned *want[6]; } yaml_effects;
typedef struct yaml_train {
    unsigned *quality, *steps, *samples_per_step, *levels, *log2_table, *finest_resolution;
    uint64_t *seed;
    double *time_budget_s, *checkpoint_every_s, *learning_rate;
} yaml_train;
typedef struct yaml_compose { double *exponent, *reach; unsigned *max_tiles; } yaml_compose;
typedef struct yaml_render { unsigned *width_px, *frames; double *fps, *exposure_ev; char *view, *look; } yaml_render;
typedef struct yaml_city {
    unsigned version;
    yaml_photos *photos; yaml_poses *poses; yaml_plan *plan; yaml_effects *effects; yaml_train *train; yaml_compose *compose; yaml_render *render;
} yaml_city;

static const cyaml_strval_t matchers[] = {{"auto", CN_MATCH_AUTO}, {"gps", CN_MATCH_GPS}, {"exhaustive", CN_MATCH_EXHAUSTIVE}, {"sequential", CN_MATCH_SEQUENTIAL}};
static const cyaml_strval_t tristates[] = {{"auto", CN_AUTO}, {"on", CN_ON}, {"off", CN_OFF}};
static const cyaml_strval_t layouts[] = {{"auto", CN_LAYOUT_AUTO}, {"grid", CN_LAYOUT_GRID}, {"centres", CN_LAYOUT_CENTRES}};
static const cyaml_strval_t qualities[] = {{"preview", CN_QUALITY_PREVIEW}, {"standard", CN_QUALITY_STANDARD}, {"high", CN_QUALITY_HIGH}, {"reference", CN_QUALITY_REFERENCE}};

#define OPTIONAL (CYAML_FLAG_OPTIONAL | CYAML_FLAG_POINTER)
#define UINT(type, name) CYAML_FIELD_UINT_PTR(#name, OPTIONAL, type, name)
#define REAL(type, name) CYAML_FIELD_FLOAT_PTR(#name, OPTIONAL, type, name)
#define TEXT(type, name) CYAML_FIELD_STRING_PTR(#name, OPTIONAL, type, name, 0, 4096)
#define ENUM(type, name, values) CYAML_FIELD_ENUM_PTR(#name, OPTIONAL, type, name, values, CYAML_ARRAY_LEN(values))

static const cyaml_schema_field_t photos_fields[] = {TEXT(yaml_photos, folder), UINT(yaml_photos, width_px), CYAML_FIELD_END};
static const cyaml_schema_field_t poses_fields[] = {
    TEXT(yaml_poses, import), TEXT(yaml_poses, colmap), ENUM(yaml_poses, matcher, matchers), UINT(yaml_poses, neighbours),
    UINT(yaml_poses, max_image_px), ENUM(yaml_poses, refine_focal, tristates), REAL(yaml_poses, max_error_m), CYAML_FIELD_END};
static const cyaml_schema_field_t plan_fields[] = {
    ENUM(yaml_plan, layout, layouts), TEXT(yaml_plan, centres), REAL(yaml_plan, spacing_m), REAL(yaml_plan, overlap),
    UINT(yaml_plan, min_photos), UINT(yaml_plan, hold_out_every), CYAML_FIELD_END};
#define EFFECT(name, i) CYAML_FIELD_ENUM_PTR(name, OPTIONAL, yaml_effects, want[i], tristates, CYAML_ARRAY_LEN(tristates))
static const cyaml_schema_field_t effects_fields[] = {
    EFFECT("view_dependence", 0), EFFECT("appearance", 1), EFFECT("exposure", 2), EFFECT("transient", 3),
    EFFECT("pose_refinement", 4), EFFECT("sky", 5), CYAML_FIELD_END};
static const cyaml_schema_field_t train_fields[] = {
    ENUM(yaml_train, quality, qualities), UINT(yaml_train, steps), UINT(yaml_train, samples_per_step), UINT(yaml_train, levels),
    UINT(yaml_train, log2_table), UINT(yaml_train, finest_resolution), CYAML_FIELD_UINT_PTR("seed", OPTIONAL, yaml_train, seed),
    REAL(yaml_train, time_budget_s), REAL(yaml_train, checkpoint_every_s), REAL(yaml_train, learning_rate), CYAML_FIELD_END};
static const cyaml_schema_field_t compose_fields[] = {REAL(yaml_compose, exponent), REAL(yaml_compose, reach), UINT(yaml_compose, max_tiles), CYAML_FIELD_END};
static const cyaml_schema_field_t render_fields[] = {
    UINT(yaml_render, width_px), UINT(yaml_render, frames), REAL(yaml_render, fps), REAL(yaml_render, exposure_ev),
    TEXT(yaml_render, view), TEXT(yaml_render, look), CYAML_FIELD_END};
#define SECTION(name) CYAML_FIELD_MAPPING_PTR(#name, OPTIONAL | CYAML_FLAG_POINTER_NULL_STR, yaml_city, name, name##_fields)
static const cyaml_schema_field_t city_fields[] = {
    CYAML_FIELD_UINT("version", CYAML_FLAG_DEFAULT, yaml_city, version), SECTION(photos), SECTION(poses), SECTION(plan), SECTION(effects),
    SECTION(train), SECTION(compose), SECTION(render), CYAML_FIELD_END};
static const cyaml_schema_value_t city_schema = {CYAML_VALUE_MAPPING(CYAML_FLAG_POINTER, yaml_city, city_fields)};

/* What libcyaml logs of a failure: the first message, and the first line number after it. */
typedef struct complaint { char text[512]; unsigned line; } complaint;

static void listen(cyaml_log_t level, void *user, const char *format, va_list args)
{
    complaint *c = user;
    char text[512];
    vsnprintf(text, sizeof text, format, args);
    const char *line = strstr(text, "line: ");
    if (!line) line = strstr(text, "line ");
    if (line && !c->line) c->line = (unsigned)strtoul(line + (line[4] == ':' ? 6 : 5), NULL, 10);
    if (level < CYAML_LOG_ERROR || c->text[0] || strstr(text, "Backtrace")) return;
    const char *from = strncmp(text, "Load: ", 6) == 0 ? text + 6 : text;
    snprintf(c->text, sizeof c->text, "%s", from);
    c->text[strcspn(c->text, "\n")] = 0;
}

static char *resolve(const char *folder, const char *path)
{
    if (!path || !*path) return NULL;
    return *path == '/' ? cn_format("%s", path) : cn_path_join(folder, path);
}

#define SET(target, source) do { if (source) (target) = *(source); } while (0)
#define SET_AS(type, target, source) do { if (source) (target) = (type)*(source); } while (0)

static void take_poses(cn_config *c, const yaml_poses *y, const char *folder)
{
    if (!y) return;
    c->import = resolve(folder, y->import);
    c->colmap = y->colmap && *y->colmap ? cn_format("%s", y->colmap) : NULL;
    SET_AS(cn_matcher, c->poses.matcher, y->matcher);
    SET(c->poses.neighbours, y->neighbours);
    SET(c->poses.max_image_px, y->max_image_px);
    SET_AS(cn_tristate, c->poses.refine_focal, y->refine_focal);
    SET(c->poses.max_error_m, y->max_error_m);
}

static void take_plan(cn_config *c, const yaml_plan *y, const char *folder)
{
    if (!y) return;
    SET_AS(cn_layout, c->plan.layout, y->layout);
    c->centres = resolve(folder, y->centres);
    SET(c->plan.spacing_m, y->spacing_m);
    SET(c->plan.overlap, y->overlap);
    SET(c->plan.min_photos, y->min_photos);
    SET(c->plan.hold_out_every, y->hold_out_every);
}

static void take_train(cn_train_options *o, const yaml_train *y)
{
    if (!y) return;
    SET(o->seed, y->seed);
    SET(o->steps, y->steps);
    SET(o->samples_per_step, y->samples_per_step);
    SET(o->levels, y->levels);
    SET(o->log2_table, y->log2_table);
    SET(o->finest_resolution, y->finest_resolution);
    SET(o->time_budget_s, y->time_budget_s);
    SET(o->checkpoint_every_s, y->checkpoint_every_s);
    SET(o->learning_rate, y->learning_rate);
}

static void take(cn_config *c, const yaml_city *y, const char *folder)
{
    c->photos = y->photos ? resolve(folder, y->photos->folder) : NULL;
    if (y->photos) SET(c->width_px, y->photos->width_px);
    take_poses(c, y->poses, folder);
    take_plan(c, y->plan, folder);
    for (uint32_t i = 0; y->effects && i < cn_config_n_effects; i++) SET_AS(cn_tristate, c->effects[i], y->effects->want[i]);
    if (y->train) SET_AS(cn_quality, c->quality, y->train->quality);
    c->train = cn_train_options_preset(c->quality);
    take_train(&c->train, y->train);
    if (y->compose) {
        SET(c->compose.exponent, y->compose->exponent);
        SET(c->compose.reach, y->compose->reach);
        SET(c->compose.max_tiles, y->compose->max_tiles);
    }
    if (y->render) {
        SET(c->render_width_px, y->render->width_px);
        SET(c->render_frames, y->render->frames);
        SET(c->render_fps, y->render->fps);
        SET(c->exposure_ev, y->render->exposure_ev);
        c->view = y->render->view && *y->render->view ? cn_format("%s", y->render->view) : NULL;
        c->look = y->render->look && *y->render->look ? cn_format("%s", y->render->look) : NULL;
    }
    c->poses.import = c->import;
    if (c->colmap) c->poses.colmap = c->colmap;
    c->plan.centres = c->centres;
}

static cn_status bad(const char *path, const char *key, double value, const char *range)
{
    return cn_fail(CN_ERR_CONFIG, "%s: %s is %g; give %s", path, key, value, range);
}

static cn_status check(const cn_config *c, const char *path)
{
    if (!c->photos) return cn_fail(CN_ERR_CONFIG, "%s: photos.folder is missing; name the folder that holds the photos", path);
    if (c->width_px < 16 || c->width_px > 65535) return bad(path, "photos.width_px", c->width_px, "16 to 65535");
    if (!(c->poses.max_error_m > 0)) return bad(path, "poses.max_error_m", c->poses.max_error_m, "metres above 0");
    if (!(c->plan.overlap >= 0 && c->plan.overlap < 0.95)) return bad(path, "plan.overlap", c->plan.overlap, "0 to 0.95");
    if (!(c->plan.spacing_m >= 0 && c->plan.spacing_m < 1e7)) return bad(path, "plan.spacing_m", c->plan.spacing_m, "metres, or 0 for automatic");
    if (c->plan.layout == CN_LAYOUT_CENTRES && !c->centres) return cn_fail(CN_ERR_CONFIG, "%s: plan.layout is centres but plan.centres names no GeoJSON file", path);
    if (!(c->train.learning_rate > 0 && c->train.learning_rate < 10)) return bad(path, "train.learning_rate", c->train.learning_rate, "a number above 0");
    if (c->train.steps < 1 || c->train.steps > 100000000) return bad(path, "train.steps", c->train.steps, "1 to 100000000");
    if (!(c->compose.exponent >= 0 && c->compose.exponent <= 64)) return bad(path, "compose.exponent", c->compose.exponent, "0 to 64");
    if (!(c->compose.reach > 0)) return bad(path, "compose.reach", c->compose.reach, "a number above 0");
    if (c->compose.max_tiles < 1 || c->compose.max_tiles > 16) return bad(path, "compose.max_tiles", c->compose.max_tiles, "1 to 16");
    if (c->render_width_px < 16 || c->render_width_px > 16384) return bad(path, "render.width_px", c->render_width_px, "16 to 16384");
    if (c->render_frames < 1 || c->render_frames > 1000000) return bad(path, "render.frames", c->render_frames, "1 to 1000000");
    return CN_OK;
}

static cn_status parse(cn_config *config, const char *folder, const char *path, const char *text, size_t size)
{
    complaint said = {{0}, 0};
    const cyaml_config_t how = {.log_fn = listen, .log_ctx = &said, .log_level = CYAML_LOG_INFO, .mem_fn = cyaml_mem};
    yaml_city *city = NULL;
    const cyaml_err_t error = cyaml_load_data((const uint8_t *)text, size, &how, &city_schema, (cyaml_data_t **)&city, NULL);
    if (error != CYAML_OK)
        return cn_fail(CN_ERR_CONFIG, "%s:%u: %s; the keys and their values are explained in the comments that `conurb init` writes", path,
                       said.line, said.text[0] ? said.text : cyaml_strerror(error));
    if (city->version > CN_CONFIG_VERSION) {
        const unsigned version = city->version;
        cyaml_free(&how, &city_schema, city, 0);
        return cn_fail(CN_ERR_VERSION, "%s has version %u, this Conurb knows up to %d; use a newer Conurb", path, version, CN_CONFIG_VERSION);
    }
    take(config, city, folder);
    cyaml_free(&how, &city_schema, city, 0);
    return check(config, path);
}

cn_status cn_config_load(cn_config *config, const char *folder)
{
    *config = (cn_config){.width_px = 800, .poses = cn_pose_options_default(), .plan = cn_plan_options_default(),
                          .quality = CN_QUALITY_STANDARD, .compose = cn_compose_options_default(), .render_width_px = 640,
                          .render_frames = 48, .render_fps = 24};
    char *path = cn_path_join(folder, "city.yaml"), *text = NULL;
    size_t size = 0;
    cn_status status = path ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK && !cn_file_exists(path))
        status = cn_fail(CN_ERR_USAGE, "%s is not a city: it has no city.yaml; make one with `conurb init %s --photos DIR`", folder, folder);
    if (status == CN_OK) status = cn_file_read(path, 1 << 20, &text, &size);
    if (status == CN_OK) status = parse(config, folder, path, text, size);
    free(text);
    free(path);
    if (status != CN_OK) cn_config_deinit(config);
    return status;
}

void cn_config_deinit(cn_config *config)
{
    char *owned[] = {config->photos, config->import, config->view, config->look, config->colmap, config->centres};
    for (size_t i = 0; i < sizeof owned / sizeof *owned; i++) free(owned[i]);
    *config = (cn_config){0};
}

cn_train_options cn_config_train(const cn_config *config, int quality, double time_budget_s)
{
    cn_train_options o = config->train;
    if (quality >= 0 && quality != (int)config->quality) {
        o = cn_train_options_preset((cn_quality)quality);
        o.seed = config->train.seed;
        o.checkpoint_every_s = config->train.checkpoint_every_s;
    }
    if (time_budget_s > 0) o.time_budget_s = time_budget_s;
    return o;
}
