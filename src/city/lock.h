/* A stage at work: it holds its lock, and says in it how far it is. */
#ifndef CONURB_CITY_LOCK_H
#define CONURB_CITY_LOCK_H
#include "base/lock.h"
#include "conurb/city.h"

typedef struct cn_city_lock {
    cn_context ctx; /* for the stage: reports also go into the lock */
    const cn_context *outer;
    cn_lock *lock;
    double noted;
} cn_city_lock;
/* Makes CITY/FOLDER, takes FOLDER/LOCK and removes the temporaries that dead processes left in FOLDER. what: for the
 * message, "tile 32TLT". CN_ERR_LOCKED when another process has it. The guard must stay where it is until it is
 * dropped. */
CN_NODISCARD cn_status cn_city_lock_take(cn_city_lock *lock, const cn_context *ctx, const cn_city *city,
                                         const char *folder, const char *what);
/* As that, with a folder of any place, a lock of that name, and only temporaries that no living writer can have: for a
 * folder in which several work at once. */
CN_NODISCARD cn_status cn_city_lock_share(cn_city_lock *lock, const cn_context *ctx, const char *folder,
                                          const char *name, const char *what);
/* Where CITY/FOLDER is done: removes the lock and the temporaries of a process that died there, if any. */
void cn_city_lock_tidy(const cn_city *city, const char *folder);
/* Fine on a zeroed guard and twice. */
void cn_city_lock_drop(cn_city_lock *lock);
#endif
