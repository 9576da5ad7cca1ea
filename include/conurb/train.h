/* conurb/train.h: trains one tile, fits an appearance, and predicts what training costs. */
#ifndef CONURB_TRAIN_H
#define CONURB_TRAIN_H
#include "conurb/base.h"
#include "conurb/field.h"
#include "conurb/photo.h"
#include "conurb/plan.h"
#include "conurb/pose.h"
#include "conurb/tile.h"
#ifdef __cplusplus
extern "C" {
#endif

/* Precision of products in the networks during training: the fastest that this processor has, which may be bfloat16,
 * or float. Sums are always float. */
typedef enum cn_precision { CN_PRECISION_FASTEST, CN_PRECISION_FLOAT } cn_precision;

typedef struct cn_train_options {
    uint64_t seed;
    uint32_t steps;            /* length of the schedule, over which the learning rate decays */
    uint32_t steps_per_photo;  /* 0, or `steps` is at most so many for each photo of the tile (cn_train_steps) */
    double time_budget_s;      /* 0: none. Else `steps` is replaced by what fits, after a short measurement */
    uint32_t samples_per_step; /* target; the number of rays per step is adapted to it */
    cn_field_options field;    /* the field type and its settings */
    const char *teacher; /* for a field that learns from a tile first (kilo): its tile.safetensors, or a folder with
                            ID/tile.safetensors for each tile. NULL: cn_train_tile trains one. Borrowed */
    cn_field_options teacher_field; /* of that one, and its schedule */
    uint32_t teacher_steps;         /* at most `steps` are done */
    cn_precision precision;
    bool normal_maps;         /* use the normal maps of the pixel store, where photos have them */
    bool depth_maps;          /* use the depth maps of the pixel store, where photos have them */
    cn_depth_kind depth_kind; /* as in cn_photo_maps */
    cn_depth_along depth_along;
    bool leave_out_occluders; /* what only one photo shows, in front of what others see; default true */
    double learning_rate;
    double march_step;         /* a sample's step divided by its distance, at the end of the schedule; longer before */
    double checkpoint_every_s; /* seconds between checkpoints; default 60 */
    uint32_t good_every;       /* steps between states to roll back to; default 1024; 0: only the start */
    double stop_gain_db; /* early stopping; 0: never. The schedule changes to its end, where the learning rate falls,
                            when one more minute is expected to raise the validation PSNR by less than this */
    double validate_every_s; /* seconds between validations; default 20 */
    /* Scores the tile at DIR/validation/ID/tile.safetensors (dir of cn_train_tile), with DONE beside it. The photos
     * must be used neither for training nor for the final score. NULL: no early stopping. */
    cn_status (*validate)(void *user, double *psnr);
    void *validate_user;
    bool choose; /* with a time budget: the caller wants field size and march step chosen by cn_train_choose */
} cn_train_options;
/* The options of a preset, with the hash grid. For another field type set .field with cn_field_options_preset. */
CN_API cn_train_options cn_train_options_preset(cn_quality quality);

/* The steps that a tile is trained for without a time budget: those of the options, or fewer for few photos. */
CN_API uint32_t cn_train_steps(const cn_train_options *options, const cn_plan_tile *tile);

/* What to train on. Borrowed. */
typedef struct cn_train_input {
    const cn_scene *scene;
    const cn_photo_index *photos;
    const cn_pixel_store *pixels;
    const cn_plan_tile *tile;
} cn_train_input;

typedef struct cn_train_result {
    uint32_t steps;
    double seconds, samples_per_s, train_psnr;
    uint64_t arena_bytes;
} cn_train_result;

/* Trains a tile in the folder `dir`. Writes log.jsonl (one line per report), checkpoint.safetensors, good.safetensors
 * (the state to roll back to), unfinished.safetensors (the tile as the checkpoint holds it, removed at the end), and at
 * the end tile.safetensors, metrics.json and, last, DONE. Resumes from the checkpoint when that has the same options.
 * parent_hash is stored in the tile and in the checkpoint.
 *
 * A step with a loss or gradient that is not finite is skipped and counted. Training has diverged when many steps are
 * skipped, when the loss explodes, or when it stays above the loss of a single colour. Then training rolls back to the
 * last good state, with a tenth of the learning rate, and warns in ctx->log. At the fifth time the tile fails.
 *
 * The same seed and instruction set give the same tile, unless time_budget_s or stop_gain_db is set: the clock then
 * changes the number of steps.
 *
 * A field that learns from a teacher gets one at DIR/teacher when the options name none: it is trained first, which
 * counts in `seconds` and takes a third of a time budget, and stays there.
 *
 * No two calls at the same time on one `dir`. CN_ERR_DATA: training diverges. CN_ERR_INTERNAL: tile->photos has
 * held-out photos. CN_ERR_INTERRUPTED: asked to stop; a checkpoint is written first. */
CN_API CN_NODISCARD cn_status cn_train_tile(const cn_context *ctx, const cn_train_input *input,
                                            const cn_train_options *options, const char *parent_hash, const char *dir,
                                            cn_train_result *result);
/* Rays whose colours are known. target[rays.n][4]: linear ACEScg and a weight >= 0. new_light: they are of a photo
 * whose light is not known; else the row that a fit starts from has their light, as when a tile is aligned to another.
 */
typedef struct cn_lit_rays {
    cn_ray_list rays;
    const float *target;
    bool new_light;
} cn_lit_rays;
/* Fits an appearance to rays of known colour; the tile does not change (Martin-Brualla et al. 2021, section 5).
 * *appearance is the start of the fit and receives the best row found. *rmse: its error, display-encoded.
 *
 * Give the rays in order of place. Of many rays, 512 are used, evenly spaced in that order. A row is fitted to each
 * half of them and tested on the other half; each effect changes its part of the row only as far as that helps. Where
 * rays in a new light do not tell which sky they end in, it is that of the trained photos in such a light. A tile
 * without appearance keeps its row. CN_ERR_DATA: the tile sees too few of the rays. */
CN_API CN_NODISCARD cn_status cn_fit_appearance(const cn_context *ctx, const cn_tile *tile, const cn_lit_rays *lit,
                                                cn_appearance *appearance, double *rmse);
/* Predicts training with one thread per processor. bytes: exact, the size of the one arena that training allocates.
 * seconds: a rough figure, from a typical speed and not from this machine; cn_train_speed_predict measures. Any
 * thread. */
CN_API void cn_train_cost(const cn_train_options *options, const cn_plan_tile *tile, double *seconds, uint64_t *bytes);
/* The memory that training the tile takes on a graphics processor, of its own; 0: the processor has to train it. The
 * same on every device. Any thread. */
CN_API uint64_t cn_train_device_bytes(const cn_train_options *options, const cn_plan_tile *tile);
/* The memory that the tile's photos take there on top: their pixels, maps, and each camera's directions; exact but for
 * depths by stereo, which count with the most that they may have. With it the device draws the rays itself; where it is
 * not free, the processor draws them. 0: the processor draws them, whatever is free. input->photos is not used. Any
 * thread. */
CN_API uint64_t cn_train_device_photo_bytes(const cn_train_options *options, const cn_train_input *input);
/* The measured training speed of this machine. `cache`: a JSON file that keeps measurements from run to run, by
 * processor, instruction set, build, threads, settings and effects; NULL: none. A cache from another machine is
 * measured again. A cache that cannot be read or written is ignored. The caller destroys it. Use it from one thread at
 * a time. */
typedef struct cn_train_speed cn_train_speed;
CN_API CN_NODISCARD cn_status cn_train_speed_create(cn_train_speed **speed, const char *cache);
CN_API void cn_train_speed_destroy(cn_train_speed **speed);
/* Predicts seconds, and exact bytes, of training a tile with the threads of ctx. A speed that is not known yet is
 * measured by some dozens of real steps on a synthetic tile: this takes a second or two, and as much memory as the
 * training. CN_ERR_NOMEM, CN_ERR_INTERRUPTED, CN_ERR_CONFIG. */
CN_API CN_NODISCARD cn_status cn_train_speed_predict(const cn_context *ctx, cn_train_speed *speed,
                                                     const cn_train_options *options, const cn_plan_tile *tile,
                                                     double *seconds, uint64_t *bytes);
/* The options of a preset, with the seed, learning rate, checkpoint times and time budget of a request. */
CN_API cn_train_options cn_train_options_within(const cn_train_options *request, cn_quality quality);
typedef struct cn_train_choice {
    cn_train_options options; /* for cn_train_tile; steps: as many as are expected to fit the budget */
    cn_quality quality;       /* the preset that the options are from, except steps */
    uint64_t bytes;
} cn_train_choice;
/* Chooses the preset that is expected to score best on held-out photos within request->time_budget_s, among those that
 * need at most most_bytes of memory (0: any). It uses the measured speed of this machine (cn_train_speed_predict), and
 * how PSNR grew with the steps in trainings of one scene. Another scene may differ. Errors as in
 * cn_train_speed_predict. */
CN_API CN_NODISCARD cn_status cn_train_choose(const cn_context *ctx, cn_train_speed *speed,
                                              const cn_train_options *request, const cn_plan_tile *tile,
                                              uint64_t most_bytes, cn_train_choice *choice);
/* The *n_rules rules of the effect registry, for cn_plan_options: a constant array. wanted is CN_AUTO. Any thread. */
CN_API const cn_effect_rule *cn_effect_rules(uint32_t *n_rules);

#ifdef __cplusplus
}
#endif
#endif
