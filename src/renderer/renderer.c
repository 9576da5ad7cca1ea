#include "renderer/renderer.h"

#include <stdlib.h>

static cn_status create(cn_renderer **renderer, const cn_context *ctx, const cn_city *city)
{
    cn_renderer *r = *renderer = calloc(1, sizeof *r);
    if (!r) return cn_fail(CN_ERR_NOMEM, "out of memory for a renderer");
    if (ctx) r->ctx = *ctx;
    r->city = city;
    pthread_mutex_init(&r->turn, NULL);
    pthread_mutex_init(&r->lock, NULL);
    pthread_cond_init(&r->changed, NULL);
    return CN_OK;
}

cn_status cn_renderer_open(cn_renderer **renderer, const cn_context *ctx, const cn_city *city,
                           const cn_dataset *dataset, const char *folder)
{
    CN_TRY(create(renderer, ctx, city));
    (*renderer)->dataset = dataset;
    const cn_status status = cn_tile_cache_init_at(&(*renderer)->tiles, ctx, city, dataset, folder);
    if (status != CN_OK) cn_renderer_destroy(renderer);
    return status;
}

cn_status cn_renderer_create(cn_renderer **renderer, const cn_context *ctx, const cn_city *city, bool read_only)
{
    CN_TRY(create(renderer, ctx, city));
    cn_renderer *r = *renderer;
    r->read_only = read_only;
    r->dataset = &r->own;
    cn_status status = cn_dataset_load(ctx, city, true, &r->own);
    if (status == CN_OK) status = cn_tile_cache_init_live(&r->tiles, ctx, city, &r->own, read_only);
    if (status == CN_OK) status = cn_colour_create(&r->colour, NULL);
    if (status != CN_OK) cn_renderer_destroy(renderer);
    return status;
}

void cn_renderer_destroy(cn_renderer **renderer)
{
    cn_renderer *r = *renderer;
    if (!r) return;
    cn_renderer_queue_close(r);
    cn_tile_cache_deinit(&r->tiles);
    cn_colour_destroy(&r->colour);
    cn_dataset_deinit(&r->own);
    pthread_cond_destroy(&r->changed);
    pthread_mutex_destroy(&r->lock);
    pthread_mutex_destroy(&r->turn);
    free(r);
    *renderer = NULL;
}

cn_status cn_renderer_draw(cn_renderer *r, const cn_context *ctx, const cn_tile_cache_view *view, int64_t tile,
                           cn_picture *picture)
{
    pthread_mutex_lock(&r->turn);
    const cn_status status = tile == CN_RENDERER_BLEND
                                 ? cn_tile_cache_blend(&r->tiles, ctx, view, picture)
                                 : cn_tile_cache_alone(&r->tiles, ctx, (uint32_t)tile, view, picture);
    pthread_mutex_unlock(&r->turn);
    return status;
}

static cn_status draw_aovs(cn_renderer *r, const cn_context *ctx, cn_tile_cache_view *view, unsigned which,
                           cn_picture *picture, cn_aovs *aovs)
{
    uint32_t *owner = NULL;
    if (cn_aov_needs_owner(which)) {
        owner = malloc((size_t)picture->width * picture->height * sizeof *owner);
        if (!owner) return cn_fail(CN_ERR_NOMEM, "out of memory for the owners of pixels");
    }
    view->owner = owner;
    view->owner_by_all = true;
    const cn_aov_source source = { view->camera, view->view, picture, owner, 0, 1 };
    cn_status status = cn_tile_cache_blend(&r->tiles, ctx, view, picture);
    if (status == CN_OK) status = cn_aovs_init(aovs, picture->width, picture->height, which);
    if (status == CN_OK) status = cn_aovs_fill(&r->tiles, ctx, &source, aovs);
    if (status != CN_OK) cn_aovs_deinit(aovs);
    free(owner);
    return status;
}

cn_status cn_renderer_draw_aovs(cn_renderer *r, const cn_context *ctx, const cn_tile_cache_view *view, unsigned which,
                                cn_picture *picture, cn_aovs *aovs)
{
    cn_tile_cache_view mine = *view;
    *aovs = (cn_aovs){ 0 };
    pthread_mutex_lock(&r->turn);
    const cn_status status = draw_aovs(r, ctx, &mine, which, picture, aovs);
    pthread_mutex_unlock(&r->turn);
    return status;
}

cn_status cn_renderer_align(cn_renderer *r, const cn_context *ctx, const cn_appearance_spec *spec, bool make,
                            uint64_t *hash)
{
    pthread_mutex_lock(&r->turn);
    const cn_status status = cn_tile_cache_align(&r->tiles, ctx, spec, make, hash);
    pthread_mutex_unlock(&r->turn);
    return status;
}

cn_status cn_renderer_row(cn_renderer *r, const cn_context *ctx, const cn_appearance_spec *spec, const cn_tile *tile,
                          cn_appearance *row)
{
    pthread_mutex_lock(&r->turn);
    const cn_status status = cn_appearance_spec_row(spec, ctx, r->dataset, tile, &r->tiles.fits, row);
    pthread_mutex_unlock(&r->turn);
    return status;
}
