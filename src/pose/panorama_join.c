/* Poses of views of rigs become poses of their photos. */
#include "base/units.h"
#include "math/linalg.h"
#include "pose/adjust.h"
#include "pose/lens.h"
#include "pose/panorama.h"
#include "pose/scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define AGREE_DEG 2.0 /* views of one photo agree when the poses that they give it differ by less */
/* and by this part of the distance to the nearest other photo. COLMAP's poses of single views are good to some
 * hundredths of it. */
#define AGREE_SHARE 0.2
#define MOST_ERROR_PX 4.0 /* as COLMAP's filter; of the photo */

/* The pose that a view gives its photo. */
typedef struct candidate {
    uint32_t photo, view; /* view: of the pieces */
    uint32_t n_seen;      /* observations */
    double rotation[9], centre[3];
    bool agrees;
} candidate;

typedef struct joining {
    const cn_panorama_cut *cut;
    const cn_photo_index *index;
    const cn_scene *pieces;
    bool keep_focal;
    candidate *candidates; /* sorted by photo */
    uint32_t n_candidates;
    uint32_t *target; /* of each view of the pieces: view of the scene; UINT32_MAX: left out */
    cn_scene *out;
} joining;

static int by_photo(const void *a, const void *b)
{
    const candidate *x = a, *y = b;
    if (x->photo != y->photo) return x->photo < y->photo ? -1 : 1;
    return (x->view > y->view) - (x->view < y->view);
}

static void list_candidates(joining *j)
{
    for (uint32_t i = 0; i < j->pieces->n_views; i++) {
        const cn_view *view = &j->pieces->views[i];
        double turn[9], back[9];
        if (view->photo == UINT32_MAX || j->cut->view[view->photo] == CN_PANORAMA_WHOLE) continue;
        candidate *c = &j->candidates[j->n_candidates++];
        *c = (candidate){ .photo = j->cut->photo[view->photo], .view = i };
        cn_panorama_view_rotation(j->cut->view[view->photo], turn);
        cn_mat3_transpose(turn, back);
        cn_mat3_mul(back, view->rotation, c->rotation);
        cn_view_centre(view, c->centre);
    }
    uint32_t *count = j->target; /* room for every view; it is filled later */
    memset(count, 0, j->pieces->n_views * sizeof *count);
    for (uint64_t i = 0; i < j->pieces->n_observations; i++)
        count[j->pieces->observations[i].view]++;
    for (uint32_t i = 0; i < j->n_candidates; i++)
        j->candidates[i].n_seen = count[j->candidates[i].view];
    qsort(j->candidates, j->n_candidates, sizeof *j->candidates, by_photo);
}

static double turned_deg(const double a[9], const double b[9])
{
    double trace = 0.0;
    for (int k = 0; k < 9; k++)
        trace += a[k] * b[k];
    return cn_degrees(acos(fmin(fmax(0.5 * (trace - 1.0), -1.0), 1.0)));
}

/* Median over the candidates of the distance to the nearest one of another photo; INFINITY when there is one photo. */
static cn_status spacing(const joining *j, double *out)
{
    double *nearest = malloc((j->n_candidates + (size_t)1) * sizeof *nearest);
    if (!nearest) return cn_fail(CN_ERR_NOMEM, "out of memory joining views");
    for (uint32_t a = 0; a < j->n_candidates; a++) {
        nearest[a] = INFINITY;
        for (uint32_t b = 0; b < j->n_candidates; b++)
            if (j->candidates[a].photo != j->candidates[b].photo)
                nearest[a] = fmin(nearest[a], cn_distance3(j->candidates[a].centre, j->candidates[b].centre));
    }
    *out = j->n_candidates ? cn_select(nearest, j->n_candidates, j->n_candidates / 2) : INFINITY;
    free(nearest);
    return CN_OK;
}

/* Marks the candidates [first, last) that agree with the one with which most of them do, counted by what they see. */
static void vote(joining *j, uint32_t first, uint32_t last, double within)
{
    uint64_t most = 0;
    uint32_t best = first;
    for (uint32_t a = first; a < last; a++) {
        uint64_t votes = 0;
        for (uint32_t b = first; b < last; b++)
            if (turned_deg(j->candidates[a].rotation, j->candidates[b].rotation) <= AGREE_DEG &&
                cn_distance3(j->candidates[a].centre, j->candidates[b].centre) <= within)
                votes += (uint64_t)j->candidates[b].n_seen + 1;
        if (votes > most) best = a;
        if (votes > most) most = votes;
    }
    for (uint32_t b = first; b < last; b++)
        j->candidates[b].agrees = turned_deg(j->candidates[best].rotation, j->candidates[b].rotation) <= AGREE_DEG &&
                                  cn_distance3(j->candidates[best].centre, j->candidates[b].centre) <= within;
}

/* The mean of those that agree, weighted by what they see. */
static void average(const joining *j, uint32_t first, uint32_t last, cn_view *view)
{
    double sum[4] = { 0 }, centre[3] = { 0 }, total = 0.0, reference[4] = { 0 }, moved[3];
    for (uint32_t i = first; i < last; i++) {
        const candidate *c = &j->candidates[i];
        double q[4], dot = 0.0;
        if (!c->agrees) continue;
        const double weight = c->n_seen + 1.0;
        cn_mat3_to_quat(c->rotation, q);
        if (total == 0.0) memcpy(reference, q, sizeof q);
        for (int k = 0; k < 4; k++)
            dot += q[k] * reference[k];
        for (int k = 0; k < 4; k++)
            sum[k] += (dot < 0.0 ? -weight : weight) * q[k];
        for (int k = 0; k < 3; k++)
            centre[k] += weight * c->centre[k];
        total += weight;
    }
    cn_quat_to_mat3(sum, view->rotation);
    for (int k = 0; k < 3; k++)
        centre[k] /= total;
    cn_mat3_vec(view->rotation, centre, moved);
    for (int k = 0; k < 3; k++)
        view->translation[k] = -moved[k];
}

static cn_status add_view(joining *j, const cn_view *pose, uint32_t photo, const cn_camera *camera)
{
    cn_scene *out = j->out;
    const cn_photo *p = &j->index->photos[photo];
    uint32_t c = 0;
    while (c < out->n_cameras && (out->cameras[c].lens != camera->lens || out->cameras[c].width != camera->width ||
                                  out->cameras[c].height != camera->height ||
                                  memcmp(out->cameras[c].params, camera->params, sizeof camera->params) != 0))
        c++;
    if (c == out->n_cameras) {
        out->cameras[out->n_cameras++] = *camera;
        out->cameras[c].id = c + 1;
    }
    cn_view *view = &out->views[out->n_views++];
    *view = *pose;
    view->name = strdup(p->name);
    view->photo = photo;
    view->camera = c;
    return view->name ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory joining views");
}

static cn_status join_poses(joining *j)
{
    double apart = INFINITY;
    list_candidates(j);
    CN_TRY(spacing(j, &apart));
    for (uint32_t i = 0; i < j->pieces->n_views; i++)
        j->target[i] = UINT32_MAX;
    for (uint32_t first = 0, last; first < j->n_candidates; first = last) {
        const uint32_t photo = j->candidates[first].photo;
        const cn_camera camera =
            cn_camera_equirectangular(j->index->photos[photo].width, j->index->photos[photo].height);
        cn_view pose = { 0 };
        for (last = first; last < j->n_candidates && j->candidates[last].photo == photo;)
            last++;
        vote(j, first, last, AGREE_SHARE * apart);
        average(j, first, last, &pose);
        for (uint32_t i = first; i < last; i++)
            if (j->candidates[i].agrees) j->target[j->candidates[i].view] = j->out->n_views;
        CN_TRY(add_view(j, &pose, photo, &camera));
    }
    for (uint32_t i = 0; i < j->pieces->n_views; i++) {
        const cn_view *view = &j->pieces->views[i];
        if (view->photo == UINT32_MAX || j->cut->view[view->photo] != CN_PANORAMA_WHOLE) continue;
        j->target[i] = j->out->n_views;
        CN_TRY(add_view(j, view, j->cut->photo[view->photo], &j->pieces->cameras[view->camera]));
    }
    return CN_OK;
}

/* A place in a view becomes one in its photo. */
static void move(const joining *j, const cn_observation *seen, cn_observation *out)
{
    const cn_view *view = &j->pieces->views[seen->view];
    const uint8_t k = j->cut->view[view->photo];
    *out = (cn_observation){ j->target[seen->view], seen->x_px, seen->y_px };
    if (k == CN_PANORAMA_WHOLE) return;
    const cn_photo *photo = &j->index->photos[j->cut->photo[view->photo]];
    const cn_camera camera = cn_panorama_view_camera(photo->width),
                    whole = cn_camera_equirectangular(photo->width, photo->height);
    double in_view[3], turn[9], dir[3], xy[2];
    cn_panorama_view_rotation(k, turn);
    /* A pinhole has a ray for every pixel. */
    if (cn_camera_unproject(&camera, seen->x_px, seen->y_px, in_view) != CN_OK) return;
    cn_mat3_tvec(turn, in_view, dir);
    (void)cn_camera_project(&whole, dir, xy);
    out->x_px = (float)xy[0];
    out->y_px = (float)xy[1];
}

/* The observations of a point in the scene: one a view, for views of a rig overlap. */
static uint32_t join_track(joining *j, const cn_point *point, cn_observation *list)
{
    uint32_t n = 0;
    for (uint32_t k = 0; k < point->n_observations; k++) {
        const cn_observation *seen = &j->pieces->observations[(uint64_t)point->first_observation + k];
        const uint32_t target = j->target[seen->view];
        bool known = target == UINT32_MAX;
        for (uint32_t i = 0; i < n && !known; i++)
            known = list[i].view == target;
        if (!known) move(j, seen, &list[n++]);
    }
    return n;
}

static void join_points(joining *j)
{
    cn_scene *out = j->out;
    for (uint32_t i = 0; i < j->pieces->n_points; i++) {
        const uint32_t n = join_track(j, &j->pieces->points[i], out->observations + out->n_observations);
        if (n < 2) continue;
        cn_point *point = &out->points[out->n_points++];
        *point = j->pieces->points[i];
        point->first_observation = (uint32_t)out->n_observations;
        point->n_observations = n;
        out->n_observations += n;
    }
}

/* Place, turn and scale of the whole are open: the first view stays where it is. */
static cn_status adjust(const cn_context *ctx, cn_scene *scene, bool keep_focal)
{
    bool *fixed = calloc(scene->n_views + (size_t)1, sizeof *fixed);
    cn_scene_adjustment how = { .fixed = fixed, .keep_focal = keep_focal, .options = cn_adjust_options_default() };
    cn_adjust_result result;
    if (!fixed) return cn_fail(CN_ERR_NOMEM, "out of memory adjusting %u photos", scene->n_views);
    fixed[0] = true;
    how.options.stage = "poses";
    cn_status status = scene->n_observations ? cn_scene_adjust(ctx, scene, &how, &result) : CN_OK;
    if (status == CN_OK) cn_scene_drop_errors(scene, MOST_ERROR_PX);
    if (status == CN_OK && scene->n_observations) status = cn_scene_adjust(ctx, scene, &how, &result);
    free(fixed);
    return status;
}

static cn_status join(const cn_context *ctx, joining *j)
{
    const size_t n_views = j->pieces->n_views + (size_t)1;
    cn_scene *out = j->out;
    out->views = calloc(n_views, sizeof *out->views);
    out->cameras = calloc(n_views, sizeof *out->cameras);
    out->points = calloc(j->pieces->n_points + (size_t)1, sizeof *out->points);
    out->observations = calloc(j->pieces->n_observations + 1, sizeof *out->observations);
    j->candidates = calloc(n_views, sizeof *j->candidates);
    j->target = calloc(n_views, sizeof *j->target);
    if (!out->views || !out->cameras || !out->points || !out->observations || !j->candidates || !j->target)
        return cn_fail(CN_ERR_NOMEM, "out of memory joining %u views", j->pieces->n_views);
    CN_TRY(join_poses(j));
    join_points(j);
    CN_TRY(cn_scene_sort_views(out));
    CN_TRY(adjust(ctx, out, j->keep_focal));
    const double error_px = cn_scene_measure_errors(out);
    uint32_t n_agree = 0;
    for (uint32_t i = 0; i < j->n_candidates; i++)
        n_agree += j->candidates[i].agrees;
    cn_log(ctx, CN_LOG_INFO, "%u views joined to the poses of %u photos, %u views disagree; %.2f px after adjustment",
           n_agree, out->n_views, j->n_candidates - n_agree, error_px);
    return CN_OK;
}

cn_status cn_panorama_join(const cn_context *ctx, const cn_panorama_cut *cut, const cn_photo_index *index,
                           const cn_scene *pieces, bool keep_focal, cn_scene *out)
{
    joining j = { .cut = cut, .index = index, .pieces = pieces, .keep_focal = keep_focal, .out = out };
    *out = (cn_scene){ 0 };
    const cn_status status = join(ctx, &j);
    free(j.candidates);
    free(j.target);
    if (status != CN_OK) cn_scene_deinit(out);
    return status;
}
