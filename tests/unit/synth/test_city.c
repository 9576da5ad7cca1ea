/* A synthetic city on disk: the same bytes each time, EXIF and poses that agree with the truth, views under any light.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../common.h"
#include "base/file.h"
#include "base/srgb.h"
#include "base/hash.h"
#include "base/json.h"
#include "bridge/oiio.h"
#include "conurb/geo.h"
#include "conurb/photo.h"
#include "conurb/pose.h"
#include "math/linalg.h"
#include "synth/light.h"
#include "synth/synth.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static char folder[] = "/tmp/conurb-synth-XXXXXX";
static char *first, *second;
static json_t *truth;

#define must(call)                                                                                                     \
    do {                                                                                                               \
        if ((call) != CN_OK) fail_msg("%s", cn_error_message());                                                       \
    } while (0)

static cn_synth_options small(void)
{
    cn_synth_options o = cn_synth_options_default();
    o.seed = 5;
    o.n_photos = 6;
    o.n_runs = 2;
    o.width = 96;
    o.height = 64;
    o.size_m = 40;
    return o;
}

static int set_up(void **state)
{
    (void)state;
    const cn_synth_options o = small();
    cn_context ctx = { 0 };
    if (!mkdtemp(folder) || cn_pool_create(&ctx.pool, 3) != CN_OK) return -1;
    first = cn_path_join(folder, "first");
    second = cn_path_join(folder, "second");
    char *path = cn_path_join(first, "truth/truth.json");
    const bool done = cn_synth_make(&ctx, first, &o) == CN_OK && cn_synth_make(NULL, second, &o) == CN_OK &&
                      cn_json_load(path, &truth) == CN_OK;
    if (!done) fprintf(stderr, "synthetic city: %s\n", cn_error_message());
    free(path);
    cn_pool_destroy(&ctx.pool);
    return done ? 0 : -1;
}

static int tear_down(void **state)
{
    (void)state;
    free(first);
    free(second);
    json_decref(truth);
    return folder_remove(folder);
}

static const json_t *photo_truth(size_t i)
{
    return json_array_get(json_object_get(truth, "photos"), i);
}
static const char *photo_name(size_t i)
{
    return json_string_value(json_object_get(photo_truth(i), "name"));
}
static double number(const json_t *object, const char *key)
{
    double value = NAN;
    must(cn_json_number(object, "truth.json", key, &value));
    return value;
}
/* ROOT/FOLDER/NAME with another ending. */
static char *file(const char *root, const char *where, const char *name, const char *ending)
{
    return cn_format("%s/%s/%.*s%s", root, where, (int)(strrchr(name, '.') - name), name, ending);
}

static uint64_t hash_of(const char *path)
{
    uint64_t hash = 0;
    must(cn_hash_file(path, &hash));
    return hash;
}

static void the_same_seed_gives_the_same_bytes(void **state)
{
    (void)state;
    static const char *const kinds[][2] = { { "photos", ".jpg" },
                                            { "truth/views", ".exr" },
                                            { "truth/masks", ".png" } };
    for (size_t i = 0; i < 6; i++)
        for (size_t k = 0; k < 3; k++) {
            char *a = file(first, kinds[k][0], photo_name(i), kinds[k][1]),
                 *b = file(second, kinds[k][0], photo_name(i), kinds[k][1]);
            assert_int_equal(hash_of(a), hash_of(b));
            free(a);
            free(b);
        }
    char *a = cn_path_join(first, "truth/truth.json"), *b = cn_path_join(second, "truth/truth.json");
    assert_int_equal(hash_of(a), hash_of(b));
    free(a);
    free(b);
}

static void exif_agrees_with_the_truth(void **state)
{
    (void)state;
    cn_photo_index index;
    cn_frame frame;
    char *photos = cn_path_join(first, "photos"), *path = cn_path_join(first, "truth/frame.json");
    must(cn_photo_index_scan(NULL, photos, &index));
    must(cn_frame_load(&frame, path));
    assert_int_equal(index.n_photos, 6);
    assert_int_equal(index.n_gps, 6);
    double off = 0;
    for (uint32_t i = 0; i < index.n_photos; i++) {
        const cn_photo *p = &index.photos[i];
        const json_t *t = photo_truth(i);
        double centre[3], at[3];
        must(cn_json_numbers(t, "truth.json", "centre_m", centre, 3));
        assert_string_equal(p->name, photo_name(i));
        assert_true(p->has_altitude && p->orientation == 1 && p->width == 96 && p->height == 64);
        must(cn_frame_from_geodetic(&frame, (double[3]){ p->latitude_deg, p->longitude_deg, p->altitude_m }, at));
        for (int a = 0; a < 3; a++)
            assert_true(fabs(at[a] - centre[a]) < (a == 2 ? 1.5 : 1) * 4.5);
        off += fabs(at[0] - centre[0]) + fabs(at[1] - centre[1]);
        assert_true(fabs(cn_photo_exposure_ev(p) - (CN_SYNTH_REFERENCE_EV + log2(number(t, "gain")))) < 0.01);
        assert_true(fabs(p->f_number - number(t, "f_number")) < 1e-6 && fabs(p->iso - number(t, "iso")) < 1e-6);
        const bool air = json_is_true(json_object_get(t, "aerial"));
        assert_true(fabs(p->focal_35mm - (air ? 28 : 24)) < 1e-6);
        assert_true(isfinite(p->focal_mm));
        const json_t *run = json_array_get(json_object_get(truth, "runs"), (size_t)number(t, "run"));
        assert_true(p->time_s >= number(run, "start_s") && p->time_s < number(run, "start_s") + 3600);
        assert_non_null(strstr(p->camera, air ? "Swift" : "Walker"));
    }
    assert_true(off > 0.5); /* the noise is there */
    cn_photo_index_deinit(&index);
    free(photos);
    free(path);
}

/* Both forms in which poses are written say the same. */
static void poses_agree(void **state)
{
    (void)state;
    cn_photo_index index;
    cn_scene json, model;
    char *photos = cn_path_join(first, "photos"), *transforms = cn_path_join(first, "truth/transforms.json");
    char *colmap = cn_path_join(first, "truth/model");
    must(cn_photo_index_scan(NULL, photos, &index));
    must(cn_scene_read_transforms(NULL, &json, transforms, &index));
    must(cn_scene_read_colmap(&model, colmap));
    assert_int_equal(json.n_views, 6);
    assert_int_equal(model.n_views, 6);
    for (uint32_t i = 0; i < 6; i++) {
        const cn_view *a = &json.views[i], *b = &model.views[i];
        double centre[3];
        assert_string_equal(a->name, b->name);
        must(cn_json_numbers(photo_truth(i), "truth.json", "centre_m", centre, 3));
        for (int k = 0; k < 9; k++)
            assert_true(fabs(a->rotation[k] - b->rotation[k]) < 1e-9);
        double ca[3], cb[3];
        cn_view_centre(a, ca);
        cn_view_centre(b, cb);
        for (int k = 0; k < 3; k++)
            assert_true(fabs(ca[k] - centre[k]) < 1e-9 && fabs(cb[k] - centre[k]) < 1e-9);
        const double place[3] = { 0.7, -0.4, 1.5 };
        double p[2], q[2];
        assert_true(cn_camera_project(&json.cameras[a->camera], place, p) &&
                    cn_camera_project(&model.cameras[b->camera], place, q));
        assert_true(hypot(p[0] - q[0], p[1] - q[1]) < 1e-6);
    }
    assert_true(model.n_points > 20); /* where they should be, in each photo that shows them */
    for (uint32_t i = 0; i < model.n_points; i++) {
        const cn_point *point = &model.points[i];
        assert_true(point->n_observations >= 3);
        for (uint32_t k = 0; k < point->n_observations; k++) {
            const cn_observation *seen = &model.observations[point->first_observation + k];
            const cn_view *view = &model.views[seen->view];
            double at[3], pixel[2];
            cn_mat3_vec(view->rotation, point->xyz, at);
            for (int a = 0; a < 3; a++)
                at[a] += view->translation[a];
            assert_true(cn_camera_project(&model.cameras[view->camera], at, pixel));
            assert_true(hypot(pixel[0] - (double)seen->x_px, pixel[1] - (double)seen->y_px) < 1e-2);
        }
    }
    cn_scene_deinit(&json);
    cn_scene_deinit(&model);
    cn_photo_index_deinit(&index);
    free(photos);
    free(transforms);
    free(colmap);
}

static float encoded(float x)
{
    return (float)cn_srgb_encode(x);
}

/* Where the mask is white, a photo is the clean view at its exposure and white balance; where it is black, it is not.
 */
static void photos_are_clean_views_where_masks_are_white(void **state)
{
    (void)state;
    static const float to_srgb[9] = { 1.70505f,  -0.62179f, -0.08326f, -0.13026f, 1.1408f,
                                      -0.01055f, -0.024f,   -0.12897f, 1.15297f };
    double inside = 0, outside = 0;
    size_t n_inside = 0, n_outside = 0;
    for (size_t i = 0; i < 6; i++) {
        float *photo, *clean, *mask;
        uint32_t w, h;
        double balance[3];
        char *paths[3] = { file(first, "photos", photo_name(i), ".jpg"),
                           file(first, "truth/views", photo_name(i), ".exr"),
                           file(first, "truth/masks", photo_name(i), ".png") };
        must(cn_oiio_read_rgba(paths[0], &photo, &w, &h));
        must(cn_oiio_read_rgba(paths[1], &clean, &w, &h));
        must(cn_oiio_read_rgba(paths[2], &mask, &w, &h));
        must(cn_json_numbers(photo_truth(i), "truth.json", "white_balance", balance, 3));
        for (size_t p = 0; p < (size_t)w * h; p++) {
            double off = 0;
            for (size_t c = 0; c < 3; c++) {
                float x = 0;
                for (size_t k = 0; k < 3; k++)
                    x += to_srgb[3 * c + k] * clean[4 * p + k];
                x *= (float)(number(photo_truth(i), "gain") * balance[c]);
                off += fabs(photo[4 * p + c] - encoded(fminf(fmaxf(x, 0), 1))) / 3;
            }
            if (mask[4 * p] > 0.5f)
                inside += off, n_inside++;
            else
                outside += off, n_outside++;
        }
        for (int k = 0; k < 3; k++)
            free(paths[k]);
        free(photo);
        free(clean);
        free(mask);
    }
    assert_true(n_outside > 50 && n_inside > 20 * n_outside / 10);
    assert_true(inside / (double)n_inside < 0.025);
    assert_true(outside / (double)n_outside > 4 * inside / (double)n_inside);
}

static void any_view_comes_back_under_any_light(void **state)
{
    (void)state;
    char *again = cn_path_join(folder, "again.exr"), *other = cn_path_join(folder, "other.exr");
    char *view = file(first, "truth/views", photo_name(0), ".exr");
    must(cn_synth_render(NULL, first, photo_name(0), NULL, again));
    assert_int_equal(hash_of(again), hash_of(view));
    must(cn_synth_render(NULL, first, "0", "run1-overcast", other));
    assert_true(hash_of(other) != hash_of(view));
    assert_int_equal(cn_synth_render(NULL, first, "nothing", NULL, other), CN_ERR_USAGE);
    assert_non_null(strstr(cn_error_message(), "nothing"));
    assert_int_equal(cn_synth_render(NULL, first, "0", "run9-rain", other), CN_ERR_USAGE);
    assert_int_equal(cn_synth_render(NULL, folder, "0", NULL, other), CN_ERR_IO);
    free(again);
    free(other);
    free(view);
}

/* Without people and cars, a photo keeps its exposure and its place: it changes where they were, and nowhere else. */
static void an_empty_city_is_the_same_but_for_people(void **state)
{
    (void)state;
    cn_synth_options o = small();
    o.empty = true;
    char *empty = cn_path_join(folder, "empty"), *path = cn_path_join(empty, "truth/truth.json");
    json_t *alone;
    must(cn_synth_make(NULL, empty, &o));
    must(cn_json_load(path, &alone));
    double off[2] = { 0, 0 }, n[2] = { 0, 0 };
    for (size_t i = 0; i < 6; i++) {
        const json_t *other = json_array_get(json_object_get(alone, "photos"), i);
        assert_true(number(other, "gain") == number(photo_truth(i), "gain"));
        char *paths[4] = { file(first, "photos", photo_name(i), ".jpg"), file(empty, "photos", photo_name(i), ".jpg"),
                           file(first, "truth/masks", photo_name(i), ".png"),
                           file(empty, "truth/masks", photo_name(i), ".png") };
        float *pixels[4];
        uint32_t w, h;
        for (int k = 0; k < 4; k++)
            must(cn_oiio_read_rgba(paths[k], &pixels[k], &w, &h));
        for (size_t p = 0; p < (size_t)w * h; p++) {
            const int disturbed = pixels[2][4 * p] < 0.5f;
            n[disturbed]++;
            off[disturbed] += fabs((double)(pixels[0][4 * p + 1] - pixels[1][4 * p + 1]));
            assert_true(pixels[3][4 * p] > 0.5f);
        }
        for (int k = 0; k < 4; k++) {
            free(pixels[k]);
            free(paths[k]);
        }
    }
    assert_true(off[1] / n[1] > 8 * off[0] / n[0]); /* JPEG spreads a little of it */
    json_decref(alone);
    free(empty);
    free(path);
}

/* Plain photos are all of the first run, also by their EXIF, and at one exposure. */
static void plain_photos_are_of_one_run(void **state)
{
    (void)state;
    cn_synth_options o = small();
    o.plain = true;
    char *plain = cn_path_join(folder, "plain"), *photos = cn_path_join(plain, "photos");
    cn_photo_index index;
    must(cn_synth_make(NULL, plain, &o));
    must(cn_photo_index_scan(NULL, photos, &index));
    assert_int_equal(index.n_photos, 6);
    const double start = number(json_array_get(json_object_get(truth, "runs"), 0), "start_s");
    for (uint32_t i = 0; i < index.n_photos; i++) {
        const cn_photo *p = &index.photos[i];
        assert_true(p->time_s >= start && p->time_s < start + 3600);
        assert_true(fabs(cn_photo_exposure_ev(p) - CN_SYNTH_REFERENCE_EV) < 0.01);
        for (uint32_t k = 0; k < i; k++)
            assert_true(p->time_s > index.photos[k].time_s || p->time_s < index.photos[k].time_s);
    }
    cn_photo_index_deinit(&index);
    free(photos);
    free(plain);
}

static void wrong_options_are_named(void **state)
{
    (void)state;
    cn_synth_options o = small();
    o.n_runs = 0;
    assert_int_equal(cn_synth_make(NULL, folder, &o), CN_ERR_USAGE);
    assert_non_null(strstr(cn_error_message(), "--runs"));
    o = small();
    o.gps_noise_m = NAN;
    assert_int_equal(cn_synth_make(NULL, folder, &o), CN_ERR_USAGE);
    assert_non_null(strstr(cn_error_message(), "--gps-noise"));
    o = small();
    assert_int_equal(cn_synth_make(NULL, first, &o), CN_ERR_USAGE);
    assert_non_null(strstr(cn_error_message(), "already"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_same_seed_gives_the_same_bytes),
        cmocka_unit_test(exif_agrees_with_the_truth),
        cmocka_unit_test(poses_agree),
        cmocka_unit_test(photos_are_clean_views_where_masks_are_white),
        cmocka_unit_test(any_view_comes_back_under_any_light),
        cmocka_unit_test(an_empty_city_is_the_same_but_for_people),
        cmocka_unit_test(plain_photos_are_of_one_run),
        cmocka_unit_test(wrong_options_are_named),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
