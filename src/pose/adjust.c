#include "pose/adjust.h"

#include "base/units.h"
#include "math/linalg.h"
#include "pose/lens.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Principal points of real lenses lie within about so much of the middle, of the longer side. Photos that all look the
 * same way leave theirs open, and then this holds it. */
#define CENTRE_SIGMA 0.005
#define MOST_MEASURED 100000
#define MEDIAN_OF_RAYLEIGH 1.1774
#define LEAST_TIE_SIGMA_PX 0.1 /* features are no more exact */
#define FEWEST_FOR_A_LENS 200  /* observations of a camera below which its lens stays as it is */
#define MOST_BYTES ((size_t)16 << 30)

/* ---- Places of marked points ---- */

static void to_camera(const cn_view *view, const double xyz[3], double cam[3])
{
    cn_mat3_vec(view->rotation, xyz, cam);
    for (int k = 0; k < 3; k++)
        cam[k] += view->translation[k];
}

/* Solves the symmetric system a x = b by its eigenvectors. False: it is singular. */
static bool solve_symmetric(const double a[9], const double b[3], double x[3])
{
    double values[3], axes[9];
    cn_eigen_symmetric(3, a, values, axes);
    if (!(values[0] > 1e-12 * values[2])) return false;
    memset(x, 0, 3 * sizeof *x);
    for (int j = 0; j < 3; j++) {
        const double along = (axes[j] * b[0] + axes[3 + j] * b[1] + axes[6 + j] * b[2]) / values[j];
        for (int k = 0; k < 3; k++)
            x[k] += along * axes[3 * k + j];
    }
    return true;
}

/* The point nearest to all rays. */
static bool nearest_to_rays(const cn_scene *scene, const cn_point_mark *marks, uint32_t n, cn_triangulation *out)
{
    double a[9] = { 0 }, b[3] = { 0 }, least = 1.0, first[3] = { 0 };
    for (uint32_t i = 0; i < n; i++) {
        const cn_view *view = &scene->views[marks[i].view];
        double dir[3], world[3], centre[3];
        if (cn_camera_unproject(&scene->cameras[view->camera], marks[i].x_px, marks[i].y_px, dir) != CN_OK)
            return false;
        cn_mat3_tvec(view->rotation, dir, world);
        cn_view_centre(view, centre);
        const double along = cn_dot3(world, centre);
        for (int r = 0; r < 3; r++) {
            for (int c = 0; c < 3; c++)
                a[3 * r + c] += (r == c) - world[r] * world[c];
            b[r] += centre[r] - world[r] * along;
        }
        if (i == 0) memcpy(first, world, sizeof first);
        least = fmin(least, cn_dot3(first, world));
    }
    out->angle_deg = cn_degrees(acos(fmax(-1.0, least)));
    return n >= 2 && solve_symmetric(a, b, out->xyz);
}

/* The projection and its derivatives by differences. False: a view does not see the point. */
static bool differentiate(const cn_scene *scene, const cn_point_mark *mark, const double xyz[3], double xy[2],
                          double slope[2][3])
{
    const cn_view *view = &scene->views[mark->view];
    const cn_camera *camera = &scene->cameras[view->camera];
    double cam[3], moved[3], at[2];
    to_camera(view, xyz, cam);
    if (!cn_camera_project(camera, cam, xy)) return false;
    const double step = 1e-6 * cn_norm3(cam);
    for (int k = 0; k < 3; k++) {
        memcpy(moved, xyz, sizeof moved);
        moved[k] += step;
        to_camera(view, moved, cam);
        if (!cn_camera_project(camera, cam, at)) return false;
        cn_camera_offset_px(camera, xy, at, moved);
        for (int j = 0; j < 2; j++)
            slope[j][k] = moved[j] / step;
    }
    return true;
}

/* One step of Gauss and Newton. *error_px: mean error before the step. */
static bool improve(const cn_scene *scene, const cn_point_mark *marks, uint32_t n, double xyz[3], double *error_px)
{
    double a[9] = { 0 }, b[3] = { 0 }, step[3];
    *error_px = 0.0;
    for (uint32_t i = 0; i < n; i++) {
        double xy[2], slope[2][3];
        if (!differentiate(scene, &marks[i], xyz, xy, slope)) return false;
        const cn_camera *camera = &scene->cameras[scene->views[marks[i].view].camera];
        double off[2];
        *error_px += cn_camera_offset_px(camera, xy, (double[2]){ marks[i].x_px, marks[i].y_px }, off) / n;
        for (int j = 0; j < 2; j++)
            for (int r = 0; r < 3; r++) {
                b[r] += slope[j][r] * off[j];
                for (int c = 0; c < 3; c++)
                    a[3 * r + c] += slope[j][r] * slope[j][c];
            }
    }
    if (!solve_symmetric(a, b, step)) return false;
    for (int k = 0; k < 3; k++)
        xyz[k] += step[k];
    return true;
}

bool cn_scene_triangulate(const cn_scene *scene, const cn_point_mark *marks, uint32_t n, cn_triangulation *out)
{
    enum { STEPS = 10 };
    double xyz[3], error_px;
    *out = (cn_triangulation){ 0 };
    if (!nearest_to_rays(scene, marks, n, out)) return false;
    memcpy(xyz, out->xyz, sizeof xyz);
    if (!improve(scene, marks, n, xyz, &out->error_px)) return false;
    for (int i = 0; i < STEPS; i++) {
        double next[3];
        memcpy(next, xyz, sizeof next);
        /* A step that does not help ends it: of two nearly parallel rays the place wanders. */
        if (!improve(scene, marks, n, next, &error_px) || !(error_px <= out->error_px)) return true;
        memcpy(out->xyz, xyz, sizeof xyz);
        out->error_px = error_px;
        memcpy(xyz, next, sizeof xyz);
    }
    return true;
}

/* ---- Adjustment ---- */

static void lens_to(const cn_camera *camera, const cn_scene_adjustment *how, bool held, cn_adjust_camera *out)
{
    const bool one_focal = camera->lens == CN_LENS_SIMPLE_PINHOLE || camera->lens == CN_LENS_SIMPLE_RADIAL ||
                           camera->lens == CN_LENS_RADIAL;
    const uint32_t focal = one_focal ? 1u : 3u, centre = one_focal ? 1u : 2u;
    *out = (cn_adjust_camera){ .lens = (int)camera->lens, .fixed = how->keep_focal ? focal : 0u };
    out->sigma[centre] = out->sigma[centre + 1] = CENTRE_SIGMA * fmax(camera->width, camera->height);
    if (how->keep_centre) out->fixed |= 3u << centre;
    if (held) out->fixed = CN_ADJUST_ALL_FIXED;
    memcpy(out->params, camera->params, sizeof out->params);
}

/* Marks the cameras whose lens stays as it is. */
static cn_status choose_held(const cn_scene *scene, const cn_scene_adjustment *how, bool *held)
{
    uint64_t *n_seen = calloc(scene->n_cameras + (size_t)1, sizeof *n_seen);
    if (!n_seen) return cn_fail(CN_ERR_NOMEM, "out of memory adjusting %u photos", scene->n_views);
    for (uint64_t i = 0; i < scene->n_observations; i++)
        n_seen[scene->views[scene->observations[i].view].camera]++;
    for (uint32_t i = 0; i < scene->n_cameras; i++)
        held[i] =
            how->keep_lenses || n_seen[i] < FEWEST_FOR_A_LENS || scene->cameras[i].lens == CN_LENS_EQUIRECTANGULAR;
    free(n_seen);
    return CN_OK;
}

static void put_prior(const cn_place_prior *prior, double place[3], double sigma[3])
{
    memcpy(place, prior->place, sizeof prior->place);
    memcpy(sigma, prior->sigma, sizeof prior->sigma);
}

static void fill_blocks(const cn_scene *scene, const cn_scene_adjustment *how, const bool *held, cn_adjust_problem *p)
{
    for (uint32_t i = 0; i < scene->n_cameras; i++)
        lens_to(&scene->cameras[i], how, held[i], &p->cameras[i]);
    for (uint32_t i = 0; i < scene->n_views; i++) {
        const cn_view *view = &scene->views[i];
        cn_adjust_pose *pose = &p->poses[i];
        *pose = (cn_adjust_pose){ .camera = view->camera, .fixed = how->fixed && how->fixed[i] };
        memcpy(pose->rotation, view->rotation, sizeof pose->rotation);
        memcpy(pose->translation, view->translation, sizeof pose->translation);
        if (how->centres) put_prior(&how->centres[i], pose->place, pose->place_sigma);
    }
    for (uint32_t i = 0; i < scene->n_points; i++) {
        p->points[i] = (cn_adjust_point){ 0 };
        memcpy(p->points[i].xyz, scene->points[i].xyz, sizeof p->points[i].xyz);
    }
    for (uint32_t i = 0; i < how->n_points; i++) {
        cn_adjust_point *point = &p->points[scene->n_points + i];
        *point = (cn_adjust_point){ 0 };
        memcpy(point->xyz, how->points[i].xyz, sizeof point->xyz);
        put_prior(&how->points[i].prior, point->place, point->place_sigma);
    }
}

static void fill_observations(const cn_scene *scene, const cn_scene_adjustment *how, double tie_sigma_px,
                              cn_adjust_observation *out)
{
    for (uint32_t i = 0; i < scene->n_points; i++)
        for (uint32_t k = 0; k < scene->points[i].n_observations; k++) {
            const cn_observation *o = &scene->observations[(uint64_t)scene->points[i].first_observation + k];
            *out++ = (cn_adjust_observation){ o->view, i, o->x_px, o->y_px, (float)tie_sigma_px };
        }
    for (uint32_t i = 0; i < how->n_marks; i++) {
        const cn_point_mark *m = &how->marks[i];
        *out++ = (cn_adjust_observation){ m->view, scene->n_points + m->point, (float)m->x_px, (float)m->y_px,
                                          (float)how->mark_sigma_px };
    }
}

/* How exact tie points are: of photos of good cameras 0.3 px, of old or moving ones 1 px. What they say counts against
 * marks and GPS by this. The median error over that of two normal errors of 1; gross errors do not move it. */
static cn_status measure_ties(const cn_scene *scene, double *sigma_px)
{
    const uint64_t stride = scene->n_observations / MOST_MEASURED + 1;
    double *errors = malloc((scene->n_observations / stride + 2) * sizeof *errors);
    uint64_t at = 0, n = 0;
    if (!errors) return cn_fail(CN_ERR_NOMEM, "out of memory adjusting %u photos", scene->n_views);
    for (uint32_t i = 0; i < scene->n_points; i++)
        for (uint32_t k = 0; k < scene->points[i].n_observations; k++, at++) {
            const cn_observation *o = &scene->observations[(uint64_t)scene->points[i].first_observation + k];
            const cn_view *view = &scene->views[o->view];
            const cn_camera *camera = &scene->cameras[view->camera];
            double cam[3], xy[2], off[2];
            to_camera(view, scene->points[i].xyz, cam);
            if (at % stride || !cn_camera_project(camera, cam, xy)) continue;
            errors[n++] = cn_camera_offset_px(camera, (double[2]){ o->x_px, o->y_px }, xy, off);
        }
    const double median = n ? cn_select(errors, n, n / 2) : 0.0;
    *sigma_px = n ? fmax(median / MEDIAN_OF_RAYLEIGH, LEAST_TIE_SIGMA_PX) : 1.0;
    free(errors);
    return CN_OK;
}

static void take_back(cn_scene *scene, cn_scene_adjustment *how, const cn_adjust_problem *p)
{
    for (uint32_t i = 0; i < scene->n_cameras; i++)
        memcpy(scene->cameras[i].params, p->cameras[i].params, sizeof scene->cameras[i].params);
    for (uint32_t i = 0; i < scene->n_views; i++) {
        memcpy(scene->views[i].rotation, p->poses[i].rotation, sizeof scene->views[i].rotation);
        memcpy(scene->views[i].translation, p->poses[i].translation, sizeof scene->views[i].translation);
    }
    for (uint32_t i = 0; i < scene->n_points; i++)
        memcpy(scene->points[i].xyz, p->points[i].xyz, sizeof scene->points[i].xyz);
    for (uint32_t i = 0; i < how->n_points; i++)
        memcpy(how->points[i].xyz, p->points[scene->n_points + i].xyz, sizeof how->points[i].xyz);
}

static const char *photo_of(const cn_scene *scene, uint32_t camera)
{
    for (uint32_t i = 0; i < scene->n_views; i++)
        if (scene->views[i].camera == camera && scene->views[i].name) return scene->views[i].name;
    return "no photo";
}

/* A lens that the adjustment bent beyond what lenses do must not be used. It is held as it was, for one camera must not
 * cost the poses of all. True: there was one, and the adjustment has to be done again. */
static bool hold_bent(const cn_context *ctx, const cn_scene *scene, const cn_adjust_problem *p, bool *held)
{
    bool found = false;
    for (uint32_t i = 0; i < scene->n_cameras; i++) {
        cn_camera camera = scene->cameras[i];
        memcpy(camera.params, p->cameras[i].params, sizeof camera.params);
        if (held[i] || (cn_camera_check(&camera, "adjustment") == CN_OK &&
                        cn_camera_check_inverse(&camera, "adjustment", "a camera") == CN_OK))
            continue;
        held[i] = found = true;
        cn_log(ctx, CN_LOG_INFO,
               "the adjustment bends the lens of camera %u (of %s) beyond what lenses do: it stays as it was",
               camera.id, photo_of(scene, i));
    }
    return found;
}

cn_status cn_scene_adjust(const cn_context *ctx, cn_scene *scene, cn_scene_adjustment *how, cn_adjust_result *result)
{
    const size_t n_points = (size_t)scene->n_points + how->n_points;
    const size_t n_seen = scene->n_observations + how->n_marks;
    cn_adjust_observation *seen = malloc((n_seen + 1) * sizeof *seen);
    bool *held = calloc(scene->n_cameras + (size_t)1, sizeof *held);
    cn_adjust_problem p = { .cameras = malloc((scene->n_cameras + (size_t)1) * sizeof *p.cameras),
                            .poses = malloc((scene->n_views + (size_t)1) * sizeof *p.poses),
                            .points = malloc((n_points + 1) * sizeof *p.points),
                            .observations = seen,
                            .n_cameras = scene->n_cameras,
                            .n_poses = scene->n_views,
                            .n_points = (uint32_t)n_points,
                            .n_observations = n_seen };
    cn_status status = CN_OK;
    if (!seen || !held || !p.cameras || !p.poses || !p.points || n_points > UINT32_MAX)
        status = cn_fail(CN_ERR_NOMEM, "out of memory adjusting %u photos", scene->n_views);
    double tie_sigma_px = 1.0;
    if (status == CN_OK) status = measure_ties(scene, &tie_sigma_px);
    if (status == CN_OK) status = choose_held(scene, how, held);
    if (status == CN_OK) {
        cn_adjust_options options = how->options;
        if (!options.max_bytes) options.max_bytes = MOST_BYTES;
        fill_observations(scene, how, tie_sigma_px, seen);
        do {
            fill_blocks(scene, how, held, &p);
            status = cn_ceres_adjust(ctx, &p, &options, result);
        } while (status == CN_OK && hold_bent(ctx, scene, &p, held));
    }
    if (status == CN_OK) take_back(scene, how, &p);
    free(p.cameras);
    free(p.poses);
    free(p.points);
    free(seen);
    free(held);
    return status;
}
