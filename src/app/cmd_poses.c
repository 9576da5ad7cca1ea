#include "app.h"

static cn_status run_poses(const cn_context *ctx, const cn_app_call *call)
{
    cn_city *city;
    CN_TRY(cn_city_open(&city, call->operands[0]));
    const cn_status status = cn_city_poses(ctx, city);
    cn_city_close(&city);
    return status;
}

const cn_app_command cn_app_poses = {
    .name = "poses",
    .summary = "find or import the photos' poses, and place them on Earth",
    .forms = "CITY",
    .about = "A pose says from where and in which direction a photo was taken. This command runs COLMAP, or imports "
             "poses, and aligns them to the GPS of the photos. COLMAP's log is CITY/poses/colmap.log. After a stop, "
             "run the same command again: it resumes.",
    .example = "conurb poses beach",
    .min_operands = 1,
    .max_operands = 1,
    .run = run_poses,
};
