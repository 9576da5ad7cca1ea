#include "pose/align.h"

#include "base/units.h"
#include "geo/geoid.h"
#include "math/linalg.h"
#include "pose/align_fit.h"
#include "pose/align_up.h"
#include "pose/scene.h"
#include "pose/similarity.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define UPRIGHT 0.8660254037844386 /* 30 degrees; a model whose makers meant z to be up is nearer */
#define FEWEST_GPS 3
static void pairs_deinit(cn_gps_pairs *p)
{
    free(p->source);
    free(p->target);
    free(p->latitude);
    free(p->inlier);
    memset(p, 0, sizeof *p);
}

static cn_status pairs_init(cn_gps_pairs *p, uint32_t n)
{
    size_t room = n + (size_t)1;
    memset(p, 0, sizeof *p);
    p->source = calloc(room, sizeof *p->source);
    p->target = calloc(room, sizeof *p->target);
    p->latitude = calloc(room, 5 * sizeof *p->latitude);
    p->inlier = calloc(room, 3 * sizeof *p->inlier);
    if (!p->source || !p->target || !p->latitude || !p->inlier) {
        pairs_deinit(p);
        return cn_fail(CN_ERR_NOMEM, "out of memory aligning %u photos", n);
    }
    p->longitude = p->latitude + room;
    p->height = p->longitude + room;
    p->geoid = p->height + room;
    p->scratch = p->geoid + room;
    p->known = p->inlier + room;
    p->with_height = p->known + room;
    return CN_OK;
}

static double median_height(const cn_gps_pairs *p, const bool *use)
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < p->n; i++)
        if (use[i]) p->scratch[n++] = p->height[i];
    return n ? cn_select(p->scratch, n, n / 2) : 0.0;
}

/* Photos without altitude count by their place alone; until the fit tells their height, it is the median one. Where too
 * few photos have an altitude, all heights are 0. */
static void collect(cn_gps_pairs *p, const cn_scene *scene, const cn_photo_index *index)
{
    for (uint32_t i = 0; i < scene->n_views; i++) {
        const cn_photo *photo = scene->views[i].photo == UINT32_MAX ? NULL : &index->photos[scene->views[i].photo];
        if (!photo || !photo->has_gps) continue;
        cn_view_centre(&scene->views[i], p->source[p->n]);
        p->latitude[p->n] = photo->latitude_deg;
        p->longitude[p->n] = photo->longitude_deg;
        p->known[p->n] = photo->has_altitude;
        p->height[p->n++] = photo->has_altitude ? photo->altitude_m : 0.0;
    }
    p->has_height = cn_similarity_count(p->known, p->n) >= FEWEST_GPS;
    const double median_m = median_height(p, p->known);
    for (uint32_t i = 0; i < p->n; i++) {
        if (!p->has_height)
            p->height[i] = 0.0;
        else if (!p->known[i])
            p->height[i] = median_m;
        p->known[i] = p->known[i] || !p->has_height;
    }
}

/* Places count as directions from the Earth's centre, so that poles and the antimeridian need no special case. */
static void direction_of(const cn_gps_pairs *p, uint32_t i, double direction[3])
{
    const double lat = cn_radians(p->latitude[i]), lon = cn_radians(p->longitude[i]);
    direction[0] = cos(lat) * cos(lon);
    direction[1] = cos(lat) * sin(lon);
    direction[2] = sin(lat);
}

static void set_origin(const double direction[3], double height_m, cn_frame *frame)
{
    frame->latitude_deg = cn_degrees(atan2(direction[2], hypot(direction[0], direction[1])));
    frame->longitude_deg = cn_degrees(atan2(direction[1], direction[0]));
    frame->height_m = height_m;
}

/* The median place, near most photos whatever GPS the others have. */
static void median_origin(const cn_gps_pairs *p, cn_frame *frame)
{
    double median[3], direction[3];
    for (int k = 0; k < 3; k++) {
        for (uint32_t i = 0; i < p->n; i++) {
            direction_of(p, i, direction);
            p->scratch[i] = direction[k];
        }
        median[k] = cn_select(p->scratch, p->n, p->n / 2);
    }
    set_origin(median, median_height(p, p->known), frame);
}

/* The mean place of the photos that agree with the fit. */
static void mean_origin(const cn_gps_pairs *p, cn_frame *frame)
{
    const uint32_t n = cn_similarity_count(p->with_height, p->n);
    double sum[3] = { 0 }, height = 0.0, direction[3];
    for (uint32_t i = 0; i < p->n; i++) {
        if (!p->inlier[i]) continue;
        direction_of(p, i, direction);
        for (int k = 0; k < 3; k++)
            sum[k] += direction[k];
        if (p->with_height[i]) height += p->height[i] / n;
    }
    if (p->by_median || !n) height = median_height(p, n ? p->with_height : p->known);
    set_origin(sum, height, frame);
}

static cn_status check_number(const cn_gps_pairs *p)
{
    return p->n >= FEWEST_GPS ? CN_OK : cn_fail(CN_ERR_DATA, "%u posed photos have GPS, but 3 are needed", p->n);
}

static cn_status fill_targets(cn_gps_pairs *p, const cn_frame *frame)
{
    for (uint32_t i = 0; i < p->n; i++) {
        const double at[3] = { p->latitude[i], p->longitude[i], p->height[i] };
        CN_TRY(cn_frame_from_geodetic(frame, at, p->target[i]));
    }
    return CN_OK;
}

/* EXIF altitudes become ellipsoidal heights, where the grid is installed (*found). */
static cn_status add_geoid(cn_gps_pairs *p, bool *found)
{
    *found = false;
    CN_TRY(cn_geoid_heights(CN_GEOID_GRID, p->n, p->latitude, p->longitude, p->geoid, found));
    for (uint32_t i = 0; i < p->n && *found && p->has_height; i++)
        p->height[i] += p->geoid[i];
    return CN_OK;
}

static void tell_heights(const cn_context *ctx, const cn_gps_pairs *p, const cn_frame *frame)
{
    if (!p->has_height)
        cn_log(ctx, CN_LOG_WARN, "the photos have no GPS altitude: heights are relative to the cameras");
    else if (frame->geoid_applied)
        cn_log(ctx, CN_LOG_INFO, "EXIF altitudes are above sea level: EGM96 geoid applied, %.2f m here",
               frame->geoid_height_m);
    else
        cn_log(ctx, CN_LOG_WARN,
               "EXIF altitudes are above sea level, but the EGM96 grid is not installed: heights are "
               "not ellipsoidal (install the package proj-data)");
}

static void report(const cn_context *ctx, const cn_gps_pairs *p, double max_error_m, const cn_frame *frame)
{
    const uint32_t n_counted = cn_similarity_count(p->inlier, p->n);
    double target[3];
    cn_log(ctx, CN_LOG_INFO,
           "aligned to the GPS of %u photos (%u agree): residual %.3f m horizontally, %.3f m "
           "vertically; scale %.6g%s",
           frame->n_gps, n_counted, frame->residual_horizontal_m, frame->residual_vertical_m, frame->scale,
           p->level ? "; up is that of the cameras" : "");
    if (p->within_m > max_error_m)
        cn_log(ctx, CN_LOG_WARN,
               "the GPS of only %u photos agrees with their poses within %g m, so place, scale and north are those "
               "with which %u agree within %g m, and the height is that of the median photo",
               frame->n_inliers, max_error_m, n_counted, p->within_m);
    else if (n_counted < p->n)
        cn_log(ctx, CN_LOG_WARN, "the GPS of %u photos does not agree with their poses, so the alignment leaves it out",
               p->n - n_counted);
    cn_spread(p->n, (const double(*)[3])p->target, p->inlier, target, NULL);
    if (frame->residual_horizontal_m > 0.5 * target[2])
        cn_log(ctx, CN_LOG_WARN,
               "the GPS residual is as large as the area itself: position, scale and north are uncertain");
}

/* Without GPS: up from the cameras, origin at their mean. The scale does not change. */
static void level_scene(const cn_context *ctx, const cn_scene *scene, const cn_photo_index *index, cn_levelling level,
                        cn_similarity *s)
{
    double up[3], centre[3], mean[3] = { 0 };
    if (level == CN_LEVEL_NEVER) return;
    const cn_side side = cn_held_find_side(scene, index);
    if (!cn_align_up(scene, side, up)) return;
    if (side != CN_SIDE_TOP)
        cn_log(ctx, CN_LOG_INFO, "the photos stand on their side: up is on their %s",
               side == CN_SIDE_LEFT ? "left" : "right");
    if (level == CN_LEVEL_TILTED && up[2] >= UPRIGHT) return;
    if (level == CN_LEVEL_TILTED)
        cn_log(ctx, CN_LOG_INFO,
               "the imported poses are turned: the cameras say that up is %.0f degrees from their z axis",
               cn_degrees(acos(fmax(up[2], -1))));
    if (!cn_similarity_level(up, s->rotation)) return;
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
static cn_status georeference(const cn_context *ctx, const cn_scene *scene, cn_gps_pairs *p, double max_error_m,
                              cn_frame *frame, cn_similarity *s)
{
    bool found;
    CN_TRY(check_number(p));
    CN_TRY(add_geoid(p, &found));
    frame->geoid_applied = found && p->has_height;
    frame->georeferenced = true; /* lets the frame convert */
    /* One photo with GPS on another continent would move a mean of all by hundreds of kilometres, and tilt the frame.
     * So a first fit, about the median, tells which photos the origin is the mean of. */
    median_origin(p, frame);
    CN_TRY(fill_targets(p, frame));
    CN_TRY(cn_align_fit(NULL, scene, p, max_error_m, frame, s));
    mean_origin(p, frame);
    CN_TRY(fill_targets(p, frame));
    if (found) CN_TRY(cn_geo_geoid_height(frame->latitude_deg, frame->longitude_deg, &frame->geoid_height_m, &found));
    tell_heights(ctx, p, frame);
    CN_TRY(cn_align_fit(ctx, scene, p, max_error_m, frame, s));
    frame->n_gps = p->n;
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
    cn_gps_pairs p;
    cn_frame_init(frame);
    CN_TRY(pairs_init(&p, scene->n_views));
    collect(&p, scene, index);
    cn_status status = georeference(ctx, scene, &p, max_error_m, frame, &s);
    if (status == CN_OK) {
        store(&s, frame);
        report(ctx, &p, max_error_m, frame);
    } else if (status == CN_ERR_DATA) {
        cn_log(ctx, CN_LOG_WARN, "no georeference: %s; the frame is local, and its unit is not the metre",
               cn_error_message());
        cn_frame_init(frame);
        frame->n_gps = p.n;
        s = (cn_similarity){ .scale = 1.0, .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 } };
        level_scene(ctx, scene, index, level, &s);
        store(&s, frame);
        status = CN_OK;
    }
    pairs_deinit(&p);
    if (status != CN_OK) return status;
    cn_scene_transform(scene, s.scale, s.rotation, s.translation);
    frame->nadir_ambiguous = frame->georeferenced && cn_align_is_nadir(scene);
    return CN_OK;
}

/* Of the largest error that counts as agreement: scale and north of n photos with a spread of `spread` are known to
 * about error / (spread sqrt(n)). Not measured apart. */
#define SPREAD_FOR_SCALE 4

static cn_status fit_into(cn_gps_pairs *p, const cn_scene *scene, double max_error_m, const cn_frame *frame,
                          cn_similarity *s)
{
    bool found;
    cn_frame own = *frame;
    double spread[3];
    CN_TRY(check_number(p));
    CN_TRY(add_geoid(p, &found));
    /* Where this scene's photos or the frame's have no altitude, both are at one height. */
    if (!p->has_height || frame->height_m == 0.0)
        for (uint32_t i = 0; i < p->n; i++) {
            p->height[i] = frame->height_m;
            p->known[i] = true;
        }
    CN_TRY(fill_targets(p, frame));
    CN_TRY(cn_align_fit(NULL, scene, p, max_error_m, &own, s));
    const uint32_t n = cn_similarity_count(p->inlier, p->n);
    cn_spread(p->n, (const double(*)[3])p->target, p->inlier, spread, NULL);
    if (2 * n < p->n || spread[2] * sqrt(n) < SPREAD_FOR_SCALE * max_error_m)
        return cn_fail(CN_ERR_DATA, "the GPS of these %u photos does not tell where they belong", p->n);
    return CN_OK;
}

cn_status cn_align_into(const cn_scene *scene, const cn_photo_index *index, double max_error_m, const cn_frame *frame,
                        cn_similarity *s)
{
    cn_gps_pairs p;
    CN_TRY(pairs_init(&p, scene->n_views));
    collect(&p, scene, index);
    const cn_status status = fit_into(&p, scene, max_error_m, frame, s);
    pairs_deinit(&p);
    return status;
}
