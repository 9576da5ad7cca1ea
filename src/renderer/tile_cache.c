#include "renderer/tile_cache.h"

#include "base/file.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static char *tile_path(const cn_tile_cache *g, const char *id, const char *name)
{
    return cn_format("%s/%s/%s/%s", g->city->folder, g->folder, id, name);
}

static bool is_there(const cn_tile_cache *g, const char *id, const char *name)
{
    char *path = tile_path(g, id, name);
    const bool there = path && cn_file_exists(path);
    free(path);
    return there;
}

/* Training takes that file away when it ends, so where it is there the tile is in training. */
static bool is_unfinished(const cn_tile_cache *g, const char *id)
{
    return g->live && is_there(g, id, CN_TILE_UNFINISHED);
}

static cn_status make_lists(cn_tile_cache *g, const cn_city *city, const cn_dataset *dataset, const char *folder)
{
    const size_t n = dataset->plan.n_tiles + (size_t)1;
    *g = (cn_tile_cache){ .city = city,
                          .folder = folder,
                          .plan = &dataset->plan,
                          .dataset = dataset,
                          .n_cache = city->config.compose.max_tiles + 1,
                          .compose = city->config.compose };
    g->centres = calloc(n, sizeof *g->centres);
    g->radii = calloc(n, sizeof *g->radii);
    g->seen_radii = calloc(n, sizeof *g->seen_radii);
    g->which = calloc(n, sizeof *g->which);
    g->files = calloc(n, sizeof *g->files);
    if (g->centres && g->radii && g->seen_radii && g->which && g->files) return CN_OK;
    cn_tile_cache_deinit(g);
    return cn_fail(CN_ERR_NOMEM, "out of memory for the list of tiles");
}

static void say_untrained(const cn_tile_cache *g, const cn_context *ctx)
{
    for (uint32_t tile = 0, i = 0; tile < g->plan->n_tiles; tile++) {
        if (i < g->n && g->which[i] == tile)
            i++;
        else
            cn_log(ctx, CN_LOG_WARN, "tile %s is not trained yet and is left out", g->plan->tiles[tile].id);
    }
}

cn_status cn_tile_cache_init_live(cn_tile_cache *g, const cn_context *ctx, const cn_city *city,
                                  const cn_dataset *dataset, bool unfinished)
{
    CN_TRY(make_lists(g, city, dataset, "tiles"));
    g->live = unfinished;
    cn_tile_cache_refresh(g);
    say_untrained(g, ctx);
    return CN_OK;
}

cn_status cn_tile_cache_init(cn_tile_cache *g, const cn_context *ctx, const cn_city *city, const cn_dataset *dataset)
{
    return cn_tile_cache_init_at(g, ctx, city, dataset, "tiles");
}

cn_status cn_tile_cache_init_at(cn_tile_cache *g, const cn_context *ctx, const cn_city *city, const cn_dataset *dataset,
                                const char *folder)
{
    CN_TRY(make_lists(g, city, dataset, folder));
    cn_tile_cache_refresh(g);
    if (strcmp(folder, "tiles") == 0) say_untrained(g, ctx);
    if (g->n) return CN_OK;
    cn_tile_cache_deinit(g);
    return cn_fail(CN_ERR_DATA, "%s has no trained tile yet; run `conurb train %s` first", city->folder, city->folder);
}

/* Horizontal distance of the tile's centre to the farthest of its photos. */
static double farthest_of(const cn_plan_tile *t, const cn_scene *scene)
{
    double farthest = 0, place[3];
    for (uint32_t i = 0; i < t->n_photos + t->n_held_out; i++) {
        cn_view_centre(&scene->views[i < t->n_photos ? t->photos[i] : t->held_out[i - t->n_photos]], place);
        farthest = fmax(farthest, hypot(place[0] - t->centre[0], place[1] - t->centre[1]));
    }
    return farthest;
}

void cn_tile_cache_refresh(cn_tile_cache *g)
{
    const uint32_t before = g->n;
    bool changed = false;
    g->n = 0;
    for (uint32_t i = 0; i < g->plan->n_tiles; i++) {
        const cn_plan_tile *t = &g->plan->tiles[i];
        if (!is_there(g, t->id, "DONE") && !is_unfinished(g, t->id)) continue;
        if (g->n >= before || g->which[g->n] != i) { /* live views come here for each picture: photos are not few */
            changed = true;
            memcpy(g->centres[g->n], t->centre, sizeof t->centre);
            g->radii[g->n] = t->radius_m;
            g->seen_radii[g->n] = cn_compose_radius(t->radius_m, farthest_of(t, &g->dataset->scene), &g->compose);
            g->which[g->n] = i;
        }
        g->n++;
    }
    if (before && (changed || g->n != before)) cn_appearance_cache_forget(&g->fits);
}

void cn_tile_cache_close(cn_tile_cache *g)
{
    for (uint32_t i = 0; i < CN_TILE_CACHE_MAX; i++)
        cn_tile_close(&g->cache[i].open);
}

void cn_tile_cache_deinit(cn_tile_cache *g)
{
    cn_tile_cache_close(g);
    for (uint32_t i = 0; g->depths && i < g->plan->n_tiles; i++)
        cn_photo_depths_deinit(&g->depths[i]);
    free(g->depths);
    cn_appearance_cache_deinit(&g->fits);
    free(g->centres);
    free(g->radii);
    free(g->seen_radii);
    free(g->which);
    free(g->files);
    *g = (cn_tile_cache){ 0 };
}

/* Opens a tile in a slot of the cache. */
static cn_status open_slot(cn_tile_cache *g, uint32_t slot, uint32_t tile, const char *path, const struct stat *file)
{
    cn_tile_close(&g->cache[slot].open);
    CN_TRY(cn_tile_open(&g->cache[slot].open, path));
    g->cache[slot].tile = tile;
    g->files[tile] = *file;
    g->varies = g->varies || cn_tile_has_appearance(g->cache[slot].open);
    return CN_OK;
}

static bool same_file(const struct stat *a, const struct stat *b)
{
    return a->st_dev == b->st_dev && a->st_ino == b->st_ino && a->st_size == b->st_size &&
           a->st_mtim.tv_sec == b->st_mtim.tv_sec && a->st_mtim.tv_nsec == b->st_mtim.tv_nsec;
}

/* Takes the tile from the cache, or opens it in place of the least recently used one. */
static cn_status find_tile(cn_tile_cache *g, uint32_t tile, const char *path, const cn_tile **out)
{
    uint32_t slot = 0;
    struct stat file = { 0 };
    bool there = false;
    if (stat(path, &file) != 0) memset(&file, 0, sizeof file); /* cn_tile_open reports the error */
    for (uint32_t i = 0; i < g->n_cache && !there; i++) {
        there = g->cache[i].open && g->cache[i].tile == tile;
        if (there || g->cache[i].used < g->cache[slot].used) slot = i;
    }
    const bool changed = g->files[tile].st_ino && !same_file(&file, &g->files[tile]);
    if (changed) cn_appearance_cache_forget(&g->fits); /* they belong to the old tile */
    if (!there || changed) CN_TRY(open_slot(g, slot, tile, path, &file));
    g->cache[slot].used = ++g->clock;
    *out = g->cache[slot].open;
    return CN_OK;
}

cn_status cn_tile_cache_tile(cn_tile_cache *g, uint32_t tile, const cn_tile **out)
{
    const char *id = g->plan->tiles[tile].id;
    const bool unfinished = is_unfinished(g, id);
    char *path = tile_path(g, id, unfinished ? CN_TILE_UNFINISHED : "tile.safetensors");
    const cn_status status = path ? find_tile(g, tile, path, out) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(path);
    /* Training may have ended in between; then the finished tile is there. */
    if (status != CN_OK && unfinished && !is_unfinished(g, id)) return cn_tile_cache_tile(g, tile, out);
    return status;
}

cn_status cn_tile_cache_vignetting(cn_tile_cache *g, const char *id, const cn_view *view, cn_vignetting *v)
{
    const int64_t which = cn_plan_find(g->plan, id);
    const cn_tile *tile;
    *v = (cn_vignetting){ 0 };
    if (which < 0) return CN_OK;
    CN_TRY(cn_tile_cache_tile(g, (uint32_t)which, &tile));
    return cn_lens_vignetting(g->dataset, tile, view, v);
}

/* Finds the row for a tile; options->appearance then points to it. */
static cn_status row_of(cn_tile_cache *g, const cn_context *ctx, const cn_tile *tile, const cn_tile_cache_view *v,
                        cn_appearance *row)
{
    if (v->row) *row = *v->row;
    if (v->row) return CN_OK;
    return v->appearance ? cn_appearance_spec_row(v->appearance, ctx, g->dataset, tile, &g->fits, row)
                         : cn_tile_appearance(tile, NULL, row);
}

/* One view while its tiles are rendered. */
typedef struct shot {
    const cn_context *ctx;
    const cn_tile_cache_view *v;
    cn_compose_choice choice;
} shot;

/* Removes tiles that see too little of the view. */
static cn_status weigh_visibility(cn_tile_cache *g, shot *s)
{
    double visibility[CN_COMPOSE_MAX];
    if (!cn_compose_wants_visibility(&s->choice, &g->compose)) return CN_OK;
    for (uint32_t i = 0; i < s->choice.n; i++) {
        const cn_tile *tile;
        CN_TRY(cn_tile_cache_tile(g, g->which[s->choice.tile[i]], &tile));
        CN_TRY(cn_compose_visibility(s->ctx, tile, s->v->camera, s->v->view, &visibility[i]));
    }
    cn_compose_see(&s->choice, visibility, &g->compose);
    return CN_OK;
}

static void empty(const cn_camera *camera, cn_picture *picture)
{
    const size_t pixels = (size_t)picture->width * picture->height;
    picture->fade = 0;
    picture->wraps = camera->lens == CN_LENS_EQUIRECTANGULAR;
    memset(picture->rgba, 0, pixels * 4 * sizeof *picture->rgba);
    memset(picture->depth, 0, pixels * sizeof *picture->depth);
}

cn_status cn_tile_cache_alone(cn_tile_cache *g, const cn_context *ctx, uint32_t which, const cn_tile_cache_view *v,
                              cn_picture *picture)
{
    const cn_tile *tile;
    cn_render_options mine = *v->options;
    cn_appearance row;
    empty(v->camera, picture);
    CN_TRY(cn_tile_cache_tile(g, g->which[which], &tile));
    CN_TRY(row_of(g, ctx, tile, v, &row));
    mine.appearance = &row;
    return cn_render_tile(ctx, tile, v->camera, v->view, &mine, picture);
}

static cn_status add_one(cn_tile_cache *g, const shot *s, uint32_t i, cn_picture *one, cn_compose_sum *sum)
{
    const uint32_t which = s->choice.tile[i];
    CN_TRY(cn_tile_cache_alone(g, s->ctx, which, s->v, one));
    if (g->compose.scheme == CN_BLEND_DISTANCE_3D)
        cn_compose_add_3d(s->ctx, sum, one,
                          &(cn_compose_distance){ s->v->camera, s->v->view, g->centres[which], s->choice.weight[i],
                                                  g->compose.exponent });
    else
        cn_compose_add(sum, one, s->choice.weight[i]);
    return CN_OK;
}

/* Converts indices of the choice to indices of the tiles; UINT32_MAX where there is nothing. */
static void name_owners(const shot *s, const cn_picture *picture, uint32_t *owner)
{
    for (size_t i = 0; i < (size_t)picture->width * picture->height; i++)
        owner[i] = owner[i] < s->choice.n && picture->rgba[4 * i + 3] > 0 ? s->choice.tile[owner[i]] : UINT32_MAX;
}

static cn_status view_by_tile(cn_tile_cache *g, const shot *s, cn_picture *picture)
{
    cn_picture one;
    cn_compose_sum sum = { 0 };
    uint32_t *owner = s->v->owner_by_all ? s->v->owner : NULL;
    CN_TRY(cn_picture_init(&one, picture->width, picture->height));
    cn_status status = cn_compose_sum_init(&sum, picture);
    sum.heaviest = owner;
    for (uint32_t i = 0; i < s->choice.n && status == CN_OK; i++)
        status = add_one(g, s, i, &one, &sum);
    if (status == CN_OK) cn_compose_finish(&sum, s->v->border);
    if (status == CN_OK && owner) name_owners(s, picture, owner);
    cn_compose_sum_deinit(&sum);
    cn_picture_deinit(&one);
    return status;
}

/* All tiles of the view are open at the same time: the cache has room for one more. */
static cn_status view_as_union(cn_tile_cache *g, const shot *s, cn_picture *picture)
{
    cn_union_part parts[CN_COMPOSE_MAX] = { 0 };
    cn_appearance rows[CN_COMPOSE_MAX];
    uint32_t *owner = s->v->owner;
    for (uint32_t i = 0; i < s->choice.n; i++) {
        const uint32_t which = s->choice.tile[i];
        const double radius = g->radii[which];
        /* The offset of a tile that fades out: it grows until its neighbours own everything that they can show. */
        parts[i] = (cn_union_part){ .blend_width_m = CN_TILE_CACHE_BLEND_WIDTH * radius,
                                    .offset_m = radius * (1 / s->choice.weight[i] - 1),
                                    .appearance = &rows[i] };
        memcpy(parts[i].centre_m, g->centres[which], sizeof parts[i].centre_m);
        CN_TRY(cn_tile_cache_tile(g, g->which[which], &parts[i].tile));
        CN_TRY(row_of(g, s->ctx, parts[i].tile, s->v, &rows[i]));
    }
    CN_TRY(cn_render_union(s->ctx, &(cn_union){ s->choice.n, parts }, s->v->camera, s->v->view, s->v->options,
                           &(cn_union_output){ .picture = picture, .border = s->v->border, .owner = owner }));
    const size_t n = (size_t)picture->width * picture->height;
    for (size_t i = 0; i < n && owner; i++)
        if (owner[i] != UINT32_MAX) owner[i] = s->choice.tile[owner[i]];
    return CN_OK;
}

static void say_none(cn_tile_cache *g, const cn_context *ctx, const cn_view *view)
{
    if (!g->said_none && !g->n)
        cn_log(ctx, CN_LOG_WARN, "no tile of %s is trained yet: pictures stay empty until one is", g->city->folder);
    else if (!g->said_none)
        cn_log(ctx, CN_LOG_WARN,
               "%s is out of the reach of every tile and stays empty; other frames may too; raise compose.reach to see "
               "more",
               view->name ? view->name : "a view");
    g->said_none = true;
}

cn_status cn_tile_cache_blend(cn_tile_cache *g, const cn_context *ctx, const cn_tile_cache_view *v, cn_picture *picture)
{
    shot s = { .ctx = ctx, .v = v };
    const size_t pixels = (size_t)picture->width * picture->height;
    double centre[3];
    cn_view_centre(v->view, centre);
    cn_compose_choose(g->n, (const double(*)[3])g->centres, g->seen_radii, centre, &g->compose, &s.choice);
    CN_TRY(weigh_visibility(g, &s));
    if (v->used) snprintf(v->used, 32, "%s", s.choice.n ? g->plan->tiles[g->which[s.choice.tile[0]]].id : "");
    empty(v->camera, picture);
    if (v->border) memset(v->border, 0, pixels * sizeof *v->border);
    if (v->owner) memset(v->owner, 0xff, pixels * sizeof *v->owner);
    if (!s.choice.n) {
        say_none(g, ctx, v->view);
        return CN_OK;
    }
    CN_TRY(g->compose.scheme == CN_BLEND_OWNERSHIP ? view_as_union(g, &s, picture) : view_by_tile(g, &s, picture));
    cn_compose_fade(picture, s.choice.coverage);
    return CN_OK;
}
