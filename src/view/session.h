/* Sessions: one per connected page. A session holds the page's pictures in progress and the messages that wait for it.
 */
#ifndef CONURB_VIEW_SESSION_H
#define CONURB_VIEW_SESSION_H
#include "conurb/renderer.h"
#include "view/out.h"
#include "view/request.h"

#include <pthread.h>

enum {
    CN_SESSION_MAX = 64,        /* connected pages at most */
    CN_OUT_MAX = 64,            /* messages that may wait for a page at most, */
    CN_OUT_MAX_BYTES = 64 << 20 /* and their bytes; a page that exceeds either is disconnected */
};
/* Slots of messages to every page, beside those of pictures. Only the newest of them counts: they do not pile up for a
 * page that reads slowly. */
enum { CN_SLOT_STATE = CN_ASK_SLOTS, CN_SLOT_PROGRESS };

typedef struct cn_session cn_session;
/* A picture in progress. */
typedef struct cn_drawing {
    cn_session *session;
    cn_render_job *job;
    cn_ask ask;
    double begin_s;
} cn_drawing;

/* A session exists as long as the server. Pages use it one after another. */
struct cn_session {
    struct cn_live *live;
    uint32_t index;
    pthread_mutex_t lock; /* protects all members below */
    bool taken, overrun;
    uint32_t visit; /* counts the pages that used it; work for an earlier page is dropped */
    cn_drawing drawings[CN_ASK_SLOTS];
    cn_out *first;
    uint32_t n_out;
    size_t out_bytes;
};

/* The data that sessions share. */
typedef struct cn_live {
    cn_renderer *renderer;
    void (*wake)(void *user); /* a message waits; any thread */
    void *user;
    cn_session sessions[CN_SESSION_MAX];
} cn_live;
void cn_live_init(cn_live *live, cn_renderer *renderer, void (*wake)(void *user), void *user);
/* After the renderer was destroyed. */
void cn_live_deinit(cn_live *live);

/* A free session, or NULL. */
cn_session *cn_session_take(cn_live *live);
/* Ends a page's use: cancels its pictures and drops its messages. */
void cn_session_leave(cn_session *session);
/* Queues a message and takes ownership of it. It is dropped when the page of that visit has gone. */
void cn_session_send(cn_session *session, uint32_t visit, cn_out *out);
/* The same for a JSON object, to which type and id are added. Takes ownership of root, which may be NULL. */
void cn_session_send_json(cn_session *session, uint32_t visit, const char *type, uint32_t id, json_t *root);
/* {"type": "failed", "text": ...} */
void cn_session_send_failure(cn_session *session, uint32_t visit, uint32_t id, const char *text);
/* To every page. slot: as in cn_out. */
void cn_live_send_all(cn_live *live, const char *text, int slot);
uint32_t cn_live_count(cn_live *live);
/* The next message, which the caller destroys; NULL when none waits. */
cn_out *cn_session_next(cn_session *session);
/* Whether too many messages wait, so that the page must be disconnected. */
bool cn_session_overrun(cn_session *session);
uint32_t cn_session_visit(cn_session *session);

/* Begins a picture and cancels the one in progress in its slot. Takes ownership of ask's contents. */
void cn_session_draw(cn_session *session, cn_ask *ask);
void cn_session_cancel(cn_session *session, uint32_t slot);
#endif
