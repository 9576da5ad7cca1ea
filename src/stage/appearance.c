/* Appearances by name: lists them, and writes them as files and as pictures. */
#include "renderer/renderer.h"

#include "base/file.h"
#include "base/json.h"
#include "bridge/oiio.h"
#include "conurb/colour.h"
#include "conurb/stage.h"
#include "tile/model.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct desk {
    const cn_context *ctx;
    const cn_city *city;
    cn_dataset m;
    cn_renderer *renderer;
    cn_colour *colour;
} desk;

static cn_status desk_open(desk *d, const cn_context *ctx, const cn_city *city)
{
    *d = (desk){ .ctx = ctx, .city = city };
    CN_TRY(cn_dataset_load(ctx, city, true, &d->m));
    CN_TRY(cn_renderer_open(&d->renderer, ctx, city, &d->m, "tiles"));
    return cn_colour_create(&d->colour, NULL);
}

static void desk_close(desk *d)
{
    cn_colour_destroy(&d->colour);
    cn_renderer_destroy(&d->renderer);
    cn_dataset_deinit(&d->m);
}

/* {"version", "name", "tiles": {ID: {EFFECT: [..]}}} */
static cn_status rows_json(desk *d, const char *text, json_t **out)
{
    cn_appearance_spec spec;
    *out = NULL;
    CN_TRY(cn_appearance_spec_parse(&spec, text, d->city, &d->m.photos));
    json_t *tiles = json_object();
    cn_status status = CN_OK;
    for (uint32_t i = 0; i < d->renderer->tiles.n && status == CN_OK; i++) {
        const cn_tile *tile;
        cn_appearance row;
        status = cn_tile_cache_tile(&d->renderer->tiles, d->renderer->tiles.which[i], &tile);
        if (status == CN_OK) status = cn_renderer_row(d->renderer, d->ctx, &spec, tile, &row);
        if (status == CN_OK) json_object_set_new(tiles, cn_tile_id(tile), cn_tile_appearance_to_json(tile, &row));
    }
    cn_appearance_spec_deinit(&spec);
    char *name = strdup(text ? text : "mean");
    if (name) (void)cn_json_make_utf8(name);
    if (status == CN_OK && name) *out = json_pack("{s:i,s:s,s:O}", "version", 1, "name", name, "tiles", tiles);
    if (status == CN_OK && !*out) status = cn_fail(CN_ERR_NOMEM, "out of memory");
    json_decref(tiles);
    free(name);
    return status;
}

static cn_status check_name(const char *name)
{
    if (*name && !strchr(name, '/') && !strchr(name, ':') && name[0] != '.') return CN_OK;
    return cn_fail(CN_ERR_USAGE, "'%s' cannot name an appearance; give letters and digits, without '/' or ':'", name);
}

/* Localises the photo first, so that COLMAP's files go to `dir`. */
static cn_status fit_to(desk *d, const char *photo, const char *dir, const char *name, const char *file)
{
    char *code = NULL, *absolute = NULL;
    cn_query_image query;
    json_t *root = NULL;
    CN_TRY(cn_path_absolute(photo, &absolute));
    cn_status status = cn_query_image_localise(d->ctx, &d->m, absolute, dir, &query);
    if (status == CN_OK) status = cn_appearance_cache_add_query(&d->renderer->tiles.fits, absolute, &query);
    cn_query_image_deinit(&query);
    if (status == CN_OK) {
        code = cn_format("fit:%s", absolute);
        status = code ? rows_json(d, code, &root) : cn_fail(CN_ERR_NOMEM, "out of memory");
    }
    if (status == CN_OK) json_object_set_new(root, "name", json_string(name));
    if (status == CN_OK) status = cn_folder_of_make(file);
    if (status == CN_OK) status = cn_json_save(root, file);
    json_decref(root);
    free(code);
    free(absolute);
    return status;
}

cn_status cn_city_appearance_fit(const cn_context *ctx, cn_city *city, const char *photo, const char *name)
{
    CN_TRY(check_name(name));
    desk d;
    char *old = cn_city_path(city, "poses/colmap"), *relative = cn_format(CN_APPEARANCE_FITTED "/%s.json", name);
    char *file = relative ? cn_city_path(city, relative) : NULL;
    cn_status status = old && file ? desk_open(&d, ctx, city) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (old && file) {
        const char *dir = d.city->config.poses.import && !cn_file_exists(old) ? "views" : "poses";
        if (status == CN_OK) status = fit_to(&d, photo, dir, name, file);
        desk_close(&d);
    }
    free(file);
    free(relative);
    free(old);
    return status;
}

cn_status cn_city_appearance_show(const cn_context *ctx, cn_city *city, const char *code, char **json)
{
    desk d;
    json_t *root = NULL;
    *json = NULL;
    cn_status status = desk_open(&d, ctx, city);
    if (status == CN_OK) status = rows_json(&d, code, &root);
    if (status == CN_OK) *json = json_dumps(root, JSON_INDENT(2) | JSON_REAL_PRECISION(6));
    if (status == CN_OK && !*json) status = cn_fail(CN_ERR_NOMEM, "out of memory");
    json_decref(root);
    desk_close(&d);
    return status;
}

cn_status cn_city_appearance_export(const cn_context *ctx, cn_city *city, const char *code, const char *file)
{
    desk d;
    json_t *root = NULL;
    cn_status status = desk_open(&d, ctx, city);
    if (status == CN_OK) status = rows_json(&d, code, &root);
    if (status == CN_OK) status = cn_json_save(root, file);
    json_decref(root);
    desk_close(&d);
    return status;
}

/* Each tile that both the file and the city have must accept its row. */
static cn_status try_file(desk *d, const char *file, const cn_appearance_spec *spec)
{
    uint32_t known = 0;
    for (uint32_t i = 0; i < d->renderer->tiles.n; i++) {
        const cn_tile *tile;
        cn_appearance row;
        CN_TRY(cn_tile_cache_tile(&d->renderer->tiles, d->renderer->tiles.which[i], &tile));
        known += json_object_get(json_object_get(spec->file, "tiles"), cn_tile_id(tile)) != NULL;
        CN_TRY(cn_renderer_row(d->renderer, d->ctx, spec, tile, &row));
    }
    return known ? CN_OK
                 : cn_fail(CN_ERR_DATA, "%s holds no appearance for any tile of this city; export it from this city",
                           file);
}

cn_status cn_city_appearance_import(const cn_context *ctx, cn_city *city, const char *file, const char *name)
{
    CN_TRY(check_name(name));
    desk d;
    cn_appearance_spec spec = { 0 };
    cn_status status = desk_open(&d, ctx, city);
    if (status == CN_OK && cn_photo_index_find(&d.m.photos, name) >= 0)
        status = cn_fail(CN_ERR_USAGE, "'%s' is the name of a photo; give another name", name);
    if (status == CN_OK) status = cn_appearance_spec_parse(&spec, file, city, &d.m.photos);
    if (status == CN_OK && spec.kind != CN_APPEARANCE_FILE)
        status = cn_fail(CN_ERR_USAGE, "%s: give a FILE.json to import", file);
    if (status == CN_OK) status = try_file(&d, file, &spec);
    char *dir = cn_city_path(city, "appearances"), *path = dir ? cn_format("%s/%s.json", dir, name) : NULL;
    if (status == CN_OK && !path) status = cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_folder_make(dir);
    if (status == CN_OK) status = cn_json_save(spec.file, path);
    free(path);
    free(dir);
    cn_appearance_spec_deinit(&spec);
    desk_close(&d);
    return status;
}

static cn_status add_entry(cn_appearance_list *list, const char *name, cn_appearance_entry entry)
{
    entry.name = strdup(name);
    if (!entry.name) return cn_fail(CN_ERR_NOMEM, "out of memory");
    list->entries[list->n++] = entry;
    return CN_OK;
}

cn_status cn_city_appearance_list(const cn_context *ctx, cn_city *city, cn_appearance_list *list)
{
    desk d;
    *list = (cn_appearance_list){ 0 };
    json_t *lights = cn_appearance_lights(city);
    cn_status status = desk_open(&d, ctx, city);
    if (status == CN_OK) {
        list->entries = calloc(d.m.scene.n_views + json_array_size(lights) + 1, sizeof *list->entries);
        if (!list->entries) status = cn_fail(CN_ERR_NOMEM, "out of memory");
    }
    for (uint32_t v = 0; status == CN_OK && v < d.m.scene.n_views; v++) {
        const char *name = d.m.scene.views[v].name;
        cn_appearance_entry entry = { .exposure_ev =
                                          cn_photo_exposure_ev(&d.m.photos.photos[d.m.scene.views[v].photo]) };
        for (uint32_t i = 0; i < d.renderer->tiles.n; i++) {
            const cn_plan_tile *t = &d.m.plan.tiles[d.renderer->tiles.which[i]];
            for (uint32_t k = 0; k < t->n_photos; k++)
                entry.n_tiles += t->photos[k] == v;
            for (uint32_t k = 0; k < t->n_held_out; k++)
                entry.held_out = entry.held_out || t->held_out[k] == v;
        }
        if (entry.n_tiles || entry.held_out) status = add_entry(list, name, entry);
    }
    for (size_t i = 0; status == CN_OK && i < json_array_size(lights); i++)
        status = add_entry(list, json_string_value(json_array_get(lights, i)),
                           (cn_appearance_entry){ .exposure_ev = NAN, .is_light = true });
    json_decref(lights);
    desk_close(&d);
    if (status != CN_OK) cn_appearance_list_deinit(list);
    return status;
}

void cn_appearance_list_deinit(cn_appearance_list *list)
{
    for (uint32_t i = 0; i < list->n; i++)
        free(list->entries[i].name);
    free(list->entries);
    *list = (cn_appearance_list){ 0 };
}

/* ---- pictures ---- */

static const cn_view *find_view(const desk *d, const char *photo)
{
    const int64_t found = photo ? cn_photo_index_find(&d->m.photos, photo) : -1;
    for (uint32_t v = 0; v < d->m.scene.n_views; v++)
        if (!photo || (found >= 0 && d->m.scene.views[v].photo == (uint32_t)found)) return &d->m.scene.views[v];
    return NULL;
}

/* Copies a display-encoded picture into a larger one. */
static cn_status paste(const desk *d, cn_picture *picture, float *sheet, uint32_t sheet_width, uint32_t x0, uint32_t y0)
{
    const size_t n = (size_t)picture->width * picture->height;
    CN_TRY(cn_compose_unseen(picture, d->city->config.unseen));
    CN_TRY(cn_colour_to_display(d->colour, NULL, picture->rgba, n, 4));
    for (uint32_t y = 0; y < picture->height; y++)
        for (uint32_t x = 0; x < picture->width; x++)
            memcpy(sheet + 3 * ((size_t)(y0 + y) * sheet_width + x0 + x),
                   picture->rgba + 4 * ((size_t)y * picture->width + x), 3 * sizeof *sheet);
    return CN_OK;
}

/* Names of the sheet's lights: the mean, then every photo trained on. */
static uint32_t sheet_names(const desk *d, const char **names)
{
    uint32_t n = 0;
    names[n++] = NULL;
    for (uint32_t v = 0; v < d->m.scene.n_views; v++) {
        bool trained = false;
        for (uint32_t i = 0; i < d->renderer->tiles.n; i++) {
            const cn_plan_tile *t = &d->m.plan.tiles[d->renderer->tiles.which[i]];
            for (uint32_t k = 0; k < t->n_photos; k++)
                trained = trained || t->photos[k] == v;
        }
        if (trained) names[n++] = d->m.scene.views[v].name;
    }
    return n;
}

enum { GAP = 4, MAX_SHEET = 100 };

static cn_status draw_sheet(desk *d, const cn_view *view, uint32_t width, const char *file)
{
    const cn_camera *own = &d->m.scene.cameras[view->camera];
    const uint32_t height = (uint32_t)fmax(1, round((double)own->height * width / own->width));
    const char **names = calloc(d->m.scene.n_views + 1u, sizeof *names);
    uint32_t n = names ? sheet_names(d, names) : 0;
    if (n > MAX_SHEET) n = MAX_SHEET;
    const uint32_t columns = (uint32_t)ceil(sqrt(n)), rows = n ? (n + columns - 1) / columns : 0;
    const uint32_t sheet_width = columns * (width + GAP) + GAP, sheet_height = rows * (height + GAP) + GAP;
    float *sheet = calloc((size_t)sheet_width * sheet_height * 3 + 1, sizeof *sheet);
    cn_picture picture = { 0 };
    cn_status status = names && sheet ? cn_picture_init(&picture, width, height)
                                      : cn_fail(CN_ERR_NOMEM, "out of memory for the sheet");
    cn_camera camera;
    cn_camera_resize(own, width, height, &camera);
    const cn_render_options options = cn_render_options_default();
    for (uint32_t i = 0; i < n && status == CN_OK; i++) {
        cn_appearance_spec spec = { .kind = names[i] ? CN_APPEARANCE_PHOTO : CN_APPEARANCE_MEAN };
        snprintf(spec.a, sizeof spec.a, "%s", names[i] ? names[i] : "");
        const cn_tile_cache_view shown = { .camera = &camera, .view = view, .options = &options, .appearance = &spec };
        if (cn_stopping(d->ctx)) status = cn_fail(CN_ERR_INTERRUPTED, "stopped; run the same command again");
        if (status == CN_OK) status = cn_renderer_draw(d->renderer, d->ctx, &shown, CN_RENDERER_BLEND, &picture);
        if (status == CN_OK)
            status = paste(d, &picture, sheet, sheet_width, GAP + i % columns * (width + GAP),
                           GAP + i / columns * (height + GAP));
        cn_log(d->ctx, CN_LOG_INFO, "row %u, column %u: %s", i / columns + 1, i % columns + 1,
               names[i] ? names[i] : "mean");
    }
    if (status == CN_OK) status = cn_oiio_write_png(file, sheet, sheet_width, sheet_height, 3, NULL);
    cn_picture_deinit(&picture);
    free(sheet);
    free(names);
    return status;
}

cn_status cn_city_appearance_sheet(const cn_context *ctx, cn_city *city, const char *photo, uint32_t width_px,
                                   const char *file)
{
    desk d;
    cn_status status = desk_open(&d, ctx, city);
    const cn_view *view = status == CN_OK ? find_view(&d, photo) : NULL;
    if (status == CN_OK && !view)
        status = cn_fail(CN_ERR_USAGE, "photo '%s' has no pose; see photos.json", photo ? photo : "");
    if (status == CN_OK) status = draw_sheet(&d, view, width_px ? width_px : 320, file);
    desk_close(&d);
    return status;
}

/* The tile nearest to a view's camera that was trained on it. */
static int64_t tile_of(const desk *d, const cn_view *view)
{
    double centre[3], best = INFINITY;
    int64_t found = -1;
    cn_view_centre(view, centre);
    for (uint32_t i = 0; i < d->renderer->tiles.n; i++) {
        const cn_plan_tile *t = &d->m.plan.tiles[d->renderer->tiles.which[i]];
        const double away = hypot(t->centre[0] - centre[0], t->centre[1] - centre[1]);
        for (uint32_t k = 0; k < t->n_photos; k++)
            if (&d->m.scene.views[t->photos[k]] == view && away < best)
                best = away, found = d->renderer->tiles.which[i];
    }
    return found;
}

#define GREY 0.18f /* grey background, so that dark and bright transients are both visible */

/* The photo, its transients over grey, and their alpha, side by side. */
static cn_status draw_transient(desk *d, const cn_view *view, const char *file)
{
    const int64_t which = tile_of(d, view);
    CN_TRY(cn_dataset_need_pixels(&d->m));
    if (which < 0)
        return cn_fail(CN_ERR_USAGE, "no trained tile was trained on %s: nothing is known of its transients",
                       view->name);
    const cn_tile *tile;
    CN_TRY(cn_tile_cache_tile(&d->renderer->tiles, (uint32_t)which, &tile));
    const cn_pixel_extent size = cn_pixel_store_extent(d->m.pixels, view->photo);
    const size_t n = (size_t)size.width * size.height;
    cn_picture picture;
    CN_TRY(cn_picture_init(&picture, size.width, size.height));
    float *out = malloc(n * 9 * sizeof *out), *alpha = malloc(n * sizeof *alpha);
    cn_status status = out && alpha ? cn_pixel_store_read(d->m.pixels, view->photo, picture.rgba)
                                    : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = paste(d, &picture, out, 3 * size.width, 0, 0);
    if (status == CN_OK) status = cn_render_transient(d->ctx, tile, view->name, &picture);
    for (size_t i = 0; i < n && status == CN_OK; i++) {
        alpha[i] = picture.rgba[4 * i + 3];
        for (size_t c = 0; c < 3; c++)
            picture.rgba[4 * i + c] += GREY * (1 - alpha[i]);
        picture.rgba[4 * i + 3] = 1; /* else the grey would be filled as a place that no tile shows */
    }
    if (status == CN_OK) status = paste(d, &picture, out, 3 * size.width, size.width, 0);
    for (size_t i = 0; i < n && status == CN_OK; i++)
        for (size_t c = 0; c < 3; c++)
            out[3 * (i / size.width * 3 * size.width + 2 * size.width + i % size.width) + c] = alpha[i];
    if (status == CN_OK) status = cn_oiio_write_png(file, out, 3 * size.width, size.height, 3, NULL);
    free(alpha);
    free(out);
    cn_picture_deinit(&picture);
    return status;
}

cn_status cn_city_appearance_transient(const cn_context *ctx, cn_city *city, const char *photo, const char *file)
{
    desk d;
    cn_status status = desk_open(&d, ctx, city);
    const cn_view *view = status == CN_OK ? find_view(&d, photo) : NULL;
    if (status == CN_OK && !view) status = cn_fail(CN_ERR_USAGE, "photo '%s' has no pose; see photos.json", photo);
    if (status == CN_OK) status = draw_transient(&d, view, file);
    desk_close(&d);
    return status;
}
