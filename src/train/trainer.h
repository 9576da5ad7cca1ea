/* State of one training run, carved from one arena before the first step. Private to train/. */
#ifndef CONURB_TRAIN_TRAINER_H
#define CONURB_TRAIN_TRAINER_H
#include "base/arena.h"
#include "conurb/train.h"
#include "effect/effect.h"
#include "field/field.h"
#include "field/occupancy.h"
#include "rays/rays.h"

enum {
    CN_GROUP = 32,       /* rays worked on together; fixed, so that results do not depend on the thread count */
    CN_GROUP_CAP = 4032, /* samples a group may have: 84 panels; rays past it sit the step out */
    CN_MAX_RAYS = 8192,
    CN_MAX_GROUPS = CN_MAX_RAYS / CN_GROUP,
    CN_SLOTS = 32, /* gradient accumulators; fixed, and summed in order */
    CN_MAX_TIES = 65536,
    CN_TIE_EVERY = 8, /* of the rays, one in so many goes through a tie point */
    CN_MAX_PARTS = 64 /* of a level of the table, each the work of one thread */
};

#define CN_RATE_HELD 0.85     /* of the schedule: then the learning rate falls (step.c) */
#define CN_LONGEST_STEP 0.125 /* of the march, over distance: where training starts */

/* A photo that is trained on. */
typedef struct cn_train_photo {
    cn_ray_generator generator;
    uint32_t store;
    cn_pixel_extent size;
} cn_train_photo;

/* A sparse point in a photo: its pixel in the pixel store, and how far away it is. */
typedef struct cn_tie {
    uint32_t photo;
    uint16_t x, y;
    float distance_m;
} cn_tie;

/* Parameters with their Adam moments and gradient. */
typedef struct cn_parameters {
    float *value, *m, *v, *grad;
    size_t n;
} cn_parameters;

typedef struct cn_step_stats {
    double squared_error; /* sum over rays and channels, display-encoded */
    double weighed_error,
        weight; /* that sum with the rays weighed as the loss weighs them, and the sum of their weights */
    uint64_t rays, samples, live, bad; /* bad: rays left out because something was not finite */
    double gradient;                   /* sum of the squares of all gradients */
} cn_step_stats;

/* What the guard knows of the run. Only doubles, for a checkpoint keeps it as an array. */
typedef struct cn_guard {
    double steps;              /* taken since the start, the last return, or since an effect set in */
    double loss, best;         /* squared error a channel, averaged over the last steps; the lowest that this was */
    double unexplained;        /* as loss, but weighed */
    double mean[3], square[3]; /* of the photos' display-encoded colours */
    double trouble;            /* grows with every step that is left out, shrinks with every good one */
    double skipped, returns;   /* steps left out, and returns to a good state, in all */
    double hooks;              /* of effects that take part */
} cn_guard;
enum { CN_GUARD_VALUES = 14, CN_GUARD_WHY = 160, CN_GUARD_MAX_RETURNS = 4 };

/* Scratch of one thread. */
typedef struct cn_worker {
    cn_field_acts acts, d;
    float *logit; /* [cap] and gradient of the same */
    float *d_logit;
    float *weight, *behind, *tau; /* [cap] live samples: weight, transmittance behind, optical thickness */
    uint32_t *live, *live_ray;
    float *colour;              /* [cap][3] */
    float *columns, *d_columns; /* [CN_GROUP][columns] */
    float (*d_pos)[3];          /* [cap], where an effect moves rays */
    float *keep;                /* what the effects keep for their backward pass */
    float *part_grad;           /* gradients of a part of a level, and where there are any; zero between uses */
    uint8_t *touched;
} cn_worker;

/* Where a ray's live samples lie in the worker's arrays; their weights' sum; the transmittance that is left at its end.
 */
typedef struct cn_span {
    uint32_t first, n;
    float total, after;
} cn_span;

/* What shading a group of rays takes, in training and in a fit alike. */
typedef struct cn_shade {
    const cn_kernel *kernel;
    const cn_field *field;
    cn_field_params params;
    const cn_effect_pack *pack;
    cn_effect_state effects;
    cn_effect_rays rays; /* at most CN_GROUP */
    const float *target; /* [rays][4] linear ACEScg and weight; a ray of weight 0 takes no part */
    float scale;         /* of a ray's loss: 1 / (3 rays of the step) */
} cn_shade;

typedef struct cn_trainer {
    const cn_context *ctx;
    const cn_train_input *input;
    cn_train_options options;
    const cn_kernel *kernel;
    cn_arena arena;
    cn_box box;
    float inv_extent;
    cn_field field;
    cn_effect_pack pack;
    uint32_t n_photos; /* training photos; rows of constants */
    cn_train_photo *photos;
    float *constants;
    float *run; /* [n_photos], see cn_runs_find; NULL where no effect asks for it */
    float (
        *place)[3]; /* [n_photos] camera centres, in units of the mean half extent; NULL where no effect moves rays */
    cn_tie *ties;   /* [CN_MAX_TIES], n_ties of them used */
    uint32_t n_ties;

    uint16_t *table, *table_state; /* as cn_kernel.adam_table has them; a level's state begins at a block of its own */
    size_t table_n, state_n;
    uint32_t level_parts;       /* a level's work is split in so many, a power of two */
    cn_parameters flat;         /* MLP weights, the effects' rows of photos, their shared parameters */
    size_t photo_at, shared_at; /* where these begin in flat */
    float *rows_before;         /* the rows before a step, where an effect has a rate of its own */
    float *derived;             /* what the effects derive of their shared parameters */
    float *transposed;
    cn_occupancy occ;
    uint8_t *usable;

    /* What a resume needs besides parameters and occupancy. */
    uint32_t step;
    double samples_per_group, march_step;
    uint64_t bad_rays;
    cn_guard guard;

    /* The batch. */
    uint32_t n_rays, n_groups;
    cn_ray *rays;
    float *dirs, *uv; /* [rays][3]; [rays][2], NULL where no effect asks for it */
    uint32_t *ray_photo, *ray_samples;
    float *target;     /* [rays][4] linear ACEScg and weight */
    uint8_t *ray_hole; /* [rays] ends in nothing where something should be */
    float *ray_tie;    /* [rays] distance of the sparse point that the ray goes through, metres; 0: none */
    float *march_t;    /* [groups][CN_GROUP_CAP] */
    uint32_t *group_samples, *group_live;
    size_t *group_panel; /* first panel of a group; SIZE_MAX: it did not fit */
    size_t n_panels, panel_cap;
    float *pos, *enc, *length;
    /* [CN_WITNESS_CELLS] photo that saw a cell last, step since when it was no other, how often; NULL where no effect
     * asks */
    float *witness, *changed, *alone;
    uint32_t *visit_witness; /* cell of every sample of the step among these; NULL with them */
    uint32_t *visit_cell;    /* occupancy cell of every sample of the step, and what was seen of it */
    float *visit_seen;
    uint32_t kept_rays, marched_rays; /* that take part; that have samples */
    float *slot_grad;                 /* [CN_SLOTS][flat.n] */
    cn_step_stats slot_stats[CN_SLOTS];
    cn_worker *workers;
    unsigned n_workers;
    cn_status read_status[CN_MAX_GROUPS];
    cn_step_stats stats; /* of the last step */
} cn_trainer;

/* Sets sizes from options and input (field, pack, counts); then carves. With a counting arena nothing is written. */
CN_NODISCARD cn_status cn_trainer_plan(cn_trainer *trainer, const cn_train_input *input,
                                       const cn_train_options *options, unsigned n_workers);
void cn_trainer_carve(cn_trainer *trainer, cn_arena *arena);
/* Entries of one of the level_parts parts of a level; none where a level has less. Whole blocks of state. */
cn_range cn_trainer_part(const cn_trainer *trainer, uint32_t level, uint32_t part);
/* State of a level's parameters. */
uint16_t *cn_trainer_state(const cn_trainer *trainer, uint32_t level);
/* Photos, constants, initial parameters, occupancy. */
CN_NODISCARD cn_status cn_trainer_begin(cn_trainer *trainer);
/* As new: what cn_trainer_begin left, whatever came after. The guard's counts are not touched. */
CN_NODISCARD cn_status cn_trainer_restart(cn_trainer *trainer);
void cn_trainer_deinit(cn_trainer *trainer);

/* Constants of every effect that is on, for the tile's training photos and then, as far as the pack has rows, its
 * held-out ones; centred on the training photos, 0 where a photo does not say. constants has pack->n_constants floats.
 */
void cn_train_constants(const cn_train_input *input, const cn_effect_pack *pack, float *constants);

/* One step of gradient descent: batch, forward, backward, Adam, occupancy. */
CN_NODISCARD cn_status cn_trainer_step(cn_trainer *trainer);
void cn_trainer_carve_worker(const cn_field *field, const cn_effect_pack *pack, cn_arena *arena, cn_worker *worker);

/* ---- shade.c ---- */
/* The effects' columns, a row a ray, spread over the live samples; then the colours of those. */
void cn_shade_forward(const cn_shade *shade, uint32_t n_live, cn_worker *worker);
/* Composites, and the loss: pixel[ray][3] becomes the gradient of the composited colour, d_after[ray] that of the ray's
 * last transmittance. Gradients of the effects' own parameters are added to grad. */
void cn_shade_loss(const cn_shade *shade, const cn_span *spans, cn_worker *worker, float (*pixel)[3], float *d_after,
                   const cn_effect_grad *grad, cn_step_stats *stats);
/* Gradients of the colour head's output (worker->d.out) of a ray's live samples. */
void cn_shade_colours_backward(const cn_span *span, const float d_pixel[3], cn_worker *worker);
/* From the gradient of the colour head's input to the effects' parameters. */
void cn_shade_columns_backward(const cn_shade *shade, uint32_t n_live, cn_worker *worker, const cn_effect_grad *grad);
/* Zeroes what the last panel holds past the last live sample. */
void cn_shade_clear_tail(const cn_field *field, uint32_t n_live, cn_worker *worker);

/* ---- composite.c ---- */
#define CN_SPREAD_LOSS 0.01f /* weight of the variance of log-distance of a ray's samples: fog becomes surface */
#define CN_BLUR_LOSS                                                                                                   \
    0.003f /* of its mean deviation, times doubt: where the variance is as good as nothing, what is left of the fog    \
              still costs */
#define CN_TIE_LOSS                                                                                                    \
    0.1f /* of the variance about a sparse point that the ray goes through (after Deng et al. 2022, "DS-NeRF") */
#define CN_TIE_BLUR_LOSS 0.2f /* of the mean deviation from it */
/* The live samples of a group: from logits to weights; enc and pos of these move together. seen may be NULL. */
uint32_t cn_composite_gather(const cn_field *field, const uint32_t *ray_samples, uint32_t n_rays, const float *length,
                             float *enc, float *pos, float *seen, cn_worker *worker, cn_span *spans);
/* Gradients of the density logits of one ray's live samples from those of its pixel and of what is left at its end,
 * with what the spread of its matter costs. t_at: distances of all samples of the ray's group; tie: distance of the
 * sparse point that it goes through, 0 for none; scale: of a ray's loss; doubt: cn_guard_doubt. */
void cn_composite_backward(const cn_span *span, const float d_pixel[3], float d_after, const float *t_at, float tie,
                           float scale, float doubt, cn_worker *worker);
/* Forward and backward of one group of rays into a gradient accumulator. */
void cn_trainer_group(cn_trainer *trainer, uint32_t group, cn_worker *worker, float *grad, cn_step_stats *stats);

/* ---- reopen.c ---- */
/* Notes what is left of a ray at its end; opens cells for those that say something is missing. */
void cn_reopen_note(cn_trainer *trainer, uint32_t ray, float after);
void cn_reopen_cells(cn_trainer *trainer);

/* ---- witness.c ---- */
enum { CN_WITNESS_CELLS = 1 << 22 };
/* The cell of a place in contracted space, 0 to 1. */
uint32_t cn_witness_cell(float x, float y, float z);
/* Cells about sparse points need no witnesses. */
void cn_witness_begin(cn_trainer *trainer);
/* Notes the cells of a group's samples, before the live ones move together. */
void cn_witness_note(cn_trainer *trainer, uint32_t group);
/* Notes what the rays of a group have seen. */
void cn_witness_update(cn_trainer *trainer, uint32_t group);
/* Adds to the gradients of the density logits of a ray what its matter in cells with one witness costs. */
void cn_witness_backward(const cn_trainer *trainer, uint32_t group, const cn_span *span, float scale,
                         cn_worker *worker);

/* ---- guard.c ---- */
/* Whether the step just computed may change the parameters; notes its loss. */
bool cn_guard_takes(cn_trainer *trainer);
/* True when training has to go back to a good state; says why. */
bool cn_guard_despairs(const cn_trainer *trainer, char why[CN_GUARD_WHY]);
/* True when the present state is one to come back to. */
bool cn_guard_content(const cn_trainer *trainer);
/* True when every parameter is finite. */
bool cn_guard_finite(const cn_trainer *trainer);
/* Forgets the losses, and keeps the counts. */
void cn_guard_begin_anew(cn_guard *guard);
/* 1 while the photos are not yet explained, and less the better they are: what is presumed of matter without a photo
 * that says so (that it is no fog, and that a ray ends) is weighed with it. */
float cn_guard_doubt(const cn_trainer *trainer);
/* Of the learning rate: a tenth for every return. */
double cn_guard_rate(const cn_trainer *trainer);

/* Checkpoint and tile (save.c). */
CN_NODISCARD cn_status cn_trainer_save_checkpoint(const cn_trainer *trainer, const char *key, const char *path);
CN_NODISCARD cn_status cn_trainer_load_checkpoint(cn_trainer *trainer, const char *key, const char *path,
                                                  bool *resumed);
CN_NODISCARD cn_status cn_trainer_save_tile(const cn_trainer *trainer, const char *parent_hash, const char *path);
#endif
