#include "conurb/view.h"
#include "view/desk.h"
#include "view/server.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Everything that serves one city. */
typedef struct service {
    cn_renderer *renderer;
    cn_live live;
    cn_desk desk;
    cn_server *server;
    char token[CN_TOKEN_SIZE];
} service;

static void wake(void *user)
{
    service *s = user;
    cn_server *server = __atomic_load_n(&s->server, __ATOMIC_ACQUIRE);
    if (server) cn_server_wake(server);
}

static void on_ask(void *user, cn_session *session, cn_ask *ask)
{
    service *s = user;
    cn_desk_ask(&s->desk, session, ask);
}

static void say_ready(const cn_context *ctx, const service *s, const char *host, const cn_viewer_options *o)
{
    char url[512];
    const bool six = strchr(host, ':') != NULL;
    /* A browser cannot open 0.0.0.0: print an address that works. */
    const char *name = strcmp(host, "0.0.0.0") == 0 || strcmp(host, "::") == 0 ? "localhost" : host;
    snprintf(url, sizeof url, "http://%s%s%s:%u/%s%s", six && name == host ? "[" : "", name,
             six && name == host ? "]" : "", (unsigned)cn_server_port(s->server), s->token[0] ? "?token=" : "",
             s->token);
    if (o->ready)
        o->ready(o->user, url);
    else
        cn_log(ctx, CN_LOG_INFO, "the page is at %s", url);
}

static cn_status open_service(service *s, const cn_context *ctx, cn_city *city, const char *host,
                              const cn_viewer_options *o)
{
    CN_TRY(cn_renderer_create(&s->renderer, ctx, city, true));
    cn_live_init(&s->live, s->renderer, wake, s);
    if (!cn_guard_is_loopback(host)) CN_TRY(cn_guard_make_token(s->token));
    const unsigned threads = cn_pool_threads(ctx->pool);
    CN_TRY(cn_desk_open(&s->desk, &s->live, city, threads > 1 ? threads / 2 : 1));
    cn_server *server;
    const cn_server_options options = { .host = host,
                                        .port = o->port,
                                        .token = s->token[0] ? s->token : NULL,
                                        .live = &s->live,
                                        .on_ask = on_ask,
                                        .user = s };
    CN_TRY(cn_server_create(&server, &options));
    __atomic_store_n(&s->server, server, __ATOMIC_RELEASE);
    return CN_OK;
}

/* Opens the tiles and the colour config for the view that a page shows first, so that its first picture comes soon. A
 * failure is told to the page that asks. */
static void prepare_first_view(const service *s)
{
    const cn_scene *scene = &s->renderer->dataset->scene;
    if (!scene->n_views) return;
    cn_render_request q = { .view = scene->views[0], .passes = CN_PASS_FULL, .encoding = CN_ENCODING_JPEG };
    cn_camera_resize(&scene->cameras[q.view.camera], 16, 12, &q.camera);
    const cn_status status = cn_renderer_submit(s->renderer, &q, NULL);
    (void)status;
}

static void close_service(service *s)
{
    /* Destroy first what makes messages, then the server that sends them. Sessions end when their connections close. */
    cn_desk_close(&s->desk);
    cn_renderer_destroy(&s->renderer);
    cn_server_destroy(&s->server);
    if (s->live.user) cn_live_deinit(&s->live);
    free(s);
}

cn_status cn_viewer_serve(const cn_context *ctx, cn_city *city, const cn_viewer_options *options)
{
    const char *host = options->host ? options->host : "127.0.0.1";
    service *s = calloc(1, sizeof *s);
    if (!s) return cn_fail(CN_ERR_NOMEM, "out of memory for the server");
    const cn_status status = open_service(s, ctx, city, host, options);
    if (status == CN_OK) {
        prepare_first_view(s);
        say_ready(ctx, s, host, options);
        cn_server_run(s->server, ctx);
    }
    close_service(s);
    return status;
}
