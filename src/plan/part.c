/* The part of the scene that one tile needs. Evidence is measured on this part, so the cost of a tile does not
 * depend on the size of the city. */
#include "plan/plan.h"

#include <stdlib.h>
#include <string.h>

/* Evidence is a median or a fraction, and this many photos are enough for it. They are taken in runs of neighbours,
 * because evenly spread photos would have few points in common. */
#define RUNS 16u
#define RUN 32u
#define MAX_VIEWS (RUNS * RUN)

static cn_status out_of_memory(void)
{
    return cn_fail(CN_ERR_NOMEM, "out of memory while measuring effects");
}

cn_status cn_plan_part_init(cn_plan_part *part, const cn_scene *scene)
{
    *part = (cn_plan_part){ .row = malloc(sizeof *part->row * (scene->n_views + (size_t)1)),
                            .known = calloc(scene->n_points + (size_t)1, sizeof *part->known),
                            .photos = malloc(sizeof *part->photos * MAX_VIEWS),
                            .chosen = malloc(sizeof *part->chosen * MAX_VIEWS) };
    part->scene.views = malloc(sizeof *part->scene.views * MAX_VIEWS);
    if (!part->row || !part->known || !part->photos || !part->chosen || !part->scene.views) return out_of_memory();
    memset(part->row, 0xff, sizeof *part->row * scene->n_views);
    return CN_OK;
}

void cn_plan_part_deinit(cn_plan_part *part)
{
    free(part->row);
    free(part->known);
    free(part->photos);
    free(part->chosen);
    free(part->scene.views);
    free(part->scene.points);
    free(part->scene.observations);
    free(part->points);
    *part = (cn_plan_part){ 0 };
}

/* Makes room for n items; the old content is lost. */
static cn_status reserve(void **items, uint64_t *room, uint64_t n, size_t size)
{
    if (n <= *room && *items) return CN_OK;
    free(*items);
    *room = n + n / 4 + 64;
    *items = malloc(size * *room);
    if (*items) return CN_OK;
    *room = 0;
    return out_of_memory();
}

static int compare_indices(const void *a, const void *b)
{
    uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

/* All of the tile's photos, or runs of them; ascending, into part->chosen. */
static cn_status choose_views(cn_plan_part *part, const cn_plan_tile *tile, const cn_plan_views *views)
{
    part->n_chosen = tile->n_photos < MAX_VIEWS ? tile->n_photos : MAX_VIEWS;
    memcpy(part->chosen, tile->photos, sizeof *part->chosen * part->n_chosen);
    if (tile->n_photos <= MAX_VIEWS) return CN_OK;
    cn_plan_rank *order;
    CN_TRY(cn_plan_rank_views(tile, views, tile->photos, tile->n_photos, &order));
    for (uint32_t i = 0; i < MAX_VIEWS; i++)
        part->chosen[i] = order[(uint64_t)(i / RUN) * (tile->n_photos - RUN) / (RUNS - 1) + i % RUN].view;
    free(order);
    qsort(part->chosen, MAX_VIEWS, sizeof *part->chosen, compare_indices);
    return CN_OK;
}

static void take_views(cn_plan_part *part, const cn_scene *scene)
{
    part->scene.cameras = scene->cameras;
    part->scene.n_cameras = scene->n_cameras;
    part->scene.n_views = part->n_chosen;
    for (uint32_t i = 0; i < part->n_chosen; i++) {
        part->scene.views[i] = scene->views[part->chosen[i]];
        part->row[part->chosen[i]] = i;
        part->photos[i] = i;
    }
}

/* The points that the part's views see, ascending, as they stand in the city. */
static cn_status find_points(cn_plan_part *part, const cn_plan_views *views, uint32_t *n_points)
{
    uint64_t most = 0;
    uint32_t n = 0;
    for (uint32_t i = 0; i < part->n_chosen; i++)
        most += views->views[part->chosen[i]].n_points;
    CN_TRY(reserve((void **)&part->points, &part->room_points, most + 1, sizeof *part->points));
    for (uint32_t i = 0; i < part->n_chosen; i++) {
        const cn_plan_view *v = &views->views[part->chosen[i]];
        for (uint32_t k = 0; k < v->n_points; k++) {
            const uint32_t p = views->seen[v->first_point + k];
            if (!part->known[p]) part->points[n++] = p;
            part->known[p] = true;
        }
    }
    qsort(part->points, n, sizeof *part->points, compare_indices);
    *n_points = n;
    return CN_OK;
}

static cn_status take_points(cn_plan_part *part, const cn_scene *scene, uint32_t n)
{
    uint64_t most = 0, at = 0;
    for (uint32_t i = 0; i < n; i++)
        most += scene->points[part->points[i]].n_observations;
    CN_TRY(reserve((void **)&part->scene.points, &part->room_scene, n + 1, sizeof *part->scene.points));
    CN_TRY(reserve((void **)&part->scene.observations, &part->room_observations, most + 1,
                   sizeof *part->scene.observations));
    for (uint32_t i = 0; i < n; i++) {
        const cn_point *from = &scene->points[part->points[i]];
        cn_point *to = &part->scene.points[i];
        *to = *from;
        to->first_observation = (uint32_t)at;
        for (uint32_t k = 0; k < from->n_observations; k++) {
            cn_observation o = scene->observations[(uint64_t)from->first_observation + k];
            if (part->row[o.view] == UINT32_MAX) continue;
            o.view = part->row[o.view];
            part->scene.observations[at++] = o;
        }
        to->n_observations = (uint32_t)(at - to->first_observation);
    }
    part->scene.n_points = n;
    part->scene.n_observations = at;
    return CN_OK;
}

/* Clears what the tile has marked, so that the next tile starts clean without a pass over the whole city. */
static void forget(cn_plan_part *part, uint32_t n_points)
{
    for (uint32_t i = 0; i < part->n_chosen; i++)
        part->row[part->chosen[i]] = UINT32_MAX;
    for (uint32_t i = 0; i < n_points; i++)
        part->known[part->points[i]] = false;
}

cn_status cn_plan_part_effects(cn_plan_part *part, cn_plan_tile *tile, const cn_plan_views *views,
                               const cn_plan_input *input, const cn_plan_options *options)
{
    uint32_t n_points = 0;
    CN_TRY(choose_views(part, tile, views));
    take_views(part, input->scene);
    cn_status status = find_points(part, views, &n_points);
    if (status == CN_OK) status = take_points(part, input->scene, n_points);
    forget(part, n_points);
    CN_TRY(status);
    cn_plan_tile small = *tile;
    const cn_plan_input own = { &part->scene, input->photos, input->frame, input->pixels };
    small.photos = part->photos;
    small.n_photos = part->scene.n_views;
    small.held_out = NULL;
    small.n_held_out = 0;
    CN_TRY(cn_plan_effects(&small, &own, options));
    memcpy(tile->effects, small.effects, sizeof tile->effects);
    tile->n_effects = small.n_effects;
    return CN_OK;
}
