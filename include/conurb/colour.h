/* conurb/colour.h: OpenColorIO at both ends; linear ACEScg in between. */
#ifndef CONURB_COLOUR_H
#define CONURB_COLOUR_H
#include "conurb/base.h"
#ifdef __cplusplus
extern "C" {
#endif

typedef struct cn_colour cn_colour;
/* config_path NULL: $OCIO when set, else Conurb's own config (sRGB and ACES views); "": Conurb's own whatever $OCIO
 * says. The working space is the config's ACEScg under its usual names, else its scene_linear role. CN_ERR_CONFIG when
 * the config cannot be used. Caller destroys. Everything below may be called from several threads at once. */
CN_API CN_NODISCARD cn_status cn_colour_create(cn_colour **colour, const char *config_path);
CN_API void cn_colour_destroy(cn_colour **colour);
/* OpenColorIO has one log for a process, on the standard error unless the program says otherwise, and the library does
 * not touch it. A program that uses OpenColorIO through Conurb alone calls this once, before anything else: it logs
 * nothing then, and what goes wrong is returned only. */
CN_API void cn_colour_own_process(void);
/* A hash of the config that cn_colour_create would take, by its content; files that the config names in turn (LUTs) are
 * not read. What was made with another config has another hash. CN_ERR_CONFIG when the file cannot be read. */
CN_API CN_NODISCARD cn_status cn_colour_config_hash(const char *config_path, uint64_t *hash);
/* In place, n pixels with `stride` floats a pixel (3 or 4; a fourth is left alone). Non-finite channels become 0 first.
 * from: a colour space of the config; NULL for that of an sRGB photo (by its usual names, else the default role). */
CN_API CN_NODISCARD cn_status cn_colour_to_linear(const cn_colour *colour, const char *from, float *pixels, size_t n,
                                                  int stride);
/* How linear colours are brought to the screen. Zeros stand for the default. */
typedef struct cn_display_transform {
    const char *view; /* NULL: the config's default view. Conurb's own config has "sRGB" (the default) and "ACES", which
                       * is the ACES 1.0 SDR view */
    const char *look; /* NULL: none */
    double exposure_ev; /* stops, applied first, in linear light */
} cn_display_transform;
/* Linear ACEScg -> display-encoded [0,1], in place. display NULL: the defaults. Non-finite channels become 0.
 * CN_ERR_CONFIG for a view or look that the config does not have. */
CN_API CN_NODISCARD cn_status cn_colour_to_display(const cn_colour *colour, const cn_display_transform *display,
                                                   float *pixels, size_t n, int stride);
/* Names of the views, the default one first: NUL-terminated strings, NULL-terminated array owned by colour. */
CN_API const char *const *cn_colour_views(const cn_colour *colour);
/* Row-major linear ACEScg (AP1, D60) -> linear sRGB (Rec.709, D65), Bradford-adapted, and back. */
CN_API extern const double cn_srgb_from_acescg[9];
CN_API extern const double cn_acescg_from_srgb[9];

#ifdef __cplusplus
}
#endif
#endif
