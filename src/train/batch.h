/* The rays of one step and their samples, in groups. A group is the unit of work. Its size is fixed, so that results do
 * not depend on the number of threads. Private to train/. */
#ifndef CONURB_TRAIN_BATCH_H
#define CONURB_TRAIN_BATCH_H
#include "base/arena.h"
#include "device/step.h"
#include "kernel/kernel.h"
#include "rays/rays.h"

enum {
    CN_GROUP = 32,       /* rays of a group */
    CN_GROUP_CAP = 4032, /* the most samples of a group: 84 panels; rays without room are left out of the step */
    CN_MAX_RAYS = 8192,
    CN_MAX_GROUPS = CN_MAX_RAYS / CN_GROUP
};

typedef struct cn_batch {
    uint32_t n_rays, n_groups;
    cn_ray *rays;
    float *dirs, *uv;  /* [rays][3]; [rays][2], NULL where no effect asks for it */
    uint8_t *sky_hint; /* [rays] whether the photo shows sky there; NULL where no effect asks for it */
    uint32_t *ray_photo, *ray_samples;
    float *target;     /* [rays][4] linear ACEScg and weight; a ray of weight 0 takes no part */
    float *depth_m;    /* [rays] distance of the sparse point that the ray goes through; 0: none */
    float *measured_m; /* [rays] distance by the photo's depth map; 0: none; NULL where no photo has depth maps */
    /* Neighbouring rays of one photo whose normals agree lie on one plane: cn_sampler_read_normals. NULL where no photo
     * has normal maps. */
    float *plane_log;   /* [rays] log-distance of the ray less that of its neighbour (ray ^ 1), on the plane */
    float *plane_width; /* [rays] change of that difference for a turn of the plane by one radian; 0: no plane */
    float *first_t; /* [rays] where the march of a ray begins; drawn with it, as powers of devices differ in the last
                     * bit */
    float *march_t; /* [groups][CN_GROUP_CAP] distances of the samples */
    uint32_t *group_samples, *group_live;
    size_t *group_panel; /* first panel of a group; SIZE_MAX: there was no room for it */
    size_t panel_cap;
    cn_step_counts *counts;    /* set by cn_batch_lay_out */
    float *pos, *enc, *length; /* panels: positions, encodings (later their gradients), lengths of samples */
    uint32_t *visit_cell;      /* [lanes] occupancy cell of every sample ... */
    float *visit_seen;         /* ... and how much of it was seen */
    uint32_t enc_rows;         /* rows of a panel of enc */
} cn_batch;

/* How the rays of a step are marched. */
typedef struct cn_batch_march {
    const cn_kernel *kernel;
    const cn_box *box;
    const uint32_t *occupied; /* occupancy bits */
    double step;              /* length over distance */
} cn_batch_march;

/* Sets the room for panels: what samples_per_step asks for, and some more. */
void cn_batch_size(cn_batch *batch, uint32_t samples_per_step, uint32_t enc_rows);
/* Optional arrays of the rays. */
typedef struct cn_batch_wants {
    bool uv, sky_hint, measured, planes;
} cn_batch_wants;
void cn_batch_carve(cn_batch *batch, cn_arena *arena, cn_batch_wants wants);
/* Sets a group's dirs from its rays, which a device may have drawn. */
void cn_batch_note_dirs(cn_batch *batch, uint32_t group);
/* Marches one ray from its first_t. Writes the distances of its samples to `at`, which has room for `room` of them. A
 * ray that does not fit gets weight 0. */
uint32_t cn_batch_march_ray(cn_batch *batch, uint32_t ray, const cn_batch_march *march, float *at, uint32_t room);
/* Gives each group its panels, until none is left, and counts rays and samples. */
void cn_batch_lay_out(cn_batch *batch);
/* Positions and lengths of a group's samples. */
void cn_batch_place(cn_batch *batch, const cn_kernel *kernel, float march_step, float inv_extent, uint32_t group);
/* Notes the occupancy cells of a group's samples, before the live ones move together. */
void cn_batch_note_cells(cn_batch *batch, uint32_t group);
static inline bool cn_batch_has(const cn_batch *batch, uint32_t group)
{
    return batch->group_panel[group] != SIZE_MAX;
}
static inline size_t cn_batch_panels(uint32_t samples)
{
    return (samples + (size_t)CN_PANEL - 1) / CN_PANEL;
}
#endif
