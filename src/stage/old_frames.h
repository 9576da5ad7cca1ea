/* Frames of an earlier, longer render in the folder of a flight. */
#ifndef CONURB_STAGE_OLD_FRAMES_H
#define CONURB_STAGE_OLD_FRAMES_H
#include "conurb/base.h"

/* Whether the file is a marker that a render wrote when its pictures were complete: a hash and a line break. */
bool cn_is_render_mark(const char *path);
/* Whether the folder has frames from number n on that are marked as complete. False when it cannot be read. */
bool cn_old_frames_exist(const char *folder, uint32_t n);
/* Removes them: NNNNN.exr, NNNNN.png, the PNGs of channels, and last the marker NNNNN.json. What has no marker stays.
 */
CN_NODISCARD cn_status cn_old_frames_remove(const char *folder, uint32_t n);
#endif
