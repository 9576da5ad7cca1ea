#include "tile/model.h"

#include "base/json.h"

#include <stdio.h>
#include <stdlib.h>

static json_t *strings(const char *const *list, uint32_t n)
{
    json_t *array = json_array();
    for (uint32_t i = 0; i < n; i++)
        json_array_append_new(array, json_string(list[i]));
    return array;
}

/* {"type": "hash", "levels": 16, ...} */
static json_t *describe_field(const cn_field_options *field)
{
    uint32_t n;
    const cn_field_option *options = cn_field_type_options(field->type, &n);
    json_t *object = json_pack("{s:s}", "type", field->type);
    for (uint32_t i = 0; object && i < n; i++)
        json_object_set_new(object, options[i].name,
                            options[i].whole ? json_integer((json_int_t)field->value[i]) : json_real(field->value[i]));
    return object;
}

static json_t *describe(const cn_tile_parts *p)
{
    json_t *effects = json_array();
    for (uint32_t i = 0; i < p->pack->n_on; i++)
        json_array_append_new(effects, json_string(p->pack->on[i].effect->name));
    return json_pack("{s:i,s:s,s:o,s:f,s:o,s:f,s:f,s:f,s:o,s:o,s:o,s:i,s:i}", "format", CN_TILE_FORMAT, "id", p->id,
                     "centre_m", cn_json_reals(p->box->centre, 3), "radius_m", p->radius_m, "half_extent_m",
                     cn_json_reals(p->box->half_extent, 3), "near_m", (double)p->box->near_m, "far_m",
                     (double)p->box->far_m, "step", (double)p->box->step, "field", describe_field(&p->field->options),
                     "effects", effects, "photos", strings(p->names, p->n_names), "trained_photos", (int)p->n_trained,
                     "steps", (int)p->steps);
}

static cn_status add_field(cn_bundle *bundle, const cn_tile_parts *p)
{
    for (uint32_t i = 0; i < p->field->n_blocks; i++) {
        const cn_field_block *b = &p->field->block[i];
        if (b->storage == CN_FIELD_TABLE)
            CN_TRY(cn_bundle_add(bundle, b->name, CN_BF16, 2, b->dims, p->table + 2 * b->offset));
        else
            CN_TRY(cn_bundle_add(bundle, b->name, CN_F32, 2, b->dims, p->weights + b->offset));
    }
    return CN_OK;
}

static cn_status add_effects(cn_bundle *bundle, const cn_tile_parts *p)
{
    for (uint32_t i = 0; i < p->pack->n_on; i++) {
        const cn_effect_step *s = &p->pack->on[i];
        char name[64];
        if (s->effect->photo_constants) {
            const uint64_t dims[2] = { p->n_names, s->effect->photo_constants };
            snprintf(name, sizeof name, "effect.%s.constants", s->effect->name);
            CN_TRY(cn_bundle_add(bundle, name, CN_F32, 2, dims, p->constants + s->constants));
        }
        if (s->effect->photo_params) {
            const uint64_t dims[2] = { p->n_names, s->effect->photo_params };
            snprintf(name, sizeof name, "effect.%s.params", s->effect->name);
            CN_TRY(cn_bundle_add(bundle, name, CN_F32, 2, dims, p->effect_params + s->photo));
        }
        if (s->effect->shared_params) {
            const uint64_t dims[1] = { s->effect->shared_params };
            snprintf(name, sizeof name, "effect.%s.shared", s->effect->name);
            CN_TRY(cn_bundle_add(bundle, name, CN_F32, 1, dims, p->shared + s->shared));
        }
    }
    return CN_OK;
}

static cn_status add_seen(cn_bundle *bundle, const cn_seen *seen)
{
    const uint64_t places[1] = { CN_SEEN_PLACES / 32 }, directions[2] = { CN_SEEN_UP, CN_SEEN_AROUND };
    CN_TRY(cn_bundle_add(bundle, "seen.places", CN_U32, 1, places, seen->places));
    CN_TRY(cn_bundle_add(bundle, "seen.distance", CN_F32, 2, directions, seen->distance));
    if (seen->reach) CN_TRY(cn_bundle_add(bundle, "seen.reach", CN_F32, 2, directions, seen->reach));
    return cn_bundle_add(bundle, "seen.matter", CN_U8, 2, directions, seen->matter);
}

static cn_status fill(cn_bundle *bundle, const cn_tile_parts *p)
{
    const uint64_t bits[1] = { CN_OCC_CELLS / 32 };
    CN_TRY(add_field(bundle, p));
    CN_TRY(cn_bundle_add(bundle, "occupancy.bits", CN_U32, 1, bits, p->occupancy));
    if (p->seen) CN_TRY(add_seen(bundle, p->seen));
    CN_TRY(add_effects(bundle, p));
    json_t *root = describe(p);
    char *text = root ? json_dumps(root, JSON_COMPACT | JSON_SORT_KEYS) : NULL;
    json_decref(root);
    if (!text) return cn_fail(CN_ERR_NOMEM, "out of memory while writing tile %s", p->id);
    cn_status status = cn_bundle_set(bundle, "conurb.tile", text);
    free(text);
    CN_TRY(status);
    CN_TRY(cn_bundle_set(bundle, "conurb.version", cn_version()));
    return cn_bundle_set(bundle, "conurb.parent", p->parent_hash ? p->parent_hash : "");
}

cn_status cn_tile_save(const cn_tile_parts *parts, const char *path)
{
    cn_bundle *bundle = NULL;
    CN_TRY(cn_bundle_create(&bundle));
    cn_status status = fill(bundle, parts);
    if (status == CN_OK) status = cn_bundle_write(bundle, path);
    cn_bundle_destroy(&bundle);
    return status;
}
