/* How good poses are: what poses/report.json and poses/report.html say. */
#ifndef CONURB_POSE_QUALITY_H
#define CONURB_POSE_QUALITY_H
#include "pose/control_fit.h"
#include "pose/grouped.h"
#include "pose/import_check.h"
#include "pose/ladder.h"

enum { CN_QUALITY_BINS = 40 };
#define CN_QUALITY_MOST_PX 4.0 /* end of the histogram; the last bin has all that is beyond */

typedef struct cn_view_quality {
    double centre[3];  /* local frame */
    double off_m[3];   /* centre minus GPS; NaN: unknown */
    double sigma_m[3]; /* that the photo states of its GPS; 0: none */
    bool agrees;       /* within poses.max_error_m of its GPS */
    uint32_t n_seen;   /* sparse points */
    double error_px;   /* mean reprojection error; NaN without points */
} cn_view_quality;
typedef struct cn_missing_photo {
    uint32_t photo;
    uint32_t n_features, n_verified; /* of the photo; matches with its best partner that COLMAP verified */
    double sharpness;                /* beside that of posed photos, 1: equal; NaN: not measured */
    bool has_place;
    double place[3]; /* by its GPS */
    char why[240];   /* in plain words */
} cn_missing_photo;
typedef struct cn_camera_quality {
    double focal_px, exif_px; /* NaN: EXIF states none */
    uint32_t n_views;
} cn_camera_quality;

/* Borrows the poses. */
typedef struct cn_quality {
    const cn_photo_index *index;
    const cn_scene *scene;
    const cn_frame *frame;
    const cn_control *control; /* NULL: none */
    const cn_control_fit *fit;
    const char *source; /* "COLMAP", or the imported file */
    const char *import; /* the file of poses.import, NULL: none; `verdict` tells what became of it */
    cn_import_verdict verdict;
    const char *way;           /* the attempt that held, NULL for imports */
    const cn_grouped *grouped; /* NULL: not posed in groups */
    uint32_t attempt, n_models;
    cn_view_quality *views;
    cn_missing_photo *missing;
    uint32_t n_missing;
    cn_camera_quality *cameras;
    uint64_t histogram[CN_QUALITY_BINS]; /* of reprojection errors */
    double off_rms_m[3];                 /* of the photos that agree with their GPS; NaN without any */
    double mean_error_px;
} cn_quality;

typedef struct cn_quality_task {
    const cn_context *ctx;
    const cn_pose_options *options;
    const cn_colmap_choice *choice; /* NULL: imported */
    const char *groups_dir;         /* of the poses stage, when the photos were posed in groups; else NULL */
} cn_quality_task;
/* Fills q, whose borrowed members are set. The caller frees it with cn_quality_deinit; it has no arrays on failure. */
CN_NODISCARD cn_status cn_quality_measure(const cn_quality_task *task, cn_quality *q);
void cn_quality_deinit(cn_quality *q);
/* What became of the imported poses, as a word for report.json. */
const char *cn_quality_outcome(const cn_quality *q);
/* Why the photos in q->missing have no pose, by COLMAP's database and by their sharpness. What cannot be read is not
 * an error: the reason is then a general one. */
void cn_quality_explain(const cn_quality_task *task, cn_quality *q);
/* Write report.json and report.html. The page needs no other file and no network. CN_ERR_IO, CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_quality_save_json(const cn_quality *q, const char *path);
CN_NODISCARD cn_status cn_quality_save_page(const cn_quality *q, const char *path);
#endif
