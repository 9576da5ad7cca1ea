#include "base/number.h"

#include <stdio.h>
#include <string.h>

#define CN_ERROR_BYTES 1024

static _Thread_local char error_text[CN_ERROR_BYTES];

cn_status cn_fail(cn_status status, const char *format, ...)
{
    /* An argument may be cn_error_message() itself, so write to another buffer first. */
    char text[CN_ERROR_BYTES];
    va_list arguments;
    va_start(arguments, format);
    int length = cn_vprint(text, sizeof text, format, arguments);
    va_end(arguments);
    if (length < 0) snprintf(text, sizeof text, "%s", format);
    memcpy(error_text, text, strlen(text) + 1);
    return status;
}

const char *cn_error_message(void)
{
    return error_text;
}

const char *cn_status_name(cn_status status)
{
    switch (status) {
    case CN_OK: return "ok";
    case CN_ERR_INTERNAL: return "internal error";
    case CN_ERR_USAGE: return "wrong usage";
    case CN_ERR_CONFIG: return "wrong configuration";
    case CN_ERR_DATA: return "unusable data";
    case CN_ERR_FORMAT: return "damaged or foreign file";
    case CN_ERR_IO: return "reading or writing failed";
    case CN_ERR_NOMEM: return "out of memory";
    case CN_ERR_TOOL: return "a program is missing or failed";
    case CN_ERR_VERSION: return "made by a newer version";
    case CN_ERR_LOCKED: return "in use by another process";
    case CN_ERR_INTERRUPTED: return "interrupted";
    }
    return "unknown status";
}

const char *cn_version(void)
{
    return CN_VERSION_STRING;
}
