/* Normal maps give pairs of neighbouring rays on one plane; without them nothing is drawn otherwise. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/file.h"
#include "bridge/oiio.h"
#include "synthetic.h"
#include "train/sampler.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { PHOTOS = 3, WITH = 2, WIDTH = 48, HEIGHT = 36, GROUPS = 4, RAYS = GROUPS * CN_GROUP };

/* A plane in each camera's axes (OpenCV): unit, towards the camera. */
static const double plane[3] = { 0.36, -0.48, -0.8 };

typedef struct planted {
    synthetic_scene scene;
    cn_pixel_store *pixels;
    cn_train_photo photos[PHOTOS];
    cn_sampler sampler;
} planted;

/* Photos 0 to WITH - 1 have normals of the plane; that of the left half of photo 1 faces away. */
static void plant(planted *p)
{
    static float rgba[WIDTH * HEIGHT * 4];
    memset(p, 0, sizeof *p);
    synthetic_scene_init(&p->scene, PHOTOS);
    char *path = cn_format("%s/normals.bin", p->scene.folder);
    for (uint32_t i = 0; i < WITH; i++) {
        cn_photo *photo = &p->scene.index.photos[i];
        for (uint32_t k = 0; k < WIDTH * HEIGHT; k++) {
            const double sign = i == 1 && k % WIDTH < WIDTH / 2 ? -1 : 1;
            for (int a = 0; a < 3; a++)
                rgba[4 * k + (uint32_t)a] = (float)(sign * plane[a]);
            rgba[4 * k + 3] = 1;
        }
        photo->normal = cn_format("%s/normal%u.exr", p->scene.folder, i);
        photo->normal_axes = CN_NORMAL_OPENCV;
        assert_int_equal(cn_oiio_write_exr(photo->normal, rgba, NULL, WIDTH, HEIGHT, NULL), CN_OK);
    }
    assert_int_equal(cn_pixel_store_build(NULL, &p->scene.index, WIDTH, path), CN_OK);
    assert_int_equal(cn_pixel_store_open(&p->pixels, path), CN_OK);
    free(path);
    const cn_box box = { .half_extent = { 5, 5, 5 }, .near_m = 0.1f, .far_m = 100, .step = 0.01f };
    p->sampler = (cn_sampler){ .pixels = p->pixels, .seed = 5, .n_photos = PHOTOS, .photos = p->photos };
    p->sampler.near_m = box.near_m;
    p->sampler.pace.march_step = 0.01;
    for (uint32_t i = 0; i < PHOTOS; i++) {
        const cn_view *view = &p->scene.scene.views[i];
        cn_ray_generator_init(&p->photos[i].generator, &p->scene.scene.cameras[view->camera], view, &box);
        p->photos[i].store = i;
        p->photos[i].size = (cn_pixel_extent){ WIDTH, HEIGHT };
    }
}

static void uproot(planted *p)
{
    cn_pixel_store_close(&p->pixels);
    synthetic_scene_deinit(&p->scene);
}

typedef struct drawn {
    cn_ray rays[RAYS];
    float target[4 * RAYS], dirs[3 * RAYS], depth_m[RAYS], plane_log[RAYS], plane_width[RAYS], uv[2 * RAYS],
        first_t[RAYS];
    uint32_t ray_photo[RAYS];
    cn_batch batch;
} drawn;

static void draw(planted *p, uint32_t step, bool planes, drawn *d)
{
    memset(d, 0, sizeof *d);
    d->batch = (cn_batch){ .rays = d->rays,
                           .target = d->target,
                           .dirs = d->dirs,
                           .depth_m = d->depth_m,
                           .ray_photo = d->ray_photo,
                           .uv = d->uv,
                           .first_t = d->first_t,
                           .plane_log = planes ? d->plane_log : NULL,
                           .plane_width = planes ? d->plane_width : NULL };
    for (uint32_t g = 0; g < GROUPS; g++) {
        cn_sampler_draw(&p->sampler, step, (cn_lead){ 0 }, g, &d->batch);
        assert_int_equal(p->sampler.read_status[g], CN_OK);
    }
}

/* 1 over the distance along the ray to the plane at distance 1. */
static double closeness(const planted *p, const drawn *d, uint32_t r)
{
    const double *turn = p->photos[d->ray_photo[r]].generator.world_from_cam;
    double sum = 0;
    for (int a = 0; a < 3; a++)
        for (int c = 0; c < 3; c++)
            sum -= turn[3 * a + c] * plane[c] * (double)d->rays[r].dir[a];
    return sum;
}

static void neighbours_lie_on_one_plane(void **state)
{
    (void)state;
    static planted p;
    static drawn d, plain;
    plant(&p);
    cn_sampler_find_normals(&p.sampler);
    assert_int_equal(p.sampler.n_normal, WITH);
    uint32_t pairs = 0, away = 0, without = 0, alone = 0;
    for (uint32_t step = 0; step < 20; step++) {
        draw(&p, step, true, &d);
        draw(&p, step, false, &plain);
        for (uint32_t r = 0; r < RAYS; r += 2) {
            const uint32_t photo = d.ray_photo[r], moved = cn_sampler_is_neighbour(r + 1) && photo < WITH;
            assert_memory_equal(&d.rays[r], &plain.rays[r], sizeof *d.rays);
            if (!moved) assert_memory_equal(&d.rays[r + 1], &plain.rays[r + 1], sizeof *d.rays);
            without += !moved;
            if (!moved) {
                assert_true(d.plane_width[r] == 0 && d.plane_width[r + 1] == 0);
                continue;
            }
            alone += memcmp(&d.rays[r + 1], &plain.rays[r + 1], sizeof *d.rays) != 0;
            const double dx = (double)(d.uv[2 * r + 2] - d.uv[2 * r]) * WIDTH / 2,
                         dy = (double)(d.uv[2 * r + 3] - d.uv[2 * r + 1]) * HEIGHT / 2;
            assert_int_equal(d.ray_photo[r + 1], photo);
            assert_true(fabs(dx) < 2.01 && fabs(dy) < 2.01 && fabs(dx) + fabs(dy) > 0.99);
            if (photo == 1 && d.uv[2 * r] < 0) { /* faces away, or the two differ */
                assert_true(d.plane_width[r] == 0);
                away++;
                continue;
            }
            const double a = closeness(&p, &d, r), b = closeness(&p, &d, r + 1);
            if (!(d.plane_width[r] > 0)) {
                assert_true(a < 0.11 || b < 0.11 || photo == 1);
                continue;
            }
            assert_true(fabs((double)d.plane_log[r] - log(b / a)) < 0.01);
            assert_true(d.plane_log[r + 1] == -d.plane_log[r] && d.plane_width[r + 1] == d.plane_width[r]);
            assert_true(d.first_t[r + 1] == d.first_t[r]); /* so the march's steps do not tilt the plane */
            assert_true(plain.first_t[r + 1] != plain.first_t[r]);
            pairs++;
        }
    }
    assert_true(alone > 200); /* without planes these rays go through random pixels */
    assert_true(pairs > 100 && away > 20 && without > 500);
    uproot(&p);
}

/* Where no photo has a normal map, asking for them changes no byte of the tile. */
static void off_changes_no_byte(void **state)
{
    (void)state;
    synthetic_scene s;
    synthetic_scene_init(&s, 6);
    char *tiles[2];
    for (int k = 0; k < 2; k++) {
        const cn_train_input input = { &s.scene, &s.index, s.pixels, &s.tile };
        cn_train_options options = synthetic_options();
        cn_train_result result;
        options.steps = 40;
        options.normal_maps = k;
        char *dir = cn_format("%s/tile%d", s.folder, k);
        assert_int_equal(cn_folder_make(dir), CN_OK);
        assert_int_equal(cn_train_tile(&(cn_context){ 0 }, &input, &options, "parent", dir, &result), CN_OK);
        tiles[k] = cn_format("%s/tile.safetensors", dir);
        free(dir);
    }
    assert_true(same_bytes(tiles[0], tiles[1]));
    free(tiles[0]);
    free(tiles[1]);
    synthetic_scene_deinit(&s);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(neighbours_lie_on_one_plane),
                                        cmocka_unit_test(off_changes_no_byte) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
