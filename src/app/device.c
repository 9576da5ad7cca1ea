#include "app.h"

#include "conurb/device.h"

#include <stdlib.h>

/* A device that is not available is no error. The processor does the work, and a warning says why. */
cn_status cn_app_choose_device(cn_context *ctx, const char *name, bool computes)
{
    const char *choice = name ? name : getenv("CONURB_DEVICE");
    const bool asked = choice && *choice;
    if (!asked && !computes) return CN_OK;
    const cn_status status = cn_device_create(asked ? choice : "auto", &ctx->device);
    if (status == CN_ERR_USAGE)
        return cn_fail(status, "%s: %s", name ? "--device" : "CONURB_DEVICE", cn_error_message());
    if (status != CN_OK) cn_log(ctx, CN_LOG_WARN, "%s; the processor does the work", cn_error_message());
    for (const cn_device *d = ctx->device; d; d = cn_device_next(d))
        if (asked || cn_device_about(d)->version[0])
            cn_log(ctx, CN_LOG_INFO, "device: %s%s", cn_device_about(d)->name,
                   asked ? "" : ", found here; with --device cpu the processor does the work");
    return CN_OK;
}
