#include "pose/control_fit.h"

#include "math/linalg.h"
#include "pose/adjust.h"
#include "pose/align.h"
#include "pose/from_photos.h"
#include "pose/scene.h"
#include "pose/similarity.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define FEWEST 3
#define LINE_SHARE 0.02      /* second axis over first under which points count as a line */
#define LEAST_ANGLE_DEG 2.0  /* between rays, for a place to count as measured */
#define CONTROL_SIGMA_M 0.02 /* of surveyed places, where the file states none */
#define MARK_SIGMA_PX 0.5
#define MOST_SIGMAS 5.0 /* a control point farther off than so many sigmas is named */
#define SEED 1

/* A scene with its marks by view, and the surveyed places in the local frame. */
typedef struct fitting {
    const cn_context *ctx;
    const cn_control *control;
    const cn_pose_options *options;
    const cn_photo_index *index;
    cn_scene *scene;
    cn_frame *frame;
    cn_control_fit *fit;
    cn_point_mark *marks;             /* of posed photos, sorted by point */
    uint32_t n_marks, *first;         /* first[i]: of point i; first[n_points]: n_marks */
    double (*places)[3], (*found)[3]; /* found: by the photos */
} fitting;

void cn_control_fit_deinit(cn_control_fit *fit)
{
    free(fit->points);
    *fit = (cn_control_fit){ 0 };
}

static cn_status init(fitting *f)
{
    const cn_control *control = f->control;
    const size_t n = (control ? control->n_points : 0) + (size_t)1;
    f->marks = calloc((control ? control->n_marks : 0) + (size_t)1, sizeof *f->marks);
    f->first = calloc(n, sizeof *f->first);
    f->places = calloc(n, sizeof *f->places);
    f->found = calloc(n, sizeof *f->found);
    f->fit->points = calloc(n, sizeof *f->fit->points);
    f->fit->n_points = control ? control->n_points : 0;
    if (f->marks && f->first && f->places && f->found && f->fit->points) return CN_OK;
    return cn_fail(CN_ERR_NOMEM, "out of memory for control points");
}

static void deinit(fitting *f)
{
    free(f->marks);
    free(f->first);
    free(f->places);
    free(f->found);
}

/* Marks of posed photos, by view. */
static cn_status tie_marks(fitting *f)
{
    uint32_t *view_of = malloc((f->index->n_photos + (size_t)1) * sizeof *view_of);
    if (!view_of) return cn_fail(CN_ERR_NOMEM, "out of memory for control points");
    memset(view_of, 0xff, f->index->n_photos * sizeof *view_of);
    for (uint32_t i = 0; i < f->scene->n_views; i++)
        if (f->scene->views[i].photo != UINT32_MAX) view_of[f->scene->views[i].photo] = i;
    for (uint32_t i = 0, m = 0; i < f->control->n_points; i++) {
        f->first[i] = f->n_marks;
        for (; m < f->control->n_marks && f->control->marks[m].point == i; m++) {
            const cn_control_mark *mark = &f->control->marks[m];
            const uint32_t view = view_of[mark->photo];
            if (view != UINT32_MAX) f->marks[f->n_marks++] = (cn_point_mark){ i, view, mark->x_px, mark->y_px };
        }
    }
    f->first[f->control->n_points] = f->n_marks;
    free(view_of);
    return CN_OK;
}

/* Where the photos see each point. */
static void measure(fitting *f)
{
    f->fit->n_control = f->fit->n_check = 0;
    for (uint32_t i = 0; i < f->fit->n_points; i++) {
        cn_triangulation at;
        cn_control_residual *r = &f->fit->points[i];
        r->n_views = f->first[i + 1] - f->first[i];
        r->measured =
            cn_scene_triangulate(f->scene, f->marks + f->first[i], r->n_views, &at) && at.angle_deg >= LEAST_ANGLE_DEG;
        r->error_px = r->measured ? at.error_px : NAN;
        memcpy(f->found[i], at.xyz, sizeof at.xyz);
        for (int k = 0; k < 3; k++)
            r->residual_m[k] = r->measured ? at.xyz[k] - f->places[i][k] : NAN;
        if (r->measured) *(f->control->points[i].check ? &f->fit->n_check : &f->fit->n_control) += 1;
    }
}

/* RMS by axis of the points with this flag. */
static void rms(const fitting *f, bool check, bool before, double out[3])
{
    for (int k = 0; k < 3; k++) {
        double sum = 0.0;
        uint32_t n = 0;
        for (uint32_t i = 0; i < f->fit->n_points; i++) {
            const cn_control_residual *r = &f->fit->points[i];
            const double x = before ? r->before_m[k] : r->residual_m[k];
            if (f->control->points[i].check != check || !isfinite(x)) continue;
            sum += x * x;
            n++;
        }
        out[k] = n ? sqrt(sum / n) : NAN;
    }
}

static void remember_before(fitting *f)
{
    for (uint32_t i = 0; i < f->fit->n_points; i++)
        for (int k = 0; k < 3; k++)
            f->fit->points[i].before_m[k] = f->fit->georeferenced_before ? f->fit->points[i].residual_m[k] : NAN;
    rms(f, true, true, f->fit->check_before_m);
}

/* The scene and its frame move together: local' = s (frame of the source to local). */
static void move(fitting *f, const cn_similarity *s)
{
    cn_frame *frame = f->frame;
    double rotation[9], translation[3];
    cn_scene_transform(f->scene, s->scale, s->rotation, s->translation);
    cn_mat3_mul(s->rotation, frame->rotation, rotation);
    cn_similarity_apply(s, frame->translation, translation);
    memcpy(frame->rotation, rotation, sizeof rotation);
    memcpy(frame->translation, translation, sizeof translation);
    frame->scale *= s->scale;
}

/* The control points that are measured and have a height. Returns how many. */
static uint32_t pick(const fitting *f, double (*source)[3], double (*target)[3])
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < f->fit->n_points; i++) {
        if (f->control->points[i].check || !f->fit->points[i].measured || isnan(f->places[i][2])) continue;
        memcpy(source[n], f->found[i], sizeof source[n]);
        memcpy(target[n++], f->places[i], sizeof target[n]);
    }
    return n;
}

static cn_status fit_similarity(const fitting *f, uint32_t n, double (*source)[3], double (*target)[3],
                                cn_similarity *out)
{
    double deviation[3];
    if (n < FEWEST)
        return cn_fail(CN_ERR_DATA, "%u control points are seen by two posed photos or more, but 3 are needed", n);
    cn_spread(n, (const double(*)[3])target, NULL, deviation, NULL);
    if (!(deviation[1] > LINE_SHARE * deviation[2]))
        return cn_fail(CN_ERR_DATA, "the control points are on a line, which leaves the turn about it open");
    const cn_similarity_task task = {
        n, (const double(*)[3])source, (const double(*)[3])target, f->options->max_error_m, 1.0, SEED, NULL
    };
    return cn_pose_fit_similarity(&task, out, NULL);
}

/* Without georeference there is no other way to place the scene; with it, too few control points only pull at it. */
static cn_status align(fitting *f)
{
    const size_t room = f->fit->n_points + (size_t)1;
    double(*source)[3] = malloc(2 * room * sizeof *source), (*target)[3] = source + room;
    cn_similarity s;
    if (!source) return cn_fail(CN_ERR_NOMEM, "out of memory for control points");
    const uint32_t n = pick(f, source, target);
    const cn_status status = fit_similarity(f, n, source, target, &s);
    free(source);
    if (status == CN_OK) {
        move(f, &s);
        measure(f);
        f->frame->nadir_ambiguous = false;
        cn_log(f->ctx, CN_LOG_INFO, "aligned to %u control points; scale %.6g of that by GPS", n, s.scale);
    } else if (status == CN_ERR_DATA && f->fit->georeferenced_before) {
        cn_log(f->ctx, CN_LOG_WARN, "control points: %s; the place stays that of the photos' GPS", cn_error_message());
    } else if (status == CN_ERR_DATA) {
        char *why = strdup(cn_error_message());
        const cn_status failed = cn_fail(CN_ERR_DATA, "poses.control: %s; mark more of them in more photos",
                                         why ? why : "too few control points");
        free(why);
        return failed;
    } else {
        return status;
    }
    return CN_OK;
}

static void set_targets(const fitting *f, cn_marked_point *points)
{
    for (uint32_t i = 0; i < f->fit->n_points; i++) {
        const cn_control_point *point = &f->control->points[i];
        memcpy(points[i].xyz, f->found[i], sizeof points[i].xyz);
        for (int k = 0; k < 3 && !point->check; k++) {
            if (isnan(f->places[i][k])) continue;
            points[i].prior.place[k] = f->places[i][k];
            points[i].prior.sigma[k] = point->sigma_m[k] > 0 ? point->sigma_m[k] : CONTROL_SIGMA_M;
        }
    }
}

/* Marks of check points, and of points that are not measured, take no part. */
static uint32_t pick_marks(const fitting *f, cn_point_mark *out)
{
    uint32_t n = 0;
    for (uint32_t m = 0; m < f->n_marks; m++) {
        const uint32_t i = f->marks[m].point;
        if (!f->control->points[i].check && f->fit->points[i].measured) out[n++] = f->marks[m];
    }
    return n;
}

static cn_status adjust(fitting *f)
{
    cn_adjust_result result = { 0 };
    cn_scene *scene = f->scene;
    cn_place_prior *centres = calloc(scene->n_views + (size_t)1, sizeof *centres);
    cn_marked_point *points = calloc(f->fit->n_points + (size_t)1, sizeof *points);
    cn_point_mark *marks = calloc(f->n_marks + (size_t)1, sizeof *marks);
    cn_status status = centres && points && marks ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for control points");
    if (status == CN_OK) status = cn_control_gps(scene, f->index, f->frame, centres);
    if (status == CN_OK) {
        /* Surveyed heights on the ground tell the focal length. */
        const bool nadir = f->frame->nadir_ambiguous && !f->fit->n_control;
        set_targets(f, points);
        cn_scene_adjustment how = { .centres = centres,
                                    .points = points,
                                    .marks = marks,
                                    .n_points = f->fit->n_points,
                                    .n_marks = pick_marks(f, marks),
                                    .mark_sigma_px = MARK_SIGMA_PX,
                                    .keep_focal = cn_pose_keeps_focal(f->index, f->options->refine_focal, nadir),
                                    .options = cn_adjust_options_default() };
        how.options.stage = "poses";
        status = cn_scene_adjust(f->ctx, scene, &how, &result);
    }
    for (uint32_t i = 0; i < f->fit->n_points && status == CN_OK; i++)
        for (int k = 0; k < 3; k++)
            f->fit->points[i].pull_m[k] = points[i].xyz[k] - f->places[i][k];
    free(centres);
    free(points);
    free(marks);
    CN_TRY(status);
    f->fit->adjusted = true;
    cn_log(f->ctx, CN_LOG_INFO, "adjusted poses, points and lenses to %s in %u steps%s",
           f->fit->n_control ? "control points and GPS" : "GPS of stated accuracy", result.iterations,
           result.converged ? "" : "; it had not settled");
    return CN_OK;
}

static double length(const double v[3])
{
    return sqrt(v[0] * v[0] + v[1] * v[1] + (isfinite(v[2]) ? v[2] * v[2] : 0.0));
}

static void name_doubtful(const fitting *f)
{
    for (uint32_t i = 0; i < f->fit->n_points; i++) {
        const cn_control_point *point = &f->control->points[i];
        const cn_control_residual *r = &f->fit->points[i];
        const double sigma = point->sigma_m[0] > 0 ? fmax(point->sigma_m[0], point->sigma_m[2]) : CONTROL_SIGMA_M;
        if (!r->measured)
            cn_log(f->ctx, CN_LOG_WARN, "point %s is not measured: %u posed photos show it%s", point->name, r->n_views,
                   r->n_views < 2 ? ", two are needed" : ", from nearly one side");
        else if (!point->check && f->fit->adjusted && length(r->pull_m) > MOST_SIGMAS * sigma)
            cn_log(f->ctx, CN_LOG_WARN,
                   "control point %s is %.3f m off after the adjustment, which gave it little weight: look at its "
                   "place and at its marks",
                   point->name, length(r->pull_m));
    }
}

static void report(const fitting *f)
{
    const cn_control_fit *fit = f->fit;
    if (!fit->n_points) return;
    name_doubtful(f);
    if (fit->n_control)
        cn_log(f->ctx, CN_LOG_INFO, "%u control points: %.3f m rms (east %.3f, north %.3f, up %.3f)", fit->n_control,
               length(fit->control_rms_m), fit->control_rms_m[0], fit->control_rms_m[1], fit->control_rms_m[2]);
    if (fit->n_check)
        cn_log(f->ctx, CN_LOG_INFO, "%u check points: %.3f m rms (east %.3f, north %.3f, up %.3f)", fit->n_check,
               length(fit->check_rms_m), fit->check_rms_m[0], fit->check_rms_m[1], fit->check_rms_m[2]);
    if (fit->n_check && fit->georeferenced_before)
        cn_log(f->ctx, CN_LOG_INFO,
               "check points by the photos' GPS alone: %.3f m rms (east %.3f, north %.3f, up %.3f)",
               length(fit->check_before_m), fit->check_before_m[0], fit->check_before_m[1], fit->check_before_m[2]);
}

static cn_status apply(fitting *f)
{
    CN_TRY(init(f));
    f->fit->georeferenced_before = f->frame->georeferenced;
    if (f->control) {
        CN_TRY(cn_control_places(f->control, f->frame, f->places));
        CN_TRY(tie_marks(f));
        measure(f);
        remember_before(f);
        CN_TRY(align(f));
    }
    if (f->scene->n_observations && (f->fit->n_control || cn_control_has_accurate_gps(f->index))) CN_TRY(adjust(f));
    if (f->control) measure(f);
    CN_TRY(cn_control_measure_gps(f->scene, f->index, f->options->max_error_m, f->frame));
    if (!f->control) return CN_OK;
    rms(f, false, false, f->fit->control_rms_m);
    rms(f, true, false, f->fit->check_rms_m);
    report(f);
    return CN_OK;
}

cn_status cn_control_apply(const cn_context *ctx, const cn_control_task *task, cn_scene *scene, cn_frame *frame,
                           cn_control_fit *fit)
{
    fitting f = { .ctx = ctx,
                  .control = task->control,
                  .options = task->options,
                  .index = task->index,
                  .scene = scene,
                  .frame = frame,
                  .fit = fit };
    *fit = (cn_control_fit){ 0 };
    const cn_status status = apply(&f);
    deinit(&f);
    if (status != CN_OK) cn_control_fit_deinit(fit);
    return status;
}
