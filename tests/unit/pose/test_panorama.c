/* Photos of all directions for COLMAP: what the views show, and one pose out of those of the views. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../common.h"
#include "base/file.h"
#include "base/rng.h"
#include "base/units.h"
#include "bridge/oiio.h"
#include "math/linalg.h"
#include "pose/lens.h"
#include "pose/panorama.h"
#include "pose/scene.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { N = 8, N_POINTS = 300, WIDTH = 256, HEIGHT = 128, PIECES = N * CN_PANORAMA_VIEWS };
static char folder[64], logged[2048];
static cn_photo photos[N];
static cn_photo_index photo_index;
static cn_view truth[N];
static double points[N_POINTS][3];

static void note(void *user, cn_log_level level, const char *line)
{
    (void)user;
    (void)level;
    snprintf(logged, sizeof logged, "%s", line);
}

static const cn_context CONTEXT = { .log = note };

static double chance(uint32_t i, uint32_t k)
{
    return 2.0 * cn_rng_float(11, i, k) - 1.0;
}

/* Photos on a ring, a step apart, among points; every camera is turned in its own way. */
static int set_up(void **state)
{
    (void)state;
    static char names[N][8];
    strcpy(folder, "/tmp/conurb-rig-XXXXXX");
    if (!mkdtemp(folder)) return -1;
    for (uint32_t i = 0; i < N; i++) {
        snprintf(names[i], sizeof names[i], "%u.png", i);
        photos[i] = (cn_photo){
            .name = names[i], .width = WIDTH, .height = HEIGHT, .orientation = 1, .equirectangular = true, .hash = i + 1
        };
        const double q[4] = { 1, 0.1 * chance(i, 0), chance(i, 1), 0.1 * chance(i, 2) };
        const double turn = 2 * CN_PI * i / N, centre[3] = { 4 * cos(turn), 4 * sin(turn), chance(i, 3) };
        double moved[3];
        truth[i] = (cn_view){ .name = names[i], .photo = i };
        cn_quat_to_mat3(q, truth[i].rotation);
        cn_mat3_vec(truth[i].rotation, centre, moved);
        for (int k = 0; k < 3; k++)
            truth[i].translation[k] = -moved[k];
    }
    for (uint32_t p = 0; p < N_POINTS; p++)
        for (uint32_t k = 0; k < 3; k++)
            points[p][k] = (k == 2 ? 6 : 15) * chance(100 + p, k);
    photo_index = (cn_photo_index){ .folder = folder, .photos = photos, .n_photos = N };
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    return folder_remove(folder);
}

/* ---- the pictures ---- */

/* Red, green and blue are the direction in the photo's frame. */
static void write_photo(const char *path)
{
    const cn_camera whole = cn_camera_equirectangular(WIDTH, HEIGHT);
    float *rgb = malloc(sizeof *rgb * 3 * WIDTH * HEIGHT);
    assert_non_null(rgb);
    for (size_t i = 0; i < WIDTH * HEIGHT; i++) {
        double dir[3];
        assert_int_equal(cn_camera_unproject(&whole, (double)(i % WIDTH) + 0.5, (double)(i / WIDTH) + 0.5, dir), CN_OK);
        for (size_t c = 0; c < 3; c++)
            rgb[3 * i + c] = (float)(0.5 + 0.5 * dir[c]);
    }
    assert_int_equal(cn_oiio_write_png(path, rgb, WIDTH, HEIGHT, 3, NULL), CN_OK);
    free(rgb);
}

static void check_view(const char *path, unsigned k)
{
    const cn_camera camera = cn_panorama_view_camera(WIDTH);
    float *rgba;
    uint32_t w, h;
    double turn[9];
    assert_int_equal(cn_oiio_read_rgba(path, &rgba, &w, &h), CN_OK);
    assert_int_equal(w, camera.width);
    assert_int_equal(h, camera.height);
    cn_panorama_view_rotation(k, turn);
    for (size_t i = 0; i < (size_t)w * h; i += 7) {
        double in_view[3], dir[3];
        assert_int_equal(cn_camera_unproject(&camera, (double)(i % w) + 0.5, (double)(i / w) + 0.5, in_view), CN_OK);
        cn_mat3_tvec(turn, in_view, dir);
        for (size_t c = 0; c < 3; c++)
            assert_true(fabs((double)rgba[4 * i + c] - (0.5 + 0.5 * dir[c])) < 0.04); /* a JPEG */
    }
    free(rgba);
}

/* One photo of all directions among others: its views, and a link to each of the others. */
static void test_cut(void **state)
{
    (void)state;
    cn_panorama_cut cut;
    char *path = cn_path_join(folder, photos[3].name);
    for (uint32_t i = 0; i < N; i++)
        photos[i].equirectangular = i == 3;
    write_photo(path);
    free(path);
    assert_true(cn_panoramas_exist(&photo_index));
    assert_int_equal(cn_panorama_cut_make(&CONTEXT, &photo_index, folder, &cut), CN_OK);
    assert_int_equal(cut.n_panoramas, 1);
    assert_int_equal(cut.index.n_photos, N - 1 + CN_PANORAMA_VIEWS);
    for (uint32_t i = 1; i < cut.index.n_photos; i++)
        assert_true(strcmp(cut.index.photos[i - 1].name, cut.index.photos[i].name) < 0);
    for (uint32_t i = 0; i < cut.index.n_photos; i++) {
        if (cut.view[i] == CN_PANORAMA_WHOLE) continue;
        assert_int_equal(cut.photo[i], 3);
        path = cn_path_join(cut.index.folder, cut.index.photos[i].name);
        check_view(path, cut.view[i]);
        free(path);
    }
    assert_true(cut.index.photos[3].focal_px == 0.5 * cut.index.photos[3].width);
    cn_panorama_cut_deinit(&cut);
    photos[3].hash = 99; /* other bytes, which are no picture */
    path = cn_path_join(folder, photos[3].name);
    assert_int_equal(cn_file_write(path, "x", 1), CN_OK);
    assert_int_equal(cn_panorama_cut_make(&CONTEXT, &photo_index, folder, &cut), CN_ERR_FORMAT);
    assert_non_null(strstr(cn_error_message(), path));
    cn_panorama_cut_deinit(&cut);
    free(path);
}

/* ---- the poses ---- */

/* The cut without its pictures. */
static void list_cut(cn_panorama_cut *cut)
{
    *cut = (cn_panorama_cut){ .n_panoramas = N };
    cut->photo = calloc(PIECES, sizeof *cut->photo);
    cut->view = calloc(PIECES, sizeof *cut->view);
    for (uint32_t i = 0; i < PIECES; i++) {
        cut->photo[i] = i / CN_PANORAMA_VIEWS;
        cut->view[i] = (uint8_t)(i % CN_PANORAMA_VIEWS);
    }
}

/* What COLMAP gives: each view off by some hundredths of a step, some of them lost, one of them wrong; where each view
 * sees the points, 0.3 px off. */
static void make_pieces(cn_scene *s)
{
    const cn_camera camera = cn_panorama_view_camera(WIDTH);
    *s = (cn_scene){ .cameras = calloc(1, sizeof camera), .n_cameras = 1, .views = calloc(PIECES, sizeof *s->views) };
    s->cameras[0] = camera;
    s->points = calloc(N_POINTS, sizeof *s->points);
    s->observations = calloc((size_t)N_POINTS * PIECES, sizeof *s->observations);
    for (uint32_t i = 0; i < PIECES; i++) {
        const cn_view *of = &truth[i / CN_PANORAMA_VIEWS];
        double turn[9], exact[9], wobble[9], centre[3], moved[3];
        if (i % 7 == 5) continue; /* lost */
        const bool wrong = i == 9;
        const double q[4] = { 1, 0.004 * chance(i, 50), wrong ? 0.3 : 0.004 * chance(i, 51), 0.004 * chance(i, 52) };
        cn_view *view = &s->views[s->n_views++];
        *view = (cn_view){ .photo = i };
        cn_panorama_view_rotation(i % CN_PANORAMA_VIEWS, turn);
        cn_mat3_mul(turn, of->rotation, exact);
        cn_quat_to_mat3(q, wobble);
        cn_mat3_mul(wobble, exact, view->rotation);
        cn_view_centre(of, centre);
        for (uint32_t k = 0; k < 3; k++)
            centre[k] += 0.05 * chance(i, 60 + k) + (wrong ? 2 : 0);
        cn_mat3_vec(view->rotation, centre, moved);
        for (int k = 0; k < 3; k++)
            view->translation[k] = -moved[k];
    }
    for (uint32_t p = 0; p < N_POINTS; p++) {
        cn_point *point = &s->points[s->n_points++];
        *point = (cn_point){ .first_observation = (uint32_t)s->n_observations };
        for (int k = 0; k < 3; k++)
            point->xyz[k] = points[p][k] + 0.05 * chance(500 + p, (uint32_t)k);
        for (uint32_t v = 0; v < s->n_views; v++) {
            const uint32_t i = s->views[v].photo;
            const cn_view *of = &truth[i / CN_PANORAMA_VIEWS];
            double whole[3], turn[9], cam[3], xy[2];
            cn_mat3_vec(of->rotation, points[p], whole);
            for (int k = 0; k < 3; k++)
                whole[k] += of->translation[k];
            cn_panorama_view_rotation(i % CN_PANORAMA_VIEWS, turn);
            cn_mat3_vec(turn, whole, cam);
            if (!cn_camera_project(&camera, cam, xy) || !(xy[0] >= 0 && xy[1] >= 0) || xy[0] > camera.width ||
                xy[1] > camera.height)
                continue;
            s->observations[s->n_observations++] = (cn_observation){ v, (float)(xy[0] + 0.3 * chance(p, 1000 + i)),
                                                                     (float)(xy[1] + 0.3 * chance(p, 2000 + i)) };
            point->n_observations++;
        }
    }
}

/* Worst distance of centres from the truth after the best similarity, and worst turn against the first photo. */
static void compare(const cn_scene *s, double *far, double *turned_deg)
{
    double source[N][3], target[N][3];
    cn_similarity fit;
    for (uint32_t i = 0; i < N; i++) {
        cn_view_centre(&s->views[i], source[i]);
        cn_view_centre(&truth[i], target[i]);
    }
    const cn_similarity_task task = { N, (const double(*)[3])source, (const double(*)[3])target, 1.0, 1.0, 1, NULL };
    assert_int_equal(cn_pose_fit_similarity(&task, &fit, NULL), CN_OK);
    *far = *turned_deg = 0;
    for (uint32_t i = 0; i < N; i++) {
        double at[3], mine[9], back[9], rest[9];
        cn_mat3_vec(fit.rotation, source[i], at);
        for (int k = 0; k < 3; k++)
            at[k] = fit.scale * at[k] + fit.translation[k];
        *far = fmax(*far, cn_distance3(at, target[i]));
        cn_mat3_transpose(fit.rotation, back);
        cn_mat3_mul(s->views[i].rotation, back, mine);
        cn_mat3_transpose(truth[i].rotation, back);
        cn_mat3_mul(mine, back, rest);
        *turned_deg = fmax(*turned_deg, cn_degrees(acos(fmin(0.5 * (rest[0] + rest[4] + rest[8] - 1), 1))));
    }
}

static void test_join(void **state)
{
    (void)state;
    cn_panorama_cut cut;
    cn_scene pieces, joined;
    double far, turned_deg;
    list_cut(&cut);
    make_pieces(&pieces);
    assert_int_equal(cn_panorama_join(&CONTEXT, &cut, &photo_index, &pieces, false, &joined), CN_OK);
    assert_int_equal(joined.n_views, N);
    assert_int_equal(joined.n_cameras, 1);
    assert_int_equal(joined.cameras[0].lens, CN_LENS_EQUIRECTANGULAR);
    for (uint32_t i = 0; i < N; i++)
        assert_string_equal(joined.views[i].name, truth[i].name);
    assert_true(joined.n_points > N_POINTS * 3 / 4);
    /* A pixel is 1.4 degrees, and views were off by 5 cm and half a degree; 300 points bring them together. */
    compare(&joined, &far, &turned_deg);
    print_message("centres within %.4f, turns within %.3f degrees; %s\n", far, turned_deg, logged);
    assert_true(far < 0.03);
    assert_true(turned_deg < 0.2);
    assert_non_null(strstr(logged, "1 views disagree"));
    cn_scene_deinit(&joined);
    cn_scene_deinit(&pieces);
    free(cut.photo);
    free(cut.view);
}

/* All photos but the first as those of an ordinary camera: its focal length is adjusted, unless it is to stay. */
static void test_keep_focal(void **state)
{
    (void)state;
    const double focal_px = 0.5 * cn_panorama_view_camera(WIDTH).width;
    for (int keep = 0; keep < 2; keep++) {
        cn_panorama_cut cut;
        cn_scene pieces, joined;
        list_cut(&cut);
        make_pieces(&pieces);
        for (uint32_t i = 0; i < pieces.n_views; i++) {
            uint32_t *photo = &pieces.views[i].photo;
            if (cut.photo[*photo] == 0) continue;
            if (cut.view[*photo] == 0)
                cut.view[*photo] = CN_PANORAMA_WHOLE;
            else
                *photo = UINT32_MAX;
        }
        assert_int_equal(cn_panorama_join(&CONTEXT, &cut, &photo_index, &pieces, keep, &joined), CN_OK);
        const cn_camera *camera = &joined.cameras[joined.views[joined.n_views - 1].camera];
        assert_int_equal(camera->lens, CN_LENS_SIMPLE_PINHOLE);
        assert_int_equal(camera->params[0] == focal_px, keep);
        cn_scene_deinit(&joined);
        cn_scene_deinit(&pieces);
        free(cut.photo);
        free(cut.view);
    }
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = { TEST(test_cut), TEST(test_join), TEST(test_keep_focal) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
