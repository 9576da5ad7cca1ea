/* Files of splats, read again by readers of this test's own. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../common.h"
#include "base/file.h"
#include "base/rng.h"
#include "base/json.h"
#include "conurb/splat.h"
#include "random_splats.h"
#include "splat/harmonics.h"
#include "splat/splat_tiles.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <zlib.h>

enum { N = 500 };

static char folder[] = "/tmp/conurb_splat_XXXXXX";
static cn_frame frame;
static const cn_splat_about about = { &frame, "mean\nof all", "1: A" };

static cn_splats *make(uint32_t degree)
{
    return random_splats(N, degree, (const double[3]){ 100, -20, 5 }, 50, 7);
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

/* ---- SPZ ---- */

static size_t unpack(const char *path, uint8_t *out, size_t room)
{
    char *data;
    size_t size;
    assert_int_equal(cn_file_read(path, 0, &data, &size), CN_OK);
    z_stream z = { .next_in = (uint8_t *)data, .avail_in = (uInt)size, .next_out = out, .avail_out = (uInt)room };
    assert_int_equal(inflateInit2(&z, 15 + 16), Z_OK); /* gzip */
    assert_int_equal(inflate(&z, Z_FINISH), Z_STREAM_END);
    inflateEnd(&z);
    free(data);
    return room - z.avail_out;
}

static float fixed_24(const uint8_t *at, unsigned bits)
{
    uint32_t value = at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16;
    if (value & 0x800000) value |= 0xff000000;
    return ldexpf((float)(int32_t)value, -(int)bits);
}

/* The columns of a splat's ellipsoid, in the axes of q. */
static void turn_axis(const float q[4], int axis, float out[3])
{
    const float w = q[0], x = q[1], y = q[2], z = q[3];
    const float m[3][3] = { { 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y) },
                            { 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x) },
                            { 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y) } };
    for (int k = 0; k < 3; k++)
        out[k] = m[k][axis];
}

static void check_rotation(const float local[4], const uint8_t xyz[3])
{
    float q[4] = { 0 }, was[3], is[3], sum = 0;
    for (int k = 0; k < 3; k++) {
        q[1 + k] = (float)xyz[k] / 127.5f - 1;
        sum += q[1 + k] * q[1 + k];
    }
    q[0] = sqrtf(fmaxf(0, 1 - sum));
    for (int axis = 0; axis < 3; axis++) {
        turn_axis(local, axis, was);
        turn_axis(q, axis, is);
        /* A small w comes out of a difference: half a step of x, y, z moves it by a tenth. */
        assert_true(fabsf(is[0] - was[0]) < 0.25f && fabsf(is[1] - was[2]) < 0.25f && fabsf(is[2] + was[1]) < 0.25f);
    }
}

/* The colour from some directions, which the file has in its own axes. */
static void check_harmonics(const float *local, const uint8_t *bytes, uint32_t degree, size_t i)
{
    for (size_t d = 0; d < 4; d++) {
        float from[3], there[3], basis[2][CN_HARMONICS_MOST], norm = 0;
        for (size_t k = 0; k < 3; k++) {
            from[k] = 2 * cn_rng_float(7, 9, 12 * i + 3 * d + k) - 1;
            norm += from[k] * from[k];
        }
        for (int k = 0; k < 3; k++)
            from[k] /= sqrtf(norm);
        memcpy(there, (const float[3]){ from[0], from[2], -from[1] }, sizeof there);
        cn_harmonics(from, degree, basis[0]);
        cn_harmonics(there, degree, basis[1]);
        for (size_t k = 0; k < 3; k++) {
            float was = 0, is = 0;
            for (size_t c = 1; c < (size_t)(degree + 1) * (degree + 1); c++) {
                was += basis[0][c] * local[3 * c + k];
                is += basis[1][c] * ((float)bytes[3 * (c - 1) + k] - 128) / 128;
            }
            assert_true(fabsf(was - is) < 0.15f); /* steps of a 16th, and of an 8th */
        }
    }
}

static void check_spz(const cn_splats *s, const uint8_t *data, size_t size)
{
    const size_t rest = 3 * ((s->degree + 1) * (s->degree + 1) - 1);
    const uint8_t *places = data + 16, *alphas = places + 9 * N, *colours = alphas + N, *scales = colours + 3 * N;
    const uint8_t *rotations = scales + 3 * N, *harmonics = rotations + 3 * N;
    assert_memory_equal(data, "NGSP\2\0\0\0", 8);
    assert_int_equal(data[8] | data[9] << 8, N);
    assert_int_equal(data[12], s->degree);
    assert_int_equal(data[13], 12);
    assert_true(data[14] == 0 && data[15] == 0);
    assert_int_equal(size, 16 + N * (19 + rest));
    for (size_t i = 0; i < N; i++) {
        const float *colour = s->colour + i * (rest + 3);
        const double east = s->origin[0] + (double)s->centre[i][0], north = s->origin[1] + (double)s->centre[i][1],
                     up = s->origin[2] + (double)s->centre[i][2];
        assert_true(fabs((double)fixed_24(places + 9 * i, 12) - east) < 2e-4);
        assert_true(fabs((double)fixed_24(places + 9 * i + 3, 12) - up) < 2e-4);
        assert_true(fabs((double)fixed_24(places + 9 * i + 6, 12) + north) < 2e-4);
        assert_true(fabsf(alphas[i] / 255.0f - s->opacity[i]) < 0.003f);
        for (size_t k = 0; k < 3; k++) {
            assert_true(fabsf((colours[3 * i + k] / 255.0f - 0.5f) / 0.15f - colour[k]) < 0.014f);
            assert_true(fabsf(scales[3 * i + k] / 16.0f - 10 - logf(s->scale[i][k])) < 0.032f);
        }
        check_rotation(s->rotation[i], rotations + 3 * i);
        check_harmonics(colour, harmonics + rest * i, s->degree, i);
    }
}

static void test_spz(void **state)
{
    (void)state;
    static uint8_t data[N * 64];
    char *path = path_of("a.spz"), *beside = path_of("a.frame.json"), *said = path_of("a.about.json");
    for (uint32_t degree = 0; degree <= CN_SPLAT_MAX_DEGREE; degree++) {
        cn_splats *s = make(degree);
        json_t *root;
        const char *light;
        remove(beside);
        assert_int_equal(cn_splats_write(s, &about, path), CN_OK);
        check_spz(s, data, unpack(path, data, sizeof data));
        assert_true(cn_file_exists(beside));
        assert_int_equal(cn_json_load(said, &root), CN_OK);
        assert_int_equal(cn_json_string(root, said, "light", &light), CN_OK);
        assert_string_equal(light, about.light);
        json_decref(root);
        s->origin[0] = 3e5; /* coarser steps, so that the place fits */
        assert_int_equal(cn_splats_write(s, &about, path), CN_OK);
        assert_true(unpack(path, data, sizeof data) > 0 && data[13] == 4);
        s->origin[0] = 1e8;
        assert_int_equal(cn_splats_write(s, &about, path), CN_ERR_DATA);
        cn_splats_destroy(&s);
    }
    free(path);
    free(beside);
    free(said);
}

/* The JSON of a GLB. */
static json_t *glb_json(const char *path)
{
    char *bytes;
    size_t size;
    uint32_t length;
    assert_int_equal(cn_file_read(path, 1 << 20, &bytes, &size), CN_OK);
    assert_true(size > 20 && memcmp(bytes, "glTF", 4) == 0);
    memcpy(&length, bytes + 12, sizeof length);
    assert_true(length <= size - 20);
    json_t *root = json_loadb(bytes + 20, length, 0, NULL);
    assert_non_null(root);
    free(bytes);
    return root;
}

/* Values that SPZ gives have no view, and are floats but for COLOR_0: CesiumJS reads them as what accessors say. */
static void test_glb(void **state)
{
    (void)state;
    enum { UNSIGNED_BYTE = 5121, FLOAT = 5126 };
    char *path = path_of("a.glb");
    for (int compressed = 0; compressed < 2; compressed++) {
        cn_splats *s = make(1);
        assert_int_equal(cn_splat_glb_write(s, &about, compressed, path), CN_OK);
        json_t *root = glb_json(path), *accessor, *accessors = json_object_get(root, "accessors");
        const json_t *primitive =
            json_array_get(json_object_get(json_array_get(json_object_get(root, "meshes"), 0), "primitives"), 0);
        const json_t *colour = json_object_get(json_object_get(primitive, "attributes"), "COLOR_0");
        size_t i;
        assert_int_equal(json_array_size(json_object_get(root, "extensionsRequired")), compressed ? 2 : 0);
        json_array_foreach(accessors, i, accessor)
        {
            const json_int_t kind = json_integer_value(json_object_get(accessor, "componentType"));
            assert_int_equal(json_integer_value(json_object_get(accessor, "count")), N);
            assert_int_equal(json_object_get(accessor, "bufferView") == NULL, compressed);
            if (compressed) assert_int_equal(kind, (json_int_t)i == json_integer_value(colour) ? UNSIGNED_BYTE : FLOAT);
        }
        json_decref(root);
        cn_splats_destroy(&s);
    }
    free(path);
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
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_ply), cmocka_unit_test(test_spz),
                                        cmocka_unit_test(test_glb), cmocka_unit_test(test_refused) };
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    return folder_remove(folder) == 0 ? failed : 1;
}
