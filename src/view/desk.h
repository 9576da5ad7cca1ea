/* The desk answers what takes time but needs no picture of the tiles: photos, facts, files that are saved. It has two
 * threads: one answers in the order of asking and looks now and then at how far training is, one makes films. */
#ifndef CONURB_VIEW_DESK_H
#define CONURB_VIEW_DESK_H
#include "renderer/renderer.h"
#include "view/session.h"

enum { CN_DESK_MAX = 256, CN_DESK_MAX_EACH = 32 }; /* questions that wait, of all pages and of one */

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
    char *said; /* the state as it was last sent */
    /* films */
    pthread_cond_t film_changed;
    cn_question film;
    bool film_asked, film_runs;
    int film_stop; /* by cn_stop */
    double film_said_s;
    pthread_t thread, film_thread;
    bool started, film_started;
} cn_desk;

CN_NODISCARD cn_status cn_desk_open(cn_desk *desk, cn_live *live, cn_city *city, unsigned film_threads);
/* Ends a film that is in the making, and waits for both threads. Fine when the desk is zeroed. */
void cn_desk_close(cn_desk *desk);
/* Takes over what ask holds. Says no to the page where too much waits already. */
void cn_desk_ask(cn_desk *desk, cn_session *session, cn_ask *ask);

/* ---- film.c ---- */
void *cn_desk_film_work(void *desk);
void cn_desk_film_ask(cn_desk *desk, const cn_question *question);
#endif
