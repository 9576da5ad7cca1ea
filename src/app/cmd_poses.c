#include "app.h"

typedef struct options {
    bool split, merge;
    double group;
} options;

static const cn_app_option table[] = {
    { "split", NULL, "only split the photos into groups, where there are so many that they are posed in groups",
      CN_APP_FLAG, offsetof(options, split), NULL },
    { "group", "N", "map only group N, from 1. Several processes may map groups of one city at the same time",
      CN_APP_NUMBER, offsetof(options, group), NULL },
    { "merge", NULL, "only merge the groups, when all are mapped or have failed", CN_APP_FLAG, offsetof(options, merge),
      NULL },
    { 0 }
};

static cn_status run_poses(const cn_context *ctx, const cn_app_call *call)
{
    const options *o = call->options;
    const bool one = o->group != 0;
    if (o->split + o->merge + one > 1) return cn_fail(CN_ERR_USAGE, "give one of --split, --group and --merge");
    if (one && !(o->group >= 1 && o->group <= 1e6 && o->group == (uint32_t)o->group))
        return cn_fail(CN_ERR_USAGE, "--group: give the number of a group, from 1");
    cn_city *city;
    CN_TRY(cn_city_open(&city, call->operands[0]));
    const cn_status status = o->split   ? cn_city_poses_split(ctx, city)
                             : o->merge ? cn_city_poses_merge(ctx, city)
                             : one      ? cn_city_poses_group(ctx, city, (uint32_t)o->group - 1)
                                        : cn_city_poses(ctx, city);
    cn_city_close(&city);
    return status;
}

const cn_app_command cn_app_poses = {
    .name = "poses",
    .summary = "find or import the photos' poses, and place them on Earth",
    .forms = "CITY",
    .about =
        "A pose says from where and in which direction a photo was taken. This command runs COLMAP, or imports "
        "poses, and aligns them to the GPS of the photos. COLMAP's log is CITY/poses/colmap.log. More than twice "
        "poses.group_photos photos are split by place into overlapping groups, each is mapped on its own "
        "(CITY/poses/groups), and the models are merged and adjusted; a group that fails does not stop the others. "
        "The options do one of these steps. After a stop, run the same command again: it resumes.",
    .example = "conurb poses beach",
    .min_operands = 1,
    .max_operands = 1,
    .options = table,
    .size = sizeof(options),
    .run = run_poses,
};
