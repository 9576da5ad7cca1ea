/* Places in the local frame: of control points, and of cameras by GPS. */
#include "base/units.h"
#include "pose/adjust.h"
#include "pose/control_fit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define VERTICAL 2.0        /* heights by GPS are about twice as uncertain as places */
#define LEAST_SIGMA_M 0.005 /* no GPS is better, whatever it states */
#define ACCURATE_M 0.5      /* stated accuracy from which GPS is worth an adjustment */
#define FEWEST_ACCURATE 3
#define VERTICAL_WEIGHT 0.33 /* as in align.c */

/* A frame about the mean of the control points: directions from the Earth's centre are averaged, so that the
 * antimeridian needs no special case. */
static cn_status make_frame(const cn_control *control, cn_frame *frame)
{
    double sum[3] = { 0 }, height = 0.0;
    uint32_t n_heights = 0;
    bool found = false;
    for (uint32_t i = 0; i < control->n_points; i++) {
        const double *place = control->points[i].place;
        const double lat = cn_radians(place[0]), lon = cn_radians(place[1]);
        sum[0] += cos(lat) * cos(lon);
        sum[1] += cos(lat) * sin(lon);
        sum[2] += sin(lat);
        if (isnan(place[2])) continue;
        height += place[2];
        n_heights++;
    }
    cn_frame_init(frame);
    frame->georeferenced = true;
    frame->latitude_deg = cn_degrees(atan2(sum[2], hypot(sum[0], sum[1])));
    frame->longitude_deg = cn_degrees(atan2(sum[1], sum[0]));
    frame->height_m = n_heights ? height / n_heights : 0.0;
    CN_TRY(cn_geo_geoid_height(frame->latitude_deg, frame->longitude_deg, &frame->geoid_height_m, &found));
    frame->geoid_applied = found && n_heights; /* without the grid heights above the sea were not converted */
    return CN_OK;
}

cn_status cn_control_places(const cn_control *control, cn_frame *frame, double (*places)[3])
{
    if (!frame->georeferenced) {
        const cn_frame was = *frame;
        CN_TRY(make_frame(control, frame));
        frame->scale = was.scale;
        memcpy(frame->rotation, was.rotation, sizeof was.rotation);
        memcpy(frame->translation, was.translation, sizeof was.translation);
    }
    for (uint32_t i = 0; i < control->n_points; i++) {
        const double *place = control->points[i].place;
        const double at[3] = { place[0], place[1], isnan(place[2]) ? frame->height_m : place[2] };
        CN_TRY(cn_frame_from_geodetic(frame, at, places[i]));
        if (isnan(place[2])) places[i][2] = NAN;
    }
    return CN_OK;
}

bool cn_control_has_accurate_gps(const cn_photo_index *index)
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < index->n_photos; i++) {
        const cn_photo *photo = &index->photos[i];
        n += photo->has_gps && photo->gps_sigma_m[0] > 0 && photo->gps_sigma_m[0] <= ACCURATE_M;
    }
    return n >= FEWEST_ACCURATE;
}

/* False: the photo has no GPS. Without altitude the third number is NaN. */
static cn_status gps_of(const cn_photo *photo, const cn_frame *frame, double at[3], bool *found)
{
    *found = photo->has_gps;
    if (!*found) return CN_OK;
    const double geoid_m = frame->geoid_applied ? frame->geoid_height_m : 0.0;
    const double place[3] = { photo->latitude_deg, photo->longitude_deg,
                              photo->has_altitude ? photo->altitude_m + geoid_m : frame->height_m };
    CN_TRY(cn_frame_from_geodetic(frame, place, at));
    if (!photo->has_altitude) at[2] = NAN;
    return CN_OK;
}

cn_status cn_control_gps(const cn_scene *scene, const cn_photo_index *index, const cn_frame *frame,
                         cn_place_prior *priors)
{
    /* What is left after the alignment says how good unstated GPS is; of a distance in the plane, an axis has 0.7. */
    const double across = fmax(sqrt(0.5) * frame->residual_horizontal_m, LEAST_SIGMA_M);
    const double up = fmax(frame->residual_vertical_m, VERTICAL * LEAST_SIGMA_M);
    memset(priors, 0, scene->n_views * sizeof *priors);
    for (uint32_t i = 0; i < scene->n_views; i++) {
        const cn_photo *photo = scene->views[i].photo == UINT32_MAX ? NULL : &index->photos[scene->views[i].photo];
        cn_place_prior *prior = &priors[i];
        bool found = false;
        if (photo) CN_TRY(gps_of(photo, frame, prior->place, &found));
        const bool stated = found && photo->gps_sigma_m[0] > 0;
        if (!found || (!stated && frame->n_gps == 0)) continue;
        for (int k = 0; k < 3; k++)
            prior->sigma[k] = stated ? fmax(photo->gps_sigma_m[k], LEAST_SIGMA_M) : k < 2 ? across : up;
        if (isnan(prior->place[2])) prior->place[2] = prior->sigma[2] = 0.0;
    }
    return CN_OK;
}

cn_status cn_control_measure_gps(const cn_scene *scene, const cn_photo_index *index, double max_error_m,
                                 cn_frame *frame)
{
    double horizontal = 0.0, vertical = 0.0;
    uint32_t n = 0, n_heights = 0;
    for (uint32_t i = 0; i < scene->n_views; i++) {
        double gps[3], centre[3];
        bool found = false;
        if (scene->views[i].photo == UINT32_MAX) continue;
        CN_TRY(gps_of(&index->photos[scene->views[i].photo], frame, gps, &found));
        if (!found) continue;
        cn_view_centre(&scene->views[i], centre);
        const double across = hypot(centre[0] - gps[0], centre[1] - gps[1]);
        const double up = isnan(gps[2]) ? 0.0 : centre[2] - gps[2];
        if (hypot(across, VERTICAL_WEIGHT * up) > max_error_m) continue;
        horizontal += across * across;
        vertical += up * up;
        n_heights += !isnan(gps[2]);
        n++;
    }
    frame->n_inliers = n;
    frame->residual_horizontal_m = n ? sqrt(horizontal / n) : 0.0;
    frame->residual_vertical_m = n_heights ? sqrt(vertical / n_heights) : 0.0;
    return CN_OK;
}
