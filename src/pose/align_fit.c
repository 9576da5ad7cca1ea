/* GPS tells place, scale and north. It tells up as well, by the heights of the cameras; but the cameras tell up too,
 * and mostly better: GPS heights are off by metres, drift while a receiver warms up, and turn the scene. */
#include "pose/align_fit.h"

#include "math/linalg.h"
#include "pose/align_up.h"
#include "pose/scene.h"
#include "pose/similarity.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define ONE_PLACE_M 0.2      /* GPS positions spread less than this are one place */
#define LINE_SHARE 0.02      /* second axis over first under which a track counts as a line */
#define LINE_NOISE 2.0       /* ... or second axis over residual: below this, GPS noise would decide the rotation */
#define VERTICAL_WEIGHT 0.33 /* GPS heights are two to three times worse than positions */
#define ALIKE 4.0            /* GPS errors of photos taken in a row are alike: so many count as one. Not measured */
#define SEED 1
/* Poses are in doubt where a smaller share of the photos agrees with GPS: lund's import, which breaks in mid-street,
 * has 0.48; lund posed well has 0.72; castle, brighton and herz-jesus have 1. With few photos, bad GPS alone decides.
 */
#define DOUBTFUL_SHARE 0.6
#define FEWEST_TO_DOUBT 8
#define CLEAR_SHARE 0.1

bool cn_align_is_doubtful(uint32_t n_gps, uint32_t n_inliers)
{
    return n_gps >= FEWEST_TO_DOUBT && n_inliers < DOUBTFUL_SHARE * n_gps;
}

bool cn_align_is_clearly_better(uint32_t n_gps, uint32_t n_before, uint32_t n_inliers)
{
    return n_inliers > n_before && n_inliers - n_before >= CLEAR_SHARE * n_gps;
}

static cn_similarity_task task_of(const cn_gps_pairs *p, double max_error_m, double vertical_weight)
{
    return (cn_similarity_task){ .n = p->n,
                                 .source = (const double(*)[3])p->source,
                                 .target = (const double(*)[3])p->target,
                                 .max_error_m = max_error_m,
                                 .vertical_weight = vertical_weight,
                                 .seed = SEED,
                                 .has_height = vertical_weight > 0 ? p->known : NULL };
}

static uint32_t mark_heights(const cn_gps_pairs *p)
{
    for (uint32_t i = 0; i < p->n; i++)
        p->with_height[i] = p->inlier[i] && p->known[i];
    return cn_similarity_count(p->with_height, p->n);
}

static void residuals(const cn_gps_pairs *p, const cn_similarity *s, cn_frame *frame)
{
    double horizontal = 0.0, vertical = 0.0;
    const uint32_t n = cn_similarity_count(p->inlier, p->n), n_heights = mark_heights(p);
    for (uint32_t i = 0; i < p->n; i++) {
        double at[3];
        if (!p->inlier[i]) continue;
        cn_similarity_apply(s, p->source[i], at);
        double dx = at[0] - p->target[i][0], dy = at[1] - p->target[i][1], dz = at[2] - p->target[i][2];
        horizontal += dx * dx + dy * dy;
        vertical += p->with_height[i] ? dz * dz : 0;
    }
    frame->residual_horizontal_m = sqrt(horizontal / n);
    frame->residual_vertical_m = n_heights ? sqrt(vertical / n_heights) : 0;
}

static cn_status fit_line(const cn_context *ctx, const cn_scene *scene, const cn_similarity_task *task,
                          cn_similarity *out, bool *inlier)
{
    double up[3];
    if (!cn_align_up(scene, CN_SIDE_TOP, up))
        return cn_fail(CN_ERR_DATA, "all cameras are on a line, and their up directions do not agree");
    CN_TRY(cn_similarity_fit_line(task, up, out, inlier));
    cn_log(ctx, CN_LOG_INFO, "all cameras are on a line: the rotation about it is taken from their up directions");
    return CN_OK;
}

/* A fit to GPS. tilt: how far its up may be off, in radians. */
typedef struct gps_fit {
    cn_similarity *similarity;
    double tilt;
} gps_fit;

/* By GPS alone. Cameras spread over a plane can be fitted directly. Cameras on a line, up to GPS noise, need the
 * cameras' up direction. */
static cn_status fit_gps(const cn_context *ctx, const cn_scene *scene, cn_gps_pairs *p, double max_error_m,
                         cn_frame *frame, gps_fit *out)
{
    const cn_similarity_task task = task_of(p, max_error_m, VERTICAL_WEIGHT);
    cn_similarity *s = out->similarity;
    double source[3], target[3], up[3];
    /* Those without altitude do not tell the turn about a line. */
    cn_spread(p->n, task.source, p->known, source, NULL);
    cn_spread(p->n, task.target, NULL, target, NULL);
    if (!(target[2] > ONE_PLACE_M) || !(source[2] > 0.0))
        return cn_fail(CN_ERR_DATA, "all photos were taken at one place");
    bool line = source[1] < LINE_SHARE * source[2];
    if (line)
        CN_TRY(fit_line(ctx, scene, &task, s, p->inlier));
    else
        CN_TRY(cn_pose_fit_similarity(&task, s, p->inlier));
    residuals(p, s, frame);
    cn_spread(p->n, task.source, p->with_height, source, NULL);
    double noise = hypot(frame->residual_horizontal_m, frame->residual_vertical_m);
    if (!line && s->scale * source[1] < LINE_NOISE * noise && cn_align_up(scene, CN_SIDE_TOP, up)) {
        CN_TRY(fit_line(ctx, scene, &task, s, p->inlier));
        residuals(p, s, frame);
        line = true;
    }
    /* Three numbers of the fit, a height and two tilts, take up as much of the heights' errors. */
    const double n = mark_heights(p), lever = s->scale * source[line ? 2 : 1];
    out->tilt = p->has_height && n > 3 && lever > 0
                    ? frame->residual_vertical_m * sqrt(n / (n - 3)) / (lever * sqrt(fmax(n / ALIKE, 1)))
                    : INFINITY;
    return CN_OK;
}

/* Moves s up or down to where half of the heights that count are above it. */
static cn_status centre_heights(const cn_gps_pairs *p, const bool *inlier, cn_similarity *s)
{
    double *above = malloc(sizeof *above * p->n);
    uint32_t n = 0;
    if (!above) return cn_fail(CN_ERR_NOMEM, "out of memory aligning %u photos", p->n);
    for (uint32_t i = 0; i < p->n; i++) {
        double at[3];
        if (!inlier[i] || !p->known[i]) continue;
        cn_similarity_apply(s, p->source[i], at);
        above[n++] = p->target[i][2] - at[2];
    }
    if (n) s->translation[2] += cn_select(above, n, n / 2);
    free(above);
    return CN_OK;
}

static void take(cn_gps_pairs *p, const cn_similarity *fitted, const bool *inlier, double within_m, cn_frame *frame,
                 cn_similarity *s)
{
    *s = *fitted;
    memcpy(p->inlier, inlier, p->n * sizeof *inlier);
    p->level = true;
    p->within_m = within_m;
    residuals(p, s, frame);
}

/* Up by the cameras, where they tell it better than GPS heights and as many photos agree. */
static cn_status fit_upright(cn_gps_pairs *p, const double up[3], double max_error_m, bool *inlier, cn_frame *frame,
                             cn_similarity *s)
{
    const cn_similarity_task task = task_of(p, max_error_m, p->has_height ? VERTICAL_WEIGHT : 0);
    cn_similarity fitted;
    if (cn_similarity_fit_upright(&task, up, &fitted, inlier) != CN_OK) return CN_OK;
    const uint32_t n = cn_similarity_count(inlier, p->n);
    if (cn_align_is_doubtful(p->n, n) || cn_align_is_clearly_better(p->n, n, frame->n_inliers)) return CN_OK;
    if (!p->has_height) CN_TRY(centre_heights(p, inlier, &fitted));
    take(p, &fitted, inlier, max_error_m, frame, s);
    frame->n_inliers = n;
    return CN_OK;
}

/* Where few photos agree with GPS, those that do may be the ones whose errors happen to fit a turned scene. 74 photos
 * of a flight whose GPS heights rose by 110 m, places off by 10 m, had up wrong by 46 degrees, and 9 agreed. So up is
 * that of the cameras, heights count by their median only, and errors may be larger, until most photos agree. */
static cn_status fit_in_doubt(cn_gps_pairs *p, const double up[3], double max_error_m, bool *inlier, cn_frame *frame,
                              cn_similarity *s)
{
    double target[3];
    cn_spread(p->n, (const double(*)[3])p->target, NULL, target, NULL);
    for (double within_m = max_error_m;; within_m *= 2) {
        const cn_similarity_task task = task_of(p, within_m, 0);
        cn_similarity fitted;
        if (cn_similarity_fit_upright(&task, up, &fitted, inlier) != CN_OK) return CN_OK;
        if (cn_align_is_doubtful(p->n, cn_similarity_count(inlier, p->n)) && within_m < target[2]) continue;
        CN_TRY(centre_heights(p, inlier, &fitted));
        take(p, &fitted, inlier, within_m, frame, s);
        p->by_median = true;
        return CN_OK;
    }
}

/* Whether the cameras tell up better than GPS. Heights that drift steadily tilt the scene and leave no
 * residual, so GPS is also wrong where it is farther from what cameras tell than both errors explain. */
static bool cameras_tell(const gps_fit *fit, const double up[3], const cn_up_error *cameras)
{
    const double apart = acos(fmin(fmax(cn_dot3(fit->similarity->rotation + 6, up), -1), 1));
    return cameras->error < fit->tilt || apart > hypot(cameras->surely, 3 * fit->tilt);
}

cn_status cn_align_fit(const cn_context *ctx, const cn_scene *scene, cn_gps_pairs *p, double max_error_m,
                       cn_frame *frame, cn_similarity *s)
{
    double up[3];
    cn_up_error cameras;
    gps_fit by_gps = { s, 0 };
    CN_TRY(fit_gps(ctx, scene, p, max_error_m, frame, &by_gps));
    p->level = p->by_median = false;
    p->within_m = max_error_m;
    frame->n_inliers = cn_similarity_count(p->inlier, p->n);
    const bool doubtful = cn_align_is_doubtful(p->n, frame->n_inliers);
    if (!doubtful && !(cn_align_up_clear(scene, up, &cameras) && cameras_tell(&by_gps, up, &cameras))) return CN_OK;
    if (doubtful && !cn_align_up(scene, CN_SIDE_TOP, up)) return CN_OK;
    bool *inlier = calloc(p->n, sizeof *inlier);
    if (!inlier) return cn_fail(CN_ERR_NOMEM, "out of memory aligning %u photos", p->n);
    const cn_status status = (doubtful ? fit_in_doubt : fit_upright)(p, up, max_error_m, inlier, frame, s);
    free(inlier);
    return status;
}
