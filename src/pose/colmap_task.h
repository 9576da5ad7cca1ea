/* What COLMAP is to pose, and how. */
#ifndef CONURB_POSE_COLMAP_TASK_H
#define CONURB_POSE_COLMAP_TASK_H
#include "conurb/pose.h"

/* Which attempt was kept. */
typedef struct cn_colmap_choice {
    uint32_t attempt; /* from 1 */
    const char *way;  /* its name in plain words; a constant */
    char *database;   /* path; the caller frees it */
} cn_colmap_choice;

typedef struct cn_colmap_task {
    const cn_context *ctx;
    const cn_photo_index *index;
    const char *dir; /* an existing folder */
    const cn_pose_options *options;
    bool fix_focal;           /* keeps the focal length of EXIF */
    bool rig_views;           /* photos are views of rigs: a rig has a pose when some of its views have */
    const bool *core;         /* of each photo: it has to have a pose here. The others are in the core of another group,
                               * where their neighbours are, so fewer of them will do. NULL: all are core. Borrowed. */
    bool colmaps_global;      /* maps all photos at once by COLMAP's global mapper, where the program has one */
    cn_colmap_choice *choice; /* NULL, or filled with what was kept */
} cn_colmap_task;
#endif
