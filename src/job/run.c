#include "job/workspace.h"

static void print_eval(const cn_context *ctx, const cn_eval *eval)
{
    for (uint32_t i = 0; i < eval->n_photos; i++)
        cn_log(ctx, CN_LOG_INFO, "%-28s %-20s %6.2f dB  SSIM %.4f, right half fitted on the left %6.2f dB",
               eval->photos[i].name, eval->photos[i].tile, eval->photos[i].plain.psnr, eval->photos[i].plain.ssim, eval->photos[i].half.psnr);
    if (eval->n_photos)
        cn_log(ctx, CN_LOG_INFO, "%-28s %-20s %6.2f dB  SSIM %.4f, right half fitted on the left %6.2f dB", "mean of held-out photos", "",
               eval->plain.psnr, eval->plain.ssim, eval->half.psnr);
}

cn_status cn_city_run(const cn_context *ctx, cn_city *city, int quality)
{
    cn_eval eval;
    const cn_city_render_options flight = {0};
    CN_TRY(cn_city_poses(ctx, city));
    CN_TRY(cn_city_plan(ctx, city, false));
    CN_TRY(cn_city_train(ctx, city, NULL, quality, 0));
    CN_TRY(cn_city_eval(ctx, city, &eval));
    print_eval(ctx, &eval);
    cn_eval_deinit(&eval);
    CN_TRY(cn_city_render(ctx, city, &flight));
    cn_log(ctx, CN_LOG_INFO, "map: %s/plan/plan.svg", city->folder);
    cn_log(ctx, CN_LOG_INFO, "held-out photos beside their renders: %s/eval", city->folder);
    cn_log(ctx, CN_LOG_INFO, "flight: %s/renders/flight", city->folder);
    return CN_OK;
}
