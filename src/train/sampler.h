/* Which rays a step takes: random pixels of the training photos, and pixels of sparse points, whose depth is known.
 * Private to train/. */
#ifndef CONURB_TRAIN_SAMPLER_H
#define CONURB_TRAIN_SAMPLER_H
#include "conurb/train.h"
#include "effect/vignetting.h"
#include "stereo/stereo.h"
#include "train/batch.h"

enum {
    /* The most sparse depth samples. Of a synthetic city's 0.6 million, 60000 were too few
     * (tests/bench/experiments.md). */
    CN_MAX_SPARSE = 1 << 19,
    CN_SPARSE_EVERY = 8 /* one ray in so many goes through a sparse point */
};
#define CN_LONGEST_STEP 0.125 /* length of a march's step over its distance, at the start of training */
/* Fraction of the schedule at which the learning rate begins to fall (optimiser.c) and the march's steps get shorter.
 */
#define CN_RATE_HELD 0.85

/* A photo that is trained on. */
typedef struct cn_train_photo {
    cn_ray_generator generator;
    uint32_t store;
    cn_pixel_extent size;
    cn_vignetting vignetting;
    float depth_scale, depth_shift; /* from its depth map to metres; scale 0: there is none */
} cn_train_photo;

/* A sparse depth sample: a sparse point as a photo sees it. Its pixel in the pixel store, and its distance. */
typedef struct cn_sparse_sample {
    uint32_t photo;
    uint16_t x, y;
    float distance_m;
} cn_sparse_sample;

/* What adapts from step to step. It has only doubles, because a checkpoint keeps it as an array. */
typedef struct cn_pace {
    double samples_per_group, march_step; /* march_step: length of a step over its distance */
} cn_pace;
enum { CN_PACE_VALUES = 2 };

typedef struct cn_sampler {
    const cn_pixel_store *pixels;
    uint64_t seed;
    uint32_t n_photos; /* training photos */
    cn_train_photo *photos;
    cn_sparse_sample *sparse; /* [CN_MAX_SPARSE], n_sparse of them used */
    uint32_t n_sparse;
    uint8_t *sky_hint;     /* [n_photos][CN_SKY_HINTS] by cn_sky_hints_find; NULL where no effect asks for it */
    uint32_t n_depth;      /* photos with a depth map that is used */
    cn_stereo_map *stereo; /* [n_photos] depths by stereo; NULL where no effect asks for them. Not in the arena */
    uint32_t n_normal;     /* photos with a normal map */
    bool depth_along_ray;  /* else along the camera's axis */
    float near_m;          /* of the box: where marches begin */
    cn_pace pace;
    cn_status read_status[CN_MAX_GROUPS];
} cn_sampler;

/* Where the schedule stands. */
typedef struct cn_step_at {
    uint32_t step, steps;
} cn_step_at;
static inline double cn_step_progress(cn_step_at at)
{
    return at.steps ? (double)at.step / at.steps : 1;
}

void cn_sampler_carve(cn_sampler *sampler, cn_arena *arena, bool wants_sky_hints);
/* Sets the photos alone. */
CN_NODISCARD cn_status cn_sampler_find_photos(cn_sampler *sampler, const cn_train_input *input, const cn_box *box);
/* Sets the photos, the sparse depth samples, and the pace at the start. */
CN_NODISCARD cn_status cn_sampler_begin(cn_sampler *sampler, const cn_train_input *input, const cn_box *box);
/* Finds the photos' vignetting, which is then taken out of the pixels that are drawn. */
CN_NODISCARD cn_status cn_sampler_find_vignetting(cn_sampler *sampler, const cn_train_input *input);
/* How depth maps become distances (depth.c). Measured ones get one factor, the median over the sparse depth samples,
 * for poses without GPS have a scale of their own. Cues get a scale and a shift a photo by least squares over its
 * samples; photos with too few of them are left out, and the log says how many. */
CN_NODISCARD cn_status cn_sampler_fit_depth(cn_sampler *sampler, const cn_context *ctx, const cn_train_input *input,
                                            cn_depth_kind kind);
/* Finds depths by stereo, which then stand for the depth maps; once, also when training begins again. The owner of the
 * sampler frees them with cn_sampler_deinit. */
CN_NODISCARD cn_status cn_sampler_find_stereo(cn_sampler *sampler, const cn_context *ctx, const cn_train_input *input);
void cn_sampler_deinit(cn_sampler *sampler);
/* Writes the distances of a group's rays by the depth maps to batch->measured_m. x, y: the rays' pixels. */
CN_NODISCARD cn_status cn_sampler_read_depth(const cn_sampler *sampler, uint32_t group, const uint16_t *x,
                                             const uint16_t *y, cn_batch *batch);
/* Counts the photos with a normal map. */
void cn_sampler_find_normals(cn_sampler *sampler);
/* Where photos have normal maps, every fourth ray is the neighbour of the ray before it (normals.c). */
static inline bool cn_sampler_is_neighbour(uint32_t ray)
{
    return ray % 4 == 3;
}
/* Moves ray r, which is a neighbour, to a pixel near that of ray r - 1. at: the pixel of ray r - 1; is set to that of
 * ray r. False, and nothing is changed: the photo has no normal map. */
bool cn_sampler_draw_neighbour(const cn_sampler *sampler, uint32_t step, uint32_t r, cn_batch *batch, uint16_t at[2]);
/* Reads the normals of a group's pairs of neighbours and sets batch->plane_log and batch->plane_width. x, y: the rays'
 * pixels. */
CN_NODISCARD cn_status cn_sampler_read_normals(const cn_sampler *sampler, uint32_t group, const uint16_t *x,
                                               const uint16_t *y, cn_batch *batch);
/* Marks in usable[CN_OCC_CELLS] the occupancy cells that two training photos can see, or that one can see farther away
 * than its nearest sparse points. */
CN_NODISCARD cn_status cn_sampler_usable_cells(const cn_sampler *sampler, cn_pool *pool, const cn_box *box,
                                               uint8_t *usable);
/* What leads the field at a point of the schedule, beside the photos' colours. */
typedef struct cn_lead {
    bool sparse;    /* some rays go through sparse points */
    uint8_t no_sky; /* what CN_SKY_NONE is at this point: that, CN_SKY_NONE_LATE or CN_SKY_NONE_LAST */
} cn_lead;
/* The fraction of a schedule in which it leads; 1 in a short one. */
double cn_lead_end(uint32_t steps);
cn_lead cn_sampler_lead(const cn_sampler *sampler, cn_step_at at, bool moves_rays);
/* Draws the pixels of a group, reads them, makes their rays, and says where their marches begin. read_status[group]
 * tells whether reading worked. */
void cn_sampler_draw(cn_sampler *sampler, uint32_t step, cn_lead lead, uint32_t group, cn_batch *batch);
/* The row of a photo of all directions that a random number from 0 to 1 draws. */
uint32_t cn_sampler_sphere_row(float drawn, uint32_t height);
/* The error when photos cannot be read in training. */
cn_status cn_sampler_unreadable(cn_status status);
/* How many groups the next step takes. */
uint32_t cn_sampler_groups(const cn_sampler *sampler, uint32_t samples_per_step);
/* Notes how many samples the groups of a step had. */
void cn_sampler_note_groups(cn_sampler *sampler, uint64_t samples, uint32_t n_groups);
/* Whether rays have fewer samples than they may have, though the march's steps are as short as they can be. */
bool cn_sampler_has_room(const cn_sampler *sampler, double samples_per_ray, cn_step_at at, bool moves_rays,
                         double shortest);
/* Adapts the length of the march's steps to the samples that a ray had, but not below `shortest`. */
void cn_sampler_adapt_march(cn_sampler *sampler, double samples_per_ray, cn_step_at at, bool moves_rays,
                            double shortest);
#endif
