/* conurb/colour.h: colours through OpenColorIO. Photos are read into linear ACEScg, all work is done in linear ACEScg,
 * and pictures are encoded for the display at the end. */
#ifndef CONURB_COLOUR_H
#define CONURB_COLOUR_H
#include "conurb/base.h"
#ifdef __cplusplus
extern "C" {
#endif

typedef struct cn_colour cn_colour;
/* Opens an OpenColorIO config. config_path NULL: the file of $OCIO when that is set, else Conurb's own config (sRGB
 * and ACES views); "": always Conurb's own. The working space is ACEScg, found by its usual names, else by the role
 * scene_linear. CN_ERR_CONFIG: the config cannot be used. The caller destroys it. Several threads may use one
 * cn_colour at the same time. */
CN_API CN_NODISCARD cn_status cn_colour_create(cn_colour **colour, const char *config_path);
CN_API void cn_colour_destroy(cn_colour **colour);
/* OpenColorIO has one log for the process, which writes to standard error. The library does not change it. A program
 * that uses OpenColorIO only through Conurb may call this once, before anything else: OpenColorIO then logs nothing,
 * and errors are only returned. */
CN_API void cn_colour_own_process(void);
/* A hash of the content of the config that cn_colour_create would open. It tells whether something was made with
 * another config. Files that the config refers to (LUTs) are not read. CN_ERR_CONFIG: the file cannot be read. */
CN_API CN_NODISCARD cn_status cn_colour_config_hash(const char *config_path, uint64_t *hash);
/* Converts n pixels to linear ACEScg in place. stride: floats per pixel, 3 or 4; the fourth does not change. Channels
 * that are not finite are set to 0 first. from: a colour space of the config; NULL: sRGB, found by its usual names,
 * else by the default role. CN_ERR_CONFIG: the config has no such space. */
CN_API CN_NODISCARD cn_status cn_colour_to_linear(const cn_colour *colour, const char *from, float *pixels, size_t n,
                                                  int stride);
/* How linear colours are encoded for the display. All zero: the defaults. */
typedef struct cn_display_transform {
    const char *view;   /* NULL: the config's default view. Conurb's own config has "sRGB" (the default) and "ACES" (the
                           ACES 1.0 SDR view) */
    const char *look;   /* NULL: none */
    double exposure_ev; /* stops; applied first, to linear colours */
} cn_display_transform;
/* Converts n pixels from linear ACEScg to display-encoded values in [0, 1], in place. display NULL: the defaults.
 * Channels that are not finite are set to 0 first. CN_ERR_CONFIG: the config has no such view or look. */
CN_API CN_NODISCARD cn_status cn_colour_to_display(const cn_colour *colour, const cn_display_transform *display,
                                                   float *pixels, size_t n, int stride);
/* The names of the views, the default one first. The array ends with NULL and is owned by colour. */
CN_API const char *const *cn_colour_views(const cn_colour *colour);
/* The names of the looks, in the same form. Conurb's own config has none. */
CN_API const char *const *cn_colour_looks(const cn_colour *colour);
/* 3 x 3 matrices, row-major, between linear ACEScg (AP1, D60) and linear sRGB (Rec. 709, D65), with Bradford
 * adaptation. */
CN_API extern const double cn_srgb_from_acescg[9];
CN_API extern const double cn_acescg_from_srgb[9];

#ifdef __cplusplus
}
#endif
#endif
