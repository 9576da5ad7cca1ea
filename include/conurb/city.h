/* conurb/city.h: a city's workspace: its folder and its city.yaml. Use an open city from one thread at a time, unless
 * a function says otherwise. */
#ifndef CONURB_CITY_H
#define CONURB_CITY_H
#include "conurb/base.h"
#include "conurb/video.h"
#ifdef __cplusplus
extern "C" {
#endif

/* An open workspace: its folder and its parsed city.yaml. */
typedef struct cn_city cn_city;

typedef struct cn_init_options {
    const char *photos; /* folder of the photos; this or video is required */
    const char *import; /* poses of another tool, a file or a folder, as cn_pose_run imports them; NULL: none */
    uint32_t width_px;  /* working width of the photos, pixels; 0: 800 */
    const char *video;  /* a film, out of which photos are taken to CITY/photos; see cn_video_take_photos */
    cn_film_options film;
} cn_init_options;
/* Makes the folder CITY with a commented city.yaml. CN_ERR_USAGE: CITY already is a workspace. CN_ERR_DATA: the
 * folder of photos, or the poses to import, are not there; whether the folder holds photos is seen by cn_city_poses.
 * Otherwise as cn_video_take_photos, when `video` is given. */
CN_API CN_NODISCARD cn_status cn_city_init(const cn_context *ctx, const char *city, const cn_init_options *options);
/* Opens a workspace. The caller closes it with cn_city_close. CN_ERR_CONFIG: an unknown key or a wrong type in
 * city.yaml; the message has file and line. CN_ERR_VERSION: a newer Conurb made the workspace. */
CN_API CN_NODISCARD cn_status cn_city_open(cn_city **city, const char *folder);
CN_API void cn_city_close(cn_city **city);
/* The folder of the workspace. Valid until cn_city_close. */
CN_API const char *cn_city_folder(const cn_city *city);

#ifdef __cplusplus
}
#endif
#endif
