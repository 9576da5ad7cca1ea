#include "pose/quality.h"

#include "pose/lens.h"
#include "pose/scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define VERTICAL_WEIGHT 0.33     /* as in align.c */
#define FILM_DIAGONAL_MM 43.2666 /* of 36 x 24 mm, which EXIF's 35 mm focal length is for */

void cn_quality_deinit(cn_quality *q)
{
    free(q->views);
    free(q->missing);
    free(q->cameras);
    q->views = NULL;
    q->missing = NULL;
    q->cameras = NULL;
    q->n_missing = 0;
}

const char *cn_quality_outcome(const cn_quality *q)
{
    static const char *const WORDS[] = { "unchecked", "agrees", "doubtful", "kept", "replaced" };
    return WORDS[q->verdict.outcome];
}

/* GPS of a photo in the local frame; false: unknown. */
static bool gps_of(const cn_photo *photo, const cn_frame *frame, double at[3])
{
    if (!photo->has_gps || !frame->georeferenced) return false;
    const double geoid_m = frame->geoid_applied ? frame->geoid_height_m : 0.0;
    const double place[3] = { photo->latitude_deg, photo->longitude_deg,
                              photo->has_altitude ? photo->altitude_m + geoid_m : frame->height_m };
    if (cn_frame_from_geodetic(frame, place, at) != CN_OK) return false;
    if (!photo->has_altitude) at[2] = NAN;
    return true;
}

static void measure_place(const cn_quality *q, double max_error_m, uint32_t i)
{
    cn_view_quality *v = &q->views[i];
    double gps[3];
    cn_view_centre(&q->scene->views[i], v->centre);
    for (int k = 0; k < 3; k++)
        v->off_m[k] = NAN;
    v->error_px = NAN;
    if (q->scene->views[i].photo == UINT32_MAX) return;
    const cn_photo *photo = &q->index->photos[q->scene->views[i].photo];
    memcpy(v->sigma_m, photo->gps_sigma_m, sizeof v->sigma_m);
    if (!gps_of(photo, q->frame, gps)) return;
    for (int k = 0; k < 3; k++)
        v->off_m[k] = v->centre[k] - gps[k];
    const double up = isnan(v->off_m[2]) ? 0.0 : VERTICAL_WEIGHT * v->off_m[2];
    v->agrees = hypot(hypot(v->off_m[0], v->off_m[1]), up) <= max_error_m;
}

/* Means by view, and the histogram. */
static void measure_errors(cn_quality *q)
{
    const cn_scene *scene = q->scene;
    double total = 0.0, n_total = 0.0;
    for (uint32_t i = 0; i < scene->n_points; i++)
        for (uint32_t k = 0; k < scene->points[i].n_observations; k++) {
            const cn_observation *o = &scene->observations[(uint64_t)scene->points[i].first_observation + k];
            cn_view_quality *v = &q->views[o->view];
            double error_px;
            if (!cn_scene_error(scene, &scene->points[i], o, &error_px)) continue;
            const double bin = error_px / CN_QUALITY_MOST_PX * CN_QUALITY_BINS;
            q->histogram[bin < CN_QUALITY_BINS ? (int)bin : CN_QUALITY_BINS - 1]++;
            v->error_px = ((v->n_seen ? v->error_px * v->n_seen : 0.0) + error_px) / (v->n_seen + 1.0);
            v->n_seen++;
            total += error_px;
            n_total++;
        }
    q->mean_error_px = n_total > 0.0 ? total / n_total : NAN;
}

static void measure_axes(cn_quality *q)
{
    for (int k = 0; k < 3; k++) {
        double sum = 0.0;
        uint32_t n = 0;
        for (uint32_t i = 0; i < q->scene->n_views; i++) {
            const cn_view_quality *v = &q->views[i];
            if (!v->agrees || !isfinite(v->off_m[k])) continue;
            sum += v->off_m[k] * v->off_m[k];
            n++;
        }
        q->off_rms_m[k] = n ? sqrt(sum / n) : NAN;
    }
}

/* The focal length of EXIF in pixels of the photo, by the diagonal, as EXIF defines it. */
static void measure_cameras(cn_quality *q)
{
    for (uint32_t c = 0; c < q->scene->n_cameras; c++) {
        const cn_lens_view lens = cn_lens_unpack(&q->scene->cameras[c]);
        const double focal_px = lens.equirectangular ? NAN : sqrt(lens.fx * lens.fy);
        q->cameras[c] = (cn_camera_quality){ .focal_px = focal_px, .exif_px = NAN };
    }
    for (uint32_t i = 0; i < q->scene->n_views; i++) {
        const cn_view *view = &q->scene->views[i];
        cn_camera_quality *camera = &q->cameras[view->camera];
        camera->n_views++;
        if (view->photo == UINT32_MAX || isfinite(camera->exif_px)) continue;
        const cn_photo *photo = &q->index->photos[view->photo];
        if (isfinite(photo->focal_35mm) && isfinite(camera->focal_px))
            camera->exif_px = photo->focal_35mm / FILM_DIAGONAL_MM * hypot(photo->width, photo->height);
    }
}

static cn_status list_missing(cn_quality *q)
{
    bool *posed = calloc(q->index->n_photos + (size_t)1, 1);
    if (!posed) return cn_fail(CN_ERR_NOMEM, "out of memory for the report");
    for (uint32_t i = 0; i < q->scene->n_views; i++)
        if (q->scene->views[i].photo != UINT32_MAX) posed[q->scene->views[i].photo] = true;
    for (uint32_t i = 0; i < q->index->n_photos; i++) {
        if (posed[i]) continue;
        cn_missing_photo *m = &q->missing[q->n_missing++];
        *m = (cn_missing_photo){ .photo = i, .sharpness = NAN };
        m->has_place = gps_of(&q->index->photos[i], q->frame, m->place);
    }
    free(posed);
    return CN_OK;
}

cn_status cn_quality_measure(const cn_quality_task *task, cn_quality *q)
{
    q->views = calloc(q->scene->n_views + (size_t)1, sizeof *q->views);
    q->missing = calloc(q->index->n_photos + (size_t)1, sizeof *q->missing);
    q->cameras = calloc(q->scene->n_cameras + (size_t)1, sizeof *q->cameras);
    cn_status status =
        q->views && q->missing && q->cameras ? list_missing(q) : cn_fail(CN_ERR_NOMEM, "out of memory for the report");
    if (status != CN_OK) {
        cn_quality_deinit(q);
        return status;
    }
    for (uint32_t i = 0; i < q->scene->n_views; i++)
        measure_place(q, task->options->max_error_m, i);
    measure_errors(q);
    measure_axes(q);
    measure_cameras(q);
    cn_quality_explain(task, q);
    return CN_OK;
}
