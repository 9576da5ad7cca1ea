/* photos.json: what cn_photo_index_save writes. */
#ifndef CONURB_PHOTO_INDEX_FILE_H
#define CONURB_PHOTO_INDEX_FILE_H
#include "conurb/photo.h"

/* Hash of what the file says of the photos themselves: not of where their folder lies, nor of files that were left
 * out. */
CN_NODISCARD cn_status cn_photo_index_hash(const char *path, uint64_t *hash);
#endif
