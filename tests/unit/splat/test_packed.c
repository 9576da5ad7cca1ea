/* Chunks of the web page, unpacked by a reader of this test's own, and the PLY reader. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../common.h"
#include "base/file.h"
#include "base/rng.h"
#include "random_splats.h"
#include "splat/packed.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { N = 700 }; /* three blocks, the last one not full */

static char folder[] = "/tmp/conurb_packed_XXXXXX";

static cn_splats *make(uint32_t degree)
{
    return random_splats(N, degree, (const double[3]){ 1200, -300, 40 }, 250, 3);
}

static float float_at(const uint8_t *bytes)
{
    const uint32_t bits = bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 | (uint32_t)bytes[3] << 24;
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static uint32_t u32_at(const uint8_t *bytes)
{
    return bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 | (uint32_t)bytes[3] << 24;
}

static void check_place(const cn_splats *s, uint32_t splat, const uint8_t *box, const uint8_t *steps)
{
    for (int k = 0; k < 3; k++) {
        const double step = (double)float_at(box + 12 + 4 * k);
        const double place = (double)float_at(box + 4 * k) + step * (steps[2 * k] | steps[2 * k + 1] << 8);
        assert_true(fabs(place - (s->origin[k] + (double)s->centre[splat][k])) < 0.6 * step + 1e-4);
        assert_true(step < 500.0 / 65535 + 1e-6); /* within a centimetre */
    }
}

static void check_rotation(const float q[4], uint32_t packed)
{
    const unsigned largest = packed >> 30;
    double out[4], rest = 1, dot = 0;
    for (unsigned k = 0, shift = 0; k < 4; k++)
        if (k != largest) {
            out[k] = ((packed >> shift & 1023) / 1023.0 - 0.5) * sqrt(2);
            rest -= out[k] * out[k];
            shift += 10;
        }
    out[largest] = sqrt(fmax(rest, 0));
    for (int k = 0; k < 4; k++)
        dot += out[k] * (double)q[k];
    assert_true(fabs(dot) > 1 - 1e-5); /* half a degree */
}

static void check_chunk(const cn_packing *p, const uint32_t *which, const uint8_t *bytes)
{
    const cn_splats *s = p->splats;
    assert_memory_equal(bytes, "CNSP\1\0", 6);
    assert_int_equal(bytes[6], p->degree);
    assert_int_equal(bytes[7], p->n_lights);
    assert_int_equal(u32_at(bytes + 8), N);
    const float low = float_at(bytes + 12), step = float_at(bytes + 16);
    const uint8_t *boxes = bytes + CN_PACKED_HEADER, *turns = boxes + 3 * 24, *steps = turns + 4 * N;
    const uint8_t *scales = steps + 6 * N, *opacity = scales + 3 * N, *colours = opacity + N;
    const uint8_t *harmonics = colours + (size_t)p->n_lights * 3 * N;
    const size_t row = (size_t)(s->degree + 1) * (s->degree + 1) * 3;
    for (uint32_t i = 0; i < N; i++) {
        check_place(s, which[i], boxes + 24 * (i / CN_PACKED_BLOCK), steps + 6 * (size_t)i);
        check_rotation(s->rotation[which[i]], u32_at(turns + 4 * (size_t)i));
        for (size_t k = 0; k < 3; k++)
            assert_true(fabsf(low + step * scales[3 * i + k] - logf(s->scale[which[i]][k])) < 0.51f * step);
        assert_true(fabsf(opacity[i] / 255.0f - s->opacity[which[i]]) < 0.0021f);
        for (uint32_t l = 0; l < p->n_lights; l++)
            assert_memory_equal(colours + 3 * ((size_t)l * N + i), p->lights[l][which[i]], 3);
        for (size_t k = 0; k < 9 && p->degree; k++)
            assert_true(fabsf((int8_t)harmonics[9 * i + k] / 127.0f * p->harmonics -
                              s->colour[which[i] * row + 3 + k]) < 0.51f * p->harmonics / 127);
    }
}

static void test_round_trip(void **state)
{
    (void)state;
    for (uint32_t degree = 0; degree < 3; degree++) {
        cn_splats *s = make(degree);
        static uint8_t lights[2][N][3];
        uint32_t which[N];
        uint8_t *bytes;
        for (uint32_t i = 0; i < N; i++) {
            which[i] = i;
            for (int k = 0; k < 3; k++)
                for (int l = 0; l < 2; l++)
                    lights[l][i][k] = (uint8_t)cn_rng_below(1, 10u + (unsigned)l, 3 * i + (unsigned)k, 256);
        }
        const cn_packing p = { s, 2, { lights[0], lights[1] }, degree ? 1 : 0, cn_packing_harmonics(s) };
        assert_int_equal(cn_packed_make(&p, which, N, &bytes), CN_OK);
        check_chunk(&p, which, bytes);
        assert_int_equal(cn_packed_size(N, 2, p.degree), 32 + 3 * 24 + N * (14 + 6 + (degree ? 9 : 0)));
        free(bytes);
        cn_splats_destroy(&s);
    }
}

/* Any first part of the order covers the scene, and what looks large comes early. */
static void test_rank(void **state)
{
    (void)state;
    cn_splats *s = make(0), *part;
    uint32_t *order, *again, seen[N] = { 0 }, east = 0, large = 0;
    assert_int_equal(cn_splats_rank(s, &order), CN_OK);
    assert_int_equal(cn_splats_rank(s, &again), CN_OK);
    assert_memory_equal(order, again, N * sizeof *order);
    for (uint32_t i = 0; i < N; i++)
        seen[order[i]]++;
    for (uint32_t i = 0; i < N; i++)
        assert_int_equal(seen[i], 1);
    for (uint32_t i = 0; i < N / 4; i++) {
        east += s->centre[order[i]][0] > 0;
        large += s->scale[order[i]][0] * s->scale[order[i]][1] * s->scale[order[i]][2] > expf(-7.5f);
    }
    assert_in_range(east, N / 8 - 40, N / 8 + 40);
    assert_true(large > N / 8 + 20);
    assert_int_equal(cn_splats_take(s, order, N / 4, cn_splats_growth(N, N / 4), &part), CN_OK);
    assert_int_equal(part->n, N / 4);
    for (uint32_t i = 0; i < N / 4; i++) {
        assert_true(part->centre[i][1] == s->centre[order[i]][1]);
        assert_true(fabsf(part->scale[i][2] / s->scale[order[i]][2] - 2) < 1e-6f); /* sqrt(4) */
    }
    cn_splats_destroy(&part);
    cn_splats_destroy(&s);
    free(order);
    free(again);
}

static char *path_of(const char *name)
{
    char *path = cn_path_join(folder, name);
    assert_non_null(path);
    return path;
}

static void test_read(void **state)
{
    (void)state;
    cn_frame frame;
    cn_frame_init(&frame);
    for (uint32_t degree = 0; degree < 3; degree++) {
        cn_splats *s = make(degree), *back;
        char *path = path_of("a.ply");
        const size_t colours = (size_t)N * (degree + 1) * (degree + 1) * 3;
        assert_int_equal(cn_splats_write(s, &(cn_splat_about){ .frame = &frame }, path), CN_OK);
        assert_int_equal(cn_splats_read(&back, path), CN_OK);
        assert_int_equal(back->n, N);
        assert_int_equal(back->degree, degree);
        assert_memory_equal(back->colour, s->colour, colours * sizeof *s->colour);
        for (size_t i = 0; i < N; i++) {
            for (int k = 0; k < 3; k++) {
                assert_true(fabs((double)back->centre[i][k] - s->origin[k] - (double)s->centre[i][k]) < 1e-3);
                assert_true(fabsf(back->scale[i][k] / s->scale[i][k] - 1) < 1e-5f);
            }
            assert_true(fabsf(back->opacity[i] - s->opacity[i]) < 1e-5f);
            assert_true(fabsf(back->rotation[i][2] - s->rotation[i][2]) < 1e-5f);
        }
        free(path);
        cn_splats_destroy(&back);
        cn_splats_destroy(&s);
    }
}

static void refuse(const char *text, size_t size, const char *why)
{
    cn_splats *s;
    char *path = path_of("bad.ply");
    assert_int_equal(cn_file_write(path, text, size), CN_OK);
    assert_int_equal(cn_splats_read(&s, path), CN_ERR_FORMAT);
    assert_null(s);
    assert_non_null(strstr(cn_error_message(), why));
    assert_non_null(strstr(cn_error_message(), "bad.ply"));
    free(path);
}

static void test_bad_files(void **state)
{
    (void)state;
    char *path = path_of("a.ply"), *data;
    size_t size;
    assert_int_equal(cn_file_read(path, 0, &data, &size), CN_OK);
    refuse("solid\n", 6, "'ply'");
    refuse(data, size - 1, "cut off");
    refuse(data, 30, "vertex");
    char *line = strstr(data, "property float rot_2");
    memcpy(line, "property float rat_2", 20);
    refuse(data, size, "rot_2");
    memcpy(line, "property float rot_2", 20);
    memset(data + size - 16, 0xff, 4); /* not a number, in the last rotation */
    refuse(data, size, "Gaussian 699");
    free(data);
    free(path);
}

static int remove_folder(void **state)
{
    (void)state;
    return folder_remove(folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_round_trip), cmocka_unit_test(test_rank),
                                        cmocka_unit_test(test_read), cmocka_unit_test(test_bad_files) };
    if (!mkdtemp(folder)) return 1;
    return cmocka_run_group_tests(tests, NULL, remove_folder);
}
