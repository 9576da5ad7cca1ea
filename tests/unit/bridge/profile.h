/* Puts an ICC profile into a JPEG, as cameras do: in one segment right after the start. Include after cmocka. */
#ifndef CONURB_TEST_BRIDGE_PROFILE_H
#define CONURB_TEST_BRIDGE_PROFILE_H
#include <stddef.h>

/* The file at path is rewritten. size: at most 65,519 bytes, what one segment holds. */
void profile_into_jpeg(const char *path, const void *profile, size_t size);
#endif
