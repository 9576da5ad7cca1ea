/* What is written beside the photos. OUT/truth/:
 *   truth.json       the options, runs and photos: exposure, white balance, true place and place as in EXIF
 *   transforms.json  poses and lenses, as Nerfstudio has them
 *   model/           the same as a COLMAP model, with sparse points
 *   frame.json       where on Earth
 *   views/NAME.exr   each view without people and cars, linear ACEScg at the reference exposure, with Z in metres along
 *                    the ray
 *   masks/NAME.png   black where a photo does not show the city alone (people, cars, their shadows) */
#ifndef CONURB_SYNTH_TRUTH_H
#define CONURB_SYNTH_TRUTH_H
#include "synth/rig.h"

/* Makes the folders. CN_ERR_USAGE when OUT/photos is there already. */
CN_NODISCARD cn_status cn_truth_begin(const char *out);
/* OUT/FOLDER/NAME with the name's ending replaced; caller frees; NULL when out of memory. */
char *cn_truth_path(const char *out, const char *folder, const char *name, const char *ending);
/* Adds points and observations to a scene whose views are the rig's shots: three photos or more show each, unhidden.
 * The caller frees both arrays, also after an error. */
CN_NODISCARD cn_status cn_truth_points(const cn_world *world, const cn_rig *rig, cn_scene *scene);
/* All but views and masks; truth.json last. */
CN_NODISCARD cn_status cn_truth_finish(const char *out, const cn_world *world, const cn_rig *rig);
/* The options of truth.json. CN_ERR_FORMAT names the key at fault. */
CN_NODISCARD cn_status cn_truth_load(const char *out, cn_synth_options *options);
#endif
