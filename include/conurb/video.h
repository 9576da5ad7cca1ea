/* conurb/video.h: pictures to a film (H.264 in MP4), and photos out of a film, through libavcodec, libswscale and
 * libavformat. */
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

typedef struct cn_film_options {
    double every_s;    /* about one photo for so many seconds in which the camera moves; default 0.5 */
    const char *track; /* GPX, KML with a gx:Track, or the SRT of a DJI drone; NULL: what the film holds, or an SRT or
                          GPX of the film's name beside it */
    double offset_s;   /* seconds that the track's clock is ahead of the film's; default 0 */
} cn_film_options;
CN_API cn_film_options cn_film_options_default(void);

/* Takes photos out of the film `path` and writes them to `folder`, which it makes: JPEG of quality 95, upright,
 * FILM_MILLISECONDS.jpg. The film is cut into parts of equal camera motion, and a sharp picture of each is kept; where
 * the camera stands still no photos arise. Motion is the normal flow of small pictures, sharpness the energy of the
 * Laplacian. EXIF gets the time, where the film says when it was made, the make and model, and the place: from
 * options->track, else from the film's own telemetry (GoPro's GPMF), else from an SRT or GPX beside it. Times of an SRT
 * and of telemetry count from the film's start; those of GPX and KML are UTC, as the film's creation time, which is
 * taken for its start. The same film gives the same files. Memory does not grow with the film but for 24 bytes a
 * picture.
 *
 * *n_photos: how many. Reports progress as stage "frames". CN_ERR_USAGE: every_s out of range. CN_ERR_IO: the film is
 * not there, or a photo cannot be written. CN_ERR_FORMAT: no film or track that can be read. CN_ERR_DATA: the film has
 * no picture, or the track covers another time. CN_ERR_INTERRUPTED: asked to stop; the same call writes all again. */
CN_API CN_NODISCARD cn_status cn_video_take_photos(const cn_context *ctx, const char *path, const char *folder,
                                                   const cn_film_options *options, size_t *n_photos);

/* The encoder logs nothing. libavformat logs to libav's log, of which a process has one. The library does not change
 * it. A program that uses libav only through Conurb may call this once, before anything else: libav then logs nothing.
 */
CN_API void cn_video_own_process(void);

#ifdef __cplusplus
}
#endif
#endif
