#include "pose/scene.h"

#include "math/linalg.h"
#include "pose/finder.h"
#include "pose/lens.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

void cn_scene_deinit(cn_scene *scene)
{
    for (uint32_t i = 0; i < scene->n_views && scene->views; i++)
        free(scene->views[i].name);
    free(scene->cameras);
    free(scene->views);
    free(scene->points);
    free(scene->observations);
    memset(scene, 0, sizeof *scene);
}

void cn_view_centre(const cn_view *view, double centre[3])
{
    cn_mat3_tvec(view->rotation, view->translation, centre);
    for (int i = 0; i < 3; i++)
        centre[i] = -centre[i];
}

cn_side cn_view_side_up(const cn_view *view)
{
    const double steep = 0.5, one_way = 0.7071; /* cosines of the pitch and of the roll */
    const double right = view->rotation[2], down = view->rotation[5], level = hypot(right, down);
    if (level < steep || -down > one_way * level) return CN_SIDE_TOP;
    if (down > one_way * level) return CN_SIDE_BOTTOM;
    return right > 0 ? CN_SIDE_RIGHT : CN_SIDE_LEFT;
}

void cn_side_turn(cn_side up, double cam_from_world[9])
{
    static const double cosine[] = { 1, 0, 0, -1 }, sine[] = { 0, 1, -1, 0 };
    double *right = cam_from_world, *down = cam_from_world + 3;
    for (int k = 0; k < 3; k++) {
        const double r = right[k], d = down[k];
        right[k] = cosine[up] * r - sine[up] * d;
        down[k] = sine[up] * r + cosine[up] * d;
    }
}

typedef struct sort_entry {
    const char *name;
    uint32_t index;
} sort_entry;

static int compare_entries(const void *a, const void *b)
{
    return strcmp(((const sort_entry *)a)->name, ((const sort_entry *)b)->name);
}

cn_status cn_scene_sort_views(cn_scene *scene)
{
    uint32_t n = scene->n_views;
    sort_entry *entries = calloc(n + 1, sizeof *entries);
    uint32_t *place = calloc(n + 1, sizeof *place);
    cn_view *sorted = calloc(n + 1, sizeof *sorted);
    if (!entries || !place || !sorted) {
        free(entries);
        free(place);
        free(sorted);
        return cn_fail(CN_ERR_NOMEM, "out of memory sorting %u views", n);
    }
    for (uint32_t i = 0; i < n; i++)
        entries[i] = (sort_entry){ scene->views[i].name, i };
    qsort(entries, n, sizeof *entries, compare_entries);
    for (uint32_t i = 0; i < n; i++) {
        place[entries[i].index] = i;
        sorted[i] = scene->views[entries[i].index];
    }
    for (uint64_t i = 0; i < scene->n_observations; i++)
        scene->observations[i].view = place[scene->observations[i].view];
    free(scene->views);
    scene->views = sorted;
    free(entries);
    free(place);
    return CN_OK;
}

/* Compacts points and observations in place. */
static void drop_observations(cn_scene *scene, const uint32_t *place)
{
    uint64_t n_observations = 0;
    uint32_t n_points = 0;
    for (uint32_t i = 0; i < scene->n_points; i++) {
        cn_point point = scene->points[i];
        uint64_t first = n_observations;
        for (uint32_t j = 0; j < point.n_observations; j++) {
            cn_observation seen = scene->observations[(uint64_t)point.first_observation + j];
            if (place[seen.view] == UINT32_MAX) continue;
            seen.view = place[seen.view];
            scene->observations[n_observations++] = seen;
        }
        if (n_observations == first) continue;
        point.first_observation = (uint32_t)first;
        point.n_observations = (uint32_t)(n_observations - first);
        scene->points[n_points++] = point;
    }
    scene->n_points = n_points;
    scene->n_observations = n_observations;
}

cn_status cn_scene_keep_views(cn_scene *scene, const bool *keep)
{
    uint32_t *place = malloc((scene->n_views + (size_t)1) * sizeof *place), n = 0;
    if (!place) return cn_fail(CN_ERR_NOMEM, "out of memory dropping views");
    for (uint32_t i = 0; i < scene->n_views; i++) {
        place[i] = keep[i] ? n : UINT32_MAX;
        if (keep[i])
            scene->views[n++] = scene->views[i];
        else
            free(scene->views[i].name);
    }
    bool dropped = n != scene->n_views;
    scene->n_views = n;
    if (dropped) drop_observations(scene, place);
    free(place);
    return CN_OK;
}

void cn_scene_transform(cn_scene *scene, double scale, const double rotation[9], const double translation[3])
{
    double inverse[9], turned[9], moved[3];
    cn_mat3_transpose(rotation, inverse);
    for (uint32_t i = 0; i < scene->n_views; i++) {
        cn_view *view = &scene->views[i];
        cn_mat3_mul(view->rotation, inverse, turned);
        cn_mat3_vec(turned, translation, moved);
        memcpy(view->rotation, turned, sizeof turned);
        for (int k = 0; k < 3; k++)
            view->translation[k] = scale * view->translation[k] - moved[k];
    }
    for (uint32_t i = 0; i < scene->n_points; i++) {
        double *xyz = scene->points[i].xyz;
        cn_mat3_vec(rotation, xyz, moved);
        for (int k = 0; k < 3; k++)
            xyz[k] = scale * moved[k] + translation[k];
    }
}

bool cn_scene_error(const cn_scene *scene, const cn_point *point, const cn_observation *seen, double *error_px)
{
    const cn_view *view = &scene->views[seen->view];
    const cn_camera *camera = &scene->cameras[view->camera];
    const double at[2] = { seen->x_px, seen->y_px };
    double xyz[3], xy[2], off[2];
    cn_mat3_vec(view->rotation, point->xyz, xyz);
    for (int k = 0; k < 3; k++)
        xyz[k] += view->translation[k];
    if (!cn_camera_project(camera, xyz, xy)) return false;
    *error_px = cn_camera_offset_px(camera, at, xy, off);
    return true;
}

uint64_t cn_scene_drop_errors(cn_scene *scene, double most_px)
{
    uint64_t kept = 0, before = scene->n_observations;
    uint32_t n_points = 0;
    for (uint32_t i = 0; i < scene->n_points; i++) {
        cn_point point = scene->points[i];
        const uint64_t first = kept;
        for (uint32_t k = 0; k < point.n_observations; k++) {
            const cn_observation seen = scene->observations[(uint64_t)point.first_observation + k];
            double error;
            if (cn_scene_error(scene, &point, &seen, &error) && error <= most_px) scene->observations[kept++] = seen;
        }
        if (kept - first < 2) {
            kept = first;
            continue;
        }
        point.first_observation = (uint32_t)first;
        point.n_observations = (uint32_t)(kept - first);
        scene->points[n_points++] = point;
    }
    scene->n_points = n_points;
    scene->n_observations = kept;
    return before - kept;
}

double cn_scene_measure_errors(cn_scene *scene)
{
    double total = 0.0, total_n = 0.0;
    for (uint32_t i = 0; i < scene->n_points; i++) {
        cn_point *point = &scene->points[i];
        double sum = 0.0, error;
        uint32_t n = 0;
        for (uint32_t j = 0; j < point->n_observations; j++)
            if (cn_scene_error(scene, point, &scene->observations[(uint64_t)point->first_observation + j], &error)) {
                sum += error;
                n++;
            }
        point->error_px = n ? (float)(sum / n) : 0.0f;
        total += sum;
        total_n += n;
    }
    return total_n > 0.0 ? total / total_n : 0.0;
}

cn_status cn_scene_tie(cn_scene *scene, const cn_photo_index *index, uint32_t *n_lost)
{
    cn_photo_finder finder;
    CN_TRY(cn_photo_finder_init(&finder, index));
    *n_lost = 0;
    for (uint32_t i = 0; i < scene->n_views; i++) {
        int64_t photo = cn_photo_finder_find(&finder, scene->views[i].name);
        scene->views[i].photo = photo < 0 ? UINT32_MAX : (uint32_t)photo;
        *n_lost += photo < 0;
    }
    cn_photo_finder_deinit(&finder);
    return CN_OK;
}

enum { DEPTHS = 301 };
double cn_scene_median_depth(const cn_scene *scene)
{
    double found[DEPTHS];
    size_t n = 0;
    const uint64_t step = scene->n_points / DEPTHS + 1;
    for (uint64_t i = 0; i < scene->n_points && n < DEPTHS; i += step) {
        const cn_point *point = &scene->points[i];
        double centre[3];
        if (!point->n_observations) continue;
        cn_view_centre(&scene->views[scene->observations[point->first_observation].view], centre);
        found[n++] = cn_distance3(centre, point->xyz);
    }
    for (uint32_t i = 1; i < scene->n_views && !scene->n_points && n < DEPTHS; i++) {
        double a[3], b[3];
        cn_view_centre(&scene->views[0], a);
        cn_view_centre(&scene->views[i], b);
        found[n++] = cn_distance3(a, b);
    }
    return n ? cn_select(found, n, n / 2) : 1.0;
}

static void *larger(void *items, uint64_t n, uint64_t n_more, size_t size)
{
    return realloc(items, (n + n_more + 1) * size);
}

cn_status cn_scene_append(cn_scene *scene, const cn_scene *other)
{
    cn_camera *cameras = larger(scene->cameras, scene->n_cameras, other->n_cameras, sizeof *cameras);
    if (cameras) scene->cameras = cameras;
    cn_view *views = larger(scene->views, scene->n_views, other->n_views, sizeof *views);
    if (views) scene->views = views;
    cn_point *points = larger(scene->points, scene->n_points, other->n_points, sizeof *points);
    if (points) scene->points = points;
    cn_observation *observations =
        larger(scene->observations, scene->n_observations, other->n_observations, sizeof *observations);
    if (observations) scene->observations = observations;
    if (!cameras || !views || !points || !observations)
        return cn_fail(CN_ERR_NOMEM, "out of memory for %u photos more", other->n_views);
    for (uint32_t i = 0; i < other->n_views; i++) {
        cn_view *view = &scene->views[scene->n_views + i];
        *view = other->views[i];
        view->camera += scene->n_cameras;
        view->name = strdup(other->views[i].name);
        if (view->name) continue;
        while (i--)
            free(scene->views[scene->n_views + i].name);
        return cn_fail(CN_ERR_NOMEM, "out of memory for %u photos more", other->n_views);
    }
    for (uint32_t i = 0; i < other->n_points; i++) {
        cn_point *point = &scene->points[scene->n_points + i];
        *point = other->points[i];
        point->first_observation += (uint32_t)scene->n_observations;
    }
    for (uint64_t i = 0; i < other->n_observations; i++) {
        cn_observation *seen = &scene->observations[scene->n_observations + i];
        *seen = other->observations[i];
        seen->view += scene->n_views;
    }
    memcpy(scene->cameras + scene->n_cameras, other->cameras, other->n_cameras * sizeof *scene->cameras);
    scene->n_cameras += other->n_cameras;
    scene->n_views += other->n_views;
    scene->n_points += other->n_points;
    scene->n_observations += other->n_observations;
    return cn_scene_sort_views(scene);
}

int64_t cn_scene_find_view(const cn_scene *scene, const char *name)
{
    uint32_t low = 0, high = scene->n_views;
    while (low < high) {
        uint32_t middle = low + (high - low) / 2;
        int order = strcmp(scene->views[middle].name, name);
        if (order == 0) return middle;
        if (order < 0)
            low = middle + 1;
        else
            high = middle;
    }
    return -1;
}
