#include "base/number.h"

#include <stdio.h>

void cn_log(const cn_context *ctx, cn_log_level level, const char *format, ...)
{
    if (!ctx || !ctx->log) return;
    char text[2048];
    va_list arguments;
    va_start(arguments, format);
    int length = cn_vprint(text, sizeof text, format, arguments);
    va_end(arguments);
    ctx->log(ctx->user, level, length < 0 ? format : text);
}

void cn_progress(const cn_context *ctx, const cn_progress_report *report)
{
    if (ctx && ctx->progress) ctx->progress(ctx->user, report);
}

bool cn_stopping(const cn_context *ctx)
{
    return ctx && ctx->stop && __atomic_load_n(ctx->stop, __ATOMIC_RELAXED);
}

void cn_stop(int *stop)
{
    __atomic_store_n(stop, 1, __ATOMIC_RELAXED);
}
