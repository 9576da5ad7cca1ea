/* What the models of neighbouring groups share: photos, and points that both see at the same place of a photo. */
#include "pose/merge.h"

#include <stdlib.h>
#include <string.h>

/* A view of a photo, or a point at a place of a photo, in one model. */
typedef struct sighting {
    float x_px, y_px;
    uint32_t model, what; /* the view or the point */
} sighting;
/* Something that two models share. */
typedef struct shared {
    uint32_t a, b, in_a, in_b;
} shared;
typedef struct shared_list {
    shared *items;
    size_t n, room;
} shared_list;

static bool add(shared_list *list, const sighting *s, const sighting *t)
{
    if (list->n == list->room) {
        const size_t room = 2 * list->room + 1024;
        shared *grown = realloc(list->items, room * sizeof *grown);
        if (!grown) return false;
        list->items = grown;
        list->room = room;
    }
    const bool turn = s->model > t->model;
    const sighting *a = turn ? t : s, *b = turn ? s : t;
    list->items[list->n++] = (shared){ a->model, b->model, a->what, b->what };
    return true;
}

static int by_models(const void *p, const void *q)
{
    const shared *x = p, *y = q;
    if (x->a != y->a) return x->a < y->a ? -1 : 1;
    if (x->b != y->b) return x->b < y->b ? -1 : 1;
    if (x->in_a != y->in_a) return x->in_a < y->in_a ? -1 : 1;
    return (x->in_b > y->in_b) - (x->in_b < y->in_b);
}

static void sort_once(shared_list *list)
{
    size_t n = 0;
    if (list->n) qsort(list->items, list->n, sizeof *list->items, by_models);
    for (size_t i = 0; i < list->n; i++)
        if (!i || by_models(&list->items[i], &list->items[i - 1]) != 0) list->items[n++] = list->items[i];
    list->n = n;
}

static int by_number(const void *a, const void *b)
{
    const uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

static int by_place(const void *p, const void *q)
{
    const sighting *x = p, *y = q;
    if (x->x_px != y->x_px) return x->x_px < y->x_px ? -1 : 1;
    if (x->y_px != y->y_px) return x->y_px < y->y_px ? -1 : 1;
    if (x->model != y->model) return x->model < y->model ? -1 : 1;
    return (x->what > y->what) - (x->what < y->what);
}

/* Adds all pairs of different models among sightings at the same place. */
static bool pair_up(sighting *s, uint64_t n, shared_list *out)
{
    qsort(s, n, sizeof *s, by_place);
    for (uint64_t i = 0; i < n; i++)
        for (uint64_t k = i + 1; k < n && s[k].x_px == s[i].x_px && s[k].y_px == s[i].y_px; k++)
            if (s[k].model != s[i].model && !add(out, &s[i], &s[k])) return false;
    return true;
}

/* Sightings by photo: of photos that at least two models pose. */
typedef struct album {
    uint32_t n_photos;
    uint32_t *n_models; /* of each photo */
    uint64_t *first;
    sighting *sightings;
} album;

static void album_deinit(album *a)
{
    free(a->n_models);
    free(a->first);
    free(a->sightings);
}

/* Counts (sightings NULL) or writes the sightings of a model's points in shared photos. */
static void visit(album *a, const cn_scene *scene, uint32_t model)
{
    for (uint32_t i = 0; i < scene->n_points; i++)
        for (uint32_t k = 0; k < scene->points[i].n_observations; k++) {
            const cn_observation *o = &scene->observations[(uint64_t)scene->points[i].first_observation + k];
            const uint32_t photo = scene->views[o->view].photo;
            if (photo == UINT32_MAX || a->n_models[photo] < 2) continue;
            if (a->sightings)
                a->sightings[a->first[photo + 1]++] = (sighting){ o->x_px, o->y_px, model, i };
            else
                a->first[photo + 2]++;
        }
}

static cn_status album_init(album *a, const cn_merge_task *task)
{
    const size_t n = task->index->n_photos;
    *a = (album){ .n_photos = task->index->n_photos };
    a->n_models = calloc(n + 1, sizeof *a->n_models);
    a->first = calloc(n + 2, sizeof *a->first);
    if (!a->n_models || !a->first) return cn_fail(CN_ERR_NOMEM, "out of memory merging groups");
    for (uint32_t m = 0; m < task->groups->n; m++)
        for (uint32_t i = 0; i < task->models[m].n_views; i++)
            if (task->models[m].views[i].photo != UINT32_MAX) a->n_models[task->models[m].views[i].photo]++;
    for (uint32_t m = 0; m < task->groups->n; m++)
        visit(a, &task->models[m], m);
    for (size_t i = 2; i < n + 2; i++)
        a->first[i] += a->first[i - 1];
    a->sightings = malloc((a->first[n + 1] + 1) * sizeof *a->sightings);
    if (!a->sightings) return cn_fail(CN_ERR_NOMEM, "out of memory merging groups");
    for (uint32_t m = 0; m < task->groups->n; m++)
        visit(a, &task->models[m], m);
    return CN_OK;
}

static bool find_points(album *a, shared_list *out)
{
    for (uint32_t photo = 0; photo < a->n_photos; photo++)
        if (!pair_up(a->sightings + a->first[photo], a->first[photo + 1] - a->first[photo], out)) return false;
    sort_once(out);
    return true;
}

/* Views of the same photo in two models. */
static bool find_photos(const album *a, const cn_merge_task *task, shared_list *out)
{
    const size_t n = a->n_photos;
    uint64_t *first = calloc(n + 2, sizeof *first);
    bool fine = first != NULL;
    for (size_t i = 0; i < n && fine; i++)
        first[i + 2] = first[i + 1] + a->n_models[i];
    sighting *views = fine ? malloc((first[n + (n > 0)] + 1) * sizeof *views) : NULL;
    fine = fine && views;
    for (uint32_t m = 0; m < task->groups->n && fine; m++)
        for (uint32_t i = 0; i < task->models[m].n_views; i++) {
            const uint32_t photo = task->models[m].views[i].photo;
            if (photo != UINT32_MAX) views[first[photo + 1]++] = (sighting){ 0, 0, m, i };
        }
    for (size_t i = 0; i < n && fine; i++)
        fine = pair_up(views + first[i], first[i + 1] - first[i], out);
    free(first);
    free(views);
    if (fine) sort_once(out);
    return fine;
}

static bool same_models(const shared *x, const shared *y)
{
    return x->a == y->a && x->b == y->b;
}

/* Links of models that share photos, with their points. */
static bool make_links(const shared_list *photos, const shared_list *points, cn_group_links *out)
{
    out->links = calloc(photos->n + 1, sizeof *out->links);
    out->points = malloc((points->n + 1) * sizeof *out->points);
    out->photos = malloc((photos->n + 1) * sizeof *out->photos);
    if (!out->links || !out->points || !out->photos) return false;
    for (size_t i = 0; i < photos->n; i++) {
        const shared *s = &photos->items[i];
        if (!i || !same_models(s, s - 1))
            out->links[out->n++] = (cn_group_link){ .a = s->a, .b = s->b, .first_photo = (uint32_t)i };
        out->links[out->n - 1].n_photos++;
        out->photos[out->n_photos++] = (cn_shared_photo){ s->in_a, s->in_b };
    }
    uint32_t link = 0;
    for (size_t i = 0; i < points->n; i++) {
        const shared *s = &points->items[i];
        while (out->links[link].a != s->a || out->links[link].b != s->b)
            link++;
        if (!out->links[link].n_points++) out->links[link].first_point = (uint32_t)i;
        out->points[out->n_points++] = (cn_shared_point){ s->in_a, s->in_b };
    }
    return true;
}

cn_status cn_group_links_find(const cn_merge_task *task, cn_group_links *out)
{
    album a;
    shared_list points = { 0 }, photos = { 0 };
    *out = (cn_group_links){ 0 };
    cn_status status = album_init(&a, task);
    if (status == CN_OK &&
        !(find_points(&a, &points) && find_photos(&a, task, &photos) && make_links(&photos, &points, out)))
        status = cn_fail(CN_ERR_NOMEM, "out of memory merging groups");
    album_deinit(&a);
    free(points.items);
    free(photos.items);
    if (status != CN_OK) cn_group_links_deinit(out);
    return status;
}

void cn_group_links_deinit(cn_group_links *links)
{
    free(links->links);
    free(links->points);
    free(links->photos);
    *links = (cn_group_links){ 0 };
}

void cn_group_givers(const cn_merge_task *task, const cn_group_place *places, uint32_t *giver)
{
    memset(giver, 0xff, task->index->n_photos * sizeof *giver);
    for (uint32_t m = 0; m < task->groups->n; m++)
        for (uint32_t i = 0; i < task->models[m].n_views && (!places || places[m].placed); i++) {
            const uint32_t photo = task->models[m].views[i].photo;
            if (photo != UINT32_MAX && giver[photo] == UINT32_MAX) giver[photo] = m;
        }
    /* Cores last: they win. Photos that the core's group does not pose keep what they have. */
    for (uint32_t m = 0; m < task->groups->n; m++)
        for (uint32_t i = 0; i < task->models[m].n_views && (!places || places[m].placed); i++) {
            const uint32_t photo = task->models[m].views[i].photo;
            const cn_photo_group *group = &task->groups->groups[m];
            const uint32_t *core = group->photos;
            if (photo != UINT32_MAX && bsearch(&photo, core, group->n_core, sizeof *core, by_number)) giver[photo] = m;
        }
}
