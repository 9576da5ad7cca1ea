#include "pose/merge_block.h"

#include "base/clock.h"

#include <stdlib.h>
#include <string.h>

typedef struct block {
    cn_scene scene;           /* its views are copies, whose names are borrowed */
    uint32_t *views, *points; /* their numbers in the whole scene; the group's own views first */
    uint32_t n_own;
    cn_status status;
    char why[200];
} block;

typedef struct sweep {
    const cn_context *ctx;
    const cn_block_task *task;
    uint64_t *first; /* first[v]: of view v in `seen` */
    uint32_t *seen;  /* the points that each view sees */
    uint32_t *colour;
    uint32_t *group_first, *group_views; /* the views of each group */
    block *blocks;                       /* those being adjusted, one a thread */
    const uint32_t *groups;              /* their groups */
    uint32_t **number;                   /* of each view in a thread's block; UINT32_MAX: not there */
} sweep;

static void block_deinit(block *b)
{
    free(b->scene.views);
    free(b->scene.cameras);
    free(b->scene.points);
    free(b->scene.observations);
    free(b->views);
    free(b->points);
    memset(b, 0, sizeof *b);
}

/* ---- Lists ---- */

static bool list_seen(sweep *s)
{
    const cn_scene *scene = s->task->scene;
    s->first = calloc(scene->n_views + (size_t)2, sizeof *s->first);
    s->seen = malloc((scene->n_observations + 1) * sizeof *s->seen);
    if (!s->first || !s->seen) return false;
    for (uint64_t i = 0; i < scene->n_observations; i++)
        s->first[scene->observations[i].view + 2]++;
    for (uint32_t i = 2; i < scene->n_views + 2; i++)
        s->first[i] += s->first[i - 1];
    for (uint32_t i = 0; i < scene->n_points; i++)
        for (uint32_t k = 0; k < scene->points[i].n_observations; k++)
            s->seen[s->first[scene->observations[(uint64_t)scene->points[i].first_observation + k].view + 1]++] = i;
    return true;
}

static bool list_groups(sweep *s)
{
    const cn_scene *scene = s->task->scene;
    s->group_first = calloc(s->task->n_groups + (size_t)2, sizeof *s->group_first);
    s->group_views = malloc((scene->n_views + (size_t)1) * sizeof *s->group_views);
    if (!s->group_first || !s->group_views) return false;
    uint32_t *first = s->group_first;
    for (uint32_t i = 0; i < scene->n_views; i++)
        first[s->task->home[i] + 2]++;
    for (uint32_t i = 2; i < s->task->n_groups + 2; i++)
        first[i] += first[i - 1];
    for (uint32_t i = 0; i < scene->n_views; i++)
        s->group_views[first[s->task->home[i] + 1]++] = i;
    return true;
}

/* Colours groups so that no two of one colour see a point together (greedily, in their order). *n: colours. */
static bool colour_groups(sweep *s, uint32_t *n)
{
    const uint32_t n_groups = s->task->n_groups;
    const cn_scene *scene = s->task->scene;
    uint8_t *meet = calloc((size_t)n_groups * n_groups + 1, 1), *used = malloc(n_groups + (size_t)1);
    s->colour = calloc(n_groups + (size_t)1, sizeof *s->colour);
    bool fine = meet && used && s->colour;
    for (uint32_t i = 0; i < scene->n_points && fine; i++) {
        const cn_observation *o = scene->observations + scene->points[i].first_observation;
        for (uint32_t k = 1; k < scene->points[i].n_observations; k++) {
            const size_t a = s->task->home[o[k].view];
            for (uint32_t j = 0; j < k; j++) {
                const size_t b = s->task->home[o[j].view];
                meet[a * n_groups + b] = meet[b * n_groups + a] = 1;
            }
        }
    }
    *n = 0;
    for (uint32_t i = 0; i < n_groups && fine; i++) {
        memset(used, 0, n_groups);
        for (uint32_t k = 0; k < i; k++)
            if (meet[(size_t)i * n_groups + k]) used[s->colour[k]] = 1;
        while (used[s->colour[i]])
            s->colour[i]++;
        if (s->colour[i] >= *n) *n = s->colour[i] + 1;
    }
    free(meet);
    free(used);
    return fine;
}

/* ---- One group ---- */

static int by_number(const void *a, const void *b)
{
    const uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

/* The points that the group's views see, each once. */
static bool list_points(const sweep *s, uint32_t group, block *b, uint32_t *n)
{
    const uint32_t *views = s->group_views + s->group_first[group];
    const uint32_t n_views = s->group_first[group + 1] - s->group_first[group];
    uint64_t all = 0;
    uint32_t n_all = 0;
    for (uint32_t i = 0; i < n_views; i++)
        all += s->first[views[i] + 1] - s->first[views[i]];
    b->points = malloc((all + 1) * sizeof *b->points);
    if (!b->points) return false;
    for (uint32_t i = 0; i < n_views; i++)
        for (uint64_t k = s->first[views[i]]; k < s->first[views[i] + 1]; k++)
            b->points[n_all++] = s->seen[k];
    qsort(b->points, n_all, sizeof *b->points, by_number);
    *n = 0;
    for (uint32_t i = 0; i < n_all; i++)
        if (!i || b->points[i] != b->points[i - 1]) b->points[(*n)++] = b->points[i];
    return true;
}

static uint32_t add_view(block *b, const cn_scene *from, uint32_t view, uint32_t *number)
{
    if (number[view] == UINT32_MAX) {
        number[view] = b->scene.n_views;
        b->views[b->scene.n_views] = view;
        b->scene.views[b->scene.n_views++] = from->views[view];
    }
    return number[view];
}

static bool fill_block(const sweep *s, uint32_t group, block *b, uint32_t *number)
{
    const cn_scene *from = s->task->scene;
    uint32_t n_points;
    uint64_t n_seen = 0;
    if (!list_points(s, group, b, &n_points)) return false;
    b->n_own = s->group_first[group + 1] - s->group_first[group];
    for (uint32_t i = 0; i < n_points; i++)
        n_seen += from->points[b->points[i]].n_observations;
    const uint64_t most = b->n_own + n_seen < from->n_views ? b->n_own + n_seen : from->n_views;
    cn_scene *to = &b->scene;
    to->views = malloc((most + 1) * sizeof *to->views);
    b->views = malloc((most + 1) * sizeof *b->views);
    to->cameras = malloc((from->n_cameras + (size_t)1) * sizeof *to->cameras);
    to->points = malloc((n_points + (size_t)1) * sizeof *to->points);
    to->observations = malloc((n_seen + 1) * sizeof *to->observations);
    if (!to->views || !b->views || !to->cameras || !to->points || !to->observations) return false;
    memcpy(to->cameras, from->cameras, from->n_cameras * sizeof *to->cameras);
    to->n_cameras = from->n_cameras;
    for (uint32_t i = 0; i < b->n_own; i++)
        (void)add_view(b, from, s->group_views[s->group_first[group] + i], number);
    for (uint32_t i = 0; i < n_points; i++) {
        cn_point point = from->points[b->points[i]];
        const cn_observation *seen = from->observations + point.first_observation;
        point.first_observation = (uint32_t)to->n_observations;
        for (uint32_t k = 0; k < point.n_observations; k++) {
            cn_observation *o = &to->observations[to->n_observations++];
            *o = seen[k];
            o->view = add_view(b, from, seen[k].view, number);
        }
        to->points[to->n_points++] = point;
    }
    for (uint32_t i = 0; i < to->n_views; i++)
        number[b->views[i]] = UINT32_MAX;
    return true;
}

static cn_status adjust_block(const sweep *s, block *b)
{
    const size_t n = b->scene.n_views + (size_t)1;
    cn_place_prior *priors = calloc(n, sizeof *priors);
    bool *fixed = calloc(n, sizeof *fixed);
    cn_status status = priors && fixed ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory adjusting a group");
    if (status == CN_OK) {
        const cn_context quiet = { .stop = s->ctx ? s->ctx->stop : NULL };
        cn_adjust_result result;
        for (uint32_t i = 0; i < b->scene.n_views; i++) {
            fixed[i] = i >= b->n_own;
            if (s->task->priors) priors[i] = s->task->priors[b->views[i]];
        }
        cn_scene_adjustment how = {
            .centres = priors, .fixed = fixed, .keep_lenses = true, .options = s->task->options
        };
        status = cn_scene_adjust(&quiet, &b->scene, &how, &result);
    }
    free(priors);
    free(fixed);
    return status;
}

static void work(void *user, size_t i, unsigned worker)
{
    sweep *s = user;
    block *b = &s->blocks[i];
    b->status = fill_block(s, s->groups[i], b, s->number[worker])
                    ? CN_OK
                    : cn_fail(CN_ERR_NOMEM, "out of memory adjusting a group");
    if (b->status == CN_OK && b->scene.n_observations) b->status = adjust_block(s, b);
    if (b->status != CN_OK) strncpy(b->why, cn_error_message(), sizeof b->why - 1);
}

static void take_back(const sweep *s, const block *b)
{
    for (uint32_t i = 0; i < b->n_own; i++)
        s->task->scene->views[b->views[i]] = b->scene.views[i];
    for (uint32_t i = 0; i < b->scene.n_points; i++)
        memcpy(s->task->scene->points[b->points[i]].xyz, b->scene.points[i].xyz, sizeof b->scene.points[i].xyz);
}

/* ---- All groups ---- */

/* Adjusts groups of one colour, at most as many as there are threads. */
static cn_status adjust_together(sweep *s, const uint32_t *groups, uint32_t n)
{
    cn_status status = CN_OK;
    s->groups = groups;
    cn_pool_run(s->ctx ? s->ctx->pool : NULL, n, work, s);
    for (uint32_t i = 0; i < n; i++) {
        block *b = &s->blocks[i];
        if (b->status == CN_OK)
            take_back(s, b);
        else if (b->status == CN_ERR_DATA)
            cn_log(s->ctx, CN_LOG_WARN, "group %u stays as it is: %s", groups[i] + 1, b->why);
        else if (status == CN_OK)
            status = cn_fail(b->status, "%s", b->why);
        block_deinit(b);
    }
    return status;
}

static cn_status adjust_all(sweep *s, uint32_t n_colours, uint32_t *list)
{
    const unsigned n_threads = cn_pool_threads(s->ctx ? s->ctx->pool : NULL);
    const double began_s = cn_now_s();
    uint32_t done = 0;
    for (uint32_t c = 0; c < n_colours; c++) {
        uint32_t n = 0;
        for (uint32_t i = 0; i < s->task->n_groups; i++)
            if (s->colour[i] == c) list[n++] = i;
        for (uint32_t i = 0; i < n; i += n_threads) {
            const uint32_t some = n - i < n_threads ? n - i : n_threads;
            CN_TRY(adjust_together(s, list + i, some));
            done += some;
            const double spent = cn_now_s() - began_s;
            const cn_progress_report report = { "poses",           "groups", done,
                                                s->task->n_groups, spent,    spent * (s->task->n_groups - done) / done,
                                                "adjusting" };
            cn_progress(s->ctx, &report);
        }
    }
    return CN_OK;
}

static cn_status make_room(sweep *s)
{
    const unsigned n_threads = cn_pool_threads(s->ctx ? s->ctx->pool : NULL);
    s->blocks = calloc(n_threads, sizeof *s->blocks);
    s->number = calloc(n_threads, sizeof *s->number);
    bool fine = s->blocks && s->number && list_seen(s) && list_groups(s);
    for (unsigned i = 0; i < n_threads && fine; i++) {
        s->number[i] = malloc((s->task->scene->n_views + (size_t)1) * sizeof **s->number);
        fine = s->number[i] != NULL;
        if (fine) memset(s->number[i], 0xff, s->task->scene->n_views * sizeof **s->number);
    }
    return fine ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory adjusting groups");
}

cn_status cn_blocks_adjust(const cn_context *ctx, const cn_block_task *task)
{
    sweep s = { .ctx = ctx, .task = task };
    uint32_t n_colours = 0, *list = malloc((task->n_groups + (size_t)1) * sizeof *list);
    cn_status status = list ? make_room(&s) : cn_fail(CN_ERR_NOMEM, "out of memory adjusting groups");
    if (status == CN_OK && !colour_groups(&s, &n_colours))
        status = cn_fail(CN_ERR_NOMEM, "out of memory adjusting groups");
    if (status == CN_OK) status = adjust_all(&s, n_colours, list);
    for (unsigned i = 0; s.number && i < cn_pool_threads(ctx ? ctx->pool : NULL); i++)
        free(s.number[i]);
    free(s.number);
    free(s.blocks);
    free(s.first);
    free(s.seen);
    free(s.colour);
    free(s.group_first);
    free(s.group_views);
    free(list);
    return status;
}
