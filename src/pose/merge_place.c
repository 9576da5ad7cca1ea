/* One similarity for each group's model: from what neighbours share, and from GPS. */
#include "bridge/join.h"
#include "math/linalg.h"
#include "pose/adjust.h"
#include "pose/align.h"
#include "pose/control_fit.h"
#include "pose/merge.h"
#include "pose/scene.h"
#include "pose/similarity.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define ERROR_SHARE 0.02     /* of the distance of what is seen: points farther apart than this are not the same */
#define LEAST_SHARE 0.2      /* of what two models share, that has to agree */
#define SIGMA_SHARE 5e-4     /* of the same distance: no tie is better */
#define VERTICAL_WEIGHT 0.33 /* as in align.c */
#define SEED 1
enum { MOST_POINTS = 1000, LEAST_INLIERS = 6, TIE_POINTS = 40, TIE_PHOTOS = 24, SAMPLES = 301, CORNERS = 3 };

/* Two models tied. */
typedef struct tied {
    uint32_t a, b, n_inliers;
    cn_similarity b_from_a;
    double rms; /* of inliers, in b's units */
    size_t first_tie, n_ties;
} tied;

typedef struct placing {
    const cn_context *ctx;
    const cn_merge_task *task;
    const cn_group_links *links;
    double *depth; /* of each model: median distance from cameras to points, or between cameras */
    tied *tied;
    uint32_t n_tied;
    cn_join_tie *ties; /* sigma: in units of b until the models are placed */
    size_t n_ties;
    uint32_t *part;  /* of each model: the first model of its connected part; UINT32_MAX: no model */
    uint32_t *giver; /* of each photo: the model that its pose is taken from */
    cn_group_place *places;
} placing;

/* ---- Pairs of models ---- */

/* How much longer lengths are in b: distances from a shared camera to the points that both see; without points, between
 * shared cameras. */
static double relative_scale(const placing *p, const cn_group_link *link)
{
    const cn_scene *a = &p->task->models[link->a], *b = &p->task->models[link->b];
    const cn_shared_photo *photos = p->links->photos + link->first_photo;
    double ratios[SAMPLES], ca[3], cb[3];
    size_t n = 0;
    cn_view_centre(&a->views[photos[0].a], ca);
    cn_view_centre(&b->views[photos[0].b], cb);
    const uint32_t step = link->n_points / SAMPLES + 1;
    for (uint32_t i = 0; i < link->n_points && n < SAMPLES; i += step) {
        const cn_shared_point *point = &p->links->points[link->first_point + i];
        const double in_a = cn_distance3(a->points[point->a].xyz, ca), in_b = cn_distance3(b->points[point->b].xyz, cb);
        if (in_a > 0 && in_b > 0) ratios[n++] = in_b / in_a;
    }
    for (uint32_t i = 1; i < link->n_photos && link->n_points < LEAST_INLIERS && n < SAMPLES; i++) {
        double da[3], db[3];
        cn_view_centre(&a->views[photos[i].a], da);
        cn_view_centre(&b->views[photos[i].b], db);
        const double in_a = cn_distance3(da, ca), in_b = cn_distance3(db, cb);
        if (in_a > 0 && in_b > 0) ratios[n++] = in_b / in_a;
    }
    return n ? cn_select(ratios, n, n / 2) : p->depth[link->b] / p->depth[link->a];
}

/* The camera's centre, and places before it and beside it: they carry its rotation. */
static void corners_of(const cn_view *view, double away, double (*out)[3])
{
    cn_view_centre(view, out[0]);
    for (int k = 0; k < 3; k++) {
        out[1][k] = out[0][k] + away * view->rotation[6 + k];
        out[2][k] = out[0][k] + away * view->rotation[k];
    }
}

/* What both models know: corners of shared cameras, then shared points. Returns how many; the arrays have room. */
static uint32_t gather(const placing *p, const cn_group_link *link, double (*source)[3], double (*target)[3])
{
    const cn_scene *a = &p->task->models[link->a], *b = &p->task->models[link->b];
    const double scale = relative_scale(p, link), away = p->depth[link->a];
    uint32_t n = 0;
    for (uint32_t i = 0; i < link->n_photos; i++, n += CORNERS) {
        const cn_shared_photo *photo = &p->links->photos[link->first_photo + i];
        corners_of(&a->views[photo->a], away, source + n);
        corners_of(&b->views[photo->b], scale * away, target + n);
    }
    const uint32_t step = link->n_points / MOST_POINTS + 1;
    for (uint32_t i = 0; i < link->n_points; i += step, n++) {
        const cn_shared_point *point = &p->links->points[link->first_point + i];
        memcpy(source[n], a->points[point->a].xyz, sizeof source[n]);
        memcpy(target[n], b->points[point->b].xyz, sizeof target[n]);
    }
    return n;
}

/* What two models were found to share. */
typedef struct common {
    const double (*source)[3], (*target)[3];
    const bool *inlier;
    uint32_t n, n_corners; /* all; those of cameras, which come first */
} common;

/* Keeps some of the inliers as ties: every so many of the cameras' centres and of the points. */
static void keep_ties(placing *p, tied *t, const common *c)
{
    const uint32_t photo_step = c->n_corners / CORNERS / TIE_PHOTOS + 1;
    const uint32_t point_step = (c->n - c->n_corners) / TIE_POINTS + 1;
    t->first_tie = p->n_ties;
    for (uint32_t i = 0; i < c->n; i++) {
        const bool wanted = i < c->n_corners ? i % (CORNERS * photo_step) == 0 : (i - c->n_corners) % point_step == 0;
        if (!wanted || !c->inlier[i]) continue;
        cn_join_tie *tie = &p->ties[p->n_ties++];
        *tie = (cn_join_tie){ .a = t->a, .b = t->b };
        memcpy(tie->in_a, c->source[i], sizeof tie->in_a);
        memcpy(tie->in_b, c->target[i], sizeof tie->in_b);
    }
    t->n_ties = p->n_ties - t->first_tie;
    /* Errors of neighbouring points are alike, because models bend: many ties are worth no more than a few. */
    const double sigma = fmax(t->rms, SIGMA_SHARE * p->depth[t->b]) * fmax(1.0, sqrt((double)t->n_ties) / 3.0);
    for (size_t i = t->first_tie; i < p->n_ties; i++)
        p->ties[i].sigma = sigma;
}

static cn_status tie(placing *p, const cn_group_link *link)
{
    const size_t room = CORNERS * (size_t)link->n_photos + MOST_POINTS + 2;
    double(*source)[3] = malloc(2 * room * sizeof *source), (*target)[3] = source + room;
    bool *inlier = calloc(room, sizeof *inlier);
    tied t = { .a = link->a, .b = link->b };
    cn_status status = source && inlier ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory tying groups");
    if (status == CN_OK) {
        const uint32_t n = gather(p, link, source, target);
        const cn_similarity_task task = {
            n, (const double(*)[3])source, (const double(*)[3])target, ERROR_SHARE * p->depth[link->b], 1.0, SEED, NULL
        };
        status = cn_pose_fit_similarity(&task, &t.b_from_a, inlier);
        double square = 0.0;
        for (uint32_t i = 0; i < n && status == CN_OK; i++) {
            double at[3];
            if (!inlier[i]) continue;
            cn_similarity_apply(&t.b_from_a, source[i], at);
            const double off = cn_distance3(at, target[i]);
            square += off * off;
            t.n_inliers++;
        }
        if (status == CN_OK && t.n_inliers >= LEAST_INLIERS && t.n_inliers >= LEAST_SHARE * n) {
            t.rms = sqrt(square / t.n_inliers);
            keep_ties(p, &t, &(common){ task.source, task.target, inlier, n, CORNERS * link->n_photos });
            p->tied[p->n_tied++] = t;
        }
        if (status == CN_ERR_DATA) status = CN_OK; /* these two are not tied */
    }
    free(source);
    free(inlier);
    return status;
}

/* ---- Spanning tree ---- */

static int by_strength(const void *a, const void *b)
{
    const tied *x = *(const tied *const *)a, *y = *(const tied *const *)b;
    if (x->n_inliers != y->n_inliers) return x->n_inliers > y->n_inliers ? -1 : 1;
    return (x > y) - (x < y);
}

static void invert(const cn_similarity *s, cn_similarity *out)
{
    double moved[3];
    out->scale = 1.0 / s->scale;
    cn_mat3_transpose(s->rotation, out->rotation);
    cn_mat3_vec(out->rotation, s->translation, moved);
    for (int k = 0; k < 3; k++)
        out->translation[k] = -moved[k] / s->scale;
}

/* out = a after b */
static void compose(const cn_similarity *a, const cn_similarity *b, cn_similarity *out)
{
    cn_similarity made = { .scale = a->scale * b->scale };
    cn_mat3_mul(a->rotation, b->rotation, made.rotation);
    cn_similarity_apply(a, b->translation, made.translation);
    *out = made;
}

/* Moves every model of part `from` by `s` and makes it part of `to`. */
static void absorb(placing *p, uint32_t from, uint32_t to, const cn_similarity *s)
{
    for (uint32_t i = 0; i < p->task->groups->n; i++)
        if (p->part[i] == from) {
            compose(s, &p->places[i].to_world, &p->places[i].to_world);
            p->part[i] = to;
        }
}

/* The strongest ties first (Kruskal 1956): each that joins two parts places the one in the frame of the other. */
static cn_status grow_tree(placing *p)
{
    const tied **order = malloc((p->n_tied + (size_t)1) * sizeof *order);
    if (!order) return cn_fail(CN_ERR_NOMEM, "out of memory tying groups");
    for (uint32_t i = 0; i < p->n_tied; i++)
        order[i] = &p->tied[i];
    qsort(order, p->n_tied, sizeof *order, by_strength);
    for (uint32_t i = 0; i < p->n_tied; i++) {
        const tied *t = order[i];
        const uint32_t pa = p->part[t->a], pb = p->part[t->b];
        cn_similarity back, moved, a_from_b;
        if (pa == pb) continue;
        invert(&t->b_from_a, &a_from_b);
        if (pa < pb) {
            invert(&p->places[t->b].to_world, &back);
            compose(&a_from_b, &back, &moved);
            compose(&p->places[t->a].to_world, &moved, &moved);
            absorb(p, pb, pa, &moved);
        } else {
            invert(&p->places[t->a].to_world, &back);
            compose(&t->b_from_a, &back, &moved);
            compose(&p->places[t->b].to_world, &moved, &moved);
            absorb(p, pa, pb, &moved);
        }
    }
    free(order);
    return CN_OK;
}

/* ---- GPS ---- */

static bool gives(const placing *p, uint32_t model, uint32_t view)
{
    const uint32_t photo = p->task->models[model].views[view].photo;
    return photo != UINT32_MAX && p->giver[photo] == model;
}

/* The views of one part's models (UINT32_MAX: of all placed ones), each photo once, in the part's frame. Names are
 * borrowed; the caller frees the array. */
static cn_status views_of(const placing *p, uint32_t part, cn_scene *out)
{
    size_t n = 0;
    *out = (cn_scene){ 0 };
    for (uint32_t m = 0; m < p->task->groups->n; m++)
        n += p->task->models[m].n_views;
    out->views = malloc((n + 1) * sizeof *out->views);
    if (!out->views) return cn_fail(CN_ERR_NOMEM, "out of memory placing groups");
    for (uint32_t m = 0; m < p->task->groups->n; m++) {
        const cn_scene *model = &p->task->models[m];
        if (part == UINT32_MAX ? !p->places[m].placed : p->part[m] != part) continue;
        const cn_similarity *s = &p->places[m].to_world;
        cn_scene mine = { .views = out->views + out->n_views };
        for (uint32_t i = 0; i < model->n_views; i++)
            if (gives(p, m, i)) mine.views[mine.n_views++] = model->views[i];
        cn_scene_transform(&mine, s->scale, s->rotation, s->translation);
        out->n_views += mine.n_views;
    }
    return CN_OK;
}

static uint32_t largest_part(const placing *p)
{
    uint32_t best = UINT32_MAX;
    uint64_t most = 0;
    for (uint32_t i = 0; i < p->task->groups->n; i++) {
        uint64_t n = 0;
        if (p->part[i] != i) continue;
        for (uint32_t k = i; k < p->task->groups->n; k++)
            n += p->part[k] == i ? p->task->models[k].n_views : 0;
        if (n > most) {
            most = n;
            best = i;
        }
    }
    return best;
}

static void place_part(placing *p, uint32_t part, const cn_similarity *s)
{
    for (uint32_t i = 0; i < p->task->groups->n; i++)
        if (p->part[i] == part) {
            compose(s, &p->places[i].to_world, &p->places[i].to_world);
            p->places[i].placed = true;
        }
}

/* The largest part gives the frame. */
static cn_status place_largest(placing *p, uint32_t part, cn_frame *frame)
{
    cn_scene views;
    CN_TRY(views_of(p, part, &views));
    const cn_status status =
        cn_align(p->ctx, &views, p->task->index, p->task->options->max_error_m, CN_LEVEL_ALWAYS, frame);
    free(views.views);
    CN_TRY(status);
    cn_similarity s = { .scale = frame->scale };
    memcpy(s.rotation, frame->rotation, sizeof s.rotation);
    memcpy(s.translation, frame->translation, sizeof s.translation);
    place_part(p, part, &s);
    return CN_OK;
}

/* Priors of the views' centres by GPS, in the frame. The caller frees *priors. */
static cn_status priors_of(const placing *p, const cn_scene *views, const cn_frame *frame, cn_place_prior **priors)
{
    *priors = calloc(views->n_views + (size_t)1, sizeof **priors);
    if (!*priors) return cn_fail(CN_ERR_NOMEM, "out of memory placing groups");
    return frame->georeferenced ? cn_control_gps(views, p->task->index, frame, *priors) : CN_OK;
}

/* Places a part that nothing but its GPS ties to the others. */
static cn_status place_by_gps(placing *p, uint32_t part, const cn_frame *frame)
{
    cn_scene views;
    cn_similarity s;
    CN_TRY(views_of(p, part, &views));
    cn_status status = cn_align_into(&views, p->task->index, p->task->options->max_error_m, frame, &s);
    if (status == CN_OK) place_part(p, part, &s);
    if (status == CN_ERR_DATA) status = CN_OK; /* it stays apart */
    free(views.views);
    return status;
}

/* ---- All similarities together ---- */

static void middle_of(const cn_scene *scene, double middle[3])
{
    memset(middle, 0, 3 * sizeof *middle);
    for (uint32_t i = 0; i < scene->n_views; i++) {
        double centre[3];
        cn_view_centre(&scene->views[i], centre);
        for (int k = 0; k < 3; k++)
            middle[k] += centre[k] / scene->n_views;
    }
}

/* Models without a place are left out: their number in *number is UINT32_MAX. */
static uint32_t list_models(const placing *p, bool fix_first, cn_join_model *models, uint32_t *number)
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < p->task->groups->n; i++) {
        const cn_similarity *s = &p->places[i].to_world;
        number[i] = p->places[i].placed ? n : UINT32_MAX;
        if (!p->places[i].placed) continue;
        cn_join_model *m = &models[n];
        *m = (cn_join_model){ .scale = s->scale, .fixed = fix_first && n == 0 };
        memcpy(m->rotation, s->rotation, sizeof m->rotation);
        middle_of(&p->task->models[i], m->centre);
        cn_similarity_apply(s, m->centre, m->place);
        n++;
    }
    return n;
}

static size_t list_ties(const placing *p, const uint32_t *number, cn_join_tie *out)
{
    size_t n = 0;
    for (size_t i = 0; i < p->n_ties; i++) {
        cn_join_tie tie = p->ties[i];
        if (number[tie.a] == UINT32_MAX || number[tie.b] == UINT32_MAX) continue;
        tie.sigma *= p->places[tie.b].to_world.scale;
        tie.a = number[tie.a];
        tie.b = number[tie.b];
        out[n++] = tie;
    }
    return n;
}

/* views: those of all placed models, in their order. */
static size_t list_anchors(const placing *p, const uint32_t *number, const cn_place_prior *priors, cn_join_anchor *out)
{
    size_t n = 0;
    uint32_t view = 0;
    for (uint32_t m = 0; m < p->task->groups->n; m++) {
        if (number[m] == UINT32_MAX) continue;
        for (uint32_t i = 0; i < p->task->models[m].n_views; i++) {
            if (!gives(p, m, i)) continue;
            const cn_place_prior *prior = &priors[view++];
            if (!(prior->sigma[0] > 0)) continue;
            cn_join_anchor *a = &out[n++];
            *a = (cn_join_anchor){ .model = number[m] };
            cn_view_centre(&p->task->models[m].views[i], a->at);
            memcpy(a->place, prior->place, sizeof a->place);
            memcpy(a->sigma, prior->sigma, sizeof a->sigma);
        }
    }
    return n;
}

static void take_places(placing *p, const cn_join_model *models, const uint32_t *number)
{
    for (uint32_t i = 0; i < p->task->groups->n; i++) {
        if (number[i] == UINT32_MAX) continue;
        const cn_join_model *m = &models[number[i]];
        cn_similarity *s = &p->places[i].to_world;
        double turned[3];
        s->scale = m->scale;
        memcpy(s->rotation, m->rotation, sizeof s->rotation);
        cn_mat3_vec(m->rotation, m->centre, turned);
        for (int k = 0; k < 3; k++)
            s->translation[k] = m->place[k] - m->scale * turned[k];
    }
}

static cn_status join(placing *p, const cn_frame *frame)
{
    cn_scene views;
    cn_place_prior *priors = NULL;
    CN_TRY(views_of(p, UINT32_MAX, &views));
    const size_t n_groups = p->task->groups->n;
    cn_join_model *models = malloc((n_groups + 1) * sizeof *models);
    uint32_t *number = malloc((n_groups + 1) * sizeof *number);
    cn_join_anchor *anchors = malloc((views.n_views + (size_t)1) * sizeof *anchors);
    cn_join_tie *ties = malloc((p->n_ties + 1) * sizeof *ties);
    cn_status status = models && number && anchors && ties ? priors_of(p, &views, frame, &priors)
                                                           : cn_fail(CN_ERR_NOMEM, "out of memory placing groups");
    if (status == CN_OK) {
        cn_join_problem problem = { .models = models, .ties = ties, .anchors = anchors };
        problem.n_models = list_models(p, !frame->georeferenced, models, number);
        problem.n_ties = list_ties(p, number, ties);
        problem.n_anchors = list_anchors(p, number, priors, anchors);
        if (problem.n_models > 1) {
            status = cn_ceres_join(p->ctx, &problem);
            if (status == CN_OK) take_places(p, models, number);
        }
    }
    free(views.views);
    free(priors);
    free(models);
    free(number);
    free(anchors);
    free(ties);
    return status;
}

/* ---- What became of the groups ---- */

static double measure(const placing *p, const tied *t, double *square)
{
    const cn_join_tie *ties = p->ties + t->first_tie;
    for (size_t i = 0; i < t->n_ties; i++) {
        double a[3], b[3];
        cn_similarity_apply(&p->places[t->a].to_world, ties[i].in_a, a);
        cn_similarity_apply(&p->places[t->b].to_world, ties[i].in_b, b);
        const double off = cn_distance3(a, b);
        *square += off * off;
    }
    return (double)t->n_ties;
}

static cn_status describe(const placing *p, cn_merge_report *report)
{
    const size_t n = p->task->groups->n;
    double *sums = calloc(2 * n + 1, sizeof *sums);
    if (!sums) return cn_fail(CN_ERR_NOMEM, "out of memory placing groups");
    for (uint32_t i = 0; i < p->n_tied; i++) {
        const tied *t = &p->tied[i];
        double square = 0.0;
        if (!p->places[t->a].placed || !p->places[t->b].placed) continue;
        const double count = measure(p, t, &square);
        const uint32_t both[2] = { t->a, t->b };
        for (int k = 0; k < 2; k++) {
            sums[2 * both[k]] += square;
            sums[2 * both[k] + 1] += count;
            report->groups[both[k]].n_links++;
        }
    }
    for (uint32_t i = 0; i < n; i++) {
        cn_group_report *g = &report->groups[i];
        g->n_posed = p->task->models[i].n_views;
        g->fate = !g->n_posed ? CN_GROUP_MISSING : p->places[i].placed ? CN_GROUP_JOINED : CN_GROUP_APART;
        g->tie_rms_m = sums[2 * i + 1] > 0 ? sqrt(sums[2 * i] / sums[2 * i + 1]) : NAN;
        report->n_joined += g->fate == CN_GROUP_JOINED;
    }
    free(sums);
    return CN_OK;
}

static cn_status tie_all(placing *p)
{
    const uint32_t n = p->task->groups->n;
    p->depth = malloc((n + (size_t)1) * sizeof *p->depth);
    p->part = malloc((n + (size_t)1) * sizeof *p->part);
    p->tied = calloc(p->links->n + (size_t)1, sizeof *p->tied);
    p->ties = malloc(((size_t)p->links->n * (TIE_PHOTOS + TIE_POINTS + 4) + 1) * sizeof *p->ties);
    if (!p->depth || !p->part || !p->tied || !p->ties) return cn_fail(CN_ERR_NOMEM, "out of memory tying groups");
    for (uint32_t i = 0; i < n; i++) {
        const bool there = p->task->models[i].n_views > 0;
        p->depth[i] = there ? cn_scene_median_depth(&p->task->models[i]) : 1.0;
        p->part[i] = there ? i : UINT32_MAX;
        p->places[i] = (cn_group_place){ .to_world = { .scale = 1.0, .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 } } };
    }
    for (uint32_t i = 0; i < p->links->n; i++) {
        if (cn_stopping(p->ctx)) return cn_fail(CN_ERR_INTERRUPTED, "stopped while placing groups");
        CN_TRY(tie(p, &p->links->links[i]));
    }
    return grow_tree(p);
}

static cn_status place_all(placing *p, cn_frame *frame)
{
    p->giver = malloc((p->task->index->n_photos + (size_t)1) * sizeof *p->giver);
    if (!p->giver) return cn_fail(CN_ERR_NOMEM, "out of memory placing groups");
    cn_group_givers(p->task, NULL, p->giver);
    CN_TRY(tie_all(p));
    const uint32_t largest = largest_part(p);
    if (largest == UINT32_MAX) return cn_fail(CN_ERR_DATA, "none of the %u groups has a pose", p->task->groups->n);
    CN_TRY(place_largest(p, largest, frame));
    for (uint32_t i = 0; i < p->task->groups->n && frame->georeferenced; i++)
        if (p->part[i] == i && i != largest) CN_TRY(place_by_gps(p, i, frame));
    return join(p, frame);
}

cn_status cn_groups_place(const cn_context *ctx, const cn_merge_task *task, const cn_group_links *links,
                          cn_group_place *places, cn_frame *frame, cn_merge_report *report)
{
    placing p = { .ctx = ctx, .task = task, .links = links, .places = places };
    cn_status status = place_all(&p, frame);
    if (status == CN_OK) status = describe(&p, report);
    free(p.depth);
    free(p.part);
    free(p.giver);
    free(p.tied);
    free(p.ties);
    return status;
}
