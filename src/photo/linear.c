#include "photo/linear.h"

#include "base/file.h"
#include "bridge/exiv2.h"
#include "colour/icc.h"

#include <stdlib.h>
#include <string.h>

static bool has_chromaticities(const cn_oiio_info *info)
{
    return info->is_float &&
           (strcmp(info->colour_space, "ACEScg") == 0 || strcmp(info->colour_space, "ACES2065-1") == 0);
}

/* A profile that cannot be used is no error: then *icc is NULL, and *unread says why. */
static cn_status read_profile(const char *path, uint32_t channels, cn_icc **icc, char **unread)
{
    void *profile;
    size_t size;
    *icc = NULL;
    CN_TRY(cn_oiio_read_icc(path, &profile, &size));
    /* OpenImageIO 2.4 does not read the profile of HEIC and AVIF. */
    if (!profile) CN_TRY(cn_exiv2_read_icc(path, &profile, &size));
    const cn_status status = profile ? cn_icc_create(icc, profile, size, channels) : CN_OK;
    free(profile);
    if (status == CN_OK || status == CN_ERR_NOMEM) return status;
    *unread = cn_format("%s", cn_error_message());
    return *unread ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for %s", path);
}

/* The colour space of a photo without a profile. */
static const char *space_without(const char *path, const cn_oiio_info *info)
{
    cn_exif exif;
    if (info->is_float) return "Linear sRGB";
    return cn_exiv2_read(path, &exif) == CN_OK && exif.is_adobe_rgb ? "Adobe RGB (1998)" : "sRGB";
}

cn_status cn_photo_to_linear(const cn_colour *own, const char *path, const cn_oiio_info *info, float *rgba, size_t n,
                             char **unread)
{
    *unread = NULL;
    if (has_chromaticities(info)) return cn_colour_to_linear(own, info->colour_space, rgba, n, 4);
    cn_icc *icc;
    CN_TRY(read_profile(path, info->channels, &icc, unread));
    const cn_status status =
        icc ? cn_icc_to_linear(icc, own, rgba, n, 4) : cn_colour_to_linear(own, space_without(path, info), rgba, n, 4);
    cn_icc_destroy(&icc);
    return status;
}
