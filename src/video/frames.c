/* Photos out of a film, in two passes: the first measures every picture, the second writes the chosen ones. */
#include "base/clock.h"
#include "base/file.h"
#include "bridge/oiio.h"
#include "conurb/video.h"
#include "video/choose.h"
#include "video/input.h"

#include <dirent.h>
#include <libswscale/swscale.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { GREY_WIDTH = 640, SMALL_WIDTH = 160, MIN_SIDE = 16 };

typedef struct taker {
    const cn_context *ctx;
    const char *path, *folder;
    const cn_film_options *options;
    cn_film *film;
    cn_gps_track track;
    struct SwsContext *scaler;
    cn_film_picture *pictures;
    size_t n, room;
    size_t *chosen, n_chosen, n_placed;
    uint8_t *grey, *small, *reference;
    int grey_h, small_h;
    bool has_reference;
    double started_s;
} taker;

cn_film_options cn_film_options_default(void)
{
    return (cn_film_options){ .every_s = 0.5 };
}

static cn_status no_memory(const taker *t)
{
    return cn_fail(CN_ERR_NOMEM, "%s: out of memory", t->path);
}

/* pass: 0 or 1. */
static void tell(const taker *t, int pass, double time_s)
{
    const double duration_s = cn_film_facts_of(t->film)->duration_s, elapsed_s = cn_now_s() - t->started_s;
    const double done_s = pass * duration_s + fmin(time_s, duration_s), total_s = 2 * duration_s;
    const cn_progress_report report = { "frames", NULL,      done_s,
                                        total_s,  elapsed_s, done_s > 0 ? elapsed_s / done_s * (total_s - done_s) : -1,
                                        NULL };
    cn_progress(t->ctx, &report);
}

/* The film's name; photos are named by it up to the first full stop. */
static const char *stem_of(const taker *t)
{
    const char *name = cn_path_base(t->path);
    return *name == '.' ? "film" : name;
}

static cn_status stopped(const taker *t)
{
    return cn_fail(CN_ERR_INTERRUPTED, "stopped while taking photos out of %s; run the same command to take them",
                   t->path);
}

/* ---- The first pass ---- */

static cn_status shrink(taker *t, const AVFrame *picture, uint8_t *to, int w, int h)
{
    t->scaler = sws_getCachedContext(t->scaler, picture->width, picture->height, picture->format, w, h,
                                     AV_PIX_FMT_GRAY8, SWS_AREA | SWS_BITEXACT, NULL, NULL, NULL);
    if (!t->scaler) return no_memory(t);
    uint8_t *planes[4] = { to };
    const int strides[4] = { w };
    sws_scale(t->scaler, (const uint8_t *const *)picture->data, picture->linesize, 0, picture->height, planes, strides);
    return CN_OK;
}

/* The small picture is a mean of 4 x 4 pixels of the grey one. */
static void halve_twice(const taker *t)
{
    for (int y = 0; y < t->small_h; y++)
        for (int x = 0; x < SMALL_WIDTH; x++) {
            int sum = 8;
            for (int k = 0; k < 16; k++)
                sum += t->grey[(ptrdiff_t)(4 * y + k / 4) * GREY_WIDTH + 4 * x + k % 4];
            t->small[(ptrdiff_t)y * SMALL_WIDTH + x] = (uint8_t)(sum / 16);
        }
}

/* Motion counts from the last picture that had any, and only when it reaches a pixel of the small picture: the noise
 * of a camera that stands still never does. */
static double moved(taker *t)
{
    const size_t bytes = (size_t)SMALL_WIDTH * (size_t)t->small_h;
    const double px = t->has_reference ? cn_film_motion(t->reference, t->small, SMALL_WIDTH, t->small_h) : 0;
    if (t->has_reference && px < 1) return 0;
    memcpy(t->reference, t->small, bytes);
    t->has_reference = true;
    return px / SMALL_WIDTH;
}

static cn_status measure(taker *t, const AVFrame *picture, double time_s)
{
    if (t->n == t->room) {
        const size_t room = t->room ? 2 * t->room : 1024;
        cn_film_picture *more = realloc(t->pictures, room * sizeof *more);
        if (!more) return no_memory(t);
        t->pictures = more;
        t->room = room;
    }
    CN_TRY(shrink(t, picture, t->grey, GREY_WIDTH, t->grey_h));
    halve_twice(t);
    cn_film_picture *p = &t->pictures[t->n++];
    p->time_s = time_s;
    p->sharpness = cn_film_sharpness(t->grey, GREY_WIDTH, GREY_WIDTH, t->grey_h);
    p->motion = moved(t);
    return CN_OK;
}

static cn_status look(taker *t)
{
    const cn_film_facts *facts = cn_film_facts_of(t->film);
    if (facts->width < MIN_SIDE || facts->height < MIN_SIDE)
        return cn_fail(CN_ERR_DATA, "%s: its pictures have %u x %u pixels; each side needs at least %d", t->path,
                       facts->width, facts->height, MIN_SIDE);
    t->small_h = (int)fmax(3, round((double)SMALL_WIDTH * facts->height / facts->width));
    t->grey_h = 4 * t->small_h;
    t->grey = malloc((size_t)GREY_WIDTH * (size_t)t->grey_h);
    t->small = malloc((size_t)SMALL_WIDTH * (size_t)t->small_h);
    t->reference = malloc((size_t)SMALL_WIDTH * (size_t)t->small_h);
    if (!t->grey || !t->small || !t->reference) return no_memory(t);
    for (;;) {
        const AVFrame *picture;
        double time_s = 0;
        if (cn_stopping(t->ctx)) return stopped(t);
        CN_TRY(cn_film_next(t->film, &picture, &time_s));
        if (!picture) break;
        CN_TRY(measure(t, picture, time_s));
        tell(t, 0, time_s);
    }
    if (!t->n) return cn_fail(CN_ERR_DATA, "%s: no picture in it can be decoded", t->path);
    t->chosen = malloc(t->n * sizeof *t->chosen);
    if (!t->chosen) return no_memory(t);
    t->n_chosen = cn_film_choose(t->pictures, t->n, t->options->every_s, t->chosen);
    return CN_OK;
}

/* ---- Places ---- */

/* A track beside the film: the same name with another ending. */
static cn_status read_beside(taker *t)
{
    static const char *const ENDINGS[] = { ".srt", ".SRT", ".gpx", ".GPX" };
    const char *name = strrchr(t->path, '/'), *dot = strrchr(name ? name : t->path, '.');
    const int stem = (int)(dot ? dot - t->path : (ptrdiff_t)strlen(t->path));
    for (size_t i = 0; i < sizeof ENDINGS / sizeof *ENDINGS && !t->track.n; i++) {
        char *beside = cn_format("%.*s%s", stem, t->path, ENDINGS[i]);
        if (!beside) return no_memory(t);
        cn_status status = CN_OK;
        if (cn_file_exists(beside)) {
            status = cn_gps_track_read(&t->track, beside);
            /* A film may have subtitles that are no track. */
            if (status == CN_OK)
                cn_log(t->ctx, CN_LOG_INFO, "places of the photos: from %s", beside);
            else if (status == CN_ERR_FORMAT) {
                cn_log(t->ctx, CN_LOG_WARN, "%s: is left out", cn_error_message());
                status = CN_OK;
            }
        }
        free(beside);
        CN_TRY(status);
    }
    return CN_OK;
}

/* What is to be added to a time of the film to be a time of the track. */
static cn_status clock_of(const taker *t, double *offset_s)
{
    *offset_s = t->options->offset_s;
    if (t->track.from_start || !t->track.n) return CN_OK;
    const double created_s = cn_film_facts_of(t->film)->created_s;
    if (isnan(created_s))
        return cn_fail(CN_ERR_DATA,
                       "%s does not say when it was made, so a track by the clock cannot be matched; give an SRT, or "
                       "leave the track out",
                       t->path);
    *offset_s += created_s;
    return CN_OK;
}

static cn_status find_track(taker *t)
{
    if (t->options->track) {
        cn_gps_track_deinit(&t->track);
        return cn_gps_track_read(&t->track, t->options->track);
    }
    if (t->track.n) {
        cn_gps_track_sort(&t->track);
        cn_log(t->ctx, CN_LOG_INFO, "places of the photos: from the film's telemetry");
        return CN_OK;
    }
    return read_beside(t);
}

/* ---- The second pass ---- */

static void sexagesimal(double degrees, double out[3])
{
    degrees = fabs(degrees);
    out[0] = floor(degrees);
    out[1] = floor((degrees - out[0]) * 60);
    out[2] = ((degrees - out[0]) * 60 - out[1]) * 60;
}

typedef struct photo {
    const float *rgb;
    uint32_t width, height;
    double time_s;
    const cn_gps_point *place; /* NULL: unknown */
} photo;

/* Writes a JPEG with the EXIF that the film and its track give. */
static cn_status write_photo(const taker *t, const char *file, const photo *p)
{
    const cn_film_facts *facts = cn_film_facts_of(t->film);
    cn_oiio_attribute a[16];
    double latitude[3], longitude[3], altitude = 0, below = 0;
    char date[24] = "", part[8] = "";
    int n = 0;
    if (!isnan(facts->created_s)) {
        const double at_s = facts->created_s + p->time_s;
        const time_t whole = (time_t)floor(at_s);
        struct tm tm;
        gmtime_r(&whole, &tm);
        strftime(date, sizeof date, "%Y:%m:%d %H:%M:%S", &tm);
        snprintf(part, sizeof part, "%03d", (int)((at_s - floor(at_s)) * 1000));
        a[n++] = (cn_oiio_attribute){ "Exif:DateTimeOriginal", date, NULL, 0 };
        a[n++] = (cn_oiio_attribute){ "Exif:SubsecTimeOriginal", part, NULL, 0 };
    }
    if (facts->make[0]) a[n++] = (cn_oiio_attribute){ "Make", facts->make, NULL, 0 };
    if (facts->model[0]) a[n++] = (cn_oiio_attribute){ "Model", facts->model, NULL, 0 };
    const cn_gps_point *place = p->place;
    if (place) {
        sexagesimal(place->latitude_deg, latitude);
        sexagesimal(place->longitude_deg, longitude);
        a[n++] = (cn_oiio_attribute){ "GPS:Latitude", NULL, latitude, 3 };
        a[n++] = (cn_oiio_attribute){ "GPS:LatitudeRef", place->latitude_deg < 0 ? "S" : "N", NULL, 0 };
        a[n++] = (cn_oiio_attribute){ "GPS:Longitude", NULL, longitude, 3 };
        a[n++] = (cn_oiio_attribute){ "GPS:LongitudeRef", place->longitude_deg < 0 ? "W" : "E", NULL, 0 };
        if (!isnan(place->altitude_m)) {
            altitude = fabs(place->altitude_m);
            below = place->altitude_m < 0;
            a[n++] = (cn_oiio_attribute){ "GPS:Altitude", NULL, &altitude, 1 };
            a[n++] = (cn_oiio_attribute){ "GPS:AltitudeRef", NULL, &below, 1 };
        }
    }
    a[n] = (cn_oiio_attribute){ NULL, NULL, NULL, 0 };
    return cn_oiio_write_jpeg(file, p->rgb, p->width, p->height, a);
}

/* Full-range RGB by the film's own matrix and range; BT.709 where it names none. */
static cn_status to_rgb(taker *t, const AVFrame *picture, uint8_t *rgb)
{
    const int w = picture->width, h = picture->height;
    t->scaler =
        sws_getCachedContext(t->scaler, w, h, picture->format, w, h, AV_PIX_FMT_RGB24,
                             SWS_BICUBIC | SWS_ACCURATE_RND | SWS_FULL_CHR_H_INT | SWS_BITEXACT, NULL, NULL, NULL);
    if (!t->scaler) return no_memory(t);
    const int matrix = picture->colorspace == AVCOL_SPC_BT2020_NCL ? SWS_CS_BT2020
                       : picture->colorspace == AVCOL_SPC_SMPTE170M || picture->colorspace == AVCOL_SPC_BT470BG
                           ? SWS_CS_ITU601
                           : SWS_CS_ITU709;
    sws_setColorspaceDetails(t->scaler, sws_getCoefficients(matrix), picture->color_range == AVCOL_RANGE_JPEG,
                             sws_getCoefficients(SWS_CS_ITU709), 1, 0, 1 << 16, 1 << 16);
    uint8_t *planes[4] = { rgb };
    const int strides[4] = { 3 * w };
    sws_scale(t->scaler, (const uint8_t *const *)picture->data, picture->linesize, 0, h, planes, strides);
    return CN_OK;
}

/* Floats of the upright picture: `turns` quarters clockwise. */
static void turn(const uint8_t *rgb, uint32_t w, uint32_t h, int turns, float *out)
{
    const uint32_t width = turns % 2 ? h : w, height = turns % 2 ? w : h;
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            const uint32_t sx = turns == 0 ? x : turns == 1 ? y : turns == 2 ? w - 1 - x : w - 1 - y;
            const uint32_t sy = turns == 0 ? y : turns == 1 ? h - 1 - x : turns == 2 ? h - 1 - y : x;
            for (int c = 0; c < 3; c++)
                out[3 * ((size_t)y * width + x) + (size_t)c] = (float)rgb[3 * ((size_t)sy * w + sx) + (size_t)c] / 255;
        }
}

static cn_status keep(taker *t, const AVFrame *picture, double time_s, double offset_s)
{
    const uint32_t w = (uint32_t)picture->width, h = (uint32_t)picture->height;
    const int turns = cn_film_facts_of(t->film)->quarter_turns;
    char *file =
        cn_format("%s/%.*s_%08.0f.jpg", t->folder, (int)strcspn(stem_of(t), "."), stem_of(t), round(time_s * 1000));
    uint8_t *rgb = malloc((size_t)3 * w * h);
    float *upright = malloc((size_t)3 * w * h * sizeof *upright);
    cn_gps_point place;
    const bool placed = cn_gps_track_at(&t->track, time_s + offset_s, &place);
    cn_status status = file && rgb && upright ? to_rgb(t, picture, rgb) : no_memory(t);
    if (status == CN_OK) {
        turn(rgb, w, h, turns, upright);
        const photo p = { upright, turns % 2 ? h : w, turns % 2 ? w : h, time_s, placed ? &place : NULL };
        status = write_photo(t, file, &p);
    }
    free(file);
    free(rgb);
    free(upright);
    return status;
}

/* Photos that an earlier call left: other settings choose other pictures. */
static cn_status remove_old(const taker *t)
{
    const size_t stem = strcspn(stem_of(t), "."), digits = 8;
    DIR *dir = opendir(t->folder);
    const char *name;
    if (!dir) return cn_fail(CN_ERR_IO, "cannot read the folder %s", t->folder);
    cn_status status;
    while ((status = cn_folder_next(dir, t->folder, &name)) == CN_OK && name) {
        const size_t n = strlen(name);
        if (n < stem + digits + 5 || strncmp(name, stem_of(t), stem) != 0 || name[stem] != '_' ||
            strspn(name + stem + 1, "0123456789") + stem + 5 != n || strcmp(name + n - 4, ".jpg") != 0)
            continue;
        char *path = cn_path_join(t->folder, name);
        status = path ? cn_file_remove(path) : no_memory(t);
        free(path);
        if (status != CN_OK) break;
    }
    closedir(dir);
    return status;
}

static size_t count_placed(const taker *t, double offset_s)
{
    size_t n = 0;
    cn_gps_point place;
    for (size_t i = 0; i < t->n_chosen; i++)
        n += cn_gps_track_at(&t->track, t->pictures[t->chosen[i]].time_s + offset_s, &place);
    return n;
}

static cn_status write_all(taker *t)
{
    double offset_s;
    CN_TRY(clock_of(t, &offset_s));
    t->n_placed = count_placed(t, offset_s);
    if (t->track.n && !t->n_placed)
        return cn_fail(CN_ERR_DATA,
                       "%s: the track covers another time than the film; give the seconds by which its clock is ahead "
                       "(--track-offset)",
                       t->options->track ? t->options->track : t->path);
    cn_film_close(&t->film);
    CN_TRY(cn_film_open(&t->film, t->path, cn_pool_threads(t->ctx ? t->ctx->pool : NULL), NULL));
    CN_TRY(cn_folder_make(t->folder));
    CN_TRY(remove_old(t));
    size_t next = 0;
    for (size_t i = 0; next < t->n_chosen; i++) {
        const AVFrame *picture;
        double time_s = 0;
        if (cn_stopping(t->ctx)) return stopped(t);
        CN_TRY(cn_film_next(t->film, &picture, &time_s));
        if (!picture) return cn_fail(CN_ERR_DATA, "%s has changed while it was read; run the command again", t->path);
        if (i == t->chosen[next]) {
            CN_TRY(keep(t, picture, time_s, offset_s));
            next++;
        }
        tell(t, 1, time_s);
    }
    return CN_OK;
}

static cn_status take(taker *t)
{
    CN_TRY(cn_film_open(&t->film, t->path, cn_pool_threads(t->ctx ? t->ctx->pool : NULL),
                        t->options->track ? NULL : &t->track));
    if (cn_film_facts_of(t->film)->is_hdr)
        cn_log(
            t->ctx, CN_LOG_WARN,
            "%s is HDR (HLG or PQ); its colours are taken as they are stored, and look flat; a film in SDR is better",
            t->path);
    CN_TRY(look(t));
    CN_TRY(find_track(t));
    CN_TRY(write_all(t));
    cn_log(t->ctx, CN_LOG_INFO, "%s: %zu photos out of %zu pictures, %zu with a place", t->path, t->n_chosen, t->n,
           t->n_placed);
    return CN_OK;
}

cn_status cn_video_take_photos(const cn_context *ctx, const char *path, const char *folder,
                               const cn_film_options *options, size_t *n_photos)
{
    taker t = { .ctx = ctx, .path = path, .folder = folder, .options = options, .started_s = cn_now_s() };
    *n_photos = 0;
    if (!(options->every_s >= 0.01 && options->every_s <= 3600))
        return cn_fail(CN_ERR_USAGE, "a photo every %g s is not possible; give 0.01 to 3600 seconds", options->every_s);
    const cn_status status = take(&t);
    if (status == CN_OK) *n_photos = t.n_chosen;
    cn_film_close(&t.film);
    cn_gps_track_deinit(&t.track);
    sws_freeContext(t.scaler);
    free(t.pictures);
    free(t.chosen);
    free(t.grey);
    free(t.small);
    free(t.reference);
    return status;
}
