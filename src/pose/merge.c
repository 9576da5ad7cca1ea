#include "pose/merge.h"

#include "base/clock.h"
#include "pose/control_fit.h"
#include "pose/scene.h"

#include <stdlib.h>

void cn_merge_report_deinit(cn_merge_report *report)
{
    free(report->groups);
    *report = (cn_merge_report){ 0 };
}

static cn_status merge(const cn_context *ctx, const cn_merge_task *task, cn_scene *scene, cn_frame *frame,
                       cn_merge_report *report)
{
    cn_group_links links;
    cn_group_place *places = calloc(task->groups->n + (size_t)1, sizeof *places);
    uint32_t *home = NULL;
    const double began_s = cn_now_s();
    if (!places) return cn_fail(CN_ERR_NOMEM, "out of memory merging groups");
    cn_status status = cn_group_links_find(task, &links);
    if (status == CN_OK) {
        status = cn_groups_place(ctx, task, &links, places, frame, report);
        report->join_s = cn_now_s() - began_s;
    }
    if (status == CN_OK) status = cn_groups_assemble(task, &links, places, scene, &home);
    cn_group_links_deinit(&links);
    if (status == CN_OK) status = cn_groups_adjust(ctx, task, home, scene, frame, report);
    free(places);
    free(home);
    return status;
}

cn_status cn_groups_merge(const cn_context *ctx, const cn_merge_task *task, cn_scene *scene, cn_frame *frame,
                          cn_merge_report *report)
{
    *scene = (cn_scene){ 0 };
    *report = (cn_merge_report){ .n_groups = task->groups->n,
                                 .groups = calloc(task->groups->n + (size_t)1, sizeof *report->groups) };
    const cn_status status =
        report->groups ? merge(ctx, task, scene, frame, report) : cn_fail(CN_ERR_NOMEM, "out of memory merging groups");
    if (status == CN_OK) return CN_OK;
    cn_scene_deinit(scene);
    cn_merge_report_deinit(report);
    return status;
}
