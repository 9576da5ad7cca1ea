#include "base/lock.h"

#include "base/file.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

struct cn_lock {
    int fd;
    char *path;
    char note[512];
    bool leaving;
    pthread_t thread;
    pthread_mutex_t mutex;
    pthread_cond_t wake;
};

static void host_name(char out[64])
{
    if (gethostname(out, 64) != 0) snprintf(out, 64, "unknown");
    out[63] = '\0';
    for (char *p = out; *p; p++)
        if (*p == ' ' || *p == '\n') *p = '_';
}

/* One write, so that a reader sees the old text or the new. */
static void write_text(const cn_lock *lock)
{
    char host[64], text[640];
    host_name(host);
    const int n = snprintf(text, sizeof text, "%s %ld\n%s\n", host, (long)getpid(), lock->note);
    if (pwrite(lock->fd, text, (size_t)n, 0) == n && ftruncate(lock->fd, n) == 0) return;
    /* On a full disk the text is lost, but touching the file still works. */
    (void)futimens(lock->fd, NULL);
}

static void *beat(void *user)
{
    cn_lock *lock = user;
    pthread_mutex_lock(&lock->mutex);
    while (!lock->leaving) {
        struct timespec until;
        clock_gettime(CLOCK_MONOTONIC, &until);
        until.tv_sec += CN_LOCK_BEAT_S;
        const int waited = pthread_cond_timedwait(&lock->wake, &lock->mutex, &until);
        if (waited == ETIMEDOUT && !lock->leaving) write_text(lock);
    }
    pthread_mutex_unlock(&lock->mutex);
    return NULL;
}

/* Signals go to the caller's threads. */
static int start_beat(cn_lock *lock)
{
    sigset_t all, before;
    pthread_condattr_t monotonic;
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_mutex_init(&lock->mutex, NULL);
    pthread_cond_init(&lock->wake, &monotonic);
    pthread_condattr_destroy(&monotonic);
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    const int error = pthread_create(&lock->thread, NULL, beat, lock);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    return error;
}

static struct flock whole_file(short type)
{
    return (struct flock){ .l_type = type, .l_whence = SEEK_SET };
}

typedef enum answer { MINE, TAKEN, NO_LOCKS } answer;
static answer ask_kernel(int fd, int command)
{
    struct flock range = whole_file(F_WRLCK);
    if (fcntl(fd, command, &range) == 0) return command == F_OFD_GETLK && range.l_type != F_UNLCK ? TAKEN : MINE;
    return errno == EAGAIN || errno == EACCES ? TAKEN : NO_LOCKS;
}

static void read_text(int fd, cn_lock_state *state)
{
    char text[640] = "";
    struct stat info;
    const ssize_t n = pread(fd, text, sizeof text - 1, 0);
    text[n > 0 ? n : 0] = '\0';
    if (sscanf(text, "%63s %ld", state->host, &state->pid) != 2) state->host[0] = '\0';
    const char *note = strchr(text, '\n');
    if (note) snprintf(state->note, sizeof state->note, "%.*s", (int)strcspn(note + 1, "\n"), note + 1);
    if (fstat(fd, &info) == 0) {
        struct timespec now;
        clock_gettime(CLOCK_REALTIME, &now);
        state->age_s = (double)(now.tv_sec - info.st_mtim.tv_sec) + 1e-9 * (double)(now.tv_nsec - info.st_mtim.tv_nsec);
    }
}

/* Whether the holder named in the text lives, as far as this machine knows. */
static bool lives(const cn_lock_state *state, answer kernel)
{
    char here[64];
    if (kernel == TAKEN) return true;
    if (!state->host[0]) return false;
    host_name(here);
    if (strcmp(here, state->host) != 0) return state->age_s < CN_LOCK_STALE_S;
    if (kernel == MINE) return false;
    return state->age_s < CN_LOCK_STALE_S && (kill((pid_t)state->pid, 0) == 0 || errno == EPERM);
}

void cn_lock_look(const char *path, cn_lock_state *state)
{
    *state = (cn_lock_state){ 0 };
    const int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0) return;
    state->there = true;
    read_text(fd, state);
    state->held = lives(state, ask_kernel(fd, F_OFD_GETLK));
    close(fd);
}

/* The previous holder may have removed the file between our open and our lock. Then we hold no lock. */
static bool still_there(int fd, const char *path)
{
    struct stat mine, named;
    return fstat(fd, &mine) == 0 && stat(path, &named) == 0 && mine.st_ino == named.st_ino &&
           mine.st_dev == named.st_dev;
}

static cn_status refuse(const cn_lock_state *state, const char *what)
{
    if (!state->host[0])
        return cn_fail(CN_ERR_LOCKED, "another process works on %s; wait for it, or stop it and run this again", what);
    return cn_fail(
        CN_ERR_LOCKED,
        "process %ld on %s works on %s (last heard of %.0f s ago); wait for it, or stop it and run this again",
        state->pid, state->host, what, state->age_s > 0 ? state->age_s : 0);
}

static cn_status open_mine(const char *path, const char *what, int *out)
{
    for (;;) {
        /* The umask decides: in a folder that a group shares, others of it take over what a killed process left. */
        const int fd = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0666);
        if (fd < 0)
            return cn_fail(CN_ERR_IO, "cannot write %s: %s; is the workspace read-only?", path, strerror(errno));
        const answer kernel = ask_kernel(fd, F_OFD_SETLK);
        cn_lock_state state = { 0 };
        read_text(fd, &state);
        if (lives(&state, kernel)) {
            close(fd);
            return refuse(&state, what);
        }
        if (still_there(fd, path)) {
            *out = fd;
            return CN_OK;
        }
        close(fd);
    }
}

cn_status cn_lock_take(cn_lock **lock, const char *path, const char *what)
{
    *lock = NULL;
    int fd;
    CN_TRY(open_mine(path, what, &fd));
    cn_lock *l = calloc(1, sizeof *l);
    if (l) l->fd = fd, l->path = strdup(path);
    if (l && l->path) {
        write_text(l);
        if (start_beat(l) == 0) {
            *lock = l;
            return CN_OK;
        }
    }
    unlink(path);
    close(fd);
    if (l) free(l->path);
    free(l);
    return cn_fail(CN_ERR_NOMEM, "out of memory or threads while taking %s", path);
}

void cn_lock_note(cn_lock *lock, const char *note)
{
    pthread_mutex_lock(&lock->mutex);
    snprintf(lock->note, sizeof lock->note, "%s", note);
    write_text(lock);
    pthread_mutex_unlock(&lock->mutex);
}

void cn_lock_release(cn_lock **lock)
{
    cn_lock *l = *lock;
    if (!l) return;
    pthread_mutex_lock(&l->mutex);
    l->leaving = true;
    pthread_cond_signal(&l->wake);
    pthread_mutex_unlock(&l->mutex);
    pthread_join(l->thread, NULL);
    /* Remove it while it is still locked: no other process can hold it. */
    unlink(l->path);
    close(l->fd);
    pthread_cond_destroy(&l->wake);
    pthread_mutex_destroy(&l->mutex);
    free(l->path);
    free(l);
    *lock = NULL;
}
