/* Finds photos with a wrong pose. COLMAP gives a pose to a photo of which 30 matches agree, and they may be the wrong
 * ones: those of a texture that recurs, or of a reflection. Such a photo has few sparse points. Besides, one of two
 * things tells.
 *
 * Its errors are much larger than those of the other photos. Median error of a photo, as a share of its size, over the
 * median of the photos': 5.2 and 6.0 for two wrong ones, which had 0.16 and 0.07 of the median number of points; at
 * most 2.4 for 521 right ones of 19 sets (experiments.md, "Photos with a wrong pose").
 *
 * Or it stands apart, several times as far from every other photo as any two of these are from each other, and sees its
 * points from another side than they do. A reflection of a hill in a window was taken for the hill: that photo stood
 * 260 units behind it, with small errors, and the others were within 13 units. The angle alone does not tell: a table
 * is matched from opposite sides. */
#include "pose/outlier.h"

#include "math/linalg.h"
#include "pose/lens.h"
#include "pose/scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define FEW 0.25           /* of the median number of points */
#define LARGER 4           /* times the median error ... */
#define LARGE_PX 1.0       /* ... and at least that; not measured apart */
#define APART 5            /* times the extent of the other photos; that one photo has 21 */
#define OTHER_SIDE_COS 0.5 /* 60 degrees between the rays to a point */
enum { ONE_IN = 10, NAMED_AT_MOST = 10 };

/* A pose needs three points, and a few more that confirm it. COLMAP asks for 30 matches that agree, but later steps
 * take points away: photos of a rig that looks all around kept 1, 3 and 4 points, and one stood 600 units away. Right
 * poses of 19 sets have 24 at least (experiments.md, "Photos with a wrong pose"). */
enum { FEWEST = 12 };

/* Focal lengths, as shares of a picture's larger side, between which lenses lie: COLMAP's own limits, which its last
 * adjustment may pass. A photo by a stranger, among four others, had 26 and stood ten times as far away as it should.
 */
#define SHORTEST_FOCAL 0.1
#define LONGEST_FOCAL 10

/* Of each view. first: of its errors in `errors`; n: of its errors; scratch: room to find a median. */
typedef struct measures {
    uint64_t *first;
    uint32_t *n;
    double *errors, *median_px, *scratch;
} measures;

static void measures_deinit(measures *m)
{
    free(m->first);
    free(m->n);
    free(m->errors);
    free(m->median_px);
    free(m->scratch);
}

static bool measure(const cn_scene *scene, measures *m)
{
    const size_t room = scene->n_views + (size_t)2;
    *m = (measures){ .first = calloc(room, sizeof *m->first),
                     .n = calloc(room, sizeof *m->n),
                     .errors = malloc((scene->n_observations + 1) * sizeof *m->errors),
                     .median_px = calloc(room, sizeof *m->median_px),
                     .scratch = calloc(room, sizeof *m->scratch) };
    if (!m->first || !m->n || !m->errors || !m->median_px || !m->scratch) return false;
    for (uint64_t i = 0; i < scene->n_observations; i++)
        m->first[scene->observations[i].view + 1]++;
    for (uint32_t v = 0; v < scene->n_views; v++)
        m->first[v + 1] += m->first[v];
    for (uint32_t p = 0; p < scene->n_points; p++) {
        const cn_point *point = &scene->points[p];
        for (uint32_t i = 0; point->n_observations > 1 && i < point->n_observations; i++) {
            const cn_observation *seen = &scene->observations[(uint64_t)point->first_observation + i];
            double error_px;
            if (!cn_scene_error(scene, point, seen, &error_px)) continue;
            m->errors[m->first[seen->view] + m->n[seen->view]++] = error_px;
        }
    }
    for (uint32_t v = 0; v < scene->n_views; v++)
        if (m->n[v]) m->median_px[v] = cn_select(m->errors + m->first[v], m->n[v], m->n[v] / 2);
    return true;
}

/* Errors of photos of other sizes are compared as shares of them. */
static double size_px(const cn_scene *scene, uint32_t view)
{
    const cn_camera *camera = &scene->cameras[scene->views[view].camera];
    return fmax(camera->width, camera->height);
}

static void unit_ray(const cn_scene *scene, const cn_point *point, uint32_t view, double ray[3])
{
    cn_view_centre(&scene->views[view], ray);
    for (int k = 0; k < 3; k++)
        ray[k] -= point->xyz[k];
    cn_normalize3(ray);
}

/* Whether a view sees most of its points from another side than all other views do. */
static bool is_on_other_side(const cn_scene *scene, uint32_t view)
{
    uint32_t n = 0, n_other = 0;
    for (uint32_t p = 0; p < scene->n_points; p++) {
        const cn_point *point = &scene->points[p];
        const cn_observation *seen = scene->observations + point->first_observation;
        double ray[3], other[3], nearest = -1;
        bool sees = false;
        unit_ray(scene, point, view, ray);
        for (uint32_t i = 0; i < point->n_observations; i++) {
            sees = sees || seen[i].view == view;
            if (seen[i].view == view) continue;
            unit_ray(scene, point, seen[i].view, other);
            nearest = fmax(nearest, cn_dot3(ray, other));
        }
        n += sees && point->n_observations > 1;
        n_other += sees && point->n_observations > 1 && nearest < OTHER_SIDE_COS;
    }
    return 2 * n_other > n;
}

/* Whether a view is much farther from every other one than any two of these are from each other. */
static bool stands_apart(const cn_scene *scene, uint32_t view)
{
    double low[3] = { INFINITY, INFINITY, INFINITY }, high[3] = { -INFINITY, -INFINITY, -INFINITY };
    double centre[3], at[3], nearest = INFINITY;
    cn_view_centre(&scene->views[view], centre);
    for (uint32_t i = 0; i < scene->n_views; i++) {
        if (i == view) continue;
        cn_view_centre(&scene->views[i], at);
        nearest = fmin(nearest, cn_distance3(centre, at));
        for (int k = 0; k < 3; k++) {
            low[k] = fmin(low[k], at[k]);
            high[k] = fmax(high[k], at[k]);
        }
    }
    return nearest > APART * cn_distance3(low, high); /* the box's diagonal is no shorter than their distances */
}

typedef enum wrong { RIGHT, LARGE_ERRORS, FROM_AFAR } wrong;

/* Fills what[] of each view, and counts the wrong ones. */
static uint32_t judge(const cn_scene *scene, measures *m, wrong *what)
{
    const uint32_t n = scene->n_views;
    uint32_t n_wrong = 0;
    for (uint32_t i = 0; i < n; i++)
        m->scratch[i] = m->n[i];
    const double few = FEW * cn_select(m->scratch, n, n / 2);
    for (uint32_t i = 0; i < n; i++)
        m->scratch[i] = m->median_px[i] / size_px(scene, i);
    const double typical = cn_select(m->scratch, n, n / 2);
    for (uint32_t i = 0; i < n; i++) {
        what[i] = RIGHT;
        if (!m->n[i] || m->n[i] >= few) continue;
        if (m->median_px[i] > fmax(LARGE_PX, LARGER * typical * size_px(scene, i)))
            what[i] = LARGE_ERRORS;
        else if (stands_apart(scene, i) && is_on_other_side(scene, i))
            what[i] = FROM_AFAR;
        n_wrong += what[i] != RIGHT;
    }
    return n_wrong;
}

static void say_which(const cn_context *ctx, const cn_view *view, wrong what, uint32_t n, double error_px)
{
    if (what == LARGE_ERRORS)
        cn_log(ctx, CN_LOG_WARN,
               "%s gets no pose: the one that was found has few sparse points (%u) and large errors (%.1f px)",
               view->name, n, error_px);
    else
        cn_log(ctx, CN_LOG_WARN,
               "%s gets no pose: the one that was found has few sparse points (%u), far from all other photos and from "
               "another side",
               view->name, n);
}

cn_status cn_pose_drop_outliers(const cn_context *ctx, cn_scene *scene)
{
    measures m;
    if (scene->n_views < ONE_IN || !scene->n_points) return CN_OK;
    wrong *what = calloc(scene->n_views, sizeof *what);
    bool *keep = malloc(scene->n_views);
    const bool room = measure(scene, &m) && what && keep;
    cn_status status = room ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory looking for photos with a wrong pose");
    const uint32_t n_wrong = room ? judge(scene, &m, what) : 0;
    if (n_wrong && n_wrong <= scene->n_views / ONE_IN) {
        for (uint32_t i = 0, named = 0; i < scene->n_views; i++) {
            keep[i] = what[i] == RIGHT;
            if (!keep[i] && named++ < NAMED_AT_MOST) say_which(ctx, &scene->views[i], what[i], m.n[i], m.median_px[i]);
        }
        status = cn_scene_keep_views(scene, keep);
        if (status == CN_OK) cn_scene_drop_errors(scene, INFINITY); /* and points that fewer than two views see */
    }
    measures_deinit(&m);
    free(what);
    free(keep);
    return status;
}

static double focal_px(const cn_scene *scene, uint32_t view)
{
    const cn_camera *camera = &scene->cameras[scene->views[view].camera];
    const cn_lens_view lens = cn_lens_unpack(camera);
    return lens.equirectangular ? size_px(scene, view) : lens.fx;
}

static bool is_real_lens(const cn_scene *scene, uint32_t view)
{
    const double focal = focal_px(scene, view) / size_px(scene, view);
    return focal >= SHORTEST_FOCAL && focal <= LONGEST_FOCAL;
}

/* keep[i]: whether view i has a real lens, and enough points that another view sees, too, hold it. Returns how many
 * views are to be dropped. */
static uint32_t count_support(const cn_scene *scene, uint32_t *n_points, bool *keep)
{
    uint32_t n_odd = 0;
    memset(n_points, 0, scene->n_views * sizeof *n_points);
    for (uint32_t p = 0; p < scene->n_points; p++) {
        const cn_point *point = &scene->points[p];
        for (uint32_t i = 0; point->n_observations > 1 && i < point->n_observations; i++)
            n_points[scene->observations[(uint64_t)point->first_observation + i].view]++;
    }
    for (uint32_t i = 0; i < scene->n_views; i++) {
        keep[i] = n_points[i] >= FEWEST && is_real_lens(scene, i);
        n_odd += !keep[i];
    }
    return n_odd;
}

static void say_why(const cn_context *ctx, const cn_scene *scene, uint32_t view, uint32_t n_points)
{
    if (is_real_lens(scene, view))
        cn_log(ctx, CN_LOG_WARN, "%s gets no pose: only %u sparse points hold the one that was found",
               scene->views[view].name, n_points);
    else
        cn_log(ctx, CN_LOG_WARN, "%s gets no pose: no lens has the focal length that was found, %.0f px",
               scene->views[view].name, focal_px(scene, view));
}

cn_status cn_pose_drop_unsupported(const cn_context *ctx, cn_scene *scene)
{
    uint32_t *n_points = malloc((scene->n_views + (size_t)1) * sizeof *n_points), n_odd, n_named = 0;
    bool *keep = malloc(scene->n_views + (size_t)1);
    cn_status status =
        n_points && keep ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory looking for photos without points");
    /* Those that go take points along, which others may need. */
    while (status == CN_OK && (n_odd = count_support(scene, n_points, keep)) > 0 && scene->n_views >= n_odd + 2) {
        for (uint32_t i = 0; ctx && i < scene->n_views; i++)
            if (!keep[i] && n_named++ < NAMED_AT_MOST) say_why(ctx, scene, i, n_points[i]);
        status = cn_scene_keep_views(scene, keep);
        if (status == CN_OK) cn_scene_drop_errors(scene, INFINITY);
    }
    free(n_points);
    free(keep);
    return status;
}
