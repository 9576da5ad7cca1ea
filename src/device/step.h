/* CN_OP_RAYS to CN_OP_OPTIMISE_TABLE: a training step. All of its operations have the same batch, a cn_step_batch: the
 * arrays of the trainer, which lie in its arena, and what the shaders need to know about the step.
 *
 * Each array is valid on the processor, on the device, or on both. The device brings an array to where the next
 * operation runs, and only then. So the parameters stay on the device between two steps, and an operation that the
 * device cannot do runs on the processor with the right arrays. Call cn_device_fetch before the processor reads the
 * arrays outside of an operation, and cn_device_forget after it has changed them. */
#ifndef CONURB_DEVICE_STEP_H
#define CONURB_DEVICE_STEP_H
#include "device/device.h"

enum {
    CN_STEP_SLOTS = 32,       /* sums of gradients; group g belongs to slot g % CN_STEP_SLOTS */
    CN_STEP_GROUP = 32,       /* rays of a group */
    CN_STEP_GROUP_CAP = 4032, /* the most samples of a group */
    CN_STEP_GROUPS = 256,     /* the most groups of a step */
    CN_GEO_ROWS = 16          /* inputs of the colour network that are geometry features */
};

/* The arrays. Floats and words of 32 bits, unless it says otherwise. Panels: see kernel.h. */
typedef enum cn_step_array {
    /* What training changes; it stays on the device. */
    CN_STEP_TABLE,  /* pairs of bfloat16 */
    CN_STEP_STATE,  /* as cn_kernel.adam_table has it */
    CN_STEP_VALUES, /* all float parameters: weights row-major [out][in], then what belongs to effects */
    CN_STEP_MOMENT_M,
    CN_STEP_MOMENT_V,
    CN_STEP_DERIVED,         /* the weights as [in][out] */
    CN_STEP_EFFECTS_DERIVED, /* what the effects derive from their shared parameters */
    CN_STEP_SEEN,            /* of the occupancy grid */
    CN_STEP_VISITED,
    CN_STEP_BITS,
    CN_STEP_SUPPORT_PHOTO, /* multi-view support, by cell: src/train/support.h */
    CN_STEP_SUPPORT_SINCE,
    CN_STEP_SUPPORT_TIMES,
    /* Constants. */
    CN_STEP_FACTOR,    /* [values] each float parameter's rate over the usual one */
    CN_STEP_OPEN_T,    /* distances at which reactivation looks for cells along a ray */
    CN_STEP_CONSTANTS, /* what the effects know of the photos */
    CN_STEP_TREND,     /* [photos][3] of the cameras' places (src/effect/pose.h) */
    CN_STEP_RUN,       /* [photos] number of the photo's capture run; 0: unknown */
    CN_STEP_PHOTOS,    /* [photos] of cn_step_photo */
    CN_STEP_SPARSE,    /* [CN_MAX_SPARSE][3] sparse depth samples: photo, x and y (16 bits each), distance */
    CN_STEP_SKY_HINTS, /* [photos][CN_SKY_HINTS] bytes: src/effect/sky_hints.h */
    /* The rays of a step. */
    CN_STEP_RAYS,    /* [rays][9] origin and direction in box units, direction in the world */
    CN_STEP_FIRST_T, /* where the march of a ray begins */
    CN_STEP_TARGET,  /* [rays][4] */
    CN_STEP_DEPTH,   /* distance of the sparse point; 0: none */
    CN_STEP_MEASURED,
    CN_STEP_PLANE_LOG,
    CN_STEP_PLANE_WIDTH,
    CN_STEP_SKY_HINT, /* bytes */
    CN_STEP_RAY_PHOTO,
    CN_STEP_RAY_UV,       /* [rays][2] place in the photo, -1 to 1 */
    CN_STEP_CONDITIONING, /* [rays][columns] */
    /* Between operations. */
    CN_STEP_MARCH_T,     /* [groups][CN_STEP_GROUP_CAP] */
    CN_STEP_RAY_SAMPLES, /* samples of a ray */
    CN_STEP_GROUP_SAMPLES,
    CN_STEP_GROUP_LIVE,
    CN_STEP_GROUP_PANEL, /* words of 64 bits */
    CN_STEP_COUNTS,      /* cn_step_counts */
    CN_STEP_POS,
    CN_STEP_ENC,
    CN_STEP_LENGTH,
    CN_STEP_VISIT_CELL,
    CN_STEP_VISIT_SEEN,
    CN_STEP_SUPPORT_CELL, /* [lanes] the cell of every sample for multi-view support */
    CN_STEP_MISSING,      /* bytes */
    CN_STEP_SLOT_GRAD,    /* [slots][values] */
    CN_STEP_PIXEL,        /* [rays][4] composited colour, and transmittance at the end */
    CN_STEP_D_PIXEL,      /* [rays][4] their gradients */
    CN_STEP_D_COLUMNS,    /* [rays][columns] gradients of the conditioning */
    CN_STEP_D_RAYS,       /* [rays][8] gradients of origin and direction, each with an unused float */
    CN_STEP_SUMS,         /* [slots][CN_STEP_SUM_KINDS] */
    CN_STEP_ARRAYS
} cn_step_array;
#define CN_STEP_BIT(array) ((uint64_t)1 << (array))

/* A photo that CN_OP_RAYS draws from; as in shader/photos.glsl. Maps are numbers of cn_step_maps. */
enum { CN_STEP_NO_MAP = UINT32_MAX };
typedef struct cn_step_photo {
    uint32_t width, height;
    uint32_t pixels;     /* map: [height][width] of four half floats, linear ACEScg and weight */
    uint32_t directions; /* map: [height][width][3] unit directions in the camera's frame; 0: the lens has no ray */
    /* 1: a photo of all directions. In its map of directions follow [height] words: the least number of 24 bits, as
     * cn_rng_float draws it, that stands for this row or one below. */
    uint32_t sphere;
    uint32_t depths; /* map: [depth_height][depth_width] floats; 0: no value */
    uint32_t depth_width, depth_height;
    float depth_scale, depth_shift; /* to metres; scale 0: none */
    uint32_t normals;               /* map: [height][width] of four int8, 127 times the normal in the camera's frame */
    uint32_t unused;
    float world_from_cam[9], origin[3]; /* origin in box units */
} cn_step_photo;

/* What CN_OP_RAYS reads of the photos. It is too large for the trainer's arena: before the first rays a device asks for
 * one map after the other, and keeps them. Where it has no room for them, the processor draws the rays. */
typedef struct cn_step_maps {
    uint32_t n;
    const uint64_t *bytes; /* [n] multiples of 4 */
    /* Writes a map to `to`. An error ends the training. */
    cn_status (*read)(void *user, const cn_context *ctx, uint32_t map, void *to);
    void *user;
} cn_step_maps;

typedef struct cn_step_counts {
    uint32_t n_panels, kept_rays, marched_rays; /* rays that take part; rays that have samples */
    uint32_t samples;                           /* of the groups that have room */
} cn_step_counts;

typedef enum cn_step_sum {
    CN_SUM_ERROR, /* as in cn_step_stats */
    CN_SUM_WEIGHED_ERROR,
    CN_SUM_WEIGHT,
    CN_SUM_RAYS,
    CN_SUM_LIVE,
    CN_SUM_BAD,
    CN_SUM_GRADIENT,
    CN_SUM_BY_DEVICE, /* 1: a device has set the sums; 0: the processor's function keeps its own */
    CN_SUM_COLOUR,    /* of the photos' display-encoded colours, three; then of their squares, and how many rays */
    CN_SUM_COLOUR_SQUARED = CN_SUM_COLOUR + 3,
    CN_SUM_COLOURS = CN_SUM_COLOUR + 6, /* 0: the processor has the colours */
    CN_STEP_SUM_KINDS = 16
} cn_step_sum;

/* Bits of cn_step_settings.terms. */
enum {
    CN_TERM_OPENNESS = 1,
    CN_TERM_SPREAD = 2,
    CN_TERM_SPARSE = 4,
    CN_TERM_MEASURED = 8,
    CN_TERM_CUE = 16,
    CN_TERM_NORMAL = 32,
    CN_TERM_SINGLE_VIEW = 64,
    CN_TERM_GLOW = 128,
    CN_TERM_GROUND = 256
};

/* Bits of cn_step_settings.effects, the effects that take part in this step and that the device does, and of
 * cn_step_settings.projects, those whose parameters it projects after the step, also before they take part. */
enum {
    CN_DOES_DIRECTIONS = 1, /* view dependence */
    CN_DOES_APPEARANCE = 2,
    CN_DOES_SKY = 4,
    CN_DOES_EXPOSURE = 8,
    CN_DOES_TRANSIENT = 16,
    CN_DOES_POSE = 32,
    CN_DOES_DRAW_RUNS = 64, /* there are several capture runs */
    CN_DOES_CENTRE_GAINS = 128
};
/* Shapes of the effects, as in shader/effects.glsl: rows that are kept of a ray, of inputs and of gradients; columns of
 * the photos' rows that have a mean of zero; weights of networks; levels of the transients' table. */
enum {
    CN_EFFECT_X_ROWS = 244,
    CN_EFFECT_D_ROWS = 241,
    CN_EFFECT_COLUMNS = 41,
    CN_EFFECT_WEIGHTS = 8576,
    CN_EFFECT_LEVELS = 4
};

/* As in shader/step.glsl. Places (at_) are among CN_STEP_VALUES, those of constants among CN_STEP_CONSTANTS. */
typedef struct cn_step_settings {
    uint32_t n_rays, n_groups, panel_cap, levels, enc_rows, density_width, colour_width, colour_in;
    uint32_t n_weights, n_values, table_levels, softplus;
    uint32_t step, background, has_hints, has_measured, has_planes, terms;
    uint32_t opens, open_steps, dither, support_cells;
    uint32_t effects, projects, effects_by_processor, n_photos, at_shared;
    uint32_t at_appearance, column_appearance, at_sky, at_sky_head, at_exposure, constants_exposure;
    uint32_t at_transient, at_transient_head, at_pose, constants_pose;
    uint32_t seed[2];                         /* of the random numbers: the lower word, the higher */
    uint32_t n_sparse;                        /* sparse depth samples to draw from in this step; 0: none are drawn */
    uint32_t has_uv, depth_along_ray, stereo; /* stereo: the depth maps are from stereo */
    uint32_t no_sky;                          /* cn_lead of src/train/sampler.h */
    float near_t, log_ratio;                  /* log_ratio: natural logarithm of ratio */
    float far_t, ratio, march_step, inv_extent, late, cue_weight, cue_deviation, prior_weight;
    float pose_keep;  /* what a step leaves of a pose's refinement */
    float remembered; /* steps until a cell that one photo sees counts as single-view */
    float cell_decay; /* what a step in which an occupancy cell is visited leaves of its value */
    float to_mean[3], from_mean[3], from_m[3]; /* cn_box_units */
    float rate_weights, rate_others, rate_table, beta1, beta2, epsilon, decay;
    float srgb[9]; /* display-referred linear light from ACEScg, row-major */
} cn_step_settings;

/* What the processor does in the middle of an operation for effects that the device does not know; each for one slot of
 * groups. NULL: the device does it, or no effect needs it. A hook reads and writes the arrays that it names, and adds
 * the gradients of the effects' parameters to CN_STEP_SLOT_GRAD. */
typedef void cn_step_hook(void *user, size_t slot, unsigned worker);
typedef struct cn_step_hooks {
    cn_step_hook *columns;          /* VALUES -> CONDITIONING */
    cn_step_hook *pixels;           /* PIXEL, VALUES, TARGET -> D_PIXEL, SUMS */
    cn_step_hook *columns_backward; /* D_COLUMNS */
    cn_step_hook *rays_backward;    /* D_RAYS */
    cn_step_hook *project;          /* after CN_OP_OPTIMISE: VALUES; called once, for slot 0 */
    void *user;
} cn_step_hooks;

typedef struct cn_step_host {
    void *data;
    size_t bytes; /* 0: not in use */
} cn_step_host;

typedef struct cn_step_batch {
    cn_step_host array[CN_STEP_ARRAYS];
    const cn_level *level;
    cn_step_maps maps;
    cn_step_settings settings;
    cn_step_hooks hooks;
    const char *unfit;              /* why the device can do no operation of this training; NULL: it can */
    bool by_processor[CN_OP_KINDS]; /* operations that only the processor can do in this step */
    uint64_t reads[CN_OP_KINDS], writes[CN_OP_KINDS]; /* what the processor's functions read, and
                                                       * overwrite */
} cn_step_batch;
#endif
