/* conurb/measure.h: PSNR, SSIM and comparison pictures, on display-encoded sRGB in [0,1].
 * Nothing here keeps state: every function may be called from several threads at once. */
#ifndef CONURB_MEASURE_H
#define CONURB_MEASURE_H
#include "conurb/base.h"
#ifdef __cplusplus
extern "C" {
#endif

/* Peak signal-to-noise ratio in dB, peak 1. truth and test: n pixels of 3 floats. weight (n floats >= 0, 0: ignored) may be
 * NULL. Infinite for equal pictures, NaN when nothing counts. */
CN_API double cn_measure_psnr(const float *truth, const float *test, const float *weight, size_t n);
/* Mean SSIM over RGB, Gaussian window of 11 px, sigma 1.5, K1 0.01, K2 0.03 (Wang et al. 2004). Windows lie wholly inside the
 * picture and count with the weight of their centre pixel (0: ignored). Pictures: height * width * 3 floats, rows top down;
 * weight (height * width floats) may be NULL. NaN for pictures smaller than 11 px, when nothing counts, and when memory for 11
 * rows is lacking. */
CN_API double cn_measure_ssim(const float *truth, const float *test, const float *weight, uint32_t width, uint32_t height);

/* Truth, test and error beside each other, for a person to look at. truth, test: height * width * 3 floats; out: height *
 * (3 * width) * 3 floats of the caller. Error: mean absolute difference of RGB, black (0) over red and yellow to white (0.25 and more). */
CN_API void cn_measure_side_by_side(const float *truth, const float *test, uint32_t width, uint32_t height, float *out);

/* The affine change of RGB (3 x 4, least squares) that brings test nearest to truth, applied to test and clamped to [0, 1]. n pixels of 3
 * floats; weight (n floats) may be NULL; out may be test. */
CN_API void cn_measure_colour_correct(const float *truth, const float *test, const float *weight, size_t n, float *out);

/* Figures of one comparison. */
typedef struct cn_score { double psnr, ssim; } cn_score;
/* A held-out photo, scored in three ways that are never mixed:
 *   plain      the whole photo under the mean appearance and its own EXIF exposure
 *   half       the protocol of NeRF-W: the appearance is fitted on the left half, the right half is scored
 *   corrected  plain, after the best affine change of colour */
typedef struct cn_eval_photo { char *name; char tile[32]; cn_score plain, half, corrected; } cn_eval_photo;
typedef struct cn_eval { cn_eval_photo *photos; uint32_t n_photos; cn_score plain, half, corrected; /* means */ } cn_eval;
/* Frees names and photos (both from malloc) and zeroes the rest. Safe on a zeroed eval and twice. */
CN_API void cn_eval_deinit(cn_eval *eval);

#ifdef __cplusplus
}
#endif
#endif
