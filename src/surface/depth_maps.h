/* The depth maps of all views, in a file that is mapped into memory. With a key it has a name, PATH.depths, and what a
 * run that was stopped or killed has put there serves the next one. The file holds the maps as they were rendered and,
 * if they are refined, once more after that. */
#ifndef CONURB_SURFACE_DEPTH_MAPS_H
#define CONURB_SURFACE_DEPTH_MAPS_H
#include "conurb/surface.h"

enum { CN_DEPTH_WIDEST = 24 }; /* cubes */
typedef struct cn_depth_pixel {
    float depth_m;  /* along the ray; INFINITY: the sky */
    uint8_t rgb[3]; /* display-encoded */
    uint8_t band;   /* cubes on each side of the surface in which the distance counts; 0: the depth is not known */
} cn_depth_pixel;
typedef struct cn_depth_map {
    cn_camera camera;
    const cn_view *view;
    double centre[3], far_m; /* far_m: its largest depth */
    double half_angle;       /* of a cone around the view's axis that holds the picture */
    size_t first;            /* pixel */
} cn_depth_map;
typedef struct cn_depth_maps {
    const char *path;
    int fd;
    uint64_t key;     /* of what the maps are made; 0: the file has no name */
    char *name;       /* of the file, or NULL */
    uint32_t ready;   /* maps that an earlier run has left there */
    uint32_t refined; /* of them, the first ones, that are refined */
    bool checked;     /* and none of them is changed any more */
    cn_depth_map *maps;
    uint32_t n;
    size_t n_pixels;
    /* Of all maps, once cn_depth_maps_finish was called; changes go to the file. rendered: NULL when nothing is to be
     * refined. */
    cn_depth_pixel *pixels, *rendered;
    void *mapped; /* the whole file */
    size_t mapped_size;
} cn_depth_maps;

/* The file is made in the folder of path, which is borrowed. Room for n maps. */
CN_NODISCARD cn_status cn_depth_maps_open(cn_depth_maps *maps, const char *path, uint64_t key, uint32_t n);
/* Fine when zeroed. keep: the file stays for the next run, if it has a name. */
void cn_depth_maps_close(cn_depth_maps *maps, bool keep);
/* Renders a view, or takes the map that is there already, and adds it. cn_depth_maps_agree sets the
 * bands; until then they only say which depths are known. */
CN_NODISCARD cn_status cn_depth_maps_add(cn_depth_maps *maps, const cn_context *ctx, const cn_surface_source *source,
                                         const cn_view *view);
CN_NODISCARD cn_status cn_depth_maps_finish(cn_depth_maps *maps, bool refine);
/* Sets what is refined, once that is on disk, if the file has a name. CN_ERR_IO. */
CN_NODISCARD cn_status cn_depth_maps_keep(cn_depth_maps *maps, uint32_t refined, bool checked);

/* The n_nearest maps, at most all, that were taken nearest to any of maps first to first + n - 1: these themselves come
 * first, in their order. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_depth_maps_nearest(const cn_depth_maps *maps, uint32_t first, uint32_t n, uint32_t n_nearest,
                                             uint32_t *nearest);

/* The direction of a pixel's ray, in local axes. False where the lens has none. */
bool cn_depth_map_ray(const cn_depth_map *map, uint32_t x, uint32_t y, double away[3]);

/* What a map shows of a place: *sight_m, the depth there less the distance of the place (positive: the place is in
 * front of the surface), and the distance. False when the map does not show it. pixel: the nearest one. */
typedef struct cn_depth_sight {
    double sight_m, distance_m;
    const cn_depth_pixel *pixel;
} cn_depth_sight;
bool cn_depth_map_look(const cn_depth_maps *maps, const cn_depth_map *map, const double xyz[3], cn_depth_sight *sight);
/* Whether stereo has changed the depth that the field shows. pixel: one of maps->pixels. */
static inline bool cn_depth_pixel_moved(const cn_depth_maps *maps, const cn_depth_pixel *pixel)
{
    if (!maps->rendered) return false;
    const cn_depth_pixel *was = maps->rendered + (pixel - maps->pixels);
    return !was->band || pixel->depth_m < was->depth_m || pixel->depth_m > was->depth_m;
}
/* False when no place of the ball is in the picture, before far_m and a margin. */
bool cn_depth_map_reaches(const cn_depth_map *map, const double centre[3], double radius_m, double margin_m);
#endif
