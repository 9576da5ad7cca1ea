/* Effects. Each is one file and one constant descriptor; registry.c lists them. The plan says which effects a tile has
 * on. These are packed into a list of steps for each stage. An effect that is off has no step, no parameter, no
 * conditioning and no section in the tile.
 *
 * Stages over batches of rays: RAY -> FIELD_IN -> BACKGROUND -> PIXEL -> LOSS.
 *   RAY        moves rays before they are marched
 *   FIELD_IN   fills the conditioning of the colour head, one row a ray
 *   BACKGROUND adds what lies behind the scene, through the transmittance that is left
 *   PIXEL      changes a ray's composited linear colour
 *   LOSS       weighs a ray's error
 *
 * A photo's row: `photo_constants` floats that are known (EXIF) and `photo_params` floats that are trained. A render
 * picks one row (a photo's, the mean, or a mix). `shared_params` floats belong to all photos: the weights of a small
 * head. */
#ifndef CONURB_EFFECT_EFFECT_H
#define CONURB_EFFECT_EFFECT_H
#include "conurb/photo.h"
#include "conurb/plan.h"
#include "device/trace.h"
#include "kernel/kernel.h"

enum { CN_EFFECT_RAYS = 2 * CN_PANEL }; /* rays of one call, at most */

/* Rays of one call; arrays of n. */
typedef struct cn_effect_rays {
    uint32_t n;
    const float *dir; /* [n][3], unit, world axes */
    const float *uv; /* [n][2], place in the photo: x and y from -1 to 1; NULL where no effect that is on asks for it */
    const uint32_t *photo;   /* row of the photo */
    const uint8_t *sky_hint; /* [n] whether the photo shows sky there (sky_hints.h); NULL: nothing is known */
} cn_effect_rays;

/* One effect's part of the buffers. derived: made of shared by `derive`. */
typedef struct cn_effect_data {
    const cn_kernel *kernel;
    const float *constants, *photo, *shared, *derived;
} cn_effect_data;
/* What `project` is told about n photos. run: the number of each photo's capture run (runs.h), from 1; 0 where its time
 * is unknown; NULL where no effect that is on asks for it. trend: of the camera centres (pose.h); NULL where no effect
 * moves rays. */
typedef struct cn_effect_photos {
    uint32_t n;
    const float *constants, *run, (*trend)[3];
} cn_effect_photos;
/* Gradients, to be added to. */
typedef struct cn_effect_grad {
    float *photo, *shared;
} cn_effect_grad;

/* What the loss of rays is made of; arrays of n. */
typedef struct cn_effect_residuals {
    const float *target;        /* [n][4] the photo's colour and weight; NULL: not known */
    const float *error;         /* squared error, summed over channels */
    const float *scale;         /* weight of the ray's term in the whole loss */
    const float *transmittance; /* what is left at the ray's end */
} cn_effect_residuals;
/* The backward pass through PIXEL and BACKGROUND; arrays of n rays. */
typedef struct cn_effect_shading {
    const float *transmittance; /* as in the forward pass */
    float *saved;               /* saved activations of the forward pass */
    float *d_rgb;               /* [n][3] gradient of the colour; PIXEL changes it in place */
    float *d_transmittance;     /* BACKGROUND adds to it */
} cn_effect_shading;

/* Directions, and what the trained photos show there. */
typedef enum cn_look { CN_LOOK_NONE, CN_LOOK_SOMETHING, CN_LOOK_SKY } cn_look;
typedef struct cn_effect_looks {
    uint32_t n;
    const float (*dir)[3];
    const uint8_t *look; /* [n] a cn_look */
} cn_effect_looks;

/* Which settings of the camera the EXIF of trained photos tells, beside the exposure time. */
typedef struct cn_effect_settings {
    bool iso, f_number;
} cn_effect_settings;

typedef struct cn_effect {
    const char *name;
    const char *form; /* of an earlier form of an effect: the name for cn_effect_find; else NULL */
    const char *summary;
    double threshold;
    bool on_unmeasured; /* the decision when the evidence cannot be measured, or is low and a probe is not clear
                           (stage/effect_probe.h) */
    bool training_only; /* a render leaves it out */
    bool wants_uv;
    bool wants_sky_hints;  /* `loss` is told where photos show sky */
    bool wants_runs;       /* `project` is told which capture run each photo is of */
    bool wants_support;    /* once it takes part, what only one photo shows has a cost (train/support.h) */
    bool wants_vignetting; /* training sees the photos without their vignetting (vignetting.h) */
    bool wants_stereo;     /* depths by stereo of the photos lead the field in the first half of the schedule */
    bool unprobed;    /* no short training judges it: it changes only what is known of training photos, or only leads
                         to the same field sooner, or its evidence is a measurement with its error */
    float rate;       /* learning rate of its photo parameters, over that of the others; 0 means 1 */
    float spread;     /* a photo that is not trained on may be so far from the others (a standard deviation), even if
                         these are alike; 0: as far as these are from each other */
    float time_share; /* the time it adds to a step, over the time of a step without effects; measured by
                         `conurb tradeoff --effects` */
    float start;      /* fraction of the schedule at which it sets in; a longer schedule counts as one of 1500 steps */
    double (*evidence)(const cn_plan_input *input, const cn_plan_tile *tile); /* NaN: cannot be measured */
    uint32_t conditioning;                                                    /* floats a ray that FIELD_IN fills */
    bool harmonics; /* these are spherical harmonics of the direction; such an effect comes first in the list */
    uint32_t photo_constants, photo_params, shared_params;
    uint32_t saved; /* saved activations: floats a ray that the forward pass leaves for the backward pass */

    /* Fills a photo's constants from its EXIF; NaN where it does not say. told: what the tile's trained photos tell.
     * NULL when there are none. */
    void (*constants)(const cn_photo *photo, cn_effect_settings told, float *row);
    /* Turns the rows of n photos, of which the first n_trained are trained on, into what the hooks use (centred, say).
     */
    void (*centre)(float *rows, uint32_t n, uint32_t n_trained);
    /* Marks what is known of a photo's row as unknown, so that a fit may change it. Appearance alignment needs this:
     * it fits a tile to the look of another tile, which the tile's own photos do not show. NULL when nothing is
     * known. */
    void (*unfreeze)(float *constants);
    /* First values of the shared parameters. Those of photos begin at 0. */
    void (*init)(uint64_t seed, float *shared);
    void (*derive)(const float *shared, float *derived);
    /* Before a tile is written: changes the shared parameters where no trained photo has looked. NULL: never. False:
     * out of memory. */
    bool (*settle)(const cn_kernel *kernel, const cn_effect_looks *looks, float *shared);
    /* Called after each step of training. Projects the photos' rows onto what is allowed, such as zero mean. */
    void (*project)(const cn_effect_photos *photos, float *rows, double progress);

    /* origin[n][3], in units of the tile's mean half extent, and dir[n][3], in place; rays->dir is the direction as
     * given. */
    void (*ray)(const cn_effect_rays *rays, const cn_effect_data *data, float (*origin)[3], float (*dir)[3]);
    void (*ray_backward)(const cn_effect_rays *rays, const cn_effect_data *data, float (*d_origin)[3],
                         float (*d_dir)[3], const cn_effect_grad *grad);
    void (*field_in)(const cn_effect_rays *rays, const cn_effect_data *data, float *conditioning, size_t stride);
    void (*field_in_backward)(const cn_effect_rays *rays, const cn_effect_data *data, const float *d_conditioning,
                              size_t stride, const cn_effect_grad *grad);
    /* rgb[n][3] += transmittance[n] * background. */
    void (*background)(const cn_effect_rays *rays, const cn_effect_data *data, const float *transmittance, float *rgb,
                       float *saved);
    /* Describes the background for a device that renders. NULL: the processor draws it. */
    void (*describe)(const cn_effect_data *data, cn_device_sky *sky);
    void (*background_backward)(const cn_effect_rays *rays, const cn_effect_data *data,
                                const cn_effect_shading *shading, const cn_effect_grad *grad);
    /* What part of the background a direction shows, 0 to 1; NULL: all of it everywhere. For the alpha of renders. */
    float (*cover)(const float dir[3]);
    /* rgb[n][3], in place; d_rgb[n][3] in place: from the gradient after the effect to the gradient before it. */
    void (*pixel)(const cn_effect_rays *rays, const cn_effect_data *data, float *rgb, float *saved);
    void (*pixel_backward)(const cn_effect_rays *rays, const cn_effect_data *data, float *d_rgb, float *saved,
                           const cn_effect_grad *grad);
    /* Multiplies factor[n], which is 1 at first, by the weight that the effect gives to each ray's error. Returns what
     * the effect adds to the sum of scale * error. May leave gradients in `saved` for the backward hooks. */
    double (*loss)(const cn_effect_rays *rays, const cn_effect_data *data, const cn_effect_residuals *residuals,
                   float *factor, float *saved);
} cn_effect;

extern const cn_effect *const cn_effect_list[];
extern const uint32_t cn_effect_count;
const cn_effect *cn_effect_find(const char *name); /* NULL if unknown; an earlier form is found by its form */
/* What to find an effect by, for a tile of this format: its name, or the name of an earlier form. */
const char *cn_effect_form(const char *name, int64_t tile_format);

/* One effect that is on: where its conditioning, constants, parameters and saved activations begin. */
typedef struct cn_effect_step {
    const cn_effect *effect;
    uint32_t conditioning;
    size_t constants, photo, shared; /* first float in the packed buffers; rows: [effect][photo][row] */
    size_t saved;                    /* first float a ray */
} cn_effect_step;

/* Steps of one stage, as indices into on[]. */
typedef struct cn_effect_stage {
    uint32_t n;
    uint8_t step[CN_MAX_EFFECTS];
} cn_effect_stage;

typedef struct cn_effect_pack {
    cn_effect_step on[CN_MAX_EFFECTS];
    uint32_t n_on;
    cn_effect_stage ray, field_in, background, pixel, loss;
    uint32_t conditioning, harmonics; /* harmonics: how many of them, at the front, are harmonics of the direction */
    size_t n_constants, n_photo, n_shared, saved;
    uint32_t n_rows; /* photos */
    bool wants_uv, wants_sky_hints, moves_rays, own_rates, wants_runs, wants_support, wants_stereo, wants_vignetting;
    bool single_view; /* an effect with wants_support takes part: what only one photo shows has a cost */
} cn_effect_pack;
/* Packs the named effects in the order of the registry, for n_photos rows. CN_ERR_CONFIG on an unknown name. */
CN_NODISCARD cn_status cn_effect_pack_make(cn_effect_pack *pack, uint32_t n, const char *const *names,
                                           uint32_t n_photos);
/* Sets which steps take part at this fraction of the schedule. The steps of FIELD_IN always do. */
void cn_effect_pack_at(cn_effect_pack *pack, double progress);
/* Drops what a render leaves out from the stages; the buffers keep their layout. */
void cn_effect_pack_for_render(cn_effect_pack *pack);

/* The buffers that a pack lays out. */
typedef struct cn_effect_state {
    const cn_kernel *kernel;
    const float *constants, *photo, *shared, *derived;
} cn_effect_state;
void cn_effects_init(const cn_effect_pack *pack, uint64_t seed, float *shared);
void cn_effects_derive(const cn_effect_pack *pack, const float *shared, float *derived);
void cn_effects_centre(const cn_effect_pack *pack, uint32_t n_trained, float *constants);
void cn_effects_project(const cn_effect_pack *pack, const cn_effect_photos *photos, float *rows, double progress);

/* Each effect has a range of the photos' parameters. Range i is first[i] .. first[i + 1]; its learning rate is
 * multiplied by factor[i]. Returns the number of ranges. */
uint32_t cn_effects_rates(const cn_effect_pack *pack, size_t first[CN_MAX_EFFECTS + 1], float factor[CN_MAX_EFFECTS]);
void cn_effects_ray(const cn_effect_pack *pack, const cn_effect_rays *rays, const cn_effect_state *state,
                    float (*origin)[3], float (*dir)[3]);
void cn_effects_ray_backward(const cn_effect_pack *pack, const cn_effect_rays *rays, const cn_effect_state *state,
                             float (*d_origin)[3], float (*d_dir)[3], const cn_effect_grad *grad);
/* What the tile's trained photos tell. */
cn_effect_settings cn_effect_settings_told(const cn_photo_index *photos, const cn_scene *scene,
                                           const cn_plan_tile *tile);
/* Subtracts their mean from n rows of `width` floats. For `project`. */
void cn_effect_zero_mean(uint32_t n, uint32_t width, float *rows);

/* conditioning[i * stride + c] of ray i. */
void cn_effects_field_in(const cn_effect_pack *pack, const cn_effect_rays *rays, const cn_effect_state *state,
                         float *conditioning, size_t stride);
void cn_effects_field_in_backward(const cn_effect_pack *pack, const cn_effect_rays *rays, const cn_effect_state *state,
                                  const float *d_conditioning, size_t stride, const cn_effect_grad *grad);
/* Describes what lies behind the scene, of the state's first row. False: a device cannot draw it. */
bool cn_effects_describe(const cn_effect_pack *pack, const cn_effect_state *state, cn_device_sky *sky);
/* BACKGROUND and PIXEL. transmittance NULL: only PIXEL. saved has pack->saved * CN_EFFECT_RAYS floats. A render passes
 * them too, although it has no backward pass. */
void cn_effects_shade(const cn_effect_pack *pack, const cn_effect_rays *rays, const cn_effect_state *state,
                      const float *transmittance, float *rgb, float *saved);
/* What part of a direction the backgrounds cover, 0 to 1. */
float cn_effects_cover(const cn_effect_pack *pack, const float dir[3]);
/* Returns the loss of these rays. Sets factor[n]: the weight that the effects give to each ray's error. */
double cn_effects_loss(const cn_effect_pack *pack, const cn_effect_rays *rays, const cn_effect_state *state,
                       const cn_effect_residuals *residuals, float *factor, float *saved);
/* shading->d_transmittance is set, whatever it held before. */
void cn_effects_shade_backward(const cn_effect_pack *pack, const cn_effect_rays *rays, const cn_effect_state *state,
                               const cn_effect_shading *shading, const cn_effect_grad *grad);
#endif
