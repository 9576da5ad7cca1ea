/* conurb/base.h: status codes, error text, logging, progress, threads.
 * Every fallible function returns cn_status; the text for the last failure on a
 * thread is cn_error_message(). Libraries never print and never exit.
 * Numbers in files and messages have a dot, whatever setlocale() has set. The global locale of C++
 * (std::locale::global) must keep its dot: OpenColorIO reads its config by it, and the functions that
 * need colours fail with CN_ERR_CONFIG under another. */
#ifndef CONURB_BASE_H
#define CONURB_BASE_H

#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#if defined(__GNUC__)
#define CN_NODISCARD __attribute__((warn_unused_result))
#define CN_PRINTF(fmt_index, first) __attribute__((format(printf, fmt_index, first)))
#else
#define CN_NODISCARD
#define CN_PRINTF(fmt_index, first)
#endif
#define CN_API __attribute__((visibility("default")))

/* Status codes. The value is also the exit code of the conurb binary. */
typedef enum cn_status {
    CN_OK = 0,
    CN_ERR_INTERNAL = 1, /* a bug in Conurb */
    CN_ERR_USAGE = 2,    /* wrong command line or argument */
    CN_ERR_CONFIG = 3,   /* city.yaml: unknown key, wrong type, bad value */
    CN_ERR_DATA = 4,     /* the photos or poses cannot be worked with */
    CN_ERR_FORMAT = 5,   /* a file is damaged or is not what it should be */
    CN_ERR_IO = 6,       /* reading or writing failed: disk full, read-only, missing */
    CN_ERR_NOMEM = 7,
    CN_ERR_TOOL = 8,        /* a program that a stage runs is missing or failed */
    CN_ERR_VERSION = 9,     /* made by a newer Conurb */
    CN_ERR_LOCKED = 10,     /* another process works on this */
    CN_ERR_INTERRUPTED = 75 /* stopped by a signal; a rerun resumes */
} cn_status;

/* Records a message for this thread and returns `status`. Name the file, photo or key at
 * fault and what to do about it. Messages are cut at 1023 bytes. */
CN_API cn_status cn_fail(cn_status status, const char *format, ...) CN_PRINTF(2, 3);
/* The message of the last failure on this thread; "" if none. Valid until the next failure. */
CN_API const char *cn_error_message(void);
/* Short, lower case, constant: "out of memory". */
CN_API const char *cn_status_name(cn_status status);
/* Forwards a failure to the caller. */
#define CN_TRY(call)                                                                                                   \
    do {                                                                                                               \
        cn_status cn_try_status_ = (call);                                                                             \
        if (cn_try_status_ != CN_OK) return cn_try_status_;                                                            \
    } while (0)

/* Semantic version of the library, "0.1.0". A constant string. */
CN_API const char *cn_version(void);

typedef enum cn_log_level { CN_LOG_DEBUG, CN_LOG_INFO, CN_LOG_WARN, CN_LOG_ERROR } cn_log_level;

/* One report of a long job. Strings live until the callback returns. */
typedef struct cn_progress_report {
    const char *stage;        /* "photos", "poses", "train", ... */
    const char *item;         /* tile id, photo name, or NULL */
    double done, total;       /* same unit; total 0 when unknown */
    double elapsed_s, left_s; /* left_s < 0 when unknown */
    const char *detail;       /* "PSNR 24.1 dB, 1.6 M samples/s" or NULL */
} cn_progress_report;

typedef struct cn_pool cn_pool;
typedef struct cn_device cn_device; /* conurb/device.h */

/* What the caller lends to a stage: threads, a log, a progress sink, a flag that asks it to stop.
 * All members may be zero: one thread, silence, no way to stop. The callbacks are called from the
 * calling thread only. */
typedef struct cn_context {
    cn_pool *pool;
    void (*log)(void *user, cn_log_level level, const char *text);
    void (*progress)(void *user, const cn_progress_report *report);
    void *user;
    /* Non-zero: finish the step, save, return CN_ERR_INTERRUPTED. The pool's threads read it with cn_stopping while the
     * caller's signal handler or another thread sets it, so set it with cn_stop (or __atomic_store_n). */
    const int *stop;
    cn_device *device; /* computes; NULL: the processor */
} cn_context;

/* Hand a line or a report to the sink of ctx, if there is one. ctx may be NULL. Log lines are cut at 2047 bytes. */
CN_API void cn_log(const cn_context *ctx, cn_log_level level, const char *format, ...) CN_PRINTF(3, 4);
CN_API void cn_progress(const cn_context *ctx, const cn_progress_report *report);
/* Whether the caller asked to stop; cheap enough to ask every step. Any thread. */
CN_API bool cn_stopping(const cn_context *ctx);
/* Sets the flag that a context's `stop` points to. Any thread; a signal handler may call it. */
CN_API void cn_stop(int *stop);

/* Thread pool. The calling thread is one of its threads (worker 0); the others block all signals, so signals reach the
 * caller's threads. n_threads 0: one a processor that this process may use (affinity respected).
 * CN_ERR_USAGE above 1024; CN_ERR_NOMEM when the system refuses a thread. cn_pool_destroy waits for the threads; NULL
 * is fine. */
CN_API CN_NODISCARD cn_status cn_pool_create(cn_pool **pool, unsigned n_threads);
CN_API void cn_pool_destroy(cn_pool **pool);
CN_API unsigned cn_pool_threads(const cn_pool *pool); /* 1 for NULL */
/* Runs task(user, i, worker) for every i in [0, n); returns when all are done. worker is in
 * [0, threads); two items at once never have the same worker. Items are handed out in order, so long ones belong first.
 * pool NULL: serial. What a task writes is seen by the caller afterwards. One caller at a time, and not reentrant: a
 * task must not call cn_pool_run on the same pool. */
CN_API void cn_pool_run(cn_pool *pool, size_t n, void (*task)(void *user, size_t i, unsigned worker), void *user);

#ifdef __cplusplus
}
#endif
#endif
