/* Any bytes as a photo: what the index takes from its head. */
#include "fuzz.h"

#include "bridge/oiio.h"

#include <math.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    cn_oiio_info info;
    if (cn_oiio_read_info(fuzz_file("photo.jpg", data, size), &info) == CN_OK) {
        if (info.orientation < 1 || info.orientation > 8) abort();
        if (!isnan(info.exposure_s) && !(info.exposure_s > 0)) abort();
    }
    return 0;
}
