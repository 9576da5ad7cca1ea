#include "app.h"

static cn_status run_poses(const cn_context *ctx, const cn_app_args *args)
{
    const char *folder;
    const cn_app_option none[] = { { 0 } };
    cn_city *city;
    CN_TRY(cn_app_parse(args, &folder, none));
    CN_TRY(cn_city_open(&city, folder));
    const cn_status status = cn_city_poses(ctx, city);
    cn_city_close(&city);
    return status;
}

const cn_app_command cn_app_poses = {
    "poses",
    "find or import the photos' poses, and place them on Earth",
    "usage: conurb poses CITY\n\nRuns COLMAP (its log is CITY/poses/colmap.log) or imports, aligns to GPS. "
    "Resumes.\n\nexample: conurb poses beach",
    run_poses,
};
