/* Colours of Gaussians, and of the sky, under several lights: asked from the field, so that one geometry can be relit.
 */
#ifndef CONURB_STAGE_SPLAT_LIGHTS_H
#define CONURB_STAGE_SPLAT_LIGHTS_H
#include "conurb/splat.h"
#include "renderer/renderer.h"
#include "stage/survey.h"

enum { CN_SKY_WIDTH = 128, CN_SKY_HEIGHT = 64 };
typedef struct cn_splat_lights {
    const cn_context *ctx;
    cn_renderer *renderer; /* the specs are aligned */
    const cn_survey *survey;
    const cn_appearance_spec *specs; /* the first is the light of the splats' own colours */
    uint32_t n;
} cn_splat_lights;
/* colours[l][i]: display-referred sRGB of splat i under light l. Under the first it is the splat's own, of degree 0.
 * For the others, the field of the nearest tile is asked for the colour that the photo with the best view of the splat
 * has there, under that light and under the first, by a ray that begins just in front of the splat. The ratio of the
 * splat's own colour to that of the field (in linear light, from a half to two) is kept. CN_ERR_NOMEM,
 * CN_ERR_INTERRUPTED. */
CN_NODISCARD cn_status cn_splat_lights_find(const cn_splat_lights *lights, const cn_splats *splats,
                                            uint8_t (*const *colours)[3]);
/* sky[l][CN_SKY_HEIGHT][CN_SKY_WIDTH]: display-referred sRGB, from the zenith down, and clockwise from north. Where the
 * tile in the middle knows no sky, it is grey; below the horizon it goes over to grey. */
CN_NODISCARD cn_status cn_splat_lights_sky(const cn_splat_lights *lights, uint8_t (*const *sky)[3]);
#endif
