/* Pictures of a world. */
#ifndef CONURB_SYNTH_PICTURE_H
#define CONURB_SYNTH_PICTURE_H
#include "synth/rig.h"

/* Directions of a lens, at the corners of pixels: (width + 1) * (height + 1) * 3, z forward. */
typedef struct cn_lens_table {
    const cn_camera *camera;
    uint32_t width, height;
    float pixel;
    float *directions;
} cn_lens_table;
/* The camera must outlive the table. */
CN_NODISCARD cn_status cn_lens_table_init(cn_lens_table *table, const cn_camera *camera);
void cn_lens_table_deinit(cn_lens_table *table);

/* Linear radiance, rows top down, width * height pixels. seen, clean: RGB. distance: metres along the ray through the
 * pixel's middle, 0 in the sky. steady: the share of a pixel that no one stands in or shades. */
typedef struct cn_film {
    float *seen, *clean, *distance_m, *still;
} cn_film;
CN_NODISCARD cn_status cn_film_create(cn_film *film, uint32_t width, uint32_t height);
void cn_film_destroy(cn_film *film);
/* The input of an exposure: a shot's view of the world in the light of a run. */
typedef struct cn_exposure {
    const cn_world *world;
    const cn_shot *shot;
    const cn_crowd *crowd; /* NULL: no people and cars */
    const cn_lens_table *lens;
    uint32_t index; /* seeds the photo's random numbers */
    uint32_t run;
} cn_exposure;
/* Exposes rows [from, to). */
void cn_film_expose(cn_film *film, const cn_exposure *exposure, uint32_t from, uint32_t to);

/* Writes OUT/photos/NAME from what the film has seen: exposure, white balance, noise, EXIF. Fills exposure_s and gain.
 */
CN_NODISCARD cn_status cn_shot_develop(const cn_world *world, const cn_rig *rig, cn_shot *shot, uint32_t index,
                                       const cn_film *film, const char *path);
/* EXR of the clean picture in linear ACEScg with its depth; the mask as PNG, black where a pixel is not the city alone.
 */
CN_NODISCARD cn_status cn_film_write_clean(const cn_film *film, uint32_t width, uint32_t height, const char *path);
CN_NODISCARD cn_status cn_film_write_mask(const cn_film *film, uint32_t width, uint32_t height, const char *path);
#endif
