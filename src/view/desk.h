/* The desk answers slow requests that need no render: photos, facts about the city, saved files. It has two threads.
 * One answers requests in order and checks the progress of training from time to time; the other makes films. */
#ifndef CONURB_VIEW_DESK_H
#define CONURB_VIEW_DESK_H
#include "renderer/renderer.h"
#include "view/session.h"

enum { CN_DESK_MAX = 256, CN_DESK_MAX_EACH = 32 }; /* waiting requests at most, of all pages and of one page */

typedef struct cn_question {
    cn_session *session;
    uint32_t visit;
    cn_ask ask;
} cn_question;

typedef struct cn_desk {
    cn_live *live;
    cn_city *city;
    const cn_dataset *dataset;
    const cn_colour *colour;
    unsigned film_threads;
    int stop; /* by cn_stop */
    pthread_mutex_t lock;
    pthread_cond_t changed;
    cn_question waiting[CN_DESK_MAX]; /* a ring */
    uint32_t first, n;
    char *said; /* the state that was sent last */
    /* films */
    pthread_cond_t film_changed;
    cn_question film; /* a film, or a light to be fitted: one of them at a time */
    bool film_asked, film_runs;
    int film_stop; /* by cn_stop */
    double film_said_s;
    char *reported; /* the last report of a film or a fit, or NULL */
    pthread_t thread, film_thread;
    bool started, film_started;
} cn_desk;

CN_NODISCARD cn_status cn_desk_open(cn_desk *desk, cn_live *live, cn_city *city, unsigned film_threads);
/* Stops a film in progress and waits for both threads. Safe on a zeroed desk. */
void cn_desk_close(cn_desk *desk);
/* Takes ownership of ask's contents. Refuses when too many requests wait. */
void cn_desk_ask(cn_desk *desk, cn_session *session, cn_ask *ask);

/* ---- film.c ---- */
void *cn_desk_film_work(void *desk);
/* Takes ownership of the question's contents when it begins. */
void cn_desk_film_ask(cn_desk *desk, cn_question *question);
CN_NODISCARD cn_status cn_desk_film_show(const cn_desk *desk, const cn_question *question);

/* ---- fit.c ---- */
/* Fits a light to the photo of desk->film, and keeps it under its name. */
CN_NODISCARD cn_status cn_desk_fit(const cn_desk *desk, const cn_context *ctx);
#endif
