/* Writes the trained tile to a file. */
#include "train/trainer.h"

#include "effect/runs.h"
#include "field/islands.h"
#include "tile/model.h"
#include "train/looks.h"
#include "train/unseen_light.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Names of the tile's rows: trained photos, then held-out ones; borrowed strings, caller frees the array. */
static const char **row_names(const cn_trainer *t, uint32_t *n)
{
    const cn_plan_tile *tile = t->input->tile;
    const cn_view *views = t->input->scene->views;
    const char **names = malloc(sizeof *names * ((size_t)t->sampler.n_photos + tile->n_held_out + 1));
    *n = 0;
    for (uint32_t i = 0; names && i < t->sampler.n_photos; i++)
        names[(*n)++] = views[tile->photos[i]].name;
    for (uint32_t i = 0; names && i < tile->n_held_out; i++)
        names[(*n)++] = views[tile->held_out[i]].name;
    return names;
}

/* Sets the rows of held-out photos, as far as a render uses them. */
static cn_status predict_held_out(const cn_trainer *t, const cn_effect_pack *pack, float *params)
{
    const cn_plan_tile *tile = t->input->tile;
    const cn_view **views = malloc(sizeof *views * (pack->n_rows + 1u));
    float *run = malloc(sizeof *run * (pack->n_rows + 1u));
    const bool room = views && run;
    for (uint32_t i = 0; i < pack->n_rows && room; i++) {
        views[i] = &t->input->scene->views[i < tile->n_photos ? tile->photos[i] : tile->held_out[i - tile->n_photos]];
        run[i] = cn_run_time(&t->input->photos->photos[views[i]->photo]);
    }
    if (room) (void)cn_runs_find_trained(run, 1, pack->n_rows, tile->n_photos);
    for (uint32_t e = 0; e < pack->n_on && room; e++) {
        const cn_effect *effect = pack->on[e].effect;
        if (!effect->training_only && effect->photo_params)
            cn_unseen_light(views, run, pack->n_rows, tile->n_photos, effect->photo_params, params + pack->on[e].photo);
    }
    free(views);
    free(run);
    return room ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the tile %s", tile->id);
}

/* Lets the effects change a copy of their shared parameters before it is written. */
static cn_status settle(const cn_trainer *t, float *shared)
{
    const cn_effect_pack *pack = &t->effects.pack;
    float(*dir)[3] = malloc(sizeof *dir * CN_LOOKS);
    uint8_t *look = malloc(CN_LOOKS);
    bool room = dir && look;
    if (room) cn_looks_find(&t->sampler, dir, look);
    const cn_effect_looks looks = { CN_LOOKS, (const float(*)[3])dir, look };
    for (uint32_t e = 0; e < pack->n_on && room; e++)
        if (pack->on[e].effect->settle)
            room = pack->on[e].effect->settle(t->kernel, &looks, shared + pack->on[e].shared);
    free(dir);
    free(look);
    return room ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory while writing tile %s", t->input->tile->id);
}

/* The cells that a render shows. Without sparse points nothing tells a small thing from a mistake, so all islands
 * stay. */
static cn_status find_shown(const cn_trainer *t, uint32_t *shown)
{
    const cn_scene *scene = t->input->scene;
    cn_occupancy_shown(&t->occ, t->step, shown);
    if (!scene || !scene->n_points) return CN_OK;
    uint8_t *held = calloc(CN_OCC_CELLS, 1);
    if (!held) return cn_fail(CN_ERR_NOMEM, "out of memory while writing tile %s", t->input->tile->id);
    for (uint32_t i = 0; i < scene->n_points; i++) {
        float x[3];
        cn_box_contract(&t->box, scene->points[i].xyz, x);
        held[cn_occupancy_cell(x[0], x[1], x[2])] = 1;
    }
    const cn_status status = cn_islands_drop(shown, held);
    free(held);
    return status;
}

cn_status cn_trainer_save_tile(const cn_trainer *t, const char *parent_hash, const char *path)
{
    uint32_t n_names = 0;
    const char **names = row_names(t, &n_names);
    const char *effects[CN_MAX_EFFECTS];
    for (uint32_t i = 0; i < t->effects.pack.n_on; i++)
        effects[i] = t->effects.pack.on[i].effect->name;
    cn_effect_pack pack;
    cn_status status = cn_effect_pack_make(&pack, t->effects.pack.n_on, effects, n_names);
    const size_t n_shared = t->effects.pack.n_shared;
    float *rows = status == CN_OK ? calloc(pack.n_constants + pack.n_photo + 1, sizeof *rows) : NULL,
          *shared = malloc(sizeof *shared * (n_shared + 1));
    uint32_t *shown = malloc(sizeof *shown * (CN_OCC_CELLS / 32));
    if (status == CN_OK && (!names || !rows || !shown || !shared))
        status = cn_fail(CN_ERR_NOMEM, "out of memory while writing %s", path);
    if (status == CN_OK) status = find_shown(t, shown);
    if (status == CN_OK) {
        const float *params = t->parameters.value + t->parameters.photo_at;
        /* A render marches with the step length at the end of training. */
        cn_box box = t->box;
        box.step = (float)fmax(t->box.step, t->sampler.pace.march_step);
        cn_train_constants(t->input, &pack, rows);
        for (uint32_t i = 0; i < pack.n_on; i++)
            memcpy(rows + pack.n_constants + pack.on[i].photo, params + t->effects.pack.on[i].photo,
                   sizeof(float) * t->sampler.n_photos * pack.on[i].effect->photo_params);
        status = predict_held_out(t, &pack, rows + pack.n_constants);
        memcpy(shared, t->parameters.value + t->parameters.shared_at, sizeof *shared * n_shared);
        if (status == CN_OK) status = settle(t, shared);
        const cn_seen seen = { t->looks.places, t->looks.matter, t->looks.distance, t->looks.reach };
        const cn_tile_parts parts = {
            .id = t->input->tile->id,
            .parent_hash = parent_hash,
            .radius_m = t->input->tile->radius_m,
            .box = &box,
            .field = &t->parameters.field,
            .table = t->parameters.table,
            .weights = t->parameters.value,
            .occupancy = shown,
            .seen = t->looks.places ? &seen : NULL,
            .pack = &pack,
            .names = names,
            .n_names = n_names,
            .n_trained = t->sampler.n_photos,
            .constants = rows,
            .effect_params = rows + pack.n_constants,
            .shared = shared,
            .steps = t->step,
        };
        if (status == CN_OK) status = cn_tile_save(&parts, path);
    }
    free(names);
    free(rows);
    free(shown);
    free(shared);
    return status;
}
