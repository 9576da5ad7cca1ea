/* Rays of a tile: from a pixel of a view through its lens into the tile's box. Results are floats relative to the
 * tile's centre; the code behind this header never uses world coordinates. */
#ifndef CONURB_RAYS_RAYS_H
#define CONURB_RAYS_RAYS_H
#include "conurb/pose.h"
#include "kernel/kernel.h"

/* The tile's place: a box of centre +- half_extent (local metres) that maps to [-1,1]^3, and the range of its rays. */
typedef struct cn_box {
    double centre[3], half_extent[3];
    float near_m, far_m;
    float step; /* a step's length over its distance */
} cn_box;

/* One ray. box_ray: box units; dir: unit, world axes (east, north, up). */
typedef struct cn_ray {
    cn_box_ray box_ray;
    float dir[3];
} cn_ray;

/* A view, ready to shoot rays. */
typedef struct cn_ray_generator {
    cn_camera camera;
    double world_from_cam[9], origin[3]; /* origin relative to the box's centre, metres */
    double inv_extent[3];
} cn_ray_generator;

/* camera must already have the size of the picture that pixels are given in. */
void cn_ray_generator_init(cn_ray_generator *generator, const cn_camera *camera, const cn_view *view,
                           const cn_box *box);
/* False when the lens has no ray there (the pixel is then left out). x_px, y_px: pixel centres are at .5. */
bool cn_ray_generator_ray(const cn_ray_generator *generator, double x_px, double y_px, cn_ray *ray);
/* The ray from a point of the local frame (metres) along a unit direction. */
void cn_ray_make(const cn_box *box, const double origin[3], const double dir[3], cn_ray *ray);
/* The contracted position, 0 to 1, of a point of the local frame (metres). Returns the factor by which the contraction
 * multiplies positions there: 1 in the box. */
double cn_box_contract(const cn_box *box, const double point[3], float x[3]);
/* 1 / mean half extent, 1/m. */
float cn_box_inv_extent(const cn_box *box);
/* Factors along each axis: from box units to mean half extents, back, and from metres to box units. Training multiplies
 * by them instead of dividing, because a device may round a quotient in its own way, and rays that differ meet other
 * cells. */
typedef struct cn_box_units {
    float to_mean[3], from_mean[3], from_m[3];
} cn_box_units;
cn_box_units cn_box_units_of(const cn_box *box);
/* Real spherical harmonics up to degree 3 (16 values) of a unit direction. Sloan 2008. */
void cn_rays_harmonics(const float dir[3], float out[16]);
/* The views of cn_rays_visible_cells. */
enum { CN_ALONE_X = 8, CN_ALONE_Y = 6, CN_ALONE_PARTS = CN_ALONE_X * CN_ALONE_Y };
typedef struct cn_seeing_views {
    uint32_t n;
    const cn_ray_generator *generators; /* [n] */
    const float *alone_from_m; /* [n][CN_ALONE_Y][CN_ALONE_X] parts of a view's picture: beyond this distance one view
                                * is enough, without a second one; INFINITY: never. NULL: never */
} cn_seeing_views;

/* Fills usable[CN_OCC_CELLS]. A cell is usable when two of the views see it, when the only view sees it, or when one
 * view sees it from beyond its alone_from_m. A cell at a picture's edge counts as seen. Of more than 512 views that may
 * see the surroundings of a cell, 512 are asked. Takes long: runs on the pool. False: out of memory. */
bool cn_rays_visible_cells(cn_pool *pool, const cn_box *box, const cn_seeing_views *views, uint8_t *usable);
/* Where each view shows that nothing is in front of the sky. */
typedef struct cn_clear_maps {
    uint32_t columns, rows;   /* a map covers its view's whole picture */
    const uint8_t *clearance; /* [views][rows][columns]: to the nearest place that is not clear, in places of the map,
                               * the larger of both axes; 0: not clear itself; 255: so many or more */
} cn_clear_maps;

/* Sets usable[cell] to 0 for each cell that lies wholly, with a margin of one place, where two of the views are clear,
 * or where the only view is. alone_from_m is not used. Asks as many views. Takes long: runs on the pool. False: out of
 * memory. */
bool cn_rays_clear_cells(cn_pool *pool, const cn_box *box, const cn_seeing_views *views, const cn_clear_maps *maps,
                         uint8_t *usable);
#endif
