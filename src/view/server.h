/* HTTP and WebSocket, by libwebsockets, on one thread: files of the page to those who may have them, and messages
 * between pages and their sessions. */
#ifndef CONURB_VIEW_SERVER_H
#define CONURB_VIEW_SERVER_H
#include "view/guard.h"
#include "view/session.h"

enum {
    CN_SERVER_CONNECTIONS = 128, /* at once, with those that never say a word */
    CN_SERVER_SILENT_S = 10,     /* a connection that does not finish a request in this time is closed */
    CN_SERVER_PING_S = 20,       /* an idle page is asked whether it lives, */
    CN_SERVER_HANG_UP_S = 30     /* and closed when it does not answer, or does not read */
};

typedef struct cn_server cn_server;
typedef struct cn_server_options {
    const char *host;
    uint16_t port;     /* 0: one that is free */
    const char *token; /* NULL: none is asked for */
    cn_live *live;
    void (*on_ask)(void *user, cn_session *session, cn_ask *ask); /* takes over what ask holds */
    void *user;
} cn_server_options;

/* Listens. The options' texts are borrowed until destroy. CN_ERR_IO when the address cannot be had. */
CN_NODISCARD cn_status cn_server_create(cn_server **server, const cn_server_options *options);
void cn_server_destroy(cn_server **server);
uint16_t cn_server_port(const cn_server *server);
/* Serves until ctx asks to stop. */
void cn_server_run(cn_server *server, const cn_context *ctx);
/* A message waits for a page. Any thread. */
void cn_server_wake(cn_server *server);
#endif
