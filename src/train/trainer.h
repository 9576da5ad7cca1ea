/* One training run. Its parts are carved from one arena before the first step. Each part has its own header and does
 * not know the trainer. Private to train/. */
#ifndef CONURB_TRAIN_TRAINER_H
#define CONURB_TRAIN_TRAINER_H
#include "conurb/train.h"
#include "device/device.h"
#include "field/occupancy.h"
#include "loss/loss.h"
#include "train/distil.h"
#include "train/effects.h"
#include "train/looks.h"
#include "train/monitor.h"
#include "train/optimiser.h"
#include "train/parameters.h"
#include "train/reactivation.h"
#include "train/sampler.h"
#include "train/shade.h"
#include "train/support.h"
#include "train/worker.h"

enum { CN_SLOTS = CN_STEP_SLOTS }; /* gradient accumulators: a fixed number, summed in order */

/* The photos as other devices read them (photos_on_device.c): a record of each, and their maps. */
typedef struct cn_train_map {
    uint32_t photo, kind;
} cn_train_map;
enum { CN_TRAIN_MAPS = 4 }; /* of a photo, at most: pixels, directions, depths, normals */
typedef struct cn_train_photos {
    cn_step_photo *record; /* [photos] */
    cn_train_map *map;     /* [n] */
    uint64_t *bytes;       /* [n] */
    uint32_t n;
} cn_train_photos;
typedef struct cn_train_photos_wants {
    bool depths, stereo, normals; /* maps that training reads; depths stand before stereo */
} cn_train_photos_wants;

/* What other devices need to do a step, besides the arrays of the trainer's parts (on_device.c). */
typedef struct cn_train_device {
    cn_step_batch step;
    cn_train_photos photos;
    float *conditioning, *pixel, *d_pixel, *d_columns, *d_rays, *sums; /* as in cn_step_array */
    float *factor, *open_t;
} cn_train_device;

typedef struct cn_trainer {
    const cn_context *ctx;
    const cn_train_input *input;
    cn_train_options options;
    const cn_kernel *kernel;
    cn_arena arena;
    cn_box box;
    float inv_extent;

    cn_sampler sampler;
    cn_batch batch;
    cn_parameters parameters;
    cn_train_effects effects;
    cn_optimiser optimiser;
    cn_occupancy occ;
    uint8_t *usable; /* occupancy cells that two photos or more can see */
    cn_looks looks;  /* what the photos see; none where no effect asks for sky hints */
    cn_reactivation reactivation;
    cn_support support;
    cn_monitor monitor;
    cn_distil distil;    /* the teacher */
    cn_loss_pack losses; /* the terms that are on in this step */

    uint32_t step;
    uint64_t bad_rays;
    bool ending;         /* early stopping has set the end of the schedule, which is then fixed */
    cn_step_stats stats; /* of the last step */

    cn_train_device device;

    float *slot_grad; /* [CN_SLOTS][parameters.n] */
    cn_step_stats slot_stats[CN_SLOTS];
    cn_worker *workers;
    unsigned n_workers;
} cn_trainer;

/* Sets sizes from options and input, then carves the parts. A counting arena writes nothing. */
CN_NODISCARD cn_status cn_trainer_plan(cn_trainer *trainer, const cn_train_input *input,
                                       const cn_train_options *options, unsigned n_workers);
void cn_trainer_carve(cn_trainer *trainer, cn_arena *arena);
/* Sets the photos, the constants, the first parameters and the occupancy. */
CN_NODISCARD cn_status cn_trainer_begin(cn_trainer *trainer);
/* Goes back to the state after cn_trainer_begin. The counts of the monitor stay. */
CN_NODISCARD cn_status cn_trainer_restart(cn_trainer *trainer);
void cn_trainer_deinit(cn_trainer *trainer);

/* One step of gradient descent: batch, forward, backward, Adam, occupancy. */
CN_NODISCARD cn_status cn_trainer_step(cn_trainer *trainer);
/* The forward and backward pass of one group of rays. Adds to a gradient accumulator (group.c). */
void cn_trainer_group(cn_trainer *trainer, uint32_t group, cn_worker *worker, float *grad, cn_step_stats *stats);

/* Shading of a group of rays. */
cn_shade cn_trainer_shade(const cn_trainer *trainer, uint32_t group);
/* Weight of depths that nobody measured, and of the mean deviation from them. */
float cn_trainer_cue_weight(const cn_trainer *trainer);
float cn_trainer_cue_deviation(const cn_trainer *trainer);
/* The first sample behind a surface lies half a step behind it on average. A sparse point's distance is multiplied by
 * this. */
static inline float cn_trainer_late(const cn_trainer *trainer)
{
    return (float)(1 + 0.5 * trainer->sampler.pace.march_step);
}

/* Sizes and arrays for other devices; what a step is like, before it; and before its update. */
void cn_train_device_carve(cn_train_device *device, const cn_trainer *trainer, cn_arena *arena);
void cn_train_device_begin(cn_trainer *trainer);
void cn_train_device_step(cn_trainer *trainer, cn_lead lead);
void cn_train_device_update(cn_trainer *trainer, double rate);
/* The sums of the step's loss, if a device has computed them. */
bool cn_train_device_stats(const cn_trainer *trainer, cn_step_stats *stats);
/* What the device has to know of the effects in this step, and what of them the processor does. */
void cn_train_device_effects(cn_trainer *trainer);
/* Whether a device does all of these effects. */
bool cn_train_device_does(const cn_effect_pack *pack);
void cn_train_photos_carve(cn_train_photos *photos, uint32_t n_photos, cn_arena *arena);
/* Lists the photos of the sampler and their maps. */
void cn_train_photos_list(cn_train_photos *photos, const cn_sampler *sampler, const cn_train_photos_wants *wants);
/* Writes a map to `to`. Errors as of cn_sampler_unreadable. */
CN_NODISCARD cn_status cn_train_photos_read(const cn_train_photos *photos, const cn_sampler *sampler,
                                            const cn_context *ctx, uint32_t map, void *to);
/* The maps that the options and the effects ask for. */
cn_train_photos_wants cn_train_photos_wanted(const cn_train_options *options, const cn_effect_pack *pack);

/* The state that the next step depends on. Random numbers are counter-based, so the step's number is their state. */
CN_NODISCARD cn_status cn_trainer_save_checkpoint(cn_trainer *trainer, const char *key, const char *path);
CN_NODISCARD cn_status cn_trainer_load_checkpoint(cn_trainer *trainer, const char *key, const char *path,
                                                  bool *resumed);
/* Writes the present tile (tile.c). */
CN_NODISCARD cn_status cn_trainer_save_tile(const cn_trainer *trainer, const char *parent_hash, const char *path);

static inline cn_step_at cn_trainer_at(const cn_trainer *trainer)
{
    return (cn_step_at){ trainer->step, trainer->options.steps };
}
#endif
