#include "conurb/splat.h"

#include <stdlib.h>
#include <string.h>

cn_status cn_splats_create(cn_splats **splats, size_t n, uint32_t degree)
{
    *splats = NULL;
    if (degree > CN_SPLAT_MAX_DEGREE)
        return cn_fail(CN_ERR_USAGE, "spherical harmonics of degree %u: splats have degree 0 to %d", degree,
                       CN_SPLAT_MAX_DEGREE);
    const size_t room = n ? n : 1, coefficients = (size_t)(degree + 1) * (degree + 1);
    cn_splats *s = calloc(1, sizeof *s);
    if (s) {
        *s = (cn_splats){ .n = n, .degree = degree };
        s->centre = calloc(room, sizeof *s->centre);
        s->scale = calloc(room, sizeof *s->scale);
        s->rotation = calloc(room, sizeof *s->rotation);
        s->opacity = calloc(room, sizeof *s->opacity);
        s->colour = calloc(room, coefficients * 3 * sizeof *s->colour);
    }
    if (!s || !s->centre || !s->scale || !s->rotation || !s->opacity || !s->colour) {
        cn_splats_destroy(&s);
        return cn_fail(CN_ERR_NOMEM, "out of memory for %zu splats", n);
    }
    *splats = s;
    return CN_OK;
}

void cn_splats_destroy(cn_splats **splats)
{
    cn_splats *s = *splats;
    *splats = NULL;
    if (!s) return;
    free(s->centre);
    free(s->scale);
    free(s->rotation);
    free(s->opacity);
    free(s->colour);
    free(s);
}

cn_camera cn_splats_camera(const cn_camera *camera)
{
    if (camera->lens == CN_LENS_EQUIRECTANGULAR) {
        const double w = 0.5 * camera->width, h = 0.5 * camera->height;
        return (cn_camera){
            .lens = CN_LENS_PINHOLE, .width = camera->width, .height = camera->height, .params = { h, h, w, h }
        };
    }
    const bool one = camera->lens == CN_LENS_SIMPLE_PINHOLE || camera->lens == CN_LENS_SIMPLE_RADIAL ||
                     camera->lens == CN_LENS_RADIAL;
    const double *p = camera->params;
    cn_camera out = *camera;
    out.lens = CN_LENS_PINHOLE;
    memset(out.params, 0, sizeof out.params);
    out.params[0] = p[0];
    for (int k = 1; k < 4; k++)
        out.params[k] = p[one ? k - 1 : k];
    return out;
}
