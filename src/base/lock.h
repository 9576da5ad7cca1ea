/* Locks between processes, on one machine or on several machines that share a file system. A lock is a file that its
 * holder keeps locked and touches regularly. */
#ifndef CONURB_BASE_LOCK_H
#define CONURB_BASE_LOCK_H
#include "conurb/base.h"

enum { CN_LOCK_BEAT_S = 5, CN_LOCK_STALE_S = 60 };

/* A lock that is held. Use it from one thread at a time. A thread of its own touches the file every CN_LOCK_BEAT_S,
 * whatever the holder does.
 *
 * On one machine the kernel's lock on the open file decides. It ends with the process, so a dead holder blocks nobody.
 * Not every shared file system passes such locks to other machines. So a lock of another machine counts as held until
 * its file has not been touched for CN_LOCK_STALE_S. The machines' clocks must agree to half of that. On a file system
 * without locks only the age counts, and a lock of a dead process of this machine is free at once. There, two machines
 * that start within a second of each other may both get the lock. */
typedef struct cn_lock cn_lock;
/* path: the lock file, in a folder that is there. what: for the message, "tile 32TLT". CN_ERR_LOCKED names the holder
 * and when it was last heard of; CN_ERR_IO when the file cannot be made. */
CN_NODISCARD cn_status cn_lock_take(cn_lock **lock, const char *path, const char *what);
/* Sets one line of text that cn_lock_look shows; also touches the file. Cut at 511 bytes. */
void cn_lock_note(cn_lock *lock, const char *note);
/* Removes the file. NULL is fine. */
void cn_lock_release(cn_lock **lock);

typedef struct cn_lock_state {
    bool there; /* whether the file exists; if not, no other member is set */
    bool held;  /* whether its process lives, as far as this machine knows */
    char host[64];
    long pid;
    double age_s; /* since its last beat */
    char note[512];
} cn_lock_state;
/* Reads without taking. Any thread. */
void cn_lock_look(const char *path, cn_lock_state *state);
#endif
