/* The pixel store's file: a header, one record a photo, then each photo's pixels from a page boundary on. Little-
 * endian. A store is replaced as a whole, so a file with its name is complete. */
#ifndef CONURB_PHOTO_STORE_H
#define CONURB_PHOTO_STORE_H
#include "conurb/photo.h"

#define CN_STORE_MAGIC "CONURB PIXELS" /* NUL-padded to 14 bytes; the version follows */
/* Version 1 took every integer photo as sRGB; it is still read. Version 2 uses ICC profiles. Version 3 has depth maps;
 * a store without them is written as version 2. Version 4 has normal maps; a store without them is written as an older
 * version. */
enum {
    CN_STORE_VERSION = 4,
    CN_STORE_DEPTH = 3,
    CN_STORE_PLAIN = 2,
    CN_STORE_PAGE = 4096,
    CN_STORE_NAME_SIZE = 448,
    CN_STORE_RECORD_SIZE = 512
};

typedef struct cn_store_record {
    uint64_t offset, hash, mask_hash; /* mask_hash 0: no mask */
    uint32_t width, height, full_width, reserved;
    uint64_t depth_hash;  /* 0: no depth map. Else one float per pixel follows the colours: metres, 0 where there is no
                             value */
    uint64_t normal_hash; /* 0: no normal map. Else four int8 per pixel follow: 127 times the normal in the axes of
                             cn_camera, and 0; all 0 where there is no value. The hash covers the file and its axes */
    uint8_t unused[8];
    char name[CN_STORE_NAME_SIZE];
} cn_store_record;
_Static_assert(sizeof(cn_store_record) == CN_STORE_RECORD_SIZE, "a record is part of the file format");

typedef struct cn_store_header {
    char magic[14];
    uint16_t version;
    uint64_t n_photos, width_px;
    uint8_t unused[32];
} cn_store_header;
_Static_assert(sizeof(cn_store_header) == 64, "the header is part of the file format");

/* Places of a photo that are left out, in cells: an equal part of its width and of its height each. */
enum { CN_HIDDEN_COLUMNS = 32, CN_HIDDEN_ROWS = 24 };

struct cn_pixel_store {
    int fd;
    char *path;
    cn_store_header head;
    cn_store_record *records;
    uint32_t (*hidden)[CN_HIDDEN_ROWS]; /* [photos]; NULL: nothing is hidden */
};

static inline uint64_t cn_store_pixel_bytes(const cn_store_record *r)
{
    return (uint64_t)r->width * r->height * 8;
}
/* Where the normals begin: behind the colours, and behind the depths if there are any. */
static inline uint64_t cn_store_normals_at(const cn_store_record *r)
{
    return (uint64_t)r->width * r->height * (r->depth_hash ? 12 : 8);
}
/* Bytes of the colours, and of the depths and normals if there are any. */
static inline uint64_t cn_store_photo_bytes(const cn_store_record *r)
{
    return cn_store_normals_at(r) + (r->normal_hash ? 4 * (uint64_t)r->width * r->height : 0);
}
/* Whether cn_pixel_store_build would leave the file as it is. */
CN_NODISCARD cn_status cn_pixel_store_is_done(const cn_photo_index *index, uint32_t width_px, const char *path,
                                              bool *done);
/* A store of n photos of one size, from rgbw[n][height][width][4], in memory that no file names. Caller closes. */
CN_NODISCARD cn_status cn_pixel_store_in_memory(cn_pixel_store **store, uint32_t n, uint32_t width, uint32_t height,
                                                const float *rgbw);
/* A whole photo as the file has it, into the caller's buffer: [height][width][4] half floats; [height][width] floats,
 * for a photo with depths; [height][width][4] int8, for one with normals. Errors as in cn_store_read_at. */
CN_NODISCARD cn_status cn_store_read_colours(const cn_pixel_store *store, uint32_t photo, uint16_t *half);
CN_NODISCARD cn_status cn_store_read_depths(const cn_pixel_store *store, uint32_t photo, float *depth_m);
CN_NODISCARD cn_status cn_store_read_normals(const cn_pixel_store *store, uint32_t photo, int8_t *normal);
/* The same store once more, in which places may be hidden. It needs the first no longer. The caller closes it. */
CN_NODISCARD cn_status cn_pixel_store_copy(const cn_pixel_store *store, cn_pixel_store **copy);
/* From now on pixels in these cells of a photo weigh 0, as if a mask left them out. cells[row]: a bit for each column.
 */
CN_NODISCARD cn_status cn_pixel_store_hide(cn_pixel_store *store, uint32_t photo, const uint32_t cells[CN_HIDDEN_ROWS]);
/* Whether a pixel of a photo is hidden, in a store that has hidden places. */
static inline bool cn_store_hides(const cn_pixel_store *store, uint32_t photo, uint32_t x, uint32_t y)
{
    const cn_store_record *r = &store->records[photo];
    const uint32_t column = x * CN_HIDDEN_COLUMNS / r->width, row = y * CN_HIDDEN_ROWS / r->height;
    return store->hidden[photo][row] >> column & 1;
}
/* size bytes at offset; CN_ERR_FORMAT past the end of the file. Thread-safe. */
CN_NODISCARD cn_status cn_store_read_at(const cn_pixel_store *store, void *data, size_t size, uint64_t offset);
#endif
