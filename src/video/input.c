#include "video/input.h"

#include "base/date.h"

#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/display.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct cn_film {
    char *path;
    AVFormatContext *format;
    AVCodecContext *codec;
    AVPacket *packet;
    AVFrame *frame;
    cn_gps_track *telemetry;
    cn_film_facts facts;
    int video, gpmf; /* streams; gpmf -1: none */
    double first_s;  /* of the first picture; NaN before it */
    bool draining;
};

static cn_status no_film(const char *path, int error)
{
    char text[AV_ERROR_MAX_STRING_SIZE] = "";
    if (error == AVERROR(ENOMEM)) return cn_fail(CN_ERR_NOMEM, "%s: out of memory", path);
    av_strerror(error, text, sizeof text);
    if (error == AVERROR(ENOENT) || error == AVERROR(EACCES))
        return cn_fail(CN_ERR_IO, "%s: cannot be read: %s", path, text);
    return cn_fail(CN_ERR_FORMAT, "%s: no film that can be read: %s", path, text);
}

static const char *tag(const cn_film *film, const char *name)
{
    const AVDictionaryEntry *e = av_dict_get(film->format->metadata, name, NULL, 0);
    if (!e) e = av_dict_get(film->format->streams[film->video]->metadata, name, NULL, 0);
    return e ? e->value : NULL;
}

static void read_facts(cn_film *film)
{
    cn_film_facts *facts = &film->facts;
    const AVStream *stream = film->format->streams[film->video];
    const char *created = tag(film, "creation_time"), *make = tag(film, "com.apple.quicktime.make"),
               *model = tag(film, "com.apple.quicktime.model");
    if (!make) make = tag(film, "make");
    if (!model) model = tag(film, "model");
    facts->width = (uint32_t)stream->codecpar->width;
    facts->height = (uint32_t)stream->codecpar->height;
    facts->duration_s = film->format->duration > 0 ? (double)film->format->duration / AV_TIME_BASE : 0;
    facts->created_s = created ? cn_parse_date_time(created) : NAN;
    facts->is_hdr =
        stream->codecpar->color_trc == AVCOL_TRC_SMPTE2084 || stream->codecpar->color_trc == AVCOL_TRC_ARIB_STD_B67;
    snprintf(facts->make, sizeof facts->make, "%s", make ? make : "");
    snprintf(facts->model, sizeof facts->model, "%s", model ? model : "");
    size_t size = 0;
    const uint8_t *matrix = av_stream_get_side_data(stream, AV_PKT_DATA_DISPLAYMATRIX, &size);
    if (!matrix || size < 9 * sizeof(int32_t)) return;
    const double degrees = av_display_rotation_get((const int32_t *)(const void *)matrix); /* counterclockwise */
    if (!isnan(degrees)) facts->quarter_turns = (int)(((lrint(-degrees / 90) % 4) + 4) % 4);
}

static int open_codec(cn_film *film, unsigned threads)
{
    const AVCodec *decoder = NULL;
    film->video = av_find_best_stream(film->format, AVMEDIA_TYPE_VIDEO, -1, -1, &decoder, 0);
    if (film->video < 0) return film->video;
    film->codec = avcodec_alloc_context3(decoder);
    film->packet = av_packet_alloc();
    film->frame = av_frame_alloc();
    if (!film->codec || !film->packet || !film->frame) return AVERROR(ENOMEM);
    const int error = avcodec_parameters_to_context(film->codec, film->format->streams[film->video]->codecpar);
    if (error < 0) return error;
    film->codec->thread_count = (int)(threads ? threads : 1);
    film->codec->log_level_offset = AV_LOG_MAX_OFFSET; /* errors are counted, not printed */
    return avcodec_open2(film->codec, decoder, NULL);
}

cn_status cn_film_open(cn_film **out, const char *path, unsigned threads, cn_gps_track *telemetry)
{
    cn_film *film = *out = calloc(1, sizeof *film);
    if (!film || !(film->path = strdup(path))) {
        cn_film_close(out);
        return cn_fail(CN_ERR_NOMEM, "%s: out of memory", path);
    }
    film->first_s = NAN;
    film->gpmf = -1;
    int error = avformat_open_input(&film->format, path, NULL, NULL);
    if (error >= 0) error = avformat_find_stream_info(film->format, NULL);
    if (error >= 0) error = open_codec(film, threads);
    if (error < 0) {
        cn_film_close(out);
        return no_film(path, error);
    }
    for (unsigned i = 0; telemetry && i < film->format->nb_streams && film->gpmf < 0; i++)
        if (film->format->streams[i]->codecpar->codec_tag == MKTAG('g', 'p', 'm', 'd')) film->gpmf = (int)i;
    film->telemetry = telemetry;
    read_facts(film);
    return CN_OK;
}

void cn_film_close(cn_film **out)
{
    cn_film *film = *out;
    if (!film) return;
    av_frame_free(&film->frame);
    av_packet_free(&film->packet);
    avcodec_free_context(&film->codec);
    avformat_close_input(&film->format);
    free(film->path);
    free(film);
    *out = NULL;
}

const cn_film_facts *cn_film_facts_of(const cn_film *film)
{
    return &film->facts;
}

static double seconds(const cn_film *film, int stream, int64_t ticks)
{
    return (double)ticks * av_q2d(film->format->streams[stream]->time_base);
}

/* Gives the decoder the next packet of the video. Telemetry on the way is kept. */
static cn_status feed(cn_film *film)
{
    AVPacket *packet = film->packet;
    while (!film->draining) {
        const int error = av_read_frame(film->format, packet);
        if (error < 0) {
            /* A film that is cut off in the middle ends there. */
            film->draining = true;
            avcodec_send_packet(film->codec, NULL);
            return CN_OK;
        }
        cn_status status = CN_OK;
        const int stream = packet->stream_index;
        if (stream == film->gpmf && packet->pts != AV_NOPTS_VALUE) {
            const double begin_s = seconds(film, stream, packet->pts);
            status = cn_gps_track_add_gpmf(film->telemetry, packet->data, (size_t)packet->size, begin_s,
                                           begin_s + seconds(film, stream, packet->duration));
        }
        if (stream == film->video) avcodec_send_packet(film->codec, packet); /* damaged: the next one may do */
        av_packet_unref(packet);
        if (status != CN_OK || stream == film->video) return status;
    }
    return CN_OK;
}

cn_status cn_film_next(cn_film *film, const AVFrame **picture, double *time_s)
{
    for (;;) {
        const int error = avcodec_receive_frame(film->codec, film->frame);
        if (error == AVERROR(EAGAIN)) {
            CN_TRY(feed(film));
        } else if (error == AVERROR_EOF || (error < 0 && film->draining)) {
            *picture = NULL;
            return CN_OK;
        } else if (error >= 0 && film->frame->best_effort_timestamp != AV_NOPTS_VALUE) {
            const double at_s = seconds(film, film->video, film->frame->best_effort_timestamp);
            if (isnan(film->first_s)) film->first_s = at_s;
            *time_s = at_s - film->first_s;
            *picture = film->frame;
            return CN_OK;
        }
    }
}
