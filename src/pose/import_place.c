/* The frame of imported poses whose file says where its origin lies. */
#include "geo/geoid.h"
#include "math/linalg.h"
#include "pose/align.h"
#include "pose/align_up.h"
#include "pose/import.h"

#include <math.h>
#include <stdlib.h>

#define FEWEST_GPS 3

typedef struct misfit {
    double *far_m; /* horizontal distance of each photo with GPS */
    uint32_t n;
    double squares, vertical;
} misfit;

static cn_status measure(const cn_scene *scene, const cn_photo_index *index, const cn_frame *frame, misfit *out)
{
    for (uint32_t i = 0; i < scene->n_views; i++) {
        const cn_photo *photo = &index->photos[scene->views[i].photo];
        double centre[3], gps[3];
        if (!photo->has_gps) continue;
        const double height_m = photo->has_altitude ? photo->altitude_m + frame->geoid_height_m : frame->height_m;
        const double at[3] = { photo->latitude_deg, photo->longitude_deg, height_m };
        CN_TRY(cn_frame_from_geodetic(frame, at, gps));
        cn_view_centre(&scene->views[i], centre);
        const double far_m = hypot(centre[0] - gps[0], centre[1] - gps[1]);
        out->far_m[out->n++] = far_m;
        out->squares += far_m * far_m;
        out->vertical += (centre[2] - gps[2]) * (centre[2] - gps[2]);
    }
    return CN_OK;
}

static cn_status make_frame(const cn_import_origin *origin, cn_frame *frame)
{
    bool found = false;
    double geoid_m;
    cn_frame_init(frame);
    CN_TRY(cn_geo_geoid_height(origin->latitude_deg, origin->longitude_deg, &geoid_m, &found));
    frame->georeferenced = true;
    frame->latitude_deg = origin->latitude_deg;
    frame->longitude_deg = origin->longitude_deg;
    frame->geoid_height_m = geoid_m;
    frame->geoid_applied = found || !origin->sea_level;
    frame->height_m = origin->height_m + (origin->sea_level ? geoid_m : 0.0);
    return CN_OK;
}

/* Poses whose place on Earth is to be found, and how far GPS may be off. */
typedef struct posed {
    const cn_scene *scene;
    const cn_photo_index *index;
    double max_error_m;
} posed;

/* *keep: the frame of the file holds; `frame` is it then. */
static cn_status try_origin(const cn_context *ctx, const posed *p, const cn_import_origin *origin, cn_frame *frame,
                            bool *keep)
{
    const cn_scene *scene = p->scene;
    misfit m = { .far_m = calloc(scene->n_views + (size_t)1, sizeof *m.far_m) };
    if (!m.far_m) return cn_fail(CN_ERR_NOMEM, "out of memory placing %u photos", scene->n_views);
    cn_status status = make_frame(origin, frame);
    if (status == CN_OK) status = measure(scene, p->index, frame, &m);
    const double typical_m = status == CN_OK && m.n ? cn_select(m.far_m, m.n, m.n / 2) : 0.0;
    free(m.far_m);
    CN_TRY(status);
    *keep = m.n < FEWEST_GPS || typical_m <= p->max_error_m;
    if (!*keep) {
        cn_log(ctx, CN_LOG_WARN,
               "the file of the poses states an origin from which the photos' GPS is %.1f m off: the poses are aligned "
               "to GPS instead",
               typical_m);
        return CN_OK;
    }
    frame->n_gps = frame->n_inliers = m.n;
    frame->residual_horizontal_m = m.n ? sqrt(m.squares / m.n) : 0.0;
    frame->residual_vertical_m = m.n ? sqrt(m.vertical / m.n) : 0.0;
    frame->nadir_ambiguous = cn_align_is_nadir(scene);
    cn_log(ctx, CN_LOG_INFO,
           "the poses keep the place that their file states: %.6f, %.6f; GPS of %u photos: %.2f m off",
           frame->latitude_deg, frame->longitude_deg, m.n, frame->residual_horizontal_m);
    return CN_OK;
}

cn_status cn_import_place(const cn_context *ctx, cn_scene *scene, const cn_photo_index *index, double max_error_m,
                          const cn_import_origin *origin, cn_frame *frame)
{
    bool keep = false;
    if (origin->known) CN_TRY(try_origin(ctx, &(posed){ scene, index, max_error_m }, origin, frame, &keep));
    /* Phones and survey programs know which way is down; their pictures may lie on the side. */
    const cn_levelling level = origin->arbitrary_axes ? CN_LEVEL_TILTED : CN_LEVEL_NEVER;
    return keep ? CN_OK : cn_align(ctx, scene, index, max_error_m, level, frame);
}
