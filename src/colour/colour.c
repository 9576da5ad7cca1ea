#include "conurb/colour.h"

#include "base/hash.h"
#include "bridge/ocio.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

extern const char cn_colour_config_text[];

/* AP1 (D60) <-> Rec. 709 (D65) with Bradford adaptation, computed from the primaries. The config's built-in transforms
 * are equal (tests compare). */
const double cn_srgb_from_acescg[9] = { 1.7050509926579833,    -0.6217921206570047,  -0.08325887200097867,
                                        -0.13025641750704348,  1.1408047365754015,   -0.010548319068358007,
                                        -0.024003356804618126, -0.12896897606497063, 1.1529723328695887 };
const double cn_acescg_from_srgb[9] = { 0.6130974024011876,   0.3395231461841057,  0.04737945141470668,
                                        0.07019372246958173,  0.9163538790573441,  0.0134523984730741,
                                        0.020615592882226974, 0.10956977293813548, 0.8698146341796376 };

struct cn_colour {
    cn_ocio *ocio;
    const char *working, *photo; /* colour spaces of the config */
};

/* Names of the same spaces in the ACES configs of recent years. */
static const char *const WORKING_NAMES[] = { "ACEScg", "ACES - ACEScg", "lin_ap1", "scene_linear", NULL };
static const char *const PHOTO_NAMES[] = { "sRGB",
                                           "sRGB - Texture",
                                           "sRGB Encoded Rec.709 (sRGB)",
                                           "Utility - sRGB - Texture",
                                           "srgb_tx",
                                           "srgb_texture",
                                           "default",
                                           NULL };

/* The config file to use, or NULL for Conurb's own config. */
static const char *config_file(const char *config_path)
{
    const char *path = config_path ? config_path : getenv("OCIO");
    return path && *path ? path : NULL;
}

cn_status cn_colour_config_hash(const char *config_path, uint64_t *hash)
{
    const char *path = config_file(config_path);
    *hash = cn_hash64(cn_colour_config_text, strlen(cn_colour_config_text));
    if (path && cn_hash_file(path, hash) != CN_OK)
        return cn_fail(CN_ERR_CONFIG, "OpenColorIO config %s cannot be read; correct OCIO or unset it", path);
    return CN_OK;
}

cn_status cn_colour_create(cn_colour **colour, const char *config_path)
{
    *colour = calloc(1, sizeof **colour);
    if (!*colour) return cn_fail(CN_ERR_NOMEM, "out of memory for a colour configuration");
    const char *path = config_file(config_path);
    cn_status status = cn_ocio_create(&(*colour)->ocio, path, cn_colour_config_text);
    if (status == CN_OK) {
        (*colour)->working = cn_ocio_first_space((*colour)->ocio, WORKING_NAMES);
        (*colour)->photo = cn_ocio_first_space((*colour)->ocio, PHOTO_NAMES);
        if (!(*colour)->working || !(*colour)->photo)
            status = cn_fail(CN_ERR_CONFIG, "OpenColorIO config %s has neither %s; give those roles or unset OCIO",
                             path ? path : "(built in)",
                             (*colour)->working ? "a colour space sRGB nor the role default"
                                                : "a colour space ACEScg nor the role scene_linear");
    }
    if (status != CN_OK) cn_colour_destroy(colour);
    return status;
}

void cn_colour_own_process(void)
{
    cn_ocio_own_process();
}

void cn_colour_destroy(cn_colour **colour)
{
    if (!*colour) return;
    cn_ocio_destroy(&(*colour)->ocio);
    free(*colour);
    *colour = NULL;
}

/* One NaN channel would make the whole pixel NaN. */
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
    return cn_ocio_convert(colour->ocio, from ? from : colour->photo, colour->working, pixels, n, stride);
}

static bool has_view(const cn_colour *colour, const char *view)
{
    for (const char *const *name = cn_ocio_views(colour->ocio); *name; name++)
        if (strcmp(*name, view) == 0) return true;
    return false;
}

static cn_status unknown_view(const cn_colour *colour, const char *view)
{
    char list[256] = "";
    for (const char *const *name = cn_ocio_views(colour->ocio); *name; name++) {
        const size_t used = strlen(list);
        snprintf(list + used, sizeof list - used, "%s%s", used ? ", " : "", *name);
    }
    return cn_fail(CN_ERR_CONFIG, "there is no view \"%s\"; the OpenColorIO config has %s", view, list);
}

cn_status cn_colour_to_display(const cn_colour *colour, const cn_display_transform *display, float *pixels, size_t n,
                               int stride)
{
    cn_display_transform d = display ? *display : (cn_display_transform){ 0 };
    if (!d.view) d.view = cn_ocio_views(colour->ocio)[0];
    if (!has_view(colour, d.view)) return unknown_view(colour, d.view);
    clean(pixels, n, stride);
    const cn_ocio_look look = { .from = colour->working, .view = d.view, .look = d.look, .exposure_ev = d.exposure_ev };
    CN_TRY(cn_ocio_display(colour->ocio, &look, pixels, n, stride));
    for (size_t i = 0; i < n; i++)
        for (int c = 0; c < 3; c++) {
            float *x = &pixels[i * (size_t)stride + (size_t)c];
            *x = fminf(fmaxf(*x, 0), 1);
        }
    return CN_OK;
}

const char *const *cn_colour_views(const cn_colour *colour)
{
    return cn_ocio_views(colour->ocio);
}

const char *const *cn_colour_looks(const cn_colour *colour)
{
    return cn_ocio_looks(colour->ocio);
}
