#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../common.h"
#include "base/file.h"
#include "bridge/oiio.h"
#include "conurb/video.h"

#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { N = 12, WIDTH = 65, HEIGHT = 48 }; /* an odd width */

static char folder[] = "/tmp/conurb_video_XXXXXX";
static char *names[N];

/* A grey ramp to the right, a bar that moves, and a red field on the left. */
static void paint(float *rgb, int frame)
{
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++)
            for (int c = 0; c < 3; c++) {
                float v = x < 16 ? (c == 0 ? 0.8f : 0.1f) : (float)x / WIDTH;
                rgb[3 * (y * WIDTH + x) + c] = y / 4 == frame ? 1 : v;
            }
}

static int make_pictures(void **state)
{
    (void)state;
    float rgb[WIDTH * HEIGHT * 3];
    if (!mkdtemp(folder)) return -1;
    for (int i = 0; i < N; i++) {
        paint(rgb, i);
        names[i] = cn_format("%s/%05d.png", folder, i);
        if (cn_oiio_write_png(names[i], rgb, WIDTH, HEIGHT, 3, NULL) != CN_OK) return -1;
    }
    return 0;
}

static int remove_pictures(void **state)
{
    (void)state;
    for (int i = 0; i < N; i++)
        free(names[i]);
    return folder_remove(folder);
}

static char *film(const char *name)
{
    char *path = cn_format("%s/%s", folder, name);
    cn_video_options options = cn_video_options_default();
    if (cn_video_encode(NULL, N, (const char *const *)names, &options, path) == CN_OK) return path;
    print_message("%s\n", cn_error_message());
    free(path);
    return NULL;
}

/* Mean of a plane over the pixels x0..x1 of a row that the bar of the first pictures does not come near. */
static double mean(const AVFrame *f, int plane, int x0, int x1)
{
    double sum = 0;
    int y = plane ? 18 : 36;
    for (int x = x0; x < x1; x++)
        sum += f->data[plane][y * f->linesize[plane] + x];
    return sum / (x1 - x0);
}

static void check_picture(const AVFrame *f)
{
    /* BT.709 of R 204, G 25.5, B 25.5, limited range. */
    const double y = 0.2126 * 0.8 + 0.7874 * 0.1, cb = (0.1 - y) / 1.8556, cr = (0.8 - y) / 1.5748;
    assert_true(fabs(mean(f, 0, 2, 12) - (16 + 219 * y)) < 2.5);
    assert_true(fabs(mean(f, 1, 1, 6) - (128 + 224 * cb)) < 2.5);
    assert_true(fabs(mean(f, 2, 1, 6) - (128 + 224 * cr)) < 2.5);
    assert_true(fabs(mean(f, 0, 38, 42) - (16 + 219 * 39.5 / WIDTH)) < 2.5); /* grey stays grey, and limited */
    assert_true(fabs(mean(f, 1, 19, 21) - 128) < 1.5);
}

static void a_film_holds_its_pictures(void **state)
{
    (void)state;
    char *path = film("a.mp4");
    assert_non_null(path);
    AVFormatContext *in = NULL;
    assert_int_equal(avformat_open_input(&in, path, NULL, NULL), 0);
    assert_true(avformat_find_stream_info(in, NULL) >= 0);
    assert_int_equal(in->nb_streams, 1);
    const AVCodecParameters *p = in->streams[0]->codecpar;
    assert_int_equal(p->codec_id, AV_CODEC_ID_H264);
    assert_int_equal(p->format, AV_PIX_FMT_YUV420P);
    assert_int_equal(p->width, WIDTH - 1);
    assert_int_equal(p->height, HEIGHT);
    assert_int_equal(p->color_space, AVCOL_SPC_BT709);
    assert_int_equal(p->color_primaries, AVCOL_PRI_BT709);
    assert_int_equal(p->color_trc, AVCOL_TRC_BT709);
    assert_int_equal(p->color_range, AVCOL_RANGE_MPEG);
    assert_true(fabs(av_q2d(in->streams[0]->avg_frame_rate) - 24) < 1e-9);
    AVCodecContext *decoder = avcodec_alloc_context3(avcodec_find_decoder(AV_CODEC_ID_H264));
    assert_non_null(decoder);
    assert_true(avcodec_parameters_to_context(decoder, p) >= 0 && avcodec_open2(decoder, NULL, NULL) >= 0);
    AVPacket *packet = av_packet_alloc();
    AVFrame *frame = av_frame_alloc();
    int n = 0;
    for (bool more = true; more;) {
        more = av_read_frame(in, packet) >= 0;
        assert_true(avcodec_send_packet(decoder, more ? packet : NULL) >= 0);
        av_packet_unref(packet);
        while (avcodec_receive_frame(decoder, frame) >= 0) {
            if (n < 7) check_picture(frame);
            /* The bar tells which picture this is. */
            if (n < HEIGHT / 4) assert_true(frame->data[0][(4 * n + 2) * frame->linesize[0] + 30] > 200);
            n++;
        }
    }
    assert_int_equal(n, N);
    av_frame_free(&frame);
    av_packet_free(&packet);
    avcodec_free_context(&decoder);
    avformat_close_input(&in);
    free(path);
}

static void the_same_pictures_give_the_same_bytes(void **state)
{
    (void)state;
    char *paths[2] = { film("b.mp4"), film("c.mp4") }, *data[2];
    size_t size[2];
    for (int i = 0; i < 2; i++) {
        assert_non_null(paths[i]);
        assert_int_equal(cn_file_read(paths[i], 0, &data[i], &size[i]), CN_OK);
    }
    assert_int_equal(size[0], size[1]);
    assert_memory_equal(data[0], data[1], size[0]);
    const char *moov = memmem(data[0], size[0], "moov", 4), *mdat = memmem(data[0], size[0], "mdat", 4);
    assert_true(moov && mdat && moov < mdat); /* plays from its first bytes on */
    for (int i = 0; i < 2; i++) {
        free(data[i]);
        free(paths[i]);
    }
}

static int n_said;
static void count_encoder(void *context, int level, const char *format, va_list arguments)
{
    (void)format;
    (void)arguments;
    const AVClass *class = context ? *(const AVClass **)context : NULL;
    if (level <= av_log_get_level() && class && class == avcodec_get_class()) n_said++;
}

/* libav's log belongs to the program; the library leaves its level, and its encoder says nothing. */
static void the_log_of_the_process_is_left_alone(void **state)
{
    (void)state;
    const int before = av_log_get_level();
    av_log_set_level(AV_LOG_VERBOSE);
    av_log_set_callback(count_encoder);
    char *path = film("quiet.mp4");
    av_log_set_callback(av_log_default_callback);
    assert_int_equal(av_log_get_level(), AV_LOG_VERBOSE);
    av_log_set_level(before);
    assert_non_null(path);
    assert_int_equal(n_said, 0);
    free(path);
    cn_video_own_process();
    assert_int_equal(av_log_get_level(), AV_LOG_QUIET);
    av_log_set_level(before);
}

static void what_cannot_be_filmed_is_named(void **state)
{
    (void)state;
    cn_video_options options = cn_video_options_default();
    const char *pictures[2] = { names[0], "/nonexistent/1.png" };
    char *path = cn_format("%s/bad.mp4", folder), *small = cn_format("%s/small.png", folder);
    const float rgb[20 * 20 * 3] = { 0 };
    assert_int_equal(cn_video_encode(NULL, 0, pictures, &options, path), CN_ERR_USAGE);
    assert_int_equal(cn_video_encode(NULL, 2, pictures, &options, path), CN_ERR_IO);
    assert_non_null(strstr(cn_error_message(), "/nonexistent/1.png"));
    assert_int_equal(cn_oiio_write_png(small, rgb, 20, 20, 3, NULL), CN_OK);
    pictures[1] = small;
    assert_int_equal(cn_video_encode(NULL, 2, pictures, &options, path), CN_ERR_DATA);
    assert_non_null(strstr(cn_error_message(), "small.png is 20 x 20"));
    assert_int_equal(cn_oiio_write_png(small, rgb, 8, 8, 3, NULL), CN_OK);
    assert_int_equal(cn_video_encode(NULL, 1, &pictures[1], &options, path), CN_ERR_DATA);
    assert_false(cn_file_exists(path));
    assert_int_equal(cn_video_encode(NULL, 1, pictures, &options, "/nonexistent/film.mp4"), CN_ERR_IO);
    assert_non_null(strstr(cn_error_message(), "/nonexistent/film.mp4"));
    options.fps = 0;
    assert_int_equal(cn_video_encode(NULL, 1, pictures, &options, path), CN_ERR_USAGE);
    int stop = 1;
    cn_context ctx = { .stop = &stop };
    options = cn_video_options_default();
    assert_int_equal(cn_video_encode(&ctx, N, (const char *const *)names, &options, path), CN_ERR_INTERRUPTED);
    assert_false(cn_file_exists(path));
    free(path);
    free(small);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_film_holds_its_pictures),
        cmocka_unit_test(the_same_pictures_give_the_same_bytes),
        cmocka_unit_test(the_log_of_the_process_is_left_alone),
        cmocka_unit_test(what_cannot_be_filmed_is_named),
    };
    return cmocka_run_group_tests(tests, make_pictures, remove_pictures);
}
