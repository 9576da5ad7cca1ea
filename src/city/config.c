#include "city/config.h"

#include "base/file.h"
#include "city/config_yaml.h"
#include "city/yaml_place.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

const char *const cn_config_effects[] = { "view_dependence", "appearance",      "exposure",
                                          "transient",       "pose_refinement", "sky" };
const uint32_t cn_config_n_effects = sizeof cn_config_effects / sizeof *cn_config_effects;
_Static_assert(sizeof cn_config_effects / sizeof *cn_config_effects == CN_CONFIG_EFFECTS,
               "the schema knows every effect");

static char *resolve(const char *folder, const char *path)
{
    if (!path || !*path) return NULL;
    return *path == '/' ? cn_format("%s", path) : cn_path_join(folder, path);
}

/* A text, or NULL where it is absent or empty. */
static char *text_of(const char *text)
{
    return text && *text ? cn_format("%s", text) : NULL;
}

#define SET(target, source)                                                                                            \
    do {                                                                                                               \
        if (source) (target) = *(source);                                                                              \
    } while (0)
#define SET_AS(type, target, source)                                                                                   \
    do {                                                                                                               \
        if (source) (target) = (type) * (source);                                                                      \
    } while (0)

static void take_poses(cn_config *c, const cn_yaml_poses *y, const char *folder)
{
    if (!y) return;
    c->import = resolve(folder, y->import);
    /* A bare name is looked for in PATH. */
    c->colmap = y->colmap && strchr(y->colmap, '/') ? resolve(folder, y->colmap) : text_of(y->colmap);
    SET_AS(cn_matcher, c->poses.matcher, y->matcher);
    SET(c->poses.neighbours, y->neighbours);
    SET(c->poses.max_image_px, y->max_image_px);
    SET_AS(cn_tristate, c->poses.refine_focal, y->refine_focal);
    SET(c->poses.max_error_m, y->max_error_m);
    c->poses.import = c->import;
    if (c->colmap) c->poses.colmap = c->colmap;
}

static void take_plan(cn_config *c, const cn_yaml_plan *y, const char *folder)
{
    if (!y) return;
    SET_AS(cn_layout, c->plan.layout, y->layout);
    SET(c->plan.spacing_m, y->spacing_m);
    SET(c->plan.overlap, y->overlap);
    SET(c->plan.min_photos, y->min_photos);
    SET(c->plan.hold_out_every, y->hold_out_every);
    SET(c->plan.max_tile_photos, y->max_tile_photos);
    if (y->max_tile_gb) c->plan.max_tile_bytes = (uint64_t)(fmin(fmax(*y->max_tile_gb, 0), 1e9) * 1e9);
    c->centres = resolve(folder, y->centres);
    c->plan.centres = c->centres;
}

static void take_train(cn_train_options *o, const cn_yaml_train *y)
{
    if (!y) return;
    SET(o->seed, y->seed);
    SET(o->steps, y->steps);
    SET(o->samples_per_step, y->samples_per_step);
    SET(o->levels, y->levels);
    SET(o->log2_table, y->log2_table);
    SET(o->finest_resolution, y->finest_resolution);
    SET(o->time_budget_s, y->time_budget_s);
    SET(o->stop_gain_db, y->stop_gain_db);
    SET(o->checkpoint_every_s, y->checkpoint_every_s);
    SET(o->march_step, y->march_step);
    SET_AS(cn_precision, o->precision, y->precision);
    SET(o->learning_rate, y->learning_rate);
    /* Who names settings wants these, whatever the time. */
    o->choose =
        !y->quality && !y->samples_per_step && !y->levels && !y->log2_table && !y->finest_resolution && !y->march_step;
}

static void take_render(cn_config *c, const cn_yaml_render *y)
{
    if (!y) return;
    SET(c->render_width_px, y->width_px);
    SET(c->render_frames, y->frames);
    SET(c->render_fps, y->fps);
    SET(c->exposure_ev, y->exposure_ev);
    c->view = text_of(y->view);
    c->look = text_of(y->look);
}

static void take_compose(cn_config *c, const cn_yaml_compose *y)
{
    if (!y) return;
    SET_AS(cn_blend, c->compose.scheme, y->scheme);
    SET(c->compose.exponent, y->exponent);
    SET(c->compose.reach, y->reach);
    SET(c->compose.max_tiles, y->max_tiles);
    SET(c->compose.min_visibility, y->min_visibility);
    if (y->match) c->match = *y->match != CN_OFF;
}

static void take(cn_config *c, const cn_yaml_city *y, const char *folder)
{
    c->photos = y->photos ? resolve(folder, y->photos->folder) : NULL;
    if (y->photos) SET(c->width_px, y->photos->width_px);
    take_poses(c, y->poses, folder);
    take_plan(c, y->plan, folder);
    for (uint32_t i = 0; y->effects && i < cn_config_n_effects; i++)
        SET_AS(cn_tristate, c->effects[i], y->effects->want[i]);
    if (y->train) SET_AS(cn_quality, c->quality, y->train->quality);
    c->train = cn_train_options_preset(c->quality);
    c->train.choose = true;
    take_train(&c->train, y->train);
    take_compose(c, y->compose);
    take_render(c, y->render);
}

/* The file, for messages. */
typedef struct source {
    const char *path, *text;
    size_t size;
} source;

static unsigned line_of(const source *s, const char *section, const char *key)
{
    cn_yaml_place place = { 0 };
    if (!cn_yaml_find(s->text, s->size, section, key, &place))
        (void)cn_yaml_find(s->text, s->size, NULL, section, &place);
    return place.line ? place.line : 1;
}

static cn_status check_ranges(const cn_config *c, const source *s)
{
    const struct {
        const char *section, *key;
        double value, least, most;
    } ranges[] = {
        { "photos", "width_px", c->width_px, 16, 65535 },
        { "poses", "neighbours", c->poses.neighbours, 1, 100000 },
        { "poses", "max_image_px", c->poses.max_image_px, 64, 65535 },
        { "poses", "max_error_m", c->poses.max_error_m, 1e-6, 1e9 },
        { "plan", "spacing_m", c->plan.spacing_m, 0, 1e7 },
        { "plan", "overlap", c->plan.overlap, 0, 0.95 },
        { "plan", "min_photos", c->plan.min_photos, 1, 1e6 },
        { "plan", "max_tile_photos", c->plan.max_tile_photos, 0, 1e9 },
        { "plan", "max_tile_gb", (double)c->plan.max_tile_bytes / 1e9, 0, 1e6 },
        { "plan", "hold_out_every", c->plan.hold_out_every, 0, 1e6 },
        { "train", "steps", c->train.steps, 1, 1e8 },
        { "train", "samples_per_step", c->train.samples_per_step, 4096, 4194304 },
        { "train", "levels", c->train.levels, 1, 24 },
        { "train", "log2_table", c->train.log2_table, 8, 24 },
        { "train", "finest_resolution", c->train.finest_resolution, c->train.base_resolution, 1048576 },
        { "train", "march_step", c->train.march_step, 1e-4, 0.1 },
        { "train", "time_budget_s", c->train.time_budget_s, 0, 1e9 },
        { "train", "stop_gain_db", c->train.stop_gain_db, 0, 100 },
        { "train", "checkpoint_every_s", c->train.checkpoint_every_s, 0.01, 1e9 },
        { "train", "learning_rate", c->train.learning_rate, 1e-9, 10 },
        { "compose", "exponent", c->compose.exponent, 0, 64 },
        { "compose", "reach", c->compose.reach, 1e-3, 1e6 },
        { "compose", "max_tiles", c->compose.max_tiles, 1, CN_COMPOSE_MAX },
        { "compose", "min_visibility", c->compose.min_visibility, 0, 0.5 },
        { "render", "width_px", c->render_width_px, 16, 16384 },
        { "render", "frames", c->render_frames, 1, 1000000 },
        { "render", "fps", c->render_fps, 0.001, 1000 },
        { "render", "exposure_ev", c->exposure_ev, -64, 64 },
    };
    for (size_t i = 0; i < sizeof ranges / sizeof *ranges; i++)
        if (!(ranges[i].value >= ranges[i].least && ranges[i].value <= ranges[i].most))
            return cn_fail(CN_ERR_CONFIG, "%s:%u: %s.%s is %g; give %.10g to %.10g", s->path,
                           line_of(s, ranges[i].section, ranges[i].key), ranges[i].section, ranges[i].key,
                           ranges[i].value, ranges[i].least, ranges[i].most);
    return CN_OK;
}

static cn_status check(const cn_config *c, const source *s)
{
    if (!c->photos)
        return cn_fail(CN_ERR_CONFIG, "%s:%u: photos.folder is missing; name the folder that holds the photos", s->path,
                       line_of(s, "photos", "folder"));
    CN_TRY(check_ranges(c, s));
    if (c->plan.hold_out_every == 1)
        return cn_fail(CN_ERR_CONFIG,
                       "%s:%u: plan.hold_out_every is 1, which leaves no photo to train on; give 2 or more, or 0",
                       s->path, line_of(s, "plan", "hold_out_every"));
    if (c->plan.layout == CN_LAYOUT_CENTRES && !c->centres)
        return cn_fail(CN_ERR_CONFIG, "%s:%u: plan.layout is centres but plan.centres names no GeoJSON file", s->path,
                       line_of(s, "plan", "layout"));
    return CN_OK;
}

cn_status cn_config_load(cn_config *config, const char *folder)
{
    *config = (cn_config){ .width_px = 800,
                           .poses = cn_pose_options_default(),
                           .plan = cn_plan_options_default(),
                           .quality = CN_QUALITY_STANDARD,
                           .compose = cn_compose_options_default(),
                           .match = true,
                           .render_width_px = 640,
                           .render_frames = 48,
                           .render_fps = 24 };
    char *path = cn_path_join(folder, "city.yaml"), *text = NULL;
    size_t size = 0;
    cn_yaml_city *yaml = NULL;
    cn_status status = path ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK && !cn_file_exists(path))
        status =
            cn_fail(CN_ERR_USAGE, "%s is not a city: it has no city.yaml; make one with `conurb init %s --photos DIR`",
                    folder, folder);
    if (status == CN_OK) status = cn_file_read(path, 1 << 20, &text, &size);
    if (status == CN_OK) status = cn_yaml_parse(path, text, size, &yaml);
    if (status == CN_OK) {
        take(config, yaml, folder);
        status = check(config, &(source){ path, text, size });
    }
    if (yaml) cn_yaml_free(yaml);
    free(text);
    free(path);
    if (status != CN_OK) cn_config_deinit(config);
    return status;
}

void cn_config_deinit(cn_config *config)
{
    char *owned[] = { config->photos, config->import, config->view, config->look, config->colmap, config->centres };
    for (size_t i = 0; i < sizeof owned / sizeof *owned; i++)
        free(owned[i]);
    *config = (cn_config){ 0 };
}

cn_train_options cn_config_train(const cn_config *config, int quality, double time_budget_s)
{
    cn_train_options o = config->train;
    if (quality >= 0 && quality != (int)config->quality) {
        o = cn_train_options_preset((cn_quality)quality);
        o.seed = config->train.seed;
        o.checkpoint_every_s = config->train.checkpoint_every_s;
        o.stop_gain_db = config->train.stop_gain_db;
    }
    if (time_budget_s > 0) o.time_budget_s = time_budget_s;
    o.choose = o.choose && quality < 0 && o.time_budget_s > 0;
    return o;
}
