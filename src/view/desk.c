#include "view/desk.h"

#include "base/file.h"
#include "bridge/oiio.h"
#include "base/units.h"
#include "image/image.h"
#include "pose/lens.h"
#include "pose/scene.h"
#include "view/facts.h"
#include "view/frame.h"
#include "view/saved.h"

#include <math.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { STATE_EVERY_S = 2 };

/* ---- photos ---- */

/* As the renderer encodes its pictures, so that the two can be compared. */
static cn_display_transform display_of(const cn_desk *k, const cn_ask *ask)
{
    const cn_config *c = &k->city->config;
    return (cn_display_transform){ .view = ask->display_view[0] ? ask->display_view : c->view,
                                   .look = ask->look[0] ? ask->look : c->look,
                                   .exposure_ev = c->exposure_ev + ask->exposure_ev };
}

/* Converts linear RGBW to RGB for the display, in place. */
static cn_status encode_photo(const cn_desk *k, const cn_ask *ask, float *pixels, cn_pixel_extent extent,
                              uint8_t **jpeg, size_t *size)
{
    const uint32_t width = extent.width, height = extent.height;
    const size_t n = (size_t)width * height;
    const cn_display_transform display = display_of(k, ask);
    CN_TRY(cn_colour_to_display(k->colour, &display, pixels, n, 4));
    for (size_t i = 0; i < n; i++)
        memmove(pixels + 3 * i, pixels + 4 * i, 3 * sizeof *pixels);
    return cn_oiio_encode((cn_oiio_encoding){ .jpeg = true, .quality = CN_FRAME_QUALITY }, pixels, width, height, jpeg,
                          size);
}

static cn_status shrink_and_encode(const cn_desk *k, const cn_ask *ask, float *pixels, cn_pixel_extent full,
                                   uint8_t **jpeg, size_t *size)
{
    const uint32_t width = ask->width;
    if (!width || width >= full.width) return encode_photo(k, ask, pixels, full, jpeg, size);
    uint32_t height = (uint32_t)(((uint64_t)full.height * width + full.width / 2) / full.width);
    if (height < 1) height = 1;
    float *small = malloc((size_t)width * height * 4 * sizeof *small);
    if (!small) return cn_fail(CN_ERR_NOMEM, "out of memory for a photo of %u x %u pixels", width, height);
    cn_image_shrink(pixels, full.width, full.height, small, width, height);
    const cn_status status = encode_photo(k, ask, small, (cn_pixel_extent){ width, height }, jpeg, size);
    free(small);
    return status;
}

/* The photo as a pinhole in the middle of it would have taken it, which is how the page draws; black where its lens saw
 * nothing. *pixels is replaced. */
static cn_status straighten(const cn_scene *scene, const char *name, float **pixels, cn_pixel_extent size)
{
    const int64_t view = cn_scene_find_view(scene, name);
    const size_t n = (size_t)size.width * size.height;
    if (view < 0 || size.width < 2 || size.height < 2) return CN_OK;
    cn_camera lens;
    cn_camera_resize(&scene->cameras[scene->views[view].camera], size.width, size.height, &lens);
    const double focal_px = size.height / (2 * tan(cn_radians(cn_camera_vfov_deg(&lens)) / 2));
    float *straight = malloc(4 * n * sizeof *straight);
    if (!straight) return cn_fail(CN_ERR_NOMEM, "out of memory for the photo %s", name);
    for (size_t i = 0; i < n; i++) {
        const double x = (double)(i % size.width) + 0.5, y = (double)(i / size.width) + 0.5;
        const double dir[3] = { (x - size.width / 2.0) / focal_px, (y - size.height / 2.0) / focal_px, 1 };
        cn_camera_look_up(&lens, *pixels, dir, straight + 4 * i);
    }
    free(*pixels);
    *pixels = straight;
    return CN_OK;
}

static cn_status make_photo(const cn_desk *k, const cn_ask *ask, uint8_t **jpeg, size_t *size)
{
    const cn_dataset *d = k->dataset;
    const int64_t photo = cn_photo_index_find(&d->photos, ask->name);
    *jpeg = NULL;
    if (photo < 0) return cn_fail(CN_ERR_USAGE, "no photo is named '%s'", ask->name);
    CN_TRY(cn_dataset_need_pixels(d));
    const cn_pixel_extent full = cn_pixel_store_extent(d->pixels, (uint32_t)photo);
    float *pixels = malloc((size_t)full.width * full.height * 4 * sizeof *pixels);
    if (!pixels) return cn_fail(CN_ERR_NOMEM, "out of memory for the photo %s", ask->name);
    cn_status status = cn_pixel_store_read(d->pixels, (uint32_t)photo, pixels);
    if (status == CN_OK && ask->straight) status = straighten(&d->scene, ask->name, &pixels, full);
    if (status == CN_OK) status = shrink_and_encode(k, ask, pixels, full, jpeg, size);
    free(pixels);
    return status;
}

/* Answers a question with a picture: a frame without a slot. */
static cn_status answer_photo(const cn_desk *k, const cn_question *q)
{
    uint8_t *jpeg;
    size_t size;
    cn_out *out = NULL;
    CN_TRY(make_photo(k, &q->ask, &jpeg, &size));
    json_t *head = json_pack("{s:s, s:I, s:s}", "type", "photo", "id", (json_int_t)q->ask.id, "name", q->ask.name);
    const cn_status status =
        head ? cn_frame_join(head, &(cn_frame_data){ jpeg, size, NULL, 0 }, -1, &out) : CN_ERR_NOMEM;
    json_decref(head);
    free(jpeg);
    if (status == CN_OK) cn_session_send(q->session, q->visit, out);
    return status;
}

/* ---- transients: what training took as present in one photo only ---- */

#define GREY 0.18f /* behind them, as in `conurb appearance transient`: dark ones are visible too */

static cn_status make_transient(const cn_desk *k, const cn_ask *ask, const char *tile, cn_picture *p)
{
    cn_tile *open = NULL;
    char *path = cn_format("%s/tiles/%s/tile.safetensors", k->city->folder, tile);
    const cn_context ctx = { .stop = &k->stop }; /* the pool is the renderer's */
    cn_status status = path ? cn_tile_open(&open, path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_render_transient(&ctx, open, ask->name, p);
    for (size_t i = 0; i < (size_t)p->width * p->height && status == CN_OK; i++)
        for (size_t c = 0; c < 3; c++)
            p->rgba[4 * i + c] += GREY * (1 - p->rgba[4 * i + 3]);
    cn_tile_close(&open);
    free(path);
    return status;
}

static const char *tile_of_photo(const cn_dataset *d, const char *photo)
{
    for (uint32_t t = 0; t < d->plan.n_tiles; t++)
        for (uint32_t i = 0; i < d->plan.tiles[t].n_photos; i++)
            if (strcmp(d->scene.views[d->plan.tiles[t].photos[i]].name, photo) == 0) return d->plan.tiles[t].id;
    return NULL;
}

static cn_status answer_transient(const cn_desk *k, const cn_question *q)
{
    const char *tile = tile_of_photo(k->dataset, q->ask.name);
    const int64_t photo = cn_photo_index_find(&k->dataset->photos, q->ask.name);
    if (!tile || photo < 0) return cn_fail(CN_ERR_USAGE, "no tile was trained on a photo named '%s'", q->ask.name);
    const cn_photo *from = &k->dataset->photos.photos[photo];
    const uint32_t width = q->ask.width && q->ask.width < 512 ? q->ask.width : 512;
    const uint32_t height = (uint32_t)((uint64_t)from->height * width / from->width);
    uint8_t *jpeg = NULL;
    size_t size;
    cn_picture p;
    cn_out *out = NULL;
    CN_TRY(cn_picture_init(&p, width, height ? height : 1));
    cn_status status = make_transient(k, &q->ask, tile, &p);
    if (status == CN_OK)
        status = encode_photo(k, &q->ask, p.rgba, (cn_pixel_extent){ p.width, p.height }, &jpeg, &size);
    cn_picture_deinit(&p);
    json_t *head = json_pack("{s:s, s:I, s:s}", "type", "transient", "id", (json_int_t)q->ask.id, "name", q->ask.name);
    if (status == CN_OK)
        status = head ? cn_frame_join(head, &(cn_frame_data){ jpeg, size, NULL, 0 }, -1, &out) : CN_ERR_NOMEM;
    json_decref(head);
    free(jpeg);
    if (status == CN_OK) cn_session_send(q->session, q->visit, out);
    return status;
}

/* ---- the other answers ---- */

static cn_status answer_points(const cn_desk *k, const cn_question *q)
{
    uint8_t *points;
    size_t size;
    uint32_t n;
    cn_out *out = NULL;
    CN_TRY(cn_facts_points(k->dataset, &points, &size, &n));
    json_t *head = json_pack("{s:s, s:I, s:I}", "type", "points", "id", (json_int_t)q->ask.id, "n", (json_int_t)n);
    const cn_frame_data data = { NULL, 0, points, size };
    const cn_status status = head ? cn_frame_join(head, &data, -1, &out) : CN_ERR_NOMEM;
    json_decref(head);
    free(points);
    if (status == CN_OK) cn_session_send(q->session, q->visit, out);
    return status;
}

static cn_status answer_saved(const cn_desk *k, const cn_question *q)
{
    const cn_ask *ask = &q->ask;
    const char *type = ask->kind == CN_ASK_SAVE ? "saved" : ask->kind == CN_ASK_LIST ? "list" : "loaded";
    json_t *answer = NULL;
    if (ask->kind == CN_ASK_SAVE && ask->fresh) CN_TRY(cn_saved_check_fresh(k->city, ask->is_appearance, ask->name));
    if (ask->kind == CN_ASK_SAVE)
        CN_TRY(cn_saved_write(k->city, &k->dataset->frame, ask->is_appearance, ask->name, ask->data));
    if (ask->kind == CN_ASK_LOAD) {
        json_t *data;
        CN_TRY(cn_saved_load(k->city, ask->is_appearance, ask->name, &data));
        answer = json_pack("{s:s, s:o}", "name", ask->name, "data", data);
    } else {
        answer = json_pack("{s:s, s:o}", "name", ask->name, "names", cn_saved_list(k->city, ask->is_appearance));
    }
    if (answer) json_object_set_new(answer, "what", json_string(ask->is_appearance ? "light" : "path"));
    cn_session_send_json(q->session, q->visit, type, ask->id, answer);
    return CN_OK;
}

static cn_status answer_city(cn_desk *k, const cn_question *q)
{
    cn_session_send_json(q->session, q->visit, "city", q->ask.id, cn_facts_city(k->city, k->dataset, k->colour));
    /* A page that has just connected does not know the state yet, nor what became of a film while it was away. */
    pthread_mutex_lock(&k->lock);
    free(k->said);
    k->said = NULL;
    if (k->reported) cn_session_send(q->session, q->visit, cn_out_create(k->reported, strlen(k->reported), false, -1));
    pthread_mutex_unlock(&k->lock);
    return CN_OK;
}

static cn_status answer(cn_desk *k, cn_question *q)
{
    json_t *facts;
    switch (q->ask.kind) {
    case CN_ASK_CITY: return answer_city(k, q);
    case CN_ASK_TILE:
        CN_TRY(cn_facts_tile(k->city, k->dataset, q->ask.name, &facts));
        cn_session_send_json(q->session, q->visit, "tile", q->ask.id, facts);
        return CN_OK;
    case CN_ASK_POINTS: return answer_points(k, q);
    case CN_ASK_PHOTO: return answer_photo(k, q);
    case CN_ASK_TRANSIENT: return answer_transient(k, q);
    case CN_ASK_SAVE:
    case CN_ASK_LIST:
    case CN_ASK_LOAD: return answer_saved(k, q);
    case CN_ASK_FILM_SHOW: return cn_desk_film_show(k, q);
    case CN_ASK_FIT:
    case CN_ASK_FILM:
    case CN_ASK_FILM_STOP: cn_desk_film_ask(k, q); return CN_OK;
    case CN_ASK_VIEW:
    case CN_ASK_CANCEL: break;
    }
    return cn_fail(CN_ERR_INTERNAL, "this kind of request is unknown");
}

/* ---- the queue ---- */

static void say_state(cn_desk *k)
{
    const cn_context ctx = { .stop = &k->stop };
    json_t *root = NULL;
    if (!cn_live_count(k->live) || cn_facts_state(&ctx, k->city, k->dataset, &root) != CN_OK) return;
    json_object_set_new(root, "type", json_string("state"));
    char *text = json_dumps(root, JSON_COMPACT | JSON_SORT_KEYS | JSON_REAL_PRECISION(12));
    json_decref(root);
    pthread_mutex_lock(&k->lock);
    const bool news = text && (!k->said || strcmp(k->said, text) != 0);
    if (news) {
        free(k->said);
        k->said = strdup(text);
    }
    pthread_mutex_unlock(&k->lock);
    if (news) cn_live_send_all(k->live, text, CN_SLOT_STATE);
    free(text);
}

/* The next question; false after a timeout. */
static bool next(cn_desk *k, cn_question *q)
{
    struct timespec until;
    clock_gettime(CLOCK_REALTIME, &until);
    until.tv_sec += STATE_EVERY_S;
    pthread_mutex_lock(&k->lock);
    int waited = 0;
    while (!k->n && !cn_stopping(&(cn_context){ .stop = &k->stop }) && !waited)
        waited = pthread_cond_timedwait(&k->changed, &k->lock, &until);
    const bool there = k->n > 0;
    if (there) {
        *q = k->waiting[k->first];
        k->first = (k->first + 1) % CN_DESK_MAX;
        k->n--;
    }
    pthread_mutex_unlock(&k->lock);
    return there;
}

static void *work(void *user)
{
    cn_desk *k = user;
    struct timespec now;
    time_t said_s = 0;
    while (!cn_stopping(&(cn_context){ .stop = &k->stop })) {
        cn_question q;
        const bool there = next(k, &q);
        if (there && cn_session_visit(q.session) == q.visit && answer(k, &q) != CN_OK)
            cn_session_send_failure(q.session, q.visit, q.ask.id, cn_error_message());
        if (there) cn_ask_deinit(&q.ask);
        clock_gettime(CLOCK_MONOTONIC, &now);
        if (now.tv_sec < said_s + STATE_EVERY_S && (!there || k->said)) continue;
        said_s = now.tv_sec;
        say_state(k);
    }
    return NULL;
}

void cn_desk_ask(cn_desk *k, cn_session *session, cn_ask *ask)
{
    const uint32_t visit = cn_session_visit(session);
    uint32_t own = 0;
    pthread_mutex_lock(&k->lock);
    for (uint32_t i = 0; i < k->n; i++) {
        const cn_question *q = &k->waiting[(k->first + i) % CN_DESK_MAX];
        own += q->session == session && q->visit == visit;
    }
    const bool room = k->n < CN_DESK_MAX && own < CN_DESK_MAX_EACH;
    if (room) {
        k->waiting[(k->first + k->n++) % CN_DESK_MAX] = (cn_question){ session, visit, *ask };
        pthread_cond_signal(&k->changed);
    }
    pthread_mutex_unlock(&k->lock);
    if (!room) {
        cn_session_send_failure(session, visit, ask->id, "too many questions wait already; ask again");
        cn_ask_deinit(ask);
    }
    *ask = (cn_ask){ 0 };
}

/* Signals go to the caller's threads. */
static bool start(pthread_t *thread, void *(*run)(void *), cn_desk *k)
{
    sigset_t all, old;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &old);
    const bool started = pthread_create(thread, NULL, run, k) == 0;
    pthread_sigmask(SIG_SETMASK, &old, NULL);
    return started;
}

cn_status cn_desk_open(cn_desk *k, cn_live *live, cn_city *city, unsigned film_threads)
{
    *k = (cn_desk){ .live = live,
                    .city = city,
                    .dataset = live->renderer->dataset,
                    .colour = live->renderer->colour,
                    .film_threads = film_threads };
    pthread_mutex_init(&k->lock, NULL);
    pthread_cond_init(&k->changed, NULL);
    pthread_cond_init(&k->film_changed, NULL);
    k->started = start(&k->thread, work, k);
    k->film_started = start(&k->film_thread, cn_desk_film_work, k);
    return k->started && k->film_started ? CN_OK
                                         : cn_fail(CN_ERR_NOMEM, "the system cannot start a thread for viewers");
}

void cn_desk_close(cn_desk *k)
{
    if (!k->live) return;
    pthread_mutex_lock(&k->lock);
    cn_stop(&k->stop);
    cn_stop(&k->film_stop);
    pthread_cond_broadcast(&k->changed);
    pthread_cond_broadcast(&k->film_changed);
    pthread_mutex_unlock(&k->lock);
    if (k->started) pthread_join(k->thread, NULL);
    if (k->film_started) pthread_join(k->film_thread, NULL);
    for (uint32_t i = 0; i < k->n; i++)
        cn_ask_deinit(&k->waiting[(k->first + i) % CN_DESK_MAX].ask);
    cn_ask_deinit(&k->film.ask);
    free(k->said);
    free(k->reported);
    pthread_cond_destroy(&k->film_changed);
    pthread_cond_destroy(&k->changed);
    pthread_mutex_destroy(&k->lock);
    *k = (cn_desk){ 0 };
}
