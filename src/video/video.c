#include "conurb/video.h"

#include "base/clock.h"
#include "base/file.h"
#include "bridge/oiio.h"

#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/opt.h>
#include <libswscale/swscale.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MIN_SIDE 16u

typedef struct encoder {
    const cn_context *ctx;
    const char *path;
    AVCodecContext *codec;
    AVFormatContext *format;
    AVStream *stream;
    AVFrame *rgb, *yuv;
    AVPacket *packet;
    struct SwsContext *scaler;
    uint32_t width, height; /* of the pictures */
} encoder;

cn_video_options cn_video_options_default(void)
{
    return (cn_video_options){ .fps = 24, .quality = 18 };
}

static cn_status av_failure(const encoder *e, const char *what, int error)
{
    char text[AV_ERROR_MAX_STRING_SIZE] = "";
    av_strerror(error, text, sizeof text);
    if (error == AVERROR(ENOMEM)) return cn_fail(CN_ERR_NOMEM, "out of memory for the film %s", e->path);
    return cn_fail(CN_ERR_IO, "cannot write the film %s: %s: %s", e->path, what, text);
}

#define AV_TRY(e, what, call)                                                                                          \
    do {                                                                                                               \
        int av_try_ = (call);                                                                                          \
        if (av_try_ < 0) return av_failure((e), (what), av_try_);                                                      \
    } while (0)

static cn_status open_codec(encoder *e, const cn_video_options *options)
{
    const AVCodec *codec = avcodec_find_encoder_by_name("libx264");
    if (!codec)
        return cn_fail(CN_ERR_TOOL,
                       "no film %s: this system's libavcodec has no libx264; install one that has (on Debian "
                       "libavcodec59 or libavcodec-extra59)",
                       e->path);
    e->codec = avcodec_alloc_context3(codec);
    if (!e->codec) return av_failure(e, "encoder", AVERROR(ENOMEM));
    AVCodecContext *c = e->codec;
    const AVRational fps = av_d2q(options->fps, 100000);
    c->width = (int)(e->width & ~1u);
    c->height = (int)(e->height & ~1u);
    c->pix_fmt = AV_PIX_FMT_YUV420P;
    c->time_base = av_inv_q(fps);
    c->framerate = fps;
    c->sample_aspect_ratio = (AVRational){ 1, 1 };
    c->color_range = AVCOL_RANGE_MPEG;
    c->colorspace = AVCOL_SPC_BT709;
    c->color_primaries = AVCOL_PRI_BT709;
    c->color_trc = AVCOL_TRC_BT709;
    c->chroma_sample_location = AVCHROMA_LOC_LEFT;
    c->log_level_offset = AV_LOG_MAX_OFFSET; /* errors are returned, not printed */
    c->thread_count = 1;                     /* x264's output depends on its number of threads */
    c->flags |= AV_CODEC_FLAG_GLOBAL_HEADER | AV_CODEC_FLAG_BITEXACT;
    AV_TRY(e, "crf", av_opt_set_double(c->priv_data, "crf", options->quality, 0));
    AV_TRY(e, "preset", av_opt_set(c->priv_data, "preset", "medium", 0));
    AV_TRY(e, "encoder", avcodec_open2(c, codec, NULL));
    return CN_OK;
}

static cn_status open_file(encoder *e, const char *temporary)
{
    AV_TRY(e, "container", avformat_alloc_output_context2(&e->format, NULL, "mp4", temporary));
    e->format->flags |= AVFMT_FLAG_BITEXACT;
    e->stream = avformat_new_stream(e->format, NULL);
    if (!e->stream) return av_failure(e, "stream", AVERROR(ENOMEM));
    e->stream->time_base = e->codec->time_base;
    e->stream->avg_frame_rate = e->codec->framerate;
    AV_TRY(e, "stream", avcodec_parameters_from_context(e->stream->codecpar, e->codec));
    AV_TRY(e, "opening", avio_open(&e->format->pb, temporary, AVIO_FLAG_WRITE));
    AVDictionary *wishes = NULL;
    av_dict_set(&wishes, "movflags", "+faststart+write_colr", 0);
    int error = avformat_write_header(e->format, &wishes);
    av_dict_free(&wishes);
    AV_TRY(e, "header", error);
    return CN_OK;
}

static cn_status make_frame(const encoder *e, AVFrame **frame, enum AVPixelFormat format)
{
    *frame = av_frame_alloc();
    if (!*frame) return av_failure(e, "picture", AVERROR(ENOMEM));
    (*frame)->format = format;
    (*frame)->width = e->codec->width;
    (*frame)->height = e->codec->height;
    AV_TRY(e, "picture", av_frame_get_buffer(*frame, 0));
    return CN_OK;
}

static cn_status open_scaler(encoder *e)
{
    CN_TRY(make_frame(e, &e->rgb, AV_PIX_FMT_RGB24));
    CN_TRY(make_frame(e, &e->yuv, AV_PIX_FMT_YUV420P));
    e->packet = av_packet_alloc();
    const int w = e->codec->width, h = e->codec->height;
    e->scaler = sws_getContext(w, h, AV_PIX_FMT_RGB24, w, h, AV_PIX_FMT_YUV420P,
                               SWS_BICUBIC | SWS_ACCURATE_RND | SWS_FULL_CHR_H_INP | SWS_BITEXACT, NULL, NULL, NULL);
    if (!e->packet || !e->scaler) return av_failure(e, "picture", AVERROR(ENOMEM));
    const int *bt709 = sws_getCoefficients(SWS_CS_ITU709);
    AV_TRY(e, "colour", sws_setColorspaceDetails(e->scaler, bt709, 1, bt709, 0, 0, 1 << 16, 1 << 16));
    return CN_OK;
}

/* Writes the packets that the encoder has ready. frame NULL: flush. */
static cn_status encode_frame(encoder *e, const AVFrame *frame)
{
    AV_TRY(e, "encoding", avcodec_send_frame(e->codec, frame));
    for (;;) {
        int error = avcodec_receive_packet(e->codec, e->packet);
        if (error == AVERROR(EAGAIN) || error == AVERROR_EOF) return CN_OK;
        AV_TRY(e, "encoding", error);
        if (!e->packet->duration) e->packet->duration = 1;
        av_packet_rescale_ts(e->packet, e->codec->time_base, e->stream->time_base);
        e->packet->stream_index = e->stream->index;
        error = av_interleaved_write_frame(e->format, e->packet);
        if (error >= 0 && e->format->pb->error < 0) error = e->format->pb->error;
        AV_TRY(e, "writing", error);
    }
}

static cn_status add_picture(encoder *e, const char *picture, int64_t at)
{
    float *rgba;
    uint32_t width, height;
    CN_TRY(cn_oiio_read_rgba(picture, &rgba, &width, &height));
    if (width != e->width || height != e->height) {
        free(rgba);
        return cn_fail(CN_ERR_DATA, "%s is %u x %u pixels, but the film %s is %u x %u; render all frames at one size",
                       picture, width, height, e->path, e->width, e->height);
    }
    int error = av_frame_make_writable(e->rgb);
    if (error >= 0) error = av_frame_make_writable(e->yuv);
    for (int y = 0; y < e->codec->height && error >= 0; y++)
        for (int x = 0; x < e->codec->width; x++)
            for (int c = 0; c < 3; c++) {
                const float v = rgba[4 * ((size_t)y * width + (size_t)x) + (size_t)c];
                e->rgb->data[0][(ptrdiff_t)y * e->rgb->linesize[0] + 3 * x + c] =
                    (uint8_t)lrintf(fminf(fmaxf(v, 0), 1) * 255);
            }
    free(rgba);
    AV_TRY(e, "picture", error);
    sws_scale(e->scaler, (const uint8_t *const *)e->rgb->data, e->rgb->linesize, 0, e->codec->height, e->yuv->data,
              e->yuv->linesize);
    e->yuv->pts = at;
    return encode_frame(e, e->yuv);
}

static cn_status encode_all(encoder *e, size_t n, const char *const *pictures)
{
    const double started = cn_now_s();
    for (size_t i = 0; i < n; i++) {
        if (cn_stopping(e->ctx))
            return cn_fail(CN_ERR_INTERRUPTED, "stopped while making %s; run the same command to make it", e->path);
        CN_TRY(add_picture(e, pictures[i], (int64_t)i));
        const double elapsed = cn_now_s() - started, done = (double)i + 1, total = (double)n;
        const cn_progress_report report = {
            "video", NULL, done, total, elapsed, elapsed / done * (total - done), NULL
        };
        cn_progress(e->ctx, &report);
    }
    CN_TRY(encode_frame(e, NULL));
    AV_TRY(e, "closing", av_write_trailer(e->format));
    AV_TRY(e, "closing", avio_closep(&e->format->pb));
    return CN_OK;
}

static void close_encoder(encoder *e)
{
    if (e->format) avio_closep(&e->format->pb);
    avformat_free_context(e->format);
    avcodec_free_context(&e->codec);
    av_frame_free(&e->rgb);
    av_frame_free(&e->yuv);
    av_packet_free(&e->packet);
    sws_freeContext(e->scaler);
}

void cn_video_own_process(void)
{
    av_log_set_level(AV_LOG_QUIET);
}

cn_status cn_video_encode(const cn_context *ctx, size_t n, const char *const *pictures, const cn_video_options *options,
                          const char *path)
{
    if (!n) return cn_fail(CN_ERR_USAGE, "no pictures for the film %s", path);
    if (!(options->fps >= 0.01 && options->fps <= 1000))
        return cn_fail(CN_ERR_USAGE, "%g frames a second is not possible for a film; give 0.01 to 1000", options->fps);
    if (!(options->quality >= 0 && options->quality <= 51))
        return cn_fail(CN_ERR_USAGE, "a film's quality is 0 to 51, not %g", options->quality);
    cn_oiio_info first;
    CN_TRY(cn_oiio_read_info(pictures[0], &first));
    if (first.width < MIN_SIDE || first.height < MIN_SIDE)
        return cn_fail(CN_ERR_DATA, "%s is %u x %u pixels, too small for a film; each side needs at least %u",
                       pictures[0], first.width, first.height, MIN_SIDE);
    char *temporary = cn_file_temporary(path);
    if (!temporary) return cn_fail(CN_ERR_NOMEM, "out of memory for the film %s", path);
    encoder e = { .ctx = ctx, .path = path, .width = first.width, .height = first.height };
    cn_status status = open_codec(&e, options);
    if (status == CN_OK) status = open_file(&e, temporary);
    if (status == CN_OK) status = open_scaler(&e);
    if (status == CN_OK) status = encode_all(&e, n, pictures);
    close_encoder(&e);
    if (status == CN_OK)
        status = cn_file_replace(temporary, path);
    else
        remove(temporary);
    free(temporary);
    return status;
}
