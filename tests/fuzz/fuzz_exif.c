/* Any bytes as a photo. The index reads its header. */
#include "fuzz.h"

#include "bridge/exiv2.h"
#include "bridge/oiio.h"

#include <math.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    cn_oiio_info info;
    cn_exif exif;
    const char *path = fuzz_file("photo.jpg", data, size);
    if (cn_oiio_read_info(path, &info) == CN_OK) {
        if (info.orientation < 1 || info.orientation > 8) abort();
        if (!isnan(info.exif.exposure_s) && !(info.exif.exposure_s > 0)) abort();
    }
    if (cn_exiv2_read(path, &exif) == CN_OK && exif.has_latlon && !(fabs(exif.latitude_deg) <= 90)) abort();
    if (!isnan(exif.exposure_s) && !(exif.exposure_s > 0)) abort();
    return 0;
}
