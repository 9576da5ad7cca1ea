/* A ball with a pattern, in photos, and a field that shows it too far away. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "fixture.h"
#include "photo/store.h"
#include "surface/depth_maps.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

enum { VIEWS = 34, SIDE = 64, POINTS = 400 }; /* more views than are refined at once */
#define RADIUS 4.0
#define SHORT 0.15 /* by so much the field's ball is smaller */
#define CUBE 0.1
#define AWAY 12.0
#define STEP 0.06 /* radians between views, which lie on an arc */

static cn_camera camera = {
    .lens = CN_LENS_PINHOLE, .width = SIDE, .height = SIDE, .params = { 73, 73, SIDE / 2.0, SIDE / 2.0 }
};
static cn_view views[VIEWS];
static cn_point points[POINTS];
static cn_observation observations[POINTS * VIEWS];
static cn_scene scene = { .cameras = &camera,
                          .n_cameras = 1,
                          .views = views,
                          .n_views = VIEWS,
                          .points = points,
                          .n_points = POINTS,
                          .observations = observations };
static cn_frame frame;
static cn_colour *colour;
static cn_pool *pool;
static cn_pixel_store *pixels;
static char folder[] = "/tmp/conurb_refine_XXXXXX";
static int draws, stop;
static double stop_at; /* of the progress; 0: never */

static void place_views(void)
{
    for (uint32_t i = 0; i < VIEWS; i++) {
        const double turn = STEP * ((double)i - VIEWS / 2.0), centre[3] = { AWAY * cos(turn), AWAY * sin(turn), 0.5 };
        double z[3] = { -centre[0], -centre[1], -centre[2] };
        (void)cn_normalize3(z);
        view_along(&views[i], centre, z, (const double[3]){ 0, 0, 1 });
        views[i].photo = i;
    }
}

/* Distance along a ray to a ball in the middle; 0: it misses. */
static double hit(const double eye[3], const double dir[3], double radius)
{
    const double b = cn_dot3(eye, dir), d = b * b - cn_dot3(eye, eye) + radius * radius;
    return d > 0 ? -b - sqrt(d) : 0;
}

static float pattern(const double p[3])
{
    double sum = 0;
    for (int i = 0; i < 5; i++)
        sum += sin(p[0] * (2 + 1.3 * i) + 7 * i) * sin(p[1] * (2 + 1.9 * i) + 3 * i) + sin(p[2] * (3 + 2.1 * i) + i);
    return (float)(0.5 + 0.06 * sum);
}

static void ray_of(const cn_camera *c, const cn_view *v, uint32_t pixel, double eye[3], double dir[3])
{
    double in_camera[3];
    assert_int_equal(cn_camera_unproject(c, pixel % c->width + 0.5, pixel / c->width + 0.5, in_camera), CN_OK);
    cn_mat3_tvec(v->rotation, in_camera, dir);
    cn_view_centre(v, eye);
}

static cn_status draw(void *user, const cn_context *ctx, const cn_camera *c, const cn_view *view, cn_picture *p)
{
    (void)user;
    (void)ctx;
    draws++;
    for (uint32_t i = 0; i < c->width * c->height; i++) {
        double eye[3], dir[3];
        ray_of(c, view, i, eye, dir);
        const double depth = hit(eye, dir, RADIUS - SHORT);
        p->depth[i] = (float)depth;
        p->rgba[4 * i + 3] = 1; /* beside the ball there is sky */
    }
    return CN_OK;
}

static void take_photos(float *rgbw)
{
    for (uint32_t v = 0; v < VIEWS; v++)
        for (uint32_t i = 0; i < SIDE * SIDE; i++) {
            double eye[3], dir[3], p[3];
            ray_of(&camera, &views[v], i, eye, dir);
            const double depth = hit(eye, dir, RADIUS);
            for (int k = 0; k < 3; k++)
                p[k] = eye[k] + depth * dir[k];
            float *of = rgbw + 4 * ((size_t)v * SIDE * SIDE + i);
            of[0] = of[1] = of[2] = depth > 0 ? pattern(p) : 0.2f;
            of[3] = 1;
        }
}

/* Sparse points all over the side that the views look at. */
static void find_points(void)
{
    uint64_t n = 0;
    for (uint32_t i = 0; i < POINTS; i++) {
        const double z = 0.8 * (2 * ((i * 0.618034) - floor(i * 0.618034)) - 1), r = sqrt(1 - z * z),
                     turn = 2.4 * (i / (double)POINTS - 0.5);
        cn_point *p = &points[i];
        *p = (cn_point){ .xyz = { RADIUS * r * cos(turn), RADIUS * r * sin(turn), RADIUS * z },
                         .first_observation = (uint32_t)n };
        for (uint32_t v = 0; v < VIEWS; v++) {
            double eye[3], away[3], there[3], px[2];
            cn_view_centre(&views[v], eye);
            for (int k = 0; k < 3; k++)
                away[k] = eye[k] - p->xyz[k];
            if (cn_dot3(away, p->xyz) < 0.3 * AWAY * RADIUS) continue;
            cn_mat3_vec(views[v].rotation, p->xyz, there);
            for (int k = 0; k < 3; k++)
                there[k] += views[v].translation[k];
            if (!cn_camera_project(&camera, there, px) || px[0] < 0 || px[1] < 0 || px[0] >= SIDE || px[1] >= SIDE)
                continue;
            observations[n++] = (cn_observation){ v, (float)px[0], (float)px[1] };
            p->n_observations++;
        }
    }
    scene.n_observations = n;
}

static int begin(void **state)
{
    (void)state;
    float *rgbw = malloc(sizeof *rgbw * 4 * VIEWS * SIDE * SIDE);
    if (!rgbw) return -1;
    place_views();
    find_points();
    take_photos(rgbw);
    const cn_status status = cn_pixel_store_in_memory(&pixels, VIEWS, SIDE, SIDE, rgbw);
    free(rgbw);
    cn_frame_init(&frame);
    return status == CN_OK && mkdtemp(folder) && cn_colour_create(&colour, "") == CN_OK &&
                   cn_pool_create(&pool, 2) == CN_OK
               ? 0
               : -1;
}

static int end(void **state)
{
    (void)state;
    remove_folder(folder);
    cn_pixel_store_close(&pixels);
    cn_colour_destroy(&colour);
    cn_pool_destroy(&pool);
    return 0;
}

static void watch(void *user, const cn_progress_report *r)
{
    (void)user;
    if (stop_at > 0 && r->done >= stop_at) cn_stop(&stop);
}

static cn_status make(const char *name, const cn_pixel_store *by, uint64_t key, cn_surface_report *report)
{
    static const cn_surface_disc disc = { { 0, 0 }, 8 };
    const cn_context ctx = { .pool = pool, .stop = &stop, .progress = watch };
    const cn_surface_source source = { .scene = &scene,
                                       .frame = &frame,
                                       .draw = draw,
                                       .pixels = by,
                                       .discs = &disc,
                                       .n_discs = 1,
                                       .width_px = SIDE,
                                       .cube_m = CUBE,
                                       .colour = colour,
                                       .appearance = "mean",
                                       .key = key };
    return export_to(&ctx, &source, folder, name, report);
}

static void read_back(const char *name, char **data, size_t *size)
{
    read_from(folder, name, data, size);
}

/* The median over vertices that face the views' arc of how far they are from the middle; *most: over all vertices. */
static double radius_of(const char *name, const cn_surface_report *r, double *most)
{
    size_t size, n = 0;
    char *data;
    read_back(name, &data, &size);
    double *radius = malloc(sizeof *radius * r->n_vertices);
    const char *body = strstr(data, "end_header\n") + strlen("end_header\n");
    for (uint64_t i = 0; i < r->n_vertices; i++) {
        float v[3];
        memcpy(v, body + 27 * i, sizeof v);
        const double far = hypot(hypot((double)v[0], (double)v[1]), (double)v[2]);
        *most = fmax(*most, far);
        if (v[0] > 2 && fabsf(v[2]) < 2) radius[n++] = far;
    }
    assert_true(n > 1000);
    const double median = cn_select(radius, n, n / 2);
    free(radius);
    free(data);
    return median;
}

static void depths_move_to_where_the_photos_match(void **state)
{
    (void)state;
    cn_surface_report r;
    double most = 0;
    assert_int_equal(make("field.ply", NULL, 0, &r), CN_OK);
    const double field = radius_of("field.ply", &r, &most);
    assert_int_equal(make("stereo.ply", pixels, 0, &r), CN_OK);
    most = 0;
    const double stereo = radius_of("stereo.ply", &r, &most);
    print_message("radius %.3f by the field, %.3f by stereo, %g in truth; at most %.3f\n", field, stereo, RADIUS, most);
    assert_true(most < RADIUS + CUBE); /* 4.55 when sky beside the ball is moved too */
    assert_true(fabs(field - (RADIUS - SHORT)) < 0.2 * CUBE);
    assert_true(fabs(stereo - RADIUS) < 0.6 * CUBE); /* a pixel is 1.1 cubes wide */
}

/* Stopped while maps are refined: nothing is drawn again, and the mesh is that of the test above. */
static void a_stopped_refinement_goes_on(void **state)
{
    (void)state;
    char *whole, *resumed;
    size_t size, again;
    for (int late = 0; late < 2; late++) {
        stop_at = late ? 0.54 : 0.4; /* of 0.35 to 0.55 */
        assert_int_equal(make("resumed.ply", pixels, 9, NULL), CN_ERR_INTERRUPTED);
        draws = stop = 0;
        stop_at = 0;
        assert_int_equal(make("resumed.ply", pixels, 9, NULL), CN_OK);
        assert_int_equal(draws, 0);
        read_back("stereo.ply", &whole, &size);
        read_back("resumed.ply", &resumed, &again);
        assert_int_equal(size, again);
        assert_memory_equal(whole, resumed, size);
        free(whole);
        free(resumed);
    }
}

/* The refined maps are written through a mapping, where a full disk cannot be an error: their room is taken before. */
static void refined_maps_have_room_on_disk(void **state)
{
    (void)state;
    struct stat file;
    cn_depth_maps maps;
    const cn_context ctx = { .pool = pool };
    const cn_surface_source source = { .scene = &scene, .draw = draw, .width_px = SIDE, .colour = colour };
    char *path = cn_path_join(folder, "room.ply");
    assert_int_equal(cn_depth_maps_open(&maps, path, 0, VIEWS), CN_OK);
    for (uint32_t i = 0; i < VIEWS; i++)
        assert_int_equal(cn_depth_maps_add(&maps, &ctx, &source, &views[i]), CN_OK);
    assert_int_equal(cn_depth_maps_finish(&maps, true), CN_OK);
    assert_int_equal(fstat(maps.fd, &file), 0);
    assert_true((uint64_t)file.st_size == maps.mapped_size && 512 * (uint64_t)file.st_blocks >= maps.mapped_size);
    cn_depth_maps_close(&maps, false);
    free(path);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(depths_move_to_where_the_photos_match),
        cmocka_unit_test(a_stopped_refinement_goes_on),
        cmocka_unit_test(refined_maps_have_room_on_disk),
    };
    return cmocka_run_group_tests(tests, begin, end);
}
