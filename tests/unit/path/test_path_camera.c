/* Cameras of compositing programs: what is written is read again, and .chan and glTF of other programs. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/file.h"
#include "math/linalg.h"
#include "path/path.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { FRAMES = 40 };
static char folder[] = "/tmp/conurb_camera_XXXXXX";
static char *chan, *glb;

static int begin(void **state)
{
    (void)state;
    if (!mkdtemp(folder)) return -1;
    chan = cn_path_join(folder, "flight.chan");
    glb = cn_path_join(folder, "flight.glb");
    return 0;
}

static int end(void **state)
{
    (void)state;
    unlink(chan);
    unlink(glb);
    free(chan);
    free(glb);
    return rmdir(folder);
}

static cn_path_options options(double fps, uint32_t n)
{
    cn_path_options o = cn_path_options_default();
    o.width = 160;
    o.height = 90;
    o.fps = fps;
    o.n_frames = n;
    return o;
}

/* Every direction and roll, straight up and down among them. */
static void make_flight(cn_path *path, uint32_t n)
{
    assert_int_equal(cn_path_allocate(path, n, 25), CN_OK);
    for (uint32_t i = 0; i < n; i++) {
        cn_path_shot shot = { .time_s = i / 25.0, .vfov_deg = 40 + 0.5 * i, .width = 160, .height = 90 };
        cn_path_angles(37.0 * i, i == 3 ? -90 : i == 4 ? 90 : 80 * sin(i), 11.0 * i, shot.cam_from_world);
        for (int k = 0; k < 3; k++)
            shot.centre[k] = 500 * sin(0.1 * i + k);
        assert_int_equal(cn_path_place(path, i, &shot), CN_OK);
    }
}

static double difference(const cn_path *a, const cn_path *b)
{
    double worst = 0;
    assert_int_equal(a->n_frames, b->n_frames);
    for (uint32_t i = 0; i < a->n_frames; i++) {
        double p[3], q[3];
        cn_view_centre(&a->frames[i].view, p);
        cn_view_centre(&b->frames[i].view, q);
        worst = fmax(worst, cn_distance3(p, q) / 500);
        for (int k = 0; k < 9; k++)
            worst = fmax(worst, fabs(a->frames[i].view.rotation[k] - b->frames[i].view.rotation[k]));
        worst = fmax(worst, fabs(a->frames[i].camera.params[1] / b->frames[i].camera.params[1] - 1));
        assert_true(fabs(a->frames[i].time_s - b->frames[i].time_s) < 1e-6);
    }
    return worst;
}

static void the_same_camera_comes_back(void **state)
{
    (void)state;
    const cn_path_note note = { NULL, "a flight" };
    for (uint32_t n = 1; n <= FRAMES; n += FRAMES - 1) {
        cn_path flight, read;
        make_flight(&flight, n);
        assert_int_equal(cn_path_save(&flight, chan, &note), CN_OK);
        const cn_path_options o = options(25, 0), other = options(30, 0);
        assert_int_equal(cn_path_load(&read, chan, &o), CN_OK);
        assert_true(difference(&flight, &read) < 1e-8);
        cn_path_deinit(&read);
        assert_int_equal(cn_path_save(&flight, glb, &note), CN_OK);
        assert_int_equal(cn_path_load(&read, glb, &other), CN_OK); /* it has its own times */
        assert_true(n == 1 || read.fps == 25);
        assert_true(difference(&flight, &read) < 1e-6);
        cn_path_deinit(&read);
        cn_path_deinit(&flight);
    }
}

/* A path may have times that are not its frames': keyframes for one second in 40 pictures at 25 a second. */
static void gltf_has_the_times_of_the_film(void **state)
{
    (void)state;
    const cn_path_options o = options(30, 0);
    cn_path flight, read;
    make_flight(&flight, FRAMES);
    for (uint32_t i = 0; i < FRAMES; i++)
        flight.frames[i].time_s = (double)i / (FRAMES - 1);
    assert_int_equal(cn_path_save(&flight, glb, &(cn_path_note){ NULL, "a flight" }), CN_OK);
    assert_int_equal(cn_path_load(&read, glb, &o), CN_OK);
    assert_int_equal(read.n_frames, FRAMES);
    for (uint32_t i = 0; i < FRAMES; i++)
        assert_true(fabs(read.frames[i].time_s - i / 25.0) < 1e-6);
    cn_path_deinit(&read);
    cn_path_deinit(&flight);
}

static cn_status load_text(cn_path *path, const char *text, uint32_t n)
{
    const cn_path_options o = options(10, n);
    assert_int_equal(cn_file_write(chan, text, strlen(text)), CN_OK);
    return cn_path_load(path, chan, &o);
}

static void check_frame(const cn_path *path, uint32_t i, const double centre[3], const double forward[3])
{
    double found[3];
    cn_view_centre(&path->frames[i].view, found);
    for (int k = 0; k < 3; k++) {
        assert_true(fabs(found[k] - centre[k]) < 1e-9);
        assert_true(fabs(path->frames[i].view.rotation[6 + k] - forward[k]) < 1e-9);
    }
}

static void a_chan_of_another_program(void **state)
{
    (void)state;
    cn_path path;
    const char *text = "# made elsewhere\r\n101 1 2 3 0 0 0 50\r\n\r\n111 1 2 13 0 -90 0 50\r\n";
    assert_int_equal(load_text(&path, text, 0), CN_OK);
    assert_int_equal(path.n_frames, 11);
    /* y up becomes z up: a camera without rotation looks north; -90 about the vertical is to the east. */
    check_frame(&path, 0, (const double[3]){ 1, -3, 2 }, (const double[3]){ 0, 1, 0 });
    check_frame(&path, 5, (const double[3]){ 1, -8, 2 }, (const double[3]){ sqrt(0.5), sqrt(0.5), 0 });
    check_frame(&path, 10, (const double[3]){ 1, -13, 2 }, (const double[3]){ 1, 0, 0 });
    cn_path_deinit(&path);
    assert_int_equal(load_text(&path, text, 3), CN_OK);
    check_frame(&path, 1, (const double[3]){ 1, -8, 2 }, (const double[3]){ sqrt(0.5), sqrt(0.5), 0 });
    cn_path_deinit(&path);
    static const char *const wrong[] = { "1 0 0 0 0 0 0 50\n1 0 0 0 0 0 0 50\n",
                                         "1 0 0 0 0 0 0 0\n",
                                         "1 0 0 0\n",
                                         "1 0 0 zero 0 0 0 50\n",
                                         "1 0 0 nan 0 0 0 50\n",
                                         "# nothing\n",
                                         "1 2 3 4 5 6 7 8 9\n" };
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        assert_int_equal(load_text(&path, wrong[i], 0), CN_ERR_FORMAT);
        assert_non_null(strstr(cn_error_message(), chan));
        assert_null(path.frames);
    }
}

/* Writes a GLB by hand. */
static cn_status load_glb(cn_path *path, const char *json, const float *data, size_t n_data)
{
    const uint32_t length = (uint32_t)strlen(json), padded = (length + 3) / 4 * 4, size = (uint32_t)(4 * n_data);
    const uint32_t head[5] = { 0x46546c67, 2, 28 + padded + size, padded, 0x4e4f534a }, chunk[2] = { size, 0x4e4942 };
    const cn_path_options o = options(10, 0);
    FILE *stream = fopen(glb, "wb");
    assert_non_null(stream);
    fwrite(head, sizeof head, 1, stream);
    fprintf(stream, "%s%*s", json, (int)(padded - length), "");
    fwrite(chunk, sizeof chunk, 1, stream);
    if (n_data > 0) fwrite(data, 4, n_data, stream);
    fclose(stream);
    return cn_path_load(path, glb, &o);
}

#define HEAD "{\"asset\":{\"version\":\"2.0\"},"
#define LENS "\"cameras\":[{\"type\":\"perspective\",\"perspective\":{\"yfov\":1,\"znear\":1}}],"

/* A camera on a rig that moves: its own node is turned by a quarter and scaled, the rig's place is a cubic. */
static void a_camera_on_a_rig(void **state)
{
    (void)state;
    static const char *const json = HEAD LENS
        "\"nodes\":[{\"children\":[1]},{\"camera\":0,\"translation\":[0,1,0],\"rotation\":[0,0.70710678,0,"
        "0.70710678],\"scale\":[2,2,2]}],\"animations\":[{\"channels\":[{\"sampler\":0,\"target\":{\"node\":0,"
        "\"path\":\"translation\"}}],\"samplers\":[{\"input\":0,\"output\":1,\"interpolation\":"
        "\"CUBICSPLINE\"}]}],\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":"
        "\"SCALAR\"},{\"bufferView\":1,\"componentType\":5126,\"count\":9,\"type\":\"VEC3\"}],"
        "\"bufferViews\":[{\"buffer\":0,\"byteLength\":12},{\"buffer\":0,\"byteOffset\":12,\"byteLength\":"
        "108}],\"buffers\":[{\"byteLength\":120}]}";
    float data[30] = { 0, 0.1f, 0.2f };
    data[3 + 9 + 3] = 5; /* x of the second key */
    data[3 + 18 + 3] = 7;
    cn_path path;
    assert_int_equal(load_glb(&path, json, data, 30), CN_OK);
    assert_int_equal(path.n_frames, 3);
    /* Turned by +90 degrees about the vertical: from the north to the west. */
    double centre[3];
    const double x[3] = { 0, 5, 7 };
    for (uint32_t i = 0; i < 3; i++) {
        cn_view_centre(&path.frames[i].view, centre);
        assert_true(fabs(centre[0] - x[i]) < 1e-6 && fabs(centre[1]) < 1e-6 && fabs(centre[2] - 1) < 1e-6);
        assert_true(fabs(path.frames[i].view.rotation[6] + 1) < 1e-6);
    }
    cn_path_deinit(&path);
    data[1] = -1; /* times that go back */
    assert_int_equal(load_glb(&path, json, data, 30), CN_ERR_FORMAT);
    data[1] = 0.1f;
    assert_int_equal(load_glb(&path, json, data, 20), CN_ERR_FORMAT); /* too little data */
    assert_non_null(strstr(cn_error_message(), "outside of its data"));
}

/* Keys set by hand, at moments of their own for each channel: it moves for 10 s, by a cubic that is not straight, and
 * turns in the first second. */
static void keys_of_all_channels_count(void **state)
{
    (void)state;
    static const char *const json = HEAD LENS
        "\"nodes\":[{\"camera\":0}],\"animations\":[{\"channels\":[{\"sampler\":0,\"target\":{\"node\":0,\"path\":"
        "\"translation\"}},{\"sampler\":1,\"target\":{\"node\":0,\"path\":\"rotation\"}}],\"samplers\":[{\"input\":0,"
        "\"output\":1,\"interpolation\":\"CUBICSPLINE\"},{\"input\":2,\"output\":3}]}],\"accessors\":[{\"bufferView\":"
        "0,\"componentType\":5126,\"count\":2,\"type\":\"SCALAR\"},{\"bufferView\":1,\"componentType\":5126,\"count\":"
        "6,\"type\":\"VEC3\"},{\"bufferView\":2,\"componentType\":5126,\"count\":3,\"type\":\"SCALAR\"},"
        "{\"bufferView\":3,\"componentType\":5126,\"count\":3,\"type\":\"VEC4\"}],\"bufferViews\":[{\"buffer\":0,"
        "\"byteLength\":8},{\"buffer\":0,\"byteOffset\":8,\"byteLength\":72},{\"buffer\":0,\"byteOffset\":80,"
        "\"byteLength\":12},{\"buffer\":0,\"byteOffset\":92,\"byteLength\":48}],\"buffers\":[{\"byteLength\":140}]}";
    float data[35] = { 0, 10 };
    data[2 + 6] = 4;                 /* metres a second in x at the first key */
    data[2 + 9 + 3] = 10;            /* x of the second key, where it stands still */
    data[21] = 0.55f, data[22] = 1;  /* the second key lies between two frames */
    data[23 + 3] = data[27 + 3] = 1; /* no turn up to it, then a quarter */
    data[31 + 1] = data[31 + 3] = 0.70710678f;
    cn_path path;
    assert_int_equal(load_glb(&path, json, data, 35), CN_OK);
    assert_int_equal(path.n_frames, 101);
    for (uint32_t i = 0; i <= 100; i++) {
        double centre[3];
        const double t = i / 100.0, x = (t * t * t - 2 * t * t + t) * 40 + (3 * t * t - 2 * t * t * t) * 10;
        const double turn = fmin(fmax((i / 10.0 - 0.55) / 0.45, 0), 1) * 90;
        cn_view_centre(&path.frames[i].view, centre);
        assert_true(fabs(centre[0] - x) < 1e-3);
        assert_true(fabs(path.frames[i].view.rotation[7] - cos(turn * 3.14159265358979 / 180)) < 1e-3);
    }
    cn_path_deinit(&path);
}

static void what_is_no_camera(void **state)
{
    (void)state;
    cn_path path;
    static const char *const wrong[] = { HEAD "\"nodes\":[{}]}",
                                         HEAD "\"nodes\":[{\"camera\":3}]}",
                                         HEAD "\"cameras\":[{\"type\":\"orthographic\"}],\"nodes\":[{\"camera\":0}]}",
                                         HEAD LENS "\"nodes\":[{\"camera\":0,\"children\":[0]}]}", /* its own parent */
                                         HEAD
                                         "\"cameras\":[{\"perspective\":{\"yfov\":9}}],\"nodes\":[{\"camera\":0}]}",
                                         HEAD LENS "\"nodes\":[{\"camera\":0,\"scale\":[0,1,1]}]}",
                                         "[]",
                                         "{" };
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        assert_int_equal(load_glb(&path, wrong[i], NULL, 0), CN_ERR_FORMAT);
        assert_null(path.frames);
    }
    cn_path flight;
    make_flight(&flight, 2);
    const cn_path_note note = { 0 };
    assert_int_equal(cn_path_save(&flight, "camera.fbx", &note), CN_ERR_USAGE);
    assert_int_equal(cn_path_save(&flight, "/nonexistent/camera.chan", &note), CN_ERR_IO);
    cn_path_deinit(&flight);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_same_camera_comes_back), cmocka_unit_test(gltf_has_the_times_of_the_film),
        cmocka_unit_test(a_chan_of_another_program),  cmocka_unit_test(a_camera_on_a_rig),
        cmocka_unit_test(keys_of_all_channels_count), cmocka_unit_test(what_is_no_camera),
    };
    return cmocka_run_group_tests(tests, begin, end);
}
