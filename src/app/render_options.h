/* Options that render, relight and steady share. An entry refers to members of the command's own struct, which must be
 * called `options` and have a member `cn_city_render_options render`. */
#ifndef CONURB_APP_RENDER_OPTIONS_H
#define CONURB_APP_RENDER_OPTIONS_H
#include "app.h"

#define CN_OPTION_PATH                                                                                                 \
    {                                                                                                                  \
        "path", "FILE",                                                                                                \
            "camera path: JSON keyframes, a GeoJSON LineString, KML with a gx:Track, or a camera as .chan or .glb "    \
            "(jobs/README.md describes them). photos: along the photos, in the order of their names",                  \
            CN_APP_TEXT, offsetof(options, render.path), NULL                                                          \
    }
#define CN_OPTION_ORBIT                                                                                                \
    {                                                                                                                  \
        "orbit", "PLACE",                                                                                              \
            "circle round a place: LAT,LON,RADIUS_M,HEIGHT_M, or X,Y,RADIUS,HEIGHT in a city without GPS. The "        \
            "height is above the ground at the place",                                                                 \
            CN_APP_TEXT, offsetof(options, render.orbit), NULL                                                         \
    }
#define CN_OPTION_HEIGHT                                                                                               \
    {                                                                                                                  \
        "height", "M", "height above the ground, for LineStrings and for tracks on the ground", CN_APP_NUMBER,         \
            offsetof(options, render.height_m), NULL                                                                   \
    }
#define CN_OPTION_CAMERA                                                                                               \
    {                                                                                                                  \
        "camera", "NAME",                                                                                              \
            "equirectangular: pictures of all directions, twice as wide as high, with a level horizon; pinhole: as "   \
            "usual",                                                                                                   \
            CN_APP_CHOICE, offsetof(options, render.camera), "pinhole equirectangular"                                 \
    }
#define CN_OPTION_APPEARANCE                                                                                           \
    {                                                                                                                  \
        "appearance", "LIGHT",                                                                                         \
            "light to show: PHOTO, mean, A:B:0.3 (a mix of A and B; :C:0.2 mixes in C), FILE.json, fit:PHOTO, or an "  \
            "imported name. "                                                                                          \
            "fit:PHOTO takes any photo of the place; COLMAP finds its pose",                                           \
            CN_APP_TEXT, offsetof(options, render.appearance), NULL                                                    \
    }
#define CN_OPTION_VIEW                                                                                                 \
    {                                                                                                                  \
        "view", "NAME", "how linear colours are encoded for the screen: sRGB, ACES, Raw, or a view of $OCIO",          \
            CN_APP_TEXT, offsetof(options, render.view), "sRGB ACES"                                                   \
    }
#define CN_OPTION_LOOK                                                                                                 \
    {                                                                                                                  \
        "look", "NAME", "a look of the colour config, applied before the view", CN_APP_TEXT,                           \
            offsetof(options, render.look), NULL                                                                       \
    }
#define CN_OPTION_EXPOSURE                                                                                             \
    {                                                                                                                  \
        "exposure", "STOPS", "make the picture brighter (or darker, below 0) by so many stops", CN_APP_NUMBER,         \
            offsetof(options, render.exposure_ev), NULL                                                                \
    }
#define CN_OPTION_WIDTH                                                                                                \
    {                                                                                                                  \
        "width", "PX", "width of the pictures; by default as in city.yaml", CN_APP_NUMBER, offsetof(options, width),   \
            NULL                                                                                                       \
    }
#define CN_OPTION_BLEND                                                                                                \
    {                                                                                                                  \
        "blend", "NAME", "how tiles are blended; by default as in city.yaml", CN_APP_CHOICE,                           \
            offsetof(options, render.blend), CN_APP_BLENDS                                                             \
    }
#define CN_OPTION_OUT                                                                                                  \
    {                                                                                                                  \
        "out", "DIR", "folder for the pictures; by default one in CITY/renders", CN_APP_TEXT,                          \
            offsetof(options, render.out), NULL                                                                        \
    }
#endif
