#include "app.h"

#include "conurb/device.h"

#include <stdlib.h>

/* A device that is not available is no error. The processor does the work, and a warning says why. */
cn_status cn_app_choose_device(cn_context *ctx, const char *name)
{
    const char *choice = name ? name : getenv("CONURB_DEVICE");
    if (!choice || !*choice) return CN_OK; /* city.yaml may choose one */
    const cn_status status = cn_device_create(choice, &ctx->device);
    if (status == CN_ERR_USAGE)
        return cn_fail(status, "%s: %s", name ? "--device" : "CONURB_DEVICE", cn_error_message());
    if (status != CN_OK) cn_log(ctx, CN_LOG_WARN, "%s; the processor does the work", cn_error_message());
    for (const cn_device *d = ctx->device; d; d = cn_device_next(d))
        cn_log(ctx, CN_LOG_INFO, "device: %s", cn_device_about(d)->name);
    return CN_OK;
}
