/* Simplification, charts, pages and textures of meshes whose shape and colours are known. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/keys.h"
#include "bridge/oiio.h"
#include "fixture.h"
#include "surface/textured.h"

#include <dirent.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

enum { AROUND = 160, ALONG = 80 };
#define WIDE_M 4.0  /* of a ring */
#define THICK_M 1.5 /* of its tube */

static cn_pool *pool;
static cn_colour *colour;
static cn_frame frame;
static char folder[] = "/tmp/conurb_texture_XXXXXX";

/* A closed ring with some waves. flat: a square of the map instead, with a border. */
static cn_mesh make_mesh(bool flat)
{
    cn_mesh m = { malloc((AROUND + 1) * (ALONG + 1) * sizeof *m.vertices),
                  malloc(6 * (size_t)AROUND * ALONG * sizeof *m.corners), 0, 0 };
    const int rows = flat ? AROUND + 1 : AROUND, columns = flat ? ALONG + 1 : ALONG;
    for (int i = 0; i < rows * columns; i++) {
        const double u = 2 * M_PI * (i / columns) / AROUND, v = 2 * M_PI * (i % columns) / ALONG;
        const double thick = THICK_M + 0.05 * sin(9 * u) * cos(7 * v), far = WIDE_M + thick * cos(v);
        cn_surface_vertex *p = &m.vertices[m.n_vertices++];
        *p = (cn_surface_vertex){ .rgb = { 10, 20, 30 } };
        const double ring[3] = { far * cos(u), far * sin(u), thick * sin(v) };
        const double square[3] = { i / columns * 0.1, i % columns * 0.1, 0 };
        const double out[3] = { cos(v) * cos(u), cos(v) * sin(u), sin(v) }, up[3] = { 0, 0, 1 };
        for (int k = 0; k < 3; k++) {
            p->xyz[k] = (float)(flat ? square[k] : ring[k]);
            p->normal[k] = (float)(flat ? up[k] : out[k]);
            p->eye[k] = p->xyz[k] + 10 * p->normal[k];
        }
    }
    for (int i = 0; i < AROUND * ALONG; i++) {
        const uint32_t a = (uint32_t)(i / ALONG), b = (uint32_t)(i % ALONG), row = (uint32_t)columns;
        const uint32_t next = (a + 1) % (uint32_t)rows * row, beside = (b + 1) % row;
        const uint32_t quad[6] = { a * row + b, next + b, next + beside, a * row + b, next + beside, a * row + beside };
        memcpy(m.corners + 3 * (size_t)m.n_triangles, quad, sizeof quad);
        m.n_triangles += 2;
    }
    return m;
}

/* Sides that only one triangle has. */
static size_t open_edges(const uint32_t *corners, size_t n)
{
    cn_keys edges = { 0 };
    size_t open = 0;
    for (int pass = 0; pass < 2; pass++)
        for (size_t i = 0; i < 3 * n; i++) {
            const uint32_t a = corners[i], b = corners[i / 3 * 3 + (i + 1) % 3];
            bool fresh;
            if (pass)
                open += cn_keys_find(&edges, (uint64_t)(b + 1) << 32 | (a + 1)) == UINT32_MAX;
            else
                assert_int_equal(cn_keys_add(&edges, (uint64_t)(a + 1) << 32 | (b + 1), 0, &fresh), CN_OK);
        }
    cn_keys_deinit(&edges);
    return open;
}

static void cells_leave_no_crack(void **state)
{
    (void)state;
    const cn_context ctx = { .pool = pool };
    for (int cells = 0; cells < 2; cells++) {
        cn_mesh m = make_mesh(false);
        const uint32_t before = m.n_triangles;
        const cn_mesh_wish wish = { before / 10, INFINITY, 0.01, cells ? 1.7 : INFINITY };
        double error_m;
        assert_int_equal(open_edges(m.corners, m.n_triangles), 0);
        assert_int_equal(cn_mesh_simplify(&ctx, &m, &wish, &error_m), CN_OK);
        assert_int_equal(open_edges(m.corners, m.n_triangles), 0);
        assert_int_equal(m.n_vertices, m.n_triangles / 2); /* Euler, of a ring */
        assert_true(m.n_triangles < before * (cells ? 0.16 : 0.101));
        assert_true(error_m > 0 && error_m < 0.2);
        cn_mesh_deinit(&m);
    }
    cn_mesh square = make_mesh(true);
    const size_t rim = open_edges(square.corners, square.n_triangles);
    double error_m;
    assert_int_equal(cn_mesh_simplify(&ctx, &square, &(cn_mesh_wish){ 0, 0.01, 0.01, INFINITY }, &error_m), CN_OK);
    assert_int_equal(open_edges(square.corners, square.n_triangles), rim); /* the border stays */
    assert_true(square.n_triangles < 3 * rim && error_m <= 0.01);
    cn_mesh_deinit(&square);
}

/* Charts hold each triangle once, and on pages no two of them share a texel or a gutter. */
static void pages_hold_every_chart_once(void **state)
{
    (void)state;
    const cn_context ctx = { .pool = pool };
    cn_mesh m = make_mesh(false);
    cn_charts charts;
    cn_atlas atlas;
    assert_int_equal(cn_charts_grow(&ctx, &m, &(cn_chart_limits){ 0.03, 2, 246 }, &charts), CN_OK);
    assert_int_equal(charts.n_triangles, m.n_triangles);
    assert_in_range(charts.n, 6, 200);
    uint8_t *seen = calloc(m.n_triangles, 1), *used = malloc(256 * 256);
    for (uint32_t i = 0; i < charts.n_triangles; i++)
        assert_int_equal(seen[charts.triangles[i]]++, 0);
    assert_int_equal(cn_atlas_pack(&charts, 256, &atlas), CN_OK);
    assert_true(atlas.n > 2);
    uint32_t n = 0;
    double area = 0;
    for (uint32_t p = 0; p < atlas.n; p++) {
        const uint32_t side = atlas.pages[p].side_px;
        memset(used, 0, 256 * 256);
        assert_int_equal(atlas.pages[p].first, n);
        for (uint32_t i = 0; i < atlas.pages[p].n; i++, n++) {
            const cn_chart *c = &charts.charts[n];
            assert_int_equal(c->page, p);
            assert_true(c->at_px[0] >= CN_ATLAS_GUTTER && c->at_px[1] >= CN_ATLAS_GUTTER);
            assert_true(c->at_px[0] + c->size_px[0] + CN_ATLAS_GUTTER <= side);
            assert_true(c->at_px[1] + c->size_px[1] + CN_ATLAS_GUTTER <= side);
            for (uint32_t y = 0; y < c->size_px[1] + CN_ATLAS_GUTTER; y++)
                for (uint32_t x = 0; x < c->size_px[0] + CN_ATLAS_GUTTER; x++)
                    assert_int_equal(used[(c->at_px[1] + y) * 256 + c->at_px[0] + x]++, 0);
            if (p + 1 < atlas.n) area += (double)c->size_px[0] * c->size_px[1] / (side * side);
        }
    }
    assert_int_equal(n, charts.n);
    assert_true(area > 0.5 * (atlas.n - 1)); /* full pages are more than half full */
    cn_atlas_deinit(&atlas);
    assert_int_equal(cn_atlas_pack(&charts, 16, &atlas), CN_ERR_USAGE);
    free(seen);
    free(used);
    cn_charts_deinit(&charts);
    cn_mesh_deinit(&m);
}

/* The colour of a place says where it is. */
static double tint(int k, double at)
{
    return 0.5 + 0.4 * at / (k < 2 ? 6 : 2);
}

static cn_status shade(void *user, const cn_context *ctx, const cn_ray_list *rays, const double (*range_m)[2],
                       float *rgba)
{
    (void)user;
    (void)ctx;
    for (size_t i = 0; i < rays->n; i++) {
        const double t = (range_m[i][0] + range_m[i][1]) / 2;
        assert_true(fabs(cn_norm3(rays->direction[i]) - 1) < 1e-6 && fabs(range_m[i][1] - range_m[i][0] - 1) < 1e-6);
        for (int k = 0; k < 3; k++) {
            /* through the display encoding and back: the test reads what it wrote */
            const double shown = tint(k, rays->origin_m[i][k] + t * rays->direction[i][k]);
            rgba[4 * i + (size_t)k] = (float)shown;
        }
        rgba[4 * i + 3] = 1;
    }
    return cn_colour_to_linear(colour, NULL, rgba, rays->n, 4);
}

static cn_textured textured_of(const cn_context *ctx, const cn_surface_source *source, const cn_mesh *mesh)
{
    static const cn_mesh_about about = { &frame, "noon", "1: A", 0.1 };
    return (
        cn_textured){ .ctx = ctx, .source = source, .about = &about, .mesh = mesh, .texel_m = 0.02, .reach_m = 0.5 };
}

static size_t offset_of(const json_t *root, const char *list, size_t i)
{
    return (size_t)json_integer_value(json_object_get(json_array_get(json_object_get(root, list), i), "byteOffset"));
}

static size_t number_of(const json_t *root, const char *list, size_t i, const char *key)
{
    return (size_t)json_integer_value(json_object_get(json_array_get(json_object_get(root, list), i), key));
}

/* Every triangle's middle, looked up in its page, has the colour of its place. */
static void check_page(const json_t *root, const char *bin, size_t page, size_t *n)
{
    const size_t image = offset_of(root, "bufferViews", 2 + page);
    const size_t size = number_of(root, "bufferViews", 2 + page, "byteLength");
    char *path = cn_path_join(folder, "page.jpg");
    float *rgba;
    uint32_t width, height;
    assert_int_equal(cn_file_write(path, bin + image, size), CN_OK);
    assert_int_equal(cn_oiio_read_rgba(path, &rgba, &width, &height), CN_OK);
    free(path);
    const char *vertices = bin + offset_of(root, "accessors", 4 * page);
    const char *corners = bin + offset_of(root, "bufferViews", 1) + offset_of(root, "accessors", 4 * page + 3);
    const size_t n_corners = number_of(root, "accessors", 4 * page + 3, "count");
    double worst = 0;
    for (size_t i = 0; i < n_corners; i += 3) {
        double middle[8] = { 0 };
        for (size_t c = 0; c < 3; c++) {
            uint32_t index;
            float v[8];
            memcpy(&index, corners + 4 * (i + c), sizeof index);
            memcpy(v, vertices + 32 * (size_t)index, sizeof v);
            for (int k = 0; k < 8; k++)
                middle[k] += (double)v[k] / 3;
            assert_true(v[6] > 0 && v[6] < 1 && v[7] > 0 && v[7] < 1);
        }
        const double local[3] = { middle[0], -middle[2], middle[1] };
        const size_t x = (size_t)(middle[6] * width), y = (size_t)(middle[7] * height);
        for (int k = 0; k < 3; k++)
            worst = fmax(worst, fabs((double)rgba[4 * (y * width + x) + (size_t)k] - tint(k, local[k])));
    }
    assert_true(worst < 0.045); /* a texel's width, and what JPEG does */
    *n += n_corners / 3;
    free(rgba);
}

static void check_glb(const cn_textured *textured, const char *name, cn_textured_report *report)
{
    char *path = cn_path_join(folder, name), *data;
    size_t size, n = 0;
    assert_int_equal(cn_textured_write(textured, path, report), CN_OK);
    assert_int_equal(cn_file_read(path, 0, &data, &size), CN_OK);
    uint32_t length;
    memcpy(&length, data + 12, sizeof length);
    json_t *root = json_loadb(data + 20, length, 0, NULL);
    assert_non_null(root);
    const json_t *extras = json_object_get(json_object_get(root, "asset"), "extras");
    assert_string_equal(json_string_value(json_object_get(extras, "light")), "noon");
    assert_string_equal(json_string_value(json_object_get(extras, "tiles")), "1: A");
    for (uint32_t p = 0; p < report->n_pages; p++)
        check_page(root, data + 28 + length, p, &n);
    assert_int_equal(n, textured->mesh->n_triangles);
    json_decref(root);
    free(data);
    free(path);
}

static void a_texture_shows_what_is_there(void **state)
{
    (void)state;
    const cn_context ctx = { .pool = pool };
    const cn_surface_source source = { .colour = colour, .page_px = 512, .shade = shade, .cube_m = 0.1 };
    cn_mesh m = make_mesh(false);
    double error_m;
    assert_int_equal(cn_mesh_simplify(&ctx, &m, &(cn_mesh_wish){ 4000, INFINITY, 0.01, INFINITY }, &error_m), CN_OK);
    const cn_textured textured = textured_of(&ctx, &source, &m);
    cn_textured_report report;
    check_glb(&textured, "ring.glb", &report);
    assert_true(report.n_pages > 1 && report.used > 0.3);
    cn_mesh_deinit(&m);
}

/* Flat ground may be two triangles of 1000 texels a side: a page of 64 gets larger ones. */
static void a_triangle_wider_than_a_page_fits(void **state)
{
    (void)state;
    const cn_context ctx = { .pool = pool };
    const cn_surface_source source = { .colour = colour, .page_px = 64, .shade = shade, .cube_m = 0.1 };
    cn_surface_vertex corner[4] = { { .xyz = { 0 } } };
    uint32_t corners[6] = { 0, 1, 2, 2, 1, 3 };
    for (int i = 0; i < 4; i++)
        corner[i] = (cn_surface_vertex){ .xyz = { 2.0f * (float)(i & 1), (float)(i & 2), 0 }, .normal = { 0, 0, 1 } };
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 3; k++)
            corner[i].eye[k] = corner[i].xyz[k] + 10 * corner[i].normal[k];
    const cn_mesh m = { corner, corners, 4, 2 };
    cn_textured textured = textured_of(&ctx, &source, &m);
    cn_textured_report report;
    textured.texel_m = 0.002;
    check_glb(&textured, "wide.glb", &report);
    assert_int_equal(report.n_pages, 2); /* neither fits beside the other */
}

/* OBJ: vertices keep their numbers, so the ring is closed. Nothing changes when one of its files cannot be written. */
static void an_obj_is_closed_and_whole(void **state)
{
    (void)state;
    const cn_context ctx = { .pool = pool };
    const cn_surface_source source = { .colour = colour, .page_px = 512, .shade = shade, .cube_m = 0.1 };
    cn_mesh m = make_mesh(false);
    double error_m;
    assert_int_equal(cn_mesh_simplify(&ctx, &m, &(cn_mesh_wish){ 2000, INFINITY, 0.01, INFINITY }, &error_m), CN_OK);
    const cn_textured textured = textured_of(&ctx, &source, &m);
    char *path = cn_path_join(folder, "a ring.obj"), *data;
    size_t size, n = 0;
    assert_int_equal(cn_textured_write(&textured, path, NULL), CN_OK);
    assert_int_equal(cn_file_read(path, 0, &data, &size), CN_OK);
    uint32_t *corners = malloc(3 * (size_t)m.n_triangles * sizeof *corners);
    assert_non_null(strstr(data, "mtllib a_ring.mtl\n"));
    for (const char *at = data; (at = strstr(at, "\nf ")); at++, n++) {
        assert_true(n < m.n_triangles);
        assert_int_equal(
            sscanf(at, "\nf %u/%*u/%*u %u/%*u/%*u %u/", &corners[3 * n], &corners[3 * n + 1], &corners[3 * n + 2]), 3);
    }
    assert_int_equal(n, m.n_triangles);
    assert_int_equal(open_edges(corners, n), 0);
    free(data);
    free(corners);
    /* A name in these files ends at white space. */
    static const char *const beside[] = { "a_ring.mtl", "a_ring-1.jpg" };
    for (int i = 0; i < 2; i++) {
        char *other = cn_path_join(folder, beside[i]);
        assert_true(cn_file_exists(other));
        free(other);
    }
    free(path);
    read_from(folder, "a_ring.mtl", &data, &size);
    assert_non_null(strstr(data, "map_Kd a_ring-1.jpg\n"));
    free(data);
    char *nowhere = cn_path_join(folder, "none/ring.obj");
    assert_int_equal(cn_textured_write(&textured, nowhere, NULL), CN_ERR_IO);
    free(nowhere);
    cn_mesh_deinit(&m);
}

static size_t entries(void)
{
    size_t n = 0;
    DIR *dir = opendir(folder);
    while (readdir(dir))
        n++;
    closedir(dir);
    return n;
}

/* The scratch file of the images fits, the file itself does not: it stays as it was, and there is no other. */
static void a_full_disk_leaves_the_old_file(void **state)
{
    (void)state;
    static const char *const names[] = { "full.glb", "full.obj" };
    const cn_context ctx = { .pool = pool };
    const cn_surface_source source = { .colour = colour, .page_px = 128, .shade = shade, .cube_m = 0.1 };
    cn_mesh m = make_mesh(false);
    cn_textured textured = textured_of(&ctx, &source, &m);
    struct rlimit limit, small;
    textured.texel_m = 0.2;
    getrlimit(RLIMIT_FSIZE, &limit);
    small = limit;
    small.rlim_cur = 300000;
    signal(SIGXFSZ, SIG_IGN);
    for (int i = 0; i < 2; i++) {
        char *path = cn_path_join(folder, names[i]), *data;
        size_t size;
        assert_int_equal(cn_file_write(path, "old", 3), CN_OK);
        const size_t before = entries();
        setrlimit(RLIMIT_FSIZE, &small);
        const cn_status status = cn_textured_write(&textured, path, NULL);
        setrlimit(RLIMIT_FSIZE, &limit);
        assert_int_equal(status, CN_ERR_IO);
        assert_non_null(strstr(cn_error_message(), names[i]));
        assert_int_equal(entries(), before);
        assert_int_equal(cn_file_read(path, 0, &data, &size), CN_OK);
        assert_string_equal(data, "old");
        free(data);
        free(path);
    }
    cn_mesh_deinit(&m);
}

static int begin(void **state)
{
    (void)state;
    cn_frame_init(&frame);
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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(cells_leave_no_crack),          cmocka_unit_test(pages_hold_every_chart_once),
        cmocka_unit_test(a_texture_shows_what_is_there), cmocka_unit_test(a_triangle_wider_than_a_page_fits),
        cmocka_unit_test(an_obj_is_closed_and_whole),    cmocka_unit_test(a_full_disk_leaves_the_old_file),
    };
    return cmocka_run_group_tests(tests, begin, end);
}
