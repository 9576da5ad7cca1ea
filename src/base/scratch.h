/* Scratch files on disk: they have no name, and vanish when they are closed or the process ends. */
#ifndef CONURB_BASE_SCRATCH_H
#define CONURB_BASE_SCRATCH_H
#include "conurb/base.h"

/* Opens one in the folder of `path`. CN_ERR_IO: the message names the folder. The caller closes *fd. */
CN_NODISCARD cn_status cn_scratch_open(const char *path, int *fd);
/* The failure of a read or write of it; `what` is "read" or "write", error is errno. */
cn_status cn_scratch_failure(const char *path, const char *what, int error);
#endif
