/* Finds photos by name as cn_photo_index_find does, but fast for many names. */
#ifndef CONURB_POSE_FINDER_H
#define CONURB_POSE_FINDER_H
#include "conurb/photo.h"

typedef struct cn_finder_entry {
    const char *name;
    uint32_t photo;
} cn_finder_entry;
typedef struct cn_photo_finder {
    cn_finder_entry *whole, *bare; /* sorted by name, and by file name without folder */
    uint32_t n;
    bool ignores_folders; /* names of folders tell nothing: all photos lie in one, or a file names others alone */
    const cn_photo_index *of;
} cn_photo_finder;

/* Borrows the index. Nothing to free on failure. */
CN_NODISCARD cn_status cn_photo_finder_init(cn_photo_finder *finder, const cn_photo_index *index);
void cn_photo_finder_deinit(cn_photo_finder *finder);
/* Index of the photo of that name, or -1. A bare file name also matches when it is unique. For any thread. */
int64_t cn_photo_finder_find(const cn_photo_finder *finder, const char *name);
/* The photo that a path of another program or machine names: the one with which it has most in common from the end on,
 * in whole names of folders. -1 where there are several, or where both have folders left: they are then of different
 * folders, as cam1/2.jpg and cam0/2.jpg. Where all photos lie in one folder, its name does not count: it may have been
 * renamed. */
int64_t cn_photo_finder_match(const cn_photo_finder *finder, const char *path);
/* The ending of the n-th photo, in any folder, whose file name is that of the path, a dot and an ending; NULL: there
 * are not so many. */
const char *cn_photo_finder_ending(const cn_photo_finder *finder, const char *path, uint32_t n);
#endif
