#include "synth/truth.h"

#include "base/file.h"
#include "base/json.h"

#include <stdlib.h>
#include <string.h>

enum { VERSION = 1 };

char *cn_truth_path(const char *out, const char *folder, const char *name, const char *ending)
{
    const char *dot = strrchr(name, '.');
    return cn_format("%s/%s/%.*s%s", out, folder, (int)(dot ? dot - name : (long)strlen(name)), name, ending);
}

static cn_status make_folder(const char *out, const char *name)
{
    char *path = cn_path_join(out, name);
    if (!path) return cn_fail(CN_ERR_NOMEM, "out of memory");
    const cn_status status = cn_folder_make(path);
    free(path);
    return status;
}

cn_status cn_truth_begin(const char *out)
{
    char *photos = cn_path_join(out, "photos");
    if (!photos) return cn_fail(CN_ERR_NOMEM, "out of memory");
    const bool there = cn_file_exists(photos);
    free(photos);
    if (there) return cn_fail(CN_ERR_USAGE, "%s/photos is there already; give another folder, or remove it", out);
    CN_TRY(make_folder(out, "photos"));
    CN_TRY(make_folder(out, "truth/views"));
    return make_folder(out, "truth/masks");
}

/* A scene that borrows the names of the shots; only its arrays are its own. */
static cn_status scene_of(const cn_rig *rig, cn_scene *scene)
{
    *scene = (cn_scene){ .cameras = (cn_camera *)rig->cameras, .n_cameras = CN_RIG_CAMERAS, .n_views = rig->n_shots };
    scene->views = calloc(rig->n_shots, sizeof *scene->views);
    if (!scene->views) return cn_fail(CN_ERR_NOMEM, "out of memory for %u poses", rig->n_shots);
    for (uint32_t i = 0; i < rig->n_shots; i++) {
        cn_view *view = &scene->views[i];
        *view = (cn_view){ .name = rig->shots[i].name, .camera = rig->shots[i].camera, .photo = i };
        memcpy(view->rotation, rig->shots[i].rotation, sizeof view->rotation);
        memcpy(view->translation, rig->shots[i].translation, sizeof view->translation);
    }
    return CN_OK;
}

static cn_status write_model(const char *out, const cn_world *world, const cn_rig *rig)
{
    cn_scene scene;
    char *folder = cn_path_join(out, "truth/model");
    cn_status status = folder ? scene_of(rig, &scene) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) {
        status = cn_truth_points(world, rig, &scene);
        if (status == CN_OK) status = cn_scene_write_colmap(&scene, folder);
        free(scene.views);
        free(scene.points);
        free(scene.observations);
    }
    free(folder);
    return status;
}

static cn_status save(json_t *root, const char *out, const char *name)
{
    char *path = cn_path_join(out, name);
    const cn_status status =
        path && root ? cn_json_save(root, path) : cn_fail(CN_ERR_NOMEM, "out of memory while writing %s", name);
    free(path);
    json_decref(root);
    return status;
}

static void put(json_t *object, const char *key, double value)
{
    json_object_set_new(object, key, cn_json_real(value));
}

/* world_from_cam with OpenGL's camera: y up, z backward. */
static json_t *matrix_of(const cn_shot *shot)
{
    json_t *rows = json_array();
    for (int i = 0; i < 3; i++)
        json_array_append_new(rows, cn_json_reals((double[4]){ shot->rotation[i], -shot->rotation[3 + i],
                                                               -shot->rotation[6 + i], shot->centre[i] },
                                                  4));
    json_array_append_new(rows, cn_json_reals((double[4]){ 0, 0, 0, 1 }, 4));
    return rows;
}

static void put_lens(json_t *frame, const cn_camera *c)
{
    const bool opencv = c->lens == CN_LENS_OPENCV;
    const double *p = c->params + (opencv ? 1 : 0); /* fy or f, cx, cy, k1, ... */
    put(frame, "fl_x", c->params[0]);
    put(frame, "fl_y", p[0]);
    put(frame, "cx", p[1]);
    put(frame, "cy", p[2]);
    put(frame, "k1", p[3]);
    put(frame, "k2", opencv ? p[4] : 0);
    put(frame, "p1", opencv ? p[5] : 0);
    put(frame, "p2", opencv ? p[6] : 0);
}

static json_t *transforms_of(const cn_rig *rig)
{
    json_t *root = json_object(), *frames = json_array();
    for (uint32_t i = 0; i < rig->n_shots; i++) {
        const cn_shot *shot = &rig->shots[i];
        const cn_camera *c = &rig->cameras[shot->camera];
        const bool sphere = c->lens == CN_LENS_EQUIRECTANGULAR;
        char *file = cn_format("../photos/%s", shot->name);
        json_t *frame = json_pack("{s:s, s:s, s:i, s:i}", "file_path", file ? file : "", "camera_model",
                                  sphere ? "EQUIRECTANGULAR" : "OPENCV", "w", (int)c->width, "h", (int)c->height);
        free(file);
        if (!sphere) put_lens(frame, c);
        json_object_set_new(frame, "transform_matrix", matrix_of(shot));
        json_array_append_new(frames, frame);
    }
    json_object_set_new(root, "camera_model", json_string("OPENCV"));
    json_object_set_new(root, "frames", frames);
    return root;
}

static json_t *options_json(const cn_synth_options *o)
{
    json_t *root =
        json_pack("{s:I, s:i, s:i, s:i, s:i, s:b, s:b, s:b, s:b}", "seed", (json_int_t)o->seed, "photos",
                  (int)o->n_photos, "runs", (int)o->n_runs, "width", (int)o->width, "height", (int)o->height, "plain",
                  (int)o->plain, "empty", (int)o->empty, "sphere", (int)o->sphere, "survey", (int)o->survey);
    put(root, "size_m", o->size_m);
    put(root, "aerial", o->aerial);
    put(root, "gps_noise_m", o->gps_noise_m);
    put(root, "exposure_spread_ev", o->exposure_spread_ev);
    put(root, "latitude_deg", o->latitude_deg);
    put(root, "longitude_deg", o->longitude_deg);
    put(root, "altitude_m", o->altitude_m);
    return root;
}

static json_t *run_json(const cn_light *l)
{
    json_t *run = json_pack("{s:s, s:I}", "name", l->name, "start_s", (json_int_t)l->start_s);
    put(run, "sun_elevation_deg", l->sun_elevation_deg);
    put(run, "sun_azimuth_deg", l->sun_azimuth_deg);
    json_object_set_new(run, "sun", cn_json_reals((double[3]){ l->sun[0], l->sun[1], l->sun[2] }, 3));
    json_object_set_new(run, "lamps", json_boolean(l->lamp > 0));
    return run;
}

static json_t *photo_json(const cn_shot *s)
{
    json_t *photo =
        json_pack("{s:s, s:i, s:b}", "name", s->name, "run", (int)s->run, "aerial", s->camera == CN_RIG_AERIAL);
    json_object_set_new(photo, "centre_m", cn_json_reals(s->centre, 3));
    json_object_set_new(photo, "exif_lat_lon_alt", cn_json_reals(s->gps, 3));
    json_object_set_new(photo, "white_balance", cn_json_reals(s->balance, 3));
    put(photo, "gain", s->gain);
    put(photo, "exposure_s", s->exposure_s);
    put(photo, "iso", s->iso);
    put(photo, "f_number", s->f_number);
    return photo;
}

static json_t *truth_json(const cn_world *world, const cn_rig *rig)
{
    json_t *root = json_pack("{s:i}", "version", VERSION), *runs = json_array(), *photos = json_array();
    for (uint32_t i = 0; i < world->n_lights; i++)
        json_array_append_new(runs, run_json(&world->lights[i]));
    for (uint32_t i = 0; i < rig->n_shots; i++)
        json_array_append_new(photos, photo_json(&rig->shots[i]));
    json_object_set_new(root, "options", options_json(&world->options));
    json_object_set_new(root, "runs", runs);
    json_object_set_new(root, "photos", photos);
    put(root, "reference_ev", CN_SYNTH_REFERENCE_EV);
    return root;
}

cn_status cn_truth_finish(const char *out, const cn_world *world, const cn_rig *rig)
{
    cn_frame frame;
    cn_rig_frame(&world->options, &frame);
    char *path = cn_path_join(out, "truth/frame.json");
    const cn_status status = path ? cn_frame_save(&frame, path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(path);
    CN_TRY(status);
    CN_TRY(write_model(out, world, rig));
    CN_TRY(save(transforms_of(rig), out, "truth/transforms.json"));
    return save(truth_json(world, rig), out, "truth/truth.json");
}

static cn_status integer(const json_t *from, const char *path, const char *key, int64_t most, uint64_t *value)
{
    int64_t n = 0;
    CN_TRY(cn_json_integer(from, path, key, &n));
    if (n < 0 || n > most) return cn_fail(CN_ERR_FORMAT, "%s: %s is out of range", path, key);
    *value = (uint64_t)n;
    return CN_OK;
}

static cn_status read_options(const json_t *root, const char *path, cn_synth_options *o)
{
    const json_t *from = json_object_get(root, "options");
    const struct {
        const char *key;
        uint32_t *value;
    } whole[] = {
        { "photos", &o->n_photos }, { "runs", &o->n_runs }, { "width", &o->width }, { "height", &o->height }
    };
    const struct {
        const char *key;
        double *value;
    } real[] = { { "size_m", &o->size_m },
                 { "aerial", &o->aerial },
                 { "gps_noise_m", &o->gps_noise_m },
                 { "exposure_spread_ev", &o->exposure_spread_ev },
                 { "latitude_deg", &o->latitude_deg },
                 { "longitude_deg", &o->longitude_deg },
                 { "altitude_m", &o->altitude_m } };
    uint64_t n = 0;
    CN_TRY(integer(root, path, "version", INT64_MAX, &n));
    if (n > VERSION) return cn_fail(CN_ERR_VERSION, "%s was made by a newer conurb-synth; use that one", path);
    CN_TRY(integer(from, path, "seed", INT64_MAX, &o->seed));
    for (size_t i = 0; i < sizeof whole / sizeof *whole; i++) {
        CN_TRY(integer(from, path, whole[i].key, UINT32_MAX, &n));
        *whole[i].value = (uint32_t)n;
    }
    for (size_t i = 0; i < sizeof real / sizeof *real; i++)
        CN_TRY(cn_json_number(from, path, real[i].key, real[i].value));
    CN_TRY(cn_json_bool(from, path, "plain", &o->plain));
    CN_TRY(cn_json_bool(from, path, "empty", &o->empty));
    o->survey = json_is_true(json_object_get(from, "survey"));
    o->sphere = json_is_true(json_object_get(from, "sphere"));
    return cn_synth_options_check(o);
}

cn_status cn_truth_load(const char *out, cn_synth_options *options)
{
    json_t *root = NULL;
    char *path = cn_path_join(out, "truth/truth.json");
    if (!path) return cn_fail(CN_ERR_NOMEM, "out of memory");
    cn_status status = cn_file_exists(path)
                           ? cn_json_load(path, &root)
                           : cn_fail(CN_ERR_IO, "%s is not there: make the city first (conurb-synth %s)", path, out);
    if (status == CN_OK) status = read_options(root, path, options);
    json_decref(root);
    free(path);
    return status;
}
