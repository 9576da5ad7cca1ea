#include "renderer/alignment.h"

#include "base/file.h"
#include "base/hash.h"
#include "base/json.h"
#include "city/lock.h"
#include "tile/model.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

/* An alignment in progress: all tiles of the cache, in its order, or some of them. */
typedef struct align_job {
    const cn_context *ctx;
    cn_tile_cache *tile_cache;
    const cn_appearance_spec *spec;
    cn_alignment_tile *tiles;
    const uint32_t *some; /* NULL: all */
} align_job;

static cn_status open_tile(void *user, uint32_t tile, const cn_tile **out)
{
    align_job *j = user;
    return cn_tile_cache_tile(j->tile_cache, j->tile_cache->which[j->some ? j->some[tile] : tile], out);
}

static cn_status tile_appearance(void *user, const cn_context *ctx, const cn_tile *tile, cn_appearance *row)
{
    align_job *j = user;
    return cn_appearance_spec_row(j->spec, ctx, j->tile_cache->dataset, tile, &j->tile_cache->fits, row);
}

cn_status cn_stage_alignment(const cn_city *city, const cn_plan *plan, const cn_appearance_spec *spec, cn_stage *stage)
{
    char name[17] = "mean", code[640];
    *stage = (cn_stage){ 0 };
    if (spec->kind != CN_APPEARANCE_MEAN) cn_hash_hex(cn_appearance_spec_hash(spec, 0), name);
    cn_appearance_spec_describe(spec, code, sizeof code);
    snprintf(stage->record, sizeof stage->record, "match/%s.stage.json", name);
    snprintf(stage->stamp, sizeof stage->stamp, "match/%s.json", name);
    cn_fingerprint_add(&stage->config, "the appearance", "%s", code);
    return cn_stage_add_tiles(city, plan, stage);
}

/* How well a tile knows a photo: it was trained on it, it held it out, or it does not know it. */
static int knows(const cn_tile_cache *g, const cn_plan_tile *tile, const char *photo)
{
    const cn_view *views = g->dataset->scene.views;
    for (uint32_t i = 0; i < tile->n_photos; i++)
        if (strcmp(views[tile->photos[i]].name, photo) == 0) return 2;
    for (uint32_t i = 0; i < tile->n_held_out; i++)
        if (strcmp(views[tile->held_out[i]].name, photo) == 0) return 1;
    return 0;
}

/* Among the tiles that know the photo best, the one with the most photos. */
static uint32_t choose_root(const cn_tile_cache *g, const cn_appearance_spec *spec)
{
    uint32_t best = 0, most = 0;
    int known = -1;
    for (uint32_t i = 0; i < g->n; i++) {
        const cn_plan_tile *tile = &g->plan->tiles[g->which[i]];
        const int k = spec->kind == CN_APPEARANCE_MEAN ? 0 : knows(g, tile, spec->a);
        if (k < known || (k == known && tile->n_photos <= most)) continue;
        known = k;
        most = tile->n_photos;
        best = i;
    }
    return best;
}

static json_t *edges_json(const align_job *j, const cn_alignment *alignment)
{
    json_t *edges = json_array();
    for (uint32_t i = 0; i < alignment->n_edges; i++) {
        const cn_alignment_edge *e = &alignment->edges[i];
        json_array_append_new(edges, json_pack("{s:s,s:s,s:i,s:o,s:o}", "a", j->tiles[e->a].id, "b", j->tiles[e->b].id,
                                               "places", (int)e->n_places, "own_rmse", cn_json_real(e->own_rmse),
                                               "rmse", cn_json_real(e->rmse)));
    }
    return edges;
}

static json_t *groups_json(const align_job *j, const cn_alignment *alignment)
{
    json_t *groups = json_array();
    for (uint32_t i = 0; i < alignment->n_groups; i++)
        json_array_append_new(groups, json_array());
    for (uint32_t i = 0; i < alignment->n_tiles; i++) {
        const uint32_t tile = alignment->order[i];
        json_array_append_new(json_array_get(groups, alignment->group[tile]), json_string(j->tiles[tile].id));
    }
    return groups;
}

static cn_status save(align_job *j, const cn_alignment *alignment, const cn_stage *stage)
{
    char hex[17], name[640];
    cn_hash_hex(cn_stage_hash(stage), hex);
    cn_appearance_spec_describe(j->spec, name, sizeof name);
    json_t *tiles = json_object();
    cn_status status = CN_OK;
    for (uint32_t i = 0; i < alignment->n_tiles && status == CN_OK; i++) {
        const cn_tile *tile;
        status = open_tile(j, i, &tile);
        if (status == CN_OK)
            json_object_set_new(tiles, j->tiles[i].id, cn_tile_appearance_to_json(tile, &alignment->rows[i]));
    }
    json_t *root = json_pack("{s:i,s:s,s:s,s:o,s:o,s:o}", "version", 1, "name", name, "stage", hex, "groups",
                             groups_json(j, alignment), "edges", edges_json(j, alignment), "tiles", tiles);
    char *path = cn_city_path(j->tile_cache->city, stage->stamp);
    if (status == CN_OK && (!root || !path)) status = cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_stage_finish(j->tile_cache->city, stage);
    if (status == CN_OK) status = cn_json_save(root, path); /* written last: it marks the match as done */
    json_decref(root);
    free(path);
    return status;
}

static cn_alignment_tile alignment_tile(const cn_plan_tile *t)
{
    return (cn_alignment_tile){ .id = t->id,
                                .centre = { t->centre[0], t->centre[1], t->centre[2] },
                                .radius_m = t->radius_m,
                                .views = t->photos,
                                .n_views = t->n_photos };
}

static cn_status make_alignment(cn_tile_cache *g, const cn_context *ctx, const cn_appearance_spec *spec,
                                const cn_stage *stage)
{
    align_job j = { .ctx = ctx, .tile_cache = g, .spec = spec, .tiles = calloc(g->n, sizeof *j.tiles) };
    if (!j.tiles) return cn_fail(CN_ERR_NOMEM, "out of memory for the match of %u tiles", g->n);
    for (uint32_t i = 0; i < g->n; i++)
        j.tiles[i] = alignment_tile(&g->plan->tiles[g->which[i]]);
    const cn_alignment_input input = { .scene = &g->dataset->scene,
                                       .tiles = j.tiles,
                                       .n_tiles = g->n,
                                       .root = choose_root(g, spec),
                                       .open = open_tile,
                                       .appearance = tile_appearance,
                                       .user = &j };
    char name[640];
    cn_appearance_spec_describe(spec, name, sizeof name);
    cn_log(ctx, CN_LOG_INFO, "aligning the light '%s' of %u tiles, beginning at %s", name, g->n,
           j.tiles[input.root].id);
    cn_alignment alignment;
    cn_status status = cn_appearance_align(ctx, &input, &alignment);
    if (status == CN_OK) status = save(&j, &alignment, stage);
    cn_alignment_deinit(&alignment);
    free(j.tiles);
    return status;
}

/* Aligns unless it is done, under a lock: chunks of a render on several machines need the same alignment. */
static cn_status ensure(cn_tile_cache *g, const cn_context *ctx, const cn_appearance_spec *spec, const cn_stage *stage)
{
    cn_city_lock lock = { 0 };
    while (!cn_stage_done(g->city, stage, NULL)) {
        cn_status status = cn_city_lock_take(&lock, ctx, g->city, "match", "the match of light");
        if (status == CN_OK) {
            /* Another process may have made it meanwhile. */
            if (!cn_stage_done(g->city, stage, NULL)) status = make_alignment(g, &lock.ctx, spec, stage);
            cn_city_lock_drop(&lock);
            return status;
        }
        if (status != CN_ERR_LOCKED) return status;
        if (cn_stopping(ctx))
            return cn_fail(
                CN_ERR_INTERRUPTED,
                "stopped while waiting for another process, which aligns the tiles' light; run the same command again");
        nanosleep(&(struct timespec){ .tv_sec = 1 }, NULL);
    }
    cn_city_lock_tidy(g->city, "match");
    return CN_OK;
}

static cn_status align_plain(cn_tile_cache *g, const cn_context *ctx, const cn_appearance_spec *spec, bool make,
                             uint64_t *hash)
{
    cn_stage stage;
    json_t *root = NULL;
    for (uint32_t i = 0; i < g->fits.n_aligned; i++)
        if (g->fits.aligned[i].kind == spec->kind && strcmp(g->fits.aligned[i].photo, spec->a) == 0) return CN_OK;
    CN_TRY(cn_stage_alignment(g->city, g->plan, spec, &stage));
    if (make)
        CN_TRY(ensure(g, ctx, spec, &stage));
    else if (!cn_stage_done(g->city, &stage, NULL))
        return CN_OK;
    char *path = cn_city_path(g->city, stage.stamp);
    cn_status status = path ? cn_json_load(path, &root) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_appearance_cache_add_aligned(&g->fits, spec, root, path);
    if (status == CN_OK && hash) *hash = cn_hash_text(*hash, "%016llx", (unsigned long long)cn_stage_hash(&stage));
    free(path);
    return status;
}

cn_status cn_tile_cache_align(cn_tile_cache *g, const cn_context *ctx, const cn_appearance_spec *spec, bool make,
                              uint64_t *hash)
{
    if (!g->city->config.match || g->n < 2) return CN_OK;
    switch (spec->kind) {
    case CN_APPEARANCE_MEAN:
    case CN_APPEARANCE_PHOTO:
    case CN_APPEARANCE_FIT: return align_plain(g, ctx, spec, make, hash);
    case CN_APPEARANCE_MIX: {
        cn_appearance_spec part = { .kind = CN_APPEARANCE_PHOTO };
        memcpy(part.a, spec->a, sizeof part.a);
        CN_TRY(spec->first ? cn_tile_cache_align(g, ctx, spec->first, make, hash)
                           : align_plain(g, ctx, &part, make, hash));
        if (spec->second) return cn_tile_cache_align(g, ctx, spec->second, make, hash);
        memcpy(part.a, spec->b, sizeof part.a);
        return align_plain(g, ctx, &part, make, hash);
    }
    case CN_APPEARANCE_BETWEEN:
        CN_TRY(cn_tile_cache_align(g, ctx, spec->from, make, hash));
        return cn_tile_cache_align(g, ctx, spec->to, make, hash);
    case CN_APPEARANCE_KNOWN:       /* done by cn_tile_cache_align_known, for each view */
    case CN_APPEARANCE_FIT_LEFT:    /* each tile is fitted to the same photo */
    case CN_APPEARANCE_FILE: break; /* it has a row for each tile */
    }
    return CN_OK;
}

/* Aligns the rows of a photo in the tiles of a view. */
static cn_status keep_rows(align_job *j, uint32_t n, const cn_alignment *alignment)
{
    for (uint32_t i = 0; i < n; i++) {
        const cn_tile *tile;
        CN_TRY(open_tile(j, i, &tile));
        CN_TRY(cn_appearance_cache_add_fit(&j->tile_cache->fits, tile, j->spec->a, CN_APPEARANCE_KNOWN,
                                           &alignment->rows[i]));
    }
    return CN_OK;
}

cn_status cn_tile_cache_align_known(cn_tile_cache *g, const cn_context *ctx, const cn_appearance_spec *spec,
                                    const cn_view *view)
{
    cn_alignment_tile tiles[CN_COMPOSE_MAX];
    cn_compose_choice choice;
    double centre[3];
    cn_view_centre(view, centre);
    cn_compose_choose(g->n, (const double(*)[3])g->centres, g->seen_radii, centre, &g->compose, &choice);
    if (!g->city->config.match || choice.n < 2) return CN_OK;
    uint32_t root = 0;
    for (uint32_t i = choice.n; i-- > 0;) { /* by weight */
        const cn_plan_tile *t = &g->plan->tiles[g->which[choice.tile[i]]];
        tiles[i] = alignment_tile(t);
        if (knows(g, t, spec->a)) root = i;
    }
    align_job j = { .ctx = ctx, .tile_cache = g, .spec = spec, .tiles = tiles, .some = choice.tile };
    const cn_alignment_input input = { .scene = &g->dataset->scene,
                                       .tiles = tiles,
                                       .n_tiles = choice.n,
                                       .root = root,
                                       .open = open_tile,
                                       .appearance = tile_appearance,
                                       .user = &j };
    cn_context quiet = *ctx; /* no progress reports: this is part of another stage */
    quiet.progress = NULL;
    cn_alignment alignment;
    CN_TRY(cn_appearance_align(&quiet, &input, &alignment));
    const cn_status status = keep_rows(&j, choice.n, &alignment);
    cn_alignment_deinit(&alignment);
    return status;
}
