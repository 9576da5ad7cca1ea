#include "appearance/spec.h"

#include "appearance/lens.h"
#include "base/file.h"
#include "base/hash.h"
#include "base/json.h"
#include "base/number.h"
#include "base/rng.h"
#include "math/linalg.h"
#include "pose/scene.h"
#include "tile/model.h"

#include <dirent.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static cn_status take_photo(char out[256], const char *name, size_t length, const cn_photo_index *photos)
{
    char wanted[256];
    snprintf(wanted, sizeof wanted, "%.*s", (int)length, name);
    const int64_t photo = cn_photo_index_find(photos, wanted);
    if (photo < 0)
        return cn_fail(CN_ERR_USAGE,
                       "no photo is named '%s', and no light; give one that `conurb appearance CITY list` shows, mean, "
                       "A:B:0.3, FILE.json or fit:PHOTO (any file)",
                       wanted);
    snprintf(out, 256, "%s", photos->photos[photo].name);
    return CN_OK;
}

/* A photo to fit to: one of the collection, or else a file. */
static cn_status take_fit(cn_appearance_spec *spec, const char *name, const cn_photo_index *photos)
{
    uint64_t hash;
    char *path = NULL;
    spec->kind = CN_APPEARANCE_FIT;
    if (cn_photo_index_find(photos, name) >= 0 || !cn_file_exists(name))
        return take_photo(spec->a, name, strlen(name), photos);
    CN_TRY(cn_path_absolute(name, &path));
    cn_status status = cn_hash_file(path, &hash);
    if (status == CN_OK && strlen(path) >= sizeof spec->a)
        status = cn_fail(CN_ERR_USAGE, "the path %s is too long; move the photo", path);
    if (status == CN_OK) {
        snprintf(spec->a, sizeof spec->a, "%s", path);
        cn_hash_hex(hash, spec->b);
    }
    free(path);
    return status;
}

static bool ends_with(const char *text, const char *end)
{
    const size_t n = strlen(text), m = strlen(end);
    return n > m && strcmp(text + n - m, end) == 0;
}

enum { MIX_MAX = 16 }; /* parts of a mix */

static cn_status bad_mix(const char *text)
{
    return cn_fail(CN_ERR_USAGE,
                   "%s: a mix is A:B:0.3: two photos, mean or names of lights, and a number from 0 (the "
                   "first) to 1 (the second); more follow with their share, A:B:0.3:C:0.2, up to %d",
                   text, (int)MIX_MAX);
}

static cn_status load_file(cn_appearance_spec *spec, const char *path)
{
    spec->kind = CN_APPEARANCE_FILE;
    snprintf(spec->a, sizeof spec->a, "%s", path);
    CN_TRY(cn_json_load(path, &spec->file));
    if (json_is_object(json_object_get(spec->file, "tiles"))) return CN_OK;
    return cn_fail(CN_ERR_FORMAT,
                   "%s holds no appearance ('tiles' is missing); `conurb appearance CITY export` writes one", path);
}

/* Folders of a city whose files NAME.json are lights with a name. */
static const char *const folders[] = { "appearances", CN_APPEARANCE_FITTED };

static void add_lights(const char *folder, json_t *out)
{
    struct dirent **found = NULL;
    const int n = scandir(folder, &found, NULL, alphasort);
    for (int i = 0; i < n; i++) {
        const char *name = found[i]->d_name;
        if (name[0] != '.' && ends_with(name, ".json"))
            json_array_append_new(out, json_stringn(name, strlen(name) - strlen(".json")));
        free(found[i]);
    }
    free(found);
}

json_t *cn_appearance_lights(const cn_city *city)
{
    json_t *out = json_array();
    for (size_t i = 0; i < sizeof folders / sizeof *folders; i++) {
        char *folder = cn_city_path(city, folders[i]);
        if (folder) add_lights(folder, out);
        free(folder);
    }
    return out;
}

/* CITY/appearances/NAME.json or CITY/views/fitted/NAME.json, if it exists; the caller frees it. */
static char *named(const cn_city *city, const char *name)
{
    for (size_t i = 0; i < sizeof folders / sizeof *folders && !strchr(name, '/'); i++) {
        char *relative = cn_format("%s/%s.json", folders[i], name);
        char *path = relative ? cn_city_path(city, relative) : NULL;
        free(relative);
        if (path && cn_file_exists(path)) return path;
        free(path);
    }
    return NULL;
}

/* A light that has a name. *found: whether there is one. */
static cn_status take_named(cn_appearance_spec *spec, const char *name, const cn_city *city, bool *found)
{
    char *path = named(city, name);
    const cn_status status = path ? load_file(spec, path) : CN_OK;
    *found = path != NULL;
    free(path);
    return status;
}

/* Adds a part to a mix: what it was becomes the first part. */
static cn_status mix_in(cn_appearance_spec *spec, uint32_t n)
{
    if (n == 2) return CN_OK;
    cn_appearance_spec *first = malloc(sizeof *first);
    if (!first) return cn_fail(CN_ERR_NOMEM, "out of memory for a mix of %u lights", n);
    *first = *spec;
    *spec = (cn_appearance_spec){ .kind = CN_APPEARANCE_MIX, .first = first };
    memcpy(spec->a, first->a, sizeof spec->a);
    return CN_OK;
}

/* A part of a mix: the name of a photo goes to `name`, another light to *light. */
static cn_status take_part(char name[256], cn_appearance_spec **light, const char *text, const cn_city *city,
                           const cn_photo_index *photos)
{
    cn_appearance_spec part = { .kind = CN_APPEARANCE_MEAN };
    bool found = strcmp(text, "mean") == 0;
    if (!found && cn_photo_index_find(photos, text) < 0) CN_TRY(take_named(&part, text, city, &found));
    if (!found) return take_photo(name, text, strlen(text), photos);
    *light = malloc(sizeof part);
    if (*light) {
        **light = part;
        return CN_OK;
    }
    cn_appearance_spec_deinit(&part);
    return cn_fail(CN_ERR_NOMEM, "out of memory for the light '%s'", text);
}

/* After the first part: pairs of a part and its share. words: the text, cut into pieces here. */
static cn_status parse_mix(cn_appearance_spec *spec, const char *text, char *words, const cn_city *city,
                           const cn_photo_index *photos)
{
    char *rest = words;
    spec->kind = CN_APPEARANCE_MIX;
    CN_TRY(take_part(spec->a, &spec->first, strsep(&rest, ":"), city, photos));
    for (uint32_t n = 2; rest; n++) {
        const char *part = strsep(&rest, ":"), *share = rest ? strsep(&rest, ":") : "";
        char *end = NULL;
        const double t = cn_parse_double(share, &end);
        if (end == share || *end || !isfinite(t) || n > MIX_MAX) return bad_mix(text);
        CN_TRY(mix_in(spec, n));
        CN_TRY(take_part(spec->b, &spec->second, part, city, photos));
        spec->t = t;
    }
    return CN_OK;
}

cn_status cn_appearance_spec_parse(cn_appearance_spec *spec, const char *text, const cn_city *city,
                                   const cn_photo_index *photos)
{
    bool found = false;
    *spec = (cn_appearance_spec){ .kind = CN_APPEARANCE_MEAN };
    if (!text || strcmp(text, "mean") == 0) return CN_OK;
    if (strncmp(text, "fit:", 4) == 0) return take_fit(spec, text + 4, photos);
    if (ends_with(text, ".json")) return load_file(spec, text);
    if (cn_photo_index_find(photos, text) < 0) {
        CN_TRY(take_named(spec, text, city, &found));
        if (found) return CN_OK;
        if (strchr(text, ':')) {
            char *words = strdup(text);
            const cn_status status =
                words ? parse_mix(spec, text, words, city, photos) : cn_fail(CN_ERR_NOMEM, "out of memory for a mix");
            free(words);
            if (status != CN_OK) cn_appearance_spec_deinit(spec);
            return status;
        }
    }
    spec->kind = CN_APPEARANCE_PHOTO;
    return take_photo(spec->a, text, strlen(text), photos);
}

void cn_appearance_spec_deinit(cn_appearance_spec *spec)
{
    json_decref(spec->file);
    if (spec->first) cn_appearance_spec_deinit(spec->first);
    if (spec->second) cn_appearance_spec_deinit(spec->second);
    free(spec->first);
    free(spec->second);
    *spec = (cn_appearance_spec){ 0 };
}

uint64_t cn_appearance_spec_hash(const cn_appearance_spec *spec, uint64_t hash)
{
    char *file = spec->file ? json_dumps(spec->file, JSON_SORT_KEYS | JSON_COMPACT) : NULL;
    hash = cn_hash_text(hash, "%d|%s|%s|%.9g|%s", (int)spec->kind, spec->a, spec->b, spec->t, file ? file : "");
    free(file);
    if (spec->first) hash = cn_appearance_spec_hash(spec->first, hash);
    if (spec->second) hash = cn_appearance_spec_hash(spec->second, hash);
    if (spec->from) hash = cn_appearance_spec_hash(spec->from, hash);
    if (spec->to) hash = cn_appearance_spec_hash(spec->to, hash);
    return hash;
}

static void describe(const cn_appearance_spec *spec, char *out, size_t size)
{
    char from[600], to[600];
    switch (spec->kind) {
    case CN_APPEARANCE_MEAN: snprintf(out, size, "mean"); break;
    case CN_APPEARANCE_FIT: snprintf(out, size, "fit:%s", spec->a); break;
    case CN_APPEARANCE_MIX:
        snprintf(from, sizeof from, "%s", spec->a);
        snprintf(to, sizeof to, "%s", spec->b);
        if (spec->first) describe(spec->first, from, sizeof from);
        if (spec->second) describe(spec->second, to, sizeof to);
        cn_print(out, size, "%s:%s:%.6g", from, to, spec->t);
        break;
    case CN_APPEARANCE_BETWEEN:
        describe(spec->from, from, sizeof from);
        describe(spec->to, to, sizeof to);
        if (spec->t > 0 && spec->from != spec->to)
            cn_print(out, size, "%s:%s:%.6g", from, to, spec->t);
        else
            snprintf(out, size, "%s", from);
        break;
    case CN_APPEARANCE_PHOTO:
    case CN_APPEARANCE_KNOWN:
    case CN_APPEARANCE_FIT_LEFT:
    case CN_APPEARANCE_FILE: snprintf(out, size, "%s", spec->a); break;
    }
}

void cn_appearance_spec_describe(const cn_appearance_spec *spec, char *out, size_t size)
{
    describe(spec, out, size);
    (void)cn_json_make_utf8(out);
}

void cn_appearance_specs_free(cn_appearance_spec *specs, uint32_t n)
{
    for (uint32_t i = 0; specs && i < n; i++)
        cn_appearance_spec_deinit(&specs[i]);
    free(specs);
}

/* Parses the longest piece up to a comma that is an appearance: names may have commas. *rest: after the piece's comma,
 * or NULL at the end. */
static cn_status parse_piece(cn_appearance_spec *spec, char **rest, const cn_city *city, const cn_photo_index *photos)
{
    char *text = *rest, *comma = text + strlen(text);
    *rest = NULL;
    cn_status status = cn_appearance_spec_parse(spec, text, city, photos);
    while (status != CN_OK && status != CN_ERR_NOMEM) {
        const char end = *comma;
        *comma = '\0';
        char *shorter = strrchr(text, ',');
        *comma = end;
        if (!shorter) break;
        *shorter = '\0';
        cn_appearance_spec_deinit(spec);
        status = cn_appearance_spec_parse(spec, text, city, photos);
        *shorter = ',';
        comma = shorter;
        *rest = shorter + 1;
    }
    return status;
}

cn_status cn_appearance_specs_parse(cn_appearance_spec **specs, uint32_t *n, const char *text, const cn_city *city,
                                    const cn_photo_index *photos)
{
    uint32_t most = 1;
    for (const char *c = text; *c; c++)
        most += *c == ',';
    *n = 0;
    *specs = calloc(most, sizeof **specs);
    char *copy = strdup(text);
    cn_status status = *specs && copy ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    for (char *rest = copy; status == CN_OK && rest;)
        status = parse_piece(&(*specs)[(*n)++], &rest, city, photos);
    free(copy);
    if (status != CN_OK) {
        cn_appearance_specs_free(*specs, *n);
        *specs = NULL;
        *n = 0;
    }
    return status;
}

cn_appearance_spec cn_appearance_specs_at(const cn_appearance_spec *specs, uint32_t n, uint32_t i, uint32_t n_frames)
{
    const double s = n_frames > 1 && n > 1 ? (double)i * (n - 1) / (n_frames - 1) : 0;
    const uint32_t first = s >= n - 1.0 ? (n > 1 ? n - 2 : 0) : (uint32_t)s, second = n > 1 ? first + 1 : first;
    const double t = s - first;
    return (cn_appearance_spec){
        .kind = CN_APPEARANCE_BETWEEN, .t = t * t * (3 - 2 * t), .from = &specs[first], .to = &specs[second]
    };
}

void cn_appearance_cache_forget(cn_appearance_cache *cache)
{
    for (uint32_t i = 0; i < cache->n_aligned; i++) {
        json_decref(cache->aligned[i].root);
        free(cache->aligned[i].path);
    }
    cache->n = cache->n_aligned = 0;
}

void cn_appearance_cache_deinit(cn_appearance_cache *cache)
{
    cn_appearance_cache_forget(cache);
    free(cache->fits);
    free(cache->aligned);
    for (uint32_t i = 0; i < cache->n_queries; i++)
        cn_query_image_deinit(&cache->queries[i].query);
    free(cache->queries);
    *cache = (cn_appearance_cache){ 0 };
}

cn_status cn_appearance_cache_add_aligned(cn_appearance_cache *cache, const cn_appearance_spec *spec, json_t *root,
                                          const char *path)
{
    cn_appearance_aligned *larger = realloc(cache->aligned, (cache->n_aligned + 1) * sizeof *larger);
    char *copy = strdup(path);
    if (larger) cache->aligned = larger;
    if (!larger || !copy) {
        json_decref(root);
        free(copy);
        return cn_fail(CN_ERR_NOMEM, "out of memory for matched appearances");
    }
    cn_appearance_aligned *m = &larger[cache->n_aligned++];
    *m = (cn_appearance_aligned){ .kind = spec->kind, .root = root, .path = copy };
    memcpy(m->photo, spec->a, sizeof m->photo);
    return CN_OK;
}

/* The aligned row, if there is one. */
static cn_status matched(const cn_appearance_cache *cache, cn_appearance_kind kind, const char *photo,
                         const cn_tile *tile, cn_appearance *row, bool *found)
{
    *found = false;
    for (uint32_t i = 0; i < cache->n_aligned; i++) {
        const cn_appearance_aligned *m = &cache->aligned[i];
        if (m->kind != kind || strcmp(m->photo, photo) != 0) continue;
        const json_t *effects = json_object_get(json_object_get(m->root, "tiles"), cn_tile_id(tile));
        *found = effects != NULL;
        return effects ? cn_tile_appearance_from_json(tile, effects, m->path, row) : CN_OK;
    }
    return CN_OK;
}

static const cn_view *view_of(const cn_dataset *m, const char *photo)
{
    const int64_t i = cn_scene_find_view(&m->scene, photo);
    return i < 0 ? NULL : &m->scene.views[i];
}

enum { FIT_RAYS = 4096, STREAM_X = 40, STREAM_Y = 41 };

/* Random pixels of a photo, as rays. */
typedef struct sample {
    double origin[FIT_RAYS][3], direction[FIT_RAYS][3];
    float target[FIT_RAYS][4];
    size_t n;
} sample;

/* A photo's pose and pixels. */
typedef struct shot {
    const cn_scene *scene;
    const cn_view *view;
    const cn_pixel_store *pixels;
} shot;

cn_status cn_appearance_cache_add_query(cn_appearance_cache *cache, const char *path, cn_query_image *query)
{
    cn_appearance_query *larger = realloc(cache->queries, (cache->n_queries + 1) * sizeof *larger);
    if (!larger) return cn_fail(CN_ERR_NOMEM, "out of memory for photo %s", path);
    cache->queries = larger;
    snprintf(larger[cache->n_queries].path, sizeof larger->path, "%s", path);
    larger[cache->n_queries++].query = *query;
    *query = (cn_query_image){ 0 };
    return CN_OK;
}

/* A query photo; its pose is found once. */
static cn_status query_image_of(const cn_context *ctx, const cn_dataset *m, const char *path,
                                cn_appearance_cache *cache, const cn_query_image **query)
{
    for (uint32_t i = 0; i < cache->n_queries; i++) {
        *query = &cache->queries[i].query;
        if (strcmp(cache->queries[i].path, path) == 0) return CN_OK;
    }
    cn_query_image found;
    CN_TRY(cn_query_image_localise(ctx, m, path, "poses", &found));
    const cn_status status = cn_appearance_cache_add_query(cache, path, &found);
    cn_query_image_deinit(&found);
    if (status == CN_OK) *query = &cache->queries[cache->n_queries - 1].query;
    return status;
}

static cn_status shot_of(const cn_context *ctx, const cn_dataset *m, const char *photo, cn_appearance_cache *cache,
                         shot *out)
{
    *out = (shot){ &m->scene, view_of(m, photo), m->pixels };
    if (out->view) return cn_dataset_need_pixels(m);
    if (photo[0] != '/')
        return cn_fail(
            CN_ERR_USAGE,
            "photo %s has no pose, so no appearance can be fitted to it; add it to the photos and run `conurb poses`",
            photo);
    const cn_query_image *query = NULL;
    CN_TRY(query_image_of(ctx, m, photo, cache, &query));
    *out = (shot){ &query->scene, query->scene.views, query->pixels };
    return CN_OK;
}

static cn_status draw(const shot *from, const cn_vignetting *lens, bool left, sample *s)
{
    const cn_view *view = from->view;
    const cn_pixel_extent size = cn_pixel_store_extent(from->pixels, view->photo);
    cn_camera camera;
    cn_camera_resize(&from->scene->cameras[view->camera], size.width, size.height, &camera);
    double centre[3];
    cn_view_centre(view, centre);
    const uint32_t width = left && size.width > 1 ? size.width / 2 : size.width, n_pixels = width * size.height,
                   n_rays = n_pixels < FIT_RAYS ? n_pixels : FIT_RAYS;
    s->n = 0;
    for (uint32_t i = 0; i < n_rays; i++) {
        /* From left to right, so that the fit can try one half's row on the other. */
        const double across = (i + (double)cn_rng_float(1, STREAM_X, i)) / n_rays;
        const uint16_t x = (uint16_t)fmin(across * width, width - 1.0),
                       y = (uint16_t)cn_rng_below(1, STREAM_Y, i, size.height);
        double in_camera[3];
        if (cn_camera_unproject(&camera, x + 0.5, y + 0.5, in_camera) != CN_OK) continue;
        CN_TRY(cn_pixel_store_gather(from->pixels, 1, &view->photo, &x, &y, s->target[s->n]));
        if (!cn_vignetting_is_none(lens)) cn_vignetting_remove(lens, size, x, y, s->target[s->n]);
        cn_mat3_tvec(view->rotation, in_camera, s->direction[s->n]);
        memcpy(s->origin[s->n++], centre, sizeof centre);
    }
    return CN_OK;
}

/* A tile of a city, for which rows are made. */
typedef struct place {
    const cn_context *ctx;
    const cn_dataset *dataset;
    const cn_tile *tile;
    cn_appearance_cache *cache;
} place;

static cn_status fit_row(const place *p, const char *photo, bool left, cn_appearance *row)
{
    const cn_tile *tile = p->tile;
    shot from;
    CN_TRY(shot_of(p->ctx, p->dataset, photo, p->cache, &from));
    CN_TRY(cn_tile_appearance(tile, cn_tile_has_photo(tile, photo) ? photo : NULL, row));
    cn_vignetting lens = { 0 };
    if (from.scene == &p->dataset->scene)
        CN_TRY(cn_lens_vignetting(p->dataset, tile, from.view, &lens));
    else
        cn_tile_appearance_unfreeze(tile, row);
    sample *s = malloc(sizeof *s);
    if (!s) return cn_fail(CN_ERR_NOMEM, "out of memory while fitting the appearance of %s", photo);
    const cn_appearance mean = *row;
    double rmse;
    cn_status status = draw(&from, &lens, left, s);
    if (status == CN_OK) {
        status = cn_fit_appearance(
            p->ctx, tile,
            &(cn_lit_rays){
                { s->n, (const double(*)[3])s->origin, (const double(*)[3])s->direction }, s->target[0], true },
            row, &rmse);
        if (status == CN_ERR_DATA) { /* the tile does not see this photo's places */
            *row = mean;
            status = CN_OK;
        }
    }
    free(s);
    return status;
}

static const cn_appearance_fit *find_fit(const cn_appearance_cache *cache, const cn_tile *tile, const char *photo,
                                         cn_appearance_kind kind)
{
    for (uint32_t i = 0; i < cache->n; i++) {
        const cn_appearance_fit *f = &cache->fits[i];
        if (f->kind == kind && strcmp(f->tile, cn_tile_id(tile)) == 0 && strcmp(f->photo, photo) == 0) return f;
    }
    return NULL;
}

cn_status cn_appearance_cache_add_fit(cn_appearance_cache *cache, const cn_tile *tile, const char *photo,
                                      cn_appearance_kind kind, const cn_appearance *row)
{
    if (cache->n == cache->room) {
        const uint32_t room = cache->room ? 2 * cache->room : 16;
        cn_appearance_fit *larger = realloc(cache->fits, room * sizeof *larger);
        if (!larger) return cn_fail(CN_ERR_NOMEM, "out of memory for fitted appearances");
        cache->fits = larger;
        cache->room = room;
    }
    cn_appearance_fit *f = &cache->fits[cache->n++];
    *f = (cn_appearance_fit){ .kind = kind, .row = *row };
    snprintf(f->tile, sizeof f->tile, "%s", cn_tile_id(tile));
    snprintf(f->photo, sizeof f->photo, "%s", photo);
    return CN_OK;
}

/* kind: CN_APPEARANCE_FIT or CN_APPEARANCE_FIT_LEFT. */
static cn_status fitted(const place *p, const char *photo, cn_appearance_kind kind, cn_appearance *row)
{
    const cn_appearance_fit *known = find_fit(p->cache, p->tile, photo, kind);
    if (known) {
        *row = known->row;
        return CN_OK;
    }
    CN_TRY(fit_row(p, photo, kind == CN_APPEARANCE_FIT_LEFT, row));
    return cn_appearance_cache_add_fit(p->cache, p->tile, photo, kind, row);
}

/* The exposure from EXIF; all else is the tile's mean, or the aligned row. */
static cn_status known_row(const cn_tile *tile, const char *photo, const cn_appearance_cache *cache, cn_appearance *row)
{
    const cn_appearance_fit *matched = find_fit(cache, tile, photo, CN_APPEARANCE_KNOWN);
    if (!matched) return cn_tile_appearance(tile, cn_tile_has_photo(tile, photo) ? photo : NULL, row);
    *row = matched->row;
    return CN_OK;
}

static cn_status photo_row(const place *p, const char *photo, cn_appearance *row)
{
    bool found;
    CN_TRY(matched(p->cache, CN_APPEARANCE_PHOTO, photo, p->tile, row, &found));
    if (found) return CN_OK;
    if (cn_tile_trained_on(p->tile, photo)) return cn_tile_appearance(p->tile, photo, row);
    return fitted(p, photo, CN_APPEARANCE_FIT, row);
}

cn_status cn_appearance_spec_row(const cn_appearance_spec *spec, const cn_context *ctx, const cn_dataset *m,
                                 const cn_tile *tile, cn_appearance_cache *cache, cn_appearance *row)
{
    if (!cn_tile_has_appearance(tile)) return cn_tile_appearance(tile, NULL, row);
    const place p = { ctx, m, tile, cache };
    cn_appearance b;
    bool found = false;
    if (spec->kind == CN_APPEARANCE_MEAN || spec->kind == CN_APPEARANCE_FIT)
        CN_TRY(matched(cache, spec->kind, spec->a, tile, row, &found));
    if (found) return CN_OK;
    switch (spec->kind) {
    case CN_APPEARANCE_PHOTO: return photo_row(&p, spec->a, row);
    case CN_APPEARANCE_KNOWN: return known_row(tile, spec->a, cache, row);
    case CN_APPEARANCE_FIT:
    case CN_APPEARANCE_FIT_LEFT: return fitted(&p, spec->a, spec->kind, row);
    case CN_APPEARANCE_MIX:
        if (spec->first)
            CN_TRY(cn_appearance_spec_row(spec->first, ctx, m, tile, cache, row));
        else
            CN_TRY(photo_row(&p, spec->a, row));
        CN_TRY(spec->second ? cn_appearance_spec_row(spec->second, ctx, m, tile, cache, &b)
                            : photo_row(&p, spec->b, &b));
        cn_appearance_mix(row, &b, spec->t, row);
        return CN_OK;
    case CN_APPEARANCE_BETWEEN:
        CN_TRY(cn_appearance_spec_row(spec->from, ctx, m, tile, cache, row));
        CN_TRY(cn_appearance_spec_row(spec->to, ctx, m, tile, cache, &b));
        cn_appearance_mix(row, &b, spec->t, row);
        return CN_OK;
    case CN_APPEARANCE_FILE: {
        const json_t *effects = json_object_get(json_object_get(spec->file, "tiles"), cn_tile_id(tile));
        return effects ? cn_tile_appearance_from_json(tile, effects, spec->a, row)
                       : cn_tile_appearance(tile, NULL, row);
    }
    case CN_APPEARANCE_MEAN: break;
    }
    return cn_tile_appearance(tile, NULL, row);
}
