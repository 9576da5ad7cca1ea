/* conurb/video.h: numbered pictures become a film: H.264 in MP4, through libavcodec, libswscale and libavformat. */
#ifndef CONURB_VIDEO_H
#define CONURB_VIDEO_H
#include "conurb/base.h"
#ifdef __cplusplus
extern "C" {
#endif

typedef struct cn_video_options {
    double fps;     /* pictures a second; default 24 */
    double quality; /* x264's constant rate factor, 0 (lossless) to 51; default 18 */
} cn_video_options;
CN_API cn_video_options cn_video_options_default(void);

/* Encodes n display-referred sRGB pictures (PNG; what OpenImageIO reads as integers) into `path`, an MP4 that plays
 * from its first bytes on (faststart). 4:2:0, limited range, matrix, primaries and transfer tagged BT.709 (ITU-R
 * BT.709-6); an odd last column or row is left out. The same pictures, options and libx264 give the same bytes: one
 * encoding thread, no dates. Memory is some pictures' worth, whatever n is. Written under a temporary name, synced,
 * renamed. CN_ERR_USAGE for no pictures, fps or quality out of range; CN_ERR_DATA naming the first picture whose size
 * differs from the first's or which is below 16 x 16; CN_ERR_IO and CN_ERR_FORMAT for pictures that cannot be read or a
 * film that cannot be written; CN_ERR_TOOL when this libavcodec has no libx264; CN_ERR_INTERRUPTED when asked to stop.
 * Reports progress as stage "video". May be called from several threads at once for different paths. */
CN_API CN_NODISCARD cn_status cn_video_encode(const cn_context *ctx, size_t n, const char *const *pictures,
                                              const cn_video_options *options, const char *path);

/* The encoder is silent; the container's messages go to libav's log, which a process has one of, and which the library
 * does not touch. A program that uses libav through Conurb alone calls this once, before anything else: it logs nothing
 * then. */
CN_API void cn_video_own_process(void);

#ifdef __cplusplus
}
#endif
#endif
