/* `conurb match`: one appearance in all tiles. */
#include "conurb/stage.h"
#include "renderer/alignment.h"

/* Logs each pair of neighbours from the file, as when it was made. */
static void report(const cn_context *ctx, const json_t *root, const char *path)
{
    size_t i;
    const json_t *e;
    json_array_foreach(json_object_get(root, "edges"), i, e) cn_log(
        ctx, CN_LOG_INFO, "%s - %s: %d places, difference %.4f, was %.4f", json_string_value(json_object_get(e, "a")),
        json_string_value(json_object_get(e, "b")), (int)json_integer_value(json_object_get(e, "places")),
        json_number_value(json_object_get(e, "rmse")), json_number_value(json_object_get(e, "own_rmse")));
    const size_t groups = json_array_size(json_object_get(root, "groups"));
    if (groups > 1)
        cn_log(ctx, CN_LOG_WARN, "%zu groups of tiles share no places with each other: each has a light of its own",
               groups);
    cn_log(ctx, CN_LOG_INFO, "matched: %s", path);
}

static cn_status align_appearance(cn_tile_cache *g, const cn_context *ctx, const cn_appearance_spec *spec)
{
    CN_TRY(cn_tile_cache_align(g, ctx, spec, true, NULL));
    for (uint32_t i = 0; i < g->fits.n_aligned; i++)
        report(ctx, g->fits.aligned[i].root, g->fits.aligned[i].path);
    if (!g->fits.n_aligned)
        cn_log(ctx, CN_LOG_INFO,
               g->n < 2 ? "a single tile has nothing to match"
                        : "nothing to match: that light has a row for each tile, or "
                          "compose.match is off");
    return CN_OK;
}

cn_status cn_city_align(const cn_context *ctx, cn_city *city, const char *appearance)
{
    cn_dataset m;
    cn_tile_cache g = { 0 };
    cn_appearance_spec spec = { 0 };
    CN_TRY(cn_dataset_load(ctx, city, true, &m));
    cn_status status = cn_appearance_spec_parse(&spec, appearance, city, &m.photos);
    if (status == CN_OK) status = cn_tile_cache_init(&g, ctx, city, &m);
    if (status == CN_OK) status = align_appearance(&g, ctx, &spec);
    cn_appearance_spec_deinit(&spec);
    cn_tile_cache_deinit(&g);
    cn_dataset_deinit(&m);
    return status;
}
