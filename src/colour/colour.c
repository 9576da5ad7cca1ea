#include "conurb/colour.h"

#include "bridge/ocio.h"

#include <math.h>
#include <stdlib.h>

extern const char cn_colour_config_text[];

/* AP1 (D60) <-> Rec.709 (D65) with Bradford adaptation: what the config's builtin transforms amount to (tests compare). */
const double cn_srgb_from_acescg[9] = {1.7050509926579815, -0.6217921205992767, -0.08325887205870485,
                                       -0.13025641748825, 1.1408047365754048, -0.010548319086154778,
                                       -0.024003356804618042, -0.12896897606497185, 1.15297233286959};
const double cn_acescg_from_srgb[9] = {0.6130974023989185, 0.3395231462094063, 0.04737945139167522,
                                       0.07019372247006918, 0.9163538790731306, 0.013452398456800174,
                                       0.02061559288344101, 0.10956977293812464, 0.8698146341784343};

struct cn_colour { cn_ocio *ocio; };

cn_status cn_colour_create(cn_colour **colour, const char *config_path)
{
    *colour = calloc(1, sizeof **colour);
    if (!*colour) return cn_fail(CN_ERR_NOMEM, "out of memory for a colour configuration");
    const char *path = config_path ? config_path : getenv("OCIO");
    if (path && !*path) path = NULL;
    const cn_status status = cn_ocio_create(&(*colour)->ocio, path, cn_colour_config_text);
    if (status != CN_OK) cn_colour_destroy(colour);
    return status;
}

void cn_colour_destroy(cn_colour **colour)
{
    if (!*colour) return;
    cn_ocio_destroy(&(*colour)->ocio);
    free(*colour);
    *colour = NULL;
}

/* One channel that is not a number would make the whole pixel so. */
static void clean(float *pixels, size_t n, int stride)
{
    for (size_t i = 0; i < n; i++)
        for (int c = 0; c < 3; c++) {
            float *x = &pixels[i * (size_t)stride + (size_t)c];
            if (!isfinite(*x)) *x = 0;
        }
}

cn_status cn_colour_to_linear(const cn_colour *colour, const char *from, float *pixels, size_t n, int stride)
{
    clean(pixels, n, stride);
    return cn_ocio_convert(colour->ocio, from ? from : "default", "scene_linear", pixels, n, stride);
}

cn_status cn_colour_to_display(const cn_colour *colour, const char *view, const char *look, double exposure_ev, float *pixels,
                               size_t n, int stride)
{
    clean(pixels, n, stride);
    CN_TRY(cn_ocio_display(colour->ocio, "scene_linear", view ? view : cn_ocio_views(colour->ocio)[0], look, exposure_ev, pixels, n,
                           stride));
    for (size_t i = 0; i < n; i++)
        for (int c = 0; c < 3; c++) {
            float *x = &pixels[i * (size_t)stride + (size_t)c];
            *x = fminf(fmaxf(*x, 0), 1);
        }
    return CN_OK;
}

const char *const *cn_colour_views(const cn_colour *colour) { return cn_ocio_views(colour->ocio); }
