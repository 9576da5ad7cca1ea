/* How many photos see a place: the depths of the photos that a tile was trained on, as the tile shows them itself. */
#ifndef CONURB_RENDERER_PHOTO_DEPTHS_H
#define CONURB_RENDERER_PHOTO_DEPTHS_H
#include "conurb/render.h"

#include <sys/stat.h>

typedef struct cn_photo_depth {
    cn_camera camera; /* of the small picture */
    const cn_view *view;
    double centre[3];
    float *depth; /* [height][width] metres along the ray; 0: nothing is there. NULL: not rendered yet */
} cn_photo_depth;
typedef struct cn_photo_depths {
    cn_photo_depth *photos; /* NULL: none is rendered yet */
    uint32_t n;
    struct stat file; /* of the tile; for the owner's use */
} cn_photo_depths;
/* The views of one tile. */
typedef struct cn_photo_views {
    const cn_scene *scene; /* borrowed for as long as the depths live */
    const uint32_t *views;
    uint32_t n;
} cn_photo_views;
enum { CN_PHOTO_DEPTHS_WIDTH = 128 };
/* Renders the depths of all views that are not there yet, or are narrower than width pixels (at most
 * CN_PHOTO_DEPTHS_WIDTH). Zero the struct before the first call. After a failure the next call goes on with the views
 * that are left. CN_ERR_NOMEM, CN_ERR_INTERRUPTED. */
CN_NODISCARD cn_status cn_photo_depths_render(cn_photo_depths *depths, const cn_context *ctx, const cn_tile *tile,
                                              const cn_photo_views *of, uint32_t width);
void cn_photo_depths_deinit(cn_photo_depths *depths); /* fine when zeroed */
/* The number of photos that see the place. */
uint32_t cn_photo_depths_count(const cn_photo_depths *depths, const double xyz[3]);
#endif
