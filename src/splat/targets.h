/* What splats are fitted to: pictures and depths of a field in many views, in scratch files mapped into memory. */
#ifndef CONURB_SPLAT_TARGETS_H
#define CONURB_SPLAT_TARGETS_H
#include "conurb/splat.h"
#include "splat/clear.h"
#include "splat/raster.h"

typedef struct cn_target {
    cn_camera camera; /* a pinhole */
    cn_view view;
    double eye[3];
    size_t pixels; /* of its picture (cn_raster_target_size bytes) in `pictures` */
    size_t depths; /* of its first depth; height * width metres along the ray; 0: nothing; INFINITY: the sky */
} cn_target;
typedef struct cn_targets {
    const char *path;
    int fd[2]; /* pictures, depths */
    cn_target *list;
    uint32_t n, most, width_px;
    size_t size[2];          /* bytes */
    const uint8_t *pictures; /* once all are there */
    const float *depths;
    cn_clear_space clear;
} cn_targets;

/* Renders the source's views, and, when they are few, one between each and its two neighbours; all together with about
 * 32 pixels for each Gaussian of the budget at most. CN_ERR_DATA: no view. CN_ERR_INTERRUPTED. */
CN_NODISCARD cn_status cn_targets_make(cn_targets *targets, const cn_context *ctx, const cn_splat_source *source,
                                       uint32_t budget, const char *path);
void cn_targets_deinit(cn_targets *targets); /* fine when zeroed */
#endif
