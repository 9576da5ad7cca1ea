#include "job/film.h"
#include "job/gallery.h"
#include "job/survey.h"

#include "base/file.h"
#include "base/json.h"
#include "bridge/oiio.h"
#include "conurb/colour.h"
#include "math/linalg.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

typedef struct render_job {
    const cn_context *ctx; cn_city *city; const cn_city_render_options *options;
    cn_material m; cn_gallery gallery; cn_path path; cn_colour *colour;
    cn_render_options render; cn_light *lights; uint32_t n_lights;
    const char *view, *look; double exposure_ev;
    char *out;
    uint64_t key; /* of everything that a frame depends on */
    uint64_t film; /* of the frames so far */
} render_job;

static double now_s(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* A photo's own view at the render's width. */
static cn_status photo_path(render_job *j, uint32_t width)
{
    const int64_t photo = cn_photo_index_find(&j->m.photos, j->options->photo);
    for (uint32_t i = 0; photo >= 0 && i < j->m.scene.n_views; i++) {
        const cn_view *v = &j->m.scene.views[i];
        if (v->photo != (uint32_t)photo) continue;
        const cn_camera *c = &j->m.scene.cameras[v->camera];
        j->path.frames = calloc(1, sizeof *j->path.frames);
        if (!j->path.frames) return cn_fail(CN_ERR_NOMEM, "out of memory");
        j->path.n_frames = 1;
        j->path.fps = 24;
        cn_camera_resize(c, width, (uint32_t)fmax(1, round((double)c->height * width / c->width)), &j->path.frames[0].camera);
        j->path.frames[0].view = *v;
        j->path.frames[0].view.name = strdup(v->name);
        return CN_OK;
    }
    return cn_fail(CN_ERR_USAGE, "photo '%s' has no pose; see photos.json and poses/ for those that have", j->options->photo);
}

/* The picture's height keeps the shape of the first photo. */
static uint32_t height_for(const render_job *j, uint32_t width)
{
    const cn_camera *c = &j->m.scene.cameras[j->m.scene.views[0].camera];
    /* Even, so that a video encoder takes it. */
    return (uint32_t)fmax(2, round((double)c->height * width / c->width / 2)) * 2;
}

/* A file of that name is "./photos". */
static bool by_photos(const render_job *j) { return j->options->path && strcmp(j->options->path, "photos") == 0; }

static cn_status choose_path(render_job *j)
{
    const cn_config *c = &j->city->config;
    const uint32_t width = j->options->width_px ? j->options->width_px : c->render_width_px;
    const uint32_t frames = j->options->n_frames ? j->options->n_frames : c->render_frames;
    if (j->options->photo) return photo_path(j, width);
    if (!j->m.scene.n_views) return cn_fail(CN_ERR_DATA, "no photo has a pose; there is nothing to fly over");
    cn_path_options o = cn_path_options_default();
    o.frame = &j->m.frame;
    o.width = width;
    o.height = height_for(j, width);
    o.n_frames = j->options->n_frames;
    o.fps = c->render_fps;
    cn_city_sounder sounder = {j->ctx, j->city, &j->m};
    o.sound = cn_city_sound;
    o.sound_user = &sounder;
    if (j->options->height_m != 0) o.height_m = j->options->height_m;
    if (j->options->path && !by_photos(j)) return cn_path_load(&j->path, j->options->path, &o);
    o.n_frames = frames;
    if (j->options->orbit) return cn_path_orbit(&j->path, j->options->orbit, &o);
    if (j->options->path) return cn_path_photos(&j->path, &j->m.scene, &o);
    CN_TRY(cn_path_default(&j->path, &j->m.scene, frames, width, height_for(j, width)));
    j->path.fps = c->render_fps;
    return CN_OK;
}

static char *out_folder(const render_job *j)
{
    if (j->options->out) return cn_format("%s", j->options->out);
    const char *base = j->options->photo ? j->options->photo : j->options->orbit ? "orbit" : j->options->path ? cn_path_base(j->options->path) : "flight";
    char name[256];
    snprintf(name, sizeof name, "%s", base);
    if (j->options->sequence) snprintf(name, sizeof name, "relit-%s", base);
    for (char *p = name; *p; p++)
        if (*p == '/') *p = '_';
    char *dot = strrchr(name, '.');
    if (dot && dot != name) *dot = 0;
    char *relative = cn_path_join("renders", name), *path = relative ? cn_city_path(j->city, relative) : NULL;
    free(relative);
    return path;
}

static cn_status frame_key(render_job *j)
{
    uint64_t key = 0;
    for (uint32_t i = 0; i < j->gallery.n; i++) {
        char relative[128];
        snprintf(relative, sizeof relative, "tiles/%s/stage.json", j->m.plan.tiles[j->gallery.which[i]].id);
        char *path = cn_city_path(j->city, relative), *text = NULL;
        size_t size;
        if (!path) return cn_fail(CN_ERR_NOMEM, "out of memory");
        if (cn_file_read(path, 1 << 20, &text, &size) == CN_OK) key = cn_hash_text(key, "%s", text);
        free(text);
        free(path);
    }
    const cn_compose_options *c = &j->city->config.compose;
    j->key = cn_hash_text(key, "%s|%s|%.9g|%.9g|%.9g|%u", j->view ? j->view : "", j->look ? j->look : "", j->exposure_ev,
                          c->exponent, c->reach, c->max_tiles);
    return CN_OK;
}

static cn_status write_frame(const render_job *j, const cn_path_frame *frame, const char *appearance, const cn_picture *picture, const char *exr, const char *png)
{
    double centre[3], geo[3];
    char software[32];
    snprintf(software, sizeof software, "Conurb %s", cn_version());
    cn_view_centre(&frame->view, centre);
    const bool placed = j->m.frame.georeferenced && cn_frame_to_geodetic(&j->m.frame, centre, geo) == CN_OK;
    const cn_oiio_attribute attributes[] = {
        {"Software", software, NULL, 0},
        {"conurb:appearance", appearance, NULL, 0},
        {"conurb:camera_centre_m", NULL, centre, 3},
        {"conurb:cam_from_world", NULL, frame->view.rotation, 9},
        {"conurb:camera_params", NULL, frame->camera.params, 8},
        {"conurb:frames_per_second", NULL, &j->path.fps, 1},
        /* Doubles as text: floats would lose metres. */
        {placed ? "conurb:latitude_longitude_height" : NULL, "", NULL, 0},
        {NULL, NULL, NULL, 0},
    };
    cn_oiio_attribute list[sizeof attributes / sizeof *attributes];
    memcpy(list, attributes, sizeof list);
    char place[96];
    snprintf(place, sizeof place, "%.9f %.9f %.4f", placed ? geo[0] : 0, placed ? geo[1] : 0, placed ? geo[2] : 0);
    if (placed) list[6].text = place;
    CN_TRY(cn_oiio_write_exr(exr, picture->rgba, picture->depth, picture->width, picture->height, list));
    const size_t n = (size_t)picture->width * picture->height;
    float *display = malloc(n * 4 * sizeof *display);
    if (!display) return cn_fail(CN_ERR_NOMEM, "out of memory while writing %s", png);
    memcpy(display, picture->rgba, n * 4 * sizeof *display);
    cn_status status = cn_colour_to_display(j->colour, j->view, j->look, j->exposure_ev, display, n, 4);
    for (size_t i = 0; i < n; i++)
        for (int c = 0; c < 3; c++) display[3 * i + (size_t)c] = display[4 * i + (size_t)c];
    if (status == CN_OK) status = cn_oiio_write_png(png, display, picture->width, picture->height, 3, list);
    free(display);
    return status;
}

static cn_status render_frame(render_job *j, uint32_t i)
{
    const cn_path_frame *frame = &j->path.frames[i];
    char name[32], record[64];
    snprintf(name, sizeof name, "%05u", i);
    snprintf(record, sizeof record, "%s.json", name);
    char *exr = cn_format("%s/%s.exr", j->out, name), *png = cn_format("%s/%s.png", j->out, name), *mark = cn_path_join(j->out, record);
    char appearance[640];
    const cn_light light = cn_light_at(j->lights, j->n_lights, i, j->path.n_frames);
    cn_light_describe(&light, appearance, sizeof appearance);
    uint64_t key = cn_light_hash(&light, cn_hash_text(j->key, "%u %u", frame->camera.width, frame->camera.height));
    for (int a = 0; a < 3; a++) key = cn_hash_text(key, "%.17g %.17g", frame->view.translation[a], frame->camera.params[a]);
    for (int a = 0; a < 9; a++) key = cn_hash_text(key, "%.17g", frame->view.rotation[a]);
    char wanted[32], *have = NULL;
    size_t size;
    j->film = cn_hash_text(j->film, "%016llx", (unsigned long long)key);
    snprintf(wanted, sizeof wanted, "%016llx\n", (unsigned long long)key);
    cn_status status = exr && png && mark ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    const bool done = status == CN_OK && cn_file_exists(exr) && cn_file_exists(png) && cn_file_exists(mark) &&
                      cn_file_read(mark, 64, &have, &size) == CN_OK && strcmp(have, wanted) == 0;
    cn_picture picture = {0};
    if (status == CN_OK && !done) status = cn_picture_init(&picture, frame->camera.width, frame->camera.height);
    if (status == CN_OK && !done) status = cn_gallery_view(&j->gallery, j->ctx, &frame->camera, &frame->view, &j->render, &light, &picture, NULL);
    if (status == CN_OK && !done) status = write_frame(j, frame, appearance, &picture, exr, png);
    if (status == CN_OK && !done) status = cn_file_write(mark, wanted, strlen(wanted)); /* last: the frame is whole */
    cn_picture_deinit(&picture);
    free(have);
    free(exr);
    free(png);
    free(mark);
    return status;
}

/* A sequence of lights in one photo's view is that view, again and again. */
static cn_status hold_view(render_job *j)
{
    const uint32_t n = j->options->n_frames ? j->options->n_frames : j->city->config.render_frames;
    if (!j->options->sequence || j->path.n_frames != 1 || n < 2) return CN_OK;
    cn_path_frame *frames = calloc(n, sizeof *frames);
    if (!frames) return cn_fail(CN_ERR_NOMEM, "out of memory for %u frames", n);
    for (uint32_t i = 0; i < n; i++) {
        frames[i] = j->path.frames[0];
        frames[i].time_s = i / j->path.fps;
        frames[i].view.name = i ? cn_format("frame_%05u", i) : j->path.frames[0].view.name;
    }
    free(j->path.frames);
    j->path.frames = frames;
    j->path.n_frames = n;
    return CN_OK;
}

static cn_status render_all(render_job *j)
{
    CN_TRY(cn_gallery_init(&j->gallery, j->ctx, j->city, &j->m));
    CN_TRY(choose_path(j));
    CN_TRY(cn_colour_create(&j->colour, NULL));
    CN_TRY(frame_key(j));
    j->out = out_folder(j);
    if (!j->out) return cn_fail(CN_ERR_NOMEM, "out of memory");
    CN_TRY(hold_view(j));
    CN_TRY(cn_folder_make(j->out));
    const double started = now_s();
    for (uint32_t i = 0; i < j->path.n_frames; i++) {
        if (cn_stopping(j->ctx)) return cn_fail(CN_ERR_INTERRUPTED, "stopped at frame %u; run the same command to go on", i);
        CN_TRY(render_frame(j, i));
        const double elapsed = now_s() - started, done = i + 1.0;
        const cn_progress_report report = {"render", NULL, done, j->path.n_frames, elapsed, elapsed / done * (j->path.n_frames - done), NULL};
        cn_progress(j->ctx, &report);
    }
    cn_log(j->ctx, CN_LOG_INFO, "%u frames in %s", j->path.n_frames, j->out);
    return cn_film_make(j->ctx, j->out, j->path.n_frames, j->path.fps, j->film);
}

static cn_status parse_lights(render_job *j)
{
    const cn_city_render_options *o = j->options;
    if (o->appearance && o->sequence) return cn_fail(CN_ERR_USAGE, "an appearance and a sequence of them exclude each other; give one");
    if (o->sequence) return cn_lights_parse(&j->lights, &j->n_lights, o->sequence, j->city, &j->m.photos);
    j->lights = calloc(1, sizeof *j->lights);
    if (!j->lights) return cn_fail(CN_ERR_NOMEM, "out of memory");
    j->n_lights = 1;
    return cn_light_parse(&j->lights[0], o->appearance, j->city, &j->m.photos);
}

cn_status cn_city_render(const cn_context *ctx, cn_city *city, const cn_city_render_options *options)
{
    if ((options->path != NULL) + (options->photo != NULL) + (options->orbit != NULL) > 1)
        return cn_fail(CN_ERR_USAGE, "--path, --photo and --orbit exclude each other; give one");
    render_job j = {.ctx = ctx, .city = city, .options = options, .render = cn_render_options_default()};
    j.view = options->view ? options->view : city->config.view;
    j.look = options->look ? options->look : city->config.look;
    j.exposure_ev = city->config.exposure_ev + options->exposure_ev;
    CN_TRY(cn_material_load(ctx, city, true, &j.m));
    cn_status status = parse_lights(&j);
    if (status == CN_OK) status = render_all(&j);
    cn_lights_free(j.lights, j.n_lights);
    cn_path_deinit(&j.path);
    cn_colour_destroy(&j.colour);
    cn_gallery_deinit(&j.gallery);
    cn_material_deinit(&j.m);
    free(j.out);
    return status;
}
