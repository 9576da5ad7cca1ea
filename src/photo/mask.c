#include "photo/mask.h"

#include "base/file.h"
#include "bridge/oiio.h"
#include "photo/maps.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

typedef struct mask {
    float *rgba;
    uint32_t width, height; /* of the file */
    uint8_t orientation;    /* of its pixels, as EXIF has it: 5 to 8 where the file lies on its side, else 1 */
} mask;

/* The pixel of the file that is shown at x, y. */
static const float *pixel_at(const mask *m, uint32_t x, uint32_t y)
{
    const uint32_t right = m->width - 1, bottom = m->height - 1;
    uint32_t u = x, v = y;
    if (m->orientation >= 5) {
        u = m->orientation == 7 || m->orientation == 8 ? right - y : y;
        v = m->orientation == 6 || m->orientation == 7 ? bottom - x : x;
    }
    return m->rgba + 4 * ((size_t)v * m->width + u);
}

static cn_status read_mask(const char *path, const cn_photo *photo, mask *m)
{
    cn_status status = cn_oiio_read_rgba(path, &m->rgba, &m->width, &m->height);
    if (status != CN_OK) {
        char why[512];
        snprintf(why, sizeof why, "%s", cn_error_message());
        return cn_fail(status, "the mask of %s: %s; repair or remove it", photo->name, why);
    }
    m->orientation = 1;
    if (cn_photo_same_shape(m->width, m->height, photo)) return CN_OK;
    if (photo->orientation < 5 || !cn_photo_same_shape(m->height, m->width, photo))
        return cn_photo_check_shape(path, m->width, m->height, photo);
    m->orientation = photo->orientation;
    return CN_OK;
}

cn_status cn_photo_apply_mask(const char *folder, const cn_photo *photo, float *rgba)
{
    mask m = { 0 };
    if (!photo->mask) return CN_OK;
    char *path = cn_path_join(folder, photo->mask);
    const cn_status status = path ? read_mask(path, photo, &m) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(path);
    const bool turned = m.orientation >= 5;
    const uint32_t w = photo->width, h = photo->height;
    const uint64_t shown_w = turned ? m.height : m.width, shown_h = turned ? m.width : m.height;
    for (uint32_t y = 0; status == CN_OK && y < h; y++)
        for (uint32_t x = 0; x < w; x++) {
            const float *p = pixel_at(&m, (uint32_t)(x * shown_w / w), (uint32_t)(y * shown_h / h));
            if (!(fmaxf(p[0], fmaxf(p[1], p[2])) > 0.5f)) rgba[4 * ((size_t)y * w + x) + 3] = 0;
        }
    free(m.rgba);
    return status;
}
