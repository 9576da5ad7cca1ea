/* Locks between processes, on one machine or on several that share a file system: a file that its holder keeps locked
 * and keeps touching. */
#ifndef CONURB_BASE_LOCK_H
#define CONURB_BASE_LOCK_H
#include "conurb/base.h"

enum { CN_LOCK_BEAT_S = 5, CN_LOCK_STALE_S = 60 };

/* A lock that is held. One thread at a time may use it; a thread of its own keeps the file fresh every CN_LOCK_BEAT_S,
 * whatever the holder is busy with.
 *
 * The kernel's lock on the open file decides where it reaches: it goes with the process, however that ends, so a dead
 * holder on the same machine keeps nobody out. A file of another machine's holder counts as held until it has not been
 * touched for CN_LOCK_STALE_S, for not every shared file system tells of locks held elsewhere; clocks have to agree to
 * half of that. On a file system without locks the age decides alone, and a dead pid of this machine frees it at once;
 * two machines that start within a second of each other may then both get it. */
typedef struct cn_lock cn_lock;
/* path: the lock file, in a folder that is there. what: for the message, "tile 32TLT". CN_ERR_LOCKED names the holder
 * and when it was last heard of; CN_ERR_IO when the file cannot be made. */
CN_NODISCARD cn_status cn_lock_take(cn_lock **lock, const char *path, const char *what);
/* One line for those who look (cn_lock_look); counts as a beat. Cut at 511 bytes. */
void cn_lock_note(cn_lock *lock, const char *note);
/* Removes the file. NULL is fine. */
void cn_lock_release(cn_lock **lock);

typedef struct cn_lock_state {
    bool there; /* the file; without, nothing else is said */
    bool held;  /* by a process that lives, as far as can be told */
    char host[64];
    long pid;
    double age_s; /* since its last beat */
    char note[512];
} cn_lock_state;
/* Reads without taking. Any thread. */
void cn_lock_look(const char *path, cn_lock_state *state);
#endif
