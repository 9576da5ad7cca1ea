#include "view/request.h"

#include "base/units.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const struct {
    const char *name;
    cn_ask_kind kind;
} kinds[] = {
    { "view", CN_ASK_VIEW },           { "cancel", CN_ASK_CANCEL }, { "city", CN_ASK_CITY },
    { "tile", CN_ASK_TILE },           { "points", CN_ASK_POINTS }, { "photo", CN_ASK_PHOTO },
    { "save", CN_ASK_SAVE },           { "list", CN_ASK_LIST },     { "transient", CN_ASK_TRANSIENT },
    { "load", CN_ASK_LOAD },           { "film", CN_ASK_FILM },     { "film_stop", CN_ASK_FILM_STOP },
    { "film_show", CN_ASK_FILM_SHOW }, { "fit", CN_ASK_FIT },
};
static const char *const channels[] = { "colour", "depth", "normal", "opacity", "tiles", "occlusion", "coverage" };

static cn_status take_text(const json_t *root, const char *key, char *out, size_t size)
{
    const json_t *value = json_object_get(root, key);
    if (!value || json_is_null(value)) return CN_OK;
    const size_t length = json_string_length(value);
    if (!json_is_string(value) || length >= size || strlen(json_string_value(value)) != length)
        return cn_fail(CN_ERR_USAGE, "message: '%s' is not a text of at most %zu bytes", key, size - 1);
    memcpy(out, json_string_value(value), length + 1);
    return CN_OK;
}

static cn_status take_number(const json_t *root, const char *key, double low, double high, double *out)
{
    const json_t *value = json_object_get(root, key);
    if (!value || json_is_null(value)) return CN_OK;
    const double number = json_number_value(value);
    if (!json_is_number(value) || !(number >= low && number <= high))
        return cn_fail(CN_ERR_USAGE, "message: '%s' is not a number from %g to %g", key, low, high);
    *out = number;
    return CN_OK;
}

static cn_status take_whole(const json_t *root, const char *key, double low, double high, uint32_t *out)
{
    double number = *out;
    CN_TRY(take_number(root, key, low, high, &number));
    *out = (uint32_t)number;
    return CN_OK;
}

static cn_status take_numbers(const json_t *root, const char *key, size_t n, double limit, double *out)
{
    const json_t *list = json_object_get(root, key);
    bool good = json_array_size(list) == n;
    for (size_t i = 0; i < n && good; i++) {
        const json_t *value = json_array_get(list, i);
        out[i] = json_number_value(value);
        good = json_is_number(value) && fabs(out[i]) <= limit;
    }
    return good ? CN_OK : cn_fail(CN_ERR_USAGE, "message: '%s' is not a list of %zu numbers up to %g", key, n, limit);
}

/* Whether the matrix is a rotation: orthonormal rows, right-handed. */
static bool is_rotation(const double r[9])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const double dot = r[3 * i] * r[3 * j] + r[3 * i + 1] * r[3 * j + 1] + r[3 * i + 2] * r[3 * j + 2];
            if (fabs(dot - (i == j)) > 1e-3) return false;
        }
    const double determinant =
        r[0] * (r[4] * r[8] - r[5] * r[7]) - r[1] * (r[3] * r[8] - r[5] * r[6]) + r[2] * (r[3] * r[7] - r[4] * r[6]);
    return determinant > 0;
}

static cn_status take_camera(const json_t *root, cn_ask *ask)
{
    double centre[3], vfov_deg = 60;
    uint32_t width = 0, height = 0;
    CN_TRY(take_numbers(root, "rotation", 9, 1.1, ask->view.rotation));
    CN_TRY(take_numbers(root, "centre", 3, 1e7, centre));
    CN_TRY(take_number(root, "vfov_deg", 0.01, 170, &vfov_deg));
    CN_TRY(take_whole(root, "width", 1, CN_ASK_MAX_SIDE, &width));
    CN_TRY(take_whole(root, "height", 1, CN_ASK_MAX_SIDE, &height));
    if (!width || !height || width * height > CN_ASK_MAX_PIXELS)
        return cn_fail(CN_ERR_USAGE, "message: a picture of %u x %u pixels", width, height);
    if (!is_rotation(ask->view.rotation)) return cn_fail(CN_ERR_USAGE, "message: 'rotation' is not a rotation");
    for (int i = 0; i < 3; i++) {
        const double *row = ask->view.rotation + 3 * i;
        ask->view.translation[i] = -(row[0] * centre[0] + row[1] * centre[1] + row[2] * centre[2]);
    }
    ask->view.photo = UINT32_MAX;
    const double focal_px = height / (2 * tan(vfov_deg * CN_PI / 360));
    ask->camera = (cn_camera){ .lens = CN_LENS_PINHOLE,
                               .width = width,
                               .height = height,
                               .params = { focal_px, focal_px, width / 2.0, height / 2.0 } };
    return CN_OK;
}

static cn_status take_crop(const json_t *root, cn_ask *ask)
{
    const json_t *crop = json_object_get(root, "crop");
    if (!crop || json_is_null(crop)) return CN_OK;
    CN_TRY(take_numbers(root, "crop", 6, 1e7, ask->crop_m));
    for (int i = 0; i < 3; i++)
        if (ask->crop_m[i] > ask->crop_m[i + 3])
            return cn_fail(CN_ERR_USAGE, "message: 'crop' is not the lowest, then the highest x, y and z");
    ask->cropped = true;
    return CN_OK;
}

static cn_status take_channel(const json_t *root, cn_channel *channel)
{
    char name[16] = "colour";
    CN_TRY(take_text(root, "channel", name, sizeof name));
    for (size_t i = 0; i < sizeof channels / sizeof *channels; i++)
        if (strcmp(channels[i], name) == 0) {
            *channel = (cn_channel)i;
            return CN_OK;
        }
    return cn_fail(CN_ERR_USAGE, "message: no channel is named '%s'", name);
}

/* Checks an appearance text. Unlike `conurb render`, a page must not name files of this machine. */
static cn_status take_appearance(const json_t *root, cn_ask *ask)
{
    CN_TRY(take_text(root, "appearance", ask->appearance, sizeof ask->appearance));
    const size_t n = strlen(ask->appearance);
    if (strncmp(ask->appearance, "fit:", 4) == 0 || (n >= 5 && strcmp(ask->appearance + n - 5, ".json") == 0))
        return cn_fail(CN_ERR_USAGE, "message: '%s' names a file; give a photo, a mix or a name", ask->appearance);
    return CN_OK;
}

/* What of the city is shown: of a picture and a film. */
static cn_status take_scene(const json_t *root, cn_ask *ask)
{
    CN_TRY(take_crop(root, ask));
    return take_text(root, "blend", ask->blend, sizeof ask->blend);
}

/* How light is shown: of a picture, a film and a photo. */
static cn_status take_display(const json_t *root, cn_ask *ask)
{
    CN_TRY(take_number(root, "exposure_ev", -20, 20, &ask->exposure_ev));
    CN_TRY(take_text(root, "display_view", ask->display_view, sizeof ask->display_view));
    return take_text(root, "look", ask->look, sizeof ask->look);
}

static cn_status take_picture(const json_t *root, cn_ask *ask)
{
    ask->moving = json_is_true(json_object_get(root, "moving"));
    CN_TRY(take_camera(root, ask));
    CN_TRY(take_channel(root, &ask->channel));
    CN_TRY(take_scene(root, ask));
    CN_TRY(take_text(root, "photo", ask->photo, sizeof ask->photo));
    return take_display(root, ask);
}

static cn_status take_saved(const json_t *root, cn_ask *ask)
{
    char what[16] = "";
    CN_TRY(take_text(root, "what", what, sizeof what));
    ask->is_appearance = strcmp(what, "light") == 0;
    if (!ask->is_appearance && strcmp(what, "path") != 0)
        return cn_fail(CN_ERR_USAGE, "message: 'what' is path or light, not '%s'", what);
    if (ask->kind == CN_ASK_LIST) return CN_OK;
    if (!cn_ask_name_is_safe(ask->name))
        return cn_fail(CN_ERR_USAGE, "name it with letters, digits, '_', '-' and blanks, 64 at most");
    json_t *data = json_object_get(root, "data");
    if (ask->kind != CN_ASK_SAVE) return CN_OK;
    if (!json_is_object(data)) return cn_fail(CN_ERR_USAGE, "message: 'data' is not an object");
    ask->data = json_incref(data);
    ask->fresh = json_is_true(json_object_get(root, "fresh"));
    return CN_OK;
}

static cn_status take_members(const json_t *root, cn_ask *ask)
{
    char type[16] = "";
    size_t i = 0;
    CN_TRY(take_whole(root, "id", 0, UINT32_MAX, &ask->id)); /* first: the answer to a faulty request names it, too */
    CN_TRY(take_text(root, "type", type, sizeof type));
    while (i < sizeof kinds / sizeof *kinds && strcmp(kinds[i].name, type) != 0)
        i++;
    if (i == sizeof kinds / sizeof *kinds) return cn_fail(CN_ERR_USAGE, "message: no type is named '%s'", type);
    ask->kind = kinds[i].kind;
    CN_TRY(take_whole(root, "slot", 0, CN_ASK_SLOTS - 1, &ask->slot));
    CN_TRY(take_text(root, "name", ask->name, sizeof ask->name));
    CN_TRY(take_appearance(root, ask));
    if (ask->kind == CN_ASK_VIEW) return take_picture(root, ask);
    if (ask->kind == CN_ASK_SAVE || ask->kind == CN_ASK_LIST || ask->kind == CN_ASK_LOAD) return take_saved(root, ask);
    CN_TRY(take_whole(root, "width", 16, CN_ASK_MAX_SIDE, &ask->width));
    ask->straight = json_is_true(json_object_get(root, "straight"));
    CN_TRY(take_whole(root, "frame", 0, 99999, &ask->frame));
    if (ask->kind == CN_ASK_FILM || ask->kind == CN_ASK_PHOTO) CN_TRY(take_display(root, ask));
    if (ask->kind == CN_ASK_FILM) CN_TRY(take_scene(root, ask));
    if ((ask->kind == CN_ASK_FILM || ask->kind == CN_ASK_FILM_SHOW) && !cn_ask_name_is_safe(ask->name))
        return cn_fail(CN_ERR_USAGE, "message: no path is named '%s'", ask->name);
    return CN_OK;
}

cn_status cn_ask_parse(cn_ask *ask, const char *text, size_t size)
{
    json_error_t error;
    *ask = (cn_ask){ 0 };
    if (size > CN_ASK_MAX_BYTES) return cn_fail(CN_ERR_USAGE, "message: %zu bytes are too many", size);
    json_t *root = json_loadb(text, size, JSON_REJECT_DUPLICATES, &error);
    if (!json_is_object(root)) {
        json_decref(root);
        return cn_fail(CN_ERR_USAGE, "message: not a JSON object");
    }
    cn_status status = take_members(root, ask);
    json_decref(root);
    if (status == CN_OK && ask->kind == CN_ASK_FIT)
        status = cn_fail(CN_ERR_USAGE, "message: a photo comes as a binary message");
    if (status != CN_OK) cn_ask_deinit(ask);
    return status;
}

/* Whether the bytes begin as those of a JPEG or PNG file do. */
static bool is_photo(const uint8_t *bytes, size_t n)
{
    static const uint8_t jpeg[] = { 0xff, 0xd8, 0xff }, png[] = { 0x89, 'P', 'N', 'G' };
    return (n > sizeof jpeg && memcmp(bytes, jpeg, sizeof jpeg) == 0) ||
           (n > sizeof png && memcmp(bytes, png, sizeof png) == 0);
}

static cn_status take_upload(const json_t *root, cn_ask *ask, const uint8_t *file, size_t size)
{
    if (!json_is_object(root)) return cn_fail(CN_ERR_USAGE, "message: its head is not a JSON object");
    CN_TRY(take_members(root, ask));
    if (ask->kind != CN_ASK_FIT) return cn_fail(CN_ERR_USAGE, "message: only a photo comes as a binary message");
    if (!cn_ask_name_is_safe(ask->name))
        return cn_fail(CN_ERR_USAGE, "name the light with letters, digits, '_', '-' and blanks, 64 at most");
    if (!is_photo(file, size)) return cn_fail(CN_ERR_USAGE, "that file is no JPEG or PNG");
    ask->bytes = malloc(size);
    if (!ask->bytes) return cn_fail(CN_ERR_NOMEM, "out of memory for a photo of %zu bytes", size);
    memcpy(ask->bytes, file, size);
    ask->n_bytes = size;
    return CN_OK;
}

cn_status cn_ask_parse_upload(cn_ask *ask, const uint8_t *message, size_t size)
{
    enum { HEAD = 4 };
    uint32_t n = 0;
    *ask = (cn_ask){ 0 };
    for (uint32_t i = 0; i < HEAD && size >= HEAD; i++)
        n |= (uint32_t)message[i] << (8 * i);
    if (size < HEAD || n > size - HEAD || n > CN_ASK_MAX_BYTES || size > CN_ASK_MAX_UPLOAD)
        return cn_fail(CN_ERR_USAGE, "message: a binary message without a whole head");
    json_t *root = json_loadb((const char *)message + HEAD, n, JSON_REJECT_DUPLICATES, NULL);
    const cn_status status = take_upload(root, ask, message + HEAD + n, size - HEAD - n);
    json_decref(root);
    if (status != CN_OK) cn_ask_deinit(ask);
    return status;
}

void cn_ask_deinit(cn_ask *ask)
{
    json_decref(ask->data);
    free(ask->bytes);
    ask->data = NULL;
    ask->bytes = NULL;
}

bool cn_ask_name_is_safe(const char *name)
{
    const size_t n = strlen(name);
    for (const char *c = name; *c; c++)
        if (!(*c >= 'a' && *c <= 'z') && !(*c >= 'A' && *c <= 'Z') && !(*c >= '0' && *c <= '9') && !strchr("_- ", *c))
            return false;
    return n > 0 && n <= 64 && name[0] != ' ' && name[n - 1] != ' ';
}
