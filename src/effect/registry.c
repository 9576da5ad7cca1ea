/* The list of effects. A new effect is a file in this folder and a line here. The steps of a stage are in the order of
 * the list. */
#include "effect/effect.h"

#include <string.h>

extern const cn_effect cn_effect_view_dependence;
extern const cn_effect cn_effect_appearance;
extern const cn_effect cn_effect_sky;
extern const cn_effect cn_effect_exposure;
extern const cn_effect cn_effect_transient;
extern const cn_effect cn_effect_pose_refinement;
extern const cn_effect cn_effect_stereo_depth;
extern const cn_effect cn_effect_vignetting;

const cn_effect *const cn_effect_list[] = {
    &cn_effect_view_dependence, &cn_effect_appearance,      &cn_effect_sky,          &cn_effect_exposure,
    &cn_effect_transient,       &cn_effect_pose_refinement, &cn_effect_stereo_depth, &cn_effect_vignetting,
};
_Static_assert(sizeof cn_effect_list / sizeof *cn_effect_list <= CN_MAX_EFFECTS, "raise CN_MAX_EFFECTS");
const uint32_t cn_effect_count = sizeof cn_effect_list / sizeof *cn_effect_list;

/* Earlier forms, and the last format of tiles that has them. */
extern const cn_effect cn_effect_sky_by_input;
static const struct {
    const cn_effect *effect;
    int64_t last_format;
} earlier[] = { { &cn_effect_sky_by_input, 1 } };
enum { N_EARLIER = sizeof earlier / sizeof *earlier };

const cn_effect *cn_effect_find(const char *name)
{
    for (uint32_t i = 0; i < cn_effect_count; i++)
        if (strcmp(cn_effect_list[i]->name, name) == 0) return cn_effect_list[i];
    for (uint32_t i = 0; i < N_EARLIER; i++)
        if (strcmp(earlier[i].effect->form, name) == 0) return earlier[i].effect;
    return NULL;
}

const char *cn_effect_form(const char *name, int64_t tile_format)
{
    for (uint32_t i = 0; i < N_EARLIER; i++)
        if (tile_format <= earlier[i].last_format && strcmp(earlier[i].effect->name, name) == 0)
            return earlier[i].effect->form;
    return name;
}
