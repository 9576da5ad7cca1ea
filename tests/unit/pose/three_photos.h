/* For tests of poses that other tools write: three photos, their true poses, and the file that is written of them. */
#ifndef CONURB_TEST_THREE_PHOTOS_H
#define CONURB_TEST_THREE_PHOTOS_H
#include "../common.h"
#include "conurb/pose.h"

enum { N = 3, ROOM = 8192 };
extern char folder[64], logged[LOGGED];
extern const cn_context CONTEXT; /* logs there */
extern cn_photo photos[N];
extern cn_photo_index photo_index;
extern cn_view views[N]; /* the truth, as a COLMAP model has it */

/* For a test's set-up and tear-down: a fresh folder and log, photos of these names and of this size. 0, or -1. */
int photos_make(const char *const names[N], uint32_t width, uint32_t height);
int photos_remove(void **state);
/* world_from_cam of a view, with the camera's y and z turned by `sign`: 4 x 4, row by row. */
void world_from_cam(int view, double sign, double m[16]);

/* The file: begin() names it and empties its text, say() adds to the text. */
extern char path[160], said[ROOM];
void begin(const char *name);
CN_PRINTF(1, 2) void say(const char *format, ...);
/* The text with `old` replaced by `fresh`; valid until the next call. */
const char *changed(const char *old, const char *fresh);
#endif
