/* Pictures of one tile. */
#include "render/march.h"

#include <stdlib.h>

cn_render_options cn_render_options_default(void)
{
    return (cn_render_options){ .min_transmittance = 1e-3, .depth_left = 0.5, .fine_depth = true };
}

cn_status cn_picture_init(cn_picture *picture, uint32_t width, uint32_t height)
{
    *picture = (cn_picture){ .width = width, .height = height };
    if (!width || !height || width > 65535 || height > 65535)
        return cn_fail(CN_ERR_USAGE, "a picture of %u x %u pixels cannot be made; give 1 to 65535 pixels for each side",
                       width, height);
    picture->rgba = calloc((size_t)width * height * 4, sizeof(float));
    picture->depth = calloc((size_t)width * height, sizeof(float));
    if (!picture->rgba || !picture->depth) {
        cn_picture_deinit(picture);
        return cn_fail(CN_ERR_NOMEM, "out of memory for a picture of %u x %u pixels", width, height);
    }
    return CN_OK;
}

void cn_picture_deinit(cn_picture *picture)
{
    free(picture->rgba);
    free(picture->depth);
    *picture = (cn_picture){ 0 };
}

cn_status cn_render_tile(const cn_context *ctx, const cn_tile *tile, const cn_camera *camera, const cn_view *view,
                         const cn_render_options *options, cn_picture *picture)
{
    const cn_union_part part = { .tile = tile, .appearance = options->appearance };
    cn_raymarch m;
    CN_TRY(cn_raymarch_check(camera, picture));
    cn_status status = cn_raymarch_init(&m, ctx, options, 1, &part, part.centre_m);
    if (status == CN_OK) cn_raymarch_take_picture(&m, camera, view, picture);
    if (status == CN_OK) status = cn_raymarch_run(&m);
    cn_raymarch_deinit(&m);
    return status;
}

cn_status cn_render_rays(const cn_context *ctx, const cn_tile *tile, const cn_ray_list *rays,
                         const cn_render_options *options, float *rgba, float *depth_m)
{
    const cn_union_part part = { .tile = tile, .appearance = options->appearance };
    cn_raymarch m;
    if (!rays->n) return CN_OK;
    cn_status status = cn_raymarch_init(&m, ctx, options, 1, &part, part.centre_m);
    m.rgba = rgba;
    m.depth = depth_m;
    m.n_rays = rays->n;
    m.origin = rays->origin_m;
    m.direction = rays->direction;
    m.range = options->range_m;
    if (m.range) m.all_opaque = m.any_opaque = false;
    if (status == CN_OK) status = cn_raymarch_run(&m);
    cn_raymarch_deinit(&m);
    return status;
}
