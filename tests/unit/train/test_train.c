/* Training as a whole: it learns, the thread count changes no byte, a stopped run ends as an uninterrupted one,
 * held-out photos are refused. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "base/file.h"
#include "base/rng.h"
#include "conurb/measure.h"
#include "conurb/render.h"
#include "effect/display.h"
#include "effect/sky_hints.h"
#include "synthetic.h"
#include "math/linalg.h"
#include "tile/model.h"
#include "train/trainer.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static synthetic_scene synthetic;

static int make(void **state)
{
    (void)state;
    synthetic_scene_init(&synthetic, 17);
    return 0;
}
static int unmake(void **state)
{
    (void)state;
    synthetic_scene_deinit(&synthetic);
    return 0;
}

static void turn_on(const char *first, const char *second)
{
    const char *names[2] = { first, second };
    synthetic.tile.n_effects = 0;
    for (int i = 0; i < 2; i++) {
        if (!names[i]) continue;
        cn_plan_effect *e = &synthetic.tile.effects[synthetic.tile.n_effects++];
        memset(e, 0, sizeof *e);
        strcpy(e->name, names[i]);
        e->on = true;
    }
}

/* Every effect of the list. */
static void turn_all_on(void)
{
    synthetic.tile.n_effects = 0;
    for (uint32_t i = 0; i < cn_effect_count; i++) {
        cn_plan_effect *e = &synthetic.tile.effects[synthetic.tile.n_effects++];
        memset(e, 0, sizeof *e);
        strcpy(e->name, cn_effect_list[i]->name);
        e->on = true;
    }
}

static cn_status train(unsigned threads, const cn_train_options *o, const char *name, const int *stop, char path[160])
{
    cn_pool *pool = NULL;
    assert_int_equal(cn_pool_create(&pool, threads), CN_OK);
    const cn_context ctx = { .pool = pool, .stop = stop };
    const cn_train_input input = { &synthetic.scene, &synthetic.index, synthetic.pixels, &synthetic.tile };
    cn_train_result result;
    char dir[128];
    snprintf(dir, sizeof dir, "%s/%s", synthetic.folder, name);
    const cn_status status = cn_train_tile(&ctx, &input, o, "parent", dir, &result);
    cn_pool_destroy(&pool);
    snprintf(path, 160, "%s/tile.safetensors", dir);
    return status;
}

static void test_threads_change_nothing(void **state)
{
    (void)state;
    turn_all_on();
    const cn_train_options o = synthetic_options();
    char one[160], other[160];
    assert_int_equal(train(1, &o, "t1", NULL, one), CN_OK);
    static const unsigned counts[] = { 2, 3, 7 };
    for (size_t i = 0; i < 3; i++) {
        char name[16];
        snprintf(name, sizeof name, "t%u", counts[i]);
        assert_int_equal(train(counts[i], &o, name, NULL, other), CN_OK);
        assert_true(same_bytes(one, other));
    }
    cn_train_options seed = o;
    seed.seed = 2;
    assert_int_equal(train(1, &seed, "seed2", NULL, other), CN_OK);
    assert_false(same_bytes(one, other)); /* so the comparison can fail */
}

/* The progress callback stops the training. */
static int stop_flag;
static void stop_soon(void *user, const cn_progress_report *r)
{
    (void)user;
    if (r->done >= 24) stop_flag = 1;
}

static void resume_with(const char *what)
{
    const cn_train_options o = synthetic_options();
    char whole[160], parts[160], dir[128], name[64];
    snprintf(name, sizeof name, "whole-%s", what);
    assert_int_equal(train(2, &o, name, NULL, whole), CN_OK);
    const cn_context ctx = { .progress = stop_soon, .stop = &stop_flag };
    const cn_train_input input = { &synthetic.scene, &synthetic.index, synthetic.pixels, &synthetic.tile };
    cn_train_result result;
    snprintf(name, sizeof name, "parts-%s", what);
    snprintf(dir, sizeof dir, "%s/%s", synthetic.folder, name);
    assert_int_equal(cn_train_tile(&ctx, &input, &o, "parent", dir, &result), CN_ERR_INTERRUPTED);
    snprintf(parts, sizeof parts, "%s/checkpoint.safetensors", dir);
    assert_true(cn_file_exists(parts));
    snprintf(parts, sizeof parts, "%s/DONE", dir);
    assert_false(cn_file_exists(parts));
    stop_flag = 0;
    assert_int_equal(train(2, &o, name, NULL, parts), CN_OK);
    if (!same_bytes(whole, parts)) fail_msg("a resumed run with %s ends with other bytes", what);
}

/* With each effect of the list, and with all of them. */
static void test_resume_gives_the_same_bytes(void **state)
{
    (void)state;
    for (uint32_t e = 0; e < cn_effect_count; e++) {
        turn_on(cn_effect_list[e]->name, NULL);
        resume_with(cn_effect_list[e]->name);
    }
    turn_all_on();
    resume_with("all");
}

static double held_out_psnr(const char *path, bool with_photo)
{
    cn_tile *tile = NULL;
    assert_int_equal(cn_tile_open(&tile, path), CN_OK);
    const cn_context ctx = { 0 };
    cn_render_options o = cn_render_options_default();
    double error = 0;
    size_t n = 0;
    for (uint32_t h = 0; h < synthetic.tile.n_held_out; h++) {
        const cn_view *v = &synthetic.scene.views[synthetic.tile.held_out[h]];
        cn_picture p;
        float truth[48 * 36 * 4];
        assert_int_equal(cn_picture_init(&p, 48, 36), CN_OK);
        cn_appearance row;
        assert_int_equal(cn_tile_appearance(tile, with_photo ? v->name : NULL, &row), CN_OK);
        o.appearance = &row;
        assert_int_equal(cn_render_tile(&ctx, tile, &synthetic.scene.cameras[0], v, &o, &p), CN_OK);
        assert_int_equal(cn_pixel_store_read(synthetic.pixels, v->photo, truth), CN_OK);
        for (size_t i = 0; i < 48 * 36 * 4; i++) {
            if (i % 4 == 3) continue;
            const double d = sqrt(fmax(p.rgba[i], 0)) - sqrt(fmax(truth[i], 0));
            error += d * d;
            n++;
        }
        cn_picture_deinit(&p);
    }
    cn_tile_close(&tile);
    return -10 * log10(error / (double)n);
}

static void test_learns_and_exposure_helps(void **state)
{
    (void)state;
    if (!MEASURES) skip();
    cn_train_options o = synthetic_options();
    o.steps = 1000;
    char with[160], without[160];
    turn_on("view_dependence", "exposure");
    assert_int_equal(train(2, &o, "with", NULL, with), CN_OK);
    turn_on("view_dependence", NULL);
    assert_int_equal(train(2, &o, "without", NULL, without), CN_OK);
    const double a = held_out_psnr(with, true), b = held_out_psnr(without, false);
    print_message("held-out: %.2f dB with exposure, %.2f dB without\n", a, b);
    assert_true(a > 17);
    assert_true(a > b + 2);
}

/* Ground that is black in the photos is matter, also in a tile with a sky. Without matter the views of the photos would
 * look the same, but other views would show a hole. */
static void test_black_ground_is_matter(void **state)
{
    (void)state;
    if (!MEASURES) skip();
    const synthetic_scene day = synthetic;
    cn_train_options o = synthetic_options();
    cn_tile *tile = NULL;
    cn_picture p;
    cn_appearance row;
    char path[160];
    o.steps = 300;
    synthetic_night_init(&synthetic, 17);
    turn_on("sky", "exposure");
    assert_int_equal(train(2, &o, "night", NULL, path), CN_OK);
    assert_int_equal(cn_tile_open(&tile, path), CN_OK);
    assert_int_equal(cn_tile_appearance(tile, NULL, &row), CN_OK);
    cn_render_options render = cn_render_options_default();
    render.appearance = &row;
    assert_int_equal(cn_picture_init(&p, 48, 36), CN_OK);
    const cn_view *view = &synthetic.scene.views[synthetic.tile.held_out[0]];
    assert_int_equal(cn_render_tile(&(cn_context){ 0 }, tile, &synthetic.scene.cameras[0], view, &render, &p), CN_OK);
    double alpha = 0; /* of the lowest rows, which show the floor */
    for (size_t i = 30 * 48; i < 36 * 48; i++)
        alpha += (double)p.rgba[4 * i + 3] / (6 * 48);
    print_message("opacity of black ground: %.3f\n", alpha);
    assert_true(alpha > 0.9);
    cn_picture_deinit(&p);
    cn_tile_close(&tile);
    synthetic_scene_deinit(&synthetic);
    synthetic = day;
}

/* Sparse points and the lack of sky lead a short schedule to its end, a long one in its first part; afterwards sparse
 * points are drawn in every second step. Where poses are refined, sparse points are drawn at first only. */
static void test_what_leads_a_schedule(void **state)
{
    (void)state;
    static const struct {
        cn_step_at at;
        bool moves_rays;
        cn_lead lead;
    } cases[] = {
        { { 0, 300 }, false, { true, CN_SKY_NONE } },           { { 1499, 1500 }, false, { true, CN_SKY_NONE_LAST } },
        { { 1200, 1500 }, false, { true, CN_SKY_NONE } },       { { 2999, 6000 }, false, { true, CN_SKY_NONE } },
        { { 3001, 6000 }, false, { false, CN_SKY_NONE_LATE } }, { { 3003, 6000 }, false, { false, CN_SKY_NONE_LATE } },
        { { 3002, 6000 }, false, { true, CN_SKY_NONE_LATE } },  { { 5200, 6000 }, false, { true, CN_SKY_NONE_LAST } },
        { { 5400, 20000 }, false, { true, CN_SKY_NONE } },      { { 5501, 20000 }, false, { false, CN_SKY_NONE_LATE } },
        { { 40, UINT32_MAX }, false, { true, CN_SKY_NONE } }, /* a budget's first steps */
        { { 149, 1500 }, true, { true, CN_SKY_NONE } },         { { 151, 1500 }, true, { false, CN_SKY_NONE } },
        { { 152, 1500 }, true, { false, CN_SKY_NONE } },        { { 3004, 6000 }, true, { false, CN_SKY_NONE_LATE } },
    };
    const cn_sampler some = { .n_sparse = 1 }, none = { 0 };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const cn_lead lead = cn_sampler_lead(&some, cases[i].at, cases[i].moves_rays);
        assert_int_equal(lead.sparse, cases[i].lead.sparse);
        assert_int_equal(lead.no_sky, cases[i].lead.no_sky);
    }
    assert_false(cn_sampler_lead(&none, (cn_step_at){ 0, 1500 }, false).sparse);
}

/* Codes have zero mean, so the mean of the rows is the mean light. */
static void test_codes_have_zero_mean(void **state)
{
    (void)state;
    char path[160];
    const cn_train_options o = synthetic_options();
    turn_on("appearance", NULL);
    assert_int_equal(train(2, &o, "zero", NULL, path), CN_OK);
    cn_tile *tile = NULL;
    cn_appearance mean;
    assert_int_equal(cn_tile_open(&tile, path), CN_OK);
    assert_int_equal(cn_tile_appearance(tile, NULL, &mean), CN_OK);
    assert_true(mean.n > 0);
    for (uint32_t i = 0; i < mean.n; i++)
        assert_true(fabsf(mean.row[i]) < 1e-5f);
    cn_tile_close(&tile);
}

/* How far the codes of photos lie from the mean of their run (photos taken in turn in one and in the other), rms over
 * all numbers. */
static double spread_of_codes(const char *name)
{
    char path[160];
    const cn_train_options o = synthetic_options();
    turn_on("appearance", NULL);
    assert_int_equal(train(2, &o, name, NULL, path), CN_OK);
    cn_tile *tile = NULL;
    cn_appearance row, mean[2] = { { 0 }, { 0 } };
    double sum = 0;
    assert_int_equal(cn_tile_open(&tile, path), CN_OK);
    for (int pass = 0; pass < 2; pass++)
        for (uint32_t i = 0; i < synthetic.tile.n_photos; i++) {
            const cn_view *view = &synthetic.scene.views[synthetic.tile.photos[i]];
            cn_appearance *m = &mean[view->photo % 2];
            assert_int_equal(cn_tile_appearance(tile, view->name, &row), CN_OK);
            for (uint32_t c = 0; c < row.n; c++) {
                if (pass == 0)
                    m->row[c] += row.row[c] / (float)((synthetic.tile.n_photos + 1) / 2);
                else
                    sum += (double)((row.row[c] - m->row[c]) * (row.row[c] - m->row[c]));
            }
        }
    cn_tile_close(&tile);
    return sqrt(sum / (synthetic.tile.n_photos * (double)row.n));
}

/* Photos of one capture run have one light, so their codes are drawn together. Photos of unknown time are not. */
static void test_codes_of_a_run_stay_together(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < synthetic.index.n_photos; i++)
        synthetic.index.photos[i].time_s = NAN;
    const double loose = spread_of_codes("loose");
    for (uint32_t i = 0; i < synthetic.index.n_photos; i++)
        synthetic.index.photos[i].time_s = 1.7e9 + 10 * i + (i % 2 ? 36000 : 0);
    const double drawn = spread_of_codes("drawn");
    print_message("codes about their run's mean: %.4f, of unknown times %.4f\n", drawn, loose);
    assert_true(drawn < 0.75 * loose);
    for (uint32_t i = 0; i < synthetic.index.n_photos; i++)
        synthetic.index.photos[i].time_s = 0;
}

/* While space is full of fog the march is coarse, 0.125 of the distance at first; at the end it may take more samples a
 * ray. */
static void test_the_march_ends_fine(void **state)
{
    (void)state;
    char path[160];
    cn_train_options o = synthetic_options();
    o.steps = 200;
    o.march_step = 1.0 / 128;
    turn_on(NULL, NULL);
    assert_int_equal(train(2, &o, "march", NULL, path), CN_OK);
    cn_tile *tile = NULL;
    assert_int_equal(cn_tile_open(&tile, path), CN_OK);
    assert_true(tile->box.step < 0.09f);
    cn_tile_close(&tile);
}

/* The distance in metres from the middle of the scene to rays that should go through it. The cameras are turned by a
 * given angle each, and then corrected by what the tile learned. */
static double passes_by(double (*by)[3], const char *path)
{
    double sum = 0, half = 0;
    cn_bundle *bundle = NULL;
    const cn_tensor *learned = NULL;
    if (path) {
        assert_int_equal(cn_bundle_open(&bundle, path, true), CN_OK);
        learned = cn_bundle_find(bundle, "effect.pose_refinement.params");
        assert_non_null(learned);
    }
    for (int a = 0; a < 3; a++)
        half += (synthetic.tile.bounds_max[a] - synthetic.tile.bounds_min[a]) / 6;
    for (uint32_t i = 0; i < synthetic.tile.n_photos; i++) {
        const float none[6] = { 0 }, *row = learned ? (const float *)learned->data + 12 * (size_t)i : none;
        double at[3], ahead[3], turn[3], side[3], off[3];
        cn_view_centre(&synthetic.scene.views[synthetic.tile.photos[i]], at);
        for (int a = 0; a < 3; a++) {
            ahead[a] = -at[a];
            at[a] += 0.2 * half * (double)row[3 + a];
            turn[a] = by[i][a] + (double)row[a];
        }
        cn_normalize3(ahead);
        cn_cross3(turn, ahead, side);
        for (int a = 0; a < 3; a++)
            ahead[a] += side[a];
        cn_normalize3(ahead);
        cn_cross3(at, ahead, off);
        sum += cn_norm3(off) / synthetic.tile.n_photos;
    }
    cn_bundle_destroy(&bundle);
    return sum;
}

/* Cameras that are turned by a few degrees each turn back. In so small a scene and so short a time they do not turn
 * back all the way; the benchmark measures it on a city. */
static void test_poses_are_mended(void **state)
{
    (void)state;
    if (!MEASURES) skip();
    enum { MOST = 64 };
    static double by[MOST][3];
    static cn_view kept[MOST];
    char path[160];
    cn_train_options o = synthetic_options();
    o.steps = 1000;
    assert_true(synthetic.tile.n_photos <= MOST);
    for (uint32_t i = 0; i < synthetic.tile.n_photos; i++) {
        cn_view *view = &synthetic.scene.views[synthetic.tile.photos[i]];
        double centre[3], back[9], away[3];
        kept[i] = *view;
        for (int a = 0; a < 3; a++)
            by[i][a] = 0.06 * (double)(cn_rng_float(5, 1, 3 * i + (uint32_t)a) - 0.5f);
        const double quaternion[4] = { 1, -by[i][0] / 2, -by[i][1] / 2, -by[i][2] / 2 };
        cn_view_centre(view, centre);
        cn_quat_to_mat3(quaternion, back);
        cn_mat3_mul(kept[i].rotation, back, view->rotation);
        cn_mat3_vec(view->rotation, centre, away);
        for (int a = 0; a < 3; a++)
            view->translation[a] = -away[a];
    }
    turn_on("pose_refinement", NULL);
    assert_int_equal(train(2, &o, "mended", NULL, path), CN_OK);
    const double before = passes_by(by, NULL), after = passes_by(by, path);
    print_message("rays pass the middle by %.3f m, after training %.3f\n", before, after);
    assert_true(after < 0.8 * before);
    for (uint32_t i = 0; i < synthetic.tile.n_photos; i++)
        synthetic.scene.views[synthetic.tile.photos[i]] = kept[i];
}

/* Acts like a busy machine, on which the same steps take seconds longer. */
static void sleep_once(void *user, const cn_progress_report *report)
{
    bool *slept = user;
    (void)report;
    if (!*slept) usleep(2200000);
    *slept = true;
}

static void test_psnr_is_of_steps_not_of_seconds(void **state)
{
    (void)state;
    turn_on(NULL, NULL);
    cn_train_options o = synthetic_options();
    o.steps = 40;
    double psnr[2];
    for (int busy = 0; busy < 2; busy++) {
        bool slept = false;
        const cn_context ctx = { .progress = busy ? sleep_once : NULL, .user = &slept };
        const cn_train_input input = { &synthetic.scene, &synthetic.index, synthetic.pixels, &synthetic.tile };
        cn_train_result result;
        char dir[128];
        snprintf(dir, sizeof dir, "%s/busy%d", synthetic.folder, busy);
        assert_int_equal(cn_train_tile(&ctx, &input, &o, "parent", dir, &result), CN_OK);
        psnr[busy] = result.train_psnr;
        assert_true(slept == (busy == 1));
    }
    assert_true(isfinite(psnr[0]) && psnr[0] == psnr[1]);
}

static void test_held_out_is_refused(void **state)
{
    (void)state;
    const cn_train_options o = synthetic_options();
    char path[160];
    const uint32_t kept = synthetic.tile.held_out[0];
    synthetic.tile.held_out[0] = synthetic.tile.photos[0];
    turn_on("view_dependence", NULL);
    assert_int_equal(train(1, &o, "refused", NULL, path), CN_ERR_INTERNAL);
    assert_non_null(strstr(cn_error_message(), "held-out"));
    synthetic.tile.held_out[0] = kept;
}

/* What the forecast says, with a thread a processor, is what a training of that many threads allocates and uses, to the
 * byte: without an effect, with each, and with all. */
static void test_cost_is_the_arena(void **state)
{
    (void)state;
    const unsigned threads = (unsigned)sysconf(_SC_NPROCESSORS_ONLN);
    const cn_train_options o = synthetic_options();
    const cn_train_input input = { &synthetic.scene, &synthetic.index, synthetic.pixels, &synthetic.tile };
    cn_trainer *t = calloc(1, sizeof *t);
    assert_non_null(t);
    for (uint32_t e = 0; e <= cn_effect_count + 1; e++) {
        double seconds;
        uint64_t bytes;
        if (e == cn_effect_count + 1)
            turn_all_on();
        else
            turn_on(e < cn_effect_count ? cn_effect_list[e]->name : NULL, NULL);
        cn_train_cost(&o, &synthetic.tile, &seconds, &bytes);
        memset(t, 0, sizeof *t);
        assert_int_equal(cn_trainer_plan(t, &input, &o, threads), CN_OK);
        assert_int_equal(cn_arena_init(&t->arena, bytes), CN_OK);
        cn_trainer_carve(t, &t->arena);
        assert_int_equal(t->arena.used, bytes);
        assert_non_null(t->workers[threads - 1].part.touched); /* the last that is carved: all of it fitted */
        cn_trainer_deinit(t);
    }
    free(t);
    const cn_context ctx = { 0 };
    cn_train_result result;
    cn_train_speed *speed;
    cn_train_options timed = o;
    char dir[128];
    double seconds;
    uint64_t bytes;
    timed.time_budget_s = 1; /* nothing has to be measured */
    assert_int_equal(cn_train_speed_create(&speed, NULL), CN_OK);
    assert_int_equal(cn_train_speed_predict(&ctx, speed, &timed, &synthetic.tile, &seconds, &bytes), CN_OK);
    cn_train_speed_destroy(&speed);
    snprintf(dir, sizeof dir, "%s/cost", synthetic.folder);
    assert_int_equal(cn_train_tile(&ctx, &input, &o, "parent", dir, &result), CN_OK);
    assert_int_equal(result.arena_bytes, bytes);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_threads_change_nothing),
        cmocka_unit_test(test_resume_gives_the_same_bytes),
        cmocka_unit_test(test_learns_and_exposure_helps),
        cmocka_unit_test(test_black_ground_is_matter),
        cmocka_unit_test(test_what_leads_a_schedule),
        cmocka_unit_test(test_codes_have_zero_mean),
        cmocka_unit_test(test_codes_of_a_run_stay_together),
        cmocka_unit_test(test_the_march_ends_fine),
        cmocka_unit_test(test_poses_are_mended),
        cmocka_unit_test(test_psnr_is_of_steps_not_of_seconds),
        cmocka_unit_test(test_held_out_is_refused),
        cmocka_unit_test(test_cost_is_the_arena),
    };
    return cmocka_run_group_tests(tests, make, unmake);
}
