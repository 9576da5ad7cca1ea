/* The light of a render: one row of what the tile's effects hold for each photo. */
#include "tile/model.h"

#include "base/json.h"

#include <stdlib.h>

static int64_t find_row(const cn_tile *tile, const char *name)
{
    for (uint32_t i = 0; i < tile->n_names; i++)
        if (strcmp(tile->names[i], name) == 0) return i;
    return -1;
}

bool cn_tile_has_photo(const cn_tile *tile, const char *photo)
{
    return find_row(tile, photo) >= 0;
}

bool cn_tile_trained_on(const cn_tile *tile, const char *photo)
{
    const int64_t row = find_row(tile, photo);
    return row >= 0 && row < tile->n_trained;
}

uint32_t cn_tile_photo_count(const cn_tile *tile)
{
    return tile->n_trained;
}
const char *cn_tile_photo_name(const cn_tile *tile, uint32_t i)
{
    return i < tile->n_trained ? tile->names[i] : NULL;
}

/* Row `row`, or the mean of the trained rows (row < 0), of one packed block of `width` floats a photo. */
static void pick_row(const float *block, uint32_t width, int64_t row, uint32_t n_trained, float *out)
{
    for (uint32_t c = 0; c < width; c++) {
        if (row >= 0) {
            out[c] = block[(size_t)row * width + c];
            continue;
        }
        double sum = 0;
        for (uint32_t i = 0; i < n_trained; i++)
            sum += (double)block[(size_t)i * width + c];
        out[c] = (float)(sum / (n_trained ? n_trained : 1));
    }
}

cn_status cn_tile_appearance(const cn_tile *tile, const char *photo, cn_appearance *appearance)
{
    const int64_t row = photo ? find_row(tile, photo) : -1;
    if (photo && row < 0)
        return cn_fail(CN_ERR_USAGE, "tile %s has no photo named '%s'; `conurb appearance CITY list` names them",
                       tile->id, photo);
    const cn_effect_pack *one = &tile->one;
    *appearance = (cn_appearance){ .n = (uint32_t)(one->n_constants + one->n_photo) };
    for (uint32_t i = 0; i < tile->pack.n_on; i++) {
        const cn_effect_step *from = &tile->pack.on[i], *to = &one->on[i];
        pick_row(tile->constants + from->constants, from->effect->photo_constants, row, tile->n_trained,
                 appearance->row + to->constants);
        pick_row(tile->effect_params + from->photo, from->effect->photo_params, row, tile->n_trained,
                 appearance->row + one->n_constants + to->photo);
    }
    return CN_OK;
}

void cn_tile_appearance_unfreeze(const cn_tile *tile, cn_appearance *appearance)
{
    for (uint32_t i = 0; i < tile->one.n_on; i++) {
        const cn_effect_step *s = &tile->one.on[i];
        if (s->effect->unfreeze) s->effect->unfreeze(appearance->row + s->constants);
    }
}

void cn_appearance_mix(const cn_appearance *a, const cn_appearance *b, double t, cn_appearance *out)
{
    out->n = a->n < b->n ? a->n : b->n;
    for (uint32_t i = 0; i < out->n; i++)
        out->row[i] = (float)((1 - t) * (double)a->row[i] + t * (double)b->row[i]);
}

/* Calls one function for each effect's named slice of a row: constants, then parameters. */
static json_t *slices(const cn_tile *tile, const float *row)
{
    json_t *effects = json_object();
    for (uint32_t i = 0; i < tile->one.n_on; i++) {
        const cn_effect_step *s = &tile->one.on[i];
        const uint32_t n_constants = s->effect->photo_constants, n_params = s->effect->photo_params;
        if (s->effect->training_only || n_constants + n_params == 0) continue;
        json_t *values = json_array();
        for (uint32_t c = 0; c < n_constants; c++)
            json_array_append_new(values, cn_json_real((double)row[s->constants + c]));
        for (uint32_t c = 0; c < n_params; c++)
            json_array_append_new(values, cn_json_real((double)row[tile->one.n_constants + s->photo + c]));
        json_object_set_new(effects, s->effect->name, values);
    }
    return effects;
}

json_t *cn_tile_appearance_to_json(const cn_tile *tile, const cn_appearance *appearance)
{
    return slices(tile, appearance->row);
}

cn_status cn_tile_appearance_from_json(const cn_tile *tile, const json_t *effects, const char *file,
                                       cn_appearance *appearance)
{
    CN_TRY(cn_tile_appearance(tile, NULL, appearance));
    for (uint32_t i = 0; i < tile->one.n_on; i++) {
        const cn_effect_step *s = &tile->one.on[i];
        const uint32_t n_constants = s->effect->photo_constants, n = n_constants + s->effect->photo_params;
        if (s->effect->training_only || n == 0) continue;
        const json_t *values = json_object_get(effects, s->effect->name);
        if (!values) continue; /* the file was written before that effect was on: keep the mean */
        if (json_array_size(values) != n)
            return cn_fail(CN_ERR_FORMAT,
                           "%s: '%s' of tile %s has %zu values, the tile's effect has %u; export it again", file,
                           s->effect->name, tile->id, json_array_size(values), n);
        for (uint32_t c = 0; c < n; c++) {
            const json_t *value = json_array_get(values, c);
            if (!json_is_number(value))
                return cn_fail(CN_ERR_FORMAT, "%s: '%s' of tile %s has a value that is not a number; export it again",
                               file, s->effect->name, tile->id);
            float *at = c < n_constants ? &appearance->row[s->constants + c]
                                        : &appearance->row[tile->one.n_constants + s->photo + c - n_constants];
            *at = (float)json_number_value(value);
        }
    }
    return CN_OK;
}
