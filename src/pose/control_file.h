/* What the readers of control points share. */
#ifndef CONURB_POSE_CONTROL_FILE_H
#define CONURB_POSE_CONTROL_FILE_H
#include "pose/control.h"
#include "pose/finder.h"

/* A file that is being read. Places are in the file's own coordinates until it is complete. */
typedef struct cn_control_file {
    const cn_context *ctx;
    const cn_control_source *source;
    cn_photo_finder finder;
    cn_control *to;
    uint32_t room_points, room_marks, n_missing; /* n_missing: marks in photos that are not in the index */
    char crs[512];
} cn_control_file;

/* The point of that name; it is added when it is new. place NULL: the file states no place here. CN_ERR_FORMAT: the
 * point has another place already. */
CN_NODISCARD cn_status cn_control_file_point(cn_control_file *file, const char *name, const double place[3],
                                             uint32_t *point);
/* Adds a mark. x, y: pixels of the stored photo, from its upper left corner; fractions: of OpenSfM, from its centre,
 * in units of its longer side. CN_ERR_FORMAT: the point has a mark in this photo already, or it is outside. */
typedef struct cn_control_seen {
    uint32_t point;
    const char *photo;
    double x, y;
    bool fractions;
} cn_control_seen;
CN_NODISCARD cn_status cn_control_file_mark(cn_control_file *file, const cn_control_seen *seen);

/* The readers of text and of JSON. */
CN_NODISCARD cn_status cn_control_read_list(cn_control_file *file);
CN_NODISCARD cn_status cn_control_read_table(cn_control_file *file);
CN_NODISCARD cn_status cn_control_read_json(cn_control_file *file);
#endif
