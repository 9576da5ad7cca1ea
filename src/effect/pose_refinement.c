/* Pose refinement. Each photo's camera may turn a little and move a little (SE(3), to first order). All cameras of
 * one capture run may also do so together, where photo times show more than one run. The given pose pulls the camera
 * back; this pull weakens by 10^4 over the schedule (after Tancik et al., "Block-NeRF", CVPR 2022, section 4.1).
 *
 * Turns and moves keep zero mean over the photos. Moves also have no linear trend in the cameras' places: photos can
 * hardly tell a scene that is stretched or sheared together with its cameras from one that is not, so the scene
 * would drift. Two settings of the trainer serve the same purpose (sampler.c). It uses sparse points for a shorter
 * time, because their distances are those of the given poses. And it marches in shorter steps, because long steps
 * find a surface too late, the later the farther away, which makes high cameras rise.
 *
 * Evidence: mean reprojection error of the tile's sparse points, in pixels at the working width. */
#include "effect/effect.h"
#include "effect/pose.h"
#include "effect/runs.h"
#include "math/linalg.h"

#include <math.h>

/* A photo's parameters: turn (radians, world axes) and move (in MOVEs of the tile's mean half extent), then the same
 * two of its run. MOVE is a fifth because a photo mostly shows things at about that distance: a step of either
 * parameter then shifts the picture about equally. Not measured apart. */
enum { POSE = 6, PARAMS = 2 * POSE };
#define MOVE 0.2f
/* The part of a parameter that a step removes. Tuned on the synthetic city with wrong poses: a stronger pull left half
 * of the error. */
#define MAX_PULL 0.005f
#define FEWEST_FOR_TREND 12 /* with fewer photos, a trend would remove too much of what they learn */
/* A direction has no trend when the variance of the cameras' places along it is less than this part of the largest
 * one. Not measured apart. */
#define FLAT 1e-6

static void constants_of(const cn_photo *photo, cn_effect_settings told, float *row)
{
    (void)told;
    row[0] = cn_run_time(photo);
}

static void centre(float *rows, uint32_t n, uint32_t n_trained)
{
    if (cn_runs_find_trained(rows, 1, n, n_trained) > 1) return;
    for (uint32_t i = 0; i < n; i++) /* the photos' own poses say all about a single run */
        rows[i] = 0;
}

static void ray(const cn_effect_rays *rays, const cn_effect_data *data, float (*origin)[3], float (*dir)[3])
{
    for (uint32_t i = 0; i < rays->n; i++) {
        const float *p = data->photo + (size_t)rays->photo[i] * PARAMS, *d = rays->dir + 3 * (size_t)i;
        float w[POSE];
        for (int c = 0; c < POSE; c++)
            w[c] = p[c] + (data->constants[rays->photo[i]] > 0 ? p[POSE + c] : 0);
        dir[i][0] += w[1] * d[2] - w[2] * d[1];
        dir[i][1] += w[2] * d[0] - w[0] * d[2];
        dir[i][2] += w[0] * d[1] - w[1] * d[0];
        for (int c = 0; c < 3; c++)
            origin[i][c] += MOVE * w[3 + c];
    }
}

static void ray_backward(const cn_effect_rays *rays, const cn_effect_data *data, float (*d_origin)[3],
                         float (*d_dir)[3], const cn_effect_grad *grad)
{
    for (uint32_t i = 0; i < rays->n; i++) {
        const float *d = rays->dir + 3 * (size_t)i, *g = d_dir[i];
        const float turn[3] = { d[1] * g[2] - d[2] * g[1], d[2] * g[0] - d[0] * g[2], d[0] * g[1] - d[1] * g[0] };
        float *out = grad->photo + (size_t)rays->photo[i] * PARAMS;
        const bool has_run = data->constants[rays->photo[i]] > 0;
        for (int c = 0; c < 3; c++) {
            out[c] += turn[c];
            out[3 + c] += MOVE * d_origin[i][c];
            if (!has_run) continue;
            out[POSE + c] += turn[c];
            out[POSE + 3 + c] += MOVE * d_origin[i][c];
        }
    }
}

void cn_pose_trends(uint32_t n, const float (*place)[3], float (*trend)[3])
{
    double mean[3] = { 0 }, spread[9] = { 0 }, variance[3], axes[9];
    for (uint32_t i = 0; i < n; i++)
        for (int a = 0; a < 3; a++)
            mean[a] += (double)place[i][a] / n;
    for (uint32_t i = 0; i < n; i++)
        for (int a = 0; a < 9; a++)
            spread[a] += ((double)place[i][a / 3] - mean[a / 3]) * ((double)place[i][a % 3] - mean[a % 3]);
    cn_eigen_symmetric(3, spread, variance, axes);
    for (uint32_t i = 0; i < n; i++) {
        double along[3] = { 0 };
        for (int k = 0; k < 3; k++)
            for (int a = 0; a < 3; a++)
                along[k] += axes[3 * a + k] * ((double)place[i][a] - mean[a]);
        for (int k = 0; k < 3; k++)
            trend[i][k] =
                n >= FEWEST_FOR_TREND && variance[k] > FLAT * variance[2] ? (float)(along[k] / sqrt(variance[k])) : 0;
    }
}

/* Removes from the moves, which have zero mean, the part that is linear in the cameras' places. */
static void detrend(uint32_t n, const float (*trend)[3], float *rows)
{
    for (int k = 0; k < 3; k++) {
        double slope[3] = { 0 };
        for (int pass = 0; pass < 2; pass++)
            for (uint32_t i = 0; i < n; i++) {
                float *move = rows + (size_t)i * PARAMS + 3;
                for (int c = 0; c < 3; c++) {
                    if (pass == 0)
                        slope[c] += (double)trend[i][k] * (double)move[c];
                    else
                        move[c] -= (float)(slope[c] * (double)trend[i][k]);
                }
            }
    }
}

float cn_pose_keep(double progress)
{
    return 1 - MAX_PULL * (float)pow(10, -4 * progress);
}

static void project(const cn_effect_photos *photos, float *rows, double progress)
{
    const uint32_t n = photos->n;
    const float keep = cn_pose_keep(progress);
    for (size_t i = 0; i < (size_t)n * PARAMS; i++)
        rows[i] *= keep;
    /* The rows of all photos of a run hold a copy of its parameters. This makes the copies equal. */
    cn_runs_draw(photos->constants, n, rows + POSE, PARAMS, POSE, 1);
    cn_effect_zero_mean(n, PARAMS, rows);
    detrend(n, photos->trend, rows);
}

static double evidence(const cn_plan_input *input, const cn_plan_tile *tile)
{
    const cn_scene *scene = input->scene;
    if (scene->n_points < 50 || !tile->n_photos || !input->pixels) return NAN;
    double sum = 0, n = 0;
    for (uint32_t i = 0; i < scene->n_points; i++) {
        const cn_point *p = &scene->points[i];
        bool inside = isfinite(p->error_px) && p->n_observations > 0;
        for (int a = 0; a < 3; a++)
            inside = inside && p->xyz[a] >= tile->bounds_min[a] && p->xyz[a] <= tile->bounds_max[a];
        if (!inside) continue;
        const cn_view *view = &scene->views[scene->observations[p->first_observation].view];
        const cn_pixel_extent size = cn_pixel_store_extent(input->pixels, view->photo);
        sum += (double)p->error_px * size.width / scene->cameras[view->camera].width;
        n++;
    }
    return n >= 50 ? sum / n : NAN;
}

extern const cn_effect cn_effect_pose_refinement;
const cn_effect cn_effect_pose_refinement = {
    .name = "pose_refinement",
    .summary = "photos' poses are corrected while the tile is trained",
    .threshold = 0.8,
    .unprobed = true,
    .time_share = 0.3f,
    .training_only = true,
    .rate = 0.01f, /* short steps: a photo has about a dozen rays a step, so its gradient is mostly noise */
    .start = 0.05f,
    .evidence = evidence,
    .photo_constants = 1,
    .photo_params = PARAMS,
    .constants = constants_of,
    .centre = centre,
    .project = project,
    .ray = ray,
    .ray_backward = ray_backward,
};
