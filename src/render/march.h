/* Rays marched front to back through one tile, or through several that share space. One tile is the case of one part.
 * Rays go in blocks, one block a task of the pool, and in rounds of a few samples, so that a ray that has become opaque
 * costs nothing behind its surface. A block is an item of three operations of a device: rays, trace, pixels. */
#ifndef CONURB_RENDER_MARCH_H
#define CONURB_RENDER_MARCH_H
#include "render/raymarch.h"

/* parts: 1 to CN_UNION_MAX; origin_m: the camera's place on the map. Caller deinits, also after a failure. */
CN_NODISCARD cn_status cn_raymarch_init(cn_raymarch *march, const cn_context *ctx, const cn_render_options *options,
                                        uint32_t n, const cn_union_part *parts, const double origin_m[2]);
void cn_raymarch_deinit(cn_raymarch *march);
/* CN_ERR_USAGE when the camera does not have the picture's size. */
CN_NODISCARD cn_status cn_raymarch_check(const cn_camera *camera, const cn_picture *picture);
/* Takes the rays of a picture's pixels, and the picture as the result. */
void cn_raymarch_take_picture(cn_raymarch *march, const cn_camera *camera, const cn_view *view, cn_picture *picture);
/* Renders all rays on the device of ctx: every render of one tile and of several comes through here.
 * CN_ERR_INTERRUPTED when ctx asks to stop, which is looked at once a block. */
CN_NODISCARD cn_status cn_raymarch_run(cn_raymarch *march);
#endif
