/* What takes long, one at a time: films of saved paths, made as `conurb render` makes them, and lights that are fitted
 * to a photo. */
#include "view/desk.h"

#include "base/clock.h"
#include "base/file.h"
#include "conurb/stage.h"
#include "view/frame.h"
#include "view/saved.h"

#include <stdlib.h>
#include <string.h>

enum { CN_FILM_SHOWN = 48 << 20 }; /* bytes of a film that a page can play, at most */

/* The caller frees it; NULL when out of memory. Takes ownership of more, which may be NULL. */
static char *report(const cn_ask *ask, const char *state, json_t *more)
{
    json_t *root = more ? more : json_object();
    json_object_set_new(root, "type", json_string(ask->kind == CN_ASK_FIT ? "fit" : "film"));
    json_object_set_new(root, "state", json_string(state));
    json_object_set_new(root, "name", json_string(ask->name));
    char *text = json_dumps(root, JSON_COMPACT);
    json_decref(root);
    return text;
}

/* Under the lock, so that a page that asks for the city meanwhile gets the newest report last. Takes ownership of text.
 */
static void say(cn_desk *k, char *text, int slot)
{
    if (text) cn_live_send_all(k->live, text, slot);
    free(k->reported);
    k->reported = text;
}

static void say_running(cn_desk *k, json_t *more)
{
    char *text = report(&k->film.ask, "running", more);
    pthread_mutex_lock(&k->lock);
    say(k, text, CN_SLOT_PROGRESS);
    pthread_mutex_unlock(&k->lock);
}

static void on_progress(void *user, const cn_progress_report *r)
{
    enum { PER_S = 4 };
    cn_desk *k = user;
    const double now_s = cn_now_s();
    if (now_s - k->film_said_s < 1.0 / PER_S) return;
    k->film_said_s = now_s;
    say_running(k, json_pack("{s:s, s:f, s:f, s:f}", "stage", r->stage, "done", r->done, "total", r->total, "left_s",
                             r->left_s));
}

static cn_status make(cn_desk *k, const cn_context *ctx, const cn_ask *ask, char **out)
{
    char *path = cn_saved_path(k->city, false, ask->name), *relative = cn_format("renders/%s", ask->name);
    *out = relative ? cn_city_path(k->city, relative) : NULL;
    const cn_city_render_options options = { .path = path,
                                             .out = *out,
                                             .appearance = ask->appearance[0] ? ask->appearance : NULL,
                                             .view = ask->display_view[0] ? ask->display_view : NULL,
                                             .look = ask->look[0] ? ask->look : NULL,
                                             .exposure_ev = ask->exposure_ev,
                                             .blend = ask->blend[0] ? ask->blend : NULL,
                                             .crop_m = ask->cropped ? ask->crop_m : NULL,
                                             .width_px = ask->width };
    cn_status status = path && *out ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    cn_city *city = NULL;
    /* The film opens the city a second time, because a render takes locks and needs the present state. */
    if (status == CN_OK) status = cn_city_open(&city, k->city->folder);
    if (status == CN_OK) status = cn_city_render(ctx, city, &options);
    cn_city_close(&city);
    free(path);
    free(relative);
    return status;
}

/* A path of a single view gives a picture and no film. */
static char *report_done(const cn_ask *ask, const char *folder)
{
    char *film = folder ? cn_format("%s/flight.mp4", folder) : NULL;
    const bool there = film && cn_file_exists(film);
    free(film);
    return report(ask, "done", json_pack("{s:s, s:b}", "folder", folder ? folder : "", "film", (int)there));
}

/* Returns the report of how it ended. */
static char *make_film(cn_desk *k)
{
    cn_context ctx = {
        .progress = on_progress, .user = k, .stop = &k->film_stop, .device = k->live->renderer->ctx.device
    };
    const cn_ask *ask = &k->film.ask;
    char *out = NULL;
    say_running(k, NULL);
    cn_status status = cn_pool_create(&ctx.pool, k->film_threads);
    if (status == CN_OK) status = ask->kind == CN_ASK_FIT ? cn_desk_fit(k, &ctx) : make(k, &ctx, ask, &out);
    cn_pool_destroy(&ctx.pool);
    char *end = status == CN_OK ? report_done(ask, out)
                                : report(ask, status == CN_ERR_INTERRUPTED ? "stopped" : "failed",
                                         json_pack("{s:s}", "text", cn_error_message()));
    free(out);
    return end;
}

/* The whole file goes in one message; a page that asks for a film that is too long is told where it is. */
cn_status cn_desk_film_show(const cn_desk *k, const cn_question *q)
{
    char *relative = q->ask.frame ? cn_format("renders/%s/%05u.png", q->ask.name, (unsigned)q->ask.frame - 1)
                                  : cn_format("renders/%s/flight.mp4", q->ask.name);
    char *bytes = NULL;
    char *path = relative ? cn_city_path(k->city, relative) : NULL;
    size_t size = 0;
    cn_out *out = NULL;
    cn_status status = path ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK && !q->ask.frame && !cn_file_exists(path))
        status = cn_fail(CN_ERR_USAGE, "the path '%s' has no film yet; press 'Render this path' first", q->ask.name);
    if (status == CN_OK) status = cn_file_read(path, CN_FILM_SHOWN, &bytes, &size);
    json_t *head = json_pack("{s:s, s:I, s:s}", "type", "film_file", "id", (json_int_t)q->ask.id, "name", q->ask.name);
    const cn_frame_data data = { NULL, 0, bytes, size };
    if (status == CN_OK) status = head ? cn_frame_join(head, &data, -1, &out) : CN_ERR_NOMEM;
    json_decref(head);
    free(bytes);
    free(path);
    free(relative);
    if (status == CN_OK) cn_session_send(q->session, q->visit, out);
    return status;
}

void *cn_desk_film_work(void *user)
{
    cn_desk *k = user;
    pthread_mutex_lock(&k->lock);
    while (!cn_stopping(&(cn_context){ .stop = &k->stop })) {
        if (!k->film_asked) {
            pthread_cond_wait(&k->film_changed, &k->lock);
            continue;
        }
        k->film_asked = false;
        k->film_runs = true;
        pthread_mutex_unlock(&k->lock);
        char *end = make_film(k);
        pthread_mutex_lock(&k->lock);
        cn_ask_deinit(&k->film.ask);
        k->film_runs = false; /* whoever reads of the end can ask for the next one */
        say(k, end, -1);
    }
    pthread_mutex_unlock(&k->lock);
    return NULL;
}

void cn_desk_film_ask(cn_desk *k, cn_question *q)
{
    pthread_mutex_lock(&k->lock);
    const bool busy = k->film_asked || k->film_runs, stop = q->ask.kind == CN_ASK_FILM_STOP;
    if (stop && busy) cn_stop(&k->film_stop);
    if (!stop && !busy) {
        k->film = *q;
        q->ask.bytes = NULL;
        k->film_stop = 0;
        k->film_asked = true;
        pthread_cond_signal(&k->film_changed);
    }
    pthread_mutex_unlock(&k->lock);
    if (!stop && busy)
        cn_session_send_failure(q->session, q->visit, q->ask.id,
                                "a film or a fit is in the making already; wait for it, or stop it");
}
