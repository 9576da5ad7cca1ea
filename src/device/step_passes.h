/* The passes of a training step on a Vulkan device: one compute shader each (shader/step_NAME.comp), with the arrays
 * that it binds. */
#ifndef CONURB_DEVICE_STEP_PASSES_H
#define CONURB_DEVICE_STEP_PASSES_H
#include "device/step.h"
#include "device/vulkan.h"

enum { CN_MAP_BLOCKS = 4 };

/* Buffers that only the device has, after the arrays of the trainer. */
enum {
    CN_OWN_SETTINGS = CN_STEP_ARRAYS,
    CN_OWN_LEVELS,        /* words: resolution, entries, offset, hashed */
    CN_OWN_LOGIT,         /* [lanes] */
    CN_OWN_LIVE,          /* [lanes][4] of live samples: weight, transmittance behind, gradient of tau, distance */
    CN_OWN_LIVE_FROM,     /* [lanes][2] their lane among all samples, their ray */
    CN_OWN_SPANS,         /* [rays][4] first live lane, number, sum of weights, transmittance at the end */
    CN_OWN_PANEL_GROUP,   /* [panels] the group of a panel */
    CN_OWN_LIVE_POS,      /* [lanes][4] */
    CN_OWN_ACTS,          /* [lanes][rows] activations of live samples */
    CN_OWN_D_ACTS,        /* their gradients */
    CN_OWN_COLOUR,        /* [lanes][4] */
    CN_OWN_D_SAMPLE,      /* [lanes][4] gradients of the colour's output and of the logit */
    CN_OWN_D_PLACE,       /* [lanes][4] gradient of the place in box units; distance */
    CN_OWN_FIXED,         /* [entries][2][2] sums of the table's gradients in fixed point */
    CN_OWN_TOUCHED,       /* [blocks of 8 entries] whether an entry has a gradient */
    CN_OWN_CELL_MOST,     /* [cells] the most that this step saw of a cell */
    CN_OWN_SINGLE_VIEW,   /* [lanes] of live samples: whether only one photo shows their place */
    CN_OWN_SUPPORT_LAST,  /* [support cells] rays of this step that saw a cell: step_support_last.comp */
    CN_OWN_SUPPORT_COUNT, /* [support cells] how many of them after the last one of another photo */
    CN_OWN_EFFECT_X,      /* [groups][CN_EFFECT_X_ROWS][rays of a group] inputs of layers of the effects' networks */
    CN_OWN_EFFECT_D,      /* [groups][CN_EFFECT_D_ROWS][rays of a group] gradients */
    CN_OWN_GROUP_SUMS,    /* [groups][CN_STEP_SUM_KINDS] */
    CN_OWN_RUN_MEAN,      /* [CN_EFFECT_COLUMNS][photos] mean of a photo's capture run */
    CN_OWN_DRAWN,         /* [rays] pixel: x and y, 16 bits each */
    CN_OWN_MAPS, /* cn_step_maps in so many buffers; the first begins with [maps][2] buffer and word of a map */
    CN_OWN_MAPS_END = CN_OWN_MAPS + CN_MAP_BLOCKS - 1,
    CN_STEP_BUFFERS
};

typedef enum cn_step_pass {
    CN_STEP_DRAW,
    CN_STEP_DEPTHS,
    CN_STEP_MOVE,
    CN_STEP_MARCH,
    CN_STEP_LAY_OUT,
    CN_STEP_PLACE,
    CN_STEP_ENCODE,
    CN_STEP_CONDITION,
    CN_STEP_LOGITS,
    CN_STEP_LIVE,
    CN_STEP_SUPPORT,
    CN_STEP_FORWARD,
    CN_STEP_COMPOSITE,
    CN_STEP_EFFECTS,
    CN_STEP_SAMPLES,
    CN_STEP_BACKWARD,
    CN_STEP_COLUMNS,
    CN_STEP_POSITION,
    CN_STEP_RAY_GRAD,
    CN_STEP_WEIGHT_GRAD,
    CN_STEP_ROW_GRAD,
    CN_STEP_HEAD_GRAD,
    CN_STEP_FEATURE_GRAD,
    CN_STEP_SUM,
    CN_STEP_ADAM,
    CN_STEP_DERIVE,
    CN_STEP_PROJECT,
    CN_STEP_EFFECT_DERIVE,
    CN_STEP_TABLE_GRAD,
    CN_STEP_TABLE_ADAM,
    CN_STEP_VISITS,
    CN_STEP_OCCUPANCY,
    CN_STEP_OPEN,
    CN_STEP_SUPPORT_LAST,
    CN_STEP_SUPPORT_COUNT,
    CN_STEP_SUPPORT_UPDATE,
    CN_STEP_PASSES
} cn_step_pass;

enum { CN_STEP_BINDINGS = 16 }; /* of a pass, at most: the settings and its arrays */
typedef struct cn_step_pass_about {
    const char *name;
    uint32_t n;                        /* bindings */
    uint8_t binding[CN_STEP_BINDINGS]; /* buffers */
    uint64_t writes;                   /* arrays that the pass changes */
} cn_step_pass_about;
extern const cn_step_pass_about cn_step_about[CN_STEP_PASSES];

typedef struct cn_step_pipelines {
    VkDescriptorPool pool;
    VkDescriptorSetLayout set_layout[CN_STEP_PASSES];
    VkPipelineLayout layout[CN_STEP_PASSES];
    VkDescriptorSet set[CN_STEP_PASSES];
    VkPipeline pipeline[CN_STEP_PASSES];
} cn_step_pipelines;
/* lanes: threads of a group in the networks, whose widest layer has `rows`. */
CN_NODISCARD cn_status cn_step_pipelines_create(cn_vulkan *device, uint32_t lanes, uint32_t rows,
                                                const cn_device_buffer buffer[CN_STEP_BUFFERS],
                                                cn_step_pipelines *pipelines);
void cn_step_pipelines_destroy(cn_vulkan *device, cn_step_pipelines *pipelines);
#endif
