/* HTTP and WebSocket by libwebsockets, on one thread: serves the page's files to authorised clients, and passes
 * messages between pages and their sessions. */
#ifndef CONURB_VIEW_SERVER_H
#define CONURB_VIEW_SERVER_H
#include "view/guard.h"
#include "view/session.h"

enum {
    CN_SERVER_CONNECTIONS = 128, /* open connections at most, silent ones included */
    CN_SERVER_SILENT_S = 10,     /* a connection that does not finish a request in this time is closed */
    CN_SERVER_PING_S = 20,       /* an idle page is pinged after this time, */
    CN_SERVER_HANG_UP_S = 30,    /* and closed when it does not answer, or does not read */
    CN_SERVER_UPLOAD_S = 120     /* a photo that takes longer to arrive makes way for another */
};

typedef struct cn_server cn_server;
typedef struct cn_server_options {
    const char *host;
    uint16_t port;     /* 0: any free port */
    const char *token; /* NULL: none is needed */
    cn_live *live;
    void (*on_ask)(void *user, cn_session *session, cn_ask *ask); /* takes ownership of ask's contents */
    void *user;
} cn_server_options;

/* Begins to listen. The options' texts are borrowed until destroy. CN_ERR_IO: it cannot listen on the address. */
CN_NODISCARD cn_status cn_server_create(cn_server **server, const cn_server_options *options);
void cn_server_destroy(cn_server **server);
uint16_t cn_server_port(const cn_server *server);
/* Serves until ctx asks to stop. */
void cn_server_run(cn_server *server, const cn_context *ctx);
/* Tells the server that a message waits for a page. Any thread. */
void cn_server_wake(cn_server *server);
#endif
