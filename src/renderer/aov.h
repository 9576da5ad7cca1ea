/* Channels beside a picture's colour: from its depths, and from the tile that each pixel is of. */
#ifndef CONURB_RENDERER_AOV_H
#define CONURB_RENDERER_AOV_H
#include "renderer/tile_cache.h"

/* A picture that is there already. */
typedef struct cn_aov_source {
    const cn_camera *camera;
    const cn_view *view;
    const cn_picture *picture;
    const uint32_t *owner; /* of each pixel the tile, below tiles->n; NULL: all are of `tile` */
    uint32_t tile;
    uint32_t coarse; /* 0, or a divisor of the width of the photos' depths, for a picture that must come soon */
} cn_aov_source;
/* Whether any of these channels needs the owners of pixels. */
bool cn_aov_needs_owner(unsigned which);
/* aovs is made and zeroed by the caller; what it has room for is filled. CN_ERR_INTERRUPTED when asked to stop. */
CN_NODISCARD cn_status cn_aovs_fill(cn_tile_cache *tiles, const cn_context *ctx, const cn_aov_source *source,
                                    cn_aovs *aovs);
#endif
