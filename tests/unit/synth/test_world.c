/* Rays, light and pictures of a synthetic city, without files. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "conurb/colour.h"
#include "math/linalg.h"
#include "synth/noise.h"
#include "synth/picture.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static cn_world world;
static cn_rig rig;

static int set_up(void **state)
{
    (void)state;
    cn_synth_options o = cn_synth_options_default();
    o.seed = 3;
    o.n_photos = 8;
    o.n_runs = 1;
    o.width = 96;
    o.height = 64;
    o.size_m = 40;
    const bool good = cn_world_init(&world, &o) == CN_OK && cn_rig_init(&rig, &world) == CN_OK &&
                      cn_world_bake(NULL, &world, 0, 1) == CN_OK;
    if (!good) fprintf(stderr, "made world: %s\n", cn_error_message());
    return good ? 0 : -1;
}

static int tear_down(void **state)
{
    (void)state;
    cn_rig_deinit(&rig);
    cn_world_deinit(&world);
    return 0;
}

static void expose(uint32_t i, const cn_crowd *crowd, cn_film *film)
{
    cn_lens_table lens;
    const cn_camera *camera = &rig.cameras[rig.shots[i].camera];
    assert_int_equal(cn_lens_table_init(&lens, camera), CN_OK);
    assert_int_equal(cn_film_create(film, camera->width, camera->height), CN_OK);
    cn_film_expose(film, &(cn_exposure){ &world, &rig.shots[i], crowd, &lens, i, 0 }, 0, camera->height);
    cn_lens_table_deinit(&lens);
}

/* A place that one view's depth gives is met by a ray from another view at its own distance, or something stands before
 * it: a ray goes past it only where the place is the very edge of something. */
static void depths_of_views_agree(void **state)
{
    (void)state;
    uint32_t met = 0, hidden = 0, past = 0;
    for (uint32_t i = 0; i < rig.n_shots; i++) {
        const cn_shot *a = &rig.shots[i], *b = &rig.shots[(i + 1) % rig.n_shots];
        const cn_camera *camera = &rig.cameras[a->camera];
        cn_film film;
        expose(i, NULL, &film);
        for (uint32_t p = 0; p < camera->width * camera->height; p += 7) {
            double d[3], world_d[3], to[3];
            cn_hit hit;
            if (film.distance_m[p] <= 0) continue;
            assert_int_equal(cn_camera_unproject(camera, p % camera->width + 0.5, p / camera->width + 0.5, d), CN_OK);
            cn_mat3_tvec(a->rotation, d, world_d);
            for (int k = 0; k < 3; k++)
                to[k] = a->centre[k] + film.distance_m[p] * world_d[k] - b->centre[k];
            const double far = cn_norm3(to);
            cn_normalize3(to);
            assert_true(cn_tracer_hit(world.tracer, b->centre, to, 5000, &hit));
            if (far > 150) continue;
            if (fabs(hit.t - far) < 0.005)
                met++;
            else if (hit.t < far)
                hidden++;
            else
                past++;
        }
        cn_film_destroy(&film);
    }
    assert_true(met > hidden / 2 && met > 300);
    assert_true(past * 500 < met);
}

static void the_mask_is_where_the_crowd_changes_the_picture(void **state)
{
    (void)state;
    uint32_t masked = 0, changed = 0;
    for (uint32_t i = 0; i < rig.n_shots; i++) {
        cn_crowd crowd;
        cn_film film;
        assert_int_equal(cn_crowd_init(&crowd, &world, &rig.shots[i], i), CN_OK);
        expose(i, &crowd, &film);
        for (uint32_t p = 0; p < world.options.width * world.options.height; p++) {
            const bool same = memcmp(film.seen + 3 * p, film.clean + 3 * p, 3 * sizeof(float)) == 0;
            if (film.still[p] > 0.999f)
                assert_true(same);
            else
                masked++, changed += !same;
        }
        cn_film_destroy(&film);
        cn_crowd_deinit(&crowd);
    }
    assert_true(masked > 100);
    assert_int_equal(changed, masked);
}

static void cameras_stand_in_the_open(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < rig.n_shots; i++) {
        const cn_shot *s = &rig.shots[i];
        assert_true(s->centre[2] > 1 &&
                    s->centre[2] > cn_town_roof(&world.town, (float)s->centre[0], (float)s->centre[1], 0));
        for (int k = 0; k < 12; k++) {
            const double a = 0.5235987755982988 * k, d[3] = { cos(a), sin(a), 0 };
            assert_false(cn_tracer_blocked(world.tracer, s->centre, d, 0.5));
        }
        double product[9], transposed[9];
        cn_mat3_transpose(s->rotation, transposed);
        cn_mat3_mul(s->rotation, transposed, product);
        for (int k = 0; k < 9; k++)
            assert_true(fabs(product[k] - (k % 4 == 0)) < 1e-12);
        assert_true(s->rotation[5] < -0.5); /* up is up in the picture */
    }
}

/* At the equinoxes' noon the sun stands at 90 degrees less the latitude, in the south. */
static void the_sun_stands_where_it_should(void **state)
{
    (void)state;
    double elevation, azimuth;
    cn_light_sun(48, 81, 12, &elevation, &azimuth);
    assert_true(fabs(elevation - 42) < 0.5 && fabs(azimuth - 180) < 0.5);
    cn_light_sun(48, 81, 6, &elevation, &azimuth);
    assert_true(fabs(elevation) < 0.5 && fabs(azimuth - 90) < 1);
    cn_light_sun(-30, 172, 12, &elevation, &azimuth);
    assert_true(fabs(elevation - 36.5) < 0.5 && (azimuth < 1 || azimuth > 359));
}

static void light_is_finite_and_not_dark(void **state)
{
    (void)state;
    double sum = 0;
    const size_t n = 3 * (size_t)world.mesh.n_texels;
    for (size_t i = 0; i < n; i++) {
        assert_true(isfinite(world.ambient[0][i]) && world.ambient[0][i] >= 0);
        sum += world.ambient[0][i];
    }
    assert_true(sum / (double)n > 0.1 && sum / (double)n < 3);
}

/* A texture has no detail finer than a pixel: seen from very far, all of a wall is one colour or nearly. */
static void details_fade_with_distance(void **state)
{
    (void)state;
    float near = 0, far = 0;
    for (int i = 0; i < 200; i++) {
        near += fabsf(cn_noise_sum(0.37f * (float)i, 0.11f, 9, (cn_octaves){ 1, 0.7f, 5 }, 0.001f));
        far += fabsf(cn_noise_sum(0.37f * (float)i, 0.11f, 9, (cn_octaves){ 1, 0.7f, 5 }, 5));
    }
    assert_true(near > 20 && far == 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(depths_of_views_agree),
        cmocka_unit_test(the_mask_is_where_the_crowd_changes_the_picture),
        cmocka_unit_test(cameras_stand_in_the_open),
        cmocka_unit_test(the_sun_stands_where_it_should),
        cmocka_unit_test(light_is_finite_and_not_dark),
        cmocka_unit_test(details_fade_with_distance),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
