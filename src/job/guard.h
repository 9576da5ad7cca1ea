/* A stage at work: it holds its lock, and says in it how far it is. */
#ifndef CONURB_JOB_GUARD_H
#define CONURB_JOB_GUARD_H
#include "base/lock.h"
#include "job/stage.h"

typedef struct cn_guard {
    cn_context ctx; /* for the stage: reports also go into the lock */
    const cn_context *outer;
    cn_lock *lock;
    double noted;
} cn_guard;
/* Makes CITY/FOLDER, takes FOLDER/LOCK and removes the temporaries that dead processes left in FOLDER. what: for the
 * message, "tile 32TLT". CN_ERR_LOCKED when another process has it. The guard must stay where it is until it is
 * dropped. */
CN_NODISCARD cn_status cn_guard_take(cn_guard *guard, const cn_context *ctx, const cn_city *city, const char *folder,
                                     const char *what);
/* As that, with a folder of any place, a lock of that name, and only temporaries that no living writer can have: for a
 * folder in which several work at once. */
CN_NODISCARD cn_status cn_guard_share(cn_guard *guard, const cn_context *ctx, const char *folder, const char *name,
                                      const char *what);
/* Where CITY/FOLDER is done: removes the lock and the temporaries of a process that died there, if any. */
void cn_guard_tidy(const cn_city *city, const char *folder);
/* Fine on a zeroed guard and twice. */
void cn_guard_drop(cn_guard *guard);
#endif
