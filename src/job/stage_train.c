#include "job/workspace.h"

#include "base/file.h"
#include "base/hash.h"

#include <stdio.h>
#include <stdlib.h>

static cn_status train_one(const cn_context *ctx, const cn_city *city, const cn_material *m, const cn_plan_tile *tile, const cn_train_options *options)
{
    char record[96], artefact[96], parent[17];
    cn_stage stage;
    CN_TRY(cn_stage_tile(city, options, tile, &m->scene, record, sizeof record, &stage));
    snprintf(artefact, sizeof artefact, "tiles/%s/DONE", tile->id);
    if (cn_stage_done(city, &stage, artefact)) {
        cn_log(ctx, CN_LOG_INFO, "tile %s is done", tile->id);
        return CN_OK;
    }
    cn_hash_hex(cn_stage_hash(&stage), parent);
    char *tiles = cn_city_path(city, "tiles"), *dir = tiles ? cn_path_join(tiles, tile->id) : NULL;
    const cn_train_input input = {&m->scene, &m->photos, m->pixels, tile};
    cn_train_result result;
    cn_status status = dir ? cn_train_tile(ctx, &input, options, parent, dir, &result) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_stage_finish(city, &stage);
    if (status == CN_OK)
        cn_log(ctx, CN_LOG_INFO, "tile %s: %u steps in %.0f s, %.2f M samples/s, training PSNR %.2f dB, %.0f MB", tile->id, result.steps, result.seconds,
               result.samples_per_s / 1e6, result.train_psnr, (double)result.arena_bytes / 1e6);
    free(tiles);
    free(dir);
    return status;
}

cn_status cn_city_train(const cn_context *ctx, cn_city *city, const char *tile, int quality, double time_budget_s)
{
    cn_material m;
    CN_TRY(cn_material_load(ctx, city, true, &m));
    const cn_train_options options = cn_config_train(&city->config, quality, time_budget_s);
    const int64_t only = tile ? cn_plan_find(&m.plan, tile) : -1;
    cn_status status = tile && only < 0 ? cn_fail(CN_ERR_USAGE, "the plan has no tile '%s'; see %s/plan/plan.json", tile, city->folder) : CN_OK;
    for (uint32_t i = 0; i < m.plan.n_tiles && status == CN_OK; i++)
        if (only < 0 || only == (int64_t)i) status = train_one(ctx, city, &m, &m.plan.tiles[i], &options);
    cn_material_deinit(&m);
    return status;
}
