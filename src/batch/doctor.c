#include "conurb/batch.h"
#include "conurb/device.h"

#include "base/clock.h"
#include "base/file.h"
#include "base/number.h"
#include "base/process.h"
#include "batch/queue.h"
#include "geo/geoid.h"
#include "kernel/kernel.h"
#include "pose/colmap_options.h"

#include <errno.h>
#include <fcntl.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/statvfs.h>
#include <unistd.h>

enum { DISK_BYTES = 64 << 20, DISK_BLOCK = 1 << 20, TYPICAL_PHOTOS = 200 /* of a tile */ };
#define TYPICAL_PHOTO_BYTES (8.0 * 800 * 600) /* on a device */

static cn_check *add(cn_checks *checks, const char *name)
{
    cn_check *larger = realloc(checks->list, (checks->n + 1) * sizeof *larger);
    if (!larger) return NULL;
    checks->list = larger;
    cn_check *check = &larger[checks->n++];
    *check = (cn_check){ 0 };
    snprintf(check->name, sizeof check->name, "%s", name);
    return check;
}

/* Versions are read from the names of the loaded libraries: "libOpenImageIO.so.2.4.7". */
static void check_libraries(cn_check *check)
{
    static const char *const wanted[] = { "libOpenImageIO.so.", "libOpenColorIO.so.", "libGeographicLib.so.",
                                          "libproj.so.",        "libjansson.so.",     "libyaml-0.so.",
                                          "libavcodec.so." };
    FILE *maps = fopen("/proc/self/maps", "re");
    char line[1024];
    bool seen[sizeof wanted / sizeof *wanted] = { false };
    size_t n = 0;
    while (maps && fgets(line, sizeof line, maps)) {
        line[strcspn(line, "\n")] = '\0';
        const char *base = cn_path_base(line);
        for (size_t i = 0; i < sizeof wanted / sizeof *wanted; i++) {
            if (seen[i] || strncmp(base, wanted[i], strlen(wanted[i])) != 0) continue;
            seen[i] = true;
            const char *dot = strchr(base, '.');
            n += (size_t)snprintf(check->found + n, sizeof check->found - n, "%s%.*s %s", n ? ", " : "",
                                  (int)(dot - base - 3), base + 3, dot + 4);
        }
    }
    if (maps) fclose(maps);
    check->good = n > 0;
    if (!check->good)
        snprintf(check->lack, sizeof check->lack,
                 "the system does not say which libraries are loaded (/proc/self/maps)");
}

static void check_processor(cn_check *check)
{
    cpu_set_t set;
    const int n = sched_getaffinity(0, sizeof set, &set) == 0 ? CPU_COUNT(&set) : 1;
    const char *kernels = cn_kernel_best()->name;
    const cn_kernel *sets[4];
    char names[64] = "";
    for (int i = 0, n_sets = cn_kernel_sets(sets); i < n_sets; i++) {
        const size_t used = strlen(names);
        snprintf(names + used, sizeof names - used, " %s", sets[i]->name);
    }
    snprintf(check->found, sizeof check->found, "%d processors for this process; kernel sets:%s; kernel set in use: %s",
             n, names, kernels);
    check->good = strcmp(kernels, "ref") != 0;
    if (!check->good)
        snprintf(check->lack, sizeof check->lack,
                 "without AVX2 or NEON (or under CONURB_CPU=ref) training takes some ten times as long");
}

/* Having none is not reported as missing: the processor then does all the work. */
static void check_device(cn_check *check)
{
    cn_device_info list[CN_DEVICE_MAX];
    uint32_t n;
    size_t used = 0;
    check->good = true;
    if (cn_device_list(list, &n) != CN_OK) {
        snprintf(check->found, sizeof check->found, "none, the processor does all: %s", cn_error_message());
        return;
    }
    for (uint32_t i = 0; i < n && used < sizeof check->found; i++) {
        const int wrote = cn_print(
            check->found + used, sizeof check->found - used, "%sgpu:%u %s, Vulkan %u.%u, %.1f of %.1f GB free%s%s",
            i ? "; " : "", i, list[i].name, list[i].version[0], list[i].version[1], (double)list[i].free_bytes / 1e9,
            (double)list[i].bytes / 1e9, list[i].software ? " (software: slower than the processor)" : "",
            list[i].fit ? "" : " (not fit: Vulkan 1.3 is wanted)");
        used += wrote > 0 ? (size_t)wrote : 0;
    }
    const cn_train_options standard = cn_train_options_preset(CN_QUALITY_STANDARD);
    const cn_plan_tile tile = { .n_photos = TYPICAL_PHOTOS };
    if (used < sizeof check->found)
        cn_print(check->found + used, sizeof check->found - used,
                 "; a tile at standard quality takes %.1f GB there, and its photos %.1f GB",
                 (double)cn_train_device_bytes(&standard, &tile) / 1e9, TYPICAL_PHOTOS * TYPICAL_PHOTO_BYTES / 1e9);
}

static double cgroup_bytes(void)
{
    FILE *stream = fopen("/sys/fs/cgroup/memory.max", "re");
    double bytes = 0;
    if (!stream) return 0;
    if (fscanf(stream, "%lf", &bytes) != 1) bytes = 0;
    fclose(stream);
    return bytes;
}

static void check_memory(cn_check *check)
{
    char key[32];
    double kilobytes = 0, available = 0, seconds;
    FILE *stream = fopen("/proc/meminfo", "re");
    while (stream && fscanf(stream, "%31s %lf%*[^\n]", key, &kilobytes) == 2)
        if (strcmp(key, "MemAvailable:") == 0) available = kilobytes * 1024;
    if (stream) fclose(stream);
    const double limit = cgroup_bytes();
    if (limit > 0 && limit < available) available = limit;
    const cn_train_options standard = cn_train_options_preset(CN_QUALITY_STANDARD);
    const cn_plan_tile tile = { .n_photos = TYPICAL_PHOTOS };
    uint64_t bytes;
    cn_train_cost(&standard, &tile, &seconds, &bytes);
    cn_print(check->found, sizeof check->found, "%.1f GB free; a tile at standard quality takes about %.1f GB",
             available / 1e9, (double)bytes / 1e9);
    check->good = available > 1.5 * (double)bytes;
    if (!check->good)
        snprintf(check->lack, sizeof check->lack,
                 "lower train.samples_per_step or field.log2_table, or train with --quality preview");
}

/* Seconds to write DISK_BYTES through to the disk, or -1 with errno. */
static double time_disk(const char *folder)
{
    char *path = cn_path_join(folder, "conurb-doctor"), *temporary = path ? cn_file_temporary(path) : NULL,
         *block = malloc(DISK_BLOCK);
    double seconds = -1;
    const int fd = temporary && block ? open(temporary, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600) : -1;
    if (fd >= 0) {
        const double began = cn_now_s();
        size_t written = 0;
        for (size_t i = 0; i < DISK_BLOCK; i++)
            block[i] = (char)(i * 2654435761u >> 16);
        while (written < DISK_BYTES && write(fd, block, DISK_BLOCK) == DISK_BLOCK)
            written += DISK_BLOCK;
        if (written == DISK_BYTES && fsync(fd) == 0) seconds = cn_now_s() - began;
        const int error = errno;
        close(fd);
        unlink(temporary);
        errno = error;
    }
    free(block);
    free(temporary);
    free(path);
    return seconds;
}

static void check_disk(cn_check *check, const char *folder)
{
    struct statvfs info;
    const double seconds = time_disk(folder);
    if (seconds < 0) {
        snprintf(check->lack, sizeof check->lack, "%s cannot be written: %s", folder, strerror(errno));
        return;
    }
    const double room = statvfs(folder, &info) == 0 ? (double)info.f_bavail * (double)info.f_frsize : 0;
    cn_print(check->found, sizeof check->found, "%.0f GB free at %s, written at %.0f MB/s", room / 1e9, folder,
             DISK_BYTES / 1e6 / seconds);
    check->good = room > 5e9 && seconds < DISK_BYTES / 20e6;
    if (room <= 5e9)
        snprintf(check->lack, sizeof check->lack, "a city takes some 2 MB a photo and 50 MB a tile");
    else if (!check->good)
        snprintf(check->lack, sizeof check->lack,
                 "checkpoints will take long; raise train.checkpoint_every_s or use a faster disk");
}

typedef struct ear {
    char line[200];
    const char *wanted;
} ear;
static void hear(void *user, char *line)
{
    ear *e = user;
    const char *at = strstr(line, e->wanted);
    if (at && !e->line[0]) snprintf(e->line, sizeof e->line, "%s", at);
}

/* Finds a program's version: the first line of its output that contains the word. False when it cannot be run, or does
 * not end. */
static bool ask(const cn_context *ctx, const char *const *argv, const char *wanted, char *out, size_t size)
{
    ear e = { "", wanted };
    const cn_process program = {
        .argv = argv, .log_path = "/dev/null", .on_line = hear, .user = &e, .limit_s = CN_SLURM_LIMIT_S
    };
    int code;
    const bool ran = cn_process_watch(ctx, &program, &code) == CN_OK;
    if (ran)
        snprintf(out, size, "%s%s", e.line[0] ? e.line : argv[0],
                 e.line[0] ? "" : " is there, but does not tell its version");
    return ran;
}

static void check_program(const cn_context *ctx, cn_check *check, const char *const *argv, const char *wanted,
                          const char *lack)
{
    check->good = ask(ctx, argv, wanted, check->found, sizeof check->found);
    if (!check->good) snprintf(check->lack, sizeof check->lack, "%s", lack);
}

/* Which mapper large collections get. */
static void check_colmap(const cn_context *ctx, cn_check *check)
{
    static const char *const help[] = { "colmap", "help", NULL };
    char global[200] = "";
    check_program(ctx, check, help, "COLMAP",
                  "poses have to be imported: conurb init --import MODEL, or transforms.json");
    if (!check->good) return;
    const bool has = ask(ctx, help, "global_mapper", global, sizeof global) && strstr(global, "global_mapper");
    const size_t used = strlen(check->found);
    snprintf(check->found + used, sizeof check->found - used, "; groups of photos are mapped by %s global mapper",
             has ? "its" : "Conurb's");
    check->good = cn_colmap_check_options(ctx, help[0]) == CN_OK;
    if (!check->good) snprintf(check->lack, sizeof check->lack, "%s", cn_error_message());
}

static void check_slurm(const cn_context *ctx, cn_check *check)
{
    static const char *const version[] = { "sbatch", "--version", NULL }, *const config[] = { "scontrol", "show",
                                                                                              "config", NULL };
    char requeue[200] = "";
    check_program(ctx, check, version, "slurm", "conurb submit --engine slurm only writes scripts here (--dry-run)");
    if (!check->good) return;
    check->good = ask(ctx, config, "RequeueExit ", requeue, sizeof requeue) && strstr(requeue, "75");
    if (!check->good)
        snprintf(check->lack, sizeof check->lack,
                 "RequeueExit=75 is not in slurm.conf (or the controller is not reached): tasks that stop with a "
                 "checkpoint ask scontrol to be started again");
}

static void check_geoid(cn_check *check)
{
    const double zero = 0;
    double height;
    bool found = false;
    check->good = cn_geoid_heights(CN_GEOID_GRID, 1, &zero, &zero, &height, &found) == CN_OK && found;
    snprintf(check->found, sizeof check->found, "%s", check->good ? "EGM96 (" CN_GEOID_GRID ")" : "");
    if (!check->good)
        snprintf(check->lack, sizeof check->lack,
                 CN_GEOID_GRID " is not installed (Debian: proj-data): heights above sea level in EXIF are taken "
                               "for heights above the ellipsoid, up to 100 m off");
}

cn_status cn_doctor(const cn_context *ctx, const char *folder, cn_checks *checks)
{
    static const char *const kubectl[] = { "kubectl", "version", "--client", NULL };
    static const char *const names[] = { "libraries", "processor", "memory",     "disk",  "geoid",
                                         "COLMAP",    "Slurm",     "Kubernetes", "device" };
    *checks = (cn_checks){ 0 };
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        cn_check *check = add(checks, names[i]);
        if (!check) {
            cn_checks_deinit(checks);
            return cn_fail(CN_ERR_NOMEM, "out of memory");
        }
        if (i == 0) check_libraries(check);
        if (i == 1) check_processor(check);
        if (i == 2) check_memory(check);
        if (i == 3) check_disk(check, folder);
        if (i == 4) check_geoid(check);
        if (i == 5) check_colmap(ctx, check);
        if (i == 6) check_slurm(ctx, check);
        if (i == 7)
            check_program(ctx, check, kubectl, "Client",
                          "conurb submit --engine kubernetes only writes manifests here (--dry-run)");
        if (i == 8) check_device(check);
    }
    return CN_OK;
}

void cn_checks_deinit(cn_checks *checks)
{
    free(checks->list);
    *checks = (cn_checks){ 0 };
}
