/* The renderer, by the demo city: its pictures are those of `conurb render`, from any thread, and jobs end. */
#include "../common.h"
#include "bridge/oiio.h"
#include "conurb/path.h"
#include "conurb/stage.h"
#include "math/linalg.h"
#include "renderer/renderer.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

enum { WIDTH = 96, THREADS = 8, BLOCK_RAYS = 64 };
static const char VIEW[] = "run0-clear_air_0003.jpg", DAY[] = "run0-clear_street_0006.jpg";

static char folder[64];
static cn_context ctx;
static cn_city *city;
static cn_render_request request; /* of VIEW */

static int set_up(void **state)
{
    (void)state;
    char command[512];
    snprintf(folder, sizeof folder, "/tmp/test_renderer_XXXXXX");
    if (!mkdtemp(folder)) return 1;
    snprintf(command, sizeof command, "cp -r %s/. %s", DEMO, folder);
    if (system(command) != 0) return 1;
    if (cn_pool_create(&ctx.pool, 2) != CN_OK || cn_city_open(&city, folder) != CN_OK) return 1;
    cn_dataset m;
    if (cn_dataset_load(&ctx, city, true, &m) != CN_OK) return 1;
    for (uint32_t v = 0; v < m.scene.n_views; v++) {
        const cn_view *view = &m.scene.views[v];
        const cn_camera *own = &m.scene.cameras[view->camera];
        if (strcmp(view->name, VIEW) != 0) continue;
        request = (cn_render_request){ .view = *view, .passes = CN_PASS_FULL };
        /* As `conurb render --photo` has it. */
        const uint32_t height = (uint32_t)fmax(1, round((double)own->height * WIDTH / own->width));
        cn_camera_resize(own, WIDTH, height, &request.camera);
        request.view.name = NULL;
    }
    cn_dataset_deinit(&m);
    return request.camera.width == 0;
}

static int tear_down(void **state)
{
    (void)state;
    cn_city_close(&city);
    cn_pool_destroy(&ctx.pool);
    return folder_remove(folder);
}

static cn_renderer *create(void)
{
    cn_renderer *r;
    assert_int_equal(cn_renderer_create(&r, &ctx, city, true), CN_OK);
    return r;
}

static size_t pixels_of(const cn_picture *p)
{
    return (size_t)p->width * p->height;
}

static void assert_same(const cn_picture *a, const cn_picture *b)
{
    assert_true(a->width == b->width && a->height == b->height);
    assert_memory_equal(a->rgba, b->rgba, pixels_of(a) * 4 * sizeof(float));
    assert_memory_equal(a->depth, b->depth, pixels_of(a) * sizeof(float));
}

/* The job's full picture; the caller releases the job. */
static cn_render_job *render(cn_renderer *r, const cn_render_request *q, cn_render_result *result)
{
    cn_render_job *job;
    assert_int_equal(cn_renderer_submit(r, q, &job), CN_OK);
    assert_int_equal(cn_renderer_wait(job, NULL, result), CN_OK);
    return job;
}

static float *decode(const uint8_t *bytes, size_t size, const char *name, uint32_t *width, uint32_t *height)
{
    char path[128];
    float *rgba;
    snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *f = fopen(path, "wb");
    assert_non_null(f);
    assert_int_equal(fwrite(bytes, 1, size, f), size);
    assert_int_equal(fclose(f), 0);
    assert_int_equal(cn_oiio_read_rgba(path, &rgba, width, height), CN_OK);
    return rgba;
}

static void channels_come_with_the_picture(void **state)
{
    (void)state;
    cn_renderer *r = create();
    cn_render_request q = request;
    cn_render_result plain, result;
    cn_render_job *without = render(r, &q, &plain);
    q.aovs = CN_AOV_DEPTH | CN_AOV_NORMAL;
    cn_render_job *job = render(r, &q, &result);
    assert_null(plain.aovs);
    assert_non_null(result.aovs);
    assert_null(result.owners); /* nobody asked for these */
    assert_same(plain.picture, result.picture);
    assert_null(result.aovs->values[4]);
    assert_memory_equal(result.aovs->values[0], result.picture->depth, pixels_of(result.picture) * sizeof(float));
    for (size_t i = 0; i < pixels_of(result.picture); i++) {
        const float *n = result.aovs->values[1] + 3 * i, length = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
        assert_true(result.picture->depth[i] > 0 ? fabsf(length - 1) < 1e-3f : length < 1.01f);
    }
    /* What one tile alone shows is its own. */
    q.owners = true;
    q.tile = plain.tile;
    cn_renderer_release(&job);
    job = render(r, &q, &result);
    assert_non_null(result.owners);
    for (size_t i = 0; i < pixels_of(result.picture); i++) {
        const uint32_t owner = result.owners[i];
        assert_true((owner != UINT32_MAX) == (result.picture->rgba[4 * i + 3] > 0));
        if (owner != UINT32_MAX) assert_string_equal(r->tiles.plan->tiles[owner].id, plain.tile);
    }
    cn_renderer_release(&without);
    cn_renderer_release(&job);
    cn_renderer_destroy(&r);
}

/* What is outside of the box is not there, and what is inside has its depth. */
static void a_crop_leaves_the_rest_out(void **state)
{
    (void)state;
    cn_renderer *r = create();
    cn_render_request q = request;
    cn_render_result whole, part;
    double eye[3], dir[3], at[3];
    cn_render_job *all = render(r, &q, &whole);
    const uint32_t w = whole.picture->width, h = whole.picture->height;
    const size_t middle = (size_t)(h / 2) * w + w / 2;
    const float depth = whole.picture->depth[middle];
    assert_true(depth > 0);
    cn_view_centre(&q.view, eye);
    assert_int_equal(cn_camera_unproject(&q.camera, w / 2 + 0.5, h / 2 + 0.5, dir), CN_OK);
    cn_mat3_tvec(q.view.rotation, dir, at);
    double box[6];
    for (int k = 0; k < 3; k++) {
        box[k] = eye[k] + (double)depth * at[k] - 3;
        box[k + 3] = box[k] + 6;
    }
    q.crop_m = box;
    cn_render_job *some = render(r, &q, &part);
    size_t left = 0;
    for (size_t i = 0; i < pixels_of(part.picture); i++)
        left += part.picture->rgba[4 * i + 3] > 0.5f;
    assert_true(left > 0 && left < pixels_of(part.picture) / 2);
    assert_float_equal(part.picture->depth[middle], depth, 3);
    assert_float_equal(part.picture->rgba[3], 0, 0); /* no sky */
    cn_renderer_release(&some);
    for (int k = 0; k < 6; k++)
        box[k] = 1e5 + k;
    some = render(r, &q, &part);
    for (size_t i = 0; i < 4 * pixels_of(part.picture); i++)
        assert_true(part.picture->rgba[i] == 0);
    cn_renderer_release(&some);
    cn_renderer_release(&all);
    cn_renderer_destroy(&r);
}

static void pictures_are_those_of_the_command(void **state)
{
    (void)state;
    char out[96], path[128];
    snprintf(out, sizeof out, "%s/frames", folder);
    const cn_city_render_options options = {
        .photo = VIEW, .appearance = DAY, .width_px = WIDTH, .out = out, .blend = "ownership"
    };
    assert_int_equal(cn_city_render(&ctx, city, &options), CN_OK);
    uint32_t w, h, w2, h2;
    float *wanted;
    snprintf(path, sizeof path, "%s/00000.png", out);
    assert_int_equal(cn_oiio_read_rgba(path, &wanted, &w, &h), CN_OK);

    cn_renderer *r = create();
    cn_render_request q = request;
    cn_render_result result;
    q.appearance = DAY;
    q.blend = "ownership";
    q.encoding = CN_ENCODING_PNG;
    cn_render_job *job = render(r, &q, &result);
    float *got = decode(result.encoded, result.encoded_size, "got.png", &w2, &h2);
    assert_true(w == w2 && h == h2 && result.tile[0]);
    assert_memory_equal(wanted, got, (size_t)w * h * 4 * sizeof(float));
    free(got);
    cn_renderer_release(&job);

    q.encoding = CN_ENCODING_JPEG;
    q.quality = 100;
    job = render(r, &q, &result);
    got = decode(result.encoded, result.encoded_size, "got.jpg", &w2, &h2);
    assert_true(w == w2 && h == h2);
    double sum = 0;
    for (size_t i = 0; i < (size_t)w * h * 4; i++)
        sum += pow((double)(got[i] - wanted[i]), 2);
    assert_true(sqrt(sum / (4.0 * w * h)) < 0.03);
    free(got);
    free(wanted);
    cn_renderer_release(&job);
    cn_renderer_destroy(&r);
}

static void one_tile_is_what_cn_render_tile_gives(void **state)
{
    (void)state;
    char path[128];
    cn_renderer *r = create();
    cn_render_request q = request;
    cn_render_result result;
    cn_tile *tile;
    cn_appearance row;
    cn_picture picture;
    q.tile = r->tiles.plan->tiles[r->tiles.which[0]].id;
    snprintf(path, sizeof path, "%s/tiles/%s/tile.safetensors", folder, q.tile);
    assert_int_equal(cn_tile_open(&tile, path), CN_OK);
    assert_int_equal(cn_tile_appearance(tile, cn_tile_photo_name(tile, 0), &row), CN_OK);
    q.row = &row;
    cn_render_options options = cn_render_options_default();
    options.appearance = &row;
    assert_int_equal(cn_picture_init(&picture, q.camera.width, q.camera.height), CN_OK);
    assert_int_equal(cn_render_tile(&ctx, tile, &q.camera, &q.view, &options, &picture), CN_OK);
    cn_render_job *job = render(r, &q, &result);
    assert_same(result.picture, &picture);
    assert_string_equal(result.tile, q.tile);
    cn_renderer_release(&job);
    q.tile = "nowhere";
    assert_int_equal(cn_renderer_submit(r, &q, &job), CN_OK);
    assert_int_equal(cn_renderer_wait(job, NULL, NULL), CN_ERR_USAGE);
    assert_non_null(strstr(cn_error_message(), "nowhere"));
    cn_renderer_release(&job);
    cn_picture_deinit(&picture);
    cn_tile_close(&tile);
    cn_renderer_destroy(&r);
}

/* ---- many threads ---- */

typedef struct visitor {
    pthread_t thread;
    cn_renderer *renderer;
    cn_render_request request;
    cn_render_job *job;
    cn_render_result result;
    cn_status status;
} visitor;

static void *visit(void *user)
{
    visitor *v = user;
    v->status = cn_renderer_submit(v->renderer, &v->request, &v->job);
    if (v->status == CN_OK) v->status = cn_renderer_wait(v->job, NULL, &v->result);
    return NULL;
}

/* Turned a little to the side. */
static cn_view turned(const cn_view *view, double angle)
{
    cn_view out = *view;
    const double c = cos(angle), s = sin(angle);
    for (int a = 0; a < 3; a++) {
        out.rotation[a] = c * view->rotation[a] - s * view->rotation[6 + a];
        out.rotation[6 + a] = s * view->rotation[a] + c * view->rotation[6 + a];
    }
    out.translation[0] = c * view->translation[0] - s * view->translation[2];
    out.translation[2] = s * view->translation[0] + c * view->translation[2];
    return out;
}

static void eight_threads_get_their_pictures(void **state)
{
    (void)state;
    static visitor v[THREADS];
    cn_renderer *r = create();
    for (int i = 0; i < THREADS; i++) {
        v[i] = (visitor){ .renderer = r, .request = request };
        v[i].request.view = turned(&request.view, 0.1 * i);
        v[i].request.appearance = i & 1 ? DAY : NULL;
        v[i].request.blend = i & 2 ? "ownership" : "distance_3d";
        assert_int_equal(pthread_create(&v[i].thread, NULL, visit, &v[i]), 0);
    }
    for (int i = 0; i < THREADS; i++)
        pthread_join(v[i].thread, NULL);
    for (int i = 0; i < THREADS; i++) {
        cn_render_result alone;
        assert_int_equal(v[i].status, CN_OK);
        cn_render_job *job = render(r, &v[i].request, &alone);
        assert_same(v[i].result.picture, alone.picture);
        cn_renderer_release(&job);
        if (i >= 4) assert_memory_not_equal(v[i].result.picture->rgba, v[i - 4].result.picture->rgba, 4 * WIDTH);
    }
    for (int i = 0; i < THREADS; i++)
        cn_renderer_release(&v[i].job);
    cn_renderer_destroy(&r);
}

/* ---- passes ---- */

typedef struct delivered {
    int passes[8];
    uint32_t widths[8];
    int n;
    cn_status end;
    atomic_bool first;
    bool cancel; /* in the first delivery */
} delivered;

static void take(void *user, cn_render_job *job, cn_status status, const cn_render_result *result)
{
    delivered *d = user;
    d->end = status;
    if (!result) return;
    d->passes[d->n] = result->pass;
    d->widths[d->n++] = result->picture->width;
    if (d->cancel) cn_renderer_cancel(job);
    atomic_store(&d->first, true);
}

static void passes_end_with_the_full_picture(void **state)
{
    (void)state;
    cn_renderer *r = create();
    delivered d = { 0 };
    cn_render_result full, last;
    cn_render_job *alone = render(r, &request, &full);
    cn_render_request q = request;
    q.passes = CN_PASS_ALL;
    q.deliver = take;
    q.user = &d;
    cn_render_job *job = render(r, &q, &last);
    assert_int_equal(last.pass, CN_PASS_FULL);
    assert_same(full.picture, last.picture);
    assert_int_equal(d.n, 4);
    assert_int_equal(d.end, CN_OK);
    for (int i = 0; i < 4; i++) {
        assert_int_equal(d.passes[i], 1 << i);
        assert_int_equal(d.widths[i], WIDTH >> (3 - i));
    }
    cn_renderer_release(&job);
    cn_renderer_release(&alone);
    cn_renderer_destroy(&r);
}

/* ---- cancellation ---- */

/* A picture that takes seconds. */
static cn_render_request large(void)
{
    cn_render_request q = request;
    cn_camera_resize(&request.camera, 32 * WIDTH, 32 * request.camera.height, &q.camera);
    return q;
}

/* After a cancel, a job evaluates at most the samples of one block of rays a thread. */
static void a_cancelled_job_stops_at_once(void **state)
{
    (void)state;
    cn_renderer *r = create();
    delivered d = { 0 };
    cn_render_request q = large();
    q.passes = CN_PASS_EIGHTH | CN_PASS_FULL;
    q.blend = "nearest";
    q.deliver = take;
    q.user = &d;
    cn_render_job *job;
    assert_int_equal(cn_renderer_submit(r, &q, &job), CN_OK);
    while (!atomic_load(&d.first))
        usleep(1000);
    const uint64_t eighth = __atomic_load_n(&job->samples, __ATOMIC_RELAXED);
    while (__atomic_load_n(&job->samples, __ATOMIC_RELAXED) < 2 * eighth)
        usleep(1000);
    cn_renderer_cancel(job);
    assert_int_equal(cn_renderer_wait(job, NULL, NULL), CN_ERR_INTERRUPTED);
    /* A step of 0.4 % from 0.01 m to 10 km takes less than 4000 samples a ray. */
    const uint64_t after = job->samples - job->samples_at_cancel, most = 2ull * BLOCK_RAYS * 4000;
    assert_true(after <= most);
    assert_true(job->samples < 32 * eighth); /* the full pass takes 64 times as much */
    assert_int_equal(d.n, 1);
    assert_int_equal(d.end, CN_ERR_INTERRUPTED);
    cn_renderer_release(&job);
    cn_renderer_destroy(&r);
}

static void no_pass_follows_a_cancel(void **state)
{
    (void)state;
    cn_renderer *r = create();
    delivered d = { .cancel = true };
    cn_render_request q = large();
    q.passes = CN_PASS_ALL;
    q.deliver = take;
    q.user = &d;
    cn_render_job *job;
    assert_int_equal(cn_renderer_submit(r, &q, &job), CN_OK);
    assert_int_equal(cn_renderer_wait(job, NULL, NULL), CN_ERR_INTERRUPTED);
    assert_int_equal(d.n, 1);
    cn_renderer_release(&job);
    cn_renderer_destroy(&r);
}

static void a_new_job_cancels_its_stream(void **state)
{
    (void)state;
    cn_renderer *r = create();
    cn_render_request q = large();
    cn_render_job *old, *other, *new;
    cn_render_result result;
    q.stream = 7;
    assert_int_equal(cn_renderer_submit(r, &q, &old), CN_OK);
    cn_render_request small = request;
    small.stream = 8;
    assert_int_equal(cn_renderer_submit(r, &small, &other), CN_OK);
    small.stream = 7;
    small.priority = 1;
    assert_int_equal(cn_renderer_submit(r, &small, &new), CN_OK);
    assert_int_equal(cn_renderer_wait(old, NULL, NULL), CN_ERR_INTERRUPTED);
    assert_int_equal(cn_renderer_wait(new, NULL, &result), CN_OK);
    assert_int_equal(cn_renderer_wait(other, NULL, &result), CN_OK);
    cn_renderer_release(&old);
    cn_renderer_release(&other);
    cn_renderer_release(&new);
    cn_renderer_destroy(&r);
}

static void destroying_ends_what_waits(void **state)
{
    (void)state;
    cn_renderer *r = create();
    const cn_render_request q = large();
    cn_render_job *jobs[6];
    for (int i = 0; i < 6; i++)
        assert_int_equal(cn_renderer_submit(r, &q, i < 3 ? &jobs[i] : NULL), CN_OK);
    cn_renderer_destroy(&r);
    assert_null(r);
    for (int i = 0; i < 3; i++) {
        assert_int_equal(cn_renderer_wait(jobs[i], NULL, NULL), CN_ERR_INTERRUPTED);
        cn_renderer_cancel(jobs[i]);
        cn_renderer_release(&jobs[i]);
    }
}

static void waiting_stops_when_asked_to(void **state)
{
    (void)state;
    int stop = 1;
    const cn_context asked = { .stop = &stop };
    cn_renderer *r = create();
    const cn_render_request q = large();
    cn_render_job *job;
    assert_int_equal(cn_renderer_submit(r, &q, &job), CN_OK);
    assert_int_equal(cn_renderer_wait(job, &asked, NULL), CN_ERR_INTERRUPTED);
    cn_renderer_release(&job);
    cn_renderer_destroy(&r);
}

/* ---- tiles that change ---- */

/* The nearest tile's file is replaced by another tile's; its name stays. */
static void a_tile_that_changed_is_opened_again(void **state)
{
    (void)state;
    char command[512];
    cn_renderer *r = create();
    cn_render_request q = request;
    cn_render_result before, after;
    const cn_plan *plan = r->tiles.plan;
    const char *id = plan->tiles[r->tiles.which[0]].id, *other = plan->tiles[r->tiles.which[1]].id;
    q.tile = id;
    cn_render_job *first = render(r, &q, &before);
    snprintf(command, sizeof command,
             "cd %s/tiles && cp %s/tile.safetensors kept && cp %s/tile.safetensors new && mv new %s/tile.safetensors",
             folder, id, other, id);
    assert_int_equal(system(command), 0);
    cn_render_job *second = render(r, &q, &after);
    assert_memory_not_equal(before.picture->rgba, after.picture->rgba, pixels_of(before.picture) * 16);
    cn_renderer_release(&second);
    snprintf(command, sizeof command, "cd %s/tiles && mv kept %s/tile.safetensors && mv %s/DONE %s/UNDONE", folder, id,
             id, id);
    assert_int_equal(system(command), 0);
    /* While it is trained again it is not there. */
    assert_int_equal(cn_renderer_submit(r, &q, &second), CN_OK);
    assert_int_equal(cn_renderer_wait(second, NULL, NULL), CN_ERR_USAGE);
    cn_renderer_release(&second);
    snprintf(command, sizeof command, "cd %s/tiles && mv %s/UNDONE %s/DONE", folder, id, id);
    assert_int_equal(system(command), 0);
    second = render(r, &q, &after);
    assert_same(before.picture, after.picture);
    cn_renderer_release(&second);
    cn_renderer_release(&first);
    cn_renderer_destroy(&r);
}

static void in_tiles(const char *command)
{
    char text[512];
    snprintf(text, sizeof text, "cd %s/tiles && %s", folder, command);
    assert_int_equal(system(text), 0);
}

static void assert_empty(cn_renderer *r)
{
    cn_render_result result;
    cn_render_job *job = render(r, &request, &result);
    assert_string_equal(result.tile, "");
    for (size_t i = 0; i < pixels_of(result.picture) * 4; i++)
        assert_true(result.picture->rgba[i] == 0);
    cn_renderer_release(&job);
}

/* From no tile at all to all of them, and back. */
static void tiles_come_while_a_city_is_trained(void **state)
{
    (void)state;
    char command[256];
    cn_renderer *r = create();
    cn_render_result all, one, again;
    cn_render_job *wanted = render(r, &request, &all), *job;
    assert_true(r->tiles.n > 1);
    snprintf(command, sizeof command, "mv %s/UNDONE %s/DONE", all.tile, all.tile);
    cn_renderer_destroy(&r);
    in_tiles("for t in */DONE; do mv $t ${t%DONE}UNDONE; done");
    r = create();
    assert_empty(r);
    in_tiles(command);
    job = render(r, &request, &one);
    assert_string_equal(one.tile, all.tile);
    assert_memory_not_equal(one.picture->rgba, all.picture->rgba, pixels_of(all.picture) * 16);
    cn_renderer_release(&job);
    in_tiles("for t in */UNDONE; do mv $t ${t%UNDONE}DONE; done");
    job = render(r, &request, &again);
    assert_same(all.picture, again.picture);
    cn_renderer_release(&job);
    in_tiles("for t in */DONE; do mv $t ${t%DONE}UNDONE; done");
    assert_empty(r);
    in_tiles("for t in */UNDONE; do mv $t ${t%UNDONE}DONE; done");
    cn_renderer_release(&wanted);
    cn_renderer_destroy(&r);
}

static void requests_that_make_no_sense_are_refused(void **state)
{
    (void)state;
    cn_renderer *r = create();
    const cn_appearance row = { 0 };
    cn_render_job *job;
    cn_render_request q = request;
    q.passes = 0;
    assert_int_equal(cn_renderer_submit(r, &q, &job), CN_ERR_USAGE);
    assert_null(job);
    q = request;
    q.camera.width = 0;
    assert_int_equal(cn_renderer_submit(r, &q, &job), CN_ERR_USAGE);
    q = request;
    q.row = &row;
    assert_int_equal(cn_renderer_submit(r, &q, &job), CN_ERR_USAGE);
    q = request;
    q.encoding = CN_ENCODING_PNG;
    q.display_view = "no such view";
    assert_int_equal(cn_renderer_submit(r, &q, &job), CN_OK);
    assert_int_equal(cn_renderer_wait(job, NULL, NULL), CN_ERR_CONFIG);
    cn_renderer_release(&job);
    q = request;
    q.appearance = "nobody.jpg";
    assert_int_equal(cn_renderer_submit(r, &q, &job), CN_OK);
    assert_int_equal(cn_renderer_wait(job, NULL, NULL), CN_ERR_USAGE);
    cn_renderer_release(&job);
    cn_renderer_destroy(&r);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pictures_are_those_of_the_command),  cmocka_unit_test(one_tile_is_what_cn_render_tile_gives),
        cmocka_unit_test(channels_come_with_the_picture),     cmocka_unit_test(a_crop_leaves_the_rest_out),
        cmocka_unit_test(eight_threads_get_their_pictures),   cmocka_unit_test(passes_end_with_the_full_picture),
        cmocka_unit_test(a_cancelled_job_stops_at_once),      cmocka_unit_test(no_pass_follows_a_cancel),
        cmocka_unit_test(a_new_job_cancels_its_stream),       cmocka_unit_test(destroying_ends_what_waits),
        cmocka_unit_test(waiting_stops_when_asked_to),        cmocka_unit_test(a_tile_that_changed_is_opened_again),
        cmocka_unit_test(tiles_come_while_a_city_is_trained), cmocka_unit_test(requests_that_make_no_sense_are_refused),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
