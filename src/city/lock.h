/* The lock of a running stage. The lock file also holds the stage's progress. */
#ifndef CONURB_CITY_LOCK_H
#define CONURB_CITY_LOCK_H
#include "base/lock.h"
#include "conurb/city.h"

typedef struct cn_city_lock {
    cn_context ctx; /* context for the stage: its reports also go into the lock file */
    const cn_context *outer;
    cn_lock *lock;
    double noted;
} cn_city_lock;
/* Makes CITY/FOLDER, takes FOLDER/LOCK and removes the temporaries that dead processes left in FOLDER. what: for the
 * message, "tile 32TLT". CN_ERR_LOCKED: another process has it. The guard must not be moved in memory until it is
 * dropped. */
CN_NODISCARD cn_status cn_city_lock_take(cn_city_lock *lock, const cn_context *ctx, const cn_city *city,
                                         const char *folder, const char *what);
/* The same for any folder and lock name. Removes only temporaries that are too old for a running writer, because
 * several processes may work in the folder. */
CN_NODISCARD cn_status cn_city_lock_share(cn_city_lock *lock, const cn_context *ctx, const char *folder,
                                          const char *name, const char *what);
/* When CITY/FOLDER is done: removes the lock and the temporaries that a killed process left there. */
void cn_city_lock_tidy(const cn_city *city, const char *folder);
/* Safe on a zeroed guard, and twice. */
void cn_city_lock_drop(cn_city_lock *lock);
#endif
