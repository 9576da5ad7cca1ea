#include "conurb/stage.h"
#include "city/lock.h"
#include "renderer/alignment.h"

#include <stdio.h>

static void print_eval(const cn_context *ctx, const cn_eval *eval)
{
    for (uint32_t i = 0; i < eval->n_photos; i++)
        cn_log(ctx, CN_LOG_INFO, "%-28s %-20s %6.2f dB  SSIM %.4f, right half fitted on the left %6.2f dB",
               eval->photos[i].name, eval->photos[i].tile, eval->photos[i].plain.psnr, eval->photos[i].plain.ssim,
               eval->photos[i].half.psnr);
    if (eval->n_photos)
        cn_log(ctx, CN_LOG_INFO, "%-28s %-20s %6.2f dB  SSIM %.4f, right half fitted on the left %6.2f dB",
               "mean of held-out photos", "", eval->plain.psnr, eval->plain.ssim, eval->half.psnr);
}

/* Scores are made again only when a tile or the way of blending changed. scored: there are scores at the end. */
static cn_status eval_if_due(const cn_context *ctx, cn_city *city, bool *scored)
{
    cn_dataset m;
    cn_stage stage;
    cn_eval eval;
    CN_TRY(cn_dataset_load(ctx, city, true, &m));
    const cn_status status = cn_stage_eval(city, &m.plan, &stage);
    cn_dataset_deinit(&m);
    CN_TRY(status);
    *scored = cn_stage_done(city, &stage, NULL);
    if (*scored) {
        cn_city_lock_tidy(city, "eval");
        cn_log(ctx, CN_LOG_INFO, "eval is done: %s/eval/eval.json", city->folder);
        return CN_OK;
    }
    CN_TRY(cn_city_eval(ctx, city, NULL, &eval));
    print_eval(ctx, &eval);
    *scored = eval.n_photos > 0;
    cn_eval_deinit(&eval);
    return CN_OK;
}

/* A single tile has nothing to align. */
static cn_status match_if_due(const cn_context *ctx, cn_city *city)
{
    const cn_appearance_spec mean = { .kind = CN_APPEARANCE_MEAN };
    cn_dataset m;
    cn_stage stage;
    if (!city->config.match) return CN_OK;
    CN_TRY(cn_dataset_load(ctx, city, true, &m));
    const bool several = m.plan.n_tiles > 1;
    const cn_status status = cn_stage_alignment(city, &m.plan, &mean, &stage);
    cn_dataset_deinit(&m);
    CN_TRY(status);
    if (!several) return CN_OK;
    if (!cn_stage_done(city, &stage, NULL)) return cn_city_align(ctx, city, NULL);
    cn_log(ctx, CN_LOG_INFO, "match is done: %s/%s", city->folder, stage.stamp);
    return CN_OK;
}

/* Continue with the tiles that are trained. */
static cn_status finish_run(const cn_context *ctx, cn_city *city)
{
    const cn_city_render_options flight = { 0 };
    bool scored;
    CN_TRY(match_if_due(ctx, city));
    CN_TRY(eval_if_due(ctx, city, &scored));
    CN_TRY(cn_city_render(ctx, city, &flight));
    cn_log(ctx, CN_LOG_INFO, "map: %s/plan/plan.svg", city->folder);
    if (scored) cn_log(ctx, CN_LOG_INFO, "held-out photos beside their renders: %s/eval", city->folder);
    cn_log(ctx, CN_LOG_INFO, "flight: %s/renders/flight", city->folder);
    return CN_OK;
}

cn_status cn_city_run(const cn_context *ctx, cn_city *city, int quality, double time_budget_s)
{
    CN_TRY(cn_city_poses(ctx, city));
    CN_TRY(cn_city_plan(ctx, city, false, false));
    const cn_status trained = cn_city_train(ctx, city, NULL, quality, time_budget_s);
    if (trained == CN_OK) return finish_run(ctx, city);
    if (trained == CN_ERR_INTERRUPTED) return trained;
    char why[1024];
    snprintf(why, sizeof why, "%s", cn_error_message());
    const cn_status rest = finish_run(ctx, city);
    if (rest == CN_ERR_INTERRUPTED) return rest;
    /* Report failed tiles last, because the user has to act on them. */
    return cn_fail(trained, "%s", why);
}
