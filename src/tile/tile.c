#include "tile/model.h"

#include "base/json.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

static cn_status read_u32(const json_t *o, const char *path, const char *key, uint32_t *value)
{
    int64_t n;
    CN_TRY(cn_json_integer(o, path, key, &n));
    if (n < 0 || n > UINT32_MAX)
        return cn_fail(CN_ERR_FORMAT, "%s: '%s' is out of range; train the tile again", path, key);
    *value = (uint32_t)n;
    return CN_OK;
}

/* Older files have no type; they are hash grids. */
static cn_status read_field(const json_t *root, const char *path, cn_field_options *field)
{
    const json_t *o = json_object_get(root, "field");
    const char *type = json_string_value(json_object_get(o, "type"));
    uint32_t n;
    if (cn_field_options_preset(type ? type : "hash", CN_QUALITY_STANDARD, field) != CN_OK)
        return cn_fail(CN_ERR_VERSION, "%s: this Conurb has no field type '%.32s'; update Conurb", path, type);
    const cn_field_option *options = cn_field_type_options(field->type, &n);
    for (uint32_t i = 0; i < n; i++) {
        double value;
        CN_TRY(cn_json_number(o, path, options[i].name, &value));
        if (cn_field_options_set(field, options[i].name, value) != CN_OK)
            return cn_fail(CN_ERR_FORMAT, "%s: '%s' is out of range; train the tile again", path, options[i].name);
    }
    return CN_OK;
}

static cn_status read_box(const json_t *root, const char *path, cn_box *box)
{
    double near_m, far_m, step;
    CN_TRY(cn_json_numbers(root, path, "centre_m", box->centre, 3));
    CN_TRY(cn_json_numbers(root, path, "half_extent_m", box->half_extent, 3));
    CN_TRY(cn_json_number(root, path, "near_m", &near_m));
    CN_TRY(cn_json_number(root, path, "far_m", &far_m));
    CN_TRY(cn_json_number(root, path, "step", &step));
    bool good = near_m > 0 && far_m > near_m && isfinite(far_m) && step > 1e-5 && step < 1;
    for (int a = 0; a < 3; a++)
        good = good && isfinite(box->centre[a]) && box->half_extent[a] > 0 && isfinite(box->half_extent[a]);
    if (!good) return cn_fail(CN_ERR_FORMAT, "%s: the tile's box or ray range is invalid; train the tile again", path);
    box->near_m = (float)near_m;
    box->far_m = (float)far_m;
    box->step = (float)step;
    return CN_OK;
}

static cn_status read_effects(cn_tile *tile, const json_t *root, int64_t format, const char *path)
{
    const json_t *effects, *photos;
    CN_TRY(cn_json_array(root, path, "effects", &effects));
    CN_TRY(cn_json_array(root, path, "photos", &photos));
    CN_TRY(read_u32(root, path, "trained_photos", &tile->n_trained));
    const char *names[CN_MAX_EFFECTS];
    const size_t n = json_array_size(effects);
    if (n > CN_MAX_EFFECTS || tile->n_trained > json_array_size(photos))
        return cn_fail(CN_ERR_FORMAT, "%s: the lists of effects or photos are invalid; train the tile again", path);
    for (size_t i = 0; i < n; i++) {
        names[i] = json_string_value(json_array_get(effects, i));
        if (!names[i]) return cn_fail(CN_ERR_FORMAT, "%s: an effect has no name; train the tile again", path);
        names[i] = cn_effect_form(names[i], format);
    }
    tile->names = calloc(json_array_size(photos) + 1, sizeof *tile->names);
    for (size_t i = 0; tile->names && i < json_array_size(photos); i++) {
        const char *name = json_string_value(json_array_get(photos, i));
        if (!name) return cn_fail(CN_ERR_FORMAT, "%s: a photo has no name; train the tile again", path);
        tile->names[i] = strdup(name);
        if (!tile->names[i]) return cn_fail(CN_ERR_NOMEM, "out of memory while opening %s", path);
        tile->n_names++;
    }
    if (!tile->names) return cn_fail(CN_ERR_NOMEM, "out of memory while opening %s", path);
    CN_TRY(cn_effect_pack_make(&tile->one, (uint32_t)n, names, 1));
    if (tile->one.n_constants + tile->one.n_photo > CN_APPEARANCE_MAX)
        return cn_fail(CN_ERR_FORMAT,
                       "%s: its effects have more values per photo than this version reads; train the tile again",
                       path);
    cn_effect_pack_for_render(&tile->one);
    return cn_effect_pack_make(&tile->pack, (uint32_t)n, names, tile->n_names);
}

/* A tile's file. */
typedef struct source {
    const cn_bundle *bundle;
    const char *path;
} source;

/* A tensor of exactly this type and shape. */
static cn_status tensor(const source *from, const char *name, cn_dtype dtype, uint32_t n_dims, const uint64_t *dims,
                        const void **data)
{
    *data = NULL;
    const cn_tensor *t = cn_bundle_find(from->bundle, name);
    bool good = t && t->dtype == dtype && t->n_dims == n_dims && (uintptr_t)t->data % 4 == 0;
    for (uint32_t i = 0; good && i < n_dims; i++)
        good = t->dims[i] == dims[i];
    if (!good)
        return cn_fail(CN_ERR_FORMAT, "%s: tensor '%s' is missing or has another shape; train the tile again",
                       from->path, name);
    *data = t->data;
    return CN_OK;
}

/* Table and occupancy are read at random while the tile is open. They are copied into huge pages, and the file is
 * closed. */
static cn_status take_grids(cn_tile *tile, const void *bits, const cn_seen *seen)
{
    const size_t entry = 2 * sizeof(uint16_t), bits_size = CN_OCC_CELLS / 8, places_size = CN_SEEN_PLACES / 8,
                 distance_size = sizeof(float) * CN_SEEN_DIRECTIONS;
    cn_arena counter;
    cn_arena_count(&counter);
    cn_arena_take(&counter, tile->field.entries, entry);
    cn_arena_take(&counter, 1, bits_size);
    if (seen->places) cn_arena_take(&counter, 1, places_size);
    if (seen->places) cn_arena_take(&counter, 1, distance_size);
    if (seen->reach) cn_arena_take(&counter, 1, distance_size);
    if (seen->places) cn_arena_take(&counter, 1, CN_SEEN_DIRECTIONS);
    CN_TRY(cn_arena_init(&tile->memory, counter.used));
    tile->table = cn_arena_take(&tile->memory, tile->field.entries, entry);
    tile->occupancy = memcpy(cn_arena_take(&tile->memory, 1, bits_size), bits, bits_size);
    if (!seen->places) return CN_OK;
    tile->seen.places = memcpy(cn_arena_take(&tile->memory, 1, places_size), seen->places, places_size);
    tile->seen.distance = memcpy(cn_arena_take(&tile->memory, 1, distance_size), seen->distance, distance_size);
    if (seen->reach)
        tile->seen.reach = memcpy(cn_arena_take(&tile->memory, 1, distance_size), seen->reach, distance_size);
    tile->seen.matter = memcpy(cn_arena_take(&tile->memory, 1, CN_SEEN_DIRECTIONS), seen->matter, CN_SEEN_DIRECTIONS);
    return CN_OK;
}

/* A tile without a sky lacks them, and so does a tile of an earlier version. */
static cn_status read_seen(const source *from, cn_seen *seen)
{
    const uint64_t places[1] = { CN_SEEN_PLACES / 32 }, directions[2] = { CN_SEEN_UP, CN_SEEN_AROUND };
    const void *data;
    *seen = (cn_seen){ 0 };
    if (!cn_bundle_find(from->bundle, "seen.places")) return CN_OK;
    CN_TRY(tensor(from, "seen.places", CN_U32, 1, places, &data));
    seen->places = data;
    CN_TRY(tensor(from, "seen.distance", CN_F32, 2, directions, &data));
    seen->distance = data;
    if (cn_bundle_find(from->bundle, "seen.reach")) {
        CN_TRY(tensor(from, "seen.reach", CN_F32, 2, directions, &data));
        seen->reach = data;
    }
    CN_TRY(tensor(from, "seen.matter", CN_U8, 2, directions, &data));
    seen->matter = data;
    return CN_OK;
}

static cn_status read_parameters(cn_tile *tile, const source *from)
{
    const uint64_t bits_dims[1] = { CN_OCC_CELLS / 32 };
    const void *data;
    CN_TRY(tensor(from, "occupancy.bits", CN_U32, 1, bits_dims, &data));
    cn_seen seen;
    CN_TRY(read_seen(from, &seen));
    CN_TRY(take_grids(tile, data, &seen));
    for (uint32_t i = 0; i < tile->field.n_blocks; i++) {
        const cn_field_block *b = &tile->field.block[i];
        const bool table = b->storage == CN_FIELD_TABLE;
        CN_TRY(tensor(from, b->name, table ? CN_BF16 : CN_F32, 2, b->dims, &data));
        if (table)
            memcpy(tile->table + b->offset, data, sizeof(uint32_t) * b->dims[0]);
        else
            memcpy(tile->weights + b->offset, data, sizeof(float) * b->dims[0] * b->dims[1]);
    }
    tile->field.type->prepare(&tile->field, tile->weights, tile->field_derived);
    return CN_OK;
}

static cn_status read_rows(cn_tile *tile, const source *from)
{
    char name[64];
    const void *data;
    for (uint32_t i = 0; i < tile->pack.n_on; i++) {
        const cn_effect_step *s = &tile->pack.on[i];
        const uint64_t constants[2] = { tile->n_names, s->effect->photo_constants };
        const uint64_t params[2] = { tile->n_names, s->effect->photo_params };
        const uint64_t shared[1] = { s->effect->shared_params };
        if (constants[1]) {
            snprintf(name, sizeof name, "effect.%s.constants", s->effect->name);
            CN_TRY(tensor(from, name, CN_F32, 2, constants, &data));
            memcpy(tile->constants + s->constants, data, sizeof(float) * constants[0] * constants[1]);
        }
        if (params[1]) {
            snprintf(name, sizeof name, "effect.%s.params", s->effect->name);
            CN_TRY(tensor(from, name, CN_F32, 2, params, &data));
            memcpy(tile->effect_params + s->photo, data, sizeof(float) * params[0] * params[1]);
        }
        if (shared[0]) {
            snprintf(name, sizeof name, "effect.%s.shared", s->effect->name);
            CN_TRY(tensor(from, name, CN_F32, 1, shared, &data));
            memcpy(tile->shared + s->shared, data, sizeof(float) * shared[0]);
        }
    }
    cn_effects_derive(&tile->pack, tile->shared, tile->derived);
    return CN_OK;
}

static bool names_effect(const json_t *root, const char *effect)
{
    const json_t *effects = json_object_get(root, "effects");
    for (size_t i = 0; i < json_array_size(effects); i++) {
        const char *name = json_string_value(json_array_get(effects, i));
        if (name && strcmp(name, effect) == 0) return true;
    }
    return false;
}

static cn_status read_tile(cn_tile *tile, const cn_bundle *bundle, const json_t *root, const char *path)
{
    int64_t format;
    const char *id;
    cn_field_options options;
    CN_TRY(cn_json_integer(root, path, "format", &format));
    if (format > CN_TILE_FORMAT)
        return cn_fail(CN_ERR_VERSION, "%s has tile format %d, this Conurb reads up to %d; update Conurb", path,
                       (int)format, CN_TILE_FORMAT);
    if (format == 2 && names_effect(root, "sky"))
        return cn_fail(CN_ERR_VERSION, "%s has the sky of tile format 2, which is no longer drawn; train it again",
                       path);
    CN_TRY(cn_json_string(root, path, "id", &id));
    snprintf(tile->id, sizeof tile->id, "%s", id);
    CN_TRY(cn_json_number(root, path, "radius_m", &tile->radius_m));
    CN_TRY(read_box(root, path, &tile->box));
    CN_TRY(read_field(root, path, &options));
    CN_TRY(read_effects(tile, root, format, path));
    if (cn_field_layout(&tile->field, &options, (cn_field_inputs){ tile->pack.conditioning, tile->pack.harmonics }) !=
        CN_OK)
        return cn_fail(CN_ERR_FORMAT, "%s: the field's sizes are invalid; train the tile again", path);
    tile->weights = calloc(tile->field.n_weights + tile->field.n_derived, sizeof(float));
    tile->constants = calloc(tile->pack.n_constants + tile->pack.n_photo + 2 * tile->pack.n_shared + 1, sizeof(float));
    if (!tile->weights || !tile->constants) return cn_fail(CN_ERR_NOMEM, "out of memory while opening %s", path);
    tile->field_derived = tile->weights + tile->field.n_weights;
    tile->effect_params = tile->constants + tile->pack.n_constants;
    tile->shared = tile->effect_params + tile->pack.n_photo;
    tile->derived = tile->shared + tile->pack.n_shared;
    const source from = { bundle, path };
    CN_TRY(read_parameters(tile, &from));
    tile->params = (cn_field_params){ tile->table, tile->weights, tile->field_derived, 0, NULL };
    return read_rows(tile, &from);
}

cn_status cn_tile_open(cn_tile **out, const char *path)
{
    static uint64_t serials;
    *out = NULL;
    cn_tile *tile = calloc(1, sizeof *tile);
    if (!tile) return cn_fail(CN_ERR_NOMEM, "out of memory while opening %s", path);
    tile->serial = __atomic_add_fetch(&serials, 1, __ATOMIC_RELAXED);
    cn_bundle *bundle = NULL;
    cn_status status = cn_bundle_open(&bundle, path, true);
    if (status == CN_OK) {
        const char *text = cn_bundle_get(bundle, "conurb.tile");
        json_t *root = text ? json_loads(text, JSON_REJECT_DUPLICATES, NULL) : NULL;
        status = root ? read_tile(tile, bundle, root, path)
                      : cn_fail(CN_ERR_FORMAT, "%s is not a tile of Conurb (no 'conurb.tile' in its metadata)", path);
        json_decref(root);
    }
    cn_bundle_destroy(&bundle);
    if (status != CN_OK)
        cn_tile_close(&tile);
    else
        *out = tile;
    return status;
}

void cn_tile_close(cn_tile **tile)
{
    if (!tile || !*tile) return;
    for (uint32_t i = 0; i < (*tile)->n_names; i++)
        free((*tile)->names[i]);
    free((*tile)->names);
    free((*tile)->weights);
    free((*tile)->constants);
    cn_arena_deinit(&(*tile)->memory);
    free(*tile);
    *tile = NULL;
}

const char *cn_tile_id(const cn_tile *tile)
{
    return tile->id;
}
void cn_tile_centre(const cn_tile *tile, double centre_m[3])
{
    memcpy(centre_m, tile->box.centre, sizeof tile->box.centre);
}
double cn_tile_radius(const cn_tile *tile)
{
    return tile->radius_m;
}

uint64_t cn_tile_bytes(const cn_tile *tile)
{
    return tile->field.entries * 4 + CN_OCC_CELLS / 8 +
           (tile->seen.places ? CN_SEEN_PLACES / 8 + (tile->seen.reach ? 9 : 5) * CN_SEEN_DIRECTIONS : 0) +
           (tile->field.n_weights + tile->field.n_derived) * 4 +
           (tile->pack.n_constants + tile->pack.n_photo + 2 * tile->pack.n_shared) * 4;
}

bool cn_tile_has_appearance(const cn_tile *tile)
{
    for (uint32_t i = 0; i < tile->one.n_on; i++) {
        const cn_effect *e = tile->one.on[i].effect;
        if (!e->training_only && e->photo_constants + e->photo_params) return true;
    }
    return false;
}
