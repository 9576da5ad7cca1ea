#include "view/facts.h"

#include "base/file.h"
#include "base/json.h"
#include "base/units.h"
#include "appearance/spec.h"
#include "conurb/batch.h"
#include "effect/runs.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

static json_t *frame_facts(const cn_frame *f)
{
    return json_pack("{s:b, s:f, s:f, s:f, s:f, s:s}", "georeferenced", (int)f->georeferenced, "latitude_deg",
                     f->latitude_deg, "longitude_deg", f->longitude_deg, "height_m", f->height_m, "geoid_height_m",
                     f->geoid_height_m, "unit", cn_frame_unit(f));
}

static json_t *tile_facts(const cn_plan_tile *t)
{
    return json_pack("{s:s, s:o, s:f, s:i, s:i, s:o, s:o}", "id", t->id, "centre", cn_json_reals(t->centre, 3),
                     "radius_m", t->radius_m, "photos", (int)t->n_photos, "held_out", (int)t->n_held_out, "low",
                     cn_json_reals(t->bounds_min, 3), "high", cn_json_reals(t->bounds_max, 3));
}

static json_t *view_facts(const cn_dataset *d, uint32_t i, bool held_out)
{
    const cn_view *v = &d->scene.views[i];
    const cn_camera *c = &d->scene.cameras[v->camera];
    const double vfov = cn_camera_vfov_deg(c);
    double centre[3];
    cn_view_centre(v, centre);
    json_t *out = json_pack("{s:s, s:o, s:o, s:f, s:f, s:b}", "name", v->name, "centre", cn_json_reals(centre, 3),
                            "rotation", cn_json_reals(v->rotation, 9), "vfov_deg", vfov, "aspect",
                            (double)c->width / c->height, "held_out", (int)held_out);
    if (v->photo < d->photos.n_photos && isfinite(d->photos.photos[v->photo].time_s))
        json_object_set_new(out, "time_s", json_real(d->photos.photos[v->photo].time_s));
    return out;
}

/* Marks the views that any tile holds out. */
static bool *held_out_views(const cn_dataset *d)
{
    bool *held = calloc(d->scene.n_views + 1u, sizeof *held);
    for (uint32_t t = 0; held && t < d->plan.n_tiles; t++)
        for (uint32_t i = 0; i < d->plan.tiles[t].n_held_out; i++)
            if (d->plan.tiles[t].held_out[i] < d->scene.n_views) held[d->plan.tiles[t].held_out[i]] = true;
    return held;
}

static json_t *views_facts(const cn_dataset *d)
{
    json_t *list = json_array();
    bool *held = held_out_views(d);
    const uint32_t n = d->scene.n_views, step = n / CN_FACTS_VIEWS + 1;
    for (uint32_t i = 0; i < n; i += step)
        json_array_append_new(list, view_facts(d, i, held && held[i]));
    free(held);
    return list;
}

static json_t *texts(const char *const *list)
{
    json_t *out = json_array();
    for (; list && *list; list++)
        json_array_append_new(out, json_string(*list));
    return out;
}

/* Adds to each of the page's views the number of its capture run, where the photos are of several. */
static void number_runs(const cn_dataset *d, json_t *views)
{
    const uint32_t n = d->scene.n_views;
    float *runs = malloc((n + (size_t)1) * sizeof *runs);
    for (uint32_t i = 0; i < n && runs; i++) {
        const uint32_t photo = d->scene.views[i].photo;
        runs[i] = photo < d->photos.n_photos ? cn_run_time(&d->photos.photos[photo]) : NAN;
    }
    const bool several = runs && n && cn_runs_find(runs, 1, n) > 1;
    for (size_t k = 0; several && k < json_array_size(views); k++)
        json_object_set_new(json_array_get(views, k), "run",
                            json_integer((json_int_t)runs[k * (n / CN_FACTS_VIEWS + 1)]));
    free(runs);
}

/* By id, the time of the file of each tile that can be shown, as text: its digits matter, because a tile that was
 * replaced is drawn again. */
static json_t *trained_facts(const cn_city *city, const cn_dataset *d)
{
    json_t *out = json_object();
    for (uint32_t i = 0; i < d->plan.n_tiles; i++) {
        struct stat file, done;
        char *unfinished = cn_format("%s/tiles/%s/" CN_TILE_UNFINISHED, city->folder, d->plan.tiles[i].id);
        char *path = cn_format("%s/tiles/%s/tile.safetensors", city->folder, d->plan.tiles[i].id);
        char *mark = cn_format("%s/tiles/%s/DONE", city->folder, d->plan.tiles[i].id);
        if ((unfinished && stat(unfinished, &file) == 0) ||
            (path && mark && stat(path, &file) == 0 && stat(mark, &done) == 0))
            json_object_set_new(out, d->plan.tiles[i].id,
                                json_sprintf("%lld.%09ld", (long long)file.st_mtim.tv_sec, (long)file.st_mtim.tv_nsec));
        free(unfinished);
        free(path);
        free(mark);
    }
    return out;
}

json_t *cn_facts_city(const cn_city *city, const cn_dataset *d, const cn_colour *colour)
{
    json_t *blends = json_array();
    for (int i = CN_BLEND_NEAREST; i <= CN_BLEND_OWNERSHIP; i++)
        json_array_append_new(blends, json_string(cn_blend_name((cn_blend)i)));
    json_t *tiles = json_array();
    for (uint32_t i = 0; i < d->plan.n_tiles; i++)
        json_array_append_new(tiles, tile_facts(&d->plan.tiles[i]));
    char *absolute = NULL;
    const char *folder = cn_path_absolute(city->folder, &absolute) == CN_OK ? absolute : city->folder;
    json_t *out =
        json_pack("{s:s, s:s, s:o, s:o, s:o, s:o, s:o, s:o, s:i, s:i, s:b, s:s}", "name", cn_path_base(folder),
                  "version", cn_version(), "frame", frame_facts(&d->frame), "tiles", tiles, "views", views_facts(d),
                  "blends", blends, "display_views", texts(cn_colour_views(colour)), "named",
                  cn_appearance_lights(city), "points", (int)d->scene.n_points, "n_views", (int)d->scene.n_views,
                  "pixels", d->pixels != NULL, "blend", cn_blend_name(city->config.compose.scheme));
    free(absolute);
    if (out) number_runs(d, json_object_get(out, "views"));
    if (out) json_object_set_new(out, "trained", trained_facts(city, d));
    if (out) json_object_set_new(out, "looks", texts(cn_colour_looks(colour)));
    if (out && city->config.view) json_object_set_new(out, "display_view", json_string(city->config.view));
    return out;
}

/* ---- a tile ---- */

static json_t *effects_facts(const cn_plan_tile *t)
{
    json_t *list = json_array();
    for (uint32_t i = 0; i < t->n_effects; i++) {
        const cn_plan_effect *e = &t->effects[i];
        json_array_append_new(list, json_pack("{s:s, s:b, s:o, s:o, s:s}", "name", e->name, "on", (int)e->on,
                                              "evidence", cn_json_real(e->evidence), "threshold",
                                              cn_json_real(e->threshold), "reason", e->reason));
    }
    return list;
}

static json_t *names_of(const cn_dataset *d, const uint32_t *views, uint32_t n)
{
    json_t *list = json_array();
    for (uint32_t i = 0; i < n && i < CN_FACTS_VIEWS; i++)
        if (views[i] < d->scene.n_views) json_array_append_new(list, json_string(d->scene.views[views[i]].name));
    return list;
}

static void add_curve_point(json_t *curve, const json_t *line)
{
    static const char *const keys[] = { "step", "psnr", "samples_per_s" };
    if (!json_is_number(json_object_get(line, "step")) || !json_is_number(json_object_get(line, "psnr"))) return;
    for (size_t k = 0; k < sizeof keys / sizeof *keys; k++) {
        json_t *value = json_object_get(line, keys[k]);
        json_array_append(json_object_get(curve, keys[k]), value ? value : json_null());
    }
}

/* Every n-th line of a tile's log. */
static json_t *curve_facts(const char *log)
{
    char *text = NULL;
    size_t size, n_lines = 0, i = 0;
    json_t *curve = json_pack("{s:[], s:[], s:[]}", "step", "psnr", "samples_per_s");
    if (!cn_file_exists(log) || cn_file_read(log, 64 << 20, &text, &size) != CN_OK) return curve;
    for (const char *c = text; *c; c++)
        n_lines += *c == '\n';
    const size_t step = n_lines / CN_FACTS_CURVE + 1;
    char *rest = text;
    for (char *line; (line = strsep(&rest, "\n")) != NULL && rest; i++) {
        if (i % step && i + 1 < n_lines) continue;
        json_t *root = json_loads(line, 0, NULL);
        add_curve_point(curve, root);
        json_decref(root);
    }
    free(text);
    return curve;
}

static json_t *load_optional(const char *path)
{
    json_t *root = NULL;
    return cn_file_exists(path) && cn_json_load(path, &root) == CN_OK ? root : json_null();
}

cn_status cn_facts_tile(const cn_city *city, const cn_dataset *d, const char *id, json_t **out)
{
    *out = NULL;
    const int64_t index = cn_plan_find(&d->plan, id);
    if (index < 0) return cn_fail(CN_ERR_USAGE, "the plan has no tile '%s'", id);
    const cn_plan_tile *t = &d->plan.tiles[index];
    char *log = cn_format("%s/tiles/%s/log.jsonl", city->folder, t->id);
    char *metrics = cn_format("%s/tiles/%s/metrics.json", city->folder, t->id);
    if (log && metrics)
        *out =
            json_pack("{s:s, s:o, s:o, s:o, s:o, s:o, s:f, s:f}", "name", t->id, "effects", effects_facts(t), "photos",
                      names_of(d, t->photos, t->n_photos), "held_out", names_of(d, t->held_out, t->n_held_out), "curve",
                      curve_facts(log), "metrics", load_optional(metrics), "near_m", t->near_m, "far_m", t->far_m);
    free(log);
    free(metrics);
    return *out ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the facts of tile %s", id);
}

cn_status cn_facts_points(const cn_dataset *d, uint8_t **bytes, size_t *size, uint32_t *n)
{
    enum { STRIDE = 16 };
    const uint32_t step = d->scene.n_points / CN_FACTS_POINTS + 1;
    *n = (d->scene.n_points + step - 1) / step;
    *size = (size_t)*n * STRIDE;
    uint8_t *at = *bytes = calloc(*n + 1u, STRIDE);
    if (!at) return cn_fail(CN_ERR_NOMEM, "out of memory for %u points", *n);
    for (uint32_t i = 0; i < d->scene.n_points; i += step, at += STRIDE) {
        const cn_point *p = &d->scene.points[i];
        const float xyz[3] = { (float)p->xyz[0], (float)p->xyz[1], (float)p->xyz[2] };
        memcpy(at, xyz, sizeof xyz);
        memcpy(at + sizeof xyz, p->rgb, sizeof p->rgb);
    }
    return CN_OK;
}

/* ---- while it trains ---- */

cn_status cn_facts_state(const cn_context *ctx, cn_city *city, const cn_dataset *d, json_t **out)
{
    cn_city_state state;
    char *text = NULL;
    *out = NULL;
    CN_TRY(cn_city_state_read(ctx, city, &state));
    const cn_status status = cn_city_state_json(&state, &text);
    cn_city_state_deinit(&state);
    if (status != CN_OK) return status;
    json_t *rows = json_loads(text, 0, NULL);
    free(text);
    *out = json_pack("{s:o, s:o}", "state", rows ? rows : json_null(), "trained", trained_facts(city, d));
    return *out ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the state of the city");
}
