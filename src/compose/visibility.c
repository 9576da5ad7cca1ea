/* The part of a view that a tile sees: renders few rays and uses only their alpha and depth. * Block-NeRF trains a
 * network beside each tile for this (4 layers of 128, with place and direction as input). That takes 60 thousand
 * multiply-adds for one place, so some 500 thousand for a ray with 8 places, a second training, and weights in every
 * tile. A ray through the tile takes 3.3 thousand for the density of a sample and 6.4 thousand for the colour of one
 * that shows, and ends at the first surface: about 100 thousand for its 20 to 30 samples. Rendering the tile itself is
 * therefore cheaper, and cannot be out of date. 32 x 18 rays are a third of a percent of a picture of 640 x 360. */
#include "conurb/compose.h"

#include "math/linalg.h"
#include "tile/model.h"

#include <math.h>
#include <stdlib.h>

enum { ACROSS = 32, DOWN = 18, RAYS = ACROSS * DOWN };

/* Rays of a view, and a tile's alpha and depth along them. */
typedef struct observation {
    double origin[RAYS][3], direction[RAYS][3];
    float rgba[RAYS][4], depth[RAYS];
    size_t n;
} observation;

static void aim(observation *o, const cn_camera *camera, const cn_view *view)
{
    double centre[3];
    cn_view_centre(view, centre);
    for (uint32_t i = 0; i < RAYS; i++) {
        const double x = (i % ACROSS + 0.5) / ACROSS * camera->width, y = (i / ACROSS + 0.5) / DOWN * camera->height;
        double in_camera[3];
        if (cn_camera_unproject(camera, x, y, in_camera) != CN_OK) continue;
        cn_mat3_tvec(view->rotation, in_camera, o->direction[o->n]);
        memcpy(o->origin[o->n++], centre, sizeof centre);
    }
}

static bool within(const cn_box *box, const double origin[3], const double direction[3], double t)
{
    for (int a = 0; a < 3; a++)
        if (fabs(origin[a] + t * direction[a] - box->centre[a]) > box->half_extent[a]) return false;
    return true;
}

cn_status cn_compose_visibility(const cn_context *ctx, const cn_tile *tile, const cn_camera *camera,
                                const cn_view *view, double *visibility)
{
    const cn_render_options options = cn_render_options_default();
    observation *o = calloc(1, sizeof *o);
    *visibility = 0;
    if (!o) return cn_fail(CN_ERR_NOMEM, "out of memory while asking what tile %s sees", tile->id);
    aim(o, camera, view);
    const cn_status status = cn_render_rays(
        ctx, tile, &(cn_ray_list){ o->n, (const double(*)[3])o->origin, (const double(*)[3])o->direction }, &options,
        o->rgba[0], o->depth);
    for (size_t i = 0; i < o->n && status == CN_OK; i++) {
        const double depth = (double)o->depth[i];
        if (depth > 0 && within(&tile->box, o->origin[i], o->direction[i], depth))
            *visibility += (double)o->rgba[i][3] / RAYS;
    }
    free(o);
    return status;
}
