/* For tests in which a shell script plays COLMAP: the script, and photos for it. */
#ifndef CONURB_TEST_FAKE_COLMAP_H
#define CONURB_TEST_FAKE_COLMAP_H
#include "conurb/photo.h"

/* n photos, a.jpg to z.jpg at most, that say nothing of their camera. Their names hold until the next call. */
void fake_colmap_photos(cn_photo *photos, int n, uint32_t width, uint32_t height);
/* Writes the script, which starts with #!/bin/sh. Asked for help, it prints the file PROGRAM.help, if there is one. */
CN_PRINTF(2, 3) void fake_colmap_write(const char *program, const char *format, ...);
#endif
