/* Checkpoints and finished tiles. A checkpoint holds all that the next step depends on; random numbers are
 * counter-based, so the step's number is their state. */
#include "train/trainer.h"

#include "tile/model.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

typedef struct part {
    const char *name;
    void *data;
    size_t n;
    cn_dtype dtype;
} part;
enum { PARTS = 10 };

static void list_parts(const cn_trainer *t, part parts[PARTS])
{
    const part all[PARTS] = {
        { "table", t->table, t->table_n, CN_BF16 },
        { "table.state", t->table_state, t->state_n, CN_BF16 },
        { "flat.value", t->flat.value, t->flat.n, CN_F32 },
        { "flat.m", t->flat.m, t->flat.n, CN_F32 },
        { "flat.v", t->flat.v, t->flat.n, CN_F32 },
        { "occupancy.seen", t->occ.seen, CN_OCC_CELLS, CN_F32 },
        { "constants", t->constants, t->pack.n_constants, CN_F32 },
        { "witness", t->witness, t->witness ? CN_WITNESS_CELLS : 0, CN_F32 },
        { "witness.changed", t->changed, t->changed ? CN_WITNESS_CELLS : 0, CN_F32 },
        { "witness.alone", t->alone, t->alone ? CN_WITNESS_CELLS : 0, CN_F32 },
    };
    memcpy(parts, all, sizeof all);
}

cn_status cn_trainer_save_checkpoint(const cn_trainer *t, const char *key, const char *path)
{
    cn_bundle *bundle = NULL;
    CN_TRY(cn_bundle_create(&bundle));
    part parts[PARTS];
    list_parts(t, parts);
    const uint64_t counters[3] = { t->step, t->bad_rays, t->options.steps }, three[1] = { 3 }, two[1] = { 2 },
                   all[1] = { CN_GUARD_VALUES };
    const double adapted[2] = { t->samples_per_group, t->march_step };
    cn_status status = CN_OK;
    for (int i = 0; i < PARTS && status == CN_OK; i++) {
        const uint64_t dims[1] = { parts[i].n };
        if (parts[i].n) status = cn_bundle_add(bundle, parts[i].name, parts[i].dtype, 1, dims, parts[i].data);
    }
    if (status == CN_OK) status = cn_bundle_add(bundle, "state.counters", CN_U64, 1, three, counters);
    if (status == CN_OK) status = cn_bundle_add(bundle, "state.adapted", CN_F64, 1, two, adapted);
    if (status == CN_OK) status = cn_bundle_add(bundle, "state.guard", CN_F64, 1, all, &t->guard);
    if (status == CN_OK) status = cn_bundle_set(bundle, "conurb.checkpoint", key);
    if (status == CN_OK) status = cn_bundle_write(bundle, path);
    cn_bundle_destroy(&bundle);
    return status;
}

static const void *find(const cn_bundle *bundle, const char *name, cn_dtype dtype, size_t n)
{
    const cn_tensor *tensor = cn_bundle_find(bundle, name);
    return tensor && tensor->dtype == dtype && tensor->n_dims == 1 && tensor->dims[0] == n ? tensor->data : NULL;
}

static cn_status restore(cn_trainer *t, const cn_bundle *bundle, const char *path)
{
    part parts[PARTS];
    list_parts(t, parts);
    const uint64_t *counters = find(bundle, "state.counters", CN_U64, 3);
    const double *adapted = find(bundle, "state.adapted", CN_F64, 2);
    const double *guard = find(bundle, "state.guard", CN_F64, CN_GUARD_VALUES);
    bool whole = counters && adapted && guard && adapted[0] >= 1 && adapted[1] > 0;
    for (int i = 0; i < PARTS && whole; i++)
        whole = !parts[i].n || find(bundle, parts[i].name, parts[i].dtype, parts[i].n);
    if (!whole) return cn_fail(CN_ERR_FORMAT, "%s is damaged; delete it to train from the start", path);
    for (int i = 0; i < PARTS; i++)
        if (parts[i].n)
            memcpy(parts[i].data, find(bundle, parts[i].name, parts[i].dtype, parts[i].n),
                   parts[i].n * (parts[i].dtype == CN_F32 ? sizeof(float) : sizeof(uint16_t)));
    cn_field_transpose(&t->field, t->flat.value, t->transposed);
    cn_effects_derive(&t->pack, t->flat.value + t->shared_at, t->derived);
    cn_occupancy_restore(&t->occ);
    t->step = (uint32_t)counters[0];
    t->bad_rays = counters[1];
    t->options.steps = (uint32_t)counters[2];
    t->samples_per_group = adapted[0];
    t->march_step = adapted[1];
    memcpy(&t->guard, guard, sizeof t->guard);
    return CN_OK;
}

cn_status cn_trainer_load_checkpoint(cn_trainer *t, const char *key, const char *path, bool *resumed)
{
    *resumed = false;
    cn_bundle *bundle = NULL;
    CN_TRY(cn_bundle_open(&bundle, path, true));
    const char *made_with = cn_bundle_get(bundle, "conurb.checkpoint");
    cn_status status = CN_OK;
    if (made_with && strcmp(made_with, key) == 0) {
        status = restore(t, bundle, path);
        *resumed = status == CN_OK;
    }
    cn_bundle_destroy(&bundle);
    return status;
}

/* Names of the tile's rows: trained photos, then held-out ones; borrowed strings, caller frees the array. */
static const char **row_names(const cn_trainer *t, uint32_t *n)
{
    const cn_plan_tile *tile = t->input->tile;
    const cn_view *views = t->input->scene->views;
    const char **names = malloc(sizeof *names * ((size_t)t->n_photos + tile->n_held_out + 1));
    *n = 0;
    for (uint32_t i = 0; names && i < t->n_photos; i++)
        names[(*n)++] = views[tile->photos[i]].name;
    for (uint32_t i = 0; names && i < tile->n_held_out; i++)
        names[(*n)++] = views[tile->held_out[i]].name;
    return names;
}

cn_status cn_trainer_save_tile(const cn_trainer *t, const char *parent_hash, const char *path)
{
    uint32_t n_names = 0;
    const char **names = row_names(t, &n_names);
    const char *effects[CN_MAX_EFFECTS];
    for (uint32_t i = 0; i < t->pack.n_on; i++)
        effects[i] = t->pack.on[i].effect->name;
    cn_effect_pack pack;
    cn_status status = cn_effect_pack_make(&pack, t->pack.n_on, effects, n_names);
    float *rows = status == CN_OK ? calloc(pack.n_constants + pack.n_photo + 1, sizeof *rows) : NULL;
    if (status == CN_OK && (!names || !rows)) status = cn_fail(CN_ERR_NOMEM, "out of memory while writing %s", path);
    if (status == CN_OK) {
        const float *params = t->flat.value + t->photo_at;
        /* A render steps as the last training steps did. */
        cn_box box = t->box;
        box.step = (float)fmax(t->box.step, t->march_step);
        cn_train_constants(t->input, &pack, rows);
        for (uint32_t i = 0; i < pack.n_on; i++)
            memcpy(rows + pack.n_constants + pack.on[i].photo, params + t->pack.on[i].photo,
                   sizeof(float) * t->n_photos * pack.on[i].effect->photo_params);
        const cn_tile_parts parts = {
            .id = t->input->tile->id,
            .parent_hash = parent_hash,
            .radius_m = t->input->tile->radius_m,
            .box = &box,
            .field = &t->field,
            .table = t->table,
            .weights = t->flat.value,
            .occupancy = t->occ.bits,
            .pack = &pack,
            .names = names,
            .n_names = n_names,
            .n_trained = t->n_photos,
            .constants = rows,
            .effect_params = rows + pack.n_constants,
            .shared = t->flat.value + t->shared_at,
            .steps = t->step,
        };
        status = cn_tile_save(&parts, path);
    }
    free(names);
    free(rows);
    return status;
}
