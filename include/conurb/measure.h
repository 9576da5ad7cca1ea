/* conurb/measure.h: PSNR, SSIM, comparison pictures, temporal consistency and seams. All pictures are display-encoded
 * sRGB in [0, 1]. No function keeps state: several threads may call them at the same time. */
#ifndef CONURB_MEASURE_H
#define CONURB_MEASURE_H
#include "conurb/base.h"
#include "conurb/pose.h"
#ifdef __cplusplus
extern "C" {
#endif

/* Peak signal-to-noise ratio in dB, peak 1. truth and test: n pixels of 3 floats. weight: NULL, or n floats >= 0;
 * pixels of weight 0 are ignored. Infinite for equal pictures; NaN when all weights are 0. */
CN_API double cn_measure_psnr(const float *truth, const float *test, const float *weight, size_t n);
/* Mean SSIM over RGB with a Gaussian window of 11 px, sigma 1.5, K1 0.01, K2 0.03 (Wang et al. 2004). Windows lie
 * wholly inside the picture; each counts with the weight of its centre pixel. Pictures: height * width * 3 floats,
 * rows top down. weight: NULL, or height * width floats >= 0. NaN: the picture is smaller than 11 px, all weights are
 * 0, or there is no memory for 11 rows. */
CN_API double cn_measure_ssim(const float *truth, const float *test, const float *weight, uint32_t width,
                              uint32_t height);

/* Puts truth, test and error side by side in one picture. truth, test: height * width * 3 floats; out: height * (3 *
 * width) * 3 floats of the caller. The error is the mean absolute difference of RGB, from black (0) over red and
 * yellow to white (0.25 and more). */
CN_API void cn_measure_side_by_side(const float *truth, const float *test, uint32_t width, uint32_t height, float *out);

/* Fits an affine transform of RGB (3 x 4) from test to truth by least squares, applies it to test, and clamps to [0,
 * 1]. n pixels of 3 floats. weight: NULL, or n floats. out may be test. */
CN_API void cn_measure_colour_correct(const float *truth, const float *test, const float *weight, size_t n, float *out);

/* The scores of one comparison; psnr in dB. */
typedef struct cn_score {
    double psnr, ssim;
} cn_score;
/* A held-out photo with four scores, each by a protocol of its own:
 *   plain      the whole photo, with the mean appearance of its capture run, aligned between the tiles, and the photo's
 *              EXIF exposure
 *   half       the protocol of NeRF-W: the appearance is fitted to the left half, the right half is scored
 *   unfitted   the right half of the plain picture, without a fit
 *   corrected  plain, after the best affine transform of colour */
typedef struct cn_eval_photo {
    char *name;
    char tile[32];
    cn_score plain, half, unfitted, corrected;
} cn_eval_photo;
typedef struct cn_eval {
    cn_eval_photo *photos;
    uint32_t n_photos;
    cn_score plain, half, unfitted, corrected; /* means over the photos that have a score; NaN without any */
    double render_s;                           /* median time to render one photo's view, seconds; NaN without photos */
    /* Where cn_evaluate_tile was given true depths: the median error over the pixels, and the share within 10 cm. */
    double depth_error_m, depth_within;
} cn_eval;
/* Frees the names and the photos (both from malloc) and zeroes the rest. Safe on a zeroed eval. */
CN_API void cn_eval_deinit(cn_eval *eval);

/* ---- temporal consistency of a path ----
 *
 * Each frame is compared with the frame before, which is warped by its own depth. The residual of a pixel is the mean
 * absolute difference of RGB. Pixels that the frame before does not show are left out.
 *
 * A pixel is at a border when a second tile has a share of CN_TEMPORAL_SHARE or more in either frame. When the two
 * frames come from different tiles, every pixel is. All other pixels are away from borders.
 *
 * Most of a pixel's residual is texture that is shifted by a fraction of a pixel. A change of light with the tiles'
 * weights is much smaller, but equal over a whole region. It is measured by blocks of CN_TEMPORAL_BLOCK x
 * CN_TEMPORAL_BLOCK pixels: the residual of light is the mean over RGB of |mean of the signed differences in the
 * block|. A block counts when at least half of its pixels can be compared. It is at a border when most of these are. */
#define CN_TEMPORAL_SHARE 0.05f
enum { CN_TEMPORAL_LEVELS = 16, CN_TEMPORAL_STEPS = 1000, CN_TEMPORAL_BLOCK = 8 };
/* One frame. rgb: height * width * 3, display-encoded. depth: height * width, metres along the ray, 0: none. border:
 * height * width, the second largest share per pixel (cn_compose_finish). camera has the picture's size. All borrowed.
 */
typedef struct cn_temporal_frame {
    uint32_t width, height;
    const float *rgb, *depth, *border;
    const cn_camera *camera;
    const cn_view *view;
} cn_temporal_frame;
/* Sums of residuals: a histogram in steps of a thousandth, and number and sum by texture strength, in levels of a
 * factor of sqrt 2. */
typedef struct cn_temporal_part {
    uint64_t n, count[CN_TEMPORAL_STEPS + 1], level_n[CN_TEMPORAL_LEVELS];
    double sum, level_sum[CN_TEMPORAL_LEVELS];
} cn_temporal_part;
typedef struct cn_temporal {
    cn_temporal_part away, border, light_away, light_border;
} cn_temporal; /* zeroed by the caller before the first frame */
/* Adds a pair of frames of the same size. switched: the two frames come from different tiles. */
CN_API void cn_measure_temporal(cn_temporal *sums, const cn_temporal_frame *before, const cn_temporal_frame *after,
                                bool switched);
/* Means and medians of the residuals; NaN when there are none. ratio: the mean at borders, divided by the mean away
 * from borders at the same texture strength. (Residuals grow with texture, so the two must be compared at the same
 * strength.) 1: borders are not visible. */
typedef struct cn_temporal_figure {
    uint64_t n_border, n_away;
    double border_mean, away_mean, border_median, away_median, ratio;
} cn_temporal_figure;
typedef struct cn_temporal_figures {
    cn_temporal_figure pixels, light;
} cn_temporal_figures;
CN_API cn_temporal_figures cn_measure_temporal_figures(const cn_temporal *sums);

/* ---- seams within a picture ----
 *
 * With ownership a border stays at one place of the scene, so a comparison of frames does not see it. Here two blocks
 * of CN_TEMPORAL_BLOCK x CN_TEMPORAL_BLOCK pixels are compared, in one row or column, at most CN_SEAM_GAP blocks
 * apart. Each block belongs to one tile alone, and the two tiles differ. The pair is a crossing. Its step is the mean
 * over RGB of |difference of the blocks' means|. own_step is the same step in pictures that each of the two tiles
 * renders alone. These have no border, so own_step is the scene's own contrast. */
enum { CN_SEAM_GAP = 4 };
/* rgb: height * width * 3, display-encoded. owner: height * width, the tile of each pixel; UINT32_MAX: none. border:
 * height * width, the second largest share per pixel. alone[i]: as rgb, rendered by tile i alone; NULL when tile i
 * owns no pixel. All borrowed. */
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
} cn_seam; /* sums; zeroed by the caller before the first picture */
CN_API void cn_measure_seam(cn_seam *seam, const cn_seam_frame *frame);
/* Means over n crossings. ratio: step / own_step; 1: the border adds nothing. NaN without crossings. */
typedef struct cn_seam_figures {
    uint64_t n;
    double step, own_step, ratio;
} cn_seam_figures;
CN_API cn_seam_figures cn_measure_seam_figures(const cn_seam *seam);

/* ---- accuracy against time ---- */
/* One setting: seconds of training, median seconds to render a held-out photo, bytes of memory that training takes and
 * of the tile on disk, PSNR in dB by the protocols plain and half (cn_eval_photo), SSIM, PSNR of the training photos at
 * the end of training. Where a truth is known: the median error of depth over all pixels of the held-out photos, and
 * the share of them within 10 cm; else NaN. Times are valid only when nothing else runs on the machine. why: of a type
 * of field whose PSNR is far below the best type's, what it lacks: more steps or a larger field, more photos;
 * else "". */
typedef struct cn_tradeoff_row {
    char name[64];
    double train_s, render_s, bytes, psnr, half_psnr, ssim, disk_bytes, depth_error_m, depth_within, train_psnr;
    char why[192];
} cn_tradeoff_row;
typedef struct cn_tradeoff {
    cn_tradeoff_row *rows;
    uint32_t n;
    /* Each photo of the tile has its own light: rows are compared by half_psnr, and ssim is of that too. In the mean
     * light a photo of dusk says nothing of the field. */
    bool fitted;
} cn_tradeoff;
/* The PSNR that rows are compared by, dB. */
CN_API double cn_tradeoff_db(const cn_tradeoff *tradeoff, const cn_tradeoff_row *row);
CN_API void cn_tradeoff_deinit(cn_tradeoff *tradeoff);

#ifdef __cplusplus
}
#endif
#endif
