/* Meshes of a ball whose shape is known, in views that are drawn by the test. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/json.h"
#include "fixture.h"
#include "surface/lattice.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { VIEWS = 26, SIDE = 160 };
#define RADIUS 4.0
#define CUBE 0.1 /* regions are 12.8 m wide, and meet in the ball's middle */

static cn_camera camera = { .lens = CN_LENS_PINHOLE, .width = SIDE, .height = SIDE, .params = { 130, 130, 80, 80 } };
static cn_view views[VIEWS];
static cn_scene scene = { .cameras = &camera, .n_cameras = 1, .views = views, .n_views = VIEWS };
static cn_frame frame;
static cn_colour *colour;
static cn_pool *pool;
static char folder[] = "/tmp/conurb_surface_XXXXXX";
static double hidden_x; /* the surface is drawn where x is below */
static bool speck;      /* a small ball beside the large one */
static uint64_t key;
static int draws, stop_at; /* stop_at: the draw that fails; 0: none */
static cn_status failure;  /* of that draw */
static double apart;       /* half of how far the views' depths are apart */
static bool by_distance;   /* the field's own distance is that of a ball which is larger by LARGER */
#define LARGER 0.07

/* Views from the 26 directions of a cube's corners, edges and sides, 12 m from the middle. */
static void place_views(void)
{
    for (int i = 0, n = 0; i < 27; i++) {
        double z[3] = { 1 - i % 3, 1 - i / 3 % 3, 1 - i / 9 };
        double centre[3];
        if (!cn_normalize3(z)) continue;
        for (int k = 0; k < 3; k++)
            centre[k] = -12 * z[k];
        view_along(&views[n++], centre, z, (const double[3]){ 0.1, 0.2, 1 });
    }
}

/* Distance along a ray to a ball; 0: it misses. */
static double hit(const double eye[3], const double dir[3], const double centre[3], double radius)
{
    const double from[3] = { eye[0] - centre[0], eye[1] - centre[1], eye[2] - centre[2] };
    const double b = cn_dot3(from, dir), d = b * b - cn_dot3(from, from) + radius * radius;
    return d > 0 ? -b - sqrt(d) : 0;
}

static cn_status draw(void *user, const cn_context *ctx, const cn_camera *c, const cn_view *view, cn_picture *p)
{
    static const double middle[3] = { 0 }, beside[3] = { 6, 0, 0 };
    double eye[3];
    (void)user;
    (void)ctx;
    if (++draws == stop_at) return cn_fail(failure, "stopped");
    cn_view_centre(view, eye);
    for (uint32_t i = 0; i < c->width * c->height; i++) {
        double in_camera[3], dir[3];
        CN_TRY(cn_camera_unproject(c, i % c->width + 0.5, i / c->width + 0.5, in_camera));
        cn_mat3_tvec(view->rotation, in_camera, dir);
        double depth = hit(eye, dir, middle, RADIUS);
        const double x = eye[0] + depth * dir[0];
        if (x > hidden_x) depth = 0;
        if (depth > 0) depth += apart * ((double)((view - views) * 7 % VIEWS) / 12.5 - 1);
        if (!(depth > 0) && speck) depth = hit(eye, dir, beside, 0.2);
        p->depth[i] = (float)depth;
        p->rgba[4 * i] = x > 0 ? 0.5f : 0;
        p->rgba[4 * i + 3] = depth > 0;
    }
    return CN_OK;
}

/* Unknown in the half where y is below 0. */
static void measure(void *user, unsigned worker, size_t n, const double (*xyz)[3], float *distance_m)
{
    (void)user;
    (void)worker;
    for (size_t i = 0; i < n; i++)
        distance_m[i] = xyz[i][1] < 0 ? NAN : (float)(cn_norm3(xyz[i]) - RADIUS - LARGER);
}

static int begin(void **state)
{
    (void)state;
    place_views();
    cn_frame_init(&frame);
    frame = (cn_frame){ .georeferenced = true,
                        .latitude_deg = 48,
                        .longitude_deg = 11,
                        .height_m = 500,
                        .scale = 1,
                        .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 } };
    return mkdtemp(folder) && cn_colour_create(&colour, "") == CN_OK && cn_pool_create(&pool, 2) == CN_OK ? 0 : -1;
}

static int end(void **state)
{
    (void)state;
    remove_folder(folder);
    cn_colour_destroy(&colour);
    cn_pool_destroy(&pool);
    return 0;
}

static cn_status make(const char *name, cn_pool *on, cn_surface_report *report)
{
    static const cn_surface_disc disc = { { 0, 0 }, 8 };
    const cn_context ctx = { .pool = on };
    const cn_surface_source source = { .scene = &scene,
                                       .frame = &frame,
                                       .draw = draw,
                                       .distance = by_distance ? measure : NULL,
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

/* Edges that belong to one triangle only; *twisted: those that two triangles run through in the same direction. */
static size_t open_edges(const uint8_t *faces, uint64_t n, size_t *twisted)
{
    cn_keys edges = { 0 };
    bool fresh;
    size_t open = 0;
    *twisted = 0;
    for (int pass = 0; pass < 2; pass++)
        for (uint64_t i = 0; i < n; i++) {
            uint32_t c[3];
            memcpy(c, faces + 13 * i + 1, sizeof c);
            for (int k = 0; k < 3; k++) {
                const uint64_t a = c[k] + 1, b = c[(k + 1) % 3] + 1;
                if (pass) {
                    open += cn_keys_find(&edges, b << 32 | a) == UINT32_MAX;
                    continue;
                }
                assert_int_equal(cn_keys_add(&edges, a << 32 | b, 0, &fresh), CN_OK);
                *twisted += !fresh;
            }
        }
    cn_keys_deinit(&edges);
    return open;
}

static void a_ball_is_closed_and_round(void **state)
{
    (void)state;
    cn_surface_report r;
    size_t size, twisted;
    hidden_x = 100;
    assert_int_equal(make("ball.ply", pool, &r), CN_OK);
    char *data;
    read_back("ball.ply", &data, &size);
    const size_t head = (size_t)(strstr(data, "end_header\n") - data) + strlen("end_header\n");
    assert_non_null(strstr(data, "latitude 48.000000000"));
    assert_non_null(strstr(data, "height 500.0000 m above the sea")); /* no geoid was applied */
    assert_non_null(strstr(data, "light: mean"));
    const char *body = data + head;
    assert_int_equal(size, head + 27 * r.n_vertices + 13 * r.n_triangles);
    assert_int_equal(r.n_vertices, r.n_triangles / 2 + 2); /* Euler, of a closed ball */
    for (uint64_t i = 0; i < r.n_vertices; i++) {
        float v[6];
        memcpy(v, body + 27 * i, sizeof v);
        const double at[3] = { (double)v[0], (double)v[1], (double)v[2] },
                     normal[3] = { (double)v[3], (double)v[4], (double)v[5] };
        assert_true(fabs(cn_norm3(at) - RADIUS) < 0.3 * CUBE);
        assert_true(cn_dot3(at, normal) > 0.95 * RADIUS);
        const uint8_t red = (uint8_t)body[27 * i + 24];
        if (fabs(at[0]) > 0.3) assert_true(at[0] > 0 ? red > 150 : red < 50);
    }
    assert_int_equal(open_edges((const uint8_t *)body + 27 * r.n_vertices, r.n_triangles, &twisted), 0);
    assert_int_equal(twisted, 0);
    char *beside;
    read_back("ball.frame.json", &beside, &size);
    free(beside);
    free(data);
}

/* Views whose depths are farther apart than the narrow band still show a whole surface. */
static void views_that_differ_agree(void **state)
{
    enum { HIGH = 40, ROUND = 120 }; /* squares of 0.2 m at the equator, of equal area */
    static bool there[HIGH][ROUND];
    (void)state;
    cn_surface_report r;
    size_t size, holes = 0;
    char *data;
    hidden_x = 100;
    apart = 0.75;
    assert_int_equal(make("apart.ply", pool, &r), CN_OK);
    apart = 0;
    read_back("apart.ply", &data, &size);
    const char *body = strstr(data, "end_header\n") + strlen("end_header\n");
    for (uint64_t i = 0; i < r.n_vertices; i++) {
        float v[3];
        memcpy(v, body + 27 * i, sizeof v);
        const double at[3] = { (double)v[0], (double)v[1], (double)v[2] }, radius = cn_norm3(at);
        if (!(fabs(radius - RADIUS) < 0.75)) fail_msg("a vertex is %g m off", radius - RADIUS);
        const int high = (int)(HIGH * fmin(0.5 + 0.5 * at[2] / radius, 0.9999));
        there[high][(int)(ROUND * fmin(0.5 + atan2(at[1], at[0]) / (2 * M_PI), 0.9999))] = true;
    }
    for (int i = 0; i < HIGH * ROUND; i++)
        holes += !there[i / ROUND][i % ROUND];
    if (holes > 100) fail_msg("%zu of %d squares are holes", holes, HIGH * ROUND); /* a narrow band leaves 407 */
    free(data);
}

/* Where a field has a distance of its own the mesh lies between its zero and what the depth maps say, else at these. */
static void a_distance_decides_half(void **state)
{
    (void)state;
    cn_surface_report r;
    size_t size, own = 0, shown = 0;
    char *data;
    hidden_x = 100;
    by_distance = true;
    assert_int_equal(make("distance.ply", pool, &r), CN_OK);
    by_distance = false;
    read_back("distance.ply", &data, &size);
    const char *body = strstr(data, "end_header\n") + strlen("end_header\n");
    for (uint64_t i = 0; i < r.n_vertices; i++) {
        float v[3];
        memcpy(v, body + 27 * i, sizeof v);
        const double at[3] = { (double)v[0], (double)v[1], (double)v[2] }, radius = cn_norm3(at);
        own += at[1] > CUBE && fabs(radius - RADIUS - LARGER / 2) < 0.2 * CUBE;
        shown += at[1] < -CUBE && fabs(radius - RADIUS) < 0.3 * CUBE;
        assert_true(fabs(at[1]) <= CUBE || fabs(radius - RADIUS - (at[1] > 0 ? LARGER / 2 : 0)) < 0.3 * CUBE);
    }
    assert_true(own > 0.4 * (double)r.n_vertices && shown > 0.4 * (double)r.n_vertices);
    free(data);
}

static void threads_do_not_matter(void **state)
{
    (void)state;
    size_t size, again;
    hidden_x = 1;
    assert_int_equal(make("two.ply", pool, NULL), CN_OK);
    assert_int_equal(make("one.ply", NULL, NULL), CN_OK);
    char *two, *one;
    read_back("two.ply", &two, &size);
    read_back("one.ply", &one, &again);
    assert_int_equal(size, again);
    assert_memory_equal(one, two, size);
    free(one);
    free(two);
}

/* What was drawn before the stop, or before a failure such as a full disk, is not drawn again, and the mesh is the
 * same. Another key begins anew, and wrong data leaves nothing. */
static void a_stopped_export_goes_on(void **state)
{
    (void)state;
    size_t size, again;
    char *depths = cn_path_join(folder, "two.ply.depths"), *whole, *resumed;
    hidden_x = 1;
    assert_int_equal(make("one.ply", pool, NULL), CN_OK);
    key = 7;
    for (int i = 0; i < 3; i++) {
        const bool other = i == 2;
        draws = 0;
        stop_at = 11;
        failure = i == 1 ? CN_ERR_IO : CN_ERR_INTERRUPTED;
        assert_int_equal(make("two.ply", pool, NULL), failure);
        assert_true(cn_file_exists(depths));
        draws = stop_at = 0;
        key += other;
        assert_int_equal(make("two.ply", pool, NULL), CN_OK);
        assert_int_equal(draws, other ? VIEWS : VIEWS - 10);
        assert_false(cn_file_exists(depths));
        read_back("one.ply", &whole, &size);
        read_back("two.ply", &resumed, &again);
        assert_int_equal(size, again);
        assert_memory_equal(whole, resumed, size);
        free(whole);
        free(resumed);
    }
    draws = 0;
    stop_at = 11;
    failure = CN_ERR_DATA;
    assert_int_equal(make("two.ply", pool, NULL), CN_ERR_DATA);
    assert_false(cn_file_exists(depths));
    key = 0;
    stop_at = 0;
    free(depths);
}

static void specks_are_dropped(void **state)
{
    (void)state;
    cn_surface_report with, without;
    hidden_x = 100;
    assert_int_equal(make("plain.ply", pool, &without), CN_OK);
    speck = true;
    assert_int_equal(make("speck.ply", pool, &with), CN_OK);
    speck = false;
    assert_int_equal(without.n_dropped, 0);
    assert_true(with.n_dropped > 20);
    assert_true(llabs((long long)with.n_triangles - (long long)without.n_triangles) < 50);
}

static void gltf_is_whole(void **state)
{
    (void)state;
    cn_surface_report r;
    size_t size;
    uint32_t head[5];
    double low[3];
    hidden_x = 0.5;
    assert_int_equal(make("ball.glb", pool, &r), CN_OK);
    char *data;
    read_back("ball.glb", &data, &size);
    memcpy(head, data, sizeof head);
    assert_int_equal(head[0], 0x46546c67);
    assert_int_equal(head[2], size);
    json_t *root = json_loadb(data + 20, head[3], 0, NULL);
    assert_non_null(root);
    const json_t *accessor = json_array_get(json_object_get(root, "accessors"), 0);
    assert_int_equal(json_integer_value(json_object_get(accessor, "count")), r.n_vertices);
    assert_int_equal(cn_json_numbers(accessor, "ball.glb", "min", low, 3), CN_OK);
    /* The ball is cut at x = 0.5; y is up, so its lowest place is -RADIUS on every axis. */
    for (int k = 0; k < 3; k++)
        assert_true(fabs(low[k] + RADIUS) < 0.3 * CUBE);
    const json_t *origin = json_object_get(json_object_get(root, "extras"), "origin_wgs84");
    assert_true(json_number_value(json_object_get(origin, "latitude_deg")) == 48);
    json_decref(root);
    uint32_t chunk;
    memcpy(&chunk, data + 20 + head[3], sizeof chunk);
    assert_int_equal(chunk, 32 * r.n_vertices + 12 * r.n_triangles);
    free(data);
    assert_int_equal(make("ball.obj", pool, &r), CN_OK);
    read_back("ball.obj", &data, &size);
    uint64_t faces = 0;
    for (const char *at = data; (at = strstr(at, "\nf ")); at++)
        faces++;
    assert_int_equal(faces, r.n_triangles);
    free(data);
}

static char *in_folder(const char *name)
{
    return cn_path_join(folder, name);
}

/* The ball against points of a ball that is 0.08 m larger: every distance is known. */
static void distances_are_as_made(void **state)
{
    (void)state;
    cn_surface_fit fit;
    hidden_x = 100;
    assert_int_equal(make("fit.ply", pool, NULL), CN_OK);
    char *mesh = in_folder("fit.ply"), *reference = in_folder("reference.ply");
    FILE *f = fopen(reference, "w");
    const int n = 20000;
    fprintf(f,
            "ply\nformat ascii 1.0\nelement vertex %d\nproperty float x\nproperty uchar red\nproperty double y\n"
            "property float z\nend_header\n",
            n);
    for (int i = 0; i < n; i++) {
        const double z = 1 - (2 * i + 1.0) / n, r = sqrt(1 - z * z), at = 2.399963229728653 * i, size = RADIUS + 0.08;
        fprintf(f, "%.6f 7 %.6f %.6f\n", size * r * cos(at), size * r * sin(at), size * z);
    }
    fclose(f);
    const cn_context ctx = { .pool = pool };
    assert_int_equal(cn_surface_compare(&ctx, mesh, reference, NULL, &fit), CN_OK);
    assert_int_equal(fit.from_reference.n, n);
    assert_true(fabs(fit.from_reference.median_m - 0.08) < 0.003);
    assert_true(fit.from_reference.within[0] < 0.05 && fit.from_reference.within[1] > 0.95);
    assert_true(fit.from_mesh.median_m > 0.075 && fit.from_mesh.median_m < 0.11); /* points lie 0.1 m apart */
    assert_true(fabs(fit.chamfer_m - (fit.from_mesh.mean_m + fit.from_reference.mean_m) / 2) < 1e-12);
    assert_true(fit.f_score[3] > 0.999);
    /* Half of the ball: what is missing shows in the reference's distances only. */
    hidden_x = 0;
    assert_int_equal(make("fit.ply", pool, NULL), CN_OK);
    assert_int_equal(cn_surface_compare(&ctx, mesh, reference, NULL, &fit), CN_OK);
    assert_true(fit.from_mesh.within[3] > 0.999);
    assert_true(fit.from_reference.within[3] > 0.5 && fit.from_reference.within[3] < 0.62);
    free(mesh);
    free(reference);
}

/* One large triangle: a place above it, one beside a corner, one beyond the end of a side. */
static void a_triangle_is_as_far_as_it_is(void **state)
{
    (void)state;
    static const struct {
        const char *place;
        double distance;
    } cases[] = { { "2 2 1", 1 }, { "-3 -4 0", 5 }, { "20 0 0", 10 }, { "4 -2 0", 2 } };
    static const char *const triangle = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
                                        "property float z\nelement face 1\nproperty list uchar int vertex_index\n"
                                        "end_header\n0 0 0\n10 0 0\n0 10 0\n3 0 1 2\n";
    char *mesh = in_folder("triangle.ply"), *reference = in_folder("place.ply");
    assert_int_equal(cn_file_write(mesh, triangle, strlen(triangle)), CN_OK);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        cn_surface_fit fit;
        char *text = cn_format("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
                               "property float z\nend_header\n%s\n",
                               cases[i].place);
        assert_int_equal(cn_file_write(reference, text, strlen(text)), CN_OK);
        assert_int_equal(cn_surface_compare(NULL, mesh, reference, NULL, &fit), CN_OK);
        assert_true(fabs(fit.from_reference.median_m - cases[i].distance) < 1e-6);
        free(text);
    }
    free(mesh);
    free(reference);
}

static void bad_references_are_named(void **state)
{
    (void)state;
    static const char *const texts[] = {
        "plx\nend_header\n",
        "ply\nformat binary_big_endian 1.0\nend_header\n",
        "ply\nformat ascii 1.0\n",
        "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nend_header\n1\n",
        "ply\nformat ascii 1.0\nelement vertex 4000000000\nproperty float x\nend_header\n1\n",
        "ply\nformat ascii 1.0\nelement vertex 4000000000\nend_header\n",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\nnan\n",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty double x\nend_header\n1e300\n",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nelement face 1\nproperty list uchar int "
        "vertex_indices\nend_header\n1\n3 0 0 1\n",
        "ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty float x\nend_header\n123456789"
    };
    char *mesh = in_folder("fit.ply"), *reference = in_folder("bad.ply");
    cn_surface_fit fit;
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        assert_int_equal(cn_file_write(reference, texts[i], strlen(texts[i])), CN_OK);
        assert_int_equal(cn_surface_compare(NULL, mesh, reference, NULL, &fit), CN_ERR_FORMAT);
        assert_non_null(strstr(cn_error_message(), "bad.ply"));
    }
    free(mesh);
    free(reference);
}

static void what_cannot_be_made_is_said(void **state)
{
    (void)state;
    hidden_x = 100;
    assert_int_equal(make("ball.stl", pool, NULL), CN_ERR_USAGE);
    assert_non_null(strstr(cn_error_message(), ".glb"));
    hidden_x = -100;
    assert_int_equal(make("none.ply", pool, NULL), CN_ERR_DATA);
    char *path = cn_path_join(folder, "none.ply");
    assert_false(cn_file_exists(path));
    free(path);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(a_ball_is_closed_and_round),
                                        cmocka_unit_test(threads_do_not_matter),
                                        cmocka_unit_test(views_that_differ_agree),
                                        cmocka_unit_test(a_stopped_export_goes_on),
                                        cmocka_unit_test(a_distance_decides_half),
                                        cmocka_unit_test(specks_are_dropped),
                                        cmocka_unit_test(gltf_is_whole),
                                        cmocka_unit_test(distances_are_as_made),
                                        cmocka_unit_test(a_triangle_is_as_far_as_it_is),
                                        cmocka_unit_test(bad_references_are_named),
                                        cmocka_unit_test(what_cannot_be_made_is_said) };
    return cmocka_run_group_tests(tests, begin, end);
}
