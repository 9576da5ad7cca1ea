#include "stage/film.h"
#include "city/lock.h"
#include "renderer/renderer.h"
#include "stage/aov_files.h"
#include "stage/camera_path.h"
#include "stage/old_frames.h"

#include "base/clock.h"
#include "base/file.h"
#include "base/hash.h"
#include "base/json.h"
#include "base/number.h"
#include "bridge/oiio.h"
#include "conurb/colour.h"
#include "math/linalg.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct render_job {
    const cn_context *ctx;
    cn_city *city;
    const cn_city_render_options *options;
    cn_dataset m;
    cn_renderer *renderer;
    cn_path path;
    cn_colour *colour;
    cn_render_options render;
    cn_appearance_spec *specs;
    uint32_t n_specs;
    const char *view, *look;
    double exposure_ev;
    char *out;
    bool look_only; /* check only; render nothing */
    uint64_t key;   /* hash of everything that a frame depends on */
} render_job;

/* Whether the light changes along the frames. */
static bool relights(const cn_city_render_options *o)
{
    return o->sequence || o->from;
}

static char *out_folder(const render_job *j)
{
    if (j->options->out) return cn_format("%s", j->options->out);
    const char *base = j->options->photo   ? j->options->photo
                       : j->options->orbit ? "orbit"
                       : j->options->path  ? cn_path_base(j->options->path)
                                           : "flight";
    char *relative = cn_format("renders/%s%s", relights(j->options) ? "relit-" : "", base);
    /* The name keeps the photo's folder and extension, so that no two photos share a folder. */
    char *dot = relative && !j->options->photo ? strrchr(relative, '.') : NULL;
    if (dot && dot[-1] != '/') *dot = '\0';
    char *path = relative ? cn_city_path(j->city, relative) : NULL;
    free(relative);
    return path;
}

static cn_status frame_key(render_job *j)
{
    uint64_t key = 0;
    CN_TRY(cn_colour_config_hash(NULL, &key));
    for (uint32_t i = 0; i < j->renderer->tiles.n; i++) {
        char relative[128];
        snprintf(relative, sizeof relative, "tiles/%s/DONE", j->m.plan.tiles[j->renderer->tiles.which[i]].id);
        char *path = cn_city_path(j->city, relative), *text = NULL;
        size_t size;
        if (!path) return cn_fail(CN_ERR_NOMEM, "out of memory");
        if (cn_file_read(path, 1 << 20, &text, &size) == CN_OK) key = cn_hash_text(key, "%s", text);
        free(text);
        free(path);
    }
    const cn_compose_options *c = &j->renderer->tiles.compose;
    j->key = cn_hash_text(key, "%s|%s|%.9g|%s|%.9g|%.9g|%u|%.9g|%d", j->view ? j->view : "", j->look ? j->look : "",
                          j->exposure_ev, cn_blend_name(c->scheme), c->exponent, c->reach, c->max_tiles,
                          c->min_visibility, (int)j->city->config.unseen);
    for (int i = 0; i < 6 && j->options->crop_m; i++)
        j->key = cn_hash_text(j->key, "crop %.17g", j->options->crop_m[i]);
    return CN_OK;
}

/* A frame's files, and the text of its marker file when they are complete and of these tiles, view and light. */
typedef struct frame_files {
    char *exr, *png, *mark;
    char wanted[32];
    bool done;
} frame_files;

/* What was rendered for a frame. */
typedef struct frame_pictures {
    cn_picture picture;
    cn_aovs aovs;
} frame_pictures;

static cn_status write_frame(const render_job *j, const cn_path_frame *frame, const char *appearance,
                             const frame_pictures *made, const frame_files *files)
{
    double centre[3], geo[3];
    char software[32];
    snprintf(software, sizeof software, "Conurb %s", cn_version());
    cn_view_centre(&frame->view, centre);
    const bool placed = j->m.frame.georeferenced && cn_frame_to_geodetic(&j->m.frame, centre, geo) == CN_OK;
    const cn_oiio_attribute attributes[] = {
        { "Software", software, NULL, 0 },
        { "conurb:appearance", appearance, NULL, 0 },
        { "conurb:camera_centre_m", NULL, centre, 3 },
        { "conurb:cam_from_world", NULL, frame->view.rotation, 9 },
        { "conurb:camera_params", NULL, frame->camera.params, 8 },
        { "conurb:frames_per_second", NULL, &j->path.fps, 1 },
        /* Doubles are written as text: floats are not exact to a metre. */
        { placed ? "conurb:latitude_longitude_height" : NULL, "", NULL, 0 },
        { NULL, NULL, NULL, 0 },
    };
    cn_oiio_attribute list[sizeof attributes / sizeof *attributes];
    memcpy(list, attributes, sizeof list);
    char place[96];
    cn_print(place, sizeof place, "%.9f %.9f %.4f", placed ? geo[0] : 0, placed ? geo[1] : 0, placed ? geo[2] : 0);
    if (placed) list[6].text = place;
    const cn_picture *picture = &made->picture;
    cn_oiio_channel layers[CN_AOV_LAYERS];
    cn_aov_layers(&made->aovs, layers);
    CN_TRY(cn_oiio_write_exr_layers(
        files->exr, &(cn_oiio_exr){ picture->rgba, picture->depth, picture->width, picture->height, layers }, list));
    CN_TRY(cn_aov_write_pngs(&made->aovs, files->png, j->renderer->tiles.radii[0], list));
    const cn_display_transform transform = { .view = j->view, .look = j->look, .exposure_ev = j->exposure_ev };
    /* Beside a crop, what is not there was taken away, and is not to be filled. */
    const cn_unseen unseen = j->options->crop_m ? CN_UNSEEN_BLACK : j->city->config.unseen;
    float *display;
    CN_TRY(cn_renderer_display(j->colour, &transform, unseen, picture, &display));
    const cn_status status = cn_oiio_write_png(files->png, display, picture->width, picture->height, 3, list);
    free(display);
    return status;
}

static void frame_files_deinit(frame_files *f)
{
    free(f->exr);
    free(f->png);
    free(f->mark);
}

static cn_status look_at_frame(const render_job *j, uint32_t i, frame_files *f)
{
    const cn_path_frame *frame = &j->path.frames[i];
    const cn_appearance_spec spec = cn_appearance_specs_at(j->specs, j->n_specs, i, j->path.n_frames);
    uint64_t key =
        cn_appearance_spec_hash(&spec, cn_hash_text(j->key, "%u %u", frame->camera.width, frame->camera.height));
    if (j->options->aovs) key = cn_hash_text(key, "aovs %u", j->options->aovs);
    key = cn_hash_text(key, "lens %d, %.17g frames a second", (int)frame->camera.lens, j->path.fps);
    for (int a = 0; a < 8; a++)
        key = cn_hash_text(key, "%.17g", frame->camera.params[a]);
    for (int a = 0; a < 3; a++)
        key = cn_hash_text(key, "%.17g", frame->view.translation[a]);
    for (int a = 0; a < 9; a++)
        key = cn_hash_text(key, "%.17g", frame->view.rotation[a]);
    *f = (frame_files){ cn_format("%s/%05u.exr", j->out, i), cn_format("%s/%05u.png", j->out, i),
                        cn_format("%s/%05u.json", j->out, i), "", false };
    if (!f->exr || !f->png || !f->mark) {
        frame_files_deinit(f);
        return cn_fail(CN_ERR_NOMEM, "out of memory");
    }
    snprintf(f->wanted, sizeof f->wanted, "%016llx\n", (unsigned long long)key);
    char *have = NULL;
    size_t size;
    f->done = cn_file_exists(f->exr) && cn_file_exists(f->png) && cn_file_exists(f->mark) &&
              cn_aov_pngs_exist(f->png, j->options->aovs) && cn_file_read(f->mark, 64, &have, &size) == CN_OK &&
              strcmp(have, f->wanted) == 0;
    free(have);
    return CN_OK;
}

static cn_status make_frame(render_job *j, uint32_t i, const frame_files *f)
{
    const cn_path_frame *frame = &j->path.frames[i];
    const cn_appearance_spec spec = cn_appearance_specs_at(j->specs, j->n_specs, i, j->path.n_frames);
    char appearance[640], stem[16];
    cn_appearance_spec_describe(&spec, appearance, sizeof appearance);
    frame_pictures made = { 0 };
    /* The marker and the channels belong to the old pictures. */
    if (cn_is_render_mark(f->mark)) CN_TRY(cn_aov_pngs_remove(f->png));
    CN_TRY(cn_file_remove(f->mark));
    snprintf(stem, sizeof stem, "%05u", i);
    CN_TRY(cn_folder_sweep(j->out, stem, 0)); /* this process holds the chunk's lock, so their writer is dead */
    CN_TRY(cn_picture_init(&made.picture, frame->camera.width, frame->camera.height));
    const cn_tile_cache_view view = {
        .camera = &frame->camera, .view = &frame->view, .options = &j->render, .appearance = &spec
    };
    cn_status status =
        j->options->aovs
            ? cn_renderer_draw_aovs(j->renderer, j->ctx, &view, j->options->aovs, &made.picture, &made.aovs)
            : cn_renderer_draw(j->renderer, j->ctx, &view, CN_RENDERER_BLEND, &made.picture);
    if (status == CN_OK) status = write_frame(j, frame, appearance, &made, f);
    cn_aovs_deinit(&made.aovs);
    if (status == CN_OK)
        status = cn_file_write(f->mark, f->wanted, strlen(f->wanted)); /* last: the frame is complete */
    cn_picture_deinit(&made.picture);
    return status;
}

/* With a sequence of lights and one photo, every frame has that photo's view. */
static cn_status hold_view(render_job *j)
{
    const uint32_t n = j->options->n_frames ? j->options->n_frames : j->city->config.render_frames;
    if (!relights(j->options) || j->path.n_frames != 1 || n < 2) return CN_OK;
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

static cn_status prepare(render_job *j)
{
    CN_TRY(cn_renderer_open(&j->renderer, j->ctx, j->city, &j->m, "tiles"));
    if (j->options->blend) CN_TRY(cn_blend_parse(j->options->blend, &j->renderer->tiles.compose.scheme));
    CN_TRY(cn_route_choose(j->ctx, j->city, &j->m, j->options, &j->path));
    CN_TRY(cn_colour_create(&j->colour, NULL));
    CN_TRY(frame_key(j));
    for (uint32_t i = 0; i < j->n_specs; i++)
        CN_TRY(cn_renderer_align(j->renderer, j->ctx, &j->specs[i], !j->look_only, &j->key));
    j->out = out_folder(j);
    if (!j->out) return cn_fail(CN_ERR_NOMEM, "out of memory");
    return hold_view(j);
}

/* Finds which of the frames first to last - 1 are done; *film is a hash of their identities. */
static cn_status survey(const render_job *j, uint32_t first, uint32_t last, bool *done, uint32_t *n_done,
                        uint64_t *film)
{
    *n_done = 0;
    for (uint32_t i = first; i < last; i++) {
        frame_files files;
        CN_TRY(look_at_frame(j, i, &files));
        *n_done += files.done;
        if (done) done[i] = files.done;
        if (film) *film = cn_hash_text(*film, "%s", files.wanted);
        frame_files_deinit(&files);
    }
    return CN_OK;
}

static cn_status render_range(render_job *j, uint32_t first, uint32_t last)
{
    const double started = cn_now_s();
    for (uint32_t i = first; i < last; i++) {
        frame_files files;
        if (cn_stopping(j->ctx))
            return cn_fail(CN_ERR_INTERRUPTED, "stopped at frame %u; run the same command to resume", i);
        CN_TRY(look_at_frame(j, i, &files));
        const cn_status status = files.done ? CN_OK : make_frame(j, i, &files);
        frame_files_deinit(&files);
        CN_TRY(status);
        const double elapsed = cn_now_s() - started, done = i + 1.0 - first, n = last - first;
        const cn_progress_report report = { "render", NULL, done, n, elapsed, elapsed / done * (n - done), NULL };
        cn_progress(j->ctx, &report);
    }
    return CN_OK;
}

/* Whether a process is working there, or died there. */
static bool left_behind(const render_job *j, const char *name)
{
    char *path = cn_path_join(j->out, name);
    const bool there = path && cn_file_exists(path);
    free(path);
    return there;
}

/* Chunk I of N has a lock of its own, so that other chunks can be rendered at the same time. */
static cn_status render_chunk(render_job *j, uint32_t first, uint32_t last)
{
    uint32_t n_done;
    CN_TRY(survey(j, first, last, NULL, &n_done, NULL));
    const bool done = n_done == last - first;
    char name[48] = "LOCK", what[64] = "these frames";
    if (j->options->n_chunks) {
        snprintf(name, sizeof name, "LOCK.%u-of-%u", j->options->chunk, j->options->n_chunks);
        snprintf(what, sizeof what, "chunk %u of %u of these frames", j->options->chunk, j->options->n_chunks);
    }
    if (done && !left_behind(j, name)) return CN_OK;
    const cn_context *outer = j->ctx;
    cn_city_lock lock;
    const cn_status taken = cn_city_lock_share(&lock, outer, j->out, name, what);
    if (done && taken == CN_ERR_LOCKED) return CN_OK;
    CN_TRY(taken);
    j->ctx = &lock.ctx;
    const cn_status status = render_range(j, first, last);
    j->ctx = outer;
    cn_city_lock_drop(&lock);
    return status;
}

/* The process that renders the last missing frame makes the film, and removes what an earlier, longer render left in
 * the folder: a program that reads the sequence would take it for part of this flight. A LOCK is another process's by
 * now, which may be rendering those frames. */
static cn_status make_film(render_job *j)
{
    uint64_t film = 0;
    uint32_t n_done;
    cn_city_lock lock;
    CN_TRY(survey(j, 0, j->path.n_frames, NULL, &n_done, &film));
    if (n_done < j->path.n_frames) return CN_OK;
    const bool old = !left_behind(j, "LOCK") && cn_old_frames_exist(j->out, j->path.n_frames);
    if (cn_film_done(j->out, j->path.n_frames, j->path.fps, film) && !old && !left_behind(j, "LOCK.film")) return CN_OK;
    const cn_status taken = cn_city_lock_share(&lock, j->ctx, j->out, "LOCK.film", "the film");
    if (taken == CN_ERR_LOCKED) return CN_OK;
    CN_TRY(taken);
    cn_status status = cn_folder_sweep(j->out, "flight", 0);
    if (status == CN_OK) status = cn_folder_sweep(j->out, "flight.mp4", 0);
    if (status == CN_OK && old) status = cn_old_frames_remove(j->out, j->path.n_frames);
    if (status == CN_OK) status = cn_film_make(&lock.ctx, j->out, j->path.n_frames, j->path.fps, film);
    cn_city_lock_drop(&lock);
    return status;
}

static cn_status render_all(render_job *j)
{
    const uint64_t n = j->path.n_frames, part = j->options->chunk, parts = j->options->n_chunks;
    const uint32_t first = parts ? (uint32_t)(n * (part - 1) / parts) : 0,
                   last = parts ? (uint32_t)(n * part / parts) : (uint32_t)n;
    CN_TRY(render_chunk(j, first, last));
    if (parts)
        cn_log(j->ctx, CN_LOG_INFO, "chunk %u of %u: %u frames in %s", (unsigned)part, (unsigned)parts, last - first,
               j->out);
    else
        cn_log(j->ctx, CN_LOG_INFO, "%u frames in %s", last, j->out);
    return make_film(j);
}

static cn_status parse_appearances(render_job *j)
{
    const cn_city_render_options *o = j->options;
    if ((o->appearance != NULL) + (o->sequence != NULL) + (o->from != NULL) > 1 || !o->from != !o->to)
        return cn_fail(CN_ERR_USAGE, "give one of: an appearance, a sequence of them, or the first and the last");
    if (o->sequence) return cn_appearance_specs_parse(&j->specs, &j->n_specs, o->sequence, j->city, &j->m.photos);
    j->specs = calloc(2, sizeof *j->specs);
    if (!j->specs) return cn_fail(CN_ERR_NOMEM, "out of memory");
    j->n_specs = 1;
    CN_TRY(cn_appearance_spec_parse(&j->specs[0], o->from ? o->from : o->appearance, j->city, &j->m.photos));
    if (!o->to) return CN_OK;
    j->n_specs = 2;
    return cn_appearance_spec_parse(&j->specs[1], o->to, j->city, &j->m.photos);
}

static cn_status survey_all(const render_job *j, cn_render_survey *out)
{
    out->n_frames = j->path.n_frames;
    out->done = calloc(out->n_frames + 1u, sizeof *out->done);
    if (!out->done) return cn_fail(CN_ERR_NOMEM, "out of memory");
    return survey(j, 0, out->n_frames, out->done, &out->n_done, NULL);
}

/* Renders; when out is given, only checks. */
static cn_status work(const cn_context *ctx, cn_city *city, const cn_city_render_options *options,
                      cn_render_survey *out)
{
    if (options->n_chunks && (options->chunk < 1 || options->chunk > options->n_chunks))
        return cn_fail(CN_ERR_USAGE, "chunk %u of %u: the first is 1", options->chunk, options->n_chunks);
    render_job j = {
        .ctx = ctx, .city = city, .options = options, .render = cn_render_options_default(), .look_only = out != NULL
    };
    j.render.crop_m = options->crop_m;
    j.view = options->view ? options->view : city->config.view;
    j.look = options->look ? options->look : city->config.look;
    j.exposure_ev = city->config.exposure_ev + options->exposure_ev;
    CN_TRY(cn_dataset_load(ctx, city, true, &j.m));
    cn_status status = parse_appearances(&j);
    if (status == CN_OK) status = prepare(&j);
    if (status == CN_OK) status = out ? survey_all(&j, out) : render_all(&j);
    cn_appearance_specs_free(j.specs, j.n_specs);
    cn_path_deinit(&j.path);
    cn_colour_destroy(&j.colour);
    cn_renderer_destroy(&j.renderer);
    cn_dataset_deinit(&j.m);
    free(j.out);
    return status;
}

cn_status cn_city_render(const cn_context *ctx, cn_city *city, const cn_city_render_options *options)
{
    return work(ctx, city, options, NULL);
}

cn_status cn_city_render_survey(const cn_context *ctx, cn_city *city, const cn_city_render_options *options,
                                cn_render_survey *out)
{
    *out = (cn_render_survey){ 0 };
    const cn_status status = work(ctx, city, options, out);
    if (status != CN_OK) cn_render_survey_deinit(out);
    return status;
}

void cn_render_survey_deinit(cn_render_survey *survey)
{
    free(survey->done);
    *survey = (cn_render_survey){ 0 };
}
