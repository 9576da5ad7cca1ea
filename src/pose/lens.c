#include "pose/lens.h"

#include "base/units.h"

#include <math.h>
#include <string.h>

static const struct {
    cn_lens lens;
    const char *name;
    int n_params;
} LENSES[] = {
    { CN_LENS_SIMPLE_PINHOLE, "SIMPLE_PINHOLE", 3 },
    { CN_LENS_PINHOLE, "PINHOLE", 4 },
    { CN_LENS_SIMPLE_RADIAL, "SIMPLE_RADIAL", 4 },
    { CN_LENS_RADIAL, "RADIAL", 5 },
    { CN_LENS_OPENCV, "OPENCV", 8 },
    { CN_LENS_OPENCV_FISHEYE, "OPENCV_FISHEYE", 8 },
    { CN_LENS_EQUIRECTANGULAR, "EQUIRECTANGULAR", 2 },
};
enum { N_LENSES = sizeof LENSES / sizeof *LENSES };

/* Its place in the list, or N_LENSES. */
static int place_of(int id)
{
    int i = 0;
    while (i < N_LENSES && (int)LENSES[i].lens != id)
        i++;
    return i;
}

bool cn_lens_is_known(int id)
{
    return place_of(id) < N_LENSES;
}

const char *cn_lens_name(cn_lens lens)
{
    const int i = place_of((int)lens);
    return i < N_LENSES ? LENSES[i].name : "unknown";
}

int cn_lens_params(cn_lens lens)
{
    const int i = place_of((int)lens);
    return i < N_LENSES ? LENSES[i].n_params : 0;
}

int cn_lens_from_name(const char *name)
{
    for (int i = 0; i < N_LENSES; i++)
        if (strcmp(LENSES[i].name, name) == 0) return (int)LENSES[i].lens;
    return -1;
}

cn_camera cn_camera_equirectangular(uint32_t width, uint32_t height)
{
    return (
        cn_camera){ .lens = CN_LENS_EQUIRECTANGULAR, .width = width, .height = height, .params = { width, height } };
}

cn_lens_view cn_lens_unpack(const cn_camera *camera)
{
    const double *p = camera->params;
    cn_lens_view view = { .fisheye = camera->lens == CN_LENS_OPENCV_FISHEYE };
    if (camera->lens == CN_LENS_EQUIRECTANGULAR)
        return (cn_lens_view){
            .fx = p[0] / (2.0 * CN_PI), .fy = p[1] / CN_PI, .cx = 0.5 * p[0], .cy = 0.5 * p[1], .equirectangular = true
        };
    bool one_focal = camera->lens == CN_LENS_SIMPLE_PINHOLE || camera->lens == CN_LENS_SIMPLE_RADIAL ||
                     camera->lens == CN_LENS_RADIAL;
    view.fx = *p++;
    view.fy = one_focal ? view.fx : *p++;
    view.cx = *p++;
    view.cy = *p++;
    switch (camera->lens) {
    case CN_LENS_SIMPLE_PINHOLE:
    case CN_LENS_PINHOLE:
    case CN_LENS_EQUIRECTANGULAR: break;
    case CN_LENS_SIMPLE_RADIAL: view.k[0] = p[0]; break;
    case CN_LENS_RADIAL: memcpy(view.k, p, 2 * sizeof *p); break;
    case CN_LENS_OPENCV:
        memcpy(view.k, p, 2 * sizeof *p);
        memcpy(view.p, p + 2, 2 * sizeof *p);
        break;
    case CN_LENS_OPENCV_FISHEYE: memcpy(view.k, p, 4 * sizeof *p); break;
    }
    return view;
}

void cn_lens_pack(const cn_lens_view *view, cn_camera *camera)
{
    bool one_focal = view->fx == view->fy;
    switch (camera->lens) {
    case CN_LENS_SIMPLE_PINHOLE:
        if (!one_focal) camera->lens = CN_LENS_PINHOLE;
        break;
    case CN_LENS_SIMPLE_RADIAL:
    case CN_LENS_RADIAL:
        if (!one_focal) camera->lens = CN_LENS_OPENCV;
        break;
    default: one_focal = false;
    }
    double *p = camera->params;
    memset(p, 0, sizeof camera->params);
    if (camera->lens == CN_LENS_EQUIRECTANGULAR) {
        p[0] = view->fx * 2.0 * CN_PI;
        p[1] = view->fy * CN_PI;
        return;
    }
    *p++ = view->fx;
    if (!one_focal) *p++ = view->fy;
    *p++ = view->cx;
    *p++ = view->cy;
    memcpy(p, view->k, (size_t)(cn_lens_params(camera->lens) - (p - camera->params)) * sizeof *p);
    if (camera->lens == CN_LENS_OPENCV) memcpy(p + 2, view->p, sizeof view->p);
}

cn_status cn_camera_check(const cn_camera *camera, const char *where)
{
    if (camera->width == 0 || camera->height == 0)
        return cn_fail(CN_ERR_FORMAT, "%s: camera %u is %u x %u pixels", where, camera->id, camera->width,
                       camera->height);
    for (int i = 0; i < cn_lens_params(camera->lens); i++)
        if (!isfinite(camera->params[i]))
            return cn_fail(CN_ERR_FORMAT, "%s: camera %u: parameter %d is not finite", where, camera->id, i);
    cn_lens_view view = cn_lens_unpack(camera);
    if (!(view.fx > 0.0) || !(view.fy > 0.0))
        return cn_fail(CN_ERR_FORMAT, "%s: camera %u: focal length %g x %g is not positive", where, camera->id, view.fx,
                       view.fy);
    if (camera->lens == CN_LENS_EQUIRECTANGULAR &&
        (fabs(camera->params[0] - camera->width) > 0.5 || fabs(camera->params[1] - camera->height) > 0.5))
        return cn_fail(
            CN_ERR_FORMAT,
            "%s: camera %u is equirectangular for %g x %g pixels, but its pictures are %u x %u; a picture of "
            "a part of the sphere cannot be used",
            where, camera->id, camera->params[0], camera->params[1], camera->width, camera->height);
    return CN_OK;
}

double cn_camera_vfov_deg(const cn_camera *camera)
{
    enum { IN_PLACE_OF_A_SPHERE_DEG = 60 };
    if (camera->lens == CN_LENS_EQUIRECTANGULAR) return IN_PLACE_OF_A_SPHERE_DEG;
    return fmin(fmax(cn_degrees(2 * atan(camera->height / 2.0 / cn_lens_unpack(camera).fy)), 1), 170);
}

double cn_camera_offset_px(const cn_camera *camera, const double from[2], const double to[2], double offset[2])
{
    offset[0] = to[0] - from[0];
    offset[1] = to[1] - from[1];
    if (camera->lens == CN_LENS_EQUIRECTANGULAR) {
        /* A row is a circle, and it is the shorter the nearer it lies to a pole. */
        const double latitude = (from[1] / camera->params[1] - 0.5) * CN_PI;
        offset[0] = remainder(offset[0], camera->params[0]) * fmax(cos(latitude), 0.0);
    }
    return hypot(offset[0], offset[1]);
}

void cn_camera_resize(const cn_camera *camera, uint32_t width, uint32_t height, cn_camera *out)
{
    double sx = (double)width / camera->width, sy = (double)height / camera->height;
    cn_lens_view view = cn_lens_unpack(camera);
    view.fx *= sx;
    view.cx *= sx;
    view.fy *= sy;
    view.cy *= sy;
    *out = *camera;
    out->width = width;
    out->height = height;
    cn_lens_pack(&view, out);
}
