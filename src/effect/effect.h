/* Effects: one file and one constant descriptor each; registry.c lists them. A tile sees only the effects that its plan has on: they are packed into a step
 * list a stage, and what is off has no step, no parameter, no column and no section in the tile.
 *
 * Stages over batches of rays: RAY -> FIELD_IN -> FIELD_OUT -> BACKGROUND -> PIXEL -> LOSS. FIELD_IN gives columns of the colour head's input, one row a ray;
 * PIXEL changes a ray's composited linear colour.
 *
 * A photo's row: `photo_constants` floats that are known (EXIF) and `photo_params` floats that are trained. A render picks one row (a photo's, the mean, or a mix). */
#ifndef CONURB_EFFECT_EFFECT_H
#define CONURB_EFFECT_EFFECT_H
#include "conurb/photo.h"
#include "conurb/plan.h"

/* Rays of one call; arrays of n. */
typedef struct cn_effect_rays {
    uint32_t n;
    const float *dir;       /* [n][3], unit, world axes */
    const uint32_t *photo;  /* row of the photo */
} cn_effect_rays;

typedef struct cn_effect {
    const char *name;
    const char *summary;
    double threshold;
    bool on_unmeasured;       /* the decision when the evidence cannot be measured */
    double (*evidence)(const cn_plan_input *input, const cn_plan_tile *tile); /* NaN: cannot be measured */
    uint32_t columns;         /* of FIELD_IN */
    uint32_t photo_constants, photo_params;
    /* Fills a photo's constants from its EXIF. NULL when there are none. */
    void (*constants)(const cn_photo *photo, float *row);
    /* columns[i * stride ..]: this effect's columns of ray i. */
    void (*field_in)(const cn_effect_rays *rays, const float *constants, const float *params, float *columns, size_t stride);
    /* d_params += gradient; NULL when there are no parameters. */
    void (*field_in_backward)(const cn_effect_rays *rays, const float *constants, const float *params, const float *d_columns,
                              size_t stride, float *d_params);
    /* rgb[n][3], in place. */
    void (*pixel)(const cn_effect_rays *rays, const float *constants, const float *params, float *rgb);
    /* d_rgb[n][3] in place: from the gradient after the effect to the gradient before it; before[n][3]: the colour that the effect was given. */
    void (*pixel_backward)(const cn_effect_rays *rays, const float *constants, const float *params, const float *before,
                           float *d_rgb, float *d_params);
} cn_effect;

extern const cn_effect *const cn_effect_list[];
extern const uint32_t cn_effect_count;
const cn_effect *cn_effect_find(const char *name); /* NULL if unknown */

/* One effect that is on: where its columns, constants and parameters begin. */
typedef struct cn_effect_step {
    const cn_effect *effect;
    uint32_t column;
    size_t constants, params; /* first float in the packed buffers: [effect][photo][row] */
} cn_effect_step;

typedef struct cn_effect_pack {
    cn_effect_step on[CN_MAX_EFFECTS]; uint32_t n_on;
    cn_effect_step field_in[CN_MAX_EFFECTS]; uint32_t n_field_in;
    cn_effect_step pixel[CN_MAX_EFFECTS]; uint32_t n_pixel;
    uint32_t columns;
    size_t n_constants, n_params;
} cn_effect_pack;
/* Packs the named effects in the order of the registry, for n_photos rows. CN_ERR_CONFIG on an unknown name. */
CN_NODISCARD cn_status cn_effect_pack_make(cn_effect_pack *pack, uint32_t n, const char *const *names, uint32_t n_photos);

void cn_effects_field_in(const cn_effect_pack *pack, const cn_effect_rays *rays, const float *constants, const float *params,
                         float *columns, size_t stride);
void cn_effects_field_in_backward(const cn_effect_pack *pack, const cn_effect_rays *rays, const float *constants,
                                  const float *params, const float *d_columns, size_t stride, float *d_params);
/* rgb[n][3] in place; trail (may be NULL) keeps the colours before each step, [n_pixel][n][3], for the backward pass. */
void cn_effects_pixel(const cn_effect_pack *pack, const cn_effect_rays *rays, const float *constants, const float *params,
                      float *rgb, float *trail);
void cn_effects_pixel_backward(const cn_effect_pack *pack, const cn_effect_rays *rays, const float *constants,
                               const float *params, const float *trail, float *d_rgb, float *d_params);
#endif
