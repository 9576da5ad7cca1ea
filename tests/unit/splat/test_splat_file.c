/* Files of splats, read again by readers of this test's own. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/file.h"
#include "base/rng.h"
#include "conurb/splat.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { N = 500 };

static char folder[] = "/tmp/conurb_splat_XXXXXX";
static cn_frame frame;
static const cn_splat_about about = { &frame, "mean\nof all", "1: A" };

static float between(float low, float high, uint64_t stream, uint64_t at)
{
    return low + (high - low) * cn_rng_float(7, stream, at);
}

static cn_splats *make(uint32_t degree)
{
    cn_splats *s;
    assert_int_equal(cn_splats_create(&s, N, degree), CN_OK);
    memcpy(s->origin, (const double[3]){ 100, -20, 5 }, sizeof s->origin);
    for (size_t i = 0; i < N; i++) {
        float norm = 0;
        for (size_t k = 0; k < 4; k++) {
            s->rotation[i][k] = between(-1, 1, 1, 4 * i + k);
            norm += s->rotation[i][k] * s->rotation[i][k];
        }
        for (size_t k = 0; k < 4; k++)
            s->rotation[i][k] /= sqrtf(norm);
        for (size_t k = 0; k < 3; k++) {
            s->centre[i][k] = between(-50, 50, 2, 3 * i + k);
            s->scale[i][k] = expf(between(-6, 1, 3, 3 * i + k));
        }
        s->opacity[i] = between(0.01f, 0.99f, 4, i);
        for (size_t k = 0; k < 3 * (degree + 1) * (degree + 1); k++)
            s->colour[i * 3 * (degree + 1) * (degree + 1) + k] = between(-0.7f, 0.7f, 5, 64 * i + k);
    }
    return s;
}

static char *path_of(const char *name)
{
    char *path = cn_path_join(folder, name);
    assert_non_null(path);
    return path;
}

/* ---- PLY ---- */

static size_t column(const char *header, const char *name)
{
    char line[64];
    size_t n = 0;
    snprintf(line, sizeof line, "property float %s\n", name);
    const char *at = strstr(header, line);
    assert_non_null(at);
    for (const char *c = header; (c = strstr(c, "property float ")) && c < at; c++)
        n++;
    return n;
}

static float value(const char *rows, size_t width, size_t row, size_t column)
{
    float f;
    memcpy(&f, rows + 4 * (row * width + column), sizeof f); /* the test machines are little-endian */
    return f;
}

static void check_ply_row(const cn_splats *s, size_t i, const char *header, const char *rows, size_t width)
{
    const size_t n_c = (size_t)(s->degree + 1) * (s->degree + 1);
    const float logit = value(rows, width, i, column(header, "opacity"));
    assert_true(fabsf(1 / (1 + expf(-logit)) - s->opacity[i]) < 1e-5f);
    for (size_t k = 0; k < 3; k++) {
        const float place = value(rows, width, i, column(header, "x") + k);
        assert_true(fabs(place - (s->origin[k] + s->centre[i][k])) < 1e-4);
        assert_true(fabsf(expf(value(rows, width, i, column(header, "scale_0") + k)) / s->scale[i][k] - 1) < 1e-4f);
        assert_true(value(rows, width, i, column(header, "f_dc_0") + k) == s->colour[3 * n_c * i + k]);
        for (size_t c = 1; c < n_c; c++)
            assert_true(value(rows, width, i, column(header, "f_rest_0") + k * (n_c - 1) + c - 1) ==
                        s->colour[3 * (n_c * i + c) + k]);
    }
    for (size_t k = 0; k < 4; k++)
        assert_true(value(rows, width, i, column(header, "rot_0") + k) == s->rotation[i][k]);
}

static void test_ply(void **state)
{
    (void)state;
    char *path = path_of("a.ply"), *beside = path_of("a.frame.json");
    for (uint32_t degree = 0; degree <= CN_SPLAT_MAX_DEGREE; degree++) {
        cn_splats *s = make(degree);
        char *data, *rows;
        size_t size;
        assert_int_equal(cn_splats_write(s, &about, path), CN_OK);
        assert_int_equal(cn_file_read(path, 0, &data, &size), CN_OK);
        assert_true(cn_file_exists(beside));
        rows = strstr(data, "end_header\n");
        assert_non_null(rows);
        *rows = '\0';
        rows += strlen("end_header\n");
        const size_t width = 17 + 3 * ((degree + 1) * (degree + 1) - 1);
        assert_non_null(strstr(data, "\nformat binary_little_endian 1.0\n"));
        assert_non_null(strstr(data, "\nelement vertex 500\n"));
        assert_non_null(strstr(data, "\ncomment light: mean of all\n"));
        assert_non_null(strstr(data, "\ncomment tiles: 1: A\n"));
        assert_int_equal((size_t)(data + size - rows), 4 * width * N);
        for (size_t i = 0; i < N; i++)
            check_ply_row(s, i, data, rows, width);
        free(data);
        cn_splats_destroy(&s);
    }
    free(path);
    free(beside);
}

static void test_refused(void **state)
{
    (void)state;
    char *path = path_of("b.ply"), *other = path_of("b.xyz");
    cn_splats *s = make(0), *none;
    assert_int_equal(cn_splats_create(&none, 1, 3), CN_ERR_USAGE);
    assert_null(none);
    assert_int_equal(cn_splats_write(s, &about, other), CN_ERR_USAGE);
    s->centre[3][1] = NAN;
    assert_int_equal(cn_splats_write(s, &about, path), CN_ERR_DATA);
    s->centre[3][1] = 0;
    s->scale[4][2] = 0;
    assert_int_equal(cn_splats_write(s, &about, path), CN_ERR_DATA);
    s->n = 0;
    assert_int_equal(cn_splats_write(s, &about, path), CN_ERR_DATA);
    s->n = N;
    s->scale[4][2] = 1;
    assert_false(cn_file_exists(path));
    assert_int_equal(cn_splats_write(s, &about, "/nonexistent/b.ply"), CN_ERR_IO);
    cn_splats_destroy(&s);
    free(path);
    free(other);
}

int main(void)
{
    cn_frame_init(&frame);
    if (!mkdtemp(folder)) return 1;
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_ply), cmocka_unit_test(test_refused) };
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    char *command = cn_format("rm -r %s", folder);
    const int removed = command ? system(command) : 1;
    free(command);
    return failed || removed;
}
