/* LD_PRELOAD layer for the power-loss test: keeps, in $CONURB_SYNCED, what is on the disk for certain.
 *
 * POSIX promises a file's content once fsync on it returned, and the names in a folder once fsync on the folder
 * returned; nothing else. So every fsync under $CONURB_SYNCED_ROOT leaves a copy: data/INODE for a file,
 * names/INODE-BIRTH for a folder (a line "INODE NAME" each). pin/INODE is a hard link, so that an inode's number is not
 * given to another file. power_loss.py puts the pieces together again. */
#include <dirent.h>
#include <dlfcn.h>
#include <fcntl.h>
#include <inttypes.h>
#include <limits.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static void die(const char *what)
{
    perror(what);
    _exit(99);
}

static void copy_data(int fd, const char *store, uint64_t inode)
{
    char path[PATH_MAX], temporary[PATH_MAX + 16], from[64], block[65536];
    snprintf(from, sizeof from, "/proc/self/fd/%d", fd);
    snprintf(path, sizeof path, "%s/pin/%" PRIu64, store, inode);
    (void)!linkat(AT_FDCWD, from, AT_FDCWD, path, AT_SYMLINK_FOLLOW);
    snprintf(path, sizeof path, "%s/data/%" PRIu64, store, inode);
    snprintf(temporary, sizeof temporary, "%s.%ld", path, (long)getpid());
    const int in = open(from, O_RDONLY | O_CLOEXEC),
              out = open(temporary, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    if (in < 0 || out < 0) die("synced: copy");
    for (ssize_t n; (n = read(in, block, sizeof block)) > 0;)
        if (write(out, block, (size_t)n) != n) die("synced: write");
    close(in);
    close(out);
    if (rename(temporary, path) != 0) die("synced: rename");
}

/* Folders cannot be pinned; with its time of birth an inode's number is one folder's. */
static void copy_names(int fd, const char *store)
{
    struct statx info;
    if (statx(fd, "", AT_EMPTY_PATH, STATX_INO | STATX_BTIME, &info) != 0) die("synced: statx");
    char path[PATH_MAX], temporary[PATH_MAX + 16];
    snprintf(path, sizeof path, "%s/names/%" PRIu64 "-%" PRId64 ".%09" PRIu32, store, (uint64_t)info.stx_ino,
             (int64_t)info.stx_btime.tv_sec, (uint32_t)info.stx_btime.tv_nsec);
    snprintf(temporary, sizeof temporary, "%s.%ld", path, (long)getpid());
    FILE *out = fopen(temporary, "we");
    DIR *dir = fdopendir(openat(fd, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC));
    if (!out || !dir) die("synced: names");
    for (const struct dirent *e; (e = readdir(dir));) {
        struct statx entry;
        if (strcmp(e->d_name, ".") == 0 || strcmp(e->d_name, "..") == 0) continue;
        if (statx(fd, e->d_name, AT_SYMLINK_NOFOLLOW, STATX_INO | STATX_BTIME | STATX_TYPE, &entry) != 0) continue;
        if (S_ISDIR(entry.stx_mode))
            fprintf(out, "%" PRIu64 "-%" PRId64 ".%09" PRIu32 " %s\n", (uint64_t)entry.stx_ino,
                    (int64_t)entry.stx_btime.tv_sec, (uint32_t)entry.stx_btime.tv_nsec, e->d_name);
        else
            fprintf(out, "%" PRIu64 " %s\n", (uint64_t)entry.stx_ino, e->d_name);
    }
    closedir(dir);
    fclose(out);
    if (rename(temporary, path) != 0) die("synced: rename");
}

static void keep(int fd)
{
    const char *store = getenv("CONURB_SYNCED"), *root = getenv("CONURB_SYNCED_ROOT");
    char link[64], path[PATH_MAX];
    struct stat info;
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    const ssize_t n = readlink(link, path, sizeof path - 1);
    if (!store || !root || n < 0 || fstat(fd, &info) != 0) return;
    path[n] = '\0';
    if (strncmp(path, root, strlen(root)) != 0) return;
    if (S_ISDIR(info.st_mode))
        copy_names(fd, store);
    else if (S_ISREG(info.st_mode))
        copy_data(fd, store, (uint64_t)info.st_ino);
}

int fsync(int fd)
{
    int (*real)(int);
    *(void **)&real = dlsym(RTLD_NEXT, "fsync");
    const int result = real(fd);
    if (result == 0) keep(fd);
    return result;
}

int fdatasync(int fd)
{
    return fsync(fd);
}
