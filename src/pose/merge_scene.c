/* The scene of all groups: each photo's pose from one group, and points that groups share as one. */
#include "base/disjoint.h"
#include "math/linalg.h"
#include "pose/colmap.h"
#include "pose/lens.h"
#include "pose/merge.h"
#include "pose/scene.h"
#include "pose/similarity.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct assembly {
    const cn_merge_task *task;
    const cn_group_links *links;
    const cn_group_place *places;
    cn_scene *out;
    uint32_t *giver;        /* of each photo: the group that its pose is from */
    uint32_t *view_of;      /* of each photo: its view in the scene */
    uint64_t *first_point;  /* of each group: the number of its first point among all */
    uint32_t *same;         /* of each of all points: another one that is the same (a forest), or itself */
    uint32_t *first_camera; /* of each group: its first camera among all */
} assembly;

/* ---- Views ---- */

static cn_status add_views(assembly *a)
{
    const uint32_t n = a->task->index->n_photos;
    uint32_t *view_in = malloc((n + (size_t)1) * sizeof *view_in);
    a->out->views = calloc(n + (size_t)1, sizeof *a->out->views);
    if (!view_in || !a->out->views) {
        free(view_in);
        return cn_fail(CN_ERR_NOMEM, "out of memory merging groups");
    }
    for (uint32_t m = 0; m < a->task->groups->n; m++)
        for (uint32_t i = 0; i < a->task->models[m].n_views; i++) {
            const uint32_t photo = a->task->models[m].views[i].photo;
            if (photo != UINT32_MAX && a->giver[photo] == m) view_in[photo] = i;
        }
    cn_status status = CN_OK;
    for (uint32_t photo = 0; photo < n && status == CN_OK; photo++) {
        const uint32_t m = a->giver[photo];
        a->view_of[photo] = UINT32_MAX;
        if (m == UINT32_MAX) continue;
        const cn_similarity *s = &a->places[m].to_world;
        cn_view view = a->task->models[m].views[view_in[photo]];
        cn_scene one = { .views = &view, .n_views = 1 };
        cn_scene_transform(&one, s->scale, s->rotation, s->translation);
        view.camera += a->first_camera[m];
        view.name = strdup(a->task->index->photos[photo].name);
        if (!view.name) status = cn_fail(CN_ERR_NOMEM, "out of memory merging groups");
        a->view_of[photo] = a->out->n_views;
        a->out->views[a->out->n_views++] = view;
    }
    free(view_in);
    return status;
}

/* ---- Points ---- */

/* The smaller number becomes the root, so that the order of the links does not matter. */
static void unite(assembly *a)
{
    for (uint32_t l = 0; l < a->links->n; l++) {
        const cn_group_link *link = &a->links->links[l];
        if (!a->places[link->a].placed || !a->places[link->b].placed) continue;
        for (uint32_t i = 0; i < link->n_points; i++) {
            const cn_shared_point *p = &a->links->points[link->first_point + i];
            const uint32_t x = cn_root_of(a->same, (uint32_t)(a->first_point[link->a] + p->a));
            const uint32_t y = cn_root_of(a->same, (uint32_t)(a->first_point[link->b] + p->b));
            if (x < y)
                a->same[y] = x;
            else
                a->same[x] = y;
        }
    }
}

/* A point of a group, listed by its root. */
typedef struct member {
    uint32_t root, group, point;
} member;
static int by_root(const void *p, const void *q)
{
    const member *x = p, *y = q;
    if (x->root != y->root) return x->root < y->root ? -1 : 1;
    return (x->group > y->group) - (x->group < y->group);
}

/* Adds the observations of one group's point that the track does not have, one a photo. */
static void add_observations(assembly *a, const member *m, cn_point *point)
{
    const cn_scene *model = &a->task->models[m->group];
    const cn_point *from = &model->points[m->point];
    for (uint32_t k = 0; k < from->n_observations; k++) {
        const cn_observation *o = &model->observations[(uint64_t)from->first_observation + k];
        const uint32_t photo = model->views[o->view].photo;
        if (photo == UINT32_MAX || a->view_of[photo] == UINT32_MAX) continue;
        bool known = false;
        for (uint32_t i = 0; i < point->n_observations && !known; i++)
            known = a->out->observations[(uint64_t)point->first_observation + i].view == a->view_of[photo];
        if (known) continue;
        a->out->observations[a->out->n_observations++] = (cn_observation){ a->view_of[photo], o->x_px, o->y_px };
        point->n_observations++;
    }
}

/* One point of the scene from its members: the mean of their places. */
static void add_point(assembly *a, const member *members, size_t n)
{
    cn_point *point = &a->out->points[a->out->n_points];
    double sum[3] = { 0 };
    *point = a->task->models[members[0].group].points[members[0].point];
    point->first_observation = (uint32_t)a->out->n_observations;
    point->n_observations = 0;
    for (size_t i = 0; i < n; i++) {
        double at[3];
        const cn_point *from = &a->task->models[members[i].group].points[members[i].point];
        cn_similarity_apply(&a->places[members[i].group].to_world, from->xyz, at);
        for (int k = 0; k < 3; k++)
            sum[k] += at[k] / (double)n;
        add_observations(a, &members[i], point);
    }
    memcpy(point->xyz, sum, sizeof sum);
    if (point->n_observations >= 2)
        a->out->n_points++;
    else
        a->out->n_observations = point->first_observation;
}

static cn_status add_points(assembly *a, uint64_t n_points, uint64_t n_observations)
{
    member *members = malloc((n_points + 1) * sizeof *members);
    size_t n = 0;
    a->out->points = malloc((n_points + 1) * sizeof *a->out->points);
    a->out->observations = malloc((n_observations + 1) * sizeof *a->out->observations);
    if (!members || !a->out->points || !a->out->observations) {
        free(members);
        return cn_fail(CN_ERR_NOMEM, "out of memory merging groups");
    }
    for (uint32_t m = 0; m < a->task->groups->n; m++)
        for (uint32_t i = 0; i < a->task->models[m].n_points && a->places[m].placed; i++)
            members[n++] = (member){ cn_root_of(a->same, (uint32_t)(a->first_point[m] + i)), m, i };
    qsort(members, n, sizeof *members, by_root);
    for (size_t i = 0, end; i < n; i = end) {
        for (end = i + 1; end < n && members[end].root == members[i].root;)
            end++;
        add_point(a, members + i, end - i);
    }
    free(members);
    return CN_OK;
}

/* ---- Cameras ---- */

/* Photos that share a lens get one camera: the mean of the groups' cameras of the lens model that most of the photos
 * have. */
static void share_camera(cn_scene *scene, const uint32_t *views, uint32_t n, uint32_t camera)
{
    uint32_t votes[CN_LENS_EQUIRECTANGULAR + 1] = { 0 }, best = 0, used = 0;
    double sum[8] = { 0 };
    for (uint32_t i = 0; i < n; i++)
        votes[scene->cameras[scene->views[views[i]].camera].lens]++;
    for (uint32_t k = 1; k <= CN_LENS_EQUIRECTANGULAR; k++)
        if (votes[k] > votes[best]) best = k;
    cn_camera made = { 0 };
    for (uint32_t i = 0; i < n; i++) {
        const cn_camera *c = &scene->cameras[scene->views[views[i]].camera];
        if (c->lens != (cn_lens)best || (used && (c->width != made.width || c->height != made.height))) continue;
        if (!used++) made = *c;
        for (int k = 0; k < 8; k++)
            sum[k] += c->params[k];
    }
    for (int k = 0; k < 8; k++)
        made.params[k] = sum[k] / used;
    made.id = camera + 1;
    scene->cameras[camera] = made;
    for (uint32_t i = 0; i < n; i++) {
        cn_view *view = &scene->views[views[i]];
        const cn_camera *c = &scene->cameras[view->camera];
        if (c->width == made.width && c->height == made.height) view->camera = camera;
    }
}

/* Only cameras that a view has, in the order of their views. */
static cn_status compact_cameras(cn_scene *scene)
{
    uint32_t *number = malloc((scene->n_cameras + (size_t)1) * sizeof *number), n = 0;
    cn_camera *kept = malloc((scene->n_cameras + (size_t)1) * sizeof *kept);
    if (!number || !kept) {
        free(number);
        free(kept);
        return cn_fail(CN_ERR_NOMEM, "out of memory merging groups");
    }
    memset(number, 0xff, scene->n_cameras * sizeof *number);
    for (uint32_t i = 0; i < scene->n_views; i++) {
        uint32_t *camera = &scene->views[i].camera;
        if (number[*camera] == UINT32_MAX) {
            kept[n] = scene->cameras[*camera];
            number[*camera] = n;
            kept[n].id = n + 1;
            n++;
        }
        *camera = number[*camera];
    }
    free(number);
    free(scene->cameras);
    scene->cameras = kept;
    scene->n_cameras = n;
    return CN_OK;
}

static cn_status share_cameras(assembly *a)
{
    cn_lens_groups lenses;
    uint32_t *views = malloc((a->task->index->n_photos + (size_t)1) * sizeof *views);
    if (!views) return cn_fail(CN_ERR_NOMEM, "out of memory merging groups");
    cn_status status = cn_colmap_group(a->task->index, a->task->options->single_camera, &lenses);
    if (status != CN_OK) {
        free(views);
        return status;
    }
    for (uint32_t g = 0; g < lenses.n_groups; g++) {
        const cn_lens_group *lens = &lenses.groups[g];
        uint32_t n = 0;
        for (uint32_t i = 0; i < lens->n && lens->shared; i++) {
            const uint32_t view = a->view_of[lenses.order[lens->first + i]];
            if (view != UINT32_MAX) views[n++] = view;
        }
        if (n) share_camera(a->out, views, n, a->out->n_cameras++);
    }
    cn_lens_groups_deinit(&lenses);
    free(views);
    return compact_cameras(a->out);
}

static cn_status add_cameras(assembly *a)
{
    uint32_t n = 0;
    for (uint32_t m = 0; m < a->task->groups->n; m++) {
        a->first_camera[m] = n;
        n += a->task->models[m].n_cameras;
    }
    /* There are fewer shared cameras than cameras of groups, or photos. */
    a->out->cameras = malloc((n + (size_t)a->task->index->n_photos + 1) * sizeof *a->out->cameras);
    if (!a->out->cameras) return cn_fail(CN_ERR_NOMEM, "out of memory merging groups");
    for (uint32_t m = 0; m < a->task->groups->n; m++)
        if (a->task->models[m].n_cameras)
            memcpy(a->out->cameras + a->first_camera[m], a->task->models[m].cameras,
                   a->task->models[m].n_cameras * sizeof *a->out->cameras);
    a->out->n_cameras = n;
    return CN_OK;
}

static cn_status assemble(assembly *a)
{
    const uint32_t n_groups = a->task->groups->n, n_photos = a->task->index->n_photos;
    uint64_t n_points = 0, n_observations = 0;
    a->giver = malloc((n_photos + (size_t)1) * sizeof *a->giver);
    a->view_of = malloc((n_photos + (size_t)1) * sizeof *a->view_of);
    a->first_point = malloc((n_groups + (size_t)1) * sizeof *a->first_point);
    a->first_camera = malloc((n_groups + (size_t)1) * sizeof *a->first_camera);
    if (!a->giver || !a->view_of || !a->first_point || !a->first_camera)
        return cn_fail(CN_ERR_NOMEM, "out of memory merging groups");
    for (uint32_t m = 0; m < n_groups; m++) {
        a->first_point[m] = n_points;
        n_points += a->task->models[m].n_points;
        n_observations += a->task->models[m].n_observations;
    }
    if (n_points >= UINT32_MAX || n_observations >= UINT32_MAX)
        return cn_fail(CN_ERR_DATA,
                       "the groups have %llu sparse points with %llu observations, more than a model can "
                       "hold; lower poses.max_features",
                       (unsigned long long)n_points, (unsigned long long)n_observations);
    a->same = malloc((n_points + 1) * sizeof *a->same);
    if (!a->same) return cn_fail(CN_ERR_NOMEM, "out of memory merging groups");
    for (uint32_t i = 0; i < n_points; i++)
        a->same[i] = i;
    cn_group_givers(a->task, a->places, a->giver);
    CN_TRY(add_cameras(a));
    CN_TRY(add_views(a));
    unite(a);
    CN_TRY(add_points(a, n_points, n_observations));
    return share_cameras(a);
}

cn_status cn_groups_assemble(const cn_merge_task *task, const cn_group_links *links, const cn_group_place *places,
                             cn_scene *scene, uint32_t **home)
{
    assembly a = { .task = task, .links = links, .places = places, .out = scene };
    *scene = (cn_scene){ 0 };
    cn_status status = assemble(&a);
    *home = status == CN_OK ? malloc((scene->n_views + (size_t)1) * sizeof **home) : NULL;
    if (status == CN_OK && !*home) status = cn_fail(CN_ERR_NOMEM, "out of memory merging groups");
    for (uint32_t i = 0; i < scene->n_views && status == CN_OK; i++)
        (*home)[i] = a.giver[scene->views[i].photo];
    free(a.giver);
    free(a.view_of);
    free(a.first_point);
    free(a.same);
    free(a.first_camera);
    if (status != CN_OK) cn_scene_deinit(scene);
    return status;
}
