/* conurb/measure.h: PSNR, SSIM and comparison pictures, on display-encoded sRGB in [0,1]. */
#ifndef CONURB_MEASURE_H
#define CONURB_MEASURE_H
#include "conurb/base.h"
#ifdef __cplusplus
extern "C" {
#endif

/* truth and test: n pixels of 3 floats. weight (n floats, 0 = ignored) may be NULL. Infinite for equal pictures, NaN when nothing counts. */
CN_API double cn_measure_psnr(const float *truth, const float *test, const float *weight, size_t n);
/* Mean SSIM over RGB, Gaussian window 11, sigma 1.5, K1 0.01, K2 0.03 (Wang et al. 2004). NaN for pictures smaller than 11 px. */
CN_API double cn_measure_ssim(const float *truth, const float *test, const float *weight, uint32_t width, uint32_t height);

typedef struct cn_eval_photo { char *name; char tile[32]; double psnr, ssim; } cn_eval_photo;
typedef struct cn_eval { cn_eval_photo *photos; uint32_t n_photos; double psnr, ssim; /* means */ } cn_eval;
CN_API void cn_eval_deinit(cn_eval *eval);

#ifdef __cplusplus
}
#endif
#endif
