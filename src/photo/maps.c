#include "photo/maps.h"

#include "base/file.h"
#include "bridge/oiio.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* FOLDER/NAME.png or .exr, NAME with or without the photo's own ending; NULL when there is none. */
static cn_status find_map(const char *folder, const char *name, char **found)
{
    static const char *const endings[] = { ".png", ".exr" };
    const char *base = strrchr(name, '/'), *dot = strrchr(base ? base : name, '.');
    const size_t whole = strlen(name), lengths[] = { whole, dot ? (size_t)(dot - name) : whole };
    *found = NULL;
    for (size_t i = 0; i < 4; i++) {
        char *path = cn_format("%s/%.*s%s", folder, (int)lengths[i / 2], name, endings[i % 2]);
        if (!path) return cn_fail(CN_ERR_NOMEM, "out of memory");
        if (cn_file_exists(path)) {
            *found = path;
            return CN_OK;
        }
        free(path);
    }
    return CN_OK;
}

cn_status cn_photo_index_find_maps(cn_photo_index *index, const cn_photo_maps *maps, uint32_t *n)
{
    *n = 0;
    for (uint32_t i = 0; i < index->n_photos; i++) {
        cn_photo *p = &index->photos[i];
        free(p->depth);
        p->depth = NULL;
        if (maps->depth) CN_TRY(find_map(maps->depth, p->name, &p->depth));
        *n += p->depth != NULL;
    }
    if (!maps->depth || *n) return CN_OK;
    return cn_fail(CN_ERR_DATA,
                   "photos.depth: no photo has a depth map in %s; name it as the photo, such as %s.png or .exr",
                   maps->depth, index->n_photos ? index->photos[0].name : "NAME");
}

/* A map may be smaller than its photo, as from depth cameras. Its aspect ratio must be the same, up to the rounding of
 * a pixel. */
static bool same_shape(const cn_oiio_map *map, const cn_photo *photo)
{
    const double w = (double)map->height * photo->width / photo->height,
                 h = (double)map->width * photo->height / photo->width;
    return fabs(w - map->width) <= 1 || fabs(h - map->height) <= 1;
}

static cn_status check(const cn_photo *photo, const cn_oiio_map *map)
{
    if (map->bits == 8)
        return cn_fail(CN_ERR_DATA, "%s has 8 bits per value; give a 16-bit PNG in millimetres or an EXR in metres",
                       photo->depth);
    if (same_shape(map, photo)) return CN_OK;
    return cn_fail(CN_ERR_DATA, "%s is %u x %u pixels and its photo %u x %u: give both the same aspect ratio",
                   photo->depth, map->width, map->height, photo->width, photo->height);
}

cn_status cn_photo_read_depth(const cn_photo *photo, uint32_t width, uint32_t height, float *depth_m)
{
    cn_oiio_map map;
    CN_TRY(cn_oiio_read_map(photo->depth, 1, &map));
    const cn_status status = check(photo, &map);
    const float unit = map.bits ? 65.535f : 1; /* metres for a value of 1 */
    for (uint32_t y = 0; y < height && status == CN_OK; y++)
        for (uint32_t x = 0; x < width; x++) {
            const size_t u = (size_t)((x + 0.5) * map.width / width), v = (size_t)((y + 0.5) * map.height / height);
            const float value = unit * map.values[v * map.width + u];
            depth_m[(size_t)y * width + x] = isfinite(value) && value > 0 ? value : 0;
        }
    free(map.values);
    return status;
}
