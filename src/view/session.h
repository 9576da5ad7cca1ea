/* Sessions: one a page that is connected. What is drawn for it, and the messages that wait to be sent to it. */
#ifndef CONURB_VIEW_SESSION_H
#define CONURB_VIEW_SESSION_H
#include "conurb/renderer.h"
#include "view/out.h"
#include "view/request.h"

#include <pthread.h>

enum {
    CN_SESSION_MAX = 64,        /* pages at once */
    CN_OUT_MAX = 64,            /* messages that may wait for a page, */
    CN_OUT_MAX_BYTES = 64 << 20 /* and their size; a page that lets more pile up is cut off */
};

typedef struct cn_session cn_session;
/* A picture in the making. */
typedef struct cn_drawing {
    cn_session *session;
    cn_render_job *job;
    cn_ask ask;
    double begin_s;
} cn_drawing;

/* A session lives as long as the server; pages take it one after another. */
struct cn_session {
    struct cn_live *live;
    uint32_t index;
    pthread_mutex_t lock; /* of all below */
    bool taken, overrun;
    uint32_t visit; /* how many pages took it: work for an earlier one is dropped by that */
    cn_drawing drawings[CN_ASK_SLOTS];
    cn_out *first;
    uint32_t n_out;
    size_t out_bytes;
};

/* What sessions share. */
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
/* The page is gone: its pictures are cancelled, its messages dropped. */
void cn_session_leave(cn_session *session);
/* Hands a message over, which belongs to the session then; dropped when the page of that visit is gone. */
void cn_session_send(cn_session *session, uint32_t visit, cn_out *out);
/* The same of a JSON object, to which type and id are added. Takes root over; NULL is fine. */
void cn_session_send_json(cn_session *session, uint32_t visit, const char *type, uint32_t id, json_t *root);
/* {"type": "failed", "text": ...} */
void cn_session_send_failure(cn_session *session, uint32_t visit, uint32_t id, const char *text);
/* To every page. */
void cn_live_send_all(cn_live *live, const char *text);
uint32_t cn_live_count(cn_live *live);
/* The next message, which the caller destroys; NULL when none waits. *more: whether another does. */
cn_out *cn_session_next(cn_session *session, bool *more);
/* Whether so much has piled up that the page has to be cut off. */
bool cn_session_overrun(cn_session *session);
uint32_t cn_session_visit(cn_session *session);

/* Begins a picture; what was in the making in its slot ends. Takes over what ask holds. */
void cn_session_draw(cn_session *session, cn_ask *ask);
void cn_session_cancel(cn_session *session, uint32_t slot);
#endif
