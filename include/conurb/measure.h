/* conurb/measure.h: PSNR, SSIM comparison pictures and steadiness, on display-encoded sRGB in [0,1].
 * Nothing here keeps state: every function may be called from several threads at once. */
#ifndef CONURB_MEASURE_H
#define CONURB_MEASURE_H
#include "conurb/base.h"
#include "conurb/pose.h"
#ifdef __cplusplus
extern "C" {
#endif

/* Peak signal-to-noise ratio in dB, peak 1. truth and test: n pixels of 3 floats. weight (n floats >= 0, 0: ignored)
 * may be NULL. Infinite for equal pictures, NaN when nothing counts. */
CN_API double cn_measure_psnr(const float *truth, const float *test, const float *weight, size_t n);
/* Mean SSIM over RGB, Gaussian window of 11 px, sigma 1.5, K1 0.01, K2 0.03 (Wang et al. 2004). Windows lie wholly
 * inside the picture and count with the weight of their centre pixel (0: ignored). Pictures: height * width * 3 floats,
 * rows top down; weight (height * width floats) may be NULL. NaN for pictures smaller than 11 px, when nothing counts,
 * and when memory for 11 rows is lacking. */
CN_API double cn_measure_ssim(const float *truth, const float *test, const float *weight, uint32_t width,
                              uint32_t height);

/* Truth, test and error beside each other, for a person to look at. truth, test: height * width * 3 floats; out: height
 * * (3 * width) * 3 floats of the caller. Error: mean absolute difference of RGB, black (0) over red and yellow to
 * white (0.25 and more). */
CN_API void cn_measure_side_by_side(const float *truth, const float *test, uint32_t width, uint32_t height, float *out);

/* The affine change of RGB (3 x 4, least squares) that brings test nearest to truth, applied to test and clamped to [0,
 * 1]. n pixels of 3 floats; weight (n floats) may be NULL; out may be test. */
CN_API void cn_measure_colour_correct(const float *truth, const float *test, const float *weight, size_t n, float *out);

/* Figures of one comparison. */
typedef struct cn_score {
    double psnr, ssim;
} cn_score;
/* A held-out photo, scored in four ways that are never mixed:
 *   plain      the whole photo under the mean appearance and its own EXIF exposure, matched between the tiles that show
 *   half       the protocol of NeRF-W: the appearance is fitted on the left half, the right half is scored
 *   unfitted   the right half without that fit: plain's picture
 *   corrected  plain, after the best affine change of colour */
typedef struct cn_eval_photo {
    char *name;
    char tile[32];
    cn_score plain, half, unfitted, corrected;
} cn_eval_photo;
typedef struct cn_eval {
    cn_eval_photo *photos;
    uint32_t n_photos;
    cn_score plain, half, unfitted, corrected; /* means; NaN without a photo */
    double render_s;                           /* to render one photo's view, the median; NaN where there is none */
} cn_eval;
/* Frees names and photos (both from malloc) and zeroes the rest. Safe on a zeroed eval and twice. */
CN_API void cn_eval_deinit(cn_eval *eval);

/* ---- how steady a path is ----
 * Each frame is looked up in the one before by its own depth; the residual is the mean absolute difference of RGB. What
 * is hidden or out of sight in the frame before does not count. A pixel is at a border where a second tile has
 * CN_TEMPORAL_SHARE of it or more in either frame, and everywhere when the frames are of different tiles; elsewhere it
 * is away from borders. A residual of pixels is mostly texture that is a part of a pixel off. Light that changes with
 * the tiles' weights is far below that, but changes a whole region alike: the residual of light is the mean over RGB of
 * |mean over a block of the signed differences|, in blocks of CN_TEMPORAL_BLOCK pixels a side of which at least half
 * can be compared, and which are at a border as most of these pixels are. */
#define CN_TEMPORAL_SHARE 0.05f
enum { CN_TEMPORAL_LEVELS = 16, CN_TEMPORAL_STEPS = 1000, CN_TEMPORAL_BLOCK = 8 };
/* rgb: height * width * 3, display-encoded; depth: height * width metres along the ray, 0: none; border: height *
 * width, each pixel's second heaviest share (cn_compose_finish). camera has the picture's size. All borrowed. */
typedef struct cn_temporal_frame {
    uint32_t width, height;
    const float *rgb, *depth, *border;
    const cn_camera *camera;
    const cn_view *view;
} cn_temporal_frame;
/* Residuals so far: their number by thousandths, and number and sum by how strong the texture is (a level is a factor
 * of sqrt 2). */
typedef struct cn_temporal_part {
    uint64_t n, count[CN_TEMPORAL_STEPS + 1], level_n[CN_TEMPORAL_LEVELS];
    double sum, level_sum[CN_TEMPORAL_LEVELS];
} cn_temporal_part;
typedef struct cn_temporal {
    cn_temporal_part away, border, light_away, light_border;
} cn_temporal; /* starts zeroed */
/* Adds a frame and the one before it, of one size. switched: the tiles that they are of have nothing in common. */
CN_API void cn_measure_temporal(cn_temporal *sums, const cn_temporal_frame *before, const cn_temporal_frame *after,
                                bool switched);
/* Means and medians of the residuals, NaN where there are none. ratio: the mean at borders over the mean that pixels
 * (of light: blocks) of the same texture have away from borders, for a residual grows with texture (half a pixel off is
 * nothing on asphalt); 1: borders do not show. */
typedef struct cn_temporal_figure {
    uint64_t n_border, n_away;
    double border_mean, away_mean, border_median, away_median, ratio;
} cn_temporal_figure;
typedef struct cn_temporal_figures {
    cn_temporal_figure pixels, light;
} cn_temporal_figures;
CN_API cn_temporal_figures cn_measure_temporal_figures(const cn_temporal *sums);

/* ---- seams within a picture ----
 * Where each tile owns a part of the picture, what differs stays at one place, and no warp of frames sees it. Two
 * blocks of CN_TEMPORAL_BLOCK pixels a side in one row or column, each of one tile alone, not of the same one, with at
 * most CN_SEAM_GAP blocks between them, are a crossing. Its step is the mean over RGB of |difference of the blocks'
 * means|: in the picture, and in what each of the two tiles shows there alone, where there is no border and the step is
 * the scene's own. */
enum { CN_SEAM_GAP = 4 };
/* rgb: height * width * 3, display-encoded; owner: height * width, each pixel's tile, UINT32_MAX: none; border: each
 * pixel's second heaviest share. alone[i]: as rgb, of the tile that owner names i; NULL for one that owns nothing. All
 * borrowed. */
typedef struct cn_seam_frame {
    uint32_t width, height;
    const float *rgb, *border;
    const uint32_t *owner;
    const float *const *alone;
    uint32_t n_tiles;
} cn_seam_frame;
typedef struct cn_seam {
    uint64_t n;
    double step, own_step;
} cn_seam; /* sums; starts zeroed */
CN_API void cn_measure_seam(cn_seam *seam, const cn_seam_frame *frame);
/* Means of a crossing's step in the pictures and in the two tiles' own; ratio: the first over the second. 1: the border
 * adds nothing. NaN where there is none. */
typedef struct cn_seam_figures {
    uint64_t n;
    double step, own_step, ratio;
} cn_seam_figures;
CN_API cn_seam_figures cn_measure_seam_figures(const cn_seam *seam);

/* ---- what accuracy costs in time ---- */
/* render_s: to render a held-out photo, the median. Seconds are those of a machine that does nothing else. */
typedef struct cn_tradeoff_row {
    char name[64];
    double train_s, render_s, bytes, psnr, half_psnr;
} cn_tradeoff_row;
typedef struct cn_tradeoff {
    cn_tradeoff_row *rows;
    uint32_t n;
} cn_tradeoff;
CN_API void cn_tradeoff_deinit(cn_tradeoff *tradeoff);

#ifdef __cplusplus
}
#endif
#endif
