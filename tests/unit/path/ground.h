/* A synthetic ground for path tests: z = slope * x, with a lamp post, and nothing at all west of -1000 m. */
#ifndef CONURB_TEST_PATH_GROUND_H
#define CONURB_TEST_PATH_GROUND_H
#include "conurb/path.h"

#include <math.h>

typedef struct synthetic_ground {
    double slope, post_x, post_height;
    size_t samples;
} synthetic_ground;

static inline cn_status synthetic_heights(void *user, size_t n, const double (*xy_m)[2], double *ground_m)
{
    synthetic_ground *g = user;
    for (size_t i = 0; i < n; i++) {
        double x = xy_m[i][0];
        ground_m[i] = x < -1000 ? NAN : g->slope * x + (fabs(x - g->post_x) < 0.1 ? g->post_height : 0);
    }
    g->samples += n;
    return CN_OK;
}

static inline cn_frame synthetic_frame(bool georeferenced)
{
    cn_frame frame;
    cn_frame_init(&frame);
    frame.georeferenced = georeferenced;
    frame.latitude_deg = 50;
    frame.longitude_deg = 8;
    frame.height_m = 100;
    return frame;
}

static inline cn_path_options synthetic_options(const cn_frame *frame, synthetic_ground *ground)
{
    cn_path_options options = cn_path_options_default();
    options.frame = frame;
    options.width = 160;
    options.height = 90;
    if (ground) {
        options.sound = synthetic_heights;
        options.sound_user = ground;
    }
    return options;
}
#endif
