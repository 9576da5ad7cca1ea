/* conurb/video.h: encodes pictures as a film: H.264 in MP4, through libavcodec, libswscale and libavformat. */
#ifndef CONURB_VIDEO_H
#define CONURB_VIDEO_H
#include "conurb/base.h"
#ifdef __cplusplus
extern "C" {
#endif

typedef struct cn_video_options {
    double fps;     /* pictures per second; default 24 */
    double quality; /* x264's constant rate factor, 0 (lossless) to 51; default 18 */
} cn_video_options;
CN_API cn_video_options cn_video_options_default(void);

/* Encodes n display-encoded sRGB pictures (PNG, or another integer format that OpenImageIO reads) into the MP4 file
 * `path`. Players can start before the whole file has arrived (faststart). The film is 4:2:0 with limited range;
 * matrix, primaries and transfer are tagged BT.709 (ITU-R BT.709-6). An odd last column or row is left out. The same
 * pictures, options and libx264 give the same bytes: one thread encodes, and the file has no dates. Memory does not
 * grow with n. The file is written under a temporary name, synced and renamed.
 *
 * Reports progress as stage "video". Several threads may encode different paths at the same time. CN_ERR_USAGE: no
 * pictures, or fps or quality out of range. CN_ERR_DATA: a picture is smaller than 16 x 16, or differs in size from
 * the first; the message names it. CN_ERR_IO, CN_ERR_FORMAT: a picture cannot be read, or the film cannot be written.
 * CN_ERR_TOOL: this libavcodec has no libx264. CN_ERR_INTERRUPTED: asked to stop. */
CN_API CN_NODISCARD cn_status cn_video_encode(const cn_context *ctx, size_t n, const char *const *pictures,
                                              const cn_video_options *options, const char *path);

/* The encoder logs nothing. libavformat logs to libav's log, of which a process has one. The library does not change
 * it. A program that uses libav only through Conurb may call this once, before anything else: libav then logs nothing.
 */
CN_API void cn_video_own_process(void);

#ifdef __cplusplus
}
#endif
#endif
