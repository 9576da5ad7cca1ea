/* How well a plane at a pixel explains the sources' pictures. Private to stereo/. */
#ifndef CONURB_STEREO_WINDOW_H
#define CONURB_STEREO_WINDOW_H
#include "kernel/kernel.h"
#include "stereo/views.h"

/* From the reference's pixels to a source's: the homography a + b m^T, m = K^-T normal / distance. */
typedef struct cn_stereo_pair {
    float a[9], b[3];
    cn_grey_picture picture;
} cn_stereo_pair;

/* The reference's window at a pixel, with bilateral weights (Yoon and Kweon 2006). */
typedef struct cn_stereo_window {
    cn_window samples;
    float x, y, sum, mean, variance;
} cn_stereo_window;

void cn_stereo_pair_init(cn_stereo_pair *pair, const cn_stereo_view *reference, const cn_stereo_view *source);
/* 5 x 5 samples, `step` pixels apart. */
void cn_stereo_window_init(cn_stereo_window *window, const cn_stereo_view *reference, uint32_t x, uint32_t y,
                           uint32_t step);
/* 1 - normalised cross-correlation, in [0, 2]; 2 where the source does not see the plane, or where there is no texture.
 * m: see above. */
float cn_stereo_cost(const cn_kernel *kernel, const cn_stereo_window *window, const cn_stereo_pair *pair,
                     const float m[3]);
#endif
