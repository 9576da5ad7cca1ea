#include "pose/align.h"

#include "base/units.h"
#include "geo/geoid.h"
#include "math/linalg.h"
#include "pose/scene.h"
#include "pose/similarity.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define UPRIGHT 0.8660254037844386 /* 30 degrees; a model whose makers meant z to be up is nearer */
#define FEWEST_GPS 3
#define ONE_PLACE_M 0.2      /* GPS positions spread less than this are one place */
#define LINE_SHARE 0.02      /* second axis over first under which a track counts as a line */
#define LINE_NOISE 2.0       /* ... or second axis over residual: below this, GPS noise would decide the rotation */
#define VERTICAL_WEIGHT 0.33 /* GPS heights are two to three times worse than positions */
#define SEED 1
/* Poses are in doubt where a smaller share of the photos agrees with GPS: lund's import, which breaks in mid-street,
 * has 0.48; lund posed well has 0.72; castle, brighton and herz-jesus have 1. With few photos, bad GPS alone decides.
 */
#define DOUBTFUL_SHARE 0.6
#define FEWEST_TO_DOUBT 8
#define CLEAR_SHARE 0.1

/* The views with GPS: camera centres and GPS positions. */
typedef struct pairs {
    uint32_t n, n_all; /* n: used; n_all: with GPS */
    double (*source)[3], (*target)[3];
    double *latitude, *longitude, *height, *geoid;
    bool *inlier;
    bool has_height;
} pairs;

static void pairs_deinit(pairs *p)
{
    free(p->source);
    free(p->target);
    free(p->latitude);
    free(p->inlier);
    memset(p, 0, sizeof *p);
}

static cn_status pairs_init(pairs *p, uint32_t n)
{
    size_t room = n + (size_t)1;
    memset(p, 0, sizeof *p);
    p->source = calloc(room, sizeof *p->source);
    p->target = calloc(room, sizeof *p->target);
    p->latitude = calloc(room, 4 * sizeof *p->latitude);
    p->inlier = calloc(room, sizeof *p->inlier);
    if (!p->source || !p->target || !p->latitude || !p->inlier) {
        pairs_deinit(p);
        return cn_fail(CN_ERR_NOMEM, "out of memory aligning %u photos", n);
    }
    p->longitude = p->latitude + room;
    p->height = p->longitude + room;
    p->geoid = p->height + room;
    return CN_OK;
}

/* Photos without altitude are used only when too few have one; then all heights are 0. */
static void collect(pairs *p, const cn_scene *scene, const cn_photo_index *index)
{
    uint32_t n_height = 0;
    for (uint32_t i = 0; i < scene->n_views; i++) {
        const cn_photo *photo = scene->views[i].photo == UINT32_MAX ? NULL : &index->photos[scene->views[i].photo];
        p->n_all += photo && photo->has_gps;
        n_height += photo && photo->has_gps && photo->has_altitude;
    }
    p->has_height = n_height >= FEWEST_GPS;
    for (uint32_t i = 0; i < scene->n_views; i++) {
        const cn_photo *photo = scene->views[i].photo == UINT32_MAX ? NULL : &index->photos[scene->views[i].photo];
        if (!photo || !photo->has_gps || (p->has_height && !photo->has_altitude)) continue;
        cn_view_centre(&scene->views[i], p->source[p->n]);
        p->latitude[p->n] = photo->latitude_deg;
        p->longitude[p->n] = photo->longitude_deg;
        p->height[p->n++] = p->has_height ? photo->altitude_m : 0.0;
    }
}

/* The mean place, averaged as directions from the Earth's centre, so that poles and the antimeridian need no special
 * case. */
static void mean_place(const pairs *p, cn_frame *frame)
{
    double sum[3] = { 0 }, height = 0.0;
    for (uint32_t i = 0; i < p->n; i++) {
        double lat = cn_radians(p->latitude[i]), lon = cn_radians(p->longitude[i]);
        sum[0] += cos(lat) * cos(lon);
        sum[1] += cos(lat) * sin(lon);
        sum[2] += sin(lat);
        height += p->height[i] / p->n;
    }
    frame->latitude_deg = cn_degrees(atan2(sum[2], hypot(sum[0], sum[1])));
    frame->longitude_deg = cn_degrees(atan2(sum[1], sum[0]));
    frame->height_m = height;
}

static cn_status to_local(const cn_context *ctx, pairs *p, cn_frame *frame)
{
    bool found = false;
    CN_TRY(cn_geoid_heights(CN_GEOID_GRID, p->n, p->latitude, p->longitude, p->geoid, &found));
    frame->geoid_applied = found && p->has_height;
    for (uint32_t i = 0; i < p->n && frame->geoid_applied; i++)
        p->height[i] += p->geoid[i];
    mean_place(p, frame);
    frame->georeferenced = true; /* lets the frame convert */
    if (found) CN_TRY(cn_geo_geoid_height(frame->latitude_deg, frame->longitude_deg, &frame->geoid_height_m, &found));
    for (uint32_t i = 0; i < p->n; i++) {
        const double at[3] = { p->latitude[i], p->longitude[i], p->height[i] };
        CN_TRY(cn_frame_from_geodetic(frame, at, p->target[i]));
    }
    if (!p->has_height)
        cn_log(ctx, CN_LOG_WARN, "the photos have no GPS altitude: heights are relative to the cameras");
    else if (frame->geoid_applied)
        cn_log(ctx, CN_LOG_INFO, "EXIF altitudes are above sea level: EGM96 geoid applied, %.2f m here",
               frame->geoid_height_m);
    else
        cn_log(ctx, CN_LOG_WARN,
               "EXIF altitudes are above sea level, but the EGM96 grid is not installed: heights are "
               "not ellipsoidal (install the package proj-data)");
    return CN_OK;
}

static void residuals(const pairs *p, const cn_similarity *s, cn_frame *frame)
{
    double horizontal = 0.0, vertical = 0.0;
    frame->n_inliers = 0;
    for (uint32_t i = 0; i < p->n; i++) {
        double at[3];
        if (!p->inlier[i]) continue;
        cn_similarity_apply(s, p->source[i], at);
        double dx = at[0] - p->target[i][0], dy = at[1] - p->target[i][1], dz = at[2] - p->target[i][2];
        horizontal += dx * dx + dy * dy;
        vertical += dz * dz;
        frame->n_inliers++;
    }
    frame->residual_horizontal_m = sqrt(horizontal / frame->n_inliers);
    frame->residual_vertical_m = sqrt(vertical / frame->n_inliers);
}

static cn_status fit_line(const cn_context *ctx, const cn_scene *scene, const cn_similarity_task *task,
                          cn_similarity *out, bool *inlier)
{
    double up[3];
    if (!cn_align_up(scene, up))
        return cn_fail(CN_ERR_DATA, "all cameras are on a line, and their up directions do not agree");
    CN_TRY(cn_similarity_fit_line(task, up, out, inlier));
    cn_log(ctx, CN_LOG_INFO, "all cameras are on a line: the rotation about it is taken from their up directions");
    return CN_OK;
}

/* Cameras spread over a plane can be fitted directly. Cameras on a line, up to GPS noise, need the cameras' up
 * direction. */
static cn_status fit(const cn_context *ctx, const cn_scene *scene, pairs *p, double max_error_m, cn_frame *frame,
                     cn_similarity *s)
{
    const cn_similarity_task task = {
        p->n, (const double(*)[3])p->source, (const double(*)[3])p->target, max_error_m, VERTICAL_WEIGHT, SEED
    };
    double source[3], target[3], up[3];
    cn_spread(p->n, task.source, NULL, source, NULL);
    cn_spread(p->n, task.target, NULL, target, NULL);
    if (!(target[2] > ONE_PLACE_M) || !(source[2] > 0.0))
        return cn_fail(CN_ERR_DATA, "all photos were taken at one place");
    bool line = source[1] < LINE_SHARE * source[2];
    if (line)
        CN_TRY(fit_line(ctx, scene, &task, s, p->inlier));
    else
        CN_TRY(cn_pose_fit_similarity(&task, s, p->inlier));
    residuals(p, s, frame);
    cn_spread(p->n, task.source, p->inlier, source, NULL);
    double noise = hypot(frame->residual_horizontal_m, frame->residual_vertical_m);
    if (!line && s->scale * source[1] < LINE_NOISE * noise && cn_align_up(scene, up)) {
        CN_TRY(fit_line(ctx, scene, &task, s, p->inlier));
        residuals(p, s, frame);
    }
    return CN_OK;
}

static void report(const cn_context *ctx, const pairs *p, const cn_frame *frame)
{
    cn_log(ctx, CN_LOG_INFO,
           "aligned to the GPS of %u photos (%u agree): residual %.3f m horizontally, %.3f m "
           "vertically; scale %.6g",
           frame->n_gps, frame->n_inliers, frame->residual_horizontal_m, frame->residual_vertical_m, frame->scale);
    if (frame->n_inliers < p->n)
        cn_log(ctx, CN_LOG_WARN, "the GPS of %u photos does not agree with their poses, so the alignment leaves it out",
               p->n - frame->n_inliers);
    double target[3];
    cn_spread(p->n, (const double(*)[3])p->target, p->inlier, target, NULL);
    if (frame->residual_horizontal_m > 0.5 * target[2])
        cn_log(ctx, CN_LOG_WARN,
               "the GPS residual is as large as the area itself: position, scale and north are uncertain");
}

/* Without GPS: up from the cameras, origin at their mean. The scale does not change. */
static void level_scene(const cn_context *ctx, const cn_scene *scene, cn_levelling level, cn_similarity *s)
{
    double up[3], centre[3], mean[3] = { 0 }, x[3] = { 1.0, 0.0, 0.0 }, y[3];
    if (level == CN_LEVEL_NEVER || !cn_align_up(scene, up)) return;
    if (level == CN_LEVEL_TILTED && up[2] >= UPRIGHT) return;
    if (level == CN_LEVEL_TILTED)
        cn_log(ctx, CN_LOG_INFO,
               "the imported poses are turned: the cameras say that up is %.0f degrees from their z axis",
               cn_degrees(acos(fmax(up[2], -1))));
    if (fabs(up[0]) > 0.9) {
        x[0] = 0.0;
        x[1] = 1.0;
    }
    cn_cross3(up, x, y);
    if (!cn_normalize3(y)) return;
    cn_cross3(y, up, x);
    memcpy(s->rotation, x, sizeof x);
    memcpy(s->rotation + 3, y, sizeof y);
    memcpy(s->rotation + 6, up, sizeof up);
    for (uint32_t i = 0; i < scene->n_views; i++) {
        cn_view_centre(&scene->views[i], centre);
        for (int k = 0; k < 3; k++)
            mean[k] += centre[k] / scene->n_views;
    }
    cn_mat3_vec(s->rotation, mean, s->translation);
    for (int k = 0; k < 3; k++)
        s->translation[k] = -s->translation[k];
}

/* CN_ERR_DATA: this GPS does not determine the frame; the message has the reason. */
static cn_status georeference(const cn_context *ctx, const cn_scene *scene, pairs *p, double max_error_m,
                              cn_frame *frame, cn_similarity *s)
{
    if (p->n < FEWEST_GPS) return cn_fail(CN_ERR_DATA, "%u posed photos have GPS, but 3 are needed", p->n_all);
    CN_TRY(to_local(ctx, p, frame));
    CN_TRY(fit(ctx, scene, p, max_error_m, frame, s));
    frame->n_gps = p->n_all;
    return CN_OK;
}

static void store(const cn_similarity *s, cn_frame *frame)
{
    frame->scale = s->scale;
    memcpy(frame->rotation, s->rotation, sizeof s->rotation);
    memcpy(frame->translation, s->translation, sizeof s->translation);
}

cn_status cn_align(const cn_context *ctx, cn_scene *scene, const cn_photo_index *index, double max_error_m,
                   cn_levelling level, cn_frame *frame)
{
    cn_similarity s = { .scale = 1.0, .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 } };
    pairs p;
    cn_frame_init(frame);
    CN_TRY(pairs_init(&p, scene->n_views));
    collect(&p, scene, index);
    cn_status status = georeference(ctx, scene, &p, max_error_m, frame, &s);
    if (status == CN_OK) {
        store(&s, frame);
        report(ctx, &p, frame);
    } else if (status == CN_ERR_DATA) {
        cn_log(ctx, CN_LOG_WARN, "no georeference: %s; the frame is local, and its unit is not the metre",
               cn_error_message());
        cn_frame_init(frame);
        frame->n_gps = p.n_all;
        s = (cn_similarity){ .scale = 1.0, .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 } };
        level_scene(ctx, scene, level, &s);
        store(&s, frame);
        status = CN_OK;
    }
    pairs_deinit(&p);
    if (status != CN_OK) return status;
    cn_scene_transform(scene, s.scale, s.rotation, s.translation);
    frame->nadir_ambiguous = frame->georeferenced && cn_align_is_nadir(scene);
    return CN_OK;
}

cn_status cn_align_count(const cn_scene *scene, const cn_photo_index *index, double max_error_m, uint32_t *n_gps,
                         uint32_t *n_inliers)
{
    cn_similarity s;
    cn_frame frame;
    pairs p;
    *n_gps = *n_inliers = 0;
    cn_frame_init(&frame);
    CN_TRY(pairs_init(&p, scene->n_views));
    collect(&p, scene, index);
    const cn_status status = georeference(NULL, scene, &p, max_error_m, &frame, &s);
    if (status == CN_OK) {
        *n_gps = frame.n_gps;
        *n_inliers = frame.n_inliers;
    }
    pairs_deinit(&p);
    return status == CN_ERR_DATA ? CN_OK : status;
}

bool cn_align_is_doubtful(uint32_t n_gps, uint32_t n_inliers)
{
    return n_gps >= FEWEST_TO_DOUBT && n_inliers < DOUBTFUL_SHARE * n_gps;
}

bool cn_align_is_clearly_better(uint32_t n_gps, uint32_t n_before, uint32_t n_inliers)
{
    return n_inliers > n_before && n_inliers - n_before >= CLEAR_SHARE * n_gps;
}
