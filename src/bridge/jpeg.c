#include "bridge/jpeg.h"

#include "base/file.h"

#include <stdlib.h>
#include <string.h>

enum { MARKER = 0xff, STUFFED = 0x00, FIRST_RESTART = 0xd0, START = 0xd8, END = 0xd9 };

/* Segments with a length are skipped whole: a thumbnail inside EXIF has an end marker too. Bytes between are the
 * picture's, or extraneous. Behind the end phones append films and further pictures. */
static bool has_end(const unsigned char *data, size_t size)
{
    if (size < 2 || data[0] != MARKER || data[1] != START) return false;
    for (size_t i = 2; i + 1 < size;) {
        const unsigned char kind = data[i + 1];
        if (data[i] != MARKER || kind == MARKER) {
            i++;
        } else if (kind == END) {
            return true;
        } else if (kind == STUFFED || kind == 0x01 || (kind >= FIRST_RESTART && kind <= START)) {
            i += 2;
        } else if (i + 3 < size) {
            i += 2 + (size_t)(data[i + 2] << 8 | data[i + 3]);
        } else {
            return false;
        }
    }
    return false;
}

bool cn_jpeg_is_whole(const char *path, const char *warning)
{
    /* What libjpeg says where pixels are lost. It goes on after other warnings ("Invalid SOS parameters", "N extraneous
     * bytes before marker"), which phones and panorama cameras give cause for, with the picture complete. */
    static const char *const lost[] = { "remature end",   "bad Huffman code",  "bad arithmetic code",
                                        "instead of RST", "before marker 0xd", "Inconsistent progression" };
    char *data;
    size_t size;
    for (size_t i = 0; i < sizeof lost / sizeof *lost; i++)
        if (strstr(warning, lost[i])) return false;
    /* libjpeg passes on its first warning only. A file that is also cut off lacks its end. */
    if (cn_file_read(path, 0, &data, &size) != CN_OK) return false;
    const bool whole = has_end((const unsigned char *)data, size);
    free(data);
    return whole;
}
