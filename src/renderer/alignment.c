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

/* A match at work: the tile_cache's tiles in its order, or some of them. */
typedef struct match_job {
    const cn_context *ctx;
    cn_tile_cache *tile_cache;
    const cn_appearance_spec *light;
    cn_alignment_tile *tiles;
    const uint32_t *some; /* NULL: all */
} match_job;

static cn_status open_tile(void *user, uint32_t tile, const cn_tile **out)
{
    match_job *j = user;
    return cn_tile_cache_tile(j->tile_cache, j->tile_cache->which[j->some ? j->some[tile] : tile], out);
}

static cn_status light_tile(void *user, const cn_context *ctx, const cn_tile *tile, cn_appearance *row)
{
    match_job *j = user;
    return cn_appearance_spec_row(j->light, ctx, j->tile_cache->dataset, tile, &j->tile_cache->fits, row);
}

cn_status cn_stage_alignment(const cn_city *city, const cn_plan *plan, const cn_appearance_spec *light, cn_stage *stage)
{
    char name[17] = "mean", code[640];
    *stage = (cn_stage){ 0 };
    if (light->kind != CN_APPEARANCE_MEAN) cn_hash_hex(cn_appearance_spec_hash(light, 0), name);
    cn_appearance_spec_describe(light, code, sizeof code);
    snprintf(stage->record, sizeof stage->record, "match/%s.stage.json", name);
    snprintf(stage->stamp, sizeof stage->stamp, "match/%s.json", name);
    cn_fingerprint_add(&stage->config, "the appearance", "%s", code);
    return cn_stage_add_tiles(city, plan, stage);
}

/* How much a tile knows of a photo: trained on it, it was held out from it, nothing. */
static int knows(const cn_tile_cache *g, const cn_plan_tile *tile, const char *photo)
{
    const cn_view *views = g->dataset->scene.views;
    for (uint32_t i = 0; i < tile->n_photos; i++)
        if (strcmp(views[tile->photos[i]].name, photo) == 0) return 2;
    for (uint32_t i = 0; i < tile->n_held_out; i++)
        if (strcmp(views[tile->held_out[i]].name, photo) == 0) return 1;
    return 0;
}

/* Of the tiles that know the light best, the one with the most photos. */
static uint32_t choose_root(const cn_tile_cache *g, const cn_appearance_spec *light)
{
    uint32_t best = 0, most = 0;
    int known = -1;
    for (uint32_t i = 0; i < g->n; i++) {
        const cn_plan_tile *tile = &g->plan->tiles[g->which[i]];
        const int k = light->kind == CN_APPEARANCE_MEAN ? 0 : knows(g, tile, light->a);
        if (k < known || (k == known && tile->n_photos <= most)) continue;
        known = k;
        most = tile->n_photos;
        best = i;
    }
    return best;
}

static json_t *edges_json(const match_job *j, const cn_alignment *match)
{
    json_t *edges = json_array();
    for (uint32_t i = 0; i < match->n_edges; i++) {
        const cn_alignment_edge *e = &match->edges[i];
        json_array_append_new(edges, json_pack("{s:s,s:s,s:i,s:o,s:o}", "a", j->tiles[e->a].id, "b", j->tiles[e->b].id,
                                               "places", (int)e->n_places, "own_rmse", cn_json_real(e->own_rmse),
                                               "rmse", cn_json_real(e->rmse)));
    }
    return edges;
}

static json_t *groups_json(const match_job *j, const cn_alignment *match)
{
    json_t *groups = json_array();
    for (uint32_t i = 0; i < match->n_groups; i++)
        json_array_append_new(groups, json_array());
    for (uint32_t i = 0; i < match->n_tiles; i++) {
        const uint32_t tile = match->order[i];
        json_array_append_new(json_array_get(groups, match->group[tile]), json_string(j->tiles[tile].id));
    }
    return groups;
}

static cn_status save(match_job *j, const cn_alignment *match, const cn_stage *stage)
{
    char hex[17], name[640];
    cn_hash_hex(cn_stage_hash(stage), hex);
    cn_appearance_spec_describe(j->light, name, sizeof name);
    json_t *tiles = json_object();
    cn_status status = CN_OK;
    for (uint32_t i = 0; i < match->n_tiles && status == CN_OK; i++) {
        const cn_tile *tile;
        status = open_tile(j, i, &tile);
        if (status == CN_OK)
            json_object_set_new(tiles, j->tiles[i].id, cn_tile_appearance_to_json(tile, &match->rows[i]));
    }
    json_t *root = json_pack("{s:i,s:s,s:s,s:o,s:o,s:o}", "version", 1, "name", name, "stage", hex, "groups",
                             groups_json(j, match), "edges", edges_json(j, match), "tiles", tiles);
    char *path = cn_city_path(j->tile_cache->city, stage->stamp);
    if (status == CN_OK && (!root || !path)) status = cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_stage_finish(j->tile_cache->city, stage);
    if (status == CN_OK) status = cn_json_save(root, path); /* last: it seals */
    json_decref(root);
    free(path);
    return status;
}

static cn_alignment_tile match_tile(const cn_plan_tile *t)
{
    return (cn_alignment_tile){ .id = t->id,
                                .centre = { t->centre[0], t->centre[1], t->centre[2] },
                                .radius_m = t->radius_m,
                                .views = t->photos,
                                .n_views = t->n_photos };
}

static cn_status make_match(cn_tile_cache *g, const cn_context *ctx, const cn_appearance_spec *light,
                            const cn_stage *stage)
{
    match_job j = { .ctx = ctx, .tile_cache = g, .light = light, .tiles = calloc(g->n, sizeof *j.tiles) };
    if (!j.tiles) return cn_fail(CN_ERR_NOMEM, "out of memory for the match of %u tiles", g->n);
    for (uint32_t i = 0; i < g->n; i++)
        j.tiles[i] = match_tile(&g->plan->tiles[g->which[i]]);
    const cn_alignment_input input = { .scene = &g->dataset->scene,
                                       .tiles = j.tiles,
                                       .n_tiles = g->n,
                                       .root = choose_root(g, light),
                                       .open = open_tile,
                                       .light = light_tile,
                                       .user = &j };
    char name[640];
    cn_appearance_spec_describe(light, name, sizeof name);
    cn_log(ctx, CN_LOG_INFO, "matching the light '%s' of %u tiles, from %s", name, g->n, j.tiles[input.root].id);
    cn_alignment match;
    cn_status status = cn_appearance_align(ctx, &input, &match);
    if (status == CN_OK) status = save(&j, &match, stage);
    cn_alignment_deinit(&match);
    free(j.tiles);
    return status;
}

/* Makes the match unless it is done, alone: chunks of a render on many machines want the same one. */
static cn_status ensure(cn_tile_cache *g, const cn_context *ctx, const cn_appearance_spec *light, const cn_stage *stage)
{
    cn_city_lock guard = { 0 };
    while (!cn_stage_done(g->city, stage, NULL)) {
        cn_status status = cn_city_lock_take(&guard, ctx, g->city, "match", "the match of light");
        if (status == CN_OK) {
            /* Another may have made it since. */
            if (!cn_stage_done(g->city, stage, NULL)) status = make_match(g, &guard.ctx, light, stage);
            cn_city_lock_drop(&guard);
            return status;
        }
        if (status != CN_ERR_LOCKED) return status;
        if (cn_stopping(ctx))
            return cn_fail(CN_ERR_INTERRUPTED, "stopped while another process matches the tiles' light");
        nanosleep(&(struct timespec){ .tv_sec = 1 }, NULL);
    }
    return CN_OK;
}

static cn_status match_plain(cn_tile_cache *g, const cn_context *ctx, const cn_appearance_spec *light, bool make,
                             uint64_t *hash)
{
    cn_stage stage;
    json_t *root = NULL;
    for (uint32_t i = 0; i < g->fits.n_matches; i++)
        if (g->fits.matches[i].kind == light->kind && strcmp(g->fits.matches[i].photo, light->a) == 0) return CN_OK;
    CN_TRY(cn_stage_alignment(g->city, g->plan, light, &stage));
    if (make)
        CN_TRY(ensure(g, ctx, light, &stage));
    else if (!cn_stage_done(g->city, &stage, NULL))
        return CN_OK;
    char *path = cn_city_path(g->city, stage.stamp);
    cn_status status = path ? cn_json_load(path, &root) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_appearance_cache_add_match(&g->fits, light, root, path);
    if (status == CN_OK && hash) *hash = cn_hash_text(*hash, "%016llx", (unsigned long long)cn_stage_hash(&stage));
    free(path);
    return status;
}

cn_status cn_tile_cache_align(cn_tile_cache *g, const cn_context *ctx, const cn_appearance_spec *light, bool make,
                              uint64_t *hash)
{
    if (!g->city->config.match || g->n < 2) return CN_OK;
    switch (light->kind) {
    case CN_APPEARANCE_MEAN:
    case CN_APPEARANCE_PHOTO:
    case CN_APPEARANCE_FIT: return match_plain(g, ctx, light, make, hash);
    case CN_APPEARANCE_MIX: {
        cn_appearance_spec part = { .kind = CN_APPEARANCE_PHOTO };
        memcpy(part.a, light->a, sizeof part.a);
        CN_TRY(match_plain(g, ctx, &part, make, hash));
        memcpy(part.a, light->b, sizeof part.a);
        return match_plain(g, ctx, &part, make, hash);
    }
    case CN_APPEARANCE_BETWEEN:
        CN_TRY(cn_tile_cache_align(g, ctx, light->from, make, hash));
        return cn_tile_cache_align(g, ctx, light->to, make, hash);
    case CN_APPEARANCE_KNOWN:       /* by cn_tile_cache_align_known, view by view */
    case CN_APPEARANCE_FIT_LEFT:    /* each tile is fitted to the same photo */
    case CN_APPEARANCE_FILE: break; /* it has a row for each tile */
    }
    return CN_OK;
}

/* The rows that the tiles of a view have for a photo, once matched. */
static cn_status keep_rows(match_job *j, uint32_t n, const cn_alignment *match)
{
    for (uint32_t i = 0; i < n; i++) {
        const cn_tile *tile;
        CN_TRY(open_tile(j, i, &tile));
        CN_TRY(
            cn_appearance_cache_add_fit(&j->tile_cache->fits, tile, j->light->a, CN_APPEARANCE_KNOWN, &match->rows[i]));
    }
    return CN_OK;
}

cn_status cn_tile_cache_align_known(cn_tile_cache *g, const cn_context *ctx, const cn_appearance_spec *light,
                                    const cn_view *view)
{
    cn_alignment_tile tiles[CN_COMPOSE_MAX];
    cn_compose_choice choice;
    double centre[3];
    cn_view_centre(view, centre);
    cn_compose_choose(g->n, (const double(*)[3])g->centres, g->radii, centre, &g->compose, &choice);
    if (!g->city->config.match || choice.n < 2) return CN_OK;
    uint32_t root = 0;
    for (uint32_t i = choice.n; i-- > 0;) { /* heaviest first */
        const cn_plan_tile *t = &g->plan->tiles[g->which[choice.tile[i]]];
        tiles[i] = match_tile(t);
        if (knows(g, t, light->a)) root = i;
    }
    match_job j = { .ctx = ctx, .tile_cache = g, .light = light, .tiles = tiles, .some = choice.tile };
    const cn_alignment_input input = { .scene = &g->dataset->scene,
                                       .tiles = tiles,
                                       .n_tiles = choice.n,
                                       .root = root,
                                       .open = open_tile,
                                       .light = light_tile,
                                       .user = &j };
    cn_context quiet = *ctx; /* a step of another stage's progress */
    quiet.progress = NULL;
    cn_alignment match;
    CN_TRY(cn_appearance_align(&quiet, &input, &match));
    const cn_status status = keep_rows(&j, choice.n, &match);
    cn_alignment_deinit(&match);
    return status;
}
