/* Several tiles marched as one field. */
#include "render/march.h"

cn_status cn_render_union(const cn_context *ctx, const cn_union *tiles, const cn_camera *camera, const cn_view *view,
                          const cn_render_options *options, const cn_union_output *output)
{
    const uint32_t n = tiles->n;
    double centre[3];
    cn_raymarch m;
    if (n < 1 || n > CN_UNION_MAX)
        return cn_fail(CN_ERR_USAGE, "%u tiles cannot be rendered together; give 1 to %d", n, CN_UNION_MAX);
    CN_TRY(cn_raymarch_check(camera, output->picture));
    cn_view_centre(view, centre);
    cn_status status = cn_raymarch_init(&m, ctx, options, n, tiles->parts, centre);
    m.border = output->border;
    m.owner = output->owner;
    /* When the camera is far from a tile's photos, the tile is seen beyond its own range. */
    m.to_exit = true;
    if (status == CN_OK) cn_raymarch_take_picture(&m, camera, view, output->picture);
    if (status == CN_OK) status = cn_raymarch_run(&m);
    cn_raymarch_deinit(&m);
    return status;
}

void cn_union_shares(uint32_t n, const cn_union_part *parts, const double xy_m[2], double *share)
{
    cn_partition partition;
    float at[CN_UNION_MAX];
    cn_partition_init(&partition, n, parts, xy_m);
    cn_partition_shares(&partition, 0, 0, at);
    for (uint32_t i = 0; i < n; i++)
        share[i] = (double)at[i];
}
