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

/* Writes a static page to the folder `dir`, for a web server or to open from disk: views, the films of CITY/renders,
 * the plan, the appearances and the scores of CITY/eval. index.html is written last, and all that it refers to lies in
 * `dir`. CN_ERR_DATA: no tile is trained. */
CN_API CN_NODISCARD cn_status cn_viewer_export(const cn_context *ctx, cn_city *city, const char *dir);

#ifdef __cplusplus
}
#endif
#endif
