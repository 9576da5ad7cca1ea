/* PatchMatch over one view. Private to stereo/. */
#ifndef CONURB_STEREO_MATCH_H
#define CONURB_STEREO_MATCH_H
#include "stereo/views.h"

/* Called after each row; part: of the work on the view that is done. False: stop, and leave view->depth NULL. */
typedef struct cn_stereo_watch {
    bool (*row)(void *user, double part);
    void *user;
} cn_stereo_watch;

/* Finds view->depth: a plane for each pixel, spread to neighbours and changed at random (Bleyer et al. 2011,
 * "PatchMatch Stereo"; Galliani et al. 2015 for the order). The first planes are those of the prior, where there is one
 * (NULL: nowhere), those of sparse points, and random ones. options->seed: of this view. */
CN_NODISCARD cn_status cn_stereo_match(cn_stereo_views *views, uint32_t view, const cn_scene *scene,
                                       const cn_stereo_map *prior, const cn_stereo_options *options,
                                       const cn_stereo_watch *watch);
#endif
