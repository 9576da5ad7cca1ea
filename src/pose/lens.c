#include "pose/lens.h"

#include <math.h>
#include <string.h>

static const struct {
    const char *name;
    int n_params;
} LENSES[CN_LENS_COUNT] = {
    { "SIMPLE_PINHOLE", 3 }, { "PINHOLE", 4 }, { "SIMPLE_RADIAL", 4 },
    { "RADIAL", 5 },         { "OPENCV", 8 },  { "OPENCV_FISHEYE", 8 },
};

const char *cn_lens_name(cn_lens lens)
{
    return (unsigned)lens < CN_LENS_COUNT ? LENSES[lens].name : "unknown";
}

int cn_lens_params(cn_lens lens)
{
    return LENSES[lens].n_params;
}

int cn_lens_from_name(const char *name)
{
    for (int i = 0; i < CN_LENS_COUNT; i++)
        if (strcmp(LENSES[i].name, name) == 0) return i;
    return -1;
}

cn_lens_view cn_lens_unpack(const cn_camera *camera)
{
    const double *p = camera->params;
    cn_lens_view view = { .fisheye = camera->lens == CN_LENS_OPENCV_FISHEYE };
    bool one_focal = camera->lens == CN_LENS_SIMPLE_PINHOLE || camera->lens == CN_LENS_SIMPLE_RADIAL ||
                     camera->lens == CN_LENS_RADIAL;
    view.fx = *p++;
    view.fy = one_focal ? view.fx : *p++;
    view.cx = *p++;
    view.cy = *p++;
    switch (camera->lens) {
    case CN_LENS_SIMPLE_PINHOLE:
    case CN_LENS_PINHOLE: break;
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
    return CN_OK;
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
