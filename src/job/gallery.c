#include "job/gallery.h"

#include "base/file.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static char *tile_path(const cn_gallery *g, const char *id, const char *name)
{
    return cn_format("%s/%s/%s/%s", g->city->folder, g->folder, id, name);
}

cn_status cn_gallery_init(cn_gallery *g, const cn_context *ctx, const cn_city *city, const cn_material *material)
{
    return cn_gallery_init_at(g, ctx, city, material, "tiles");
}

cn_status cn_gallery_init_at(cn_gallery *g, const cn_context *ctx, const cn_city *city, const cn_material *material, const char *folder)
{
    const cn_plan *plan = &material->plan;
    *g = (cn_gallery){.city = city, .folder = folder, .plan = plan, .material = material, .n_cache = city->config.compose.max_tiles + 1};
    g->centres = calloc(plan->n_tiles + 1u, sizeof *g->centres);
    g->radii = calloc(plan->n_tiles + 1u, sizeof *g->radii);
    g->which = calloc(plan->n_tiles + 1u, sizeof *g->which);
    if (!g->centres || !g->radii || !g->which) {
        cn_gallery_deinit(g);
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
    cn_gallery_deinit(g);
    return cn_fail(CN_ERR_DATA, "%s has no trained tile yet; run `conurb train %s` first", city->folder, city->folder);
}

void cn_gallery_deinit(cn_gallery *g)
{
    for (uint32_t i = 0; i < CN_GALLERY_MAX; i++) cn_tile_close(&g->cache[i].open);
    cn_light_cache_deinit(&g->fits);
    free(g->centres);
    free(g->radii);
    free(g->which);
    *g = (cn_gallery){0};
}

/* The open tile, from the cache or in place of the one unused for longest. */
cn_status cn_gallery_tile(cn_gallery *g, uint32_t tile, const cn_tile **out)
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

static cn_status render_one(cn_gallery *g, const cn_context *ctx, const cn_tile *tile, const cn_camera *camera, const cn_view *view,
                            const cn_render_options *options, const cn_light *light, cn_picture *picture)
{
    cn_render_options mine = *options;
    cn_appearance row;
    if (light) {
        CN_TRY(cn_light_row(light, ctx, g->material, tile, &g->fits, &row));
        mine.appearance = &row;
    }
    return cn_render_tile(ctx, tile, camera, view, &mine, picture);
}

cn_status cn_gallery_view(cn_gallery *g, const cn_context *ctx, const cn_camera *camera, const cn_view *view, const cn_render_options *options,
                          const cn_light *light, cn_picture *picture, char *used)
{
    uint32_t chosen[CN_GALLERY_MAX];
    double weight[CN_GALLERY_MAX], centre[3], heaviest = -1;
    cn_view_centre(view, centre);
    const uint32_t n = cn_compose_choose(g->n, (const double (*)[3])g->centres, g->radii, centre, &g->city->config.compose, chosen, weight);
    cn_picture one;
    CN_TRY(cn_picture_init(&one, picture->width, picture->height));
    cn_status status = CN_OK;
    for (uint32_t i = 0; i < n && status == CN_OK; i++) {
        const cn_tile *tile;
        const size_t pixels = (size_t)one.width * one.height;
        memset(one.rgba, 0, pixels * 4 * sizeof(float));
        memset(one.depth, 0, pixels * sizeof(float));
        status = cn_gallery_tile(g, g->which[chosen[i]], &tile);
        if (status == CN_OK) status = render_one(g, ctx, tile, camera, view, options, light, &one);
        if (status == CN_OK) cn_compose_add(picture, &one, weight[i]);
        if (used && weight[i] > heaviest) {
            heaviest = weight[i];
            snprintf(used, 32, "%s", g->plan->tiles[g->which[chosen[i]]].id);
        }
    }
    if (status == CN_OK) cn_compose_finish(picture);
    cn_picture_deinit(&one);
    return status;
}
