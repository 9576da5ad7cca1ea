/* Puts an ICC profile or EXIF into a JPEG, byte by byte as cameras do, right after its start. Include after cmocka. */
#ifndef CONURB_TEST_BRIDGE_SEGMENT_H
#define CONURB_TEST_BRIDGE_SEGMENT_H
#include <stddef.h>
#include <stdint.h>

/* At most 65,519 bytes, what one segment holds. The file at path is rewritten. */
void segment_profile(const char *path, const void *profile, size_t size);

/* An XMP packet. */
void segment_xmp(const char *path, const char *text);

enum segment_folder { SEGMENT_IMAGE, SEGMENT_PHOTO, SEGMENT_GPS };
/* A tag of one to three rationals (n_rationals > 0), or of text. Those of one folder come in order of their number. */
typedef struct segment_tag {
    enum segment_folder folder;
    uint16_t number;
    const char *text;
    uint32_t n_rationals, rationals[3][2];
} segment_tag;
void segment_exif(const char *path, const segment_tag *tags, size_t n);
#endif
