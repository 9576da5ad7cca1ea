/* conurb/train.h: trains one tile. */
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

/* What the networks multiply in while they are trained: the fastest that this processor has, bfloat16 products
 * included, or float. Sums are float. */
typedef enum cn_precision { CN_PRECISION_FASTEST, CN_PRECISION_FLOAT } cn_precision;

typedef struct cn_train_options {
    uint64_t seed;
    uint32_t steps;            /* the schedule's length; the learning rate decays over it */
    double time_budget_s;      /* 0: none. Otherwise steps are chosen to fit after a short probe */
    uint32_t samples_per_step; /* aimed at; rays a step adapt */
    cn_field_options field;    /* the type of field, and its settings */
    cn_precision precision;
    bool depth_maps;          /* those of the pixel store are used; a tile whose photos have none trains without */
    cn_depth_kind depth_kind; /* as cn_photo_maps has it, and so is what follows */
    cn_depth_along depth_along;
    double learning_rate;
    double march_step;         /* a sample's step over its distance, at the end of the schedule; longer before */
    double checkpoint_every_s; /* default 60 */
    uint32_t good_every; /* steps between states that training can go back to; default 1024, 0: to the start only */
    double stop_gain_db; /* 0: never. Otherwise the schedule goes over to its end, where the rate falls, once another
                          * minute is expected to gain less than this on the validation photos, as `validate` finds */
    double validate_every_s; /* default 20 */
    /* Scores a tile on photos that neither train it nor score it at the end: DIR/validation/ID/tile.safetensors, with
     * DONE beside it, for dir of cn_train_tile. NULL: no stopping. */
    cn_status (*validate)(void *user, double *psnr);
    void *validate_user;
    bool choose; /* with a time budget: a wish that table, grid and march be chosen for it (cn_train_choose) */
} cn_train_options;
/* With a hash grid; cn_field_options_preset gives another type. */
CN_API cn_train_options cn_train_options_preset(cn_quality quality);

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

/* Trains into DIR: log.jsonl (a line a report), checkpoint.safetensors (resumed from when it fits these options),
 * good.safetensors (the state to go back to), and at the end tile.safetensors, metrics.json, and DONE last. Steps with
 * a non-finite loss or gradient are left out and counted; when there are many, when the loss explodes, or when it stays
 * above that of a single colour, training goes back to the last good state with a tenth of the learning rate and a
 * warning to ctx->log; at the fifth time the tile fails (CN_ERR_DATA). Held-out photos in tile->photos are refused
 * (CN_ERR_INTERNAL). When ctx->stop is set: writes a checkpoint and returns CN_ERR_INTERRUPTED. parent_hash is stored
 * in the tile and the checkpoint. With a time budget or a stop_gain_db the clock has a say in how many steps there are,
 * and with it in the bytes of the tile. */
CN_API CN_NODISCARD cn_status cn_train_tile(const cn_context *ctx, const cn_train_input *input,
                                            const cn_train_options *options, const char *parent_hash, const char *dir,
                                            cn_train_result *result);
/* Fits an appearance to rays whose colours are known; the tile itself stays as it is (Martin-Brualla et al. 2021,
 * section 5). target[n][4]: linear ACEScg and a weight >= 0. appearance is the start and becomes the best row found;
 * *rmse is its error, display-encoded. Of many rays it takes 2048, evenly spread over the order in which they are
 * given. Give rays in order of place: a row is fitted to each half of them and tried on the other half, and each effect
 * takes over only as much of its part as helps there. A tile without appearance keeps its row. CN_ERR_DATA when the
 * tile sees too few of the rays. */
CN_API CN_NODISCARD cn_status cn_fit_appearance(const cn_context *ctx, const cn_tile *tile, const cn_ray_list *rays,
                                                const float *target, cn_appearance *appearance, double *rmse);
/* Bytes of the one arena that a training run allocates, with a thread a processor: exact. Seconds: from a samples/s
 * figure that is of no machine in particular. For any thread. */
CN_API void cn_train_cost(const cn_train_options *options, const cn_plan_tile *tile, double *seconds, uint64_t *bytes);
/* Measured training speed of this machine. Kept in the JSON file `cache` (NULL: nowhere) from run to run, by processor,
 * instruction set, build, threads, settings and effects; a cache of another machine is measured anew, one that cannot
 * be read or written is done without. Caller destroys. One call at a time. */
typedef struct cn_train_speed cn_train_speed;
CN_API CN_NODISCARD cn_status cn_train_speed_create(cn_train_speed **speed, const char *cache);
CN_API void cn_train_speed_destroy(cn_train_speed **speed);
/* Predicted seconds and exact bytes of training a tile with the threads of ctx. What is not known yet is measured by
 * some dozens of real steps on a made tile: a second or two, and the memory of the training itself. CN_ERR_NOMEM,
 * CN_ERR_INTERRUPTED, CN_ERR_CONFIG. */
CN_API CN_NODISCARD cn_status cn_train_speed_predict(const cn_context *ctx, cn_train_speed *speed,
                                                     const cn_train_options *options, const cn_plan_tile *tile,
                                                     double *seconds, uint64_t *bytes);
/* The settings of a preset, with seed, learning rate, checkpoints and time budget of a request. */
CN_API cn_train_options cn_train_options_within(const cn_train_options *request, cn_quality quality);
typedef struct cn_train_choice {
    cn_train_options options; /* for cn_train_tile; steps: as many as the budget is expected to have time for */
    cn_quality quality;       /* whose settings these are, but for the steps */
    uint64_t bytes;
} cn_train_choice;
/* The settings expected to do best on held-out photos after request->time_budget_s, among those of the presets that
 * need no more than most_bytes (0: any): by the speed of this machine, measured as cn_train_speed_predict does, and by
 * how PSNR grew with the steps in trainings of one place, which another's may do otherwise. Errors as there. */
CN_API CN_NODISCARD cn_status cn_train_choose(const cn_context *ctx, cn_train_speed *speed,
                                              const cn_train_options *request, const cn_plan_tile *tile,
                                              uint64_t most_bytes, cn_train_choice *choice);
/* Rules of the effect registry, for the plan; static, n_rules of them. wanted is CN_AUTO. Any thread. */
CN_API const cn_effect_rule *cn_effect_rules(uint32_t *n_rules);

#ifdef __cplusplus
}
#endif
#endif
