/* A folder for a test's own photos, and a context that remembers what was logged. Include after cmocka. */
#ifndef CONURB_TEST_PHOTO_SCRATCH_H
#define CONURB_TEST_PHOTO_SCRATCH_H
#include "../common.h"
#include "bridge/oiio.h"
#include "conurb/photo.h"

enum { SCRATCH_W = 48, SCRATCH_H = 32 };
typedef struct scratch {
    char folder[64];
    char logged[LOGGED];
    int reports;        /* of progress */
    double last, total; /* of the last report */
    cn_context context;
    cn_pool *pool; /* two threads */
} scratch;

int scratch_set_up(void **state); /* a fresh folder and an empty log for every test */
int scratch_tear_down(void **state);
/* Path below the folder; valid for the next three calls. Parent folders are made. */
const char *scratch_path(scratch *s, const char *name);
/* A photo with pixels chosen by `seed`. The file's ending gives the format. */
void scratch_photo(scratch *s, const char *name, unsigned seed, const cn_oiio_attribute *attributes);
/* Copies the first part of the file's bytes to another name; 1 copies all. */
void scratch_copy(scratch *s, const char *from, const char *to, double share);
#endif
