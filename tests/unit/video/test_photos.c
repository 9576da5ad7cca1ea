/* Photos out of a film: which pictures, upright, with time and place. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../common.h"
#include "base/file.h"
#include "bridge/exiv2.h"
#include "bridge/oiio.h"
#include "conurb/city.h"
#include "conurb/video.h"
#include "video/choose.h"

#include <dirent.h>
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/display.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* One second at rest, four in which the camera moves to the right by 4 pixels a picture, one at rest. */
enum { WIDTH = 320, HEIGHT = 240, FPS = 10, REST = 10, MOVE = 40, N = REST + MOVE + REST, STEP = 4 };

#define assert_near(value, want, tolerance) assert_true(fabs((double)(value) - (want)) <= (tolerance))

static char folder[] = "/tmp/conurb_photos_XXXXXX";
static char *film, *phone, *photos, logged[LOGGED];

static const cn_context CONTEXT = { .log = log_append, .user = logged };

static float texture(double x, double y)
{
    return (float)(0.5 + 0.2 * sin(x / 9) * cos(y / 7) + 0.15 * sin(x / 23 + y / 17) +
                   0.12 * sin(0.9 * x) * sin(0.8 * y));
}

/* While the camera moves, two of three pictures are blurred. A red field at the top left tells which way is up. */
static bool is_blurred(int frame)
{
    return frame >= REST && frame < REST + MOVE && frame % 3 != 1;
}

static void paint(float *rgb, int frame)
{
    const int moved = STEP * (frame < REST ? 0 : frame < REST + MOVE ? frame - REST : MOVE);
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++) {
            float v = 0;
            const int reach = is_blurred(frame) ? 6 : 0;
            for (int k = -reach; k <= reach; k++)
                v += texture(x + moved + k, y) / (float)(2 * reach + 1);
            for (int c = 0; c < 3; c++)
                rgb[3 * (y * WIDTH + x) + c] = x < 40 && y < 30 ? (c == 0 ? 0.9f : 0.1f) : v;
        }
}

/* The film again, as a phone held upright writes it: turned by a matrix, with a time and a model. */
static void make_phone(void)
{
    AVFormatContext *in = NULL, *out = NULL;
    AVPacket *packet = av_packet_alloc();
    assert_true(avformat_open_input(&in, film, NULL, NULL) >= 0);
    assert_true(avformat_find_stream_info(in, NULL) >= 0);
    assert_true(avformat_alloc_output_context2(&out, NULL, "mov", phone) >= 0);
    AVStream *stream = avformat_new_stream(out, NULL);
    assert_true(avcodec_parameters_copy(stream->codecpar, in->streams[0]->codecpar) >= 0);
    stream->time_base = in->streams[0]->time_base;
    uint8_t *matrix = av_stream_new_side_data(stream, AV_PKT_DATA_DISPLAYMATRIX, 9 * sizeof(int32_t));
    assert_non_null(matrix);
    av_display_rotation_set((int32_t *)(void *)matrix, 90); /* a quarter turn clockwise */
    av_dict_set(&out->metadata, "creation_time", "2024-05-01T10:00:00.000000Z", 0);
    av_dict_set(&out->metadata, "model", "Phone 7", 0);
    assert_true(avio_open(&out->pb, phone, AVIO_FLAG_WRITE) >= 0);
    assert_true(avformat_write_header(out, NULL) >= 0);
    while (av_read_frame(in, packet) >= 0) {
        av_packet_rescale_ts(packet, in->streams[0]->time_base, stream->time_base);
        assert_true(av_interleaved_write_frame(out, packet) >= 0);
    }
    assert_true(av_write_trailer(out) >= 0);
    avio_closep(&out->pb);
    avformat_free_context(out);
    avformat_close_input(&in);
    av_packet_free(&packet);
}

static int make_films(void **state)
{
    (void)state;
    static float rgb[WIDTH * HEIGHT * 3];
    char *names[N];
    if (!mkdtemp(folder)) return -1;
    film = cn_format("%s/walk.mp4", folder);
    phone = cn_format("%s/phone.mov", folder);
    photos = cn_format("%s/photos", folder);
    for (int i = 0; i < N; i++) {
        paint(rgb, i);
        names[i] = cn_format("%s/%05d.png", folder, i);
        if (cn_oiio_write_png(names[i], rgb, WIDTH, HEIGHT, 3, NULL) != CN_OK) return -1;
    }
    const cn_video_options options = { .fps = FPS, .quality = 10 };
    if (cn_video_encode(NULL, N, (const char *const *)names, &options, film) != CN_OK) return -1;
    for (int i = 0; i < N; i++) {
        unlink(names[i]);
        free(names[i]);
    }
    make_phone();
    return 0;
}

static int remove_films(void **state)
{
    (void)state;
    free(film);
    free(phone);
    free(photos);
    return folder_remove(folder);
}

static int before_each(void **state)
{
    (void)state;
    logged[0] = '\0';
    char *command = cn_format("rm -rf %s/photos %s/*.srt %s/city", folder, folder, folder);
    const int status = system(command);
    free(command);
    return status;
}

static void write_text(const char *path, const char *text)
{
    FILE *stream = fopen(path, "w");
    assert_non_null(stream);
    fputs(text, stream);
    assert_int_equal(fclose(stream), 0);
}

/* The milliseconds in the names of the photos, in order. */
static size_t list(const char *in, const char *stem, int *at_ms, size_t room)
{
    struct dirent **names;
    const int n = scandir(in, &names, NULL, alphasort);
    size_t found = 0;
    assert_true(n >= 0);
    for (int i = 0; i < n; i++) {
        char form[64];
        snprintf(form, sizeof form, "%s_%%8d.jpg", stem);
        if (found < room && sscanf(names[i]->d_name, form, &at_ms[found]) == 1) found++;
        free(names[i]);
    }
    free(names);
    return found;
}

static void test_pictures(void **state)
{
    (void)state;
    cn_film_options options = cn_film_options_default();
    size_t n;
    int at[N];
    assert_int_equal(cn_video_take_photos(&CONTEXT, film, photos, &options, &n), CN_OK);
    assert_int_equal(list(photos, "walk", at, N), n);
    assert_true(n >= 7 && n <= 9); /* four seconds of motion, every half second */
    int at_rest = 0;
    for (size_t i = 0; i < n; i++) {
        const int frame = at[i] / 100;
        assert_false(is_blurred(frame));
        at_rest += frame < REST - 1 || frame > REST + MOVE;
        if (i) assert_true(at[i] - at[i - 1] >= 200 && at[i] - at[i - 1] <= 1500);
    }
    assert_true(at_rest <= 2);
    assert_non_null(strstr(logged, "photos out of 60 pictures, 0 with a place"));
    /* Fewer photos the next time: those of before are gone. */
    options.every_s = 2;
    assert_int_equal(cn_video_take_photos(&CONTEXT, film, photos, &options, &n), CN_OK);
    assert_int_equal(n, 2);
    assert_int_equal(list(photos, "walk", at, N), 2);
}

static void test_upright(void **state)
{
    (void)state;
    cn_film_options options = cn_film_options_default();
    size_t n;
    int at[N];
    float *rgba;
    uint32_t width, height;
    cn_exif exif;
    options.every_s = 2;
    assert_int_equal(cn_video_take_photos(&CONTEXT, phone, photos, &options, &n), CN_OK);
    assert_int_equal(list(photos, "phone", at, N), 2);
    char *path = cn_format("%s/phone_%08d.jpg", photos, at[1]);
    assert_int_equal(cn_oiio_read_rgba(path, &rgba, &width, &height), CN_OK);
    assert_int_equal(width, HEIGHT);
    assert_int_equal(height, WIDTH);
    /* The red field of the top left is at the top right. */
    const float *corner = rgba + 4 * ((size_t)20 * width + width - 15);
    assert_near(corner[0], 0.9, 0.06);
    assert_near(corner[1], 0.1, 0.06);
    free(rgba);
    assert_int_equal(cn_exiv2_read(path, &exif), CN_OK);
    char date[32];
    snprintf(date, sizeof date, "2024:05:01 10:00:%02d", at[1] / 1000);
    assert_string_equal(exif.datetime, date);
    free(path);
}

static void test_places(void **state)
{
    (void)state;
    cn_film_options options = cn_film_options_default();
    size_t n;
    int at[N];
    cn_exif exif;
    char *srt = cn_format("%s/walk.srt", folder), *gpx = cn_format("%s/other.gpx", folder);
    /* A drone's SRT beside the film, found by its name */
    write_text(srt,
               "1\n00:00:00,000 --> 00:00:01,000\n[latitude: 46.0] [longitude: 8.0] [rel_alt: 1 abs_alt: 500]\n\n"
               "2\n00:00:06,000 --> 00:00:07,000\n[latitude: 46.006] [longitude: -8.0] [rel_alt: 1 abs_alt: 506]\n");
    assert_int_equal(cn_video_take_photos(&CONTEXT, film, photos, &options, &n), CN_OK);
    assert_non_null(strstr(logged, "places of the photos: from "));
    assert_int_equal(list(photos, "walk", at, N), n);
    char *path = cn_format("%s/walk_%08d.jpg", photos, at[2]);
    assert_int_equal(cn_exiv2_read(path, &exif), CN_OK);
    assert_true(exif.has_latlon && exif.has_altitude);
    assert_near(exif.latitude_deg, 46 + 0.001 * at[2] / 1000, 1e-6);
    assert_near(exif.altitude_m, 500 + at[2] / 1000.0, 0.01);
    /* A track by the clock needs a film that says when it was made. */
    write_text(gpx, "<gpx><trkpt lat=\"47\" lon=\"8\"><time>2024-05-01T09:59:58Z</time></trkpt>"
                    "<trkpt lat=\"47.001\" lon=\"8\"><time>2024-05-01T10:00:06Z</time></trkpt></gpx>");
    options.track = gpx;
    assert_int_equal(cn_video_take_photos(&CONTEXT, film, photos, &options, &n), CN_ERR_DATA);
    assert_non_null(strstr(cn_error_message(), "does not say when it was made"));
    assert_int_equal(cn_video_take_photos(&CONTEXT, phone, photos, &options, &n), CN_OK);
    free(path);
    assert_int_equal(list(photos, "phone", at, N), n);
    path = cn_format("%s/phone_%08d.jpg", photos, at[0]);
    assert_int_equal(cn_exiv2_read(path, &exif), CN_OK);
    assert_near(exif.latitude_deg, 47 + 0.001 * (2 + at[0] / 1000.0) / 8, 1e-6);
    /* A clock that is an hour ahead, and what to do about it */
    options.offset_s = -3600;
    assert_int_equal(cn_video_take_photos(&CONTEXT, phone, photos, &options, &n), CN_ERR_DATA);
    assert_non_null(strstr(cn_error_message(), "covers another time than the film"));
    assert_int_equal(list(photos, "phone", at, N) > 0, 1); /* what was there stays */
    free(path);
    free(srt);
    free(gpx);
}

static void test_bad(void **state)
{
    (void)state;
    cn_film_options options = cn_film_options_default();
    size_t n;
    char *text = cn_format("%s/text.mp4", folder), *cut = cn_format("%s/cut.mp4", folder), *bytes;
    size_t size;
    write_text(text, "no film");
    assert_int_equal(cn_video_take_photos(&CONTEXT, text, photos, &options, &n), CN_ERR_FORMAT);
    assert_non_null(strstr(cn_error_message(), "no film that can be read"));
    assert_int_equal(cn_video_take_photos(&CONTEXT, "/nonexistent.mp4", photos, &options, &n), CN_ERR_IO);
    options.every_s = 0;
    assert_int_equal(cn_video_take_photos(&CONTEXT, film, photos, &options, &n), CN_ERR_USAGE);
    options.every_s = 0.5;
    assert_false(cn_file_exists(photos));
    /* A film that breaks off (its table comes first) gives what it has. */
    assert_int_equal(cn_file_read(film, 0, &bytes, &size), CN_OK);
    FILE *stream = fopen(cut, "wb");
    assert_non_null(stream);
    assert_int_equal(fwrite(bytes, 1, size / 2, stream), size / 2);
    assert_int_equal(fclose(stream), 0);
    free(bytes);
    assert_int_equal(cn_video_take_photos(&CONTEXT, cut, photos, &options, &n), CN_OK);
    assert_true(n >= 1);
    const int stop = 1;
    const cn_context stopping = { .stop = &stop };
    assert_int_equal(cn_video_take_photos(&stopping, film, photos, &options, &n), CN_ERR_INTERRUPTED);
    free(text);
    free(cut);
}

/* conurb init CITY --video: the city's photos are those of the film. */
static void test_init(void **state)
{
    (void)state;
    char *city = cn_format("%s/city", folder), *taken = cn_format("%s/city/photos", folder);
    int at[N];
    cn_init_options options = { .video = film, .film = cn_film_options_default() };
    assert_int_equal(cn_city_init(&CONTEXT, city, &options), CN_OK);
    assert_true(list(taken, "walk", at, N) >= 7);
    cn_city *opened;
    assert_int_equal(cn_city_open(&opened, city), CN_OK);
    cn_city_close(&opened);
    assert_int_equal(cn_city_init(&CONTEXT, city, &options), CN_ERR_USAGE);
    assert_non_null(strstr(cn_error_message(), "already is a city"));
    options.photos = folder;
    assert_int_equal(cn_city_init(&CONTEXT, city, &options), CN_ERR_USAGE);
    assert_non_null(strstr(cn_error_message(), "not both"));
    options = (cn_init_options){ .photos = film };
    assert_int_equal(cn_city_init(&CONTEXT, city, &options), CN_ERR_DATA);
    assert_non_null(strstr(cn_error_message(), "is a file, not the folder that holds the photos"));
    free(city);
    free(taken);
}

/* Parts of equal motion: where the camera is twice as fast, photos are twice as close in time. */
static void test_choose(void **state)
{
    (void)state;
    enum { PICTURES = 300 };
    static cn_film_picture pictures[PICTURES];
    static size_t chosen[PICTURES];
    for (int i = 0; i < PICTURES; i++)
        pictures[i] = (cn_film_picture){ i * 0.1, i == 0 ? 0 : i < 200 ? 0.01 : 0.04, 1 };
    assert_int_equal(cn_film_choose(pictures, PICTURES, 1, chosen), 30);
    size_t late = 0;
    for (int i = 0; i < 30; i++) {
        late += chosen[i] >= 200;
        if (i) assert_true(chosen[i] > chosen[i - 1]);
    }
    assert_in_range(late, 19, 21);
    for (int i = 0; i < PICTURES; i++)
        pictures[i].motion = 0;
    pictures[123].sharpness = 3;
    assert_int_equal(cn_film_choose(pictures, PICTURES, 1, chosen), 1);
    assert_int_equal(chosen[0], 123);
    assert_int_equal(cn_film_choose(pictures, 0, 1, chosen), 0);
    assert_int_equal(cn_film_choose(pictures, 1, 1, chosen), 1);
}

#define TEST(name) cmocka_unit_test_setup(name, before_each)

int main(void)
{
    const struct CMUnitTest tests[] = { TEST(test_pictures), TEST(test_upright), TEST(test_places),
                                        TEST(test_bad),      TEST(test_init),    TEST(test_choose) };
    av_log_set_level(AV_LOG_QUIET);
    return cmocka_run_group_tests(tests, make_films, remove_films);
}
