/* Ground control: points whose place is surveyed, and where photos show them. */
#ifndef CONURB_POSE_CONTROL_H
#define CONURB_POSE_CONTROL_H
#include "conurb/pose.h"

typedef struct cn_control_mark {
    uint32_t point, photo;
    double x_px, y_px; /* in the upright photo, as cn_observation */
} cn_control_mark;
typedef struct cn_control_point {
    char *name;
    double place[3];   /* latitude, longitude (degrees, WGS84), height above the ellipsoid; NaN: no height */
    double sigma_m[3]; /* standard deviation to the east, to the north, upwards; 0: the file states none */
    bool check;        /* only measured: no part of alignment and adjustment */
    uint32_t n_marks;
} cn_control_point;
typedef struct cn_control {
    cn_control_point *points;
    uint32_t n_points;
    cn_control_mark *marks; /* sorted by point, then by photo */
    uint32_t n_marks;
    bool by_egm96; /* heights above sea level were converted by EGM96 */
} cn_control;

typedef struct cn_control_source {
    const cn_photo_index *index;
    const char *path;
    const char *check; /* names of check points, separated by commas; NULL: those that the file marks */
    bool sea_level;    /* heights are above sea level, where the coordinate system does not say it */
} cn_control_source;

/* Reads a file of control points, chosen by its content:
 *   gcp_list.txt of ODM: a coordinate system, then lines of x y z px py photo [name]
 *   ground_control_points.json of OpenSfM
 *   a table (CSV): a coordinate system, then a line with the names of the columns: name, x, y, z, photo, px, py, and
 *   perhaps sigma_xy, sigma_z (metres) and check (1 or 0). A row is a mark of a point in a photo. A point's place may
 *   be in each of its rows, or in one row without a photo.
 * Pixels of all are those of the stored photo, whose first pixel has its centre at (0, 0), as in OpenSfM. Marks in
 * photos that are not in the index are left out, with a warning. The caller frees it with cn_control_deinit; it is
 * empty on failure. CN_ERR_FORMAT: the file is damaged or contradicts itself. CN_ERR_DATA: no photo has a mark, or
 * PROJ cannot convert the places. */
CN_NODISCARD cn_status cn_control_read(const cn_context *ctx, const cn_control_source *source, cn_control *out);
void cn_control_deinit(cn_control *control);
#endif
