/* Splats of a city's trained tiles, as cn_splats_make makes them, and how well they show them. */
#ifndef CONURB_STAGE_SPLAT_H
#define CONURB_STAGE_SPLAT_H
#include "conurb/splat.h"
#include "renderer/renderer.h"
#include "stage/survey.h"

#define CN_SPLAT_FAR 2.5 /* radii from a tile's centre beyond which splats are the sky */
typedef struct cn_city_splats {
    cn_renderer *renderer; /* with the appearance aligned */
    const cn_dataset *dataset;
    const cn_survey *survey; /* its tiles and colours */
    const cn_appearance_spec *appearance;
    cn_splat_options options;
} cn_city_splats;
/* Fits splats to the photos' views that the tiles were trained on. Scratch files lie in the folder of path. The caller
 * destroys them. */
CN_NODISCARD cn_status cn_city_splats_make(const cn_context *ctx, const cn_city_splats *city, const char *path,
                                           cn_splats **splats);
/* Writes splats to path, a .ply or .spz; logs their size, their quality and the time that they took. */
CN_NODISCARD cn_status cn_city_splats_export(const cn_context *ctx, const cn_city_splats *city, const char *path);
/* Writes 3D Tiles of splats to a folder, without the sky: of the file `from`, or, NULL, of new ones. */
CN_NODISCARD cn_status cn_city_splats_tiles(const cn_context *ctx, const cn_city_splats *city, const char *from,
                                            bool compressed, const char *folder);
#endif
