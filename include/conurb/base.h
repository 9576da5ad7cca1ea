/* conurb/base.h: status codes, error text, logging, progress, threads.
 *
 * Every function that can fail returns cn_status. cn_error_message() gives the text of the last failure on the thread.
 * The library never prints and never exits.
 *
 * Numbers in files and messages have a decimal point, whatever setlocale() has set. The global locale of C++
 * (std::locale::global) must have a decimal point too: OpenColorIO reads its config by it. With another one, the
 * functions that need colours fail with CN_ERR_CONFIG. */
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
    CN_ERR_USAGE = 2,    /* a wrong command line or a wrong argument */
    CN_ERR_CONFIG = 3,   /* city.yaml: unknown key, wrong type, bad value */
    CN_ERR_DATA = 4,     /* the photos or poses cannot be used */
    CN_ERR_FORMAT = 5,   /* a file is damaged, or it is of another kind */
    CN_ERR_IO = 6,       /* reading or writing failed: disk full, read-only, file missing */
    CN_ERR_NOMEM = 7,
    CN_ERR_TOOL = 8,        /* a program that a stage needs is missing or failed */
    CN_ERR_VERSION = 9,     /* the file was made by a newer Conurb */
    CN_ERR_LOCKED = 10,     /* another process is working on this */
    CN_ERR_INTERRUPTED = 75 /* stopped on request; a second run resumes */
} cn_status;

/* Records a message for this thread and returns `status`. The message names the file, the photo or the key, says what
 * is wrong and what to do. It is cut at 1023 bytes. Any thread. */
CN_API cn_status cn_fail(cn_status status, const char *format, ...) CN_PRINTF(2, 3);
/* The message of the last failure on this thread; "" when there is none. Valid until the thread's next failure. */
CN_API const char *cn_error_message(void);
/* A short name of a status in lower case, such as "out of memory". A constant string. */
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

/* One progress report of a long job. The strings are valid until the callback returns. */
typedef struct cn_progress_report {
    const char *stage;        /* "photos", "poses", "train", ... */
    const char *item;         /* tile id, photo name, or NULL */
    double done, total;       /* both in the same unit; total is 0 when it is unknown */
    double elapsed_s, left_s; /* left_s < 0 when unknown */
    const char *detail;       /* "PSNR 24.1 dB, 1.6 M samples/s" or NULL */
} cn_progress_report;

typedef struct cn_pool cn_pool;
typedef struct cn_device cn_device; /* conurb/device.h */

/* What a caller passes to a long function: a thread pool, callbacks for the log and for progress, a stop flag, a
 * device. Everything is borrowed for the call. All members may be zero: then one thread works, nothing is reported,
 * and nothing stops the work. Callbacks run on the calling thread. */
typedef struct cn_context {
    cn_pool *pool;
    void (*log)(void *user, cn_log_level level, const char *text);
    void (*progress)(void *user, const cn_progress_report *report);
    void *user;
    /* NULL, or a flag. Non-zero asks to stop: the function finishes its step, saves, and returns CN_ERR_INTERRUPTED.
     * Pool threads read the flag while a signal handler or another thread sets it. Set it with cn_stop (or
     * __atomic_store_n). */
    const int *stop;
    cn_device *device; /* the device that computes, or the first of several; NULL: the processor */
} cn_context;

/* Pass a line or a report to the callback of ctx, if there is one. ctx may be NULL. Log lines are cut at 2047 bytes. */
CN_API void cn_log(const cn_context *ctx, cn_log_level level, const char *format, ...) CN_PRINTF(3, 4);
CN_API void cn_progress(const cn_context *ctx, const cn_progress_report *report);
/* Whether the caller has asked to stop. ctx may be NULL. Cheap enough for every step. Any thread. */
CN_API bool cn_stopping(const cn_context *ctx);
/* Sets the flag that a context's `stop` points to. Any thread; a signal handler may call it. */
CN_API void cn_stop(int *stop);

/* A thread pool. The calling thread is one of its threads (worker 0). The others block all signals, so that signals
 * reach the caller's threads. n_threads 0: one thread for each processor that this process may use (CPU affinity).
 * CN_ERR_USAGE: more than 1024 threads. CN_ERR_NOMEM: the system refuses a thread. cn_pool_destroy waits for the
 * threads, frees the pool and sets *pool to NULL; *pool may be NULL. */
CN_API CN_NODISCARD cn_status cn_pool_create(cn_pool **pool, unsigned n_threads);
CN_API void cn_pool_destroy(cn_pool **pool);
CN_API unsigned cn_pool_threads(const cn_pool *pool); /* 1 for NULL */
/* Runs task(user, i, worker) for every i in [0, n) and returns when all are done. worker is in [0, threads); two tasks
 * at the same time never have the same worker. Tasks start in the order of i: put long ones first. pool NULL: all run
 * on the calling thread. After the return, the caller sees everything that the tasks wrote. Only one thread at a time
 * may call this on a pool, and a task must not call it on its own pool. */
CN_API void cn_pool_run(cn_pool *pool, size_t n, void (*task)(void *user, size_t i, unsigned worker), void *user);

#ifdef __cplusplus
}
#endif
#endif
