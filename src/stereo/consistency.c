#include "stereo/consistency.h"

#include <math.h>
#include <stdlib.h>

/* Two views agree on a place when their depths differ by less, relative, and when the way there and back ends so near,
 * in pixels. */
#define SAME_DEPTH 0.02
#define SAME_PIXEL 1.5
#define JUMP 0.05 /* between neighbours on one surface, relative */
/* So many sources must agree; of a view with two sources or one, one. Any one more would leave too little. */
enum { MUST_AGREE = 2 };

static void to_world(const cn_stereo_view *v, double x, double y, double depth, double xyz[3])
{
    const double c[3] = { (x - (double)v->cx) / (double)v->focal * depth - v->pose->translation[0],
                          (y - (double)v->cy) / (double)v->focal * depth - v->pose->translation[1],
                          depth - v->pose->translation[2] };
    for (int a = 0; a < 3; a++)
        xyz[a] = v->pose->rotation[a] * c[0] + v->pose->rotation[3 + a] * c[1] + v->pose->rotation[6 + a] * c[2];
}

static double to_view(const cn_stereo_view *v, const double xyz[3], double *x, double *y)
{
    double c[3];
    cn_stereo_to_camera(v->pose, xyz, c);
    *x = (double)v->focal * c[0] / c[2] + (double)v->cx;
    *y = (double)v->focal * c[1] / c[2] + (double)v->cy;
    return c[2];
}

static bool agrees(const cn_stereo_view *r, const cn_stereo_view *s, const double at[2], double depth)
{
    double xyz[3], u, v, back[2];
    to_world(r, at[0], at[1], depth, xyz);
    const double there = to_view(s, xyz, &u, &v);
    if (!(there > 0 && u >= 0 && v >= 0 && u < s->width && v < s->height)) return false;
    const double found = (double)s->depth[(size_t)v * s->width + (size_t)u];
    if (!(fabs(found - there) < SAME_DEPTH * there)) return false;
    to_world(s, u, v, found, xyz);
    to_view(r, xyz, &back[0], &back[1]);
    return hypot(back[0] - at[0], back[1] - at[1]) < SAME_PIXEL;
}

/* The depth at a pixel of the pinhole picture if enough sources agree with it, else 0. */
static float agreed(const cn_stereo_views *views, const cn_stereo_view *v, uint32_t x, uint32_t y)
{
    const float depth = v->depth[(size_t)y * v->width + x];
    if (!(depth > 0)) return 0;
    const uint32_t needed = v->n_sources > MUST_AGREE ? MUST_AGREE : 1;
    const double at[2] = { x + 0.5, y + 0.5 };
    uint32_t n = 0;
    for (uint32_t s = 0; s < v->n_sources && n < needed; s++) {
        const cn_stereo_view *source = &views->view[v->sources[s]];
        if (source->depth) n += agrees(v, source, at, (double)depth);
    }
    return n >= needed ? depth : 0;
}

float cn_stereo_map_at(const cn_stereo_map *map, double x, double y)
{
    const float nearest = map->depth_m[(size_t)y * map->width + (size_t)x];
    const double left = floor(x - 0.5), top = floor(y - 0.5);
    if (!(nearest > 0) || left < 0 || top < 0 || left + 1 >= map->width || top + 1 >= map->height) return nearest;
    const float *d = map->depth_m + (size_t)top * map->width + (size_t)left;
    const float corner[4] = { d[0], d[1], d[map->width], d[map->width + 1] };
    const double u = x - 0.5 - left, v = y - 0.5 - top;
    double sum = 0; /* inverse depth is linear on a plane, seen through a pinhole */
    for (int i = 0; i < 4; i++) {
        if (!(fabsf(corner[i] - nearest) < (float)JUMP * nearest)) return nearest;
        sum += (i % 2 ? u : 1 - u) * (i / 2 ? v : 1 - v) / (double)corner[i];
    }
    return (float)(1 / sum);
}

cn_status cn_stereo_keep(const cn_stereo_views *views, uint32_t view, bool all, cn_stereo_map *map)
{
    const cn_stereo_view *v = &views->view[view];
    const cn_stereo_map pinhole = { v->width, v->height, v->depth };
    *map = (cn_stereo_map){ v->width, v->height, calloc((size_t)v->width * v->height + 1, sizeof(float)) };
    if (!map->depth_m) return cn_fail(CN_ERR_NOMEM, "out of memory for the depths of photos by stereo");
    for (uint32_t y = 0; y < v->height; y++)
        for (uint32_t x = 0; x < v->width; x++) {
            double dir[3];
            if (cn_camera_unproject(&v->camera, x + 0.5, y + 0.5, dir) != CN_OK || !(dir[2] > 0)) continue;
            const double px = (double)v->focal * dir[0] / dir[2] + (double)v->cx,
                         py = (double)v->focal * dir[1] / dir[2] + (double)v->cy;
            if (!(px >= 0 && py >= 0 && px < v->width && py < v->height)) continue;
            map->depth_m[(size_t)y * v->width + x] =
                all ? cn_stereo_map_at(&pinhole, px, py) : agreed(views, v, (uint32_t)px, (uint32_t)py);
        }
    return CN_OK;
}
