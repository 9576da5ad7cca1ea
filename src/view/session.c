#include "view/session.h"

#include "base/clock.h"
#include "pose/scene.h"
#include "renderer/renderer.h"
#include "view/frame.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- messages ---- */

/* Under the lock. */
static void drop_messages(cn_session *s)
{
    while (s->first) {
        cn_out *out = s->first;
        s->first = out->next;
        cn_out_destroy(out);
    }
    s->n_out = 0;
    s->out_bytes = 0;
}

/* Under the lock. */
static void append(cn_session *s, cn_out *out)
{
    cn_out **at = &s->first;
    while (*at) {
        cn_out *old = *at;
        if (out->slot < 0 || old->slot != out->slot) {
            at = &old->next;
            continue;
        }
        *at = old->next;
        s->n_out--;
        s->out_bytes -= old->size;
        cn_out_destroy(old);
    }
    *at = out;
    s->n_out++;
    s->out_bytes += out->size;
    s->overrun = s->overrun || s->n_out > CN_OUT_MAX || s->out_bytes > CN_OUT_MAX_BYTES;
}

void cn_session_send(cn_session *s, uint32_t visit, cn_out *out)
{
    if (!out) return;
    pthread_mutex_lock(&s->lock);
    const bool wanted = s->taken && s->visit == visit && !s->overrun;
    if (wanted) append(s, out);
    pthread_mutex_unlock(&s->lock);
    if (!wanted) cn_out_destroy(out);
    if (wanted) s->live->wake(s->live->user);
}

void cn_session_send_json(cn_session *s, uint32_t visit, const char *type, uint32_t id, json_t *root)
{
    json_t *whole = root ? root : json_object();
    json_object_set_new(whole, "type", json_string(type));
    json_object_set_new(whole, "id", json_integer(id));
    char *text = json_dumps(whole, JSON_COMPACT | JSON_REAL_PRECISION(10));
    json_decref(whole);
    if (text) cn_session_send(s, visit, cn_out_create(text, strlen(text), false, -1));
    free(text);
}

void cn_session_send_failure(cn_session *s, uint32_t visit, uint32_t id, const char *text)
{
    cn_session_send_json(s, visit, "failed", id, json_pack("{s:s}", "text", text));
}

void cn_live_send_all(cn_live *live, const char *text, int slot)
{
    for (uint32_t i = 0; i < CN_SESSION_MAX; i++) {
        cn_session *s = &live->sessions[i];
        pthread_mutex_lock(&s->lock);
        const bool taken = s->taken;
        const uint32_t visit = s->visit;
        pthread_mutex_unlock(&s->lock);
        if (taken) cn_session_send(s, visit, cn_out_create(text, strlen(text), false, slot));
    }
}

cn_out *cn_session_next(cn_session *s)
{
    pthread_mutex_lock(&s->lock);
    cn_out *out = s->first;
    if (out) {
        s->first = out->next;
        s->n_out--;
        s->out_bytes -= out->size;
    }
    pthread_mutex_unlock(&s->lock);
    return out;
}

bool cn_session_overrun(cn_session *s)
{
    pthread_mutex_lock(&s->lock);
    const bool overrun = s->overrun;
    pthread_mutex_unlock(&s->lock);
    return overrun;
}

uint32_t cn_session_visit(cn_session *s)
{
    pthread_mutex_lock(&s->lock);
    const uint32_t visit = s->visit;
    pthread_mutex_unlock(&s->lock);
    return visit;
}

/* ---- sessions ---- */

void cn_live_init(cn_live *live, cn_renderer *renderer, void (*wake)(void *user), void *user)
{
    *live = (cn_live){ .renderer = renderer, .wake = wake, .user = user };
    for (uint32_t i = 0; i < CN_SESSION_MAX; i++) {
        cn_session *s = &live->sessions[i];
        s->live = live;
        s->index = i;
        pthread_mutex_init(&s->lock, NULL);
        for (int slot = 0; slot < CN_ASK_SLOTS; slot++)
            s->drawings[slot].session = s;
    }
}

/* Under the lock. */
static void end_drawing(cn_drawing *d)
{
    if (d->job) cn_renderer_cancel(d->job);
    cn_renderer_release(&d->job);
    cn_ask_deinit(&d->ask);
}

void cn_live_deinit(cn_live *live)
{
    for (uint32_t i = 0; i < CN_SESSION_MAX; i++) {
        cn_session *s = &live->sessions[i];
        for (int slot = 0; slot < CN_ASK_SLOTS; slot++)
            end_drawing(&s->drawings[slot]);
        drop_messages(s);
        pthread_mutex_destroy(&s->lock);
    }
}

cn_session *cn_session_take(cn_live *live)
{
    for (uint32_t i = 0; i < CN_SESSION_MAX; i++) {
        cn_session *s = &live->sessions[i];
        pthread_mutex_lock(&s->lock);
        const bool free_one = !s->taken;
        if (free_one) {
            s->taken = true;
            s->overrun = false;
            s->visit++;
        }
        pthread_mutex_unlock(&s->lock);
        if (free_one) return s;
    }
    return NULL;
}

void cn_session_leave(cn_session *s)
{
    pthread_mutex_lock(&s->lock);
    for (int slot = 0; slot < CN_ASK_SLOTS; slot++)
        end_drawing(&s->drawings[slot]);
    drop_messages(s);
    s->taken = false;
    pthread_mutex_unlock(&s->lock);
}

uint32_t cn_live_count(cn_live *live)
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < CN_SESSION_MAX; i++) {
        pthread_mutex_lock(&live->sessions[i].lock);
        n += live->sessions[i].taken;
        pthread_mutex_unlock(&live->sessions[i].lock);
    }
    return n;
}

/* ---- pictures ---- */

/* On the renderer's thread. */
static void deliver(void *user, cn_render_job *job, cn_status status, const cn_render_result *result)
{
    cn_drawing *d = user;
    cn_session *s = d->session;
    pthread_mutex_lock(&s->lock);
    const bool wanted = s->taken && d->job == job;
    const cn_ask ask = d->ask;
    const uint32_t visit = s->visit;
    const double since_s = cn_now_s() - d->begin_s;
    pthread_mutex_unlock(&s->lock);
    if (!wanted || status == CN_ERR_INTERRUPTED) return;
    cn_out *out = NULL;
    if (status == CN_OK) status = cn_frame_make(&ask, result, since_s, &out);
    if (status == CN_OK)
        cn_session_send(s, visit, out);
    else
        cn_session_send_failure(s, visit, ask.id, cn_error_message());
}

/* The renderer's channel that is shown; 0: the picture itself has it. */
static unsigned aov_of(cn_channel channel)
{
    switch (channel) {
    case CN_CHANNEL_NORMAL: return CN_AOV_NORMAL;
    case CN_CHANNEL_OCCLUSION: return CN_AOV_AMBIENT_OCCLUSION;
    case CN_CHANNEL_COVERAGE: return CN_AOV_COVERAGE;
    case CN_CHANNEL_COLOUR:
    case CN_CHANNEL_DEPTH:
    case CN_CHANNEL_OPACITY:
    case CN_CHANNEL_TILES: break;
    }
    return 0;
}

static void fill_request(cn_drawing *d, cn_render_request *q)
{
    const cn_ask *ask = &d->ask;
    /* While the camera moves, render one tile only, unless the page asks for a blend: it takes a third of the time. */
    const char *quick = ask->moving && ask->slot == 0 && ask->channel == CN_CHANNEL_COLOUR ? "nearest" : NULL;
    const bool probe = ask->slot == CN_ASK_SLOT_PROBE, picture = !probe && ask->channel == CN_CHANNEL_COLOUR;
    *q = (cn_render_request){
        .camera = ask->camera,
        .view = ask->view,
        .appearance = ask->appearance[0] ? ask->appearance : NULL,
        .blend = ask->blend[0] ? ask->blend : quick,
        .tile = ask->name[0] ? ask->name : NULL,
        .display_view = ask->display_view[0] ? ask->display_view : NULL,
        .look = ask->look[0] ? ask->look : NULL,
        .exposure_ev = ask->exposure_ev,
        .crop_m = ask->cropped ? ask->crop_m : NULL,
        .draft = ask->moving,
        .owners = ask->channel == CN_CHANNEL_TILES,
        .aovs = probe ? 0 : aov_of(ask->channel),
        .passes = ask->moving || probe ? CN_PASS_FULL : CN_PASS_ALL,
        .encoding = picture ? CN_ENCODING_JPEG : CN_ENCODING_NONE,
        .quality = ask->moving ? CN_FRAME_QUALITY_MOVING : CN_FRAME_QUALITY,
        /* Fast pictures come before slow ones, for all pages. */
        .priority = probe || ask->moving ? 1 : 0,
        .stream = 1 + (uint64_t)d->session->index * CN_ASK_SLOTS + ask->slot,
        .deliver = deliver,
        .user = d,
    };
}

/* With its own lens, a picture lies over its photo. */
static cn_status take_camera_of_photo(const cn_scene *scene, cn_ask *ask)
{
    const int64_t i = cn_scene_find_view(scene, ask->photo);
    if (i < 0) return cn_fail(CN_ERR_USAGE, "no photo named '%s' has a pose", ask->photo);
    ask->view = scene->views[i];
    ask->view.name = NULL;
    cn_camera_resize(&scene->cameras[ask->view.camera], ask->camera.width, ask->camera.height, &ask->camera);
    return CN_OK;
}

void cn_session_draw(cn_session *s, cn_ask *ask)
{
    cn_render_request q;
    const uint32_t id = ask->id;
    if (ask->photo[0] && take_camera_of_photo(&s->live->renderer->dataset->scene, ask) != CN_OK) {
        cn_session_send_failure(s, cn_session_visit(s), id, cn_error_message());
        return;
    }
    pthread_mutex_lock(&s->lock);
    cn_drawing *d = &s->drawings[ask->slot];
    end_drawing(d);
    d->ask = *ask;
    *ask = (cn_ask){ 0 };
    d->begin_s = cn_now_s();
    fill_request(d, &q);
    /* With the lock held, so that the job is recorded before its first pass arrives. */
    const cn_status status = cn_renderer_submit(s->live->renderer, &q, &d->job);
    const uint32_t visit = s->visit;
    pthread_mutex_unlock(&s->lock);
    if (status != CN_OK) cn_session_send_failure(s, visit, id, cn_error_message());
}

void cn_session_cancel(cn_session *s, uint32_t slot)
{
    pthread_mutex_lock(&s->lock);
    end_drawing(&s->drawings[slot]);
    pthread_mutex_unlock(&s->lock);
}
