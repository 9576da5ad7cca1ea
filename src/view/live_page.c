#include "view/live_page.h"

#include "base/file.h"
#include "base/json.h"
#include "base/units.h"
#include "math/linalg.h"
#include "splat/packed.h"
#include "stage/splat.h"
#include "stage/splat_lights.h"
#include "view/pages.h"

#include <ctype.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Chunks are whole rows of the viewer's textures; the first is small, so that it comes soon. */
enum { FIRST_CHUNK = 24 * 1024, CHUNK = 64 * 1024, FEWEST = 1000, VIEWS = 40, SAMPLES = 4000, CITY_BYTES = 20000 };
#define EYE_M 1.7

typedef struct live_page {
    const cn_context *ctx;
    cn_city *city;
    const cn_viewer_page *page;
    cn_dataset m;
    cn_city_survey survey;
    cn_colour *colour;
    cn_renderer *renderer;
    cn_appearance_spec *specs;
    char names[CN_PACKED_LIGHTS][64];
    uint32_t n_lights, degree, n_chunks;
    cn_splats *splats; /* those that are shown, the most important first */
    uint8_t (*colours[CN_PACKED_LIGHTS])[3], (*sky[CN_PACKED_LIGHTS])[3];
    double size_m; /* how far the city reaches */
} live_page;

/* ---- text ---- */

/* Bytes as base64 (RFC 4648); the caller frees it. NULL: out of memory. */
static char *base64(const uint8_t *bytes, size_t n)
{
    static const char letters[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    char *out = malloc((n + 2) / 3 * 4 + 1), *at = out;
    for (size_t i = 0; out && i < n; i += 3) {
        const size_t left = n - i;
        const uint32_t v =
            (uint32_t)bytes[i] << 16 | (left > 1 ? (uint32_t)bytes[i + 1] << 8 : 0) | (left > 2 ? bytes[i + 2] : 0);
        *at++ = letters[v >> 18];
        *at++ = letters[v >> 12 & 63];
        *at++ = left > 1 ? letters[v >> 6 & 63] : '=';
        *at++ = left > 2 ? letters[v & 63] : '=';
    }
    if (out) *at = 0;
    return out;
}

static cn_status write_text(const live_page *p, const char *name, const char *text)
{
    char *path = cn_path_join(p->page->dir, name);
    const cn_status status = path ? cn_file_write(path, text, strlen(text)) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(path);
    return status;
}

/* ---- lights ---- */

/* "NAME=LIGHT": the name, or the light itself. Returns what follows. */
static char *take_name(live_page *p, char *word)
{
    char *equals = strchr(word, '=');
    const bool named = equals && equals > word && !memchr(word, '/', (size_t)(equals - word));
    if (named) *equals = 0;
    snprintf(p->names[p->n_lights], sizeof p->names[0], "%s", word);
    return named ? equals + 1 : word;
}

static cn_status parse_lights(live_page *p)
{
    char *copy = strdup(p->page->lights ? p->page->lights : "mean");
    p->specs = calloc(CN_PACKED_LIGHTS, sizeof *p->specs);
    cn_status status = copy && p->specs ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    for (char *rest = copy, *word; status == CN_OK && (word = strsep(&rest, ",")) != NULL;) {
        if (p->n_lights == CN_PACKED_LIGHTS)
            status = cn_fail(CN_ERR_USAGE, "--lights: give %d lights at most", CN_PACKED_LIGHTS);
        else {
            char *light = take_name(p, word);
            status = cn_appearance_spec_parse(&p->specs[p->n_lights++], light, p->city, &p->m.photos);
        }
    }
    free(copy);
    return status;
}

static cn_status find_colours(live_page *p)
{
    const cn_splat_lights lights = { p->ctx, p->renderer, &p->survey.survey, p->specs, p->n_lights };
    for (uint32_t l = 0; l < p->n_lights; l++) {
        p->colours[l] = malloc((p->splats->n + 1) * sizeof *p->colours[l]);
        p->sky[l] = malloc((size_t)CN_SKY_WIDTH * CN_SKY_HEIGHT * sizeof *p->sky[l]);
        if (!p->colours[l] || !p->sky[l])
            return cn_fail(CN_ERR_NOMEM, "out of memory for the lights of %zu splats", p->splats->n);
    }
    CN_TRY(cn_splat_lights_find(&lights, p->splats, p->colours));
    return cn_splat_lights_sky(&lights, p->sky);
}

/* ---- splats ---- */

/* Bytes of the files that do not depend on the splats. */
static double fixed_bytes(const live_page *p)
{
    double sum = CITY_BYTES + p->n_lights * (4.0 / 3 * 3 * CN_SKY_WIDTH * CN_SKY_HEIGHT);
    const cn_page *file;
    for (size_t i = 0; (file = cn_page_at(i)); i++)
        if (strncmp(file->path, "/live/", 6) == 0) sum += (double)strlen(file->text);
    return sum;
}

/* How many splats fit into the size. */
static cn_status count_splats(const live_page *p, size_t *n)
{
    const double per_splat = 4.0 / 3 * (double)cn_packed_size(CHUNK, p->n_lights, p->degree) / CHUNK;
    const double fixed = fixed_bytes(p) + 4.0 / 3 * 2 * (CN_PACKED_HEADER + 24);
    const double room = (p->page->size_mb * 1e6 - fixed) / per_splat;
    if (!(room >= FEWEST))
        return cn_fail(CN_ERR_USAGE, "--size %g: with %u light%s, give %.1f MB or more", p->page->size_mb, p->n_lights,
                       p->n_lights == 1 ? "" : "s", ceil((fixed + FEWEST * per_splat) / 1e5) / 10);
    *n = room < (double)*n ? (size_t)room : *n;
    return CN_OK;
}

/* As many as there is room for. */
static cn_status make_splats(live_page *p, cn_splats **splats)
{
    cn_city_splats make = { p->renderer, &p->m, &p->survey.survey, &p->specs[0], cn_splat_options_default() };
    size_t n = make.options.budget;
    p->degree = make.options.degree ? 1 : 0;
    CN_TRY(count_splats(p, &n));
    make.options.budget = (uint32_t)n;
    make.options.limit_s = p->page->limit_s;
    CN_TRY(cn_folder_make(p->page->dir));
    char *path = cn_path_join(p->page->dir, "live.html");
    const cn_status status =
        path ? cn_city_splats_make(p->ctx, &make, path, splats) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(path);
    return status;
}

static cn_status take_splats(live_page *p)
{
    cn_splats *all;
    uint32_t *order = NULL;
    CN_TRY(p->page->splats ? cn_splats_read(&all, p->page->splats) : make_splats(p, &all));
    size_t n = all->n;
    p->degree = all->degree ? 1 : 0;
    cn_status status = count_splats(p, &n);
    if (status == CN_OK) status = cn_splats_rank(all, &order);
    if (status == CN_OK) status = cn_splats_take(all, order, n, cn_splats_growth(all->n, n), &p->splats);
    if (status == CN_OK)
        cn_log(p->ctx, CN_LOG_INFO, "page: %zu of %zu splats, %u light%s", n, all->n, p->n_lights,
               p->n_lights == 1 ? "" : "s");
    free(order);
    cn_splats_destroy(&all);
    return status;
}

static uint32_t chunk_length(size_t left, uint32_t i)
{
    const size_t most = i ? CHUNK : FIRST_CHUNK;
    return (uint32_t)(left < most ? left : most);
}

static cn_status write_chunk(const live_page *p, const cn_packing *packing, uint32_t *which, uint32_t n)
{
    uint8_t *bytes;
    char name[32];
    CN_TRY(cn_packed_make(packing, which, n, &bytes));
    char *text = base64(bytes, cn_packed_size(n, packing->n_lights, packing->degree));
    char *script = text ? cn_format("splatChunk(%u,\"%s\");\n", p->n_chunks, text) : NULL;
    snprintf(name, sizeof name, "chunk-%u.js", p->n_chunks);
    const cn_status status = script ? write_text(p, name, script) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(bytes);
    free(text);
    free(script);
    return status;
}

static cn_status write_chunks(live_page *p)
{
    cn_packing packing = {
        .splats = p->splats, .n_lights = p->n_lights, .degree = p->degree, .harmonics = cn_packing_harmonics(p->splats)
    };
    memcpy(packing.lights, p->colours, sizeof packing.lights);
    uint32_t *which = malloc((p->splats->n + 1) * sizeof *which);
    cn_status status = which ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for %zu splats", p->splats->n);
    for (size_t i = 0; which && i < p->splats->n; i++)
        which[i] = (uint32_t)i;
    for (size_t done = 0; done < p->splats->n && status == CN_OK; p->n_chunks++) {
        const uint32_t n = chunk_length(p->splats->n - done, p->n_chunks);
        if (cn_stopping(p->ctx))
            status = cn_fail(CN_ERR_INTERRUPTED, "stopped while writing the page; run the same command again");
        else
            status = write_chunk(p, &packing, which + done, n);
        done += n;
    }
    free(which);
    return status;
}

/* ---- what the page says of the city ---- */

typedef struct sample {
    double at[3];
} sample;

/* Splats evenly over the order, which is by chance. */
static size_t take_samples(const live_page *p, sample *samples)
{
    const cn_splats *s = p->splats;
    const size_t n = s->n < SAMPLES ? s->n : SAMPLES;
    for (size_t i = 0; i < n; i++)
        for (int k = 0; k < 3; k++)
            samples[i].at[k] = s->origin[k] + (double)s->centre[i * s->n / n][k];
    return n;
}

static double median_of(const sample *samples, size_t n, const double from[3], double *room)
{
    for (size_t i = 0; i < n; i++)
        room[i] = cn_distance3(samples[i].at, from);
    return cn_select(room, n, n / 2);
}

/* The part of the samples that a view shows, weighed so that near ones count more; *distance: the quarter of them in
 * the middle of the picture that is nearest. */
static double look(const live_page *p, const cn_view *view, const sample *samples, size_t n, double *distance)
{
    const cn_camera *camera = &p->m.scene.cameras[view->camera];
    double *depths = malloc((n + 1) * sizeof *depths), sum = 0;
    size_t middle = 0;
    *distance = p->size_m;
    for (size_t i = 0; depths && i < n; i++) {
        double in[3], pixel[2];
        cn_mat3_vec(view->rotation, samples[i].at, in);
        for (int k = 0; k < 3; k++)
            in[k] += view->translation[k];
        if (!cn_camera_project(camera, in, pixel)) continue;
        const double x = pixel[0] / camera->width - 0.5, y = pixel[1] / camera->height - 0.5;
        if (fabs(x) > 0.5 || fabs(y) > 0.5) continue;
        sum += 1 / (1 + in[2] / p->size_m);
        if (hypot(x, y) < 0.2) depths[middle++] = in[2];
    }
    if (middle > 8) *distance = cn_select(depths, middle, middle / 4);
    free(depths);
    return sum;
}

static json_t *view_json(const live_page *p, const cn_view *view, double distance)
{
    const cn_camera *camera = &p->m.scene.cameras[view->camera];
    double eye[3], top[3], bottom[3];
    cn_view_centre(view, eye);
    const bool lens = cn_camera_unproject(camera, camera->width / 2.0, 0, top) == CN_OK &&
                      cn_camera_unproject(camera, camera->width / 2.0, camera->height, bottom) == CN_OK;
    const double vfov = lens ? cn_degrees(acos(fmin(fmax(cn_dot3(top, bottom), -1), 1))) : 55;
    return json_pack("{s:s, s:o, s:o, s:o, s:o}", "name", view->name, "eye", cn_json_reals(eye, 3), "forward",
                     cn_json_reals(view->rotation + 6, 3), "vfov", cn_json_real(vfov), "distance",
                     cn_json_real(distance));
}

/* Views of photos, evenly over the collection, the one that shows most first. */
static json_t *views_json(const live_page *p, const sample *samples, size_t n)
{
    const cn_scene *scene = &p->m.scene;
    const uint32_t count = scene->n_views < VIEWS ? scene->n_views : VIEWS;
    json_t *list = json_array();
    double most = -1;
    for (uint32_t i = 0; i < count; i++) {
        const cn_view *view = &scene->views[(uint64_t)i * scene->n_views / count];
        double distance;
        const double shown = look(p, view, samples, n, &distance);
        json_t *json = view_json(p, view, distance);
        if (shown > most)
            json_array_insert_new(list, 0, json);
        else
            json_array_append_new(list, json);
        most = fmax(most, shown);
    }
    return list;
}

static double typical_scale(const cn_splats *s)
{
    double sum = 0;
    for (size_t i = 0; i < s->n; i++)
        for (int k = 0; k < 3; k++)
            sum += log((double)s->scale[i][k]);
    return exp(sum / (3.0 * (double)s->n));
}

static json_t *sky_json(const live_page *p)
{
    json_t *pictures = json_array();
    for (uint32_t l = 0; l < p->n_lights; l++) {
        char *text = base64(p->sky[l][0], (size_t)3 * CN_SKY_WIDTH * CN_SKY_HEIGHT);
        if (text) json_array_append_new(pictures, json_string(text));
        free(text);
    }
    return json_pack("{s:i, s:i, s:o}", "width", CN_SKY_WIDTH, "height", CN_SKY_HEIGHT, "pictures", pictures);
}

static json_t *lights_json(const live_page *p)
{
    json_t *lights = json_array();
    for (uint32_t l = 0; l < p->n_lights; l++)
        json_array_append_new(lights, json_string(p->names[l]));
    return lights;
}

static json_t *frame_json(const cn_frame *frame)
{
    double m[16];
    if (!frame->georeferenced) return json_null();
    cn_frame_ecef(frame, m);
    return json_pack("{s:o}", "ecef_from_local", cn_json_reals(m, 16));
}

static cn_status write_city(live_page *p, const char *name)
{
    sample *samples = malloc(SAMPLES * sizeof *samples);
    double *room = malloc(SAMPLES * sizeof *room), middle[3] = { 0 };
    const size_t n = samples && room ? take_samples(p, samples) : 0;
    for (int k = 0; k < 3 && n; k++) {
        for (size_t i = 0; i < n; i++)
            room[i] = samples[i].at[k];
        middle[k] = cn_select(room, n, n / 2);
    }
    p->size_m = n ? fmax(2 * median_of(samples, n, middle, room), 1e-6) : 1;
    json_t *json = json_pack("{s:s, s:s, s:I, s:i, s:i, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o}", "made_by", "Conurb",
                             "name", name, "splats", (json_int_t)p->splats->n, "chunks", (int)p->n_chunks, "degree",
                             (int)p->degree, "unit", cn_json_real(typical_scale(p->splats)), "middle",
                             cn_json_reals(middle, 3), "size", cn_json_real(p->size_m), "eye_height",
                             cn_json_real(p->m.frame.georeferenced ? EYE_M : p->size_m / 50), "lights", lights_json(p),
                             "sky", sky_json(p), "views", views_json(p, samples, n), "frame", frame_json(&p->m.frame));
    char *text = json ? json_dumps(json, JSON_ENSURE_ASCII | JSON_REAL_PRECISION(12)) : NULL;
    char *script = text ? cn_format("const splatCity = %s;\n", text) : NULL;
    const cn_status status =
        script && n ? write_text(p, "city.js", script) : cn_fail(CN_ERR_NOMEM, "out of memory for the page");
    json_decref(json);
    free(samples);
    free(room);
    free(text);
    free(script);
    return status;
}

/* ---- files ---- */

/* Chunks of an earlier page that this one does not have. */
static cn_status remove_old(const live_page *p)
{
    cn_status status = CN_OK;
    for (uint32_t i = p->n_chunks; status == CN_OK; i++) {
        char name[32];
        snprintf(name, sizeof name, "chunk-%u.js", i);
        char *path = cn_path_join(p->page->dir, name);
        const bool there = path && cn_file_exists(path);
        if (there) status = cn_file_remove(path);
        free(path);
        if (!there) break;
    }
    return status;
}

static cn_status write_files(live_page *p)
{
    char *absolute = NULL;
    CN_TRY(cn_folder_make(p->page->dir));
    CN_TRY(write_chunks(p));
    CN_TRY(remove_old(p));
    CN_TRY(cn_path_absolute(p->city->folder, &absolute));
    const cn_status status = write_city(p, cn_path_base(absolute));
    free(absolute);
    CN_TRY(status);
    const cn_page *file;
    for (size_t i = 0; (file = cn_page_at(i)); i++)
        if (strncmp(file->path, "/live/", 6) == 0 && strcmp(file->path, "/live/live.html") != 0)
            CN_TRY(write_text(p, file->path + 6, file->text));
    return write_text(p, "live.html", cn_page_find("/live/live.html")->text);
}

static cn_status open_city(live_page *p)
{
    const cn_viewer_page *page = p->page;
    CN_TRY(cn_dataset_load(p->ctx, p->city, true, &p->m));
    CN_TRY(parse_lights(p));
    size_t all = SIZE_MAX;
    CN_TRY(count_splats(p, &all)); /* a size that is too small is said at once */
    CN_TRY(cn_city_survey_init(&p->survey, p->city, &p->m));
    CN_TRY(cn_colour_create(&p->colour, NULL));
    cn_survey *survey = &p->survey.survey;
    survey->colour = p->colour;
    survey->exposure_ev += page->exposure_ev;
    if (page->view) survey->view = page->view;
    if (page->look) survey->look = page->look;
    return cn_renderer_open(&p->renderer, p->ctx, p->city, &p->m, "tiles");
}

cn_status cn_live_page_write(const cn_context *ctx, cn_city *city, const cn_viewer_page *page)
{
    live_page p = { .ctx = ctx, .city = city, .page = page };
    cn_status status = open_city(&p);
    if (status == CN_OK && page->splats) status = take_splats(&p); /* what is wrong with the file is said at once */
    for (uint32_t l = 0; l < p.n_lights && status == CN_OK; l++)
        status = cn_renderer_align(p.renderer, ctx, &p.specs[l], true, NULL);
    if (status == CN_OK && !page->splats) status = take_splats(&p);
    if (status == CN_OK) status = find_colours(&p);
    if (status == CN_OK) status = write_files(&p);
    if (status == CN_OK) cn_log(ctx, CN_LOG_INFO, "page: %s/live.html", page->dir);
    for (uint32_t l = 0; l < CN_PACKED_LIGHTS; l++) {
        free(p.colours[l]);
        free(p.sky[l]);
    }
    cn_splats_destroy(&p.splats);
    if (p.specs) cn_appearance_specs_free(p.specs, p.n_lights);
    cn_renderer_destroy(&p.renderer);
    cn_colour_destroy(&p.colour);
    cn_city_survey_deinit(&p.survey);
    cn_dataset_deinit(&p.m);
    return status;
}
