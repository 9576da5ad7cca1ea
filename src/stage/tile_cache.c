#include "stage/tile_cache.h"

#include "base/file.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static char *tile_path(const cn_tile_cache *g, const char *id, const char *name)
{
    return cn_format("%s/%s/%s/%s", g->city->folder, g->folder, id, name);
}

cn_status cn_tile_cache_init(cn_tile_cache *g, const cn_context *ctx, const cn_city *city, const cn_dataset *dataset)
{
    return cn_tile_cache_init_at(g, ctx, city, dataset, "tiles");
}

cn_status cn_tile_cache_init_at(cn_tile_cache *g, const cn_context *ctx, const cn_city *city, const cn_dataset *dataset,
                                const char *folder)
{
    const cn_plan *plan = &dataset->plan;
    *g = (cn_tile_cache){ .city = city,
                          .folder = folder,
                          .plan = plan,
                          .dataset = dataset,
                          .n_cache = city->config.compose.max_tiles + 1,
                          .compose = city->config.compose };
    g->centres = calloc(plan->n_tiles + 1u, sizeof *g->centres);
    g->radii = calloc(plan->n_tiles + 1u, sizeof *g->radii);
    g->which = calloc(plan->n_tiles + 1u, sizeof *g->which);
    if (!g->centres || !g->radii || !g->which) {
        cn_tile_cache_deinit(g);
        return cn_fail(CN_ERR_NOMEM, "out of memory for the list of tiles");
    }
    for (uint32_t i = 0; i < plan->n_tiles; i++) {
        const cn_plan_tile *t = &plan->tiles[i];
        char *done = tile_path(g, t->id, "DONE");
        if (done && cn_file_exists(done)) {
            memcpy(g->centres[g->n], t->centre, sizeof t->centre);
            g->radii[g->n] = t->radius_m;
            g->which[g->n++] = i;
        } else if (strcmp(folder, "tiles") == 0) {
            cn_log(ctx, CN_LOG_WARN, "tile %s is not trained yet and is left out", t->id);
        }
        free(done);
    }
    if (g->n) return CN_OK;
    cn_tile_cache_deinit(g);
    return cn_fail(CN_ERR_DATA, "%s has no trained tile yet; run `conurb train %s` first", city->folder, city->folder);
}

void cn_tile_cache_deinit(cn_tile_cache *g)
{
    for (uint32_t i = 0; i < CN_TILE_CACHE_MAX; i++)
        cn_tile_close(&g->cache[i].open);
    cn_appearance_cache_deinit(&g->fits);
    free(g->centres);
    free(g->radii);
    free(g->which);
    *g = (cn_tile_cache){ 0 };
}

/* The open tile, from the cache or in place of the one unused for longest. */
cn_status cn_tile_cache_tile(cn_tile_cache *g, uint32_t tile, const cn_tile **out)
{
    uint32_t slot = 0;
    for (uint32_t i = 0; i < g->n_cache; i++) {
        if (g->cache[i].open && g->cache[i].tile == tile) {
            g->cache[i].used = ++g->clock;
            *out = g->cache[i].open;
            return CN_OK;
        }
        if (g->cache[i].used < g->cache[slot].used) slot = i;
    }
    cn_tile_close(&g->cache[slot].open);
    char *path = tile_path(g, g->plan->tiles[tile].id, "tile.safetensors");
    const cn_status status = path ? cn_tile_open(&g->cache[slot].open, path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(path);
    CN_TRY(status);
    g->cache[slot].tile = tile;
    g->varies = g->varies || cn_tile_has_appearance(g->cache[slot].open);
    g->cache[slot].used = ++g->clock;
    *out = g->cache[slot].open;
    return CN_OK;
}

/* A tile under the light; *row is what options->appearance then points to. */
static cn_status light_tile(cn_tile_cache *g, const cn_context *ctx, const cn_tile *tile,
                            const cn_appearance_spec *light, cn_appearance *row)
{
    return light ? cn_appearance_spec_row(light, ctx, g->dataset, tile, &g->fits, row)
                 : cn_tile_appearance(tile, NULL, row);
}

/* One view on its way through the tiles. */
typedef struct shot {
    const cn_context *ctx;
    const cn_camera *camera;
    const cn_view *view;
    const cn_render_options *options;
    const cn_appearance_spec *light;
    cn_compose_choice choice;
} shot;

static cn_status look(cn_tile_cache *g, shot *s)
{
    double visibility[CN_COMPOSE_MAX];
    if (!cn_compose_wants_visibility(&s->choice, &g->compose)) return CN_OK;
    for (uint32_t i = 0; i < s->choice.n; i++) {
        const cn_tile *tile;
        CN_TRY(cn_tile_cache_tile(g, g->which[s->choice.tile[i]], &tile));
        CN_TRY(cn_compose_visibility(s->ctx, tile, s->camera, s->view, &visibility[i]));
    }
    cn_compose_see(&s->choice, visibility, &g->compose);
    return CN_OK;
}

cn_status cn_tile_cache_alone(cn_tile_cache *g, const cn_context *ctx, uint32_t which, const cn_camera *camera,
                              const cn_view *view, const cn_render_options *options, const cn_appearance_spec *light,
                              cn_picture *picture)
{
    const cn_tile *tile;
    const size_t pixels = (size_t)picture->width * picture->height;
    cn_render_options mine = *options;
    cn_appearance row;
    memset(picture->rgba, 0, pixels * 4 * sizeof *picture->rgba);
    memset(picture->depth, 0, pixels * sizeof *picture->depth);
    CN_TRY(cn_tile_cache_tile(g, g->which[which], &tile));
    CN_TRY(light_tile(g, ctx, tile, light, &row));
    mine.appearance = &row;
    return cn_render_tile(ctx, tile, camera, view, &mine, picture);
}

static cn_status add_one(cn_tile_cache *g, const shot *s, uint32_t i, cn_picture *one, cn_compose_sum *sum)
{
    const uint32_t which = s->choice.tile[i];
    CN_TRY(cn_tile_cache_alone(g, s->ctx, which, s->camera, s->view, s->options, s->light, one));
    if (g->compose.scheme == CN_BLEND_DISTANCE_3D)
        cn_compose_add_3d(s->ctx, sum, one, s->choice.weight[i], s->camera, s->view, g->centres[which],
                          g->compose.exponent);
    else
        cn_compose_add(sum, one, s->choice.weight[i]);
    return CN_OK;
}

static cn_status view_by_tile(cn_tile_cache *g, const shot *s, cn_picture *picture, float *border)
{
    cn_picture one;
    cn_compose_sum sum = { 0 };
    CN_TRY(cn_picture_init(&one, picture->width, picture->height));
    cn_status status = cn_compose_sum_init(&sum, picture);
    for (uint32_t i = 0; i < s->choice.n && status == CN_OK; i++)
        status = add_one(g, s, i, &one, &sum);
    if (status == CN_OK) cn_compose_finish(&sum, s->choice.coverage, border);
    cn_compose_sum_deinit(&sum);
    cn_picture_deinit(&one);
    return status;
}

/* All tiles of the view are open at once: the cache holds one more than a view has. */
static cn_status view_as_union(cn_tile_cache *g, const shot *s, cn_picture *picture, float *border, uint32_t *owner)
{
    cn_union_part parts[CN_COMPOSE_MAX] = { 0 };
    cn_appearance rows[CN_COMPOSE_MAX];
    for (uint32_t i = 0; i < s->choice.n; i++) {
        const uint32_t which = s->choice.tile[i];
        const double radius = g->radii[which];
        /* A tile on its way out gives way to its neighbours until it owns nothing that they could have. */
        parts[i] = (cn_union_part){ .blend_width_m = CN_TILE_CACHE_BAND * radius,
                                    .offset_m = radius * (1 / s->choice.weight[i] - 1),
                                    .appearance = &rows[i] };
        memcpy(parts[i].centre_m, g->centres[which], sizeof parts[i].centre_m);
        CN_TRY(cn_tile_cache_tile(g, g->which[which], &parts[i].tile));
        CN_TRY(light_tile(g, s->ctx, parts[i].tile, s->light, &rows[i]));
    }
    CN_TRY(cn_render_union(s->ctx, s->choice.n, parts, s->camera, s->view, s->options, picture, border, owner));
    const size_t n = (size_t)picture->width * picture->height;
    for (size_t i = 0; i < 4 * n && s->choice.coverage < 1; i++)
        picture->rgba[i] *= (float)s->choice.coverage;
    for (size_t i = 0; i < n && owner; i++)
        if (owner[i] != UINT32_MAX) owner[i] = s->choice.tile[owner[i]];
    return CN_OK;
}

static void say_none(cn_tile_cache *g, const cn_context *ctx, const cn_view *view)
{
    if (!g->said_none)
        cn_log(ctx, CN_LOG_WARN,
               "%s is beyond the reach of every tile and stays empty, as may others; raise compose.reach to see on",
               view->name);
    g->said_none = true;
}

cn_status cn_tile_cache_view(cn_tile_cache *g, const cn_context *ctx, const cn_camera *camera, const cn_view *view,
                             const cn_render_options *options, const cn_appearance_spec *light, cn_picture *picture,
                             char *used, float *border, uint32_t *owner)
{
    shot s = { .ctx = ctx, .camera = camera, .view = view, .options = options, .light = light };
    const size_t pixels = (size_t)picture->width * picture->height;
    double centre[3];
    cn_view_centre(view, centre);
    cn_compose_choose(g->n, (const double(*)[3])g->centres, g->radii, centre, &g->compose, &s.choice);
    CN_TRY(look(g, &s));
    if (used) snprintf(used, 32, "%s", s.choice.n ? g->plan->tiles[g->which[s.choice.tile[0]]].id : "");
    memset(picture->rgba, 0, pixels * 4 * sizeof *picture->rgba);
    memset(picture->depth, 0, pixels * sizeof *picture->depth);
    if (border) memset(border, 0, pixels * sizeof *border);
    if (owner) memset(owner, 0xff, pixels * sizeof *owner);
    if (!s.choice.n) {
        say_none(g, ctx, view);
        return CN_OK;
    }
    if (g->compose.scheme == CN_BLEND_OWNERSHIP) return view_as_union(g, &s, picture, border, owner);
    return view_by_tile(g, &s, picture, border);
}
