/* conurb/view.h: shows a city in the browser: a page over HTTP, pictures and state over a WebSocket.
 *
 * The city is read only, except for what viewers save: paths in CITY/views/paths/NAME.json, appearances in
 * CITY/views/lights/NAME.json, lights fitted to a photo in CITY/views/fitted/NAME.json, and films in CITY/renders/NAME.
 */
#ifndef CONURB_VIEW_H
#define CONURB_VIEW_H
#include "conurb/base.h"
#include "conurb/city.h"
#ifdef __cplusplus
extern "C" {
#endif

typedef struct cn_viewer_options {
    /* Address to listen on; NULL: 127.0.0.1. "0.0.0.0" is every IPv4 address. When other machines can reach the
     * address, the page asks for a random token. */
    const char *host;
    uint16_t port; /* 0: any free port */
    /* Called once, on the calling thread, when the page can be opened. url contains the token when there is one. NULL:
     * the URL is only logged. */
    void (*ready)(void *user, const char *url);
    void *user;
} cn_viewer_options;

/* Serves the page until ctx asks to stop, then returns CN_OK. Meanwhile the context's pool must not be used for
 * anything else. Starts threads of its own: one renders, one reads and writes files, one makes films. The city needs
 * poses; its tiles may still be in training. CN_ERR_IO: it cannot listen on the address. Other errors as in
 * cn_renderer_create. */
CN_API CN_NODISCARD cn_status cn_viewer_serve(const cn_context *ctx, cn_city *city, const cn_viewer_options *options);

typedef struct cn_viewer_page {
    const char *dir; /* the folder; it is made */
    /* The city in 3D: live.html with a viewer of its own (WebGL 2) and all that it needs, which opens from disk and
     * asks no server. */
    bool live;
    const char *splats; /* with `live`: a PLY of Gaussians (cn_splats_read), in the first light; NULL: they are made,
                           as cn_splats_make does */
    double limit_s;     /* their fit ends after so many seconds; 0: when it is done */
    const char *lights; /* "LIGHT,NAME=LIGHT,...", up to 16: each as `conurb render --appearance` takes it, and how the
                           page calls it; NULL: mean */
    double size_mb;     /* of what `live` adds, in 10^6 bytes; the number of Gaussians follows */
    const char *view, *look; /* NULL: from city.yaml */
    double exposure_ev;
} cn_viewer_page;
/* Writes a static page, for a web server or to open from disk: views, the films of CITY/renders, the plan, the
 * appearances and the scores of CITY/eval; with `live` the city in 3D, with a slider between its lights, in place of
 * the views and the appearances. index.html is written last, and all that it refers to lies in `dir`. CN_ERR_DATA: no
 * tile is trained. CN_ERR_USAGE: a light, or a size that is too small; nothing is written then. CN_ERR_FORMAT,
 * CN_ERR_IO, CN_ERR_NOMEM, CN_ERR_INTERRUPTED. */
CN_API CN_NODISCARD cn_status cn_viewer_export(const cn_context *ctx, cn_city *city, const cn_viewer_page *page);

#ifdef __cplusplus
}
#endif
#endif
