/* Depth maps of posed photos by PatchMatch stereo (Bleyer et al. 2011; Schoenberger et al. 2016). */
#ifndef CONURB_STEREO_STEREO_H
#define CONURB_STEREO_STEREO_H
#include "conurb/photo.h"
#include "conurb/pose.h"

enum { CN_STEREO_SOURCES = 8 };
typedef struct cn_stereo_options {
    uint32_t width_px; /* width of the pictures that are matched, at most; narrower photos keep their size */
    uint32_t rounds;   /* of propagation and refinement */
    uint32_t fine; /* more rounds, with windows half as wide; where they find no match, that of the wide ones stays */
    uint32_t sources; /* views that a view is matched with, at most; 1 to CN_STEREO_SOURCES */
    float worst_cost; /* 1 - normalised cross-correlation of a match that is kept, at most */
    uint64_t seed;
} cn_stereo_options;
cn_stereo_options cn_stereo_options_default(void);

/* The depth map of one view. */
typedef struct cn_stereo_map {
    uint32_t width, height;
    float *depth_m; /* [height][width] along the camera's axis; 0: not known */
} cn_stereo_map;

/* The photos to match. Borrowed. */
typedef struct cn_stereo_input {
    const cn_scene *scene;
    const cn_pixel_store *pixels;
    const uint32_t *views; /* [n] rows of scene->views; each once */
    uint32_t n;
    const char *name; /* of the tile, for progress */
    /* NULL, or depths to begin with, [n_wanted], of the sizes of cn_stereo_size. What is found is then not compared
     * with other views' maps, as it is without: the caller does that. */
    const cn_stereo_map *prior;
    uint32_t n_wanted; /* the first views, that get a map; the rest are only matched with. 0: all */
} cn_stereo_input;

/* The size of the map of a photo of width x height pixels. 0: such a photo gets none. */
void cn_stereo_size(const cn_stereo_options *options, uint32_t width, uint32_t height, uint32_t *map_width,
                    uint32_t *map_height);
/* Fills maps[input->n], or [n_wanted]; the caller frees each with cn_stereo_map_deinit, also after a failure. Pixels
 * are those of the view's camera, resized to the map. A view with too few sparse points, or without a neighbour that
 * shares some, has an empty map. Memory: 40 bytes per pixel of a map for each thread, and 12 for each view. The same
 * seed and instruction set give the same maps, whatever the number of threads. CN_ERR_NOMEM. CN_ERR_IO: the pixels
 * cannot be read. CN_ERR_INTERRUPTED: asked to stop. */
CN_NODISCARD cn_status cn_stereo_run(const cn_context *ctx, const cn_stereo_input *input,
                                     const cn_stereo_options *options, cn_stereo_map *maps);
void cn_stereo_map_deinit(cn_stereo_map *map);
/* The depth at a place of the map, in pixels, inside of it; interpolated where its four neighbours are of one surface.
 * 0: not known. */
float cn_stereo_map_at(const cn_stereo_map *map, double x, double y);
#endif
