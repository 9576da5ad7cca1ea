/* The default flight: a uniform cubic B-spline over some of the scene's views. A B-spline never leaves the convex hull
 * of its control points, which a Catmull-Rom spline does at sharp turns, and there the photos show nothing. It is also
 * smooth when the views are not. Where a house stands between two views, more control points lead round it. Parts of a
 * city whose photos share no sparse point are flown one after the other, with a cut between them: nothing is known of
 * the places between. Views that stand alone, far from all others, are left out. */
#include "path/path.h"

#include "base/disjoint.h"
#include "base/units.h"
#include "math/linalg.h"
#include "path/free_space.h"
#include "path/lone.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MAX_VIEWS 24u
#define STEPS_PER_SEGMENT 32u
/* A detour's control points are this many cells of free space apart: then the spline is near its corners. */
#define DETOUR_CELLS 3
/* The spline cuts corners. Where that costs this much more than free space, it gets control points that are nearer to
 * each other, a few times. */
#define CUT_COSTS 1.5
#define MAX_CUTS 3

typedef struct control {
    double centre[3], quat[4];
    uint32_t part;    /* of the city: a view of it */
    bool shares_none; /* points with another view */
} control;

typedef struct spline {
    control *controls;
    uint32_t n;
} spline;

static int compare_doubles(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Median over the views of the vertical field of view of their pinhole part. */
static cn_status median_vfov(const cn_scene *scene, double *vfov_deg)
{
    double *angles = malloc(sizeof *angles * scene->n_views);
    if (!angles) return cn_fail(CN_ERR_NOMEM, "out of memory for the default camera path");
    for (uint32_t i = 0; i < scene->n_views; i++)
        angles[i] = cn_path_vfov_deg(scene, i);
    qsort(angles, scene->n_views, sizeof *angles, compare_doubles);
    *vfov_deg = angles[scene->n_views / 2];
    free(angles);
    return CN_OK;
}

/* For every i, moves the control point nearest to controls[i] to index i + 1: a greedy tour from the first. */
static void order_by_nearest(spline *s)
{
    for (uint32_t i = 0; i + 2 < s->n; i++) {
        uint32_t best = i + 1;
        for (uint32_t j = i + 2; j < s->n; j++)
            if (cn_distance3(s->controls[i].centre, s->controls[j].centre) <
                cn_distance3(s->controls[i].centre, s->controls[best].centre))
                best = j;
        control moved = s->controls[best];
        s->controls[best] = s->controls[i + 1];
        s->controls[i + 1] = moved;
    }
}

/* Without the steps from part to part. */
static double tour_length(const spline *s)
{
    double length = 0;
    for (uint32_t i = 0; i + 1 < s->n; i++)
        if (s->controls[i].part == s->controls[i + 1].part)
            length += cn_distance3(s->controls[i].centre, s->controls[i + 1].centre);
    return length;
}

enum { ANY_PART = UINT32_MAX };

/* part[i]: the same for views that share points, be it by way of other views. ANY_PART: the view shares none. */
static cn_status find_parts(const cn_scene *scene, uint32_t **part)
{
    *part = malloc((scene->n_views + (size_t)1) * sizeof **part);
    if (!*part) return cn_fail(CN_ERR_NOMEM, "out of memory for the default camera path");
    bool *shares = calloc(scene->n_views + (size_t)1, sizeof *shares);
    if (!shares) {
        free(*part);
        return cn_fail(CN_ERR_NOMEM, "out of memory for the default camera path");
    }
    for (uint32_t i = 0; i < scene->n_views; i++)
        (*part)[i] = i;
    for (uint32_t p = 0; p < scene->n_points; p++) {
        const cn_observation *seen = scene->observations + scene->points[p].first_observation;
        for (uint32_t i = 1; i < scene->points[p].n_observations; i++) {
            (*part)[cn_root_of(*part, seen[i].view)] = cn_root_of(*part, seen[0].view);
            shares[seen[i].view] = shares[seen[0].view] = true;
        }
    }
    for (uint32_t i = 0; i < scene->n_views; i++)
        (*part)[i] = cn_root_of(*part, i);
    for (uint32_t i = 0; i < scene->n_views; i++)
        if (!shares[i]) (*part)[i] = ANY_PART;
    free(shares);
    return CN_OK;
}

/* Those of any part are of that of the nearest control that has one. */
static void settle_parts(spline *s)
{
    for (uint32_t i = 0; i < s->n; i++) {
        double nearest = INFINITY;
        if (!s->controls[i].shares_none) continue;
        for (uint32_t k = 0; k < s->n; k++) {
            const control *other = &s->controls[k];
            const double distance = cn_distance3(s->controls[i].centre, other->centre);
            if (other->shares_none || distance >= nearest) continue;
            nearest = distance;
            s->controls[i].part = other->part;
        }
    }
}

/* Brings the controls of each part together, in the order in which the parts come first. */
static void order_by_part(spline *s)
{
    for (uint32_t i = 1; i < s->n; i++) {
        uint32_t last = s->n; /* of the controls before i, the last one of its part */
        for (uint32_t k = 0; k < i; k++)
            if (s->controls[k].part == s->controls[i].part) last = k;
        if (last == s->n) continue;
        const control moved = s->controls[i];
        memmove(&s->controls[last + 2], &s->controls[last + 1], (i - last - 1) * sizeof moved);
        s->controls[last + 1] = moved;
    }
}

/* The views to fly by, in the order of their names. The caller frees them. */
static cn_status list_views(const cn_scene *scene, const uint32_t *part, uint32_t **views, uint32_t *n)
{
    bool *lone = calloc(scene->n_views, sizeof *lone);
    *views = cn_path_by_name(scene);
    *n = 0;
    cn_status status = lone && *views ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the default camera path");
    if (status == CN_OK) status = cn_path_find_lone(scene, part, lone);
    for (uint32_t i = 0; status == CN_OK && i < scene->n_views; i++)
        if (!lone[(*views)[i]]) (*views)[(*n)++] = (*views)[i];
    free(lone);
    if (status != CN_OK) free(*views);
    return status;
}

/* controls: room for MAX_VIEWS. */
static cn_status choose_views(const cn_scene *scene, const uint32_t *part, spline *s)
{
    control nearest[MAX_VIEWS];
    uint32_t *order, n;
    CN_TRY(list_views(scene, part, &order, &n));
    s->n = n < MAX_VIEWS ? n : MAX_VIEWS;
    for (uint32_t i = 0; i < s->n; i++) {
        const uint32_t view = order[s->n > 1 ? (uint64_t)i * (n - 1) / (s->n - 1) : 0];
        cn_view_centre(&scene->views[view], s->controls[i].centre);
        cn_path_rotation(scene, view, s->controls[i].quat);
        s->controls[i].part = part[view];
        s->controls[i].shares_none = part[view] == ANY_PART;
    }
    free(order);
    settle_parts(s);
    order_by_part(s);
    /* Names of photos by different people have no order: then fly from each view to the nearest one left. */
    spline by_nearest = { nearest, s->n };
    memcpy(nearest, s->controls, s->n * sizeof *nearest);
    order_by_nearest(&by_nearest);
    order_by_part(&by_nearest);
    if (tour_length(s) > 1.6 * tour_length(&by_nearest)) memcpy(s->controls, nearest, s->n * sizeof *nearest);
    for (uint32_t i = 1; i < s->n; i++) {
        /* q and -q are the same rotation; choose signs so that neighbours do not cancel in the mean */
        double *q = s->controls[i].quat, *before = s->controls[i - 1].quat, dot = 0;
        for (int k = 0; k < 4; k++)
            dot += q[k] * before[k];
        for (int k = 0; k < 4 && dot < 0; k++)
            q[k] = -q[k];
    }
    return CN_OK;
}

/* u in [0, segments]. The end points are repeated three times, so the flight begins and ends at views. */
static double segments(const spline *s)
{
    return s->n + 1.0;
}

static void evaluate(const spline *s, double u, double centre[3], double quat[4])
{
    double first = fmin(floor(u), segments(s) - 1), t = u - first;
    double basis[4] = { (1 - t) * (1 - t) * (1 - t) / 6, (3 * t * t * t - 6 * t * t + 4) / 6,
                        (-3 * t * t * t + 3 * t * t + 3 * t + 1) / 6, t * t * t / 6 };
    memset(centre, 0, sizeof(double[3]));
    memset(quat, 0, sizeof(double[4]));
    for (int j = 0; j < 4; j++) {
        double index = fmin(fmax(first + j - 2, 0), s->n - 1.0);
        const control *c = &s->controls[(uint32_t)index];
        for (int k = 0; k < 3; k++)
            centre[k] += basis[j] * c->centre[k];
        for (int k = 0; k < 4; k++)
            quat[k] += basis[j] * c->quat[k];
    }
}

static bool append(spline *s, control c)
{
    /* The room doubles at each power of two. */
    if (!(s->n & (s->n - 1))) {
        control *more = realloc(s->controls, (s->n ? 2 * (size_t)s->n : 1) * sizeof *more);
        if (!more) return false;
        s->controls = more;
    }
    s->controls[s->n++] = c;
    return true;
}

static control between(const control *a, const control *b, double t)
{
    control c = *a;
    for (int k = 0; k < 3; k++)
        c.centre[k] = a->centre[k] + t * (b->centre[k] - a->centre[k]);
    for (int k = 0; k < 4; k++)
        c.quat[k] = a->quat[k] + t * (b->quat[k] - a->quat[k]);
    return c;
}

/* Control points from a, which is there, by the corners to b. The camera turns evenly along the way. */
static bool append_detour(spline *s, const control *a, const control *b, size_t n, const double (*corner)[3],
                          double spacing)
{
    double length = 0, passed = 0;
    for (size_t i = 0; i <= n; i++)
        length += cn_distance3(i ? corner[i - 1] : a->centre, i < n ? corner[i] : b->centre);
    for (size_t i = 0; i <= n; i++) {
        const double *from = i ? corner[i - 1] : a->centre, *to = i < n ? corner[i] : b->centre,
                     leg = cn_distance3(from, to);
        const uint32_t parts = n ? (uint32_t)fmax(ceil(leg / spacing), 1) : 1;
        for (uint32_t j = 1; j <= parts; j++) {
            const double t = (double)j / parts;
            control c = between(a, b, length > 0 ? (passed + t * leg) / length : 1);
            for (int k = 0; k < 3; k++)
                c.centre[k] = from[k] + t * (to[k] - from[k]);
            if (!append(s, c)) return false;
        }
        passed += leg;
    }
    return true;
}

/* Leads the spline from view to view round what stands between them. */
static cn_status avoid(const cn_free_space *space, const spline *views, spline *s)
{
    bool ok = append(s, views->controls[0]);
    for (uint32_t i = 0; ok && i + 1 < views->n; i++) {
        double(*corners)[3];
        size_t n;
        const control *a = &views->controls[i], *b = a + 1;
        CN_TRY(cn_free_space_route(space, a->centre, b->centre, &corners, &n));
        ok = append_detour(s, a, b, n, (const double(*)[3])corners, DETOUR_CELLS * space->edge);
        free(corners);
    }
    return ok ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the default camera path");
}

/* Whether the spline meets more than its control points' lines do, between controls i and i + 1. */
static bool cuts(const cn_free_space *space, const spline *s, uint32_t i)
{
    double cost = 0, length = 0, before[3], here[3], quat[4];
    evaluate(s, i + 1, before, quat);
    for (int k = 1; k <= 8; k++) {
        evaluate(s, i + 1 + k / 8.0, here, quat);
        cost += cn_free_space_line(space, before, here);
        length += cn_distance3(before, here);
        memcpy(before, here, sizeof before);
    }
    const double *a = s->controls[i].centre, *b = s->controls[i + 1].centre;
    return cost * cn_distance3(a, b) > CUT_COSTS * length * cn_free_space_line(space, a, b);
}

/* A control point in the middle of each line beside a place where the spline cuts a corner. */
static cn_status follow_closely(const cn_free_space *space, spline *s)
{
    bool any = space->cost != NULL;
    for (int round = 0; any && round < MAX_CUTS; round++) {
        spline finer = { 0 };
        bool before = false, here = s->n > 1 && cuts(space, s, 0), ok = append(&finer, s->controls[0]);
        any = here;
        for (uint32_t i = 0; ok && i + 1 < s->n; i++) {
            const bool after = i + 2 < s->n && cuts(space, s, i + 1);
            any = any || after;
            if (before || here || after) ok = append(&finer, between(&s->controls[i], &s->controls[i + 1], 0.5));
            ok = ok && append(&finer, s->controls[i + 1]);
            before = here;
            here = after;
        }
        free(ok ? s->controls : finer.controls);
        if (!ok) return cn_fail(CN_ERR_NOMEM, "out of memory for the default camera path");
        *s = finer;
    }
    return CN_OK;
}

/* Lengths along the spline up to each of its steps, so that frames can be spaced evenly over the ground. */
static uint32_t measure(const spline *s, double *length)
{
    uint32_t n = (uint32_t)segments(s) * STEPS_PER_SEGMENT;
    double before[3], here[3], quat[4];
    length[0] = 0;
    evaluate(s, 0, before, quat);
    for (uint32_t i = 1; i <= n; i++) {
        evaluate(s, (double)i / STEPS_PER_SEGMENT, here, quat);
        length[i] = length[i - 1] + cn_distance3(before, here);
        memcpy(before, here, sizeof before);
    }
    return n;
}

/* The flight over one part, and lengths along it. */
typedef struct piece {
    spline spline;
    double *length;
    uint32_t n; /* of its steps */
} piece;

static void pieces_deinit(piece *pieces)
{
    for (uint32_t i = 0; i < MAX_VIEWS; i++) {
        free(pieces[i].spline.controls);
        free(pieces[i].length);
    }
}

/* The views of a part, with its points; names and cameras are borrowed. The caller frees the arrays. */
static cn_status extract(const cn_scene *scene, const uint32_t *part, uint32_t which, cn_scene *out)
{
    uint32_t *place = malloc((scene->n_views + (size_t)1) * sizeof *place);
    *out = (cn_scene){ .cameras = scene->cameras,
                       .n_cameras = scene->n_cameras,
                       .views = malloc((scene->n_views + (size_t)1) * sizeof *out->views),
                       .points = malloc((scene->n_points + (size_t)1) * sizeof *out->points),
                       .observations = malloc((scene->n_observations + (size_t)1) * sizeof *out->observations) };
    const bool room = place && out->views && out->points && out->observations;
    for (uint32_t i = 0; room && i < scene->n_views; i++)
        if (part[i] == which) {
            place[i] = out->n_views;
            out->views[out->n_views++] = scene->views[i];
        }
    for (uint32_t i = 0; room && i < scene->n_points; i++) {
        const cn_observation *seen = scene->observations + scene->points[i].first_observation;
        cn_point point = scene->points[i];
        if (!point.n_observations || part[seen[0].view] != which) continue;
        point.first_observation = (uint32_t)out->n_observations;
        for (uint32_t k = 0; k < point.n_observations; k++)
            out->observations[out->n_observations++] =
                (cn_observation){ place[seen[k].view], seen[k].x_px, seen[k].y_px };
        out->points[out->n_points++] = point;
    }
    free(place);
    return room ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the default camera path");
}

/* Round what stands in the way. A space of its own for each part: one for all would have cells too large for each. */
static cn_status lead_round(const cn_scene *scene, const uint32_t *part, const spline *views, spline *s)
{
    cn_scene own;
    cn_free_space space = { 0 };
    cn_status status = extract(scene, part, views->controls[0].part, &own);
    if (status == CN_OK) status = cn_free_space_carve(&space, &own);
    if (status == CN_OK) status = avoid(&space, views, s);
    if (status == CN_OK) status = follow_closely(&space, s);
    cn_free_space_deinit(&space);
    free(own.views);
    free(own.points);
    free(own.observations);
    return status;
}

/* views: in the order of their parts. pieces: room for MAX_VIEWS, zeroed; the caller frees them, also on failure. */
static cn_status make_pieces(const cn_scene *scene, const uint32_t *part, const spline *views, piece *pieces,
                             uint32_t *n)
{
    *n = 0;
    for (uint32_t i = 0, end; i < views->n; i = end) {
        piece *made = &pieces[(*n)++];
        for (end = i + 1; end < views->n && views->controls[end].part == views->controls[i].part;)
            end++;
        const spline own = { views->controls + i, end - i };
        CN_TRY(lead_round(scene, part, &own, &made->spline));
        made->length = malloc(((made->spline.n + 1) * (size_t)STEPS_PER_SEGMENT + 1) * sizeof *made->length);
        if (!made->length) return cn_fail(CN_ERR_NOMEM, "out of memory for the default camera path");
        made->n = measure(&made->spline, made->length);
    }
    return CN_OK;
}

/* Frames evenly along the pieces, one piece after the other. */
static cn_status fly(cn_path *path, const piece *pieces, uint32_t n_pieces, cn_path_shot shot)
{
    double total = 0, passed = 0, quat[4];
    for (uint32_t i = 0; i < n_pieces; i++)
        total += pieces[i].length[pieces[i].n];
    uint32_t at = 0, step = 0;
    for (uint32_t f = 0; f < path->n_frames; f++) {
        const double part = path->n_frames > 1 ? (double)f / (path->n_frames - 1) : 0;
        while (at + 1 < n_pieces && part * total > passed + pieces[at].length[pieces[at].n]) {
            passed += pieces[at].length[pieces[at].n];
            at++;
            step = 0;
        }
        const piece *here = &pieces[at];
        const double *length = here->length, want = part * total - passed;
        double u = part * here->n;
        if (length[here->n] > 0) {
            while (step + 1 < here->n && length[step + 1] < want)
                step++;
            const double gap = length[step + 1] - length[step];
            u = step + (gap > 0 ? fmin((want - length[step]) / gap, 1) : 0);
        }
        evaluate(&here->spline, u / STEPS_PER_SEGMENT, shot.centre, quat);
        cn_quat_to_mat3(quat, shot.cam_from_world);
        shot.time_s = f / path->fps;
        CN_TRY(cn_path_place(path, f, &shot));
    }
    return CN_OK;
}

cn_status cn_path_default(cn_path *path, const cn_scene *scene, uint32_t n_frames, uint32_t width, uint32_t height)
{
    *path = (cn_path){ 0 };
    if (n_frames == 0 || width == 0 || height == 0)
        return cn_fail(CN_ERR_USAGE, "a camera path needs at least one frame and a picture size above 0 x 0");
    if (scene->n_views == 0)
        return cn_fail(CN_ERR_DATA, "no default flight: no photo has a pose; run `conurb poses` first");
    double vfov_deg = 0;
    control chosen[MAX_VIEWS];
    spline views = { .controls = chosen };
    piece pieces[MAX_VIEWS] = { 0 };
    uint32_t n_pieces = 0, *part;
    CN_TRY(median_vfov(scene, &vfov_deg));
    CN_TRY(find_parts(scene, &part));
    cn_status status = choose_views(scene, part, &views);
    if (status == CN_OK) status = make_pieces(scene, part, &views, pieces, &n_pieces);
    if (status == CN_OK) status = cn_path_allocate(path, n_frames, 24);
    if (status == CN_OK)
        status = fly(path, pieces, n_pieces, (cn_path_shot){ .vfov_deg = vfov_deg, .width = width, .height = height });
    if (status != CN_OK) cn_path_deinit(path);
    pieces_deinit(pieces);
    free(part);
    return status;
}
