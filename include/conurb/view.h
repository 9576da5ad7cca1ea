/* conurb/view.h: a city in the browser: one page over HTTP, pictures and facts over a WebSocket.
 *
 * The city is only read, but for what viewers save: CITY/views/paths/NAME.json and CITY/views/lights/NAME.json, and
 * films that they ask for, in CITY/renders/NAME. */
#ifndef CONURB_VIEW_H
#define CONURB_VIEW_H
#include "conurb/base.h"
#include "conurb/city.h"
#ifdef __cplusplus
extern "C" {
#endif

typedef struct cn_viewer_options {
    /* Address to listen on; NULL: 127.0.0.1. At any address that is not of this machine alone, a token made at random
     * is asked for. "0.0.0.0" is every IPv4 address. */
    const char *host;
    uint16_t port; /* 0: one that is free */
    /* Called once, on the calling thread, when the page can be opened; url holds the token where there is one. NULL:
     * nobody is told but the log. */
    void (*ready)(void *user, const char *url);
    void *user;
} cn_viewer_options;

/* Serves the page until ctx asks to stop, then returns CN_OK. Takes the context's pool for itself meanwhile, and starts
 * threads of its own: one draws, one reads and writes files, one makes films. A city whose poses are there is served
 * while its tiles are trained. CN_ERR_IO when the address cannot be listened on; else as cn_renderer_create. */
CN_API CN_NODISCARD cn_status cn_viewer_serve(const cn_context *ctx, cn_city *city, const cn_viewer_options *options);

/* A page of files, for a web server or to open from disk: views, the films of CITY/renders, the plan, the lights, the
 * scores of CITY/eval. index.html comes last, and what it names lies beside it. CN_ERR_DATA when no tile is trained. */
CN_API CN_NODISCARD cn_status cn_viewer_export(const cn_context *ctx, cn_city *city, const char *dir);

#ifdef __cplusplus
}
#endif
#endif
